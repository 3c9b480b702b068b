#include "../board/hardware_timers.h"

#include "../board/task_waits.h"
#include "Arduino.h"

using namespace board;

namespace {
constexpr unsigned int CLOCK = 80000000, LEAST_DIVIDER = 2, MOST_DIVIDER = 65536;

// A call about a timer, which a sketch may have failed to begin.
[[gnu::always_inline]] inline HardwareTimer& called(hw_timer_t* timer) {
  pass(cost::PIN_MODE);
  return there(timer);
}

hw_timer_t* begin(HardwareTimer& timer, unsigned int divider) {
  begin_timer(timer, constrain(divider, LEAST_DIVIDER, MOST_DIVIDER));
  timer.is_of_sketch = true;
  return &timer;
}
}  // namespace

hw_timer_t* timerBegin(int number, unsigned int divider, bool) {
  pass(cost::PIN_MODE);
  return number >= 0 && number < SYSTEM_TIMER ? begin(hardware[number], divider) : nullptr;
}
hw_timer_t* timerBegin(unsigned int frequency) {
  pass(cost::PIN_MODE);
  const unsigned int divider = frequency ? CLOCK / frequency : 0;
  if (divider < LEAST_DIVIDER || divider > MOST_DIVIDER) return nullptr;
  for (int number = 0; number < SYSTEM_TIMER; ++number)
    if (!hardware[number].is_used) return begin(hardware[number], divider);
  return nullptr;
}
void timerEnd(hw_timer_t* timer) {
  called(timer) = HardwareTimer();
  plan_alarms();
}

void timerAttachInterrupt(hw_timer_t* timer, void (*function)(), bool) {
  called(timer).function = InterruptFunction(function);
  plan_alarms();
}
void timerAttachInterruptArg(hw_timer_t* timer, void (*function)(void*), void* argument) {
  called(timer).function = InterruptFunction(function, argument);
  plan_alarms();
}
void timerDetachInterrupt(hw_timer_t* timer) {
  called(timer).function = InterruptFunction();
  timer->is_pending = false;
  plan_alarms();
}

void timerStart(hw_timer_t* timer) {
  if (called(timer).runs) return;
  timer->set(timer->held);
  timer->runs = true;
  plan_alarms();
}
void timerStop(hw_timer_t* timer) {
  const uint64_t count = called(timer).count();
  timer->held = count;
  timer->runs = false;
  plan_alarms();
}
void timerRestart(hw_timer_t* timer) { timerWrite(timer, 0); }
bool timerStarted(hw_timer_t* timer) { return called(timer).runs; }

uint64_t timerRead(hw_timer_t* timer) { return called(timer).count(); }
uint64_t timerReadMicros(hw_timer_t* timer) { return called(timer).lasts(timer->count()) / (2 * MICROSECOND); }
uint64_t timerReadMillis(hw_timer_t* timer) { return called(timer).lasts(timer->count()) / (2 * MILLISECOND); }
double timerReadSeconds(hw_timer_t* timer) {
  return static_cast<double>(called(timer).lasts(timer->count())) / (2.0 * SECOND);
}
void timerWrite(hw_timer_t* timer, uint64_t count) {
  called(timer).set(count);
  plan_alarms();
}
unsigned int timerGetFrequency(hw_timer_t* timer) { return CLOCK / called(timer).divider; }
unsigned int timerGetDivider(hw_timer_t* timer) { return called(timer).divider; }
void timerSetDivider(hw_timer_t* timer, unsigned int divider) {
  const uint64_t count = called(timer).count();
  timer->divider = constrain(divider, LEAST_DIVIDER, MOST_DIVIDER);
  timer->set(count);
  plan_alarms();
}

namespace {
void set_alarm(HardwareTimer& timer, uint64_t count, bool reloads, uint64_t reload) {
  timer.alarm = count;
  timer.reloads = reloads;
  timer.reload = reload;
  plan_alarms();
}
void switch_alarm(HardwareTimer& timer, bool on) {
  timer.is_alarm_on = on;
  plan_alarms();
}
}  // namespace

void timerAlarm(hw_timer_t* timer, uint64_t count, bool reloads, uint64_t reload) {
  set_alarm(called(timer), count, reloads, reload);
  switch_alarm(*timer, true);
}
void timerAlarmWrite(hw_timer_t* timer, uint64_t count, bool reloads) { set_alarm(called(timer), count, reloads, 0); }
void timerAlarmEnable(hw_timer_t* timer) { switch_alarm(called(timer), true); }
void timerAlarmDisable(hw_timer_t* timer) { switch_alarm(called(timer), false); }
bool timerAlarmEnabled(hw_timer_t* timer) { return called(timer).is_alarm_on; }
void timerSetAutoReload(hw_timer_t* timer, bool reloads) { called(timer).reloads = reloads; }
bool timerGetAutoReload(hw_timer_t* timer) { return called(timer).reloads; }
uint64_t timerAlarmRead(hw_timer_t* timer) { return called(timer).alarm; }
uint64_t timerAlarmReadMicros(hw_timer_t* timer) { return called(timer).lasts(timer->alarm) / (2 * MICROSECOND); }
double timerAlarmReadSeconds(hw_timer_t* timer) {
  return static_cast<double>(called(timer).lasts(timer->alarm)) / (2.0 * SECOND);
}
