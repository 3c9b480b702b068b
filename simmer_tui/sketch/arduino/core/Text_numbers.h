// Numbers as text and back, with the widths of an AVR: int has 16 bits, long 32.
#pragma once
#include <cstdarg>
#include <cstddef>

char* itoa(int value, char* text, int base);
char* ltoa(int value, char* text, int base);
char* utoa(unsigned int value, char* text, int base);
char* ultoa(unsigned int value, char* text, int base);
char* dtostrf(double value, signed char width, unsigned char digits, char* text);

// printf of avr-libc: %f prints '?' there, since its usual form has no floating point.
int avr_vsnprintf(char* text, size_t size, const char* format, va_list values);
int avr_snprintf(char* text, size_t size, const char* format, ...);
int avr_sprintf(char* text, const char* format, ...);
// sscanf (see Text_scan.cpp). Its usual form in avr-libc has no floating point either: %f reads nothing there.
int avr_sscanf(const char* text, const char* format, ...);
