// Serial, and Serial1 to Serial3 of a Mega.
#pragma once
#include "../board/port.h"
#include "Stream.h"

class HardwareSerial : public board::Port {
 public:
  HardwareSerial(int rx, int tx) : Port(rx, tx) {}
#if defined(SIMMER_ESP32)
  // By its number: 0 is the USB port.
  explicit HardwareSerial(int number);
  void begin(unsigned int baud, unsigned int = 0x06, int rx = -1, int tx = -1) {
    if (rx_ < 0) return;  // there is no port of its number
    set_pins(rx < 0 ? rx_ : rx, tx < 0 ? tx_ : tx);
    open(baud);
  }
  bool setPins(int rx, int tx, int = -1, int = -1) {
    set_pins(rx < 0 ? rx_ : rx, tx < 0 ? tx_ : tx);
    return true;
  }
  bool setRxBufferSize(size_t) { return true; }
  void setDebugOutput(bool) {}  // the log's messages are not there
#else
  void begin(unsigned int baud, unsigned char = 0x06) { open(baud); }
#endif
  void end() { shut(); }
  int availableForWrite() override;
  void flush() override;
  using Print::write;
  size_t write(uint8_t value) override;
  explicit operator bool() const { return true; }

 protected:
  board::Nanoseconds receiving() const override { return board::cost::SERIAL_RECEIVE; }
};

extern HardwareSerial Serial;
#if defined(SIMMER_MEGA)
extern HardwareSerial Serial1, Serial2, Serial3;
#elif defined(SIMMER_ESP32)
extern HardwareSerial Serial1, Serial2;
#endif
// Calls serialEvent() of each port with bytes: after each loop(), and in a sketch that waits itself.
void serialEventRun();
#define SERIAL_PORT_MONITOR Serial
#define SERIAL_PORT_HARDWARE Serial
