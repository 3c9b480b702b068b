// Time and waits, and what is left of the core.
#include "../board/clock.h"
#include "Arduino.h"

using namespace board;

unsigned int millis() {
  pass(cost::MILLIS);
  return static_cast<unsigned int>((now - boot) / MILLISECOND);
}

unsigned int micros() {
  pass(cost::MICROS);
  return static_cast<unsigned int>((now - boot) / (4 * MICROSECOND) * 4);  // timer 0 counts every 4 us
}

void delay(unsigned int milliseconds) {
  const WaitScope scope(Waits::InDelay, CALLED_AT);
  const Nanoseconds begin = now;
  pass_until(begin + milliseconds * MILLISECOND);
  waited += now - begin;
}
void delayMicroseconds(unsigned int microseconds) { pass(microseconds * MICROSECOND); }

void tone(int, unsigned int, unsigned int) { pass(cost::TONE); }
void noTone(int) { pass(cost::TONE); }

void shiftOut(int data, int clock, int order, int value) {
  for (int place = 0; place < 8; ++place) {
    digitalWrite(data, value >> (order == LSBFIRST ? place : 7 - place) & 1);
    digitalWrite(clock, HIGH);
    digitalWrite(clock, LOW);
  }
}

int shiftIn(int data, int clock, int order) {
  int value = 0;
  for (int place = 0; place < 8; ++place) {
    digitalWrite(clock, HIGH);
    value |= digitalRead(data) << (order == LSBFIRST ? place : 7 - place);
    digitalWrite(clock, LOW);
  }
  return value;
}

// It writes a dozen registers, before the sketch has begun anything.
__attribute__((weak)) void init() { pass(4 * MICROSECOND); }

__attribute__((weak)) void yield() {}
