// Stream: bytes that arrive, with a time limit.
#pragma once
#include "Print.h"

enum LookaheadMode { SKIP_ALL, SKIP_NONE, SKIP_WHITESPACE };

class Stream : public Print {
 public:
  virtual int available() = 0;
  virtual int read() = 0;
  virtual int peek() = 0;

  void setTimeout(unsigned int milliseconds) { timeout_ = milliseconds; }
  unsigned int getTimeout() const { return timeout_; }

  bool find(const char* target) { return find(target, __builtin_strlen(target)); }
  bool find(const char* target, size_t length);
  bool find(char target) { return find(&target, 1); }
  bool findUntil(const char* target, const char* end);
  int parseInt(LookaheadMode skip = SKIP_ALL, char ignored = 1);
  float parseFloat(LookaheadMode skip = SKIP_ALL, char ignored = 1);
  size_t readBytes(char* target, size_t length);
  size_t readBytes(uint8_t* target, size_t length) { return readBytes(reinterpret_cast<char*>(target), length); }
  size_t readBytesUntil(char end, char* target, size_t length);
  size_t readBytesUntil(char end, uint8_t* target, size_t length) {
    return readBytesUntil(end, reinterpret_cast<char*>(target), length);
  }
  String readString();
  String readStringUntil(char end);

 protected:
  int timedRead();
  int timedPeek();

 private:
  int peekNextDigit(LookaheadMode skip, bool with_point);
  unsigned int timeout_ = 1000;
};
