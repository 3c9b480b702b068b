// An MPU-6050 by its registers (InvenSense, "Register Map and Descriptions", revision 4.2). It lies flat: Z is up, and
// turns to the left are positive.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "exchange.h"
#include "i2c.h"
#include "pins.h"

namespace board {

namespace mpu6050 {
namespace {
enum : uint8_t {
  Z_GYRO_OFFSET = 0x17, SAMPLE_DIVIDER = 0x19, CONFIG = 0x1A, GYRO_CONFIG = 0x1B, ACCEL_CONFIG = 0x1C,
  INT_PIN_CONFIG = 0x37, INT_ENABLE = 0x38, INT_STATUS = 0x3A, ACCEL_OUT = 0x3B, ACCEL_Z = 0x3F, TEMPERATURE = 0x41,
  GYRO_Z = 0x47, DATA_END = 0x49, USER_CONTROL = 0x6A, POWER = 0x6B, DMP_START = 0x70, FIFO_COUNT = 0x72, FIFO_DATA = 0x74,
  WHO_AM_I = 0x75
};
enum : uint8_t { DMP_ON = 0x80, FIFO_ON = 0x40, FIFO_RESET = 0x04, ALL_RESETS = 0x0F };  // USER_CONTROL
enum : uint8_t { RESET = 0x80, SLEEP = 0x40 };                                           // POWER
enum : uint8_t { OVERFLOWED = 0x10, PACKET_READY = 0x02, DATA_READY = 0x01 };            // INT_STATUS, INT_ENABLE
enum : uint8_t { ACTIVE_LOW = 0x80, LATCHED = 0x20, CLEARED_BY_ANY = 0x10 };             // INT_PIN_CONFIG

constexpr unsigned int FIFO_SIZE = 1024, PACKET = 42, SHORT_PACKET = 28;
constexpr uint8_t SHORT_PROGRAM = 0x04;         // the page at which the DMP's program with short packets begins
constexpr Nanoseconds PACKET_PERIOD = 10 * MILLISECOND, PULSE = 50 * MICROSECOND;
constexpr int ROOM_TEMPERATURE = -3920;         // (25 - 36.53) * 340
constexpr double LEAST_GYRO = 131.0, LEAST_ACCEL = 16384.0;  // counts of a deg/s and of a g in the smallest range
constexpr double OFFSET_COUNTS = 32.8;          // of a deg/s in the registers of offsets
constexpr double PACKET_GYRO = 16.4, PACKET_ACCEL = 8192.0, SHORT_ACCEL = 16384.0;  // in a packet, whatever the ranges are
constexpr double UNIT = 1 << 30;                // of a packet's quaternion
constexpr double DEGREE = 3.14159265358979323846 / 180.0;

int16_t counts_of(double value) {
  if (std::isnan(value)) return 0;
  return static_cast<int16_t>(std::lround(std::min(std::max(value, -32768.0), 32767.0)));
}

class Mpu6050 : public I2cPart {
 public:
  Mpu6050(int number, int address, int interrupt) : I2cPart(number, address), interrupt_(interrupt) { reset(); }

  void run() override {
    if (pulse_end_ <= now) release();
    if (next_sample_ <= now) {
      next_sample_ += period();
      sample();
    }
    due_ = std::min(pulse_end_, next_sample_);
  }

 protected:
  void begin_send(uint8_t reg, unsigned int count) override {
    const unsigned int end = reg + count;
    if (registers_[INT_PIN_CONFIG] & CLEARED_BY_ANY && reg != FIFO_DATA) release();
    // All bytes of a burst are of one moment.
    if (end > ACCEL_OUT && reg < DATA_END && !(registers_[POWER] & SLEEP)) measure(end > GYRO_Z);
    if (reg <= INT_STATUS && INT_STATUS < end) see_status();
  }

  uint8_t get(uint8_t reg) override {
    if (reg == FIFO_DATA) return pop();
    if (reg == FIFO_COUNT) return static_cast<uint8_t>(fifo_count_ >> 8);
    if (reg == FIFO_COUNT + 1) return static_cast<uint8_t>(fifo_count_);
    if (reg >= sizeof registers_) return 0;
    const uint8_t value = registers_[reg];
    if (reg == INT_STATUS) {
      registers_[reg] = 0;
      release();
    }
    return value;
  }

  void set(uint8_t reg, uint8_t value) override {
    if (reg >= sizeof registers_ || reg == WHO_AM_I || (reg >= INT_STATUS && reg < 0x63) || reg >= FIFO_COUNT) return;
    if (reg == POWER && value & RESET) return reset();
    if (reg == USER_CONTROL) {
      if (value & FIFO_RESET) {
        fifo_count_ = 0;
        overflowed_ = false;
      }
      value &= static_cast<uint8_t>(~ALL_RESETS);  // they clear themselves
      if (value & DMP_ON && !(registers_[reg] & DMP_ON)) {
        first_angle_ = ask(Query::Angle);
        turned_by_offset_ = 0;
      }
    }
    const bool was_on = period() != NEVER;
    const Nanoseconds before = period();
    registers_[reg] = value;
    if (reg == CONFIG) rate_since_ = 0;  // another filter has another rate
    if (period() == NEVER)
      next_sample_ = NEVER;
    else if (!was_on || period() != before)
      next_sample_ = now + period();
    due_ = std::min(pulse_end_, next_sample_);
  }

  bool stays_at(uint8_t reg) const override { return reg == FIFO_DATA; }

 private:
  double ask(Query query) const {
    // The rate is that behind the low-pass filter, whose number is asked for with it.
    const int filter = query == Query::Rate ? registers_[CONFIG] & 7 : 0;
    const double answer = exchange(Reason::Query, query, number_ | filter << 8);
    return std::isnan(answer) ? 0 : answer;
  }

  double rate() {
    if (rate_since_ != answers_since) {
      rate_ = ask(Query::Rate);
      rate_since_ = grant_flags & ANSWER_HOLDS ? answers_since : 0;
    }
    return rate_;
  }

  void reset() {
    std::memset(registers_, 0, sizeof registers_);
    registers_[POWER] = SLEEP;
    registers_[WHO_AM_I] = 0x68;  // whatever its address is
    fifo_count_ = 0;
    overflowed_ = false;
    next_sample_ = pulse_end_ = due_ = NEVER;
    if (interrupt_ >= 0) set_input(interrupt_, 0);
  }

  bool makes_packets() const {
    return (registers_[USER_CONTROL] & (DMP_ON | FIFO_ON)) == (DMP_ON | FIFO_ON) && !(registers_[POWER] & SLEEP);
  }

  Nanoseconds sample_period() const {
    // 1 kHz with the low-pass filter, 8 kHz without.
    const int filter = registers_[CONFIG] & 7;
    return (filter == 0 || filter == 7 ? 125 : 1000) * MICROSECOND * (registers_[SAMPLE_DIVIDER] + 1u);
  }

  // Between the moments at which it does something by itself. Data that nobody is told of are made when they are read.
  Nanoseconds period() const {
    if (makes_packets()) return PACKET_PERIOD;
    const bool is_told = interrupt_ >= 0 && registers_[INT_ENABLE] & DATA_READY && !(registers_[POWER] & SLEEP);
    return is_told ? sample_period() : NEVER;
  }

  void sample() {
    uint8_t made = DATA_READY;
    if (makes_packets()) {
      push_packet();
      made = static_cast<uint8_t>(made | PACKET_READY);
    }
    registers_[INT_STATUS] |= made;
    if (made & registers_[INT_ENABLE]) interrupt();
  }

  void see_status() {
    if (registers_[POWER] & SLEEP || next_sample_ != NEVER) return;
    if (now - status_seen_ >= sample_period()) registers_[INT_STATUS] |= DATA_READY;
    status_seen_ = now;
  }

  // -- the interrupt's pin -----------------------------------------------------------------------------

  void interrupt() {
    if (interrupt_ < 0) return;
    set_input(interrupt_, !(registers_[INT_PIN_CONFIG] & ACTIVE_LOW));
    pulse_end_ = registers_[INT_PIN_CONFIG] & LATCHED ? NEVER : now + PULSE;
  }

  void release() {
    pulse_end_ = NEVER;
    due_ = next_sample_;
    if (interrupt_ >= 0) set_input(interrupt_, (registers_[INT_PIN_CONFIG] & ACTIVE_LOW) != 0);
  }

  // -- measurements --------------------------------------------------------------------------------------

  void put(uint8_t reg, int16_t value) {
    registers_[reg] = static_cast<uint8_t>(value >> 8);
    registers_[reg + 1] = static_cast<uint8_t>(value);
  }

  double z_offset() const {
    return static_cast<int16_t>(registers_[Z_GYRO_OFFSET] << 8 | registers_[Z_GYRO_OFFSET + 1]) / OFFSET_COUNTS;
  }

  void measure(bool with_z) {
    const int accel_range = registers_[ACCEL_CONFIG] >> 3 & 3, gyro_range = registers_[GYRO_CONFIG] >> 3 & 3;
    put(ACCEL_Z, counts_of(LEAST_ACCEL / (1 << accel_range)));
    put(TEMPERATURE, ROOM_TEMPERATURE);
    if (with_z) put(GYRO_Z, counts_of((rate() + z_offset()) * LEAST_GYRO / (1 << gyro_range)));
  }

  // -- packets and their FIFO ----------------------------------------------------------------------------

  void push_packet() {
    turned_by_offset_ += z_offset() * static_cast<double>(PACKET_PERIOD) / static_cast<double>(SECOND);
    const double half = (ask(Query::Angle) - first_angle_ + turned_by_offset_) * DEGREE / 2;
    const double turned = rate() + z_offset();
    uint8_t packet[PACKET] = {};
    const auto put = [&packet](unsigned int at, int32_t value) {
      for (unsigned int byte = 0; byte < 4; ++byte) packet[at + byte] = static_cast<uint8_t>(value >> (24 - 8 * byte));
    };
    put(0, static_cast<int32_t>(std::lround(std::cos(half) * UNIT)));
    put(12, static_cast<int32_t>(std::lround(std::sin(half) * UNIT)));
    if (registers_[DMP_START] == SHORT_PROGRAM) {
      put(18, counts_of(SHORT_ACCEL));                     // Z: bytes 20 and 21
      put(24, counts_of(turned * PACKET_GYRO) & 0xFFFF);  // Z: bytes 26 and 27
    } else {
      put(24, counts_of(turned * PACKET_GYRO) * 65536);
      put(36, counts_of(PACKET_ACCEL) * 65536);
    }
    const unsigned int size = registers_[DMP_START] == SHORT_PROGRAM ? SHORT_PACKET : PACKET;
    for (unsigned int at = 0; at < size; ++at) push(packet[at]);
  }

  // A full FIFO loses its oldest bytes: what is read then begins within a packet.
  void push(uint8_t byte) {
    if (fifo_count_ == FIFO_SIZE) {
      ++fifo_first_;
      --fifo_count_;
      registers_[INT_STATUS] |= OVERFLOWED;
      const uint32_t at = waiting.kind == Waits::Not ? place : waiting.place;
      if (!overflowed_) tell(Told::FifoOverflow, number_, static_cast<int>(at));
      overflowed_ = true;
    }
    fifo_[(fifo_first_ + fifo_count_++) % FIFO_SIZE] = byte;
  }

  uint8_t pop() {
    if (fifo_count_ == 0) return 0;
    --fifo_count_;
    overflowed_ = false;
    return fifo_[fifo_first_++ % FIFO_SIZE];
  }

  const int interrupt_;
  uint8_t registers_[128];
  uint8_t fifo_[FIFO_SIZE] = {};
  unsigned int fifo_first_ = 0, fifo_count_ = 0;
  bool overflowed_ = false;
  double first_angle_ = 0, turned_by_offset_ = 0, rate_ = 0;
  uint64_t rate_since_ = 0;  // `answers_since` for which `rate_` is known; 0 for none
  Nanoseconds next_sample_ = NEVER, pulse_end_ = NEVER, status_seen_ = 0;
};
}  // namespace
}  // namespace mpu6050

void add_mpu6050(const char* values) {
  char* end = nullptr;
  const int number = static_cast<int>(std::strtol(values, &end, 10));
  const int address = static_cast<int>(std::strtol(end + 1, &end, 10));
  add_part(new mpu6050::Mpu6050(number, address, static_cast<int>(std::strtol(end + 1, &end, 10))));
}

}  // namespace board
