#include "MPU6050_light.h"

namespace {
constexpr int CALIBRATION = 500;
}

uint8_t MPU6050Light::writeData(uint8_t reg, uint8_t value) {
  Wire.beginTransmission(address_);
  Wire.write(reg);
  Wire.write(value);
  return Wire.endTransmission();
}
uint8_t MPU6050Light::readData(uint8_t reg) {
  Wire.beginTransmission(address_);
  Wire.write(reg);
  Wire.endTransmission();
  Wire.requestFrom(address_, 1);
  return static_cast<uint8_t>(Wire.read());
}

uint8_t MPU6050Light::begin(int gyro_range, int accel_range) {
  const uint8_t status = writeData(0x6B, 1);
  writeData(0x19, 0);
  writeData(0x1A, 0);
  setGyroConfig(gyro_range);
  setAccConfig(accel_range);
  update();
  set(angle_, getAccAngleX(), getAccAngleY(), 0);
  before_ = millis();
  return status;
}
uint8_t MPU6050Light::setGyroConfig(int range) {
  if (range < 0 || range > 3) return 1;
  gyro_unit_ = 131.0f / static_cast<float>(1 << range);
  return writeData(0x1B, static_cast<uint8_t>(range << 3));
}
uint8_t MPU6050Light::setAccConfig(int range) {
  if (range < 0 || range > 3) return 1;
  accel_unit_ = static_cast<float>(16384 >> range);
  return writeData(0x1C, static_cast<uint8_t>(range << 3));
}

void MPU6050Light::set(float* target, float x, float y, float z) {
  target[0] = x;
  target[1] = y;
  target[2] = z;
}

void MPU6050Light::calcOffsets(bool of_gyro, bool of_accel) {
  if (of_gyro) set(gyro_offset_, 0, 0, 0);
  if (of_accel) set(accel_offset_, 0, 0, 0);
  float gyro[3] = {}, accel[3] = {};
  for (int round = 0; round < CALIBRATION; ++round) {
    fetchData();
    for (int axis = 0; axis < 3; ++axis) {
      gyro[axis] += gyro_[axis] / CALIBRATION;
      accel[axis] += accel_[axis] / CALIBRATION;
    }
    accel[2] -= 1.0f / CALIBRATION;
    delay(1);
  }
  if (of_gyro) set(gyro_offset_, gyro[0], gyro[1], gyro[2]);
  if (of_accel) set(accel_offset_, accel[0], accel[1], accel[2]);
}

void MPU6050Light::fetchData() {
  Wire.beginTransmission(address_);
  Wire.write(0x3B);
  Wire.endTransmission(false);
  Wire.requestFrom(address_, 14);
  for (int16_t& each : raw_) {
    const int high = Wire.read();
    each = static_cast<int16_t>(high << 8 | (Wire.read() & 0xFF));
  }
  const float up = upsideDownMounting ? -1 : 1;
  set(accel_, raw_[0] / accel_unit_ - accel_offset_[0], raw_[1] / accel_unit_ - accel_offset_[1],
      up * raw_[2] / accel_unit_ - accel_offset_[2]);
  temperature_ = static_cast<float>(raw_[3]) / 340 + 36.53f;
  set(gyro_, raw_[4] / gyro_unit_ - gyro_offset_[0], raw_[5] / gyro_unit_ - gyro_offset_[1],
      raw_[6] / gyro_unit_ - gyro_offset_[2]);
}

float MPU6050Light::getAccAngleX() const {
  return static_cast<float>(RAD_TO_DEG) * std::atan2(accel_[1], std::hypot(accel_[0], accel_[2]));
}
float MPU6050Light::getAccAngleY() const {
  return static_cast<float>(-RAD_TO_DEG) * std::atan2(accel_[0], std::hypot(accel_[1], accel_[2]));
}

void MPU6050Light::update() {
  fetchData();
  const unsigned int now_ms = millis();
  const float seconds = static_cast<float>(now_ms - before_) / 1000;
  before_ = now_ms;
  // Tilts lean on the acceleration, yaw has the gyro alone.
  angle_[0] = gyro_share_ * (angle_[0] + gyro_[0] * seconds) + (1 - gyro_share_) * getAccAngleX();
  angle_[1] = gyro_share_ * (angle_[1] + gyro_[1] * seconds) + (1 - gyro_share_) * getAccAngleY();
  angle_[2] += gyro_[2] * seconds;
}
