// Interrupts of pins: one flag a pin, so edges merge while the interrupts are off.
#pragma once
#include "clock.h"

namespace board {

extern Nanoseconds off_since;             // since when interrupts are off; NEVER while they are on
extern Nanoseconds last_off, last_on;     // the interval before

bool interrupts_on();
void set_interrupts(bool on);
bool interrupt_waits();                   // true if an interrupt may run now
Nanoseconds next_interrupt();             // the time at which one may run; NEVER if none waits
void run_interrupt();
bool in_interrupt();                      // true while an interrupt's function runs
bool has_interrupts();                    // true if the sketch has attached one
void attach(int pin, void (*function)(), int mode);
void note_edge(int pin, bool high);       // the level of an input has changed

}  // namespace board
