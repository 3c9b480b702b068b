#include "port.h"

#include "../core/HardwareSerial.h"
#include "exchange.h"
#include "interrupts.h"
#include "mistakes.h"

namespace board {

namespace {
constexpr unsigned int FASTEST = 2000000;  // the clock's 16 MHz by 8 (ATmega328P, 19.3.1)
constexpr int MOST_PORTS = 16;
constexpr unsigned int BITS = 10;    // start, eight, stop
Port* ports[MOST_PORTS];
int port_count = 0;

// What a receiver at one rate samples of a byte at another: in the middle of each of its own bits.
uint8_t sampled(uint8_t value, unsigned int sent_at, unsigned int read_at) {
  if (sent_at == read_at) return value;
  const uint32_t levels = static_cast<uint32_t>(value) << 1;  // bit 0 is the start bit; after bit 8 the line is high
  uint8_t result = 0;
  for (unsigned int bit = 0; bit < 8; ++bit) {
    const uint64_t place = static_cast<uint64_t>(2 * bit + 3) * sent_at / (2ull * read_at);
    const bool high = place > 8 || (levels >> place & 1u);
    result = static_cast<uint8_t>(result | (high ? 1u << bit : 0u));
  }
  return result;
}
}  // namespace

Port::Port(int rx, int tx) : rx_(rx), tx_(tx) {
  if (port_count < MOST_PORTS) ports[port_count++] = this;
}

Port::Port(const Port& other) : Port(other.rx_, other.tx_) { *this = other; }

// One that is local to a function receives no more after it.
Port::~Port() {
  for (int port = 0; port < port_count; ++port)
    if (ports[port] == this) {
      ports[port] = ports[--port_count];
      return;
    }
}

void Port::open(unsigned int baud) {
  baud_ = baud ? (baud < FASTEST ? baud : FASTEST) : 9600;
  byte_time_ = BITS * SECOND / baud_;
  open_ = true;
  drop_received();
  tell(Told::Baud, tx_, static_cast<int>(baud_));
  tell(Told::Baud, rx_, static_cast<int>(baud_));
  exchange(Reason::Output);  // the simulator must know the rate before the first byte
}

void Port::shut() { open_ = false; }

int Port::available() {
  pass(cost::SERIAL_LOOK);
  return static_cast<int>(head_ - tail_);
}

int Port::read() {
  pass(cost::SERIAL_LOOK);
  if (head_ == tail_) return -1;
  const Received& byte = queue_[tail_++ % QUEUE];
  if (now - byte.time >= LONG_WAIT && byte.time >= told_late_) note_late(byte);
  return byte.value;
}

// Tell that a byte has waited: for a call that lasted at least half of that, else at the place where it arrived.
void Port::note_late(const Received& byte) {
  told_late_ = now;  // those that arrived meanwhile waited for the same
  const Nanoseconds begin = last_wait.begin > byte.time ? last_wait.begin : byte.time;
  const bool in_call = last_wait.end > begin && 2 * (last_wait.end - begin) >= now - byte.time;
  tell_span(Told::LateByte, rx_, in_call ? last_wait.place : byte.place, byte.time, now);
}

int Port::peek() {
  pass(cost::SERIAL_LOOK);
  return head_ == tail_ ? -1 : queue_[tail_ % QUEUE].value;
}

void Port::arrived(uint8_t value, unsigned int baud, Nanoseconds time) {
  const Nanoseconds took = BITS * SECOND / (baud ? baud : 9600);
  if (!open_) return;
  ++wakes;
  if (!is_stopped) take_time(receiving());
  if (is_stopped || !receives(time > took ? time - took : 0) || head_ - tail_ >= QUEUE - 1) {
    overflow_ = true;
    tell(Told::LostByte, rx_, static_cast<int>(place));
    return;
  }
  queue_[head_++ % QUEUE] = {sampled(value, baud, baud_), place, time};
}

void Port::leave(uint8_t value, Nanoseconds end) {
  tell(Told::Byte, tx_, value, end);
  if ((grant_flags & STOP_WHEN_SENT) && static_cast<int>(grant_flags & 0xFF) == tx_) end_grant(end);
}

void receive_byte(int rx, int value, Nanoseconds time) {
  for (int port = 0; port < port_count; ++port)
    if (ports[port]->rx() == rx)
      ports[port]->arrived(static_cast<uint8_t>(value & 0xFF), static_cast<unsigned int>(value) >> 8, time);
}

}  // namespace board

// -- hardware ports -----------------------------------------------------------------------------------

using namespace board;

size_t HardwareSerial::write(uint8_t value) {
  note_in_interrupt(InterruptCall::Print, place);
  pass(cost::SERIAL_WRITE);
  if (!open_) return 1;
  // 63 bytes wait behind the one on the line: then the sketch waits too.
  const Nanoseconds room = 64 * byte_time_;
  if (free_ > now + room) pass_until(free_ - room);
  free_ = (free_ > now ? free_ : now) + byte_time_;
  leave(value, free_);
  return 1;
}

int HardwareSerial::availableForWrite() {
  pass(cost::SERIAL_LOOK);
  const Nanoseconds waiting = free_ > now && byte_time_ ? (free_ - now) / byte_time_ : 0;
  return waiting > 63 ? 0 : static_cast<int>(63 - waiting);
}

void HardwareSerial::flush() {
  if (free_ > now) pass_until(free_);
}

#if defined(SIMMER_ESP32)
namespace {
constexpr int NO_PIN = -1;
// The pins (rx, tx) of each port, before begin() gives it others.
constexpr int PORT_PINS[][2] = {{3, 1}, {9, 10}, {16, 17}};
int port_pin(int number, int which) { return number >= 0 && number < 3 ? PORT_PINS[number][which] : NO_PIN; }
}  // namespace
HardwareSerial::HardwareSerial(int number) : Port(port_pin(number, 0), port_pin(number, 1)) {}
HardwareSerial Serial(0), Serial1(1), Serial2(2);
#else
HardwareSerial Serial(0, 1);
#endif
#if defined(SIMMER_MEGA)
HardwareSerial Serial1(19, 18), Serial2(17, 16), Serial3(15, 14);
#endif
