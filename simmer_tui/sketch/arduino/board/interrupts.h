// Interrupts of pins: one flag a pin, so edges merge while the interrupts are off.
#pragma once
#include "clock.h"

namespace board {

// A function of the sketch that an interrupt calls, with an argument or without.
class InterruptFunction {
 public:
  InterruptFunction() = default;
  explicit InterruptFunction(void (*function)()) : plain_(function) {}
  InterruptFunction(void (*function)(void*), void* argument) : function_(function), argument_(argument) {}
  bool is_there() const { return plain_ || function_; }
  void call() const {
    if (plain_) plain_();
    if (function_) function_(argument_);
  }

 private:
  void (*plain_)() = nullptr;
  void (*function_)(void*) = nullptr;
  void* argument_ = nullptr;
};

extern Nanoseconds off_since;             // since when interrupts are off; NEVER while they are on
extern Nanoseconds last_off, last_on;     // the interval before

extern uint64_t wakes, pin_interrupts;    // interrupts so far: all that end a sleep, and those of pins
extern Nanoseconds waited_for_sei;        // the end of the last one that interrupts() let in; NEVER before

bool interrupts_on();
void set_interrupts(bool on);
bool interrupt_waits();                   // true if an interrupt may run now
Nanoseconds next_interrupt();             // the time at which one may run; NEVER if none waits
void run_interrupt();
bool in_interrupt();                      // true while an interrupt's function runs
bool has_interrupts();                    // true if the sketch has attached one
void attach(int pin, const InterruptFunction& function, int mode);
void note_edge(int pin, bool high);       // the level of an input has changed

}  // namespace board
