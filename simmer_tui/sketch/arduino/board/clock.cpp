#include "clock.h"

#include "exchange.h"
#include "hardware_timers.h"
#include "i2c.h"
#include "interrupts.h"
#include "tasks.h"

namespace board {

Nanoseconds now = 0;
Nanoseconds boot = 0;
Nanoseconds stopped = 0;
bool is_stopped = false;
Nanoseconds waited = 0;
Nanoseconds next_stop = NEVER;  // before main() nothing is due: constructors of globals take no time

#if defined(SIMMER_ESP32)
unsigned int halving = 0;
#endif

Wait waiting, last_wait;

WaitScope::WaitScope(Waits kind, uint32_t at) : is_outermost_(waiting.kind == Waits::Not) {
  if (is_outermost_) waiting = {kind, at, now, now};
}

WaitScope::~WaitScope() {
  if (!is_outermost_) return;
  waiting.end = now;
  if (now - waiting.begin >= LONG_WAIT) {
    last_wait = waiting;
    tell_span(Told::Waited, static_cast<int>(waiting.kind), waiting.place, waiting.begin, now);
  }
  waiting.kind = Waits::Not;
}

namespace {
Nanoseconds taken = 0;

// The busy share of each second is told at its end.
Nanoseconds second_end = NEVER, waited_before = 0;

// A wait that goes on counts too. That of a task is one in which others may work.
Nanoseconds waited_until_now() {
  const bool waits = CORES == 1 && !uses_tasks() && (waiting.kind == Waits::InDelay || waiting.kind == Waits::InSleep);
  return waits ? waited + now - waiting.begin : waited;
}

void tell_busy() {
  const Nanoseconds present = waited_until_now();
  // A wait of a task is counted at its end.
  const Nanoseconds in_second = present - waited_before < SECOND ? present - waited_before : SECOND;
  tell(Told::Busy, 0, static_cast<int>(in_second / MICROSECOND), second_end);
  waited_before = present;
  second_end += SECOND;
}
}  // namespace

void begin_clock() {
  now = boot;
  second_end = boot + SECOND;
}

void take_time(Nanoseconds duration) { taken += duration; }

void plan_stop() {
  next_stop = horizon < next_event() ? horizon : next_event();
  if (next_interrupt() < next_stop) next_stop = next_interrupt();
  if (next_part() < next_stop) next_stop = next_part();
  if (next_alarm() < next_stop) next_stop = next_alarm();
  if (next_task_stop() < next_stop) next_stop = next_task_stop();
  if (second_end < next_stop) next_stop = second_end;
}

void service() {
  for (;;) {
    // First everything that is known outside up to now. So it does not matter how far the last grant went.
    if (now >= horizon) exchange(Reason::Horizon);
    if (now >= second_end) tell_busy();
    apply_events();
    run_parts();
    run_alarms();
    if (taken) {
      const Nanoseconds duration = taken;
      taken = 0;
      plan_stop();
      pass(duration);
      continue;
    }
    if (interrupt_waits())
      run_interrupt();
    else if (!run_tasks())
      break;
  }
  plan_stop();
}

void pass_stops(Nanoseconds end) {
  while (next_stop <= end) {
    if (next_stop > now) now = next_stop;
    const Nanoseconds before = now;
    service();
    end += now - before;  // only interrupts and other tasks take time in there
  }
  now = end;
}

void pass_until(Nanoseconds moment) {
  while (now < moment) {
    if (next_stop > moment) {
      now = moment;
      return;
    }
    if (next_stop > now) now = next_stop;
    service();
  }
}

void pass_until_event(Nanoseconds moment) {
  const uint64_t seen = events_applied;
  while (now < moment && events_applied == seen) {
    Nanoseconds stop = next_stop < moment ? next_stop : moment;
    if (stop > now) now = stop;
    if (next_stop <= now) service();
  }
}

}  // namespace board
