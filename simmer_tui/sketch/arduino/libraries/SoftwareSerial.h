// A serial port on any two pins. While it writes, interrupts are off; only the port that listens receives.
#pragma once
#include "../board/port.h"

class SoftwareSerial : public board::Port {
 public:
  SoftwareSerial(int rx, int tx, bool inverse = false);
  ~SoftwareSerial() override;
  void begin(unsigned int baud);
  void end();
  bool listen();
  bool isListening() const;
  bool stopListening();
  bool overflow();
  using Print::write;
  size_t write(uint8_t value) override;
  explicit operator bool() const { return true; }

 protected:
  bool receives(board::Nanoseconds begin) const override;
};
