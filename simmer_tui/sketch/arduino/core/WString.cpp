#include "WString.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <strings.h>

#include "Text_numbers.h"

static std::string whole(int value, int base) {
  char text[40];
  return ltoa(value, text, base);
}
static std::string natural(unsigned int value, int base) {
  char text[40];
  return ultoa(value, text, base);
}
static std::string decimal(double value, int digits) {
  char text[400];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

String::String(unsigned char value, unsigned char base) : text_(natural(value, base)) {}
String::String(int value, unsigned char base) : text_(whole(value, base)) {}
String::String(unsigned int value, unsigned char base) : text_(natural(value, base)) {}
String::String(long value, unsigned char base) : text_(whole(static_cast<int>(value), base)) {}
String::String(unsigned long value, unsigned char base) : text_(natural(static_cast<unsigned>(value), base)) {}
String::String(float value, unsigned char digits) : text_(decimal(static_cast<double>(value), digits)) {}
String::String(double value, unsigned char digits) : text_(decimal(value, digits)) {}

String& String::operator=(const char* text) {
  text_ = text ? text : "";
  return *this;
}
bool String::reserve(unsigned int size) {
  text_.reserve(size);
  return true;
}
String& String::operator+=(const String& other) {
  text_ += other.text_;
  return *this;
}
String& String::operator+=(const char* other) {
  if (other) text_ += other;
  return *this;
}
String& String::operator+=(const __FlashStringHelper* other) { return *this += reinterpret_cast<const char*>(other); }
String& String::operator+=(char letter) {
  text_ += letter;
  return *this;
}

bool String::equalsIgnoreCase(const String& other) const { return strcasecmp(c_str(), other.c_str()) == 0; }
bool String::startsWith(const String& other, unsigned int from) const {
  return from <= text_.size() && text_.compare(from, other.text_.size(), other.text_) == 0;
}
bool String::endsWith(const String& other) const {
  return other.text_.size() <= text_.size() && startsWith(other, length() - other.length());
}

char String::charAt(unsigned int place) const { return place < text_.size() ? text_[place] : 0; }
void String::setCharAt(unsigned int place, char letter) {
  if (place < text_.size()) text_[place] = letter;
}
char& String::operator[](unsigned int place) {
  static char outside;
  outside = 0;
  return place < text_.size() ? text_[place] : outside;
}
void String::getBytes(unsigned char* target, unsigned int size, unsigned int from) const {
  if (!size) return;
  unsigned int count = 0;
  for (; count + 1 < size && from + count < text_.size(); ++count)
    target[count] = static_cast<unsigned char>(text_[from + count]);
  target[count] = 0;
}
void String::toCharArray(char* target, unsigned int size, unsigned int from) const {
  getBytes(reinterpret_cast<unsigned char*>(target), size, from);
}

static int place_of(size_t found) { return found == std::string::npos ? -1 : static_cast<int>(found); }
int String::indexOf(char letter, unsigned int from) const { return place_of(text_.find(letter, from)); }
int String::indexOf(const String& other, unsigned int from) const { return place_of(text_.find(other.text_, from)); }
int String::lastIndexOf(char letter) const { return place_of(text_.rfind(letter)); }
int String::lastIndexOf(char letter, unsigned int from) const { return place_of(text_.rfind(letter, from)); }
int String::lastIndexOf(const String& other) const { return place_of(text_.rfind(other.text_)); }
String String::substring(unsigned int from) const { return substring(from, length()); }
String String::substring(unsigned int from, unsigned int to) const {
  if (from > to) std::swap(from, to);
  if (from >= text_.size()) return String();
  return String(text_.substr(from, to - from));
}

void String::replace(char from, char to) {
  for (char& letter : text_)
    if (letter == from) letter = to;
}
void String::replace(const String& from, const String& to) {
  if (from.isEmpty()) return;
  for (size_t at = 0; (at = text_.find(from.text_, at)) != std::string::npos; at += to.text_.size())
    text_.replace(at, from.text_.size(), to.text_);
}
void String::remove(unsigned int from) {
  if (from < text_.size()) text_.erase(from);
}
void String::remove(unsigned int from, unsigned int count) {
  if (from < text_.size()) text_.erase(from, count);
}
void String::toLowerCase() {
  for (char& letter : text_) letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
}
void String::toUpperCase() {
  for (char& letter : text_) letter = static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
}
void String::trim() {
  const char* spaces = " \t\r\n\v\f";
  const size_t first = text_.find_first_not_of(spaces);
  if (first == std::string::npos) {
    text_.clear();
    return;
  }
  text_ = text_.substr(first, text_.find_last_not_of(spaces) - first + 1);
}

int String::toInt() const { return static_cast<int>(std::strtoll(c_str(), nullptr, 10)); }
float String::toFloat() const { return std::strtof(c_str(), nullptr); }
double String::toDouble() const { return static_cast<double>(toFloat()); }

String operator+(const String& left, const String& right) { return String(left) += right; }
String operator+(const String& left, const char* right) { return String(left) += right; }
String operator+(const char* left, const String& right) { return String(left) += right; }
String operator+(const String& left, const __FlashStringHelper* right) { return String(left) += right; }
String operator+(const String& left, char right) { return String(left) += right; }
