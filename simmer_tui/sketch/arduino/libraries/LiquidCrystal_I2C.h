// Displays of text behind a port expander (PCF8574) on I2C at 100 kHz.
#pragma once
#include "../board/display.h"

class LiquidCrystal_I2C : public board::Display {
 public:
  LiquidCrystal_I2C(int address, int columns, int rows);
  void init();
  void begin(int columns = 0, int rows = 0, int font = 0);
  void backlight();
  void noBacklight();
  void setBacklight(int on) { on ? backlight() : noBacklight(); }

 protected:
  void transfer(bool is_text, uint8_t value) override;

 private:
  void put();
  int columns_, rows_;
};
