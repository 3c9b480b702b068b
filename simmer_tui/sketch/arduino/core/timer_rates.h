// Registers with the rates of an AVR's timers, by which sketches set the frequency of PWM. It makes no difference here.
// Timer 0 is missing: delay() and millis() count by it.
#pragma once
#include <cstdint>

class TimerRateRegister {
 public:
  constexpr explicit TimerRateRegister(uint8_t reset) : value_(reset) {}
  operator uint8_t() const { return value_; }
  // Bits beyond the rate are those of a mode, which no simulated timer has: they end the board.
  TimerRateRegister& operator=(int value);
  TimerRateRegister& operator|=(int value) { return *this = value_ | value; }
  TimerRateRegister& operator&=(int value) { return *this = value_ & value; }

 private:
  uint8_t value_;
};

// The core begins with a 64th of the clock.
inline TimerRateRegister TCCR1B(3), TCCR2B(4);
enum : uint8_t { CS10, CS11, CS12 };
enum : uint8_t { CS20, CS21, CS22 };
#if defined(SIMMER_MEGA)
inline TimerRateRegister TCCR3B(3), TCCR4B(3), TCCR5B(3);
enum : uint8_t { CS30, CS31, CS32 };
enum : uint8_t { CS40, CS41, CS42 };
enum : uint8_t { CS50, CS51, CS52 };
#endif
