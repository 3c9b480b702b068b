// Displays of text behind a port expander (PCF8574) on I2C at 100 kHz.
#pragma once
#include "../board/display.h"

// Of another library with this class, which has the expander's pins.
enum t_backlighPol { POSITIVE, NEGATIVE };

class LiquidCrystal_I2C : public board::Display {
 public:
  LiquidCrystal_I2C(int address, int columns, int rows, int font = 0);
  LiquidCrystal_I2C(int address, int enable, int rw, int rs, int d4, int d5, int d6, int d7);
  LiquidCrystal_I2C(int address, int enable, int rw, int rs, int d4, int d5, int d6, int d7, int light, t_backlighPol);
  LiquidCrystal_I2C(int address, int light, t_backlighPol);
  void init();
  void begin(int columns = 0, int rows = 0, int font = 0);
  void backlight();
  void noBacklight();
  void setBacklight(int on) { on ? backlight() : noBacklight(); }
  void setBacklightPin(int, t_backlighPol) {}
  void on();
  void off();

 protected:
  void transfer(bool is_text, uint8_t value) override;

 private:
  void put();
  int columns_, rows_;
};
