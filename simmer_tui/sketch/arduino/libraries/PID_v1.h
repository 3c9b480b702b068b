// A PID controller with a sample time, limits of its output, and the derivative of its input.
#pragma once

#define AUTOMATIC 1
#define MANUAL 0
#define DIRECT 0
#define REVERSE 1
#define P_ON_M 0
#define P_ON_E 1

// A `double` of the sketch is a float, as on the board.
class PID {
 public:
  PID(float* input, float* output, float* setpoint, float p, float i, float d, int proportional_on, int direction);
  PID(float* input, float* output, float* setpoint, float p, float i, float d, int direction)
      : PID(input, output, setpoint, p, i, d, P_ON_E, direction) {}
  bool Compute();
  void SetMode(int mode);
  void SetOutputLimits(float least, float most);
  void SetTunings(float p, float i, float d, int proportional_on);
  void SetTunings(float p, float i, float d) { SetTunings(p, i, d, on_error_ ? P_ON_E : P_ON_M); }
  void SetControllerDirection(int direction);
  void SetSampleTime(int milliseconds);
  float GetKp() const { return given_p_; }
  float GetKi() const { return given_i_; }
  float GetKd() const { return given_d_; }
  int GetMode() const { return is_on_ ? AUTOMATIC : MANUAL; }
  int GetDirection() const { return direction_; }

 private:
  float limited(float value) const;
  float *input_, *output_, *setpoint_;
  float given_p_ = 0, given_i_ = 0, given_d_ = 0;  // as they were given
  float p_ = 0, i_ = 0, d_ = 0;                    // a sample, with the sign of the direction
  float sum_ = 0, last_input_ = 0, least_ = 0, most_ = 255;
  int direction_;
  bool on_error_ = true, is_on_ = false;
  unsigned int sample_ = 100, last_;  // milliseconds
};
