// AccelStepper, MultiStepper and Stepper.
#include "../core/Arduino.h"
#include "AccelStepper.h"
#include "MultiStepper.h"
#include "Stepper.h"

using namespace board;

// Levels of two and of four pins, the first in bit 0, in the order of the steps.
static constexpr unsigned int TWO_WIRE_STEPS[] = {0b10, 0b11, 0b01, 0b00};
static constexpr unsigned int FULL_STEPS[] = {0b0101, 0b0110, 0b1010, 0b1001};
static constexpr unsigned int HALF_STEPS[] = {0b0001, 0b0101, 0b0100, 0b0110, 0b0010, 0b1010, 0b1000, 0b1001};

// -- AccelStepper ------------------------------------------------------------------------------------

AccelStepper::AccelStepper(int interface, int pin1, int pin2, int pin3, int pin4, bool enable)
    : interface_(interface), pins_{pin1, pin2, pin3, pin4} {
  if (enable) enableOutputs();
  setAcceleration(1);
}
AccelStepper::AccelStepper(void (*forward)(), void (*backward)())
    : interface_(FUNCTION), step_forward_(forward), step_backward_(backward) {
  setAcceleration(1);
}

void AccelStepper::moveTo(int32_t target) {
  if (target_ == target) return;
  target_ = target;
  plan();
}

bool AccelStepper::runSpeed() {
  pass(cost::STEPPER_LOOK);
  if (!interval_) return false;
  const unsigned int present = micros();
  if (present - last_ < interval_) return false;
  position_ += forward_ ? 1 : -1;
  step(position_);
  last_ = present;
  return true;
}

bool AccelStepper::run() {
  if (runSpeed()) plan();
  return isRunning();
}

void AccelStepper::runToPosition() {
  const WaitScope scope(Waits::InSteps, CALLED_AT);
  while (run()) yield();
}

bool AccelStepper::runSpeedToPosition() {
  if (target_ == position_) return false;
  forward_ = target_ > position_;
  return runSpeed();
}

void AccelStepper::runToNewPosition(int32_t target) {
  const WaitScope scope(Waits::InSteps, CALLED_AT);
  moveTo(target);
  runToPosition();
}

int32_t AccelStepper::steps_to_stop() const { return static_cast<int32_t>(speed_ * speed_ / (2.0f * acceleration_)); }

void AccelStepper::stop() {
  if (speed_ == 0.0f) return;
  const int32_t steps = steps_to_stop() + 1;
  move(speed_ > 0.0f ? steps : -steps);
}

void AccelStepper::setMaxSpeed(float speed) {
  speed = std::fabs(speed);
  if (max_speed_ == speed) return;
  max_speed_ = speed;
  least_interval_ = 1e6f / speed;
  if (ramp_ > 0) {
    ramp_ = steps_to_stop();
    plan();
  }
}

void AccelStepper::setAcceleration(float acceleration) {
  acceleration = std::fabs(acceleration);
  if (acceleration == 0.0f || acceleration_ == acceleration) return;
  if (acceleration_ > 0.0f) ramp_ = static_cast<int32_t>(static_cast<float>(ramp_) * (acceleration_ / acceleration));
  // The first interval by Austin's approximation of a linear ramp, with his correction of 0.676.
  first_interval_ = 0.676f * std::sqrt(2.0f / acceleration) * 1e6f;
  acceleration_ = acceleration;
  plan();
}

void AccelStepper::setSpeed(float speed) {
  speed = speed > max_speed_ ? max_speed_ : speed < -max_speed_ ? -max_speed_ : speed;
  if (speed == speed_) return;
  interval_ = speed == 0.0f ? 0 : static_cast<unsigned int>(std::fabs(1e6f / speed));
  if (speed != 0.0f) forward_ = speed > 0.0f;
  speed_ = speed;
}

void AccelStepper::setCurrentPosition(int32_t position) {
  target_ = position_ = position;
  ramp_ = 0;
  interval_ = 0;
  speed_ = 0;
}

void AccelStepper::plan() {
  pass(cost::STEPPER_PLAN);
  const int32_t distance = distanceToGo(), stopping = steps_to_stop();
  if (distance == 0 && stopping <= 1) {
    interval_ = 0;
    speed_ = 0;
    ramp_ = 0;
    return;
  }
  const bool ahead = distance > 0;
  const int32_t far = ahead ? distance : -distance;
  if (distance != 0) {
    // It slows down if it must stop by now, or turns the wrong way; and speeds up again if it need not.
    if (ramp_ > 0 && (stopping >= far || forward_ != ahead))
      ramp_ = -stopping;
    else if (ramp_ < 0 && stopping < far && forward_ == ahead)
      ramp_ = -ramp_;
  }
  if (ramp_ == 0) {
    present_interval_ = first_interval_;
    forward_ = ahead;
  } else {
    present_interval_ -= 2.0f * present_interval_ / (4.0f * static_cast<float>(ramp_) + 1.0f);
    if (present_interval_ < least_interval_) present_interval_ = least_interval_;
  }
  ++ramp_;
  interval_ = static_cast<unsigned int>(present_interval_);
  speed_ = (forward_ ? 1e6f : -1e6f) / present_interval_;
}

void AccelStepper::put(unsigned int levels) {
  for (int at = 0; at < pin_count(); ++at) digitalWrite(pins_[at], (levels >> at & 1) != inverted_[at]);
}

void AccelStepper::step(int32_t position) {
  if (interface_ == FUNCTION) {
    if (forward_ ? step_forward_ : step_backward_) forward_ ? step_forward_() : step_backward_();
  } else if (interface_ == DRIVER) {
    const unsigned int direction = forward_ ? 2 : 0;
    put(direction);
    put(direction | 1);
    delayMicroseconds(pulse_);
    put(direction);
  } else if (interface_ == FULL2WIRE) {
    put(TWO_WIRE_STEPS[position & 3]);
  } else {
    put(interface_ == HALF4WIRE ? HALF_STEPS[position & 7] : FULL_STEPS[position & 3]);
  }
}

void AccelStepper::enableOutputs() {
  for (int at = 0; at < pin_count(); ++at) pinMode(pins_[at], OUTPUT);
  if (enable_pin_ == NO_PIN) return;
  pinMode(enable_pin_, OUTPUT);
  digitalWrite(enable_pin_, !enable_inverted_);
}

void AccelStepper::disableOutputs() {
  put(0);
  if (enable_pin_ == NO_PIN) return;
  pinMode(enable_pin_, OUTPUT);
  digitalWrite(enable_pin_, enable_inverted_);
}

void AccelStepper::setEnablePin(int pin) {
  enable_pin_ = pin;
  if (enable_pin_ == NO_PIN) return;
  pinMode(enable_pin_, OUTPUT);
  digitalWrite(enable_pin_, !enable_inverted_);
}

void AccelStepper::setPinsInverted(bool direction, bool step, bool enable) {
  inverted_[0] = step;
  inverted_[1] = direction;
  enable_inverted_ = enable;
}
void AccelStepper::setPinsInverted(bool pin1, bool pin2, bool pin3, bool pin4, bool enable) {
  const bool inverted[] = {pin1, pin2, pin3, pin4};
  for (int at = 0; at < 4; ++at) inverted_[at] = inverted[at];
  enable_inverted_ = enable;
}

// -- MultiStepper ------------------------------------------------------------------------------------

bool MultiStepper::addStepper(AccelStepper& stepper) {
  if (count_ >= MOST) return false;
  steppers_[count_++] = &stepper;
  return true;
}

void MultiStepper::moveTo(int32_t targets[]) {
  float longest = 0;  // seconds of the slowest
  const auto distance = [&](int at) { return static_cast<float>(targets[at] - steppers_[at]->currentPosition()); };
  for (int at = 0; at < count_; ++at) {
    const float seconds = std::fabs(distance(at)) / steppers_[at]->maxSpeed();
    if (seconds > longest) longest = seconds;
  }
  if (longest == 0.0f) return;
  for (int at = 0; at < count_; ++at) {
    const float speed = distance(at) / longest;
    steppers_[at]->moveTo(targets[at]);
    steppers_[at]->setSpeed(speed);
  }
}

bool MultiStepper::run() {
  bool moves = false;
  for (int at = 0; at < count_; ++at)
    if (steppers_[at]->distanceToGo() != 0) {
      steppers_[at]->runSpeed();
      moves = true;
    }
  return moves;
}

void MultiStepper::runSpeedToPosition() {
  const WaitScope scope(Waits::InSteps, CALLED_AT);
  while (run()) yield();
}

// -- Stepper -----------------------------------------------------------------------------------------

Stepper::Stepper(int steps_per_turn, int pin1, int pin2, int pin3, int pin4)
    : steps_per_turn_(steps_per_turn > 0 ? steps_per_turn : 1), pins_{pin1, pin2, pin3, pin4} {
  for (int pin : pins_) pinMode(pin, OUTPUT);
}

void Stepper::setSpeed(int turns_per_minute) {
  if (turns_per_minute > 0) interval_ = 60000000u / static_cast<unsigned int>(steps_per_turn_ * turns_per_minute);
}

void Stepper::step(int steps) {
  const WaitScope scope(Waits::InSteps, CALLED_AT);
  const int by = steps < 0 ? -1 : 1;
  for (int left = steps < 0 ? -steps : steps; left > 0;) {
    const unsigned int present = micros();
    pass(cost::STEPPER_LOOK);
    yield();
    if (present - last_ < interval_) continue;
    last_ = present;
    place_ = (place_ + by + steps_per_turn_) % steps_per_turn_;
    --left;
    for (int at = 0; at < 4; ++at) digitalWrite(pins_[at], FULL_STEPS[place_ & 3] >> at & 1);
  }
}
