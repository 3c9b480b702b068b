#include "Adafruit_MPU6050.h"

uint8_t Adafruit_MPU6050::bits(uint8_t reg, int shift, int count) {
  Wire.beginTransmission(address_);
  Wire.write(reg);
  if (Wire.endTransmission(false) || Wire.requestFrom(address_, 1) != 1) return 0;
  return static_cast<uint8_t>(Wire.read() >> shift & ((1 << count) - 1));
}
bool Adafruit_MPU6050::set_bits(uint8_t reg, int shift, int count, int value) {
  const int mask = ((1 << count) - 1) << shift;
  const int others = count == 8 ? 0 : bits(reg, 0, 8) & ~mask;
  Wire.beginTransmission(address_);
  Wire.write(reg);
  Wire.write(static_cast<uint8_t>(others | (value << shift & mask)));
  return Wire.endTransmission() == 0;
}

bool Adafruit_MPU6050::begin(uint8_t address, TwoWire*, int32_t id) {
  address_ = address;
  id_ = id;
  Wire.begin();
  if (bits(0x75, 0, 8) != MPU6050_DEVICE_ID) return false;
  reset();
  setSampleRateDivisor(0);
  setFilterBandwidth(MPU6050_BAND_260_HZ);
  setGyroRange(MPU6050_RANGE_500_DEG);
  setAccelerometerRange(MPU6050_RANGE_2_G);
  setClock(MPU6050_PLL_GYROX);
  enableSleep(false);
  delay(100);
  return true;
}
void Adafruit_MPU6050::reset() {
  set_bits(0x6B, 7, 1, 1);
  while (bits(0x6B, 7, 1)) delay(1);
  delay(100);
  set_bits(0x68, 0, 8, 7);
  delay(100);
}

void Adafruit_MPU6050::setGyroRange(mpu6050_gyro_range_t range) {
  set_bits(0x1B, 3, 2, range);
  gyro_unit_ = 131.0f / static_cast<float>(1 << range);
}
void Adafruit_MPU6050::setAccelerometerRange(mpu6050_accel_range_t range) {
  set_bits(0x1C, 3, 2, range);
  accel_unit_ = static_cast<float>(16384 >> range);
}

bool Adafruit_MPU6050::getEvent(sensors_event_t* acceleration, sensors_event_t* gyro, sensors_event_t* temperature) {
  Wire.beginTransmission(address_);
  Wire.write(0x3B);
  Wire.endTransmission(false);
  Wire.requestFrom(address_, 14);
  float values[7];
  for (float& each : values) {
    const int high = Wire.read();
    each = static_cast<int16_t>(high << 8 | (Wire.read() & 0xFF));
  }
  const int32_t time = static_cast<int32_t>(millis());
  if (acceleration) {
    *acceleration = {id_, SENSOR_TYPE_ACCELEROMETER, time, {}};
    for (int axis = 0; axis < 3; ++axis)
      acceleration->acceleration.v[axis] = values[axis] / accel_unit_ * SENSORS_GRAVITY_STANDARD;
  }
  if (gyro) {
    *gyro = {id_ + 1, SENSOR_TYPE_GYROSCOPE, time, {}};
    for (int axis = 0; axis < 3; ++axis) gyro->gyro.v[axis] = values[4 + axis] / gyro_unit_ * SENSORS_DPS_TO_RADS;
  }
  if (temperature) {
    *temperature = {id_ + 2, SENSOR_TYPE_AMBIENT_TEMPERATURE, time, {}};
    temperature->temperature = values[3] / 340 + 36.53f;
  }
  return true;
}

bool Adafruit_MPU6050::Part::getEvent(sensors_event_t* event) {
  return chip_->getEvent(type_ == SENSOR_TYPE_ACCELEROMETER ? event : nullptr,
                         type_ == SENSOR_TYPE_GYROSCOPE ? event : nullptr,
                         type_ == SENSOR_TYPE_AMBIENT_TEMPERATURE ? event : nullptr);
}
void Adafruit_MPU6050::Part::getSensor(sensor_t* sensor) {
  *sensor = {};
  std::strncpy(sensor->name, "MPU6050", sizeof sensor->name - 1);
  sensor->type = type_;
  const bool is_gyro = type_ == SENSOR_TYPE_GYROSCOPE, is_temperature = type_ == SENSOR_TYPE_AMBIENT_TEMPERATURE;
  sensor->sensor_id = chip_->id_ + (is_gyro ? 1 : is_temperature ? 2 : 0);
  // 500 deg/s, 2 g, and what the chip bears.
  sensor->max_value = is_gyro ? 500 * SENSORS_DPS_TO_RADS : is_temperature ? 85 : 2 * SENSORS_GRAVITY_STANDARD;
  sensor->min_value = is_temperature ? -40 : -sensor->max_value;
}
