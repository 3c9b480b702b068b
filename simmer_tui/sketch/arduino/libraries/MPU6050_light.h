// An MPU-6050 on Wire whose angles are summed up by the sketch. It has the class's name of MPU6050.h: a sketch takes one.
#pragma once
#include "Wire.h"

class MPU6050Light {
 public:
  explicit MPU6050Light(TwoWire&) {}
  bool upsideDownMounting = false;

  // Ranges: 250, 500, 1000, 2000 deg/s, and 2, 4, 8, 16 g. Returns 0, or 2 if nobody answers.
  uint8_t begin(int gyro_range = 1, int accel_range = 0);
  uint8_t setGyroConfig(int range);
  uint8_t setAccConfig(int range);
  void setAddress(uint8_t address) { address_ = address; }
  uint8_t getAddress() const { return address_; }
  uint8_t writeData(uint8_t reg, uint8_t value);
  uint8_t readData(uint8_t reg);

  // At rest: 500 readings, a millisecond apart.
  void calcOffsets(bool of_gyro = true, bool of_accel = true);
  void calcGyroOffsets() { calcOffsets(true, false); }
  void calcAccOffsets() { calcOffsets(false, true); }
  void setGyroOffsets(float x, float y, float z) { set(gyro_offset_, x, y, z); }
  void setAccOffsets(float x, float y, float z) { set(accel_offset_, x, y, z); }
  float getGyroXoffset() const { return gyro_offset_[0]; }
  float getGyroYoffset() const { return gyro_offset_[1]; }
  float getGyroZoffset() const { return gyro_offset_[2]; }
  float getAccXoffset() const { return accel_offset_[0]; }
  float getAccYoffset() const { return accel_offset_[1]; }
  float getAccZoffset() const { return accel_offset_[2]; }
  void setFilterGyroCoef(float share) { gyro_share_ = share >= 0 && share <= 1 ? share : 0.98f; }
  void setFilterAccCoef(float share) { setFilterGyroCoef(1 - share); }
  float getFilterGyroCoef() const { return gyro_share_; }
  float getFilterAccCoef() const { return 1 - gyro_share_; }

  void fetchData();
  void update();  // fetchData, and the angles
  float getTemp() const { return temperature_; }
  float getAccX() const { return accel_[0]; }
  float getAccY() const { return accel_[1]; }
  float getAccZ() const { return accel_[2]; }
  float getGyroX() const { return gyro_[0]; }
  float getGyroY() const { return gyro_[1]; }
  float getGyroZ() const { return gyro_[2]; }
  float getAccAngleX() const;
  float getAccAngleY() const;
  float getAngleX() const { return angle_[0]; }
  float getAngleY() const { return angle_[1]; }
  float getAngleZ() const { return angle_[2]; }

 protected:
  unsigned int before() const { return before_; }
  int16_t raw_[7] = {};  // as the chip has them: acceleration, temperature, rate

 private:
  static void set(float* target, float x, float y, float z);
  uint8_t address_ = 0x68;
  float gyro_unit_ = 65.5f, accel_unit_ = 16384, gyro_share_ = 0.98f, temperature_ = 0;
  float accel_[3] = {}, gyro_[3] = {}, angle_[3] = {}, accel_offset_[3] = {}, gyro_offset_[3] = {};
  unsigned int before_ = 0;  // milliseconds of the last update
};
#define MPU6050 MPU6050Light
