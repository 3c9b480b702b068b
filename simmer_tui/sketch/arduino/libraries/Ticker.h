// Functions that are called again and again, or once: by a timer of the system (see esp_timer.h).
#pragma once
#include <functional>

#include "esp_timer.h"

class Ticker {
 public:
  Ticker() = default;
  ~Ticker() { detach(); }
  Ticker(const Ticker&) = delete;
  Ticker& operator=(const Ticker&) = delete;

  void attach(double seconds, std::function<void()> function) { begin(in_microseconds(seconds), true, function); }
  void attach_ms(uint64_t milliseconds, std::function<void()> function) { begin(1000 * milliseconds, true, function); }
  void attach_us(uint64_t microseconds, std::function<void()> function) { begin(microseconds, true, function); }
  void once(double seconds, std::function<void()> function) { begin(in_microseconds(seconds), false, function); }
  void once_ms(uint64_t milliseconds, std::function<void()> function) { begin(1000 * milliseconds, false, function); }
  void once_us(uint64_t microseconds, std::function<void()> function) { begin(microseconds, false, function); }
  // With an argument.
  template <class Taken, class Given>
  void attach(double seconds, void (*function)(Taken), Given value) {
    begin(in_microseconds(seconds), true, [function, value] { function(value); });
  }
  template <class Taken, class Given>
  void attach_ms(uint64_t milliseconds, void (*function)(Taken), Given value) {
    begin(1000 * milliseconds, true, [function, value] { function(value); });
  }
  template <class Taken, class Given>
  void once(double seconds, void (*function)(Taken), Given value) {
    begin(in_microseconds(seconds), false, [function, value] { function(value); });
  }
  template <class Taken, class Given>
  void once_ms(uint64_t milliseconds, void (*function)(Taken), Given value) {
    begin(1000 * milliseconds, false, [function, value] { function(value); });
  }
  void detach();
  bool active() const;

 private:
  static uint64_t in_microseconds(double seconds) { return static_cast<uint64_t>(seconds * 1e6); }
  void begin(uint64_t microseconds, bool repeats, std::function<void()> function);
  std::function<void()> function_;
  esp_timer_handle_t timer_ = nullptr;
};
