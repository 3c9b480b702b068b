// A VL53L0X time-of-flight ranger on Wire, as Adafruit's library has it.
#pragma once
#include "VL53L0X.h"

#define VL53L0X_I2C_ADDR 0x29

typedef int8_t VL53L0X_Error;
#define VL53L0X_ERROR_NONE ((VL53L0X_Error)0)
#define VL53L0X_ERROR_TIME_OUT ((VL53L0X_Error)-7)
#define VL53L0X_ERROR_CONTROL_INTERFACE ((VL53L0X_Error)-20)

struct VL53L0X_RangingMeasurementData_t {
  uint32_t TimeStamp = 0, MeasurementTimeUsec = 0;
  uint16_t RangeMilliMeter = 0, RangeDMaxMilliMeter = 0;
  uint32_t SignalRateRtnMegaCps = 0, AmbientRateRtnMegaCps = 0;
  uint16_t EffectiveSpadRtnCount = 0;
  uint8_t ZoneId = 0, RangeFractionalPart = 0;
  uint8_t RangeStatus = 255;  // 0: valid; 4: nothing in range
};

class Adafruit_VL53L0X {
 public:
  enum VL53L0X_Sense_config_t {
    VL53L0X_SENSE_DEFAULT, VL53L0X_SENSE_LONG_RANGE, VL53L0X_SENSE_HIGH_SPEED, VL53L0X_SENSE_HIGH_ACCURACY
  };
  VL53L0X_Error Status = VL53L0X_ERROR_NONE;

  bool begin(uint8_t address = VL53L0X_I2C_ADDR, bool debug = false, TwoWire* bus = &Wire,
             VL53L0X_Sense_config_t config = VL53L0X_SENSE_DEFAULT);
  bool setAddress(uint8_t address);
  bool configSensor(VL53L0X_Sense_config_t config);

  VL53L0X_Error rangingTest(VL53L0X_RangingMeasurementData_t* measure, bool debug = false) {
    return getSingleRangingMeasurement(measure, debug);
  }
  VL53L0X_Error getSingleRangingMeasurement(VL53L0X_RangingMeasurementData_t* measure, bool debug = false);
  VL53L0X_Error getRangingMeasurement(VL53L0X_RangingMeasurementData_t* measure, bool debug = false);
  void printRangeStatus(VL53L0X_RangingMeasurementData_t* measure);

  uint16_t readRange();
  uint8_t readRangeStatus() const { return range_status_; }
  bool startRange();
  bool isRangeComplete();
  bool waitRangeComplete();
  uint16_t readRangeResult();
  bool startRangeContinuous(uint16_t period_ms = 50);
  void stopRangeContinuous();
  bool timeoutOccurred() { return sensor_.timeoutOccurred(); }
  bool setMeasurementTimingBudgetMicroSeconds(uint32_t budget);
  uint32_t getMeasurementTimingBudgetMicroSeconds();

 private:
  VL53L0X sensor_;
  uint8_t range_status_ = 255;
};
