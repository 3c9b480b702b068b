// Displays of text on six or ten pins, of which 4 or 8 carry data.
#pragma once
#include "../board/display.h"

class LiquidCrystal : public board::Display {
 public:
  LiquidCrystal(int rs, int enable, int d4, int d5, int d6, int d7);
  LiquidCrystal(int rs, int rw, int enable, int d4, int d5, int d6, int d7);
  LiquidCrystal(int rs, int enable, int d0, int d1, int d2, int d3, int d4, int d5, int d6, int d7);
  LiquidCrystal(int rs, int rw, int enable, int d0, int d1, int d2, int d3, int d4, int d5, int d6, int d7);
  void begin(int columns, int rows, int font = 0);

 protected:
  void transfer(bool is_text, uint8_t value) override;

 private:
  void put(unsigned int bits);
  int rs_, rw_, enable_, count_;
  int data_[8];
};
