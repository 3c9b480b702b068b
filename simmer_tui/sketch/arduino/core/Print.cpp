#include "Print.h"

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>

#include "../board/clock.h"
#include "Text_numbers.h"

size_t Print::write(const uint8_t* data, size_t size) {
  size_t sent = 0;
  while (size--) sent += write(*data++);
  return sent;
}
size_t Print::write(const char* text) {
  return text ? write(reinterpret_cast<const uint8_t*>(text), std::strlen(text)) : 0;
}
size_t Print::print(const String& text) {
  return write(reinterpret_cast<const uint8_t*>(text.c_str()), text.length());
}
size_t Print::print(const __FlashStringHelper* text) { return write(reinterpret_cast<const char*>(text)); }

static size_t print_natural(Print& target, uint32_t value, int base) {
  char text[40];
  ultoa(value, text, base < 2 ? 10 : base);
  board::pass(board::cost::PRINT_NUMBER + std::strlen(text) * board::cost::PRINT_DIGIT);
  for (char* at = text; *at; ++at)
    if (*at >= 'a') *at = static_cast<char>(*at - 'a' + 'A');
  return target.write(text);
}

size_t Print::print(unsigned char value, int base) { return print(static_cast<unsigned int>(value), base); }
size_t Print::print(int value, int base) {
  if (base == 0) return write(static_cast<uint8_t>(value));
  if (base != 10 || value >= 0) return print_natural(*this, static_cast<uint32_t>(value), base);
  const size_t sign = write(static_cast<uint8_t>('-'));
  return sign + print_natural(*this, 0u - static_cast<uint32_t>(value), 10);
}
size_t Print::print(unsigned int value, int base) {
  return base == 0 ? write(static_cast<uint8_t>(value)) : print_natural(*this, value, base);
}
size_t Print::print(long value, int base) { return print(static_cast<int>(value), base); }
size_t Print::print(unsigned long value, int base) { return print(static_cast<unsigned int>(value), base); }

#if defined(SIMMER_ESP32)
using Real = double;
#else
using Real = float;
#endif

size_t Print::print(double given, int digits) {
  // The limits, and the rounding in 4 bytes of an AVR, are those of the core's printFloat.
  if (std::isnan(given)) return write("nan");
  if (std::isinf(given)) return write("inf");
  if (given > 4294967040.0 || given < -4294967040.0) return write("ovf");
  board::pass(board::cost::PRINT_FLOAT);
  Real number = static_cast<Real>(given);
  size_t sent = 0;
  if (number < 0.0f) {
    sent += write(static_cast<uint8_t>('-'));
    number = -number;
  }
  Real rounding = 0.5f;
  for (int digit = 0; digit < digits; ++digit) rounding /= 10.0f;
  number += rounding;
  const uint32_t whole = static_cast<uint32_t>(number);
  Real rest = number - static_cast<Real>(whole);
  sent += print_natural(*this, whole, 10);
  if (digits > 0) sent += write(static_cast<uint8_t>('.'));
  while (digits-- > 0) {
    board::pass(board::cost::PRINT_DECIMAL);
    rest *= 10.0f;
    const unsigned int digit = static_cast<unsigned int>(rest);
    sent += print_natural(*this, digit, 10);
    rest -= static_cast<Real>(digit);
  }
  return sent;
}

size_t Print::println() { return write("\r\n"); }

#if defined(SIMMER_ESP32)
size_t Print::printf(const char* format, ...) {
  char text[512];
  va_list values;
  va_start(values, format);
  avr_vsnprintf(text, sizeof text, format, values);
  va_end(values);
  return write(text);
}
#endif
