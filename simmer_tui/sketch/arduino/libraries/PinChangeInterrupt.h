// Pin-change interrupts by their numbers, which are those of the pins here.
#pragma once
#include "../core/pin_change.h"

inline int digitalPinToPinChangeInterrupt(int pin) { return has_pin_change(pin) ? pin : NOT_AN_INTERRUPT; }
inline int digitalPinToPCINT(int pin) { return digitalPinToPinChangeInterrupt(pin); }
inline void attachPinChangeInterrupt(int number, void (*function)(), int mode) { attach_pin_change(number, function, mode); }
inline void attachPCINT(int number, void (*function)(), int mode) { attach_pin_change(number, function, mode); }
inline void detachPinChangeInterrupt(int number) { attach_pin_change(number, nullptr, CHANGE); }
inline void detachPCINT(int number) { attach_pin_change(number, nullptr, CHANGE); }
