// Pins of each board: analog names, PWM, interrupts, and the pins of its serial ports.
#pragma once

#if defined(SIMMER_ESP32)
#include "esp32_pins.h"
#else
#if defined(SIMMER_MEGA)
constexpr int FIRST_ANALOG = 54, ANALOG_PINS = 16, DIGITAL_PINS = 70, EEPROM_SIZE = 4096;
constexpr int INTERRUPT_PINS[] = {2, 3, 21, 20, 19, 18};
inline bool digitalPinHasPWM(int pin) { return (pin >= 2 && pin <= 13) || (pin >= 44 && pin <= 46); }
enum : unsigned char { SDA = 20, SCL = 21, MISO = 50, MOSI = 51, SCK = 52, SS = 53 };
#else
#if defined(ARDUINO_AVR_NANO)
constexpr int ANALOG_PINS = 8;
#else
constexpr int ANALOG_PINS = 6;  // the Uno's chip has A6 and A7 on no pin
#endif
constexpr int FIRST_ANALOG = 14, DIGITAL_PINS = 20, EEPROM_SIZE = 1024;
constexpr int INTERRUPT_PINS[] = {2, 3};
inline bool digitalPinHasPWM(int pin) {
  return pin == 3 || pin == 5 || pin == 6 || pin == 9 || pin == 10 || pin == 11;
}
enum : unsigned char { SDA = 18, SCL = 19, SS = 10, MOSI = 11, MISO = 12, SCK = 13 };
#endif

enum : unsigned char { A0 = FIRST_ANALOG, A1, A2, A3, A4, A5, A6, A7 };
#if defined(SIMMER_MEGA)
enum : unsigned char { A8 = A7 + 1, A9, A10, A11, A12, A13, A14, A15 };
#endif
#define PIN_A0 A0
#define PIN_A1 A1
#define PIN_A2 A2
#define PIN_A3 A3
#define PIN_A4 A4
#define PIN_A5 A5
#define PIN_A6 A6
#define PIN_A7 A7
#define PIN_WIRE_SDA SDA
#define PIN_WIRE_SCL SCL
// The cause of a reset, which the boot loader has cleared before the sketch begins.
enum : unsigned char { PORF, EXTRF, BORF, WDRF };
inline volatile unsigned char MCUSR = 0;

#include "timer_rates.h"
#define LED_BUILTIN 13
#define NUM_DIGITAL_PINS DIGITAL_PINS
#define NUM_ANALOG_INPUTS ANALOG_PINS
#define E2END (EEPROM_SIZE - 1)
#define NOT_A_PIN 0
#define NOT_AN_INTERRUPT -1

inline int digitalPinToInterrupt(int pin) {
  int number = 0;
  for (int each : INTERRUPT_PINS) {
    if (each == pin) return number;
    ++number;
  }
  return NOT_AN_INTERRUPT;
}
// The pin of an interrupt's number; -1 where there is none.
inline int interrupt_pin(int number) {
  constexpr int COUNT = sizeof INTERRUPT_PINS / sizeof INTERRUPT_PINS[0];
  return number >= 0 && number < COUNT ? INTERRUPT_PINS[number] : -1;
}
#endif
