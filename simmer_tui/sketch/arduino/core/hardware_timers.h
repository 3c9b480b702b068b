// The four hardware timers of an ESP32: they count parts of 80 MHz, and call a function of the sketch as an interrupt.
// Both forms of Arduino's core are there, that of 2.x (a number and a divider) and that of 3.x (a frequency).
#pragma once
#include <cstdint>

namespace board {
struct HardwareTimer;
}
typedef board::HardwareTimer hw_timer_t;

hw_timer_t* timerBegin(int number, unsigned int divider, bool counts_up);
hw_timer_t* timerBegin(unsigned int frequency);
void timerEnd(hw_timer_t* timer);
void timerAttachInterrupt(hw_timer_t* timer, void (*function)(), bool edge = true);
void timerAttachInterruptArg(hw_timer_t* timer, void (*function)(void*), void* argument);
void timerDetachInterrupt(hw_timer_t* timer);
void timerStart(hw_timer_t* timer);
void timerStop(hw_timer_t* timer);
void timerRestart(hw_timer_t* timer);
bool timerStarted(hw_timer_t* timer);
uint64_t timerRead(hw_timer_t* timer);
uint64_t timerReadMicros(hw_timer_t* timer);
uint64_t timerReadMillis(hw_timer_t* timer);
#define timerReadMilis timerReadMillis
double timerReadSeconds(hw_timer_t* timer);
void timerWrite(hw_timer_t* timer, uint64_t count);
unsigned int timerGetFrequency(hw_timer_t* timer);
unsigned int timerGetDivider(hw_timer_t* timer);
void timerSetDivider(hw_timer_t* timer, unsigned int divider);
// An alarm at a count. One that reloads begins again at `reload`; another one is over.
void timerAlarm(hw_timer_t* timer, uint64_t count, bool reloads, uint64_t reload);
void timerAlarmWrite(hw_timer_t* timer, uint64_t count, bool reloads);
void timerAlarmEnable(hw_timer_t* timer);
void timerAlarmDisable(hw_timer_t* timer);
bool timerAlarmEnabled(hw_timer_t* timer);
void timerSetAutoReload(hw_timer_t* timer, bool reloads);
bool timerGetAutoReload(hw_timer_t* timer);
uint64_t timerAlarmRead(hw_timer_t* timer);
uint64_t timerAlarmReadMicros(hw_timer_t* timer);
double timerAlarmReadSeconds(hw_timer_t* timer);
