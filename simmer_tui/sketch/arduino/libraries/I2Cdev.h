// Registers of a part on Wire, one call each.
#pragma once
#include "Wire.h"

#define I2CDEV_ARDUINO_WIRE 1
#define I2CDEV_BUILTIN_NBWIRE 2
#define I2CDEV_BUILTIN_FASTWIRE 3
#define I2CDEV_IMPLEMENTATION I2CDEV_ARDUINO_WIRE

class I2Cdev {
 public:
  // The number of bytes that were read, -1 if not all came.
  static int8_t readBytes(uint8_t address, uint8_t reg, uint8_t count, uint8_t* data, uint16_t timeout = 0);
  static int8_t readByte(uint8_t address, uint8_t reg, uint8_t* data, uint16_t timeout = 0);
  static int8_t readBit(uint8_t address, uint8_t reg, uint8_t bit, uint8_t* data, uint16_t timeout = 0);
  static int8_t readBits(uint8_t address, uint8_t reg, uint8_t start, uint8_t count, uint8_t* data, uint16_t timeout = 0);
  static int8_t readWord(uint8_t address, uint8_t reg, uint16_t* data, uint16_t timeout = 0);
  // True if the part has taken them.
  static bool writeBytes(uint8_t address, uint8_t reg, uint8_t count, const uint8_t* data);
  static bool writeByte(uint8_t address, uint8_t reg, uint8_t data);
  static bool writeBit(uint8_t address, uint8_t reg, uint8_t bit, uint8_t data);
  static bool writeBits(uint8_t address, uint8_t reg, uint8_t start, uint8_t count, uint8_t data);
  static bool writeWord(uint8_t address, uint8_t reg, uint16_t data);
};
