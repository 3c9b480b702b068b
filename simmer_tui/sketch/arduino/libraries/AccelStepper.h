// Steppers that the sketch polls: each call of run() or runSpeed() makes a step if one is due. Speeds are steps a second.
#pragma once
#include <cstdint>

class AccelStepper {
 public:
  enum MotorInterfaceType : int { FUNCTION = 0, DRIVER = 1, FULL2WIRE = 2, FULL4WIRE = 4, HALF4WIRE = 8 };
  // DRIVER: pin1 steps, pin2 is the direction. FULL2WIRE: both ends of two coils, by inverters; at a driver, one step
  // in four.
  AccelStepper(int interface = FULL4WIRE, int pin1 = 2, int pin2 = 3, int pin3 = 4, int pin4 = 5, bool enable = true);
  AccelStepper(void (*forward)(), void (*backward)());
  virtual ~AccelStepper() = default;

  void moveTo(int32_t target);
  void move(int32_t steps) { moveTo(position_ + steps); }
  bool run();
  bool runSpeed();
  void runToPosition();
  bool runSpeedToPosition();
  void runToNewPosition(int32_t target);
  void stop();
  bool isRunning() const { return speed_ != 0.0f || target_ != position_; }

  void setMaxSpeed(float speed);
  float maxSpeed() const { return max_speed_; }
  void setAcceleration(float acceleration);
  float acceleration() const { return acceleration_; }
  void setSpeed(float speed);
  float speed() const { return speed_; }
  int32_t distanceToGo() const { return target_ - position_; }
  int32_t targetPosition() const { return target_; }
  int32_t currentPosition() const { return position_; }
  void setCurrentPosition(int32_t position);

  virtual void enableOutputs();
  virtual void disableOutputs();
  void setMinPulseWidth(unsigned int microseconds) { pulse_ = microseconds; }
  void setEnablePin(int pin = NO_PIN);
  void setPinsInverted(bool direction = false, bool step = false, bool enable = false);
  void setPinsInverted(bool pin1, bool pin2, bool pin3, bool pin4, bool enable);

 protected:
  virtual void step(int32_t position);

 private:
  static constexpr int NO_PIN = 0xFF;
  void plan();             // the time of the next step, by the acceleration
  int32_t steps_to_stop() const;
  void put(unsigned int levels);
  int pin_count() const { return interface_ == FUNCTION ? 0 : interface_ == DRIVER || interface_ == FULL2WIRE ? 2 : 4; }

  int interface_, pins_[4] = {}, enable_pin_ = NO_PIN;
  bool inverted_[4] = {}, enable_inverted_ = false, forward_ = false;
  void (*step_forward_)() = nullptr;
  void (*step_backward_)() = nullptr;
  int32_t position_ = 0, target_ = 0;
  float speed_ = 0, max_speed_ = 1, acceleration_ = 0;
  unsigned int interval_ = 0, last_ = 0, pulse_ = 1;  // microseconds
  // Microseconds between two steps: the first one from rest, the present one, and the shortest.
  float first_interval_ = 0, present_interval_ = 0, least_interval_ = 1e6f;
  int32_t ramp_ = 0;  // steps since rest; negative while it slows down, then those until rest
};
