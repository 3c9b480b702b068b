// FreeRTOS: software timers. Their task is made with the first one.
#include <deque>

#include "../../board/clock.h"
#include "../../board/tasks.h"
#include "timers.h"
#include "../../board/task_waits.h"

namespace board {

struct Timer {
  const char* name;
  TickType_t period;
  bool repeats;
  void* id;
  TimerCallbackFunction_t function;
  uint64_t due = NEVER;  // a tick
  bool is_deleted = false;
};

}  // namespace board

using namespace board;

namespace {
std::deque<Timer> timers;
char commands = 0;  // its address is what the timers' task waits for

Timer* first_due() {
  Timer* first = nullptr;
  for (Timer& each : timers)
    if (each.due != NEVER && (!first || each.due < first->due)) first = &each;
  return first;
}

void run_timers(void*) {
  for (;;) {
    Timer* first = first_due();
    if (!first || first->due > tick_count()) {
      block({WaitsFor::Time, &commands}, first ? first->due : NEVER);
      continue;
    }
    first->due = first->repeats ? first->due + first->period : NEVER;
    pass(cost::TASK_CALL);
    first->function(first);
  }
}

// A command of a timer; its task looks again for the one that is due first.
[[gnu::always_inline]] inline BaseType_t set_due(TimerHandle_t timer, uint64_t due) {
  pass(cost::TASK_CALL);
  if (there(timer).is_deleted) return pdFAIL;
  timer->due = due;
  return pdPASS;
}
[[gnu::always_inline]] inline BaseType_t command(TimerHandle_t timer, uint64_t due) {
  note_in_interrupt(InterruptCall::Task, CALLED_AT);
  const BaseType_t done = set_due(timer, due);
  pass_on(&commands);
  return done;
}
[[gnu::always_inline]] inline BaseType_t command_from_isr(TimerHandle_t timer, uint64_t due, BaseType_t* is_woken) {
  const BaseType_t done = set_due(timer, due);
  pass_on_from_isr(&commands, is_woken);
  return done;
}
[[gnu::always_inline]] inline uint64_t next_due(TimerHandle_t timer) { return tick_count() + there(timer).period; }
// FreeRTOS asserts that a period has a tick. The library of an AVR goes on, without the timer.
[[gnu::always_inline]] inline bool has_period(TickType_t period) {
  if (period) return true;
  if (CORES > 1) report_no_ticks(CALLED_AT - 1);
  note_mistake(Mistake::NoPeriod, CALLED_AT);
  return false;
}
[[gnu::always_inline]] inline bool change(TimerHandle_t timer, TickType_t period) {
  if (!has_period(period)) return false;
  there(timer).period = period;
  return true;
}
}  // namespace

TimerHandle_t xTimerCreate(const char* name, TickType_t period, BaseType_t repeats, void* id,
                           TimerCallbackFunction_t function) {
  pass(cost::TASK_CREATE);
  if (!has_period(period)) return nullptr;
  if (timers.empty()) create_task(run_timers, "Tmr Svc", nullptr, configTIMER_TASK_PRIORITY);
  timers.push_back({name, period, repeats != 0, id, function});
  return &timers.back();
}

BaseType_t xTimerStart(TimerHandle_t timer, TickType_t) { return command(timer, next_due(timer)); }
BaseType_t xTimerReset(TimerHandle_t timer, TickType_t) { return command(timer, next_due(timer)); }
BaseType_t xTimerStop(TimerHandle_t timer, TickType_t) { return command(timer, NEVER); }
BaseType_t xTimerChangePeriod(TimerHandle_t timer, TickType_t period, TickType_t) {
  return change(timer, period) ? command(timer, next_due(timer)) : pdFAIL;
}
BaseType_t xTimerDelete(TimerHandle_t timer, TickType_t) {
  const BaseType_t done = command(timer, NEVER);
  timer->is_deleted = true;
  return done;
}
BaseType_t xTimerStartFromISR(TimerHandle_t timer, BaseType_t* is_woken) {
  return command_from_isr(timer, next_due(timer), is_woken);
}
BaseType_t xTimerResetFromISR(TimerHandle_t timer, BaseType_t* is_woken) {
  return command_from_isr(timer, next_due(timer), is_woken);
}
BaseType_t xTimerStopFromISR(TimerHandle_t timer, BaseType_t* is_woken) {
  return command_from_isr(timer, NEVER, is_woken);
}
BaseType_t xTimerChangePeriodFromISR(TimerHandle_t timer, TickType_t period, BaseType_t* is_woken) {
  return change(timer, period) ? command_from_isr(timer, next_due(timer), is_woken) : pdFAIL;
}

BaseType_t xTimerIsTimerActive(TimerHandle_t timer) { return there(timer).due != NEVER; }
void* pvTimerGetTimerID(TimerHandle_t timer) { return there(timer).id; }
void vTimerSetTimerID(TimerHandle_t timer, void* id) { timer->id = id; }
const char* pcTimerGetName(TimerHandle_t timer) { return there(timer).name; }
TickType_t xTimerGetPeriod(TimerHandle_t timer) { return there(timer).period; }
TickType_t xTimerGetExpiryTime(TimerHandle_t timer) { return static_cast<TickType_t>(there(timer).due); }
void vTimerSetReloadMode(TimerHandle_t timer, BaseType_t repeats) { timer->repeats = repeats != 0; }
