// Pins of an ESP32 (DevKit). 34 to 39 are inputs alone; 6 to 11 are those of the flash memory.
#pragma once

constexpr int FIRST_ANALOG = 0, ANALOG_PINS = 16, DIGITAL_PINS = 40, EEPROM_SIZE = 4096;
constexpr int BLUETOOTH_RX = 40, BLUETOOTH_TX = 41;  // no pins: the line of BluetoothSerial
inline bool digitalPinCanOutput(int pin) { return pin >= 0 && pin < 34; }
inline bool digitalPinHasPWM(int pin) { return digitalPinCanOutput(pin); }
enum : unsigned char { SDA = 21, SCL = 22, SS = 5, MOSI = 23, MISO = 19, SCK = 18, TX = 1, RX = 3 };
enum : unsigned char {
  A0 = 36, A3 = 39, A4 = 32, A5 = 33, A6 = 34, A7 = 35, A10 = 4, A11 = 0, A12 = 2, A13 = 15, A14 = 13, A15 = 12,
  A16 = 14, A17 = 27, A18 = 25, A19 = 26
};
#define LED_BUILTIN 2
#define NUM_DIGITAL_PINS DIGITAL_PINS
#define NUM_ANALOG_INPUTS ANALOG_PINS
#define E2END (EEPROM_SIZE - 1)
#define NOT_A_PIN 0
#define NOT_AN_INTERRUPT -1

// Each pin has its own.
inline int digitalPinToInterrupt(int pin) { return pin >= 0 && pin < DIGITAL_PINS ? pin : NOT_AN_INTERRUPT; }
inline int interrupt_pin(int number) { return digitalPinToInterrupt(number); }
