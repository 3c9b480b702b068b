// The bus of two wires (I2C), and the parts at it: each answers at an address, by registers.
#pragma once
#include "clock.h"

namespace board {

// A part at the bus. The first byte that it receives is the number of a register. Bytes after it are written from there
// on, and bytes are read from there on.
class I2cPart {
 public:
  I2cPart(int number, int address) : number_(static_cast<uint8_t>(number)), address_(static_cast<uint8_t>(address)) {}
  virtual ~I2cPart() = default;

  bool answers(int address) const { return is_on() && address == address_; }
  void receive(const uint8_t* data, unsigned int count);
  void send(uint8_t* data, unsigned int count);

  Nanoseconds due() const { return due_; }
  virtual void run() {}                         // what is due has come
  virtual void pin_changed(int, bool) {}        // an output of the board has another level; an input counts as high

 protected:
  virtual bool is_on() const { return true; }
  virtual void begin_send(uint8_t, unsigned int) {}  // bytes of registers from this one on are read next
  virtual uint8_t get(uint8_t reg) = 0;
  virtual void set(uint8_t reg, uint8_t value) = 0;
  virtual bool stays_at(uint8_t) const { return false; }  // a register whose next byte is its own

  const uint8_t number_;  // of its row in wiring.toml: questions to the simulator have it
  uint8_t address_;
  Nanoseconds due_ = NEVER;

 private:
  uint8_t register_ = 0;
};

// A part of the command line: "NUMBER,ADDRESS,INT", "NUMBER,XSHUT,INT"; -1 for a pin that is not wired.
void add_mpu6050(const char* values);
void add_vl53l0x(const char* values);

extern Nanoseconds i2c_byte;  // time of a byte on the bus
// A transmission takes the time of its bytes and of the address, which is all if nobody answers: then it returns false.
bool i2c_write(int address, const uint8_t* data, unsigned int count);
bool i2c_read(int address, uint8_t* data, unsigned int count);
void i2c_pass(unsigned int bytes);

void add_part(I2cPart* part);
Nanoseconds next_part();  // the earliest time at which a part does something by itself
void run_parts();
void parts_see_pin(int pin, bool high);

}  // namespace board
