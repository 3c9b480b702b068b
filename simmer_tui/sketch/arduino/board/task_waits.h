// Waits of a task for something that others give, with a limit in ticks.
#pragma once
#include "interrupts.h"
#include "mistakes.h"
#include "task_mistakes.h"
#include "tasks.h"
#include "../libraries/freertos/FreeRTOS.h"

namespace board {

inline uint64_t wake_tick(TickType_t ticks) { return ticks == portMAX_DELAY ? NEVER : tick_count() + ticks; }

// A queue, semaphore, timer or group that a call is about. A real ESP32 ends where there is none; an AVR goes on with
// what its memory has at 0. Inline, as all that calls it: the address is that of the sketch's call.
template <class Kind>
[[gnu::always_inline]] inline Kind& there(Kind* made) {
  if (!made) report_absent(CALLED_AT - 1);
  return *made;
}

// A call that an interrupt's function may not make: its kind with FromISR is for that.
[[gnu::always_inline]] inline void begin_call() {
  note_in_interrupt(InterruptCall::Task, CALLED_AT);
  pass(cost::TASK_CALL);
}

// Attempt something until it is done. In an interrupt's function, nobody can wait.
template <class Attempt>
bool wait_for(const Awaited& awaited, TickType_t ticks, Attempt attempt) {
  const uint64_t end = wake_tick(ticks);
  for (;;) {
    if (attempt()) return true;
    if (tick_count() >= end || !interrupts_on()) return false;
    if (awaited.mutex && end == NEVER) look_for_circle(awaited);
    block(awaited, end);
  }
}

// Something was given, by a task: one that waits for it runs at once, if it is more urgent.
inline void pass_on(const void* key) {
  if (wake_first(key)) ask_for_switch();
}

// The same by an interrupt's function: it says itself when a task shall run, or the next tick does.
inline void pass_on_from_isr(const void* key, BaseType_t* is_woken) {
  if (wake_first(key) && is_woken) *is_woken = pdTRUE;
}

}  // namespace board
