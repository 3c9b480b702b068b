// Sleep of the processor until an interrupt.
#pragma once
#include "../../core/Arduino.h"

// Bits of SMCR (ATmega328P, table 9-2).
#define SLEEP_MODE_IDLE 0x00
#define SLEEP_MODE_ADC 0x02
#define SLEEP_MODE_PWR_DOWN 0x04
#define SLEEP_MODE_PWR_SAVE 0x06
#define SLEEP_MODE_STANDBY 0x0C
#define SLEEP_MODE_EXT_STANDBY 0x0E

void set_sleep_mode(unsigned char mode);
void sleep_enable();
void sleep_disable();
void sleep_cpu();
void sleep_mode();
inline void sleep_bod_disable() {}
