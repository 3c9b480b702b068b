// Tasks that wait for ever, and tasks that never run.
#pragma once
#include "tasks.h"

namespace board {

// The running task is about to wait for a mutex for ever: tell if its holder waits for it too, by way of others or not.
void look_for_circle(const Awaited& awaited);
// At each tick: tell if tasks have waited for ever for a second, if one has been ready for a second and has not run,
// and if the first core of an ESP32 has not been idle for as long as its watchdog lets it.
void look_at_tasks();
void watch_core_0(bool on);
// Tasks with a watchdog call it in this time: else a real ESP32 restarts, or prints a line.
void watch_tasks(uint32_t milliseconds, bool restarts);

}  // namespace board
