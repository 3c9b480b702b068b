// An MPU-6050 on Wire whose angles are summed up by the sketch, as MPU6050_light does. It has the class's name of MPU6050.h
// too: a sketch takes one.
#pragma once
#include "MPU6050_light.h"
#undef MPU6050

#define MPU6050_ADDR 0x68

class MPU6050Tockn : public MPU6050Light {
 public:
  explicit MPU6050Tockn(TwoWire& wire, float accel_share = 0.02f, float gyro_share = 0.98f) : MPU6050Light(wire) {
    setFilterGyroCoef(gyro_share / (accel_share + gyro_share));
  }
  void begin();
  // At rest: 3000 readings, with a wait before and after them, milliseconds.
  void calcGyroOffsets(bool tells = false, uint16_t before = 1000, uint16_t after = 3000);
  void update();
  void writeMPU6050(uint8_t reg, uint8_t value) { writeData(reg, value); }
  uint8_t readMPU6050(uint8_t reg) { return readData(reg); }

  int16_t getRawAccX() const { return raw_[0]; }
  int16_t getRawAccY() const { return raw_[1]; }
  int16_t getRawAccZ() const { return raw_[2]; }
  int16_t getRawTemp() const { return raw_[3]; }
  int16_t getRawGyroX() const { return raw_[4]; }
  int16_t getRawGyroY() const { return raw_[5]; }
  int16_t getRawGyroZ() const { return raw_[6]; }
  float getGyroAngleX() const { return turned_[0]; }
  float getGyroAngleY() const { return turned_[1]; }
  float getGyroAngleZ() const { return turned_[2]; }

 private:
  float turned_[3] = {};  // by the gyro alone
};
#define MPU6050 MPU6050Tockn
