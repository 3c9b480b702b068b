// map() and random(), with 32 bits as on the board.
#include "Arduino.h"

int map(int value, int from_low, int from_high, int to_low, int to_high) {
  if (from_high == from_low) return -1;  // what avr-gcc's division by zero gives
  const int64_t product = static_cast<int32_t>(static_cast<uint32_t>(value - from_low) * static_cast<uint32_t>(to_high - to_low));
  return static_cast<int>(product / (from_high - from_low)) + to_low;
}

// Park and Miller's generator, as in avr-libc: the same seed gives the numbers of the real board.
static uint32_t state = 1;

static int next_random() {
  const int32_t before = static_cast<int32_t>(state ? state : 123459876);
  int32_t value = 16807 * (before % 127773) - 2836 * (before / 127773);
  if (value < 0) value += 0x7fffffff;
  state = static_cast<uint32_t>(value);
  return static_cast<int>(state % 0x80000000u);
}

int random(int limit) { return limit == 0 ? 0 : next_random() % limit; }
int random(int low, int limit) { return low >= limit ? low : low + random(limit - low); }
void randomSeed(unsigned int seed) {
  if (seed != 0) state = seed;
}
