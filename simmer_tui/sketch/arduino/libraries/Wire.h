// The I2C bus of the board, which leads it. Other boards cannot call it.
#pragma once
#include "../core/Arduino.h"

#define BUFFER_LENGTH 32
#define WIRE_HAS_END 1
#define WIRE_HAS_TIMEOUT 1

class TwoWire : public Stream {
 public:
  void begin();
#if defined(SIMMER_ESP32)
  bool begin(int, int, uint32_t hertz = 0) {  // its pins are any two: the parts of the wiring are at them
    begin();
    if (hertz) setClock(hertz);
    return true;
  }
#endif
  void end();
  void setClock(uint32_t hertz);

  void beginTransmission(int address);
  // 0: all was taken; 2: nobody is at the address; 4: the bus was not begun.
  uint8_t endTransmission(bool stop = true);
  // The number of bytes that have come: all, or none.
  uint8_t requestFrom(int address, int count, int stop = 1);

  using Print::write;
  size_t write(uint8_t value) override;
  int available() override { return received_ - next_; }
  int read() override { return next_ < received_ ? bytes_in_[next_++] : -1; }
  int peek() override { return next_ < received_ ? bytes_in_[next_] : -1; }

  // The bus never hangs, so there is nothing to time out.
  void setWireTimeout(uint32_t = 25000, bool = false) {}
  bool getWireTimeoutFlag() const { return false; }
  void clearWireTimeoutFlag() {}

 private:
  bool begun_ = false, is_sending_ = false;
  int address_ = 0, waiting_ = 0, received_ = 0, next_ = 0;
  uint8_t bytes_out_[BUFFER_LENGTH], bytes_in_[BUFFER_LENGTH];
};
extern TwoWire Wire;

// The register of the clock's rate, which old sketches set: 16 MHz by 16 + 2 TWBR.
struct WireRateRegister {
  WireRateRegister& operator=(int value);
};
extern WireRateRegister TWBR;
