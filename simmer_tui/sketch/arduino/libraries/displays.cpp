// LiquidCrystal and LiquidCrystal_I2C.
#include "../core/Arduino.h"
#include "LiquidCrystal.h"
#include "LiquidCrystal_I2C.h"
#include "../board/i2c.h"
#include "Wire.h"

// Waits at the start that the controller's data sheet asks for, microseconds.
static constexpr unsigned int POWER_UP = 50000, FIRST_MODES = 4500, LAST_MODE = 150;

// -- on pins -----------------------------------------------------------------------------------------

LiquidCrystal::LiquidCrystal(int rs, int enable, int d4, int d5, int d6, int d7)
    : LiquidCrystal(rs, -1, enable, d4, d5, d6, d7) {}
LiquidCrystal::LiquidCrystal(int rs, int rw, int enable, int d4, int d5, int d6, int d7)
    : rs_(rs), rw_(rw), enable_(enable), count_(4), data_{d4, d5, d6, d7} {}
LiquidCrystal::LiquidCrystal(int rs, int enable, int d0, int d1, int d2, int d3, int d4, int d5, int d6, int d7)
    : LiquidCrystal(rs, -1, enable, d0, d1, d2, d3, d4, d5, d6, d7) {}
LiquidCrystal::LiquidCrystal(int rs, int rw, int enable, int d0, int d1, int d2, int d3, int d4, int d5, int d6, int d7)
    : rs_(rs), rw_(rw), enable_(enable), count_(8), data_{d0, d1, d2, d3, d4, d5, d6, d7} {}

void LiquidCrystal::begin(int columns, int rows, int) {
  set_size(columns, rows);
  pinMode(rs_, OUTPUT);
  if (rw_ >= 0) pinMode(rw_, OUTPUT);
  pinMode(enable_, OUTPUT);
  for (int at = 0; at < count_; ++at) pinMode(data_[at], OUTPUT);
  delayMicroseconds(POWER_UP);
  digitalWrite(rs_, LOW);
  digitalWrite(enable_, LOW);
  for (unsigned int wait : {FIRST_MODES, FIRST_MODES, LAST_MODE}) {
    put(count_ == 4 ? 0x3 : 0x38);
    delayMicroseconds(wait);
  }
  if (count_ == 4) put(0x2);
  transfer(false, 0x28);
  display();
  clear();
  leftToRight();
}

void LiquidCrystal::put(unsigned int bits) {
  for (int at = 0; at < count_; ++at) digitalWrite(data_[at], bits >> at & 1);
  digitalWrite(enable_, LOW);
  delayMicroseconds(1);
  digitalWrite(enable_, HIGH);
  delayMicroseconds(1);
  digitalWrite(enable_, LOW);
  delayMicroseconds(100);  // a command takes more than 37
}

void LiquidCrystal::transfer(bool is_text, uint8_t value) {
  digitalWrite(rs_, is_text);
  if (rw_ >= 0) digitalWrite(rw_, LOW);
  if (count_ == 4) put(value >> 4);
  put(value);
}

// -- on I2C ------------------------------------------------------------------------------------------

LiquidCrystal_I2C::LiquidCrystal_I2C(int, int columns, int rows, int) : columns_(columns), rows_(rows) {}
// Without a size it is that of `begin`, or the most frequent one.
LiquidCrystal_I2C::LiquidCrystal_I2C(int address, int, int, int, int, int, int, int)
    : LiquidCrystal_I2C(address, 16, 2) {}
LiquidCrystal_I2C::LiquidCrystal_I2C(int address, int, int, int, int, int, int, int, int, t_backlighPol)
    : LiquidCrystal_I2C(address, 16, 2) {}
LiquidCrystal_I2C::LiquidCrystal_I2C(int address, int, t_backlighPol) : LiquidCrystal_I2C(address, 16, 2) {}

void LiquidCrystal_I2C::init() { begin(columns_, rows_); }

void LiquidCrystal_I2C::begin(int columns, int rows, int) {
  Wire.begin();
  set_size(columns ? columns : columns_, rows ? rows : rows_);
  delayMicroseconds(POWER_UP);
  board::pass(board::cost::DISPLAY_TRANSFER);
  delay(1000);
  for (unsigned int wait : {FIRST_MODES, FIRST_MODES, LAST_MODE}) {
    put();
    delayMicroseconds(wait);
  }
  put();
  transfer(false, 0x28);
  display();
  clear();
  leftToRight();
  home();
}

void LiquidCrystal_I2C::put() {
  board::i2c_pass(0);  // as every use of Wire: in an interrupt it waits without end
  // The bits, then with the enable bit, and without it.
  board::pass(3 * board::cost::DISPLAY_TRANSFER);
  delayMicroseconds(51);
}

void LiquidCrystal_I2C::transfer(bool, uint8_t) {
  put();
  put();
}

// The light makes no difference to what is seen here.
void LiquidCrystal_I2C::backlight() {
  board::i2c_pass(0);
  board::pass(board::cost::DISPLAY_TRANSFER);
}
void LiquidCrystal_I2C::noBacklight() { backlight(); }
void LiquidCrystal_I2C::on() {
  display();
  backlight();
}
void LiquidCrystal_I2C::off() {
  noBacklight();
  noDisplay();
}
