// The former name of MPU6050_6Axis_MotionApps612.h.
#pragma once
#include "MPU6050_6Axis_MotionApps612.h"
