// Interrupts of all pins by one call: those of attachInterrupt where a pin has one, else pin changes.
#pragma once
#include "../core/pin_change.h"

#define PINCHANGEINTERRUPT 0x80
#define arduinoInterruptedPin pin_of_change
#define arduinoPinState level_of_change

inline void enableInterrupt(int pin, void (*function)(), int mode) {
  const int number = pin & PINCHANGEINTERRUPT ? NOT_AN_INTERRUPT : digitalPinToInterrupt(pin);
  if (number == NOT_AN_INTERRUPT) attach_pin_change(pin & ~PINCHANGEINTERRUPT, function, mode);
  else attachInterrupt(number, function, mode);
}
inline void disableInterrupt(int pin) {
  const int number = pin & PINCHANGEINTERRUPT ? NOT_AN_INTERRUPT : digitalPinToInterrupt(pin);
  if (number == NOT_AN_INTERRUPT) attach_pin_change(pin & ~PINCHANGEINTERRUPT, nullptr, CHANGE);
  else detachInterrupt(number);
}
