#include "display.h"

#include "../core/Arduino.h"
#include "exchange.h"

namespace board {

namespace {
int display_count = 0;
// Execution times of the controller: clear and home 1.52 ms, for which the libraries wait 2 ms.
constexpr Nanoseconds CLEARING = 2 * MILLISECOND;
}  // namespace

Display::Display() : number_(display_count++) {}

void Display::tell_change(DisplayChange change, int value) const {
  tell(Told::Text, number_ & 7, static_cast<int>(change) << 24 | value);
}

void Display::set_size(int columns, int rows) {
  columns_ = constrain(columns, 1, COLUMNS);
  rows_ = constrain(rows, 1, 4);
  tell_change(DisplayChange::Size, columns_ << 8 | rows_);
}

size_t Display::write(uint8_t value) {
  transfer(true, value);
  if (in_glyphs_) return 1;
  tell_change(DisplayChange::Cell, line_ << 16 | column_ << 8 | value);
  column_ += step_;
  // The end of a line goes on at the beginning of the other one.
  if (column_ < 0 || column_ >= COLUMNS) {
    column_ = column_ < 0 ? COLUMNS - 1 : 0;
    line_ = 1 - line_;
  }
  if (scrolls_) shift(step_);
  return 1;
}

void Display::clear() {
  command(0x01);
  pass_until(now + CLEARING);
  line_ = column_ = shift_ = 0;
  in_glyphs_ = false;
  step_ = 1;
  tell_change(DisplayChange::Clear, 0);
}

void Display::home() {
  command(0x02);
  pass_until(now + CLEARING);
  line_ = column_ = 0;
  in_glyphs_ = false;
  shift(-shift_);
}

void Display::setCursor(int column, int row) {
  command(0x80);
  row = constrain(row, 0, rows_ - 1);
  // The third row continues the first in the memory, the fourth the second.
  line_ = row & 1;
  column_ = ((column + (row > 1 ? columns_ : 0)) % COLUMNS + COLUMNS) % COLUMNS;
  in_glyphs_ = false;
}

void Display::shift(int by) {
  shift_ = (shift_ + by + COLUMNS) % COLUMNS;
  tell_change(DisplayChange::Shift, shift_);
}
void Display::scrollDisplayLeft() {
  command(0x18);
  shift(1);
}
void Display::scrollDisplayRight() {
  command(0x1C);
  shift(-1);
}
void Display::leftToRight() {
  command(0x06);
  step_ = 1;
}
void Display::rightToLeft() {
  command(0x04);
  step_ = -1;
}
void Display::autoscroll() {
  command(0x07);
  scrolls_ = true;
}
void Display::noAutoscroll() {
  command(0x06);
  scrolls_ = false;
}
void Display::display() {
  command(0x0C);
  tell_change(DisplayChange::On, 1);
}
void Display::noDisplay() {
  command(0x08);
  tell_change(DisplayChange::On, 0);
}
void Display::createChar(int number, const uint8_t* rows) {
  command(static_cast<uint8_t>(0x40 | (number & 7) << 3));
  for (int row = 0; row < 8; ++row) transfer(true, rows[row]);
  in_glyphs_ = true;
}

}  // namespace board
