#include "hardware_timers.h"

#include "mistakes.h"

namespace board {

HardwareTimer hardware[TIMERS];
Nanoseconds first_alarm = NEVER;
int pending_alarms = 0;

namespace {
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

void find_first() {
  first_alarm = NEVER;
  pending_alarms = 0;
  for (const HardwareTimer& each : hardware) {
    pending_alarms += each.is_pending;
    if (!each.is_pending && each.due() < first_alarm) first_alarm = each.due();
  }
}
}  // namespace

void begin_timer(HardwareTimer& timer, unsigned int divider) {
  timer = HardwareTimer();
  timer.is_used = timer.runs = true;
  timer.divider = divider;
  timer.set(0);
  plan_alarms();
}

void plan_alarms() {
  find_first();
  plan_stop();
}

void set_system_alarm(void (*function)(), unsigned int divider, uint64_t counts, bool repeats) {
  HardwareTimer& timer = hardware[SYSTEM_TIMER];
  begin_timer(timer, divider);
  timer.function = InterruptFunction(function);
  timer.alarm = counts;
  timer.reloads = repeats;
  timer.is_alarm_on = true;
  plan_alarms();
}

void stop_system_alarm() {
  hardware[SYSTEM_TIMER] = HardwareTimer();
  plan_alarms();
}

void set_alarm_flags() {
  for (HardwareTimer& each : hardware)
    if (!each.is_pending && each.due() <= now) {
      pass_alarm(each);
      each.is_pending = true;
    }
  find_first();
}

void run_alarm_function() {
  for (HardwareTimer& each : hardware) {
    if (!each.is_pending) continue;
    // One flag a timer: alarms merge.
    if (each.due() <= now) {
      pass_alarm(each);
      if (each.is_of_sketch) note_mistake(Mistake::LostAlarm, place);
    }
    each.is_pending = false;
    plan_alarms();
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
