// Functions of avr-libc's and newlib's <string.h> that not every C library has.
#pragma once
#include <cctype>
#include <cstring>
#include <utility>

inline char* board_strlwr(char* text) {
  for (char* at = text; *at; ++at) *at = static_cast<char>(std::tolower(static_cast<unsigned char>(*at)));
  return text;
}
inline char* board_strupr(char* text) {
  for (char* at = text; *at; ++at) *at = static_cast<char>(std::toupper(static_cast<unsigned char>(*at)));
  return text;
}
inline char* board_strrev(char* text) {
  const size_t length = std::strlen(text);
  for (size_t at = 0; at < length / 2; ++at) std::swap(text[at], text[length - 1 - at]);
  return text;
}
// Both return the length that they would have made with enough room.
inline size_t board_strlcpy(char* target, const char* text, size_t size) {
  const size_t length = std::strlen(text);
  if (size) {
    const size_t copied = length < size ? length : size - 1;
    std::memcpy(target, text, copied);
    target[copied] = 0;
  }
  return length;
}
inline size_t board_strlcat(char* target, const char* text, size_t size) {
  const size_t length = strnlen(target, size);
  return length + board_strlcpy(target + length, text, size - length);
}

#define strlwr board_strlwr
#define strupr board_strupr
#define strrev board_strrev
#define strlcpy board_strlcpy
#define strlcat board_strlcat
