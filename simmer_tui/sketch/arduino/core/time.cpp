// Time and waits, and what is left of the core.
#include "../board/clock.h"
#include "../board/interrupts.h"
#include "../board/mistakes.h"
#include "../board/task_mistakes.h"
#include "../board/tasks.h"
#include "Arduino.h"

using namespace board;

unsigned int millis() {
  pass(cost::MILLIS);
  return static_cast<unsigned int>((now - boot - stopped) / MILLISECOND);
}

unsigned int micros() {
  pass(cost::MICROS);
#if defined(SIMMER_ESP32)
  return static_cast<unsigned int>((now - boot) / MICROSECOND);
#else
  return static_cast<unsigned int>((now - boot - stopped) / (4 * MICROSECOND) * 4);  // timer 0 counts every 4 us
#endif
}

void delay(unsigned int milliseconds) {
  note_in_interrupt(InterruptCall::Delay, CALLED_AT);
  const WaitScope scope(Waits::InDelay, CALLED_AT);
  const Nanoseconds begin = now, away = running_task().away;
#if defined(SIMMER_ESP32)
  // vTaskDelay(): other tasks run.
  if (interrupts_on() && !is_idle()) {
    if (milliseconds)
      block({WaitsFor::Time, nullptr, CALLED_AT}, tick_count() + milliseconds);
    else
      yield_task();
    return;
  }
#endif
  pass_until(begin + milliseconds * MILLISECOND);
  // Others may work meanwhile.
  waited += now - begin - (running_task().away - away);
}
#if defined(SIMMER_ESP32)
void delayMicroseconds(unsigned int microseconds) { pass_until(now + microseconds * MICROSECOND); }
int64_t esp_timer_get_time() {
  pass(cost::MICROS);
  return static_cast<int64_t>((now - boot) / MICROSECOND);
}
void enableCore0WDT() { watch_core_0(true); }
void disableCore0WDT() { watch_core_0(false); }
uint32_t esp_random() { return static_cast<uint32_t>(random(1 << 16)) << 16 | static_cast<uint32_t>(random(1 << 16)); }
#else
void delayMicroseconds(unsigned int microseconds) { pass(microseconds * MICROSECOND); }
#endif

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
