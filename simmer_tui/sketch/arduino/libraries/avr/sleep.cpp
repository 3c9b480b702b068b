#include "sleep.h"

#include "../../board/clock.h"
#include "../../board/interrupts.h"

using namespace board;

namespace {
unsigned char chosen_mode = SLEEP_MODE_IDLE;
bool is_enabled = false;
// Timer 0 counts 256 times 4 us, and its interrupt, that of millis(), ends a sleep.
constexpr Nanoseconds OVERFLOW = 1024 * MICROSECOND;
// With the oscillator off, the chip of an Uno waits for 16,384 of its cycles.
constexpr Nanoseconds START = 1024 * MICROSECOND;
// sei() lets one more instruction run: an interrupt that waited comes after it, and ends the sleep at once.
constexpr Nanoseconds ONE_INSTRUCTION = MICROSECOND;
constexpr uint64_t NOTHING = 0;  // without interrupts, nothing ends a sleep

// Sleep until a moment, or until `count` changes.
void sleep_until(Nanoseconds moment, const uint64_t& count) {
  const uint64_t seen = count;
  while (now < moment && count == seen) {
    const Nanoseconds stop = next_stop < moment ? next_stop : moment;
    if (stop > now) now = stop;
    if (next_stop <= now) service();
  }
}

void fall_asleep(uint32_t at) {
  if (!is_enabled) return;
  if (interrupts_on() && waited_for_sei != NEVER && now - waited_for_sei <= ONE_INSTRUCTION) return;
  const WaitScope scope(Waits::InSleep, at);
  const Nanoseconds begin = now;
  if (!interrupts_on()) {
    sleep_until(NEVER, NOTHING);
  } else if (chosen_mode == SLEEP_MODE_IDLE) {
    sleep_until(boot + stopped + ((now - boot - stopped) / OVERFLOW + 1) * OVERFLOW, wakes);
  } else {
    // All clocks stand: a pin alone wakes the chip, and bytes are lost.
    is_stopped = true;
    sleep_until(NEVER, pin_interrupts);
    is_stopped = false;
    if (chosen_mode != SLEEP_MODE_ADC) pass(START);
    stopped += now - begin;
  }
  waited += now - begin;
}
}  // namespace

void set_sleep_mode(unsigned char mode) { chosen_mode = mode; }
void sleep_enable() { is_enabled = true; }
void sleep_disable() { is_enabled = false; }
void sleep_cpu() { fall_asleep(CALLED_AT); }
void sleep_mode() {
  const bool was_enabled = is_enabled;
  is_enabled = true;
  fall_asleep(CALLED_AT);
  is_enabled = was_enabled;
}
