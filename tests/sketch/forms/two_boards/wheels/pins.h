#pragma once
#define ENCODER 2
const int MOTOR_PINS[6] = {5, 6, 7, 11, 12, 13};  // en, in1, in2 of each
