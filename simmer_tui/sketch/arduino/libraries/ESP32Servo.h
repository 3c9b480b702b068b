// Servos of an ESP32: those of Servo.h, with names of its timers.
#pragma once
#include "Servo.h"

class ESP32PWM {
 public:
  static void allocateTimer(int) {}
};
