// Serial, and Serial1 to Serial3 of a Mega.
#pragma once
#include "../board/port.h"
#include "Stream.h"

class HardwareSerial : public board::Port {
 public:
  HardwareSerial(int rx, int tx) : Port(rx, tx) {}
  void begin(unsigned int baud, unsigned char = 0x06) { open(baud); }
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
#endif
// Calls serialEvent() of each port with bytes: after each loop(), and in a sketch that waits itself.
void serialEventRun();
#define SERIAL_PORT_MONITOR Serial
#define SERIAL_PORT_HARDWARE Serial
