// The motion processor's program of version 6.12: its packets have 28 bytes.
#pragma once
#include "MPU6050.h"

#define MPU6050_INCLUDE_DMP_MOTIONAPPS612

class MPU6050_6Axis_MotionApps612 : public MPU6050 {
 public:
  explicit MPU6050_6Axis_MotionApps612(uint8_t address = MPU6050_DEFAULT_ADDRESS, void* = nullptr) : MPU6050(address) {
    packet_size_ = 28;
  }
};
#define MPU6050 MPU6050_6Axis_MotionApps612
