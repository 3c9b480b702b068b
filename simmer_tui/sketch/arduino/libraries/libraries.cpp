// The libraries that have more than a header.
#include "EEPROM.h"
#include "Servo.h"
#include "SoftwareSerial.h"
#include "util/atomic.h"

#include "../board/clock.h"
#include "../board/exchange.h"
#include "../board/interrupts.h"

using namespace board;

// -- util/atomic.h -----------------------------------------------------------------------------------

InterruptBlock::InterruptBlock(bool off, BlockEnd end)
    : on_at_end_(end == RESTORE_INTERRUPTS ? interrupts_on() : end == INTERRUPTS_ON) {
  if (off)
    noInterrupts();
  else
    interrupts();
}
InterruptBlock::~InterruptBlock() {
  if (on_at_end_)
    interrupts();
  else
    noInterrupts();
}

// -- SoftwareSerial ----------------------------------------------------------------------------------

namespace {
SoftwareSerial* listening = nullptr;
}

SoftwareSerial::SoftwareSerial(int rx, int tx, bool) : Port(rx, tx) {}
SoftwareSerial::~SoftwareSerial() { stopListening(); }

void SoftwareSerial::begin(unsigned int baud) {
  open(baud);
  listen();
}
void SoftwareSerial::end() {
  stopListening();
  shut();
}
bool SoftwareSerial::listen() {
  if (listening == this) return false;
  listening = this;
  drop_received();
  overflow_ = false;
  return true;
}
bool SoftwareSerial::isListening() const { return listening == this; }
bool SoftwareSerial::stopListening() {
  if (listening != this) return false;
  listening = nullptr;
  return true;
}
bool SoftwareSerial::overflow() {
  const bool before = overflow_;
  overflow_ = false;
  return before;
}

bool SoftwareSerial::receives(Nanoseconds begin) const {
  if (listening != this) return false;
  // The start bit is an interrupt. One that comes more than half a bit late reads a wrong byte: it counts as lost.
  const Nanoseconds half = byte_time() / 20;
  if (off_since != NEVER) return begin < off_since;
  return last_off == NEVER || begin < last_off || begin + half >= last_on;
}

size_t SoftwareSerial::write(uint8_t value) {
  if (!open_) return 0;
  const Nanoseconds end = now + byte_time_;
  const bool were_on = interrupts_on();
  leave(value, end);
  set_interrupts(false);
  pass_until(end);
  if (were_on) interrupts();
  return 1;
}

// -- Servo -------------------------------------------------------------------------------------------

unsigned char Servo::attach(int pin, int shortest, int longest) {
  pin_ = pin >= 0 && pin < DIGITAL_PINS ? pin : -1;
  shortest_ = shortest;
  longest_ = longest;
  pinMode(pin, OUTPUT);
  // The pulse begins as it is, 1500 us if nothing was written. Only what is written later has these limits.
  send();
  return 0;
}
void Servo::detach() {
  if (pin_ >= 0) tell(Told::Servo, pin_, 0);
  pin_ = -1;
}
void Servo::write(int value) {
  if (value < 544) {
    value = constrain(value, 0, 180);
    value = map(value, 0, 180, shortest_, longest_);
  }
  writeMicroseconds(value);
}
void Servo::writeMicroseconds(int width) {
  width_ = constrain(width, shortest_, longest_);
  send();
}
void Servo::send() const {
  pass(cost::SERVO_WRITE);
  if (pin_ < 0) return;
  // A pulse that is longer moves no servo farther.
  tell(Told::Servo, pin_, constrain(width_, 0, 3000));
  exchange(Reason::Output);
}
int Servo::read() const { return map(width_ + 1, shortest_, longest_, 0, 180); }

// -- EEPROM ------------------------------------------------------------------------------------------

EEPROMClass EEPROM;
#if defined(SIMMER_ESP32)
void flash_read() { pass(cost::FLASH_READ); }
void flash_write() { pass(cost::FLASH_WRITE); }
#else
namespace {
uint8_t cells[EEPROM_SIZE];
bool erased = false;
uint8_t& cell(int address) {
  if (!erased) std::memset(cells, 0xFF, sizeof cells);
  erased = true;
  return cells[static_cast<unsigned int>(address) % EEPROM_SIZE];
}
}  // namespace

uint8_t eeprom_read(int address) {
  pass(cost::EEPROM_READ);
  return cell(address);
}
void eeprom_write(int address, uint8_t value) {
  pass(cost::EEPROM_WRITE);
  cell(address) = value;
}
unsigned int EEPROMClass::length() const { return EEPROM_SIZE; }
#endif
