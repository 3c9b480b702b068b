// An MPU-6050 by events, in units of the SI.
#pragma once
#include "Adafruit_Sensor.h"
#include "Wire.h"

#define MPU6050_I2CADDR_DEFAULT 0x68
#define MPU6050_DEVICE_ID 0x68

typedef enum { MPU6050_RANGE_250_DEG, MPU6050_RANGE_500_DEG, MPU6050_RANGE_1000_DEG, MPU6050_RANGE_2000_DEG } mpu6050_gyro_range_t;
typedef enum { MPU6050_RANGE_2_G, MPU6050_RANGE_4_G, MPU6050_RANGE_8_G, MPU6050_RANGE_16_G } mpu6050_accel_range_t;
typedef enum {
  MPU6050_BAND_260_HZ, MPU6050_BAND_184_HZ, MPU6050_BAND_94_HZ, MPU6050_BAND_44_HZ, MPU6050_BAND_21_HZ,
  MPU6050_BAND_10_HZ, MPU6050_BAND_5_HZ
} mpu6050_bandwidth_t;
typedef enum {
  MPU6050_HIGHPASS_DISABLE, MPU6050_HIGHPASS_5_HZ, MPU6050_HIGHPASS_2_5_HZ, MPU6050_HIGHPASS_1_25_HZ,
  MPU6050_HIGHPASS_0_63_HZ, MPU6050_HIGHPASS_UNUSED, MPU6050_HIGHPASS_HOLD
} mpu6050_highpass_t;
typedef enum { MPU6050_CYCLE_1_25_HZ, MPU6050_CYCLE_5_HZ, MPU6050_CYCLE_20_HZ, MPU6050_CYCLE_40_HZ } mpu6050_cycle_rate_t;
typedef enum {
  MPU6050_INTR_8MHz, MPU6050_PLL_GYROX, MPU6050_PLL_GYROY, MPU6050_PLL_GYROZ, MPU6050_PLL_EXT_32K,
  MPU6050_PLL_EXT_19MHz, MPU6050_STOP = 7
} mpu6050_clock_select_t;

class Adafruit_MPU6050 {
 public:
  // Begins Wire, resets the chip, and takes it to 500 deg/s, 2 g and the widest filter. False if nobody answers.
  bool begin(uint8_t address = MPU6050_I2CADDR_DEFAULT, TwoWire* = &Wire, int32_t id = 0);
  void reset();
  bool getEvent(sensors_event_t* acceleration, sensors_event_t* gyro, sensors_event_t* temperature);
  Adafruit_Sensor* getAccelerometerSensor() { return &acceleration_; }
  Adafruit_Sensor* getGyroSensor() { return &gyro_; }
  Adafruit_Sensor* getTemperatureSensor() { return &temperature_; }

  void setGyroRange(mpu6050_gyro_range_t range);
  mpu6050_gyro_range_t getGyroRange() { return static_cast<mpu6050_gyro_range_t>(bits(0x1B, 3, 2)); }
  void setAccelerometerRange(mpu6050_accel_range_t range);
  mpu6050_accel_range_t getAccelerometerRange() { return static_cast<mpu6050_accel_range_t>(bits(0x1C, 3, 2)); }
  void setFilterBandwidth(mpu6050_bandwidth_t band) { set_bits(0x1A, 0, 3, band); }
  mpu6050_bandwidth_t getFilterBandwidth() { return static_cast<mpu6050_bandwidth_t>(bits(0x1A, 0, 3)); }
  void setHighPassFilter(mpu6050_highpass_t filter) { set_bits(0x1C, 0, 3, filter); }
  mpu6050_highpass_t getHighPassFilter() { return static_cast<mpu6050_highpass_t>(bits(0x1C, 0, 3)); }
  void setSampleRateDivisor(uint8_t divisor) { set_bits(0x19, 0, 8, divisor); }
  uint8_t getSampleRateDivisor() { return bits(0x19, 0, 8); }
  void setClock(mpu6050_clock_select_t clock) { set_bits(0x6B, 0, 3, clock); }
  mpu6050_clock_select_t getClock() { return static_cast<mpu6050_clock_select_t>(bits(0x6B, 0, 3)); }
  bool enableSleep(bool on) { return set_bits(0x6B, 6, 1, on); }
  bool enableCycle(bool on) { return set_bits(0x6B, 5, 1, on); }
  void setCycleRate(mpu6050_cycle_rate_t rate) { set_bits(0x6C, 6, 2, rate); }
  mpu6050_cycle_rate_t getCycleRate() { return static_cast<mpu6050_cycle_rate_t>(bits(0x6C, 6, 2)); }
  // The robot's accelerations are not felt: no motion is ever detected.
  void setMotionInterrupt(bool on) { set_bits(0x38, 6, 1, on); }
  bool getMotionInterruptStatus() { return bits(0x3A, 6, 1); }
  void setMotionDetectionThreshold(uint8_t threshold) { set_bits(0x1F, 0, 8, threshold); }
  void setMotionDetectionDuration(uint8_t duration) { set_bits(0x20, 0, 8, duration); }
  void setInterruptPinPolarity(bool active_low) { set_bits(0x37, 7, 1, active_low); }
  void setInterruptPinLatch(bool held) { set_bits(0x37, 5, 1, held); }

 private:
  class Part : public Adafruit_Sensor {
   public:
    Part(Adafruit_MPU6050* chip, sensors_type_t type) : chip_(chip), type_(type) {}
    bool getEvent(sensors_event_t* event) override;
    void getSensor(sensor_t* sensor) override;

   private:
    Adafruit_MPU6050* chip_;
    sensors_type_t type_;
  };
  uint8_t bits(uint8_t reg, int shift, int count);
  bool set_bits(uint8_t reg, int shift, int count, int value);

  uint8_t address_ = MPU6050_I2CADDR_DEFAULT;
  int32_t id_ = 0;
  float gyro_unit_ = 65.5f, accel_unit_ = 16384;
  Part acceleration_{this, SENSOR_TYPE_ACCELEROMETER}, gyro_{this, SENSOR_TYPE_GYROSCOPE},
      temperature_{this, SENSOR_TYPE_AMBIENT_TEMPERATURE};
};
