// A display of text: the memory of its controller (Hitachi HD44780), told to the simulator as it changes.
#pragma once
#include <cstdint>

#include "../core/Print.h"

#define LCD_5x8DOTS 0
#define LCD_5x10DOTS 4

namespace board {

// What is told: an operation in the upper byte, its numbers in the others.
enum class DisplayChange : uint8_t { Cell = 0, Size = 1, Clear = 2, Shift = 3, On = 4 };

class Display : public Print {
 public:
  Display();
  using Print::write;
  size_t write(uint8_t value) override;

  void clear();
  void home();
  void setCursor(int column, int row);
  void scrollDisplayLeft();
  void scrollDisplayRight();
  void leftToRight();
  void rightToLeft();
  void autoscroll();
  void noAutoscroll();
  void display();
  void noDisplay();
  void cursor() { command(); }
  void noCursor() { command(); }
  void blink() { command(); }
  void noBlink() { command(); }
  // What is written next goes to the glyphs, until the cursor is set: as in the controller.
  void createChar(int number, const uint8_t* rows);

 protected:
  void set_size(int columns, int rows);
  virtual void transfer(bool is_text, uint8_t value) = 0;  // a byte on its way, with its time

 private:
  static constexpr int COLUMNS = 40;  // of a line of its memory; 16 or 20 of them are seen
  void command(uint8_t value = 0) { transfer(false, value); }
  void tell_change(DisplayChange change, int value) const;
  void shift(int by);

  int number_, columns_ = 16, rows_ = 1;
  int line_ = 0, column_ = 0, shift_ = 0, step_ = 1;
  bool scrolls_ = false, in_glyphs_ = false;
};

}  // namespace board
