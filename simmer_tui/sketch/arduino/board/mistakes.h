// Mistakes of a sketch that its board does not show by itself: each is told once at its place.
#pragma once
#include <cstdint>

namespace board {

// `NoWait` is a wait of no tick, and `NoPeriod` a timer of none. `InInterrupt` is a call that an interrupt's function may
// not make. `LostAlarm` is one of a hardware timer that came while the one before it waited. `Starved`, `Watchdog`, `Circle`,
// `AllWait`, `SomeWait` and `NotFed` are those of tasks (see task_mistakes.h).
enum class Mistake : uint8_t {
  NoWait = 1, NoPeriod = 2, InputPin = 3, NoPullUp = 4, FlashPin = 5, InInterrupt = 6, Starved = 7, Watchdog = 8,
  Circle = 9, AllWait = 10, LostAlarm = 11, SomeWait = 12, NotFed = 13
};
// Calls that need interrupts, or wait.
enum class InterruptCall : uint8_t { Delay = 1, Pulse = 2, Print = 3, Task = 4 };

// Tell a mistake at an address of the sketch, with a number: a pin, or the call of an interrupt's function.
void note_mistake(Mistake kind, uint32_t at, int number = 0);
// Tell a call, if an interrupt's function makes it.
void note_in_interrupt(InterruptCall call, uint32_t at);

}  // namespace board
