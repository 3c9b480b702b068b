// A serial port of the board: a queue of 64 bytes that arrive, and the line on which bytes leave.
#pragma once
#include "../core/Stream.h"
#include "clock.h"

namespace board {

// SERIAL_RX_BUFFER_SIZE; one place stays free.
#if defined(SIMMER_ESP32)
constexpr unsigned int QUEUE = 256;
#else
constexpr unsigned int QUEUE = 64;
#endif

class Port : public Stream {
 public:
  Port(int rx, int tx);
  ~Port() override;
  // A copy receives too; one that is assigned to keeps its place in the list.
  Port(const Port& other);
  Port& operator=(const Port&) = default;
  int available() override;
  int read() override;
  int peek() override;

  int rx() const { return rx_; }
  Nanoseconds byte_time() const { return byte_time_; }
  // A byte has arrived whole; `baud` is the sender's.
  void arrived(uint8_t value, unsigned int baud, Nanoseconds time);

 protected:
  void open(unsigned int baud);
  void shut();
  void set_pins(int rx, int tx) { rx_ = rx; tx_ = tx; }
  virtual bool receives(Nanoseconds begin) const { (void)begin; return true; }
  virtual Nanoseconds receiving() const { return 0; }  // time of the interrupt that takes a byte off the line
  void leave(uint8_t value, Nanoseconds end);
  void drop_received() { head_ = tail_; }

  bool open_ = false, overflow_ = false;
  Nanoseconds byte_time_ = 0, free_ = 0;  // until `free_` the line carries earlier bytes
  unsigned int baud_ = 9600;
  int rx_, tx_;

 private:
  // A byte that waits to be read, with its arrival, and the place of the sketch then.
  struct Received {
    uint8_t value;
    uint32_t place;
    Nanoseconds time;
  };
  void note_late(const Received& byte);
  Received queue_[QUEUE];
  Nanoseconds told_late_ = 0;
  unsigned int head_ = 0, tail_ = 0;
};

void receive_byte(int rx, int value, Nanoseconds time);

}  // namespace board
