#include "Wire.h"

#include "../board/clock.h"
#include "../board/i2c.h"

using namespace board;

TwoWire Wire;
WireRateRegister TWBR;

void TwoWire::begin() {
  // The chip's pull-ups are on from now.
  pinMode(SDA, INPUT_PULLUP);
  pinMode(SCL, INPUT_PULLUP);
  begun_ = true;
  setClock(100000);
}

void TwoWire::end() {
  begun_ = false;
  pinMode(SDA, INPUT);
  pinMode(SCL, INPUT);
}

void TwoWire::setClock(uint32_t hertz) {
  // TWBR has 8 bits: 16 MHz by 16 to 526. At 100 kHz a byte has half a bit of overhead, which a fast bus has not.
  const uint32_t rate = constrain(hertz, 30418u, 1000000u);
  i2c_byte = rate < 400000 ? cost::I2C_BYTE * 100000 / rate : cost::I2C_FAST_BYTE * 400000 / rate;
}

WireRateRegister& WireRateRegister::operator=(int value) {
  Wire.setClock(F_CPU / (16 + 2 * (value & 0xFF)));
  return *this;
}

void TwoWire::beginTransmission(int address) {
  address_ = address & 0x7F;
  waiting_ = 0;
  is_sending_ = true;
}

size_t TwoWire::write(uint8_t value) {
  if (!is_sending_ || waiting_ >= BUFFER_LENGTH) {
    setWriteError();
    return 0;
  }
  bytes_out_[waiting_++] = value;
  return 1;
}

uint8_t TwoWire::endTransmission(bool) {
  const int count = waiting_;
  waiting_ = 0;
  is_sending_ = false;
  if (!begun_) return 4;
  return i2c_write(address_, bytes_out_, static_cast<unsigned int>(count)) ? 0 : 2;
}

uint8_t TwoWire::requestFrom(int address, int count, int) {
  received_ = next_ = 0;
  if (begun_ && count > 0) {
    const int asked = min(count, BUFFER_LENGTH);
    if (i2c_read(address & 0x7F, bytes_in_, static_cast<unsigned int>(asked))) received_ = asked;
  }
  return static_cast<uint8_t>(received_);
}
