// FreeRTOS for AVR boards: its scheduler starts after setup(), and its idle task calls loop().
#pragma once
#include "freertos/FreeRTOS.h"
#include "freertos/task.h"

namespace board {
// A sketch that includes this has ticks and an idle task. The runtime itself does not include it.
bool use_tasks();
inline const bool has_tasks = use_tasks();
}  // namespace board
