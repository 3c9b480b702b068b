// A VL53L0X, as far as our libraries use its registers. Those for its optics are kept and mean nothing.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "exchange.h"
#include "i2c.h"
#include "pins.h"
#include "vl53l0x.h"

namespace board {

namespace vl53l0x {
namespace {
constexpr int FIRST_ADDRESS = 0x29;
constexpr Nanoseconds BOOT = 1200 * MICROSECOND;   // from XSHUT's rise (STMicroelectronics DS11555, 2.9.1)
constexpr double MILLIMETRES = 25.4;               // an inch

class Vl53l0x : public I2cPart {
 public:
  Vl53l0x(int number, int xshut, int interrupt) : I2cPart(number, FIRST_ADDRESS), xshut_(xshut), interrupt_(interrupt) {
    reset();
  }

  void run() override {
    measure();
    if (mode_ == SINGLE)
      stop();
    else
      begin(std::max(begun_ + period(), now));
  }

  void pin_changed(int pin, bool high) override {
    if (pin != xshut_ || high == is_up_) return;
    is_up_ = high;
    if (high) ready_at_ = now + BOOT;
    reset();
  }

 protected:
  bool is_on() const override { return is_up_ && now >= ready_at_; }
  uint8_t get(uint8_t reg) override { return registers_[reg]; }

  void set(uint8_t reg, uint8_t value) override {
    registers_[reg] = value;
    if (reg == PAGE || registers_[PAGE]) return;
    if (reg == ADDRESS) address_ = value & 0x7F;
    if (reg == CLEAR) clear();
    if (reg != START) return;
    if (value & (BACK_TO_BACK | TIMED)) {
      mode_ = value & (BACK_TO_BACK | TIMED);
      begin(now);
    } else if (value & SINGLE) {
      // In a continuous mode this bit ends it.
      const bool is_start = mode_ == 0;
      stop();
      if (is_start) {
        mode_ = SINGLE;
        begin(now);
      }
    }
  }

 private:
  void reset() {
    std::memset(registers_, 0, sizeof registers_);
    registers_[MODEL] = MODEL_ID;
    registers_[MODEL + 1] = 0xAA;
    registers_[MODEL + 2] = 0x10;
    registers_[BUDGET] = DEFAULT_BUDGET / BUDGET_UNIT >> 8;
    registers_[BUDGET + 1] = DEFAULT_BUDGET / BUDGET_UNIT & 0xFF;
    address_ = FIRST_ADDRESS;
    stop();
    clear();
  }

  Nanoseconds budget() const {
    const unsigned int steps = static_cast<unsigned int>(registers_[BUDGET] << 8 | registers_[BUDGET + 1]);
    return std::max(steps * BUDGET_UNIT, SHORTEST_BUDGET) * MICROSECOND;
  }
  Nanoseconds period() const {
    if (mode_ != TIMED) return budget();
    uint32_t milliseconds = 0;
    for (int byte = 0; byte < 4; ++byte) milliseconds = milliseconds << 8 | registers_[PERIOD + byte];
    return std::max<Nanoseconds>(milliseconds * MILLISECOND, budget());
  }

  void begin(Nanoseconds moment) {
    begun_ = moment;
    due_ = moment + budget();
  }

  void stop() {
    mode_ = 0;
    due_ = NEVER;
    registers_[START] = 0;
  }

  // The distance at the end of the measurement.
  void measure() {
    const double inches = exchange(Reason::Query, Query::Range, number_);
    const double found = std::isfinite(inches) ? std::round(inches * MILLIMETRES) : NOTHING;
    const bool is_valid = found < NOTHING;
    const unsigned int shown = is_valid ? static_cast<unsigned int>(found) : NOTHING;
    registers_[RESULT] = static_cast<uint8_t>((is_valid ? VALID : WRONG_PHASE) << 3 | 1);
    registers_[RANGE] = static_cast<uint8_t>(shown >> 8);
    registers_[RANGE + 1] = static_cast<uint8_t>(shown);
    registers_[READY] = 4;
    if (interrupt_ >= 0) set_input(interrupt_, 0);
  }

  void clear() {
    registers_[READY] = 0;
    if (interrupt_ >= 0) set_input(interrupt_, 1);  // an open drain with its pull-up
  }

  const int xshut_, interrupt_;
  uint8_t registers_[256];
  bool is_up_ = true;  // the breakout's pull-up
  uint8_t mode_ = 0;
  Nanoseconds ready_at_ = 0, begun_ = 0;
};
}  // namespace
}  // namespace vl53l0x

void add_vl53l0x(const char* values) {
  char* end = nullptr;
  const int number = static_cast<int>(std::strtol(values, &end, 10));
  const int xshut = static_cast<int>(std::strtol(end + 1, &end, 10));
  add_part(new vl53l0x::Vl53l0x(number, xshut, static_cast<int>(std::strtol(end + 1, &end, 10))));
}

}  // namespace board
