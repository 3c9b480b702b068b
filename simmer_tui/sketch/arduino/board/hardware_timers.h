// Alarms of hardware timers, for the clock and the interrupts.
#pragma once
#include "clock.h"

namespace board {

#if defined(SIMMER_ESP32)
Nanoseconds next_alarm();      // the time of the next one; NEVER without one
void run_alarms();             // set the flags of those that are due
bool alarm_waits();            // true if the flag of one is set
void run_alarm_function();     // clear a flag, and call its function: the interrupts are off
bool has_alarms();             // true if one is to come, and has a function
#else
inline Nanoseconds next_alarm() { return NEVER; }
inline void run_alarms() {}
inline bool alarm_waits() { return false; }
inline void run_alarm_function() {}
inline bool has_alarms() { return false; }
#endif

}  // namespace board
