// Up to ten AccelSteppers that reach their targets together, at constant speeds.
#pragma once
#include "AccelStepper.h"

class MultiStepper {
 public:
  bool addStepper(AccelStepper& stepper);
  void moveTo(int32_t targets[]);
  bool run();
  void runSpeedToPosition();

 private:
  static constexpr int MOST = 10;
  AccelStepper* steppers_[MOST];
  int count_ = 0;
};
