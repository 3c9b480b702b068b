// Interrupts of an ESP32 with functions that keep values: lambdas with captures, std::bind.
#pragma once
#include <functional>
#include <type_traits>
#include <utility>

#include "../core/Arduino.h"

namespace board {
inline std::function<void()> functions_of_pins[DIGITAL_PINS];
template <size_t Pin>
void call_function() {
  functions_of_pins[Pin]();
}
template <size_t... Pins>
void (*caller(size_t pin, std::index_sequence<Pins...>))() {
  static constexpr void (*CALLERS[])() = {call_function<Pins>...};
  return CALLERS[pin];
}
}  // namespace board

// Plain functions are those of the core.
template <class Function, class = std::enable_if_t<!std::is_convertible<Function, void (*)()>::value>>
void attachInterrupt(int pin, Function function, int mode) {
  if (pin < 0 || pin >= DIGITAL_PINS) return;
  board::functions_of_pins[pin] = function;
  attachInterrupt(pin, board::caller(static_cast<size_t>(pin), std::make_index_sequence<DIGITAL_PINS>()), mode);
}
