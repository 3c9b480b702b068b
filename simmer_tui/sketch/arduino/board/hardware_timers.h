// Timers of the board's hardware: each counts, and its alarm calls a function as an interrupt.
#pragma once
#include <cstdint>

#include "clock.h"
#include "interrupts.h"

namespace board {

// A count of 80 MHz by the divider lasts 12.5 ns by the divider: times are kept in halves of a nanosecond. That of count
// 0 may be before the beginning.
using Halves = int64_t;

struct HardwareTimer {
  bool is_used = false, runs = false, is_alarm_on = false, reloads = false, is_pending = false;
  bool is_of_sketch = false;  // an alarm that is lost is told
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

#if defined(SIMMER_ESP32)
constexpr int TIMERS = 5, SYSTEM_TIMER = 4;  // the fifth is the system's, of esp_timer.h
#else
constexpr int TIMERS = 1, SYSTEM_TIMER = 0;  // timer 2, which NewPing takes
#endif
extern HardwareTimer hardware[TIMERS];
void begin_timer(HardwareTimer& timer, unsigned int divider);
void plan_alarms();          // look again for the next alarm, after a timer has changed
// Call a function as an interrupt after some counts of the system's timer, each of `divider` by 80 MHz.
void set_system_alarm(void (*function)(), unsigned int divider, uint64_t counts, bool repeats);
void stop_system_alarm();

// For the clock and the interrupts.
extern Nanoseconds first_alarm;  // the time of the next alarm that is not pending
extern int pending_alarms;
inline Nanoseconds next_alarm() { return first_alarm; }
inline bool alarm_waits() { return pending_alarms > 0; }
void set_alarm_flags();
inline void run_alarms() {       // set the flags of those that are due
  if (first_alarm <= now) set_alarm_flags();
}
void run_alarm_function();       // clear a flag, and call its function: the interrupts are off
bool has_alarms();               // true if one is to come, and has a function

}  // namespace board
