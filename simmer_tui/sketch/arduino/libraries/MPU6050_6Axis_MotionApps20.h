// MPU6050.h has the motion processor too.
#pragma once
#include "MPU6050.h"

#define MPU6050_INCLUDE_DMP_MOTIONAPPS20
