#include "hardware_timers.h"

#include "../core/Arduino.h"
#include "exchange.h"
#include "interrupts.h"
#include "mistakes.h"
#include "task_waits.h"

namespace board {

// A count of 80 MHz by the divider lasts 12.5 ns by the divider: times are kept in halves of a nanosecond. That of count
// 0 may be before the beginning.
using Halves = int64_t;

struct HardwareTimer {
  bool is_used = false, runs = false, is_alarm_on = false, reloads = false, is_pending = false;
  unsigned int divider = 2;
  Halves zero = 0;    // the time of its count 0, while it runs
  uint64_t held = 0;  // its count while it stands
  uint64_t alarm = 0, reload = 0;
  InterruptFunction function;

  Halves lasts(uint64_t counts) const { return static_cast<Halves>(counts * divider * 25); }
  uint64_t count() const { return runs ? static_cast<uint64_t>((present() - zero) / lasts(1)) : held; }
  static Halves present() { return static_cast<Halves>(2 * now); }
  void set(uint64_t count) {
    held = count;
    zero = present() - lasts(count);
  }
  // The time of its alarm. One whose count is over already comes at once.
  Nanoseconds due() const {
    if (!runs || !is_alarm_on || !function.is_there()) return NEVER;
    const Halves time = zero + lasts(alarm) + 1;
    return time > 0 ? static_cast<Nanoseconds>(time / 2) : 0;
  }
};

namespace {
constexpr int TIMERS = 4;
constexpr unsigned int CLOCK = 80000000, LEAST_DIVIDER = 2, MOST_DIVIDER = 65536;
HardwareTimer hardware[TIMERS];

// The alarm is due, and with it all that have come meanwhile: the timer goes on to the next one.
void pass_alarm(HardwareTimer& timer) {
  if (!timer.reloads) {
    timer.is_alarm_on = false;
    return;
  }
  const Halves period = timer.lasts(timer.alarm > timer.reload ? timer.alarm - timer.reload : 1);
  const Halves late = HardwareTimer::present() - (timer.zero + timer.lasts(timer.alarm));
  timer.zero += (late / period + 1) * period;
}
}  // namespace

Nanoseconds next_alarm() {
  Nanoseconds first = NEVER;
  for (const HardwareTimer& each : hardware)
    if (!each.is_pending && each.due() < first) first = each.due();
  return first;
}

void run_alarms() {
  for (HardwareTimer& each : hardware)
    if (!each.is_pending && each.due() <= now) {
      pass_alarm(each);
      each.is_pending = true;
    }
}

bool alarm_waits() {
  for (const HardwareTimer& each : hardware)
    if (each.is_pending) return true;
  return false;
}

void run_alarm_function() {
  for (HardwareTimer& each : hardware) {
    if (!each.is_pending) continue;
    // One flag a timer: alarms merge.
    if (each.due() <= now) {
      pass_alarm(each);
      note_mistake(Mistake::LostAlarm, place);
    }
    each.is_pending = false;
    each.function.call();
    return;
  }
}

bool has_alarms() {
  for (const HardwareTimer& each : hardware)
    if (each.is_pending || each.due() != NEVER) return true;
  return false;
}

}  // namespace board

using namespace board;

namespace {
// A call about a timer, which a sketch may have failed to begin.
[[gnu::always_inline]] inline HardwareTimer& called(hw_timer_t* timer) {
  pass(cost::PIN_MODE);
  return there(timer);
}

hw_timer_t* begin(HardwareTimer& timer, unsigned int divider) {
  timer = HardwareTimer();
  timer.is_used = timer.runs = true;
  timer.divider = constrain(divider, LEAST_DIVIDER, MOST_DIVIDER);
  timer.set(0);
  plan_stop();
  return &timer;
}
}  // namespace

hw_timer_t* timerBegin(int number, unsigned int divider, bool) {
  pass(cost::PIN_MODE);
  return number >= 0 && number < TIMERS ? begin(hardware[number], divider) : nullptr;
}
hw_timer_t* timerBegin(unsigned int frequency) {
  pass(cost::PIN_MODE);
  const unsigned int divider = frequency ? CLOCK / frequency : 0;
  if (divider < LEAST_DIVIDER || divider > MOST_DIVIDER) return nullptr;
  for (HardwareTimer& each : hardware)
    if (!each.is_used) return begin(each, divider);
  return nullptr;
}
void timerEnd(hw_timer_t* timer) {
  called(timer) = HardwareTimer();
  plan_stop();
}

void timerAttachInterrupt(hw_timer_t* timer, void (*function)(), bool) {
  called(timer).function = InterruptFunction(function);
  plan_stop();
}
void timerAttachInterruptArg(hw_timer_t* timer, void (*function)(void*), void* argument) {
  called(timer).function = InterruptFunction(function, argument);
  plan_stop();
}
void timerDetachInterrupt(hw_timer_t* timer) {
  called(timer).function = InterruptFunction();
  timer->is_pending = false;
  plan_stop();
}

void timerStart(hw_timer_t* timer) {
  if (called(timer).runs) return;
  timer->set(timer->held);
  timer->runs = true;
  plan_stop();
}
void timerStop(hw_timer_t* timer) {
  const uint64_t count = called(timer).count();
  timer->held = count;
  timer->runs = false;
  plan_stop();
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
  plan_stop();
}
unsigned int timerGetFrequency(hw_timer_t* timer) { return CLOCK / called(timer).divider; }
unsigned int timerGetDivider(hw_timer_t* timer) { return called(timer).divider; }
void timerSetDivider(hw_timer_t* timer, unsigned int divider) {
  const uint64_t count = called(timer).count();
  timer->divider = constrain(divider, LEAST_DIVIDER, MOST_DIVIDER);
  timer->set(count);
  plan_stop();
}

namespace {
void set_alarm(HardwareTimer& timer, uint64_t count, bool reloads, uint64_t reload) {
  timer.alarm = count;
  timer.reloads = reloads;
  timer.reload = reload;
  plan_stop();
}
void switch_alarm(HardwareTimer& timer, bool on) {
  timer.is_alarm_on = on;
  plan_stop();
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
