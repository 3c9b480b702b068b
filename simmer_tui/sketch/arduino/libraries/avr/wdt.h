// The watchdog: it never resets a simulated board.
#pragma once

enum : unsigned char {
  WDTO_15MS, WDTO_30MS, WDTO_60MS, WDTO_120MS, WDTO_250MS, WDTO_500MS, WDTO_1S, WDTO_2S, WDTO_4S, WDTO_8S
};
inline void wdt_enable(unsigned char) {}
inline void wdt_disable() {}
inline void wdt_reset() {}
