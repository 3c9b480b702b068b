// Software timers. A task of the highest priority calls their functions.
#pragma once
#include "FreeRTOS.h"
#include "task.h"

typedef void (*TimerCallbackFunction_t)(TimerHandle_t);
#define tmrTIMER_CALLBACK TimerCallbackFunction_t

TimerHandle_t xTimerCreate(const char* name, TickType_t period, BaseType_t repeats, void* id,
                           TimerCallbackFunction_t function);
BaseType_t xTimerStart(TimerHandle_t timer, TickType_t ticks);
BaseType_t xTimerStop(TimerHandle_t timer, TickType_t ticks);
BaseType_t xTimerReset(TimerHandle_t timer, TickType_t ticks);
BaseType_t xTimerChangePeriod(TimerHandle_t timer, TickType_t period, TickType_t ticks);
BaseType_t xTimerDelete(TimerHandle_t timer, TickType_t ticks);
BaseType_t xTimerStartFromISR(TimerHandle_t timer, BaseType_t* is_woken);
BaseType_t xTimerStopFromISR(TimerHandle_t timer, BaseType_t* is_woken);
BaseType_t xTimerResetFromISR(TimerHandle_t timer, BaseType_t* is_woken);
BaseType_t xTimerChangePeriodFromISR(TimerHandle_t timer, TickType_t period, BaseType_t* is_woken);
BaseType_t xTimerIsTimerActive(TimerHandle_t timer);
void* pvTimerGetTimerID(TimerHandle_t timer);
void vTimerSetTimerID(TimerHandle_t timer, void* id);
const char* pcTimerGetName(TimerHandle_t timer);
#define pcTimerGetTimerName pcTimerGetName
TickType_t xTimerGetPeriod(TimerHandle_t timer);
TickType_t xTimerGetExpiryTime(TimerHandle_t timer);
void vTimerSetReloadMode(TimerHandle_t timer, BaseType_t repeats);
