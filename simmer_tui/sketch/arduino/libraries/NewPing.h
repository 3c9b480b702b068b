// Sonars, as NewPing drives them: distances of an echo's time, with a limit.
#pragma once
#include "../board/clock.h"

#define MAX_SENSOR_DISTANCE 500
#define US_ROUNDTRIP_CM 57
#define US_ROUNDTRIP_IN 146
#define NO_ECHO 0
#define MAX_SENSOR_DELAY 5800
#define PING_MEDIAN_DELAY 29000
#define NewPingConvert(echo, unit) \
  ((((unsigned int)(echo) + (unit) / 2) / (unit)) > 1 ? (((unsigned int)(echo) + (unit) / 2) / (unit)) : ((echo) ? 1 : 0))

class NewPing {
 public:
  NewPing(int trigger, int echo, unsigned int max_cm = MAX_SENSOR_DISTANCE);
  unsigned int ping(unsigned int max_cm = 0);
  unsigned int ping_cm(unsigned int max_cm = 0);
  unsigned int ping_in(unsigned int max_cm = 0);
  unsigned int ping_median(unsigned char count = 5, unsigned int max_cm = 0);
#if !defined(SIMMER_ESP32)
  // Timer 2 calls a function as an interrupt, that of ping_timer() every 24 us until check_timer() has ended it.
  void ping_timer(void (*function)(), unsigned int max_cm = 0);
  bool check_timer();
  static void timer_us(unsigned int period, void (*function)());
  static void timer_ms(unsigned int period, void (*function)());
  static void timer_stop();
  unsigned int ping_result = 0;  // the echo's time, microseconds, once check_timer() is true
#endif
  static unsigned int convert_cm(unsigned int echo);
  static unsigned int convert_in(unsigned int echo);

 private:
  bool trigger();
  void set_limit(unsigned int max_cm);
  int trigger_, echo_;
  unsigned int limit_;  // longest echo, microseconds
  unsigned int end_ = 0;  // of the echo that ping_timer() waits for, by micros()
};
