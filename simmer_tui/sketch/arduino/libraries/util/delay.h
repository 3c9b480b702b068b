// Waiting loops of avr-libc.
#pragma once
#include "../../core/Arduino.h"

inline void _delay_us(double microseconds) { delayMicroseconds(static_cast<unsigned int>(microseconds)); }
inline void _delay_ms(double milliseconds) { _delay_us(milliseconds * 1000); }
