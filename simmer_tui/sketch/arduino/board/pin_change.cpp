#include "../core/pin_change.h"

#include "interrupts.h"
#include "pins.h"

volatile uint8_t pin_of_change = 0, level_of_change = 0;

namespace {
void (*functions_of_change[board::PINS])() = {};

void on_change(void* argument) {
  const int pin = static_cast<int>(reinterpret_cast<intptr_t>(argument));
  // All pins of a port have one interrupt, whose function looks for those that have changed.
  board::pass(board::cost::PIN_CHANGE);
  pin_of_change = static_cast<uint8_t>(pin);
  level_of_change = board::input_level(pin) ? HIGH : LOW;
  if (functions_of_change[pin]) functions_of_change[pin]();
}
}  // namespace

void attach_pin_change(int pin, void (*function)(), int mode) {
  if (!has_pin_change(pin)) return;
  functions_of_change[pin] = function;
  const board::InterruptFunction called(on_change, reinterpret_cast<void*>(static_cast<intptr_t>(pin)));
  board::attach(pin, function ? called : board::InterruptFunction(), mode);
}
