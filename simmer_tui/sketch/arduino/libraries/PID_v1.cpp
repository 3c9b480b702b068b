#include "PID_v1.h"

#include "../core/Arduino.h"

PID::PID(float* input, float* output, float* setpoint, float p, float i, float d, int proportional_on, int direction)
    : input_(input), output_(output), setpoint_(setpoint), direction_(direction) {
  SetTunings(p, i, d, proportional_on);
  last_ = millis() - sample_;
}

float PID::limited(float value) const { return value > most_ ? most_ : value < least_ ? least_ : value; }

bool PID::Compute() {
  if (!is_on_) return false;
  const unsigned int present = millis();
  if (present - last_ < sample_) return false;
  board::pass(board::cost::PID_COMPUTE);
  const float input = *input_, error = *setpoint_ - input, change = input - last_input_;
  sum_ += i_ * error;
  if (!on_error_) sum_ -= p_ * change;
  sum_ = limited(sum_);
  *output_ = limited((on_error_ ? p_ * error : 0.0f) + sum_ - d_ * change);
  last_input_ = input;
  last_ = present;
  return true;
}

void PID::SetMode(int mode) {
  const bool on = mode == AUTOMATIC;
  if (on && !is_on_) {
    // It goes on from the output that the sketch has set.
    sum_ = limited(*output_);
    last_input_ = *input_;
  }
  is_on_ = on;
}

void PID::SetOutputLimits(float least, float most) {
  if (least >= most) return;
  least_ = least;
  most_ = most;
  if (!is_on_) return;
  *output_ = limited(*output_);
  sum_ = limited(sum_);
}

void PID::SetTunings(float p, float i, float d, int proportional_on) {
  if (p < 0 || i < 0 || d < 0) return;
  on_error_ = proportional_on == P_ON_E;
  given_p_ = p;
  given_i_ = i;
  given_d_ = d;
  const float seconds = static_cast<float>(sample_) / 1000.0f, sign = direction_ == REVERSE ? -1.0f : 1.0f;
  p_ = sign * p;
  i_ = sign * i * seconds;
  d_ = sign * d / seconds;
}

void PID::SetControllerDirection(int direction) {
  direction_ = direction;
  SetTunings(given_p_, given_i_, given_d_);
}

void PID::SetSampleTime(int milliseconds) {
  if (milliseconds <= 0) return;
  sample_ = static_cast<unsigned int>(milliseconds);
  SetTunings(given_p_, given_i_, given_d_);
}
