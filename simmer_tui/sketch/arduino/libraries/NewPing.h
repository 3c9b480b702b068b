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
  // The function is called once, as an interrupt, when the echo is over; the library calls it every 24 us until then.
  void ping_timer(void (*function)(), unsigned int max_cm = 0);
  bool check_timer();
  static void timer_stop();
  unsigned int ping_result = 0;  // the echo's time, microseconds, once check_timer() is true
  static unsigned int convert_cm(unsigned int echo);
  static unsigned int convert_in(unsigned int echo);

 private:
  bool trigger();
  void set_limit(unsigned int max_cm);
  int trigger_, echo_;
  unsigned int limit_;  // longest echo, microseconds
  board::Nanoseconds begun_ = 0;  // of the echo that ping_timer() waits for
};
