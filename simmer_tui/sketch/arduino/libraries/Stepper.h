// Steppers with four wires: their coils are switched in turn while the sketch waits.
#pragma once

class Stepper {
 public:
  Stepper(int steps_per_turn, int pin1, int pin2, int pin3, int pin4);
  void setSpeed(int turns_per_minute);
  void step(int steps);  // negative ones go back
  int version() const { return 5; }

 private:
  int steps_per_turn_, place_ = 0;
  int pins_[4];
  unsigned int interval_ = 0;  // microseconds between two steps
  unsigned int last_ = 0;
};
