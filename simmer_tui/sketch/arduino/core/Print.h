// Print: numbers and text to anything that takes bytes.
#pragma once
#include <cstddef>
#include <cstdint>

#include "Program_memory.h"
#include "WString.h"

class Print;
class Printable {
 public:
  virtual ~Printable() = default;
  virtual size_t printTo(Print& target) const = 0;
};

class Print {
 public:
  virtual ~Print() = default;
  virtual size_t write(uint8_t value) = 0;
  virtual size_t write(const uint8_t* data, size_t size);
  size_t write(const char* text);
  size_t write(const char* data, size_t size) { return write(reinterpret_cast<const uint8_t*>(data), size); }
  // A number of another width is one byte, its lowest.
  size_t write(int value) { return write(static_cast<uint8_t>(value)); }
  size_t write(unsigned int value) { return write(static_cast<uint8_t>(value)); }
  size_t write(long value) { return write(static_cast<uint8_t>(value)); }
  size_t write(unsigned long value) { return write(static_cast<uint8_t>(value)); }
  size_t write(char value) { return write(static_cast<uint8_t>(value)); }
  virtual int availableForWrite() { return 0; }
  virtual void flush() {}

  size_t print(const char* text) { return write(text); }
  size_t print(const String& text);
  size_t print(const __FlashStringHelper* text);
  size_t print(char letter) { return write(static_cast<uint8_t>(letter)); }
  size_t print(unsigned char value, int base = 10);
  size_t print(int value, int base = 10);
  size_t print(unsigned int value, int base = 10);
  size_t print(long value, int base = 10);
  size_t print(unsigned long value, int base = 10);
  size_t print(double value, int digits = 2);
  size_t print(const Printable& value) { return value.printTo(*this); }

  size_t println();
  template <class Value>
  SIMMER_RUNTIME size_t println(const Value& value) {
    const size_t size = print(value);
    return size + println();
  }
  template <class Value>
  SIMMER_RUNTIME size_t println(const Value& value, int format) {
    const size_t size = print(value, format);
    return size + println();
  }

#if defined(SIMMER_ESP32)
  size_t printf(const char* format, ...);
#endif

  int getWriteError() const { return error_; }
  void clearWriteError() { error_ = 0; }

 protected:
  void setWriteError(int error = 1) { error_ = error; }

 private:
  int error_ = 0;
};
