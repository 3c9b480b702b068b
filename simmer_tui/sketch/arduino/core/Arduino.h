// Everything that a sketch has without an #include.
#pragma once

#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <strings.h>
#include <type_traits>
#if defined(SIMMER_ESP32)
// Before the macros, of which these headers have some of the names.
#include <algorithm>
#include <functional>
#include <string>
#endif
using std::isinf;
using std::isnan;

#include "binary.h"
#include "boards.h"
#include "constants.h"

typedef uint8_t byte;
typedef bool boolean;
typedef uint16_t word;

// An argument of a sketch's own template with several of one type (see preprocess.py): a variable has 16 bits, a number
// 32, and 1.5 is a double.
template <class Value>
__attribute__((always_inline)) constexpr decltype(auto) board_wide(Value&& value) {
  using Plain = std::remove_cv_t<std::remove_reference_t<Value>>;
  if constexpr (std::is_same<Plain, int16_t>::value)
    return static_cast<int>(value);
  else if constexpr (std::is_same<Plain, uint16_t>::value)
    return static_cast<unsigned int>(value);
  else if constexpr (std::is_same<Plain, double>::value)
    return static_cast<float>(value);
  else
    return static_cast<Value&&>(value);
}

// -- pins and time -----------------------------------------------------------------------------------
// Numbers are plain `int` and `unsigned int` here. Those of the sketch have their AVR widths (see build).

void pinMode(int pin, int mode);
void digitalWrite(int pin, int value);
int digitalRead(int pin);
void analogWrite(int pin, int value);
int analogRead(int pin);
void analogReference(int mode);
unsigned int pulseIn(int pin, int value, unsigned int timeout = 1000000);
inline unsigned int pulseInLong(int pin, int value, unsigned int timeout = 1000000) {
  return pulseIn(pin, value, timeout);
}
unsigned int millis();
unsigned int micros();
void delay(unsigned int milliseconds);
void delayMicroseconds(unsigned int microseconds);
void shiftOut(int data, int clock, int order, int value);
int shiftIn(int data, int clock, int order);
// No sound: only the time of the call.
void tone(int pin, unsigned int frequency, unsigned int duration = 0);
void noTone(int pin);
// Does nothing, unless the sketch has its own.
void yield();
#if defined(SIMMER_ESP32)
// Where code and data are makes no difference.
#define IRAM_ATTR
#define ARDUINO_ISR_ATTR
#define ICACHE_RAM_ATTR
#define DRAM_ATTR
#define RTC_DATA_ATTR
#define CONFIG_BT_ENABLED 1
#define CONFIG_BLUEDROID_ENABLED 1
#define CONFIG_BT_SPP_ENABLED 1
// PWM on any output, with 1 to 16 bits: by a channel (core 2), or by its pin (core 3).
double ledcSetup(int channel, unsigned int frequency, int bits);
void ledcAttachPin(int pin, int channel);
void ledcDetachPin(int pin);
bool ledcAttach(int pin, unsigned int frequency, int bits);
bool ledcAttachChannel(int pin, unsigned int frequency, int bits, int channel);
bool ledcDetach(int pin);
bool ledcWrite(int channel_or_pin, unsigned int duty);
unsigned int ledcRead(int channel_or_pin);
void analogWriteResolution(int bits);
void analogWriteResolution(int pin, int bits);
void analogWriteFrequency(unsigned int frequency);
void analogWriteFrequency(int pin, unsigned int frequency);
void analogReadResolution(int bits);
// What of the voltage at a pin is all ones.
enum adc_attenuation_t { ADC_0db, ADC_2_5db, ADC_6db, ADC_11db };
void analogSetAttenuation(adc_attenuation_t attenuation);
void analogSetPinAttenuation(int pin, adc_attenuation_t attenuation);
typedef int esp_err_t;
#define ESP_OK 0
#define ESP_FAIL (-1)
struct EspClass {
  [[noreturn]] void restart();
  uint32_t getFreeHeap() { return 290000; }  // about what a sketch without a radio has: it stays the same
};
extern EspClass ESP;
int64_t esp_timer_get_time();
uint32_t esp_random();
// The watchdog of a core's idle task: core 0 has one. loop() has none unless the sketch wants it, which changes nothing.
void enableCore0WDT();
void disableCore0WDT();
inline void enableCore1WDT() {}
inline void disableCore1WDT() {}
inline void enableLoopWDT() {}
inline void disableLoopWDT() {}
inline void feedLoopWDT() {}
#endif

// -- interrupts --------------------------------------------------------------------------------------

void attachInterrupt(int number, void (*function)(), int mode);
#if defined(SIMMER_ESP32)
void attachInterruptArg(int number, void (*function)(void*), void* argument, int mode);
#endif
void detachInterrupt(int number);
void interrupts();
void noInterrupts();
void sei();
void cli();
// The status register, as far as sketches save and restore it: its interrupt flag.
struct StatusRegister {
  operator unsigned char() const;
  StatusRegister& operator=(unsigned char value);
};
extern StatusRegister SREG;

// -- numbers -----------------------------------------------------------------------------------------

int map(int value, int from_low, int from_high, int to_low, int to_high);
int random(int limit);
int random(int low, int limit);
void randomSeed(unsigned int seed);
inline word makeWord(unsigned int value) { return static_cast<word>(value); }
inline word makeWord(byte high, byte low) { return static_cast<word>(high << 8 | low); }
#define word(...) makeWord(__VA_ARGS__)

// In avr-libc's <math.h>.
inline double square(double value) { return value * value; }

#define bit(b) (1UL << (b))
#define _BV(b) (1 << (b))
#define bitRead(value, b) (((value) >> (b)) & 0x01)
#define bitSet(value, b) ((value) |= (1U << (b)))
#define bitClear(value, b) ((value) &= ~(1U << (b)))
#define bitToggle(value, b) ((value) ^= (1U << (b)))
#define bitWrite(value, b, x) ((x) ? bitSet(value, b) : bitClear(value, b))
#define lowByte(w) ((uint8_t)((w) & 0xff))
#define highByte(w) ((uint8_t)((w) >> 8))

#if defined(SIMMER_ESP32)
#define F_CPU 240000000UL
#else
#define F_CPU 16000000UL
#endif
#define clockCyclesPerMicrosecond() (F_CPU / 1000000L)

#include "C_texts.h"
#include "Characters.h"
#include "Program_memory.h"
#include "Text_numbers.h"
#include "Variadic.h"
#include "WString.h"
#include "Print.h"
#include "Stream.h"
#include "HardwareSerial.h"

#if defined(SIMMER_ESP32)
#include "Logging.h"
#include "Tones.h"
// Functions, so that a sketch may include headers of C++ and call std::max() too. Those of two types take what differs
// in this machine's widths alone.
using std::abs;
using std::max;
using std::min;
template <class One, class Other>
constexpr auto min(One a, Other b) {
  return a < b ? a : b;
}
template <class One, class Other>
constexpr auto max(One a, Other b) {
  return a > b ? a : b;
}
#else
// Macros, as in Arduino's core: their type is that of the expression. No header comes after them.
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define abs(x) ((x) > 0 ? (x) : -(x))
#define round(x) ((x) >= 0 ? (int32_t)((x) + 0.5) : (int32_t)((x) - 0.5))
#endif
#define constrain(x, low, high) ((x) < (low) ? (low) : ((x) > (high) ? (high) : (x)))
#define radians(degrees) ((degrees) * DEG_TO_RAD)
#define degrees(radians) ((radians) * RAD_TO_DEG)
#define sq(x) ((x) * (x))
#define sprintf avr_sprintf
#define snprintf avr_snprintf
#define vsnprintf avr_vsnprintf
#define sscanf avr_sscanf

void setup();
void loop();
// Timers run from the beginning: it only costs its time.
void init();
// What the board runs: the build adds it to the sketch. One with its own `main` needs no `setup` and no `loop`.
struct SketchStart {
  void (*setup)();
  void (*loop)();
  int16_t (*main)();
};
extern const SketchStart sketch_start;
#if defined(SIMMER_ESP32)
#include "../libraries/freertos/FreeRTOS.h"
#include "../libraries/freertos/event_groups.h"
#include "../libraries/freertos/semphr.h"
#include "../libraries/freertos/timers.h"
#include "hardware_timers.h"
#endif
