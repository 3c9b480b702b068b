#include "MPU6050_tockn.h"

namespace {
constexpr int GYRO_CALIBRATION = 3000;
}

void MPU6050Tockn::begin() {
  MPU6050Light::begin();
  for (float& each : turned_) each = 0;
}

void MPU6050Tockn::calcGyroOffsets(bool tells, uint16_t before, uint16_t after) {
  delay(before);
  if (tells) Serial.print(F("\nMeasuring the gyro: the robot must not move"));
  setGyroOffsets(0, 0, 0);
  float sum[3] = {};
  for (int round = 0; round < GYRO_CALIBRATION; ++round) {
    if (tells && round % 1000 == 0) Serial.print('.');
    fetchData();
    sum[0] += getGyroX() / GYRO_CALIBRATION;
    sum[1] += getGyroY() / GYRO_CALIBRATION;
    sum[2] += getGyroZ() / GYRO_CALIBRATION;
  }
  setGyroOffsets(sum[0], sum[1], sum[2]);
  if (tells) {
    Serial.println(F(" done"));
    for (const float each : sum) Serial.println(each);
  }
  delay(after);
}

void MPU6050Tockn::update() {
  const unsigned int begun = before();
  MPU6050Light::update();
  const float seconds = static_cast<float>(before() - begun) / 1000;
  turned_[0] += getGyroX() * seconds;
  turned_[1] += getGyroY() * seconds;
  turned_[2] += getGyroZ() * seconds;
}
