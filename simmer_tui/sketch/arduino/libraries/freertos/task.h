// Tasks: their life, their waits, and notifications.
#pragma once
#include "FreeRTOS.h"

#define tskIDLE_PRIORITY ((UBaseType_t)0)
#define taskYIELD portYIELD
#define taskENTER_CRITICAL portENTER_CRITICAL
#define taskEXIT_CRITICAL portEXIT_CRITICAL
#define taskDISABLE_INTERRUPTS portDISABLE_INTERRUPTS
#define taskENABLE_INTERRUPTS portENABLE_INTERRUPTS

enum eTaskState { eRunning, eReady, eBlocked, eSuspended, eDeleted, eInvalid };
enum eNotifyAction { eNoAction, eSetBits, eIncrement, eSetValueWithOverwrite, eSetValueWithoutOverwrite };
enum { taskSCHEDULER_SUSPENDED = 0, taskSCHEDULER_NOT_STARTED = 1, taskSCHEDULER_RUNNING = 2 };

// A stack has 256 kB here, whatever its size on the board.
BaseType_t xTaskCreate(TaskFunction_t function, const char* name, unsigned int stack, void* argument,
                       unsigned int priority, TaskHandle_t* created);
#if defined(SIMMER_ESP32)
BaseType_t xTaskCreatePinnedToCore(TaskFunction_t function, const char* name, unsigned int stack, void* argument,
                                   unsigned int priority, TaskHandle_t* created, int core);
BaseType_t xPortGetCoreID();
#endif
void vTaskStartScheduler();
void vTaskDelete(TaskHandle_t task = nullptr);
void vTaskDelay(TickType_t ticks);
BaseType_t xTaskDelayUntil(TickType_t* previous, TickType_t ticks);
void vTaskDelayUntil(TickType_t* previous, TickType_t ticks);
BaseType_t xTaskAbortDelay(TaskHandle_t task);
void vTaskSuspend(TaskHandle_t task = nullptr);
void vTaskResume(TaskHandle_t task);
BaseType_t xTaskResumeFromISR(TaskHandle_t task);
void vTaskSuspendAll();
BaseType_t xTaskResumeAll();
TickType_t xTaskGetTickCount();
TickType_t xTaskGetTickCountFromISR();
void vTaskPrioritySet(TaskHandle_t task, unsigned int priority);
UBaseType_t uxTaskPriorityGet(TaskHandle_t task = nullptr);
TaskHandle_t xTaskGetCurrentTaskHandle();
TaskHandle_t xTaskGetHandle(const char* name);
char* pcTaskGetName(TaskHandle_t task = nullptr);
#define pcTaskGetTaskName pcTaskGetName
eTaskState eTaskGetState(TaskHandle_t task);
BaseType_t xTaskGetSchedulerState();
UBaseType_t uxTaskGetNumberOfTasks();
// Words of a stack that were never used: it is never full here.
unsigned int uxTaskGetStackHighWaterMark(TaskHandle_t task = nullptr);

BaseType_t xTaskNotifyGive(TaskHandle_t task);
void vTaskNotifyGiveFromISR(TaskHandle_t task, BaseType_t* is_woken);
uint32_t ulTaskNotifyTake(BaseType_t clear, TickType_t ticks);
BaseType_t xTaskNotify(TaskHandle_t task, uint32_t value, eNotifyAction action);
BaseType_t xTaskNotifyFromISR(TaskHandle_t task, uint32_t value, eNotifyAction action, BaseType_t* is_woken);
BaseType_t xTaskNotifyWait(uint32_t clear_before, uint32_t clear_after, uint32_t* value, TickType_t ticks);
BaseType_t xTaskNotifyStateClear(TaskHandle_t task = nullptr);
