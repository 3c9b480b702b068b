// FreeRTOS: tasks and their notifications.
#include <cstdlib>
#include <cstring>

#include "../../board/clock.h"
#include "../../board/interrupts.h"
#include "../../board/tasks.h"
#include "task.h"
#include "../../board/task_waits.h"

using namespace board;

#if defined(SIMMER_ESP32)
void portENTER_CRITICAL(portMUX_TYPE*) { enter_critical(); }
void portEXIT_CRITICAL(portMUX_TYPE*) { exit_critical(); }
#else
void portENTER_CRITICAL() { enter_critical(); }
void portEXIT_CRITICAL() { exit_critical(); }
#endif
void portDISABLE_INTERRUPTS() { noInterrupts(); }
void portENABLE_INTERRUPTS() { interrupts(); }
void portYIELD() { yield_task(); }
void* pvPortMalloc(size_t size) { return std::malloc(size); }
void vPortFree(void* memory) { std::free(memory); }

namespace {
Task& meant(TaskHandle_t task) { return task ? *task : running_task(); }
}  // namespace

namespace {
BaseType_t create(TaskFunction_t function, const char* name, void* argument, unsigned int priority,
                  TaskHandle_t* created, int core) {
  pass(cost::TASK_CREATE);
  Task* task = create_task(function, name, argument, priority, core);
  if (created) *created = task;
  if (is_urgent(*task)) ask_for_switch();
  return pdPASS;
}
}  // namespace

BaseType_t xTaskCreate(TaskFunction_t function, const char* name, unsigned int, void* argument, unsigned int priority,
                       TaskHandle_t* created) {
  return create(function, name, argument, priority, created, ANY_CORE);
}
#if defined(SIMMER_ESP32)
BaseType_t xTaskCreatePinnedToCore(TaskFunction_t function, const char* name, unsigned int, void* argument,
                                   unsigned int priority, TaskHandle_t* created, int core) {
  return create(function, name, argument, priority, created, core);
}
BaseType_t xPortGetCoreID() { return running_core(); }
#endif

void vTaskStartScheduler() {
  if (!tasks_run()) start_scheduler();
}

void vTaskDelete(TaskHandle_t task) {
  begin_call();
  delete_task(meant(task));
}

namespace {
void delay_task(uint64_t ticks, uint32_t at) {
  note_in_interrupt(InterruptCall::Task, at);
  pass(cost::TASK_CALL);
  if (ticks == 0) {
    yield_task();
    return;
  }
  const WaitScope scope(Waits::InTask, at);
  const uint64_t end = tick_count() + ticks;
  do
    block({WaitsFor::Time, nullptr, at}, end);
  while (is_idle() && tick_count() < end);
}

// A wait of no tick, which few mean: a tick of an AVR is long.
void look_at_ticks(TickType_t ticks, uint32_t at) {
  if (CORES == 1 && ticks == 0) note_mistake(Mistake::NoWait, at);
}

// Returns true if the moment was not over.
bool delay_until(TickType_t* previous, TickType_t ticks, uint32_t at) {
  look_at_ticks(ticks, at);
  if (CORES > 1 && ticks == 0) report_no_ticks(at - 1);
  const TickType_t gone = static_cast<TickType_t>(tick_count()) - *previous;
  *previous = static_cast<TickType_t>(*previous + ticks);
  if (gone >= ticks) {
    delay_task(0, at);
    return false;
  }
  delay_task(static_cast<TickType_t>(ticks - gone), at);
  return true;
}
}  // namespace

void vTaskDelay(TickType_t ticks) {
  look_at_ticks(ticks, CALLED_AT);
  delay_task(ticks, CALLED_AT);
}
BaseType_t xTaskDelayUntil(TickType_t* previous, TickType_t ticks) { return delay_until(previous, ticks, CALLED_AT); }
void vTaskDelayUntil(TickType_t* previous, TickType_t ticks) { delay_until(previous, ticks, CALLED_AT); }

BaseType_t xTaskAbortDelay(TaskHandle_t task) {
  begin_call();
  if (!task || task->state != TaskState::Blocked) return pdFAIL;
  make_ready(*task);
  ask_for_switch();
  return pdPASS;
}

void vTaskSuspend(TaskHandle_t task) {
  begin_call();
  suspend_task(meant(task));
}

void vTaskResume(TaskHandle_t task) {
  begin_call();
  if (!task || task->state != TaskState::Suspended) return;
  make_ready(*task);
  if (task->priority >= running_task().priority || is_urgent(*task)) ask_for_switch();
}

BaseType_t xTaskResumeFromISR(TaskHandle_t task) {
  pass(cost::TASK_CALL);
  if (!task || task->state != TaskState::Suspended) return pdFALSE;
  make_ready(*task);
  return is_urgent(*task);
}

void vTaskSuspendAll() { hold_switches(true); }
BaseType_t xTaskResumeAll() {
  hold_switches(false);
  return pdTRUE;
}

TickType_t xTaskGetTickCount() {
  pass(cost::MILLIS);
  return static_cast<TickType_t>(tick_count());
}
TickType_t xTaskGetTickCountFromISR() { return xTaskGetTickCount(); }

void vTaskPrioritySet(TaskHandle_t task, unsigned int priority) {
  begin_call();
  Task& each = meant(task);
  const bool inherits = each.priority > each.own_priority;
  each.own_priority = priority < PRIORITIES ? priority : PRIORITIES - 1;
  if (!inherits || each.own_priority > each.priority) set_priority(each, priority);
}
UBaseType_t uxTaskPriorityGet(TaskHandle_t task) { return static_cast<UBaseType_t>(meant(task).priority); }
TaskHandle_t xTaskGetCurrentTaskHandle() { return &running_task(); }
TaskHandle_t xTaskGetHandle(const char* name) { return task_named(name); }
char* pcTaskGetName(TaskHandle_t task) { return meant(task).name; }

eTaskState eTaskGetState(TaskHandle_t task) {
  if (!task) return eInvalid;
  if (task == &running_task()) return eRunning;
  switch (task->state) {
    case TaskState::Ready:
      return eReady;
    case TaskState::Blocked:
      return eBlocked;
    case TaskState::Suspended:
      return eSuspended;
    case TaskState::Deleted:
      break;
  }
  return eDeleted;
}

BaseType_t xTaskGetSchedulerState() {
  if (!tasks_run()) return taskSCHEDULER_NOT_STARTED;
  return switches_are_held() ? taskSCHEDULER_SUSPENDED : taskSCHEDULER_RUNNING;
}
UBaseType_t uxTaskGetNumberOfTasks() { return static_cast<UBaseType_t>(task_total()); }
unsigned int uxTaskGetStackHighWaterMark(TaskHandle_t) { return configMINIMAL_STACK_SIZE / 2; }

// -- notifications -----------------------------------------------------------------------------------

namespace {
const void* key_of(const Task& task) { return &task.notification; }

BaseType_t notify(TaskHandle_t task, uint32_t value, eNotifyAction action) {
  pass(cost::TASK_CALL);
  if (!task) return pdFAIL;
  const bool was_notified = task->is_notified;
  task->is_notified = true;
  switch (action) {
    case eNoAction:
      break;
    case eSetBits:
      task->notification |= value;
      break;
    case eIncrement:
      ++task->notification;
      break;
    case eSetValueWithoutOverwrite:
      if (was_notified) return pdFAIL;
      [[fallthrough]];
    case eSetValueWithOverwrite:
      task->notification = value;
  }
  return pdPASS;
}
}  // namespace

namespace {
[[gnu::always_inline]] inline BaseType_t notify_by_task(TaskHandle_t task, uint32_t value, eNotifyAction action) {
  note_in_interrupt(InterruptCall::Task, CALLED_AT);
  const BaseType_t done = notify(task, value, action);
  if (done) pass_on(key_of(*task));
  return done;
}
}  // namespace

BaseType_t xTaskNotify(TaskHandle_t task, uint32_t value, eNotifyAction action) {
  return notify_by_task(task, value, action);
}
BaseType_t xTaskNotifyGive(TaskHandle_t task) { return notify_by_task(task, 0, eIncrement); }

BaseType_t xTaskNotifyFromISR(TaskHandle_t task, uint32_t value, eNotifyAction action, BaseType_t* is_woken) {
  const BaseType_t done = notify(task, value, action);
  if (done) pass_on_from_isr(key_of(*task), is_woken);
  return done;
}
void vTaskNotifyGiveFromISR(TaskHandle_t task, BaseType_t* is_woken) {
  xTaskNotifyFromISR(task, 0, eIncrement, is_woken);
}

uint32_t ulTaskNotifyTake(BaseType_t clear, TickType_t ticks) {
  begin_call();
  Task& task = running_task();
  wait_for({WaitsFor::Notification, key_of(task), CALLED_AT}, ticks, [&] { return task.notification != 0; });
  const uint32_t value = task.notification;
  if (value) task.notification = clear ? 0 : value - 1;
  task.is_notified = false;
  return value;
}

BaseType_t xTaskNotifyWait(uint32_t clear_before, uint32_t clear_after, uint32_t* value, TickType_t ticks) {
  begin_call();
  Task& task = running_task();
  if (!task.is_notified) task.notification &= ~clear_before;
  const bool came = wait_for({WaitsFor::Notification, key_of(task), CALLED_AT}, ticks, [&] { return task.is_notified; });
  if (value) *value = task.notification;
  if (came) task.notification &= ~clear_after;
  task.is_notified = false;
  return came;
}

BaseType_t xTaskNotifyStateClear(TaskHandle_t task) {
  Task& each = meant(task);
  const bool was = each.is_notified;
  each.is_notified = false;
  return was;
}
