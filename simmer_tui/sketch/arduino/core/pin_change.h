// Pin-change interrupts of an AVR: on any pin of an Uno, on some of a Mega. Three libraries for sketches include this.
#pragma once
#include "Arduino.h"

#if defined(SIMMER_MEGA)
inline bool has_pin_change(int pin) { return (pin >= 10 && pin <= 15) || (pin >= 50 && pin <= 53) || (pin >= A8 && pin <= A15) || pin == 0; }
#else
inline bool has_pin_change(int pin) { return pin >= 0 && pin < DIGITAL_PINS; }
#endif
// The pin whose interrupt came last, and its level then.
extern volatile uint8_t pin_of_change, level_of_change;
// Without a function: no more. Nothing happens on a pin that has none.
void attach_pin_change(int pin, void (*function)(), int mode);
