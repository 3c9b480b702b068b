// Arduino's String.
#pragma once
#include <string>
#include <type_traits>

#include "Program_memory.h"

class __FlashStringHelper;

class String {
 public:
  String(const char* text = "") : text_(text ? text : "") {}
  String(const __FlashStringHelper* text) : text_(reinterpret_cast<const char*>(text)) {}
  String(const String&) = default;
  explicit String(const std::string& text) : text_(text) {}
  explicit String(char letter) : text_(1, letter) {}
  explicit String(unsigned char value, unsigned char base = 10);
  explicit String(int value, unsigned char base = 10);
  explicit String(unsigned int value, unsigned char base = 10);
  explicit String(long value, unsigned char base = 10);
  explicit String(unsigned long value, unsigned char base = 10);
  explicit String(float value, unsigned char digits = 2);
  explicit String(double value, unsigned char digits = 2);

  String& operator=(const String&) = default;
  String& operator=(const char* text);

  unsigned int length() const { return static_cast<unsigned int>(text_.size()); }
  bool isEmpty() const { return text_.empty(); }
  const char* c_str() const { return text_.c_str(); }
  bool reserve(unsigned int size);
  void clear() { text_.clear(); }

  template <class Value>
  SIMMER_RUNTIME bool concat(const Value& value) {
    *this += value;
    return true;
  }
  String& operator+=(const String& other);
  String& operator+=(const char* other);
  String& operator+=(const __FlashStringHelper* other);
  String& operator+=(char letter);
  template <class Number, class = typename std::enable_if<std::is_arithmetic<Number>::value>::type>
  SIMMER_RUNTIME String& operator+=(Number value) {
    return *this += String(value);
  }

  bool equals(const String& other) const { return text_ == other.text_; }
  bool equalsIgnoreCase(const String& other) const;
  int compareTo(const String& other) const { return text_.compare(other.text_); }
  bool startsWith(const String& other, unsigned int from = 0) const;
  bool endsWith(const String& other) const;

  char charAt(unsigned int place) const;
  void setCharAt(unsigned int place, char letter);
  char operator[](unsigned int place) const { return charAt(place); }
  char& operator[](unsigned int place);
  char* begin() { return text_.data(); }
  char* end() { return text_.data() + text_.size(); }
  void getBytes(unsigned char* target, unsigned int size, unsigned int from = 0) const;
  void toCharArray(char* target, unsigned int size, unsigned int from = 0) const;

  int indexOf(char letter, unsigned int from = 0) const;
  int indexOf(const String& other, unsigned int from = 0) const;
  int lastIndexOf(char letter) const;
  int lastIndexOf(char letter, unsigned int from) const;
  int lastIndexOf(const String& other) const;
  String substring(unsigned int from) const;
  String substring(unsigned int from, unsigned int to) const;

  void replace(char from, char to);
  void replace(const String& from, const String& to);
  void remove(unsigned int from);
  void remove(unsigned int from, unsigned int count);
  void toLowerCase();
  void toUpperCase();
  void trim();

  int toInt() const;
  float toFloat() const;
  double toDouble() const;

  explicit operator bool() const { return true; }

 private:
  std::string text_;
};

String operator+(const String& left, const String& right);
String operator+(const String& left, const char* right);
String operator+(const char* left, const String& right);
String operator+(const String& left, const __FlashStringHelper* right);
String operator+(const String& left, char right);
template <class Number, class = typename std::enable_if<std::is_arithmetic<Number>::value>::type>
SIMMER_RUNTIME String operator+(const String& left, Number right) {
  String sum(left);
  sum += right;
  return sum;
}
inline bool operator==(const String& left, const String& right) { return left.equals(right); }
inline bool operator==(const String& left, const char* right) { return left.equals(right); }
inline bool operator==(const char* left, const String& right) { return right.equals(left); }
inline bool operator!=(const String& left, const String& right) { return !left.equals(right); }
inline bool operator!=(const String& left, const char* right) { return !left.equals(right); }
inline bool operator!=(const char* left, const String& right) { return !right.equals(left); }
inline bool operator<(const String& left, const String& right) { return left.compareTo(right) < 0; }
inline bool operator>(const String& left, const String& right) { return left.compareTo(right) > 0; }
inline bool operator<=(const String& left, const String& right) { return left.compareTo(right) <= 0; }
inline bool operator>=(const String& left, const String& right) { return left.compareTo(right) >= 0; }
typedef String StringSumHelper;
