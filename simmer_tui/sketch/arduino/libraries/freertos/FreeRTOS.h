// Types and constants of FreeRTOS.
#pragma once
#include "../../core/Arduino.h"

// Their widths are those of the board.
#if defined(SIMMER_ESP32)
typedef int BaseType_t;
typedef unsigned int UBaseType_t;
typedef uint32_t TickType_t;
typedef uint8_t StackType_t;
#define portMAX_DELAY ((TickType_t)0xFFFFFFFFu)
#define configTICK_RATE_HZ 1000
#define portTICK_PERIOD_MS ((TickType_t)1)
#define configMAX_PRIORITIES 25
#define configMINIMAL_STACK_SIZE 768
#define configTIMER_TASK_PRIORITY 1
#define tskNO_AFFINITY 0x7FFFFFFF
#define portNUM_PROCESSORS 2
// A lock between the cores: here a critical section stops both.
struct portMUX_TYPE {
  int owner;
};
#define portMUX_INITIALIZER_UNLOCKED {0}
#else
typedef int8_t BaseType_t;
typedef uint8_t UBaseType_t;
typedef uint16_t TickType_t;
typedef uint8_t StackType_t;
#define portMAX_DELAY ((TickType_t)0xFFFF)
#define configTICK_RATE_HZ 62  // 128 kHz by 2,048, without its fraction
#define portTICK_PERIOD_MS ((TickType_t)16)
#define configMAX_PRIORITIES 4
#define configMINIMAL_STACK_SIZE 192
#define configTIMER_TASK_PRIORITY 3
#endif

#define pdMS_TO_TICKS(milliseconds) ((TickType_t)((uint64_t)(milliseconds) * configTICK_RATE_HZ / 1000))
#define pdTICKS_TO_MS(ticks) ((TickType_t)((uint64_t)(ticks) * 1000 / configTICK_RATE_HZ))

#define pdFALSE ((BaseType_t)0)
#define pdTRUE ((BaseType_t)1)
#define pdFAIL pdFALSE
#define pdPASS pdTRUE
#define errQUEUE_EMPTY pdFALSE
#define errQUEUE_FULL pdFALSE
#define errCOULD_NOT_ALLOCATE_REQUIRED_MEMORY (-1)

typedef void (*TaskFunction_t)(void*);
namespace board {
struct Task;
struct Queue;
struct Timer;
struct EventGroup;
}  // namespace board
typedef board::Task* TaskHandle_t;
typedef board::Queue* QueueHandle_t;
typedef board::Queue* SemaphoreHandle_t;
typedef board::Timer* TimerHandle_t;
typedef board::EventGroup* EventGroupHandle_t;

// Names of older versions.
typedef TaskHandle_t xTaskHandle;
typedef QueueHandle_t xQueueHandle;
typedef SemaphoreHandle_t xSemaphoreHandle;
typedef TimerHandle_t xTimerHandle;
typedef TickType_t portTickType;
typedef TaskFunction_t pdTASK_CODE;
#define portTICK_RATE_MS portTICK_PERIOD_MS
#define portCHAR char
#define portFLOAT float
#define portDOUBLE double
#define portLONG int32_t
#define portSHORT int16_t
#define portBASE_TYPE BaseType_t
#define portSTACK_TYPE StackType_t

#if defined(SIMMER_ESP32)
void portENTER_CRITICAL(portMUX_TYPE* lock = nullptr);
void portEXIT_CRITICAL(portMUX_TYPE* lock = nullptr);
#define portENTER_CRITICAL_ISR portENTER_CRITICAL
#define portEXIT_CRITICAL_ISR portEXIT_CRITICAL
#define taskENTER_CRITICAL_ISR portENTER_CRITICAL
#define taskEXIT_CRITICAL_ISR portEXIT_CRITICAL
inline void portMUX_INITIALIZE(portMUX_TYPE*) {}
inline void vPortCPUInitializeMutex(portMUX_TYPE*) {}
#else
void portENTER_CRITICAL();
void portEXIT_CRITICAL();
#endif
void portDISABLE_INTERRUPTS();
void portENABLE_INTERRUPTS();
void portYIELD();
inline void vPortYield() { portYIELD(); }
// At the end of an interrupt's function: a task that it has woken runs at once, and not with the next tick only.
inline void portYIELD_FROM_ISR(BaseType_t is_woken = pdTRUE) {
  if (is_woken) portYIELD();
}
#define portEND_SWITCHING_ISR portYIELD_FROM_ISR
void* pvPortMalloc(size_t size);
void vPortFree(void* memory);
