#include "Stream.h"

#include <cstdlib>
#include <cstring>
#include <string>

#include "../board/clock.h"

// Waits poll as the core does: a byte is seen at the first look after it has arrived.
static int timed(Stream& stream, int (Stream::*look)(), unsigned int milliseconds) {
  const board::WaitScope scope(board::Waits::InRead, board::place);
  const board::Nanoseconds end = board::now + milliseconds * board::MILLISECOND;
  do {
    const int value = (stream.*look)();
    if (value >= 0) return value;
    // A round of this loop asks for the time as well. It is skipped to what happens next, whole rounds at a time.
    const board::Nanoseconds round = board::cost::MILLIS + board::cost::SERIAL_LOOK;
    const board::Nanoseconds begin = board::now;
    board::pass_until_event(end);
    const board::Nanoseconds over = (board::now - begin) % round;
    if (over) board::pass(round - over);
  } while (board::now < end);
  return -1;
}

int Stream::timedRead() { return timed(*this, &Stream::read, timeout_); }
int Stream::timedPeek() { return timed(*this, &Stream::peek, timeout_); }

size_t Stream::readBytes(char* target, size_t length) {
  size_t count = 0;
  for (; count < length; ++count) {
    const int value = timedRead();
    if (value < 0) break;
    target[count] = static_cast<char>(value);
  }
  return count;
}

size_t Stream::readBytesUntil(char end, char* target, size_t length) {
  size_t count = 0;
  for (; count < length; ++count) {
    const int value = timedRead();
    if (value < 0 || value == static_cast<unsigned char>(end)) break;
    target[count] = static_cast<char>(value);
  }
  return count;
}

String Stream::readString() {
  String text;
  for (int value = timedRead(); value >= 0; value = timedRead()) text += static_cast<char>(value);
  return text;
}

String Stream::readStringUntil(char end) {
  String text;
  for (int value = timedRead(); value >= 0 && value != static_cast<unsigned char>(end); value = timedRead())
    text += static_cast<char>(value);
  return text;
}

bool Stream::find(const char* target, size_t length) {
  for (size_t matched = 0; matched < length;) {
    const int value = timedRead();
    if (value < 0) return false;
    if (value == static_cast<unsigned char>(target[matched]))
      ++matched;
    else
      matched = value == static_cast<unsigned char>(target[0]);
  }
  return true;
}

bool Stream::findUntil(const char* target, const char* end) {
  std::string read;
  const size_t length = std::strlen(target), end_length = std::strlen(end);
  const auto ends_with = [&](const char* text, size_t size) {
    return size && read.size() >= size && read.compare(read.size() - size, size, text) == 0;
  };
  for (;;) {
    if (ends_with(target, length)) return true;
    if (ends_with(end, end_length)) return false;
    const int value = timedRead();
    if (value < 0) return false;
    read += static_cast<char>(value);
  }
}

int Stream::peekNextDigit(LookaheadMode skip, bool with_point) {
  for (;;) {
    const int value = timedPeek();
    if (value < 0 || value == '-' || (value >= '0' && value <= '9') || (with_point && value == '.')) return value;
    if (skip == SKIP_NONE) return -1;
    const bool space = value == ' ' || value == '\t' || value == '\r' || value == '\n';
    if (skip == SKIP_WHITESPACE && !space) return -1;
    read();
  }
}

int Stream::parseInt(LookaheadMode skip, char ignored) {
  int value = peekNextDigit(skip, false);
  if (value < 0) return 0;
  bool negative = false;
  uint32_t number = 0;
  do {
    if (value == ignored) {
    } else if (value == '-') {
      negative = true;
    } else {
      number = number * 10 + static_cast<uint32_t>(value - '0');
    }
    read();
    value = timedPeek();
  } while ((value >= '0' && value <= '9') || value == ignored);
  return static_cast<int>(negative ? 0u - number : number);
}

float Stream::parseFloat(LookaheadMode skip, char ignored) {
  int value = peekNextDigit(skip, true);
  if (value < 0) return 0.0f;
  bool negative = false, after_point = false;
  float number = 0.0f, fraction = 1.0f;
  do {
    if (value == ignored) {
    } else if (value == '-') {
      negative = true;
    } else if (value == '.') {
      after_point = true;
    } else {
      number = number * 10.0f + static_cast<float>(value - '0');
      if (after_point) fraction *= 0.1f;
    }
    read();
    value = timedPeek();
  } while ((value >= '0' && value <= '9') || (value == '.' && !after_point) || value == ignored);
  number *= fraction;
  return negative ? -number : number;
}
