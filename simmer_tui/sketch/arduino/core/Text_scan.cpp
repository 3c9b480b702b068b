// sscanf: as avr-libc's and newlib's, with the widths of the sketch's own variables.
#include <cctype>
#include <cstdarg>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "Text_numbers.h"

namespace {

#if defined(SIMMER_ESP32)
constexpr size_t INT_BYTES = 4;
constexpr bool SCANS_FLOATS = true;
#else
constexpr size_t INT_BYTES = 2;
// avr-libc has them in another library, which Arduino does not link.
constexpr bool SCANS_FLOATS = false;
#endif
constexpr size_t ANY_WIDTH = SIZE_MAX;

class Scan {
 public:
  explicit Scan(const char* text) : begin_(text), at_(text) {}
  bool at_end() const { return !*at_; }
  int read_so_far() const { return static_cast<int>(at_ - begin_); }
  bool take(char letter) {
    if (*at_ != letter || at_end()) return false;
    ++at_;
    return true;
  }
  void skip_space() {
    while (std::isspace(static_cast<unsigned char>(*at_))) ++at_;
  }

  // A whole number of a base, 0 for that of its prefix. Returns false without a digit.
  bool whole(int base, size_t width, uint64_t& value) {
    const bool negative = sign(width);
    bool found = false;
    if ((base == 0 || base == 16) && width && *at_ == '0') {
      next(width);
      found = true;
      if (width && (*at_ == 'x' || *at_ == 'X')) {
        next(width);
        base = 16;
      } else if (base == 0) {
        base = 8;
      }
    }
    if (base == 0) base = 10;
    value = 0;
    for (; width; found = true) {
      const int digit = digit_of(*at_);
      if (digit < 0 || digit >= base) break;
      value = value * static_cast<uint64_t>(base) + static_cast<uint64_t>(digit);
      next(width);
    }
    if (negative) value = 0 - value;
    return found;
  }

  // A number with a point or an exponent. Returns false without a digit.
  bool floating(size_t width, double& value) {
    const char* const first = at_;
    sign(width);
    bool found = digits(width);
    if (width && *at_ == '.') {
      next(width);
      found = digits(width) || found;
    }
    if (found && width && (*at_ == 'e' || *at_ == 'E')) {
      const char* const before = at_;
      next(width);
      sign(width);
      if (!digits(width)) at_ = before;
    }
    char piece[64] = {};
    std::memcpy(piece, first, static_cast<size_t>(at_ - first) < 63 ? static_cast<size_t>(at_ - first) : 63);
    value = std::strtod(piece, nullptr);
    return found;
  }

  // The characters for which `takes` is true. Returns false if there is none.
  template <class Takes>
  bool characters(size_t width, char* target, bool ends, Takes takes) {
    const char* const first = at_;
    for (; width && *at_ && takes(*at_); next(width))
      if (target) *target++ = *at_;
    if (target && ends && at_ != first) *target = 0;
    return at_ != first;
  }

 private:
  void next(size_t& width) {
    ++at_;
    if (width != ANY_WIDTH) --width;
  }
  bool sign(size_t& width) {
    if (!width || (*at_ != '-' && *at_ != '+')) return false;
    const bool negative = *at_ == '-';
    next(width);
    return negative;
  }
  bool digits(size_t& width) {
    const char* const first = at_;
    while (width && std::isdigit(static_cast<unsigned char>(*at_))) next(width);
    return at_ != first;
  }
  static int digit_of(char letter) {
    if (std::isdigit(static_cast<unsigned char>(letter))) return letter - '0';
    return std::isalpha(static_cast<unsigned char>(letter)) ? std::tolower(static_cast<unsigned char>(letter)) - 'a' + 10 : -1;
  }

  const char *begin_, *at_;
};

// The characters of [...] or [^...]; `format` is after its `[`, and then at its `]`.
class Set {
 public:
  explicit Set(const char*& format) {
    const bool others = *format == '^';
    if (others) ++format;
    // A `]` that comes first is one of them.
    for (bool first = true; *format && (first || *format != ']'); first = false) {
      const unsigned char low = static_cast<unsigned char>(*format);
      unsigned char high = low;
      if (format[1] == '-' && format[2] && format[2] != ']') {
        high = static_cast<unsigned char>(format[2]);
        format += 2;
      }
      ++format;
      for (int each = low; each <= high; ++each) has_[each] = true;
    }
    if (others)
      for (bool& each : has_) each = !each;
  }
  bool operator()(char letter) const { return has_[static_cast<unsigned char>(letter)]; }

 private:
  bool has_[256] = {};
};

// The bytes of a whole number's variable, by the letters before its kind.
size_t size_of(const char*& format) {
  int longs = 0, shorts = 0;
  size_t other = 0;
  for (; *format && std::strchr("lhzjt", *format); ++format) {
    longs += *format == 'l';
    shorts += *format == 'h';
    // `size_t` is that of this machine.
    if (std::strchr("zjt", *format)) other = sizeof(size_t);
  }
  if (other) return other;
  if (longs) return longs > 1 ? 8 : 4;
  return shorts > 1 ? 1 : shorts ? 2 : INT_BYTES;
}

// The low bytes come first, on the boards and on all machines that this runs on.
void store(void* target, uint64_t value, size_t size) { std::memcpy(target, &value, size); }

}  // namespace

int avr_sscanf(const char* text, const char* format, ...) {
  va_list values;
  va_start(values, format);
  Scan scan(text);
  int found = 0;
  bool fits = true;
  for (; fits && *format; ++format) {
    if (std::isspace(static_cast<unsigned char>(*format))) {
      scan.skip_space();
      continue;
    }
    if (*format != '%') {
      fits = scan.take(*format);
      continue;
    }
    const bool kept = *++format != '*';
    if (!kept) ++format;
    size_t width = ANY_WIDTH;
    if (std::isdigit(static_cast<unsigned char>(*format))) width = 0;
    while (std::isdigit(static_cast<unsigned char>(*format))) width = width * 10 + static_cast<size_t>(*format++ - '0');
    const bool is_long = *format == 'l';
    size_t size = size_of(format);
    const char kind = *format;
    if (!kind) break;
    if (kind == 'n') {
      if (kept) store(va_arg(values, void*), static_cast<uint64_t>(scan.read_so_far()), size);
      continue;
    }
    if (kind != 'c' && kind != '[') scan.skip_space();
    if (kind == '%') {
      fits = scan.take('%');
      continue;
    }
    if (std::strchr("diuoxXp", kind)) {
      uint64_t value = 0;
      fits = scan.whole(kind == 'i' ? 0 : kind == 'o' ? 8 : kind == 'd' || kind == 'u' ? 10 : 16, width, value);
      if (kind == 'p') size = sizeof(void*);
      if (fits && kept) store(va_arg(values, void*), value, size);
    } else if (kind == 'c') {
      if (width == ANY_WIDTH) width = 1;
      fits = scan.characters(width, kept ? va_arg(values, char*) : nullptr, false, [](char) { return true; });
    } else if (kind == 's') {
      fits = scan.characters(width, kept ? va_arg(values, char*) : nullptr, true,
                             [](char letter) { return !std::isspace(static_cast<unsigned char>(letter)); });
    } else if (kind == '[') {
      const Set set(++format);
      if (!*format) break;
      fits = scan.characters(width, kept ? va_arg(values, char*) : nullptr, true, set);
    } else if (SCANS_FLOATS && std::strchr("aAeEfFgG", kind)) {
      double value = 0;
      fits = scan.floating(width, value);
      if (fits && kept && is_long)
        *va_arg(values, double*) = value;
      else if (fits && kept)
        *va_arg(values, float*) = static_cast<float>(value);
    } else {
      break;
    }
    found += fits && kept;
  }
  va_end(values);
  // Text that ends too early, before anything was found, is EOF.
  return !fits && !found && scan.at_end() ? -1 : found;
}
