#include "NewPing.h"

#include "../board/hardware_timers.h"
#include "../board/pins.h"
#include "../core/Arduino.h"

using namespace board;

NewPing::NewPing(int trigger, int echo, unsigned int max_cm) : trigger_(trigger), echo_(echo) { set_limit(max_cm); }

void NewPing::set_limit(unsigned int max_cm) {
  limit_ = (max_cm + 1 < MAX_SENSOR_DISTANCE + 1 ? max_cm + 1 : MAX_SENSOR_DISTANCE + 1) * US_ROUNDTRIP_CM;
}

bool NewPing::trigger() {
  pinMode(trigger_, OUTPUT);
  digitalWrite(trigger_, LOW);
  delayMicroseconds(4);
  digitalWrite(trigger_, HIGH);
  delayMicroseconds(10);
  digitalWrite(trigger_, LOW);
  if (trigger_ == echo_) pinMode(echo_, INPUT);
  if (digitalRead(echo_)) return false;  // the last ping has not ended
  const Nanoseconds limit = now + (limit_ + MAX_SENSOR_DELAY) * MICROSECOND;
  while (!digitalRead(echo_)) {
    if (now >= limit) return false;
    pass_until_event(limit);
  }
  return true;
}

unsigned int NewPing::ping(unsigned int max_cm) {
  if (max_cm > 0) set_limit(max_cm);
  if (!trigger()) return NO_ECHO;
  const Nanoseconds begin = now, limit = now + limit_ * MICROSECOND;
  while (digitalRead(echo_)) {
    if (now >= limit) return NO_ECHO;
    pass_until_event(limit);
  }
  const unsigned int echo = static_cast<unsigned int>((now - begin) / MICROSECOND);
  return echo > limit_ ? NO_ECHO : echo;
}

unsigned int NewPing::ping_cm(unsigned int max_cm) { return convert_cm(ping(max_cm)); }
unsigned int NewPing::ping_in(unsigned int max_cm) { return convert_in(ping(max_cm)); }
unsigned int NewPing::convert_cm(unsigned int echo) { return NewPingConvert(echo, US_ROUNDTRIP_CM); }
unsigned int NewPing::convert_in(unsigned int echo) { return NewPingConvert(echo, US_ROUNDTRIP_IN); }

unsigned int NewPing::ping_median(unsigned char count, unsigned int max_cm) {
  unsigned int echoes[256];
  unsigned int found = 0, rounds = count;
  while (rounds > 0) {
    const Nanoseconds begin = now;
    const unsigned int echo = ping(max_cm);
    --rounds;
    if (echo != NO_ECHO) {
      unsigned int place = found++;
      for (; place > 0 && echoes[place - 1] < echo; --place) echoes[place] = echoes[place - 1];
      echoes[place] = echo;
    }
    if (rounds > 0 && now - begin < PING_MEDIAN_DELAY * MICROSECOND)
      delay(static_cast<unsigned int>((PING_MEDIAN_DELAY * MICROSECOND - (now - begin)) / MILLISECOND));
  }
  return found ? echoes[found >> 1] : NO_ECHO;
}

#if !defined(SIMMER_ESP32)
// -- timer 2 -----------------------------------------------------------------------------------------

namespace {
// A count of timer 2 is 4 us, and it has 8 bits. The real library's check of an echo is every 24 us.
constexpr unsigned int DIVIDER = 320, SHORTEST_COUNT = 4, MOST_COUNTS = 256, ECHO_PERIOD = 24;
constexpr unsigned int MILLISECOND_COUNTS = 250;
constexpr unsigned int OVERHEAD = 13;  // PING_TIMER_OVERHEAD, microseconds
void (*on_timer)() = nullptr;
unsigned int period_left = 0, whole_period = 0;  // milliseconds
// The interrupt comes each millisecond. The library counts down past 0: a period is a millisecond longer.
void count_down() {
  if (period_left--) return;
  on_timer();
  period_left = whole_period;
}
}  // namespace

void NewPing::timer_us(unsigned int period, void (*function)()) {
  const unsigned int counts = period / SHORTEST_COUNT;
  set_system_alarm(function, DIVIDER, counts < 1 ? 1 : counts < MOST_COUNTS ? counts : MOST_COUNTS, true);
}
void NewPing::timer_ms(unsigned int period, void (*function)()) {
  on_timer = function;
  whole_period = period_left = period;
  set_system_alarm(count_down, DIVIDER, MILLISECOND_COUNTS, true);
}
void NewPing::timer_stop() { stop_system_alarm(); }

void NewPing::ping_timer(void (*function)(), unsigned int max_cm) {
  if (max_cm > 0) set_limit(max_cm);
  if (!trigger()) return;
  end_ = micros() + limit_;
  timer_us(ECHO_PERIOD, function);
}
bool NewPing::check_timer() {
  const unsigned int present = micros();
  if (static_cast<int32_t>(present - end_) > 0) {
    timer_stop();
    return false;
  }
  if (input_level(echo_)) return false;  // a read of its register: no time
  timer_stop();
  ping_result = micros() - (end_ - limit_) - OVERHEAD;
  return true;
}
#endif
