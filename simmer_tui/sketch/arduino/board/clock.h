// The board's simulated clock.
//
// Time passes only where it is charged: in each basic block of the sketch, and in each call by its cost. What is due
// from outside (bytes, edges) is applied at its own time, and interrupts come between any two blocks.
#pragma once
#include <cstdint>

namespace board {

using Nanoseconds = uint64_t;
constexpr Nanoseconds NEVER = ~0ull;
constexpr Nanoseconds MICROSECOND = 1000, MILLISECOND = 1000000, SECOND = 1000000000;

// Costs on an AVR at 16 MHz, as tests/sketch/test_against_simavr.py compares them with a cycle-true core.
// Those of an ESP32 are a tenth; waits of a bus and of memory are the same.
#if defined(SIMMER_ESP32)
constexpr Nanoseconds TIMES_AN_AVR = 10;
#else
constexpr Nanoseconds TIMES_AN_AVR = 1;
#endif
struct Cost {
  Nanoseconds value;
  constexpr Cost(Nanoseconds on_avr) : value(on_avr / TIMES_AN_AVR) {}
  constexpr operator Nanoseconds() const { return value; }
};
namespace cost {
constexpr Cost BLOCK = 500;
constexpr Cost DIGITAL = 4000;
constexpr Cost PIN_MODE = 4000;
constexpr Cost ANALOG_WRITE = 6000;
constexpr Cost ANALOG_READ = 112000;
constexpr Cost MILLIS = 2000;
constexpr Cost MICROS = 3500;
constexpr Cost SERIAL_LOOK = 1500;
// A byte into the queue, and later the interrupt that puts it on the line: 39.6 us for the five of a text.
constexpr Cost SERIAL_WRITE = 8000;
// The interrupt that takes a byte off the line.
constexpr Cost SERIAL_RECEIVE = 5000;
// print() of a number divides 32 bits for each digit: 56 us for 1, 241 for 12345, with the writes.
constexpr Cost PRINT_NUMBER = 10000, PRINT_DIGIT = 37000;
// A float's sign and rounding, and a multiplication and two conversions for each decimal: 375 us for 42.57.
constexpr Cost PRINT_FLOAT = 40000, PRINT_DECIMAL = 55000;
constexpr Cost INTERRUPT_ENTRY = 5000;
constexpr Cost INTERRUPT_EXIT = 2500;
// A pin-change interrupt beyond one of a single pin: it reads its port, and looks which of eight pins have changed.
constexpr Cost PIN_CHANGE = 5000;
constexpr Cost LOOP = 500;
constexpr Cost SERVO_WRITE = 8000;
constexpr Cost TONE = 10000;
// AccelStepper's documentation names 4,000 steps a second as the most of run() at 16 MHz: 250 us, of which the pins and
// the clock take 35. A look at the clock compares numbers of 32 bits and floats.
constexpr Cost STEPPER_LOOK = 4000, STEPPER_PLAN = 210000;
// Ten operations of floats, of 10 to 30 us each.
constexpr Cost PID_COMPUTE = 150000;
// A display on I2C at 100 kHz: its address and a byte for the port expander, of 95 us each.
constexpr Nanoseconds DISPLAY_TRANSFER = 190000;
// A byte of EEPROM takes 3.3 ms to write (ATmega328P, table 8-1).
constexpr Nanoseconds EEPROM_READ = 1000, EEPROM_WRITE = 3300000;
// A value of an ESP32's flash memory: judged by its pages, which take 0.4 ms to write (GD25Q32, tPP).
constexpr Nanoseconds FLASH_READ = 30000, FLASH_WRITE = 500000;
// A byte on the bus of Wire, with its acknowledge, at 100 and at 400 kHz.
constexpr Nanoseconds I2C_BYTE = 95000, I2C_FAST_BYTE = 22500;
// FreeRTOS. A switch saves 34 registers and loads 34 others, of two cycles each: 9 us, and looks for the next task. The
// tick does so too, and counts.
constexpr Cost TASK_SWITCH = 15000, TICK = 15000;
// A call, with its critical sections and the copy of an item; a new task, whose stack is filled.
constexpr Cost TASK_CALL = 20000, TASK_CREATE = 100000;
}  // namespace cost

extern Nanoseconds now;
extern Nanoseconds boot;       // the time of the last reset: millis() counts from there
extern Nanoseconds stopped;    // time in which a sleep has stopped the clock of millis()
extern bool is_stopped;
extern Nanoseconds waited;     // time spent in delay(), or asleep
void begin_clock();            // the board is reset at the present time
extern Nanoseconds next_stop;  // the earliest time at which something is due

// A call in which the sketch waits: delay(), pulseIn(), a read with a timeout, a stepper's movement, vTaskDelay(), or a sleep.
// Calls within it do not count.
enum class Waits : uint8_t { Not = 0, InDelay = 1, InPulse = 2, InRead = 3, InSteps = 4, InTask = 5, InSleep = 6 };
struct Wait {
  Waits kind = Waits::Not;
  uint32_t place = 0;  // address of the call, or of the basic block that has it
  Nanoseconds begin = 0, end = 0;
};
extern Wait waiting, last_wait;
// Told of: a program that asks at 20 Hz or faster loses at least one turn.
constexpr Nanoseconds LONG_WAIT = 20 * MILLISECOND;
// Address in the sketch to which a function that the sketch called returns.
#define CALLED_AT static_cast<uint32_t>(reinterpret_cast<uintptr_t>(__builtin_return_address(0)))
class WaitScope {
 public:
  WaitScope(Waits kind, uint32_t at);  // the address of its call, or of the block that has it
  ~WaitScope();
  WaitScope(const WaitScope&) = delete;
  WaitScope& operator=(const WaitScope&) = delete;

 private:
  bool is_outermost_;
};

// While both cores of an ESP32 work, each does its own in a time of half as much (see tasks.h): 1, else 0.
#if defined(SIMMER_ESP32)
extern unsigned int halving;
#else
constexpr unsigned int halving = 0;
#endif

// An interrupt of the core takes time from the sketch, as soon as what is due now has been applied.
void take_time(Nanoseconds duration);
// Let time pass until a moment at which something is due before: interrupts come at their own time, and prolong it.
void pass_stops(Nanoseconds end);
// Let time pass. Mostly nothing is due: so much is inline, since every call of a sketch and pass of loop() does it.
inline void pass(Nanoseconds duration) {
  const Nanoseconds end = now + (duration >> halving);
  if (next_stop > end)
    now = end;
  else
    pass_stops(end);
}
// Let time pass until a moment. Interrupts within it do not move the moment.
void pass_until(Nanoseconds moment);
// Let time pass until something happens outside, at most until a moment.
void pass_until_event(Nanoseconds moment);
// Apply everything that is due now, and run the interrupts.
void service();
// Look again for what is due next.
void plan_stop();

}  // namespace board
