#include "Text_numbers.h"

#include <cctype>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

static char* digits_of(uint32_t value, bool negative, char* text, int base) {
  if (base < 2 || base > 36) base = 10;
  char reversed[40];
  int count = 0;
  do {
    reversed[count++] = "0123456789abcdefghijklmnopqrstuvwxyz"[value % static_cast<uint32_t>(base)];
    value /= static_cast<uint32_t>(base);
  } while (value);
  char* at = text;
  if (negative) *at++ = '-';
  while (count) *at++ = reversed[--count];
  *at = 0;
  return text;
}

char* ltoa(int value, char* text, int base) {
  const bool negative = value < 0 && base == 10;
  const uint32_t size = static_cast<uint32_t>(value);
  return digits_of(negative ? 0u - size : size, negative, text, base);
}
char* itoa(int value, char* text, int base) {
  return base == 10 ? ltoa(value, text, base) : digits_of(static_cast<uint16_t>(value), false, text, base);
}
char* utoa(unsigned int value, char* text, int base) { return digits_of(value, false, text, base); }
char* ultoa(unsigned int value, char* text, int base) { return digits_of(value, false, text, base); }

char* dtostrf(double value, signed char width, unsigned char digits, char* text) {
  std::sprintf(text, "%*.*f", width, digits, value);
  return text;
}

namespace {
// The width of an int.
#if defined(SIMMER_ESP32)
int narrowed(int value) { return value; }
unsigned narrowed(unsigned value) { return value; }
#else
int narrowed(int value) { return static_cast<int16_t>(value); }
unsigned narrowed(unsigned value) { return static_cast<uint16_t>(value); }
#endif
}  // namespace

int avr_vsnprintf(char* text, size_t size, const char* format, va_list values) {
  size_t length = 0;
  const auto put = [&](const char* piece) {
    for (; *piece; ++piece, ++length)
      if (length + 1 < size) text[length] = *piece;
  };
  char piece[128];
  while (*format) {
    if (*format != '%') {
      const char one[2] = {*format++, 0};
      put(one);
      continue;
    }
    char directive[32] = "%";
    size_t used = 1;
    ++format;
    while (*format && std::strchr("-+ #0123456789.*", *format)) {
      if (*format == '*')
        used += static_cast<size_t>(std::snprintf(directive + used, 12, "%d", va_arg(values, int)));
      else if (used < 16)
        directive[used++] = *format;
      ++format;
    }
    int longs = 0;
    while (*format && std::strchr("lhzjt", *format)) {
      // `size_t` and the like have 8 bytes on this machine.
      longs += *format == 'l' ? 1 : *format == 'h' ? 0 : 2;
      ++format;
    }
    if (longs > 1) used += static_cast<size_t>(std::snprintf(directive + used, 3, "ll"));
    const char kind = *format;
    if (kind) ++format;
    directive[used++] = kind;
    directive[used] = 0;
    if (kind == '%') {
      put("%");
    } else if (std::strchr("di", kind) && kind) {
      if (longs > 1) {
        std::snprintf(piece, sizeof piece, directive, va_arg(values, long long));
      } else {
        const int value = va_arg(values, int);
        std::snprintf(piece, sizeof piece, directive, longs ? value : narrowed(value));
      }
      put(piece);
    } else if (std::strchr("uxXo", kind) && kind) {
      if (longs > 1) {
        std::snprintf(piece, sizeof piece, directive, va_arg(values, unsigned long long));
      } else {
        const unsigned value = va_arg(values, unsigned);
        std::snprintf(piece, sizeof piece, directive, longs ? value : narrowed(value));
      }
      put(piece);
    } else if (kind == 'c') {
      std::snprintf(piece, sizeof piece, directive, va_arg(values, int));
      put(piece);
    } else if (kind == 's' || kind == 'S') {
      const char* value = va_arg(values, const char*);
      directive[used - 1] = 's';
      if (used == 2) {
        put(value);
      } else {
        std::snprintf(piece, sizeof piece, directive, value);
        put(piece);
      }
    } else if (kind == 'p') {
      std::snprintf(piece, sizeof piece, "%p", va_arg(values, void*));
      put(piece);
    } else if (std::strchr("eEfFgG", kind) && kind) {
      const double value = va_arg(values, double);
#if defined(SIMMER_ESP32)
      std::snprintf(piece, sizeof piece, directive, value);
      put(piece);
#else
      (void)value;
      put("?");  // as avr-libc's usual printf
#endif
    }
  }
  if (size) text[length < size ? length : size - 1] = 0;
  return static_cast<int>(length);
}

int avr_snprintf(char* text, size_t size, const char* format, ...) {
  va_list values;
  va_start(values, format);
  const int length = avr_vsnprintf(text, size, format, values);
  va_end(values);
  return length;
}

int avr_sprintf(char* text, const char* format, ...) {
  va_list values;
  va_start(values, format);
  const int length = avr_vsnprintf(text, static_cast<size_t>(-1) / 2, format, values);
  va_end(values);
  return length;
}
