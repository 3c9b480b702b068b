// Pin-change interrupts as old sketches have them.
#pragma once
#include "../core/pin_change.h"

class PCintPort {
 public:
  static int8_t attachInterrupt(int pin, void (*function)(), int mode) {
    if (!has_pin_change(pin)) return -1;
    attach_pin_change(pin, function, mode);
    return 1;
  }
  static void detachInterrupt(int pin) { attach_pin_change(pin, nullptr, CHANGE); }
  static volatile uint8_t &arduinoPin, &pinState;
};
inline volatile uint8_t& PCintPort::arduinoPin = pin_of_change;
inline volatile uint8_t& PCintPort::pinState = level_of_change;
#define PCattachInterrupt(pin, function, mode) PCintPort::attachInterrupt(pin, function, mode)
#define PCdetachInterrupt(pin) PCintPort::detachInterrupt(pin)
