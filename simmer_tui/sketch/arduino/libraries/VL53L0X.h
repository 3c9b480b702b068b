// A VL53L0X time-of-flight ranger on Wire, as Pololu's library has it.
#pragma once
#include "Wire.h"

class VL53L0X {
 public:
  // By the names of the chip's maker.
  enum regAddr : uint8_t {
    SYSRANGE_START = 0x00, SYSTEM_SEQUENCE_CONFIG = 0x01, SYSTEM_INTERMEASUREMENT_PERIOD = 0x04,
    SYSTEM_RANGE_CONFIG = 0x09, SYSTEM_INTERRUPT_CONFIG_GPIO = 0x0A, SYSTEM_INTERRUPT_CLEAR = 0x0B,
    SYSTEM_THRESH_HIGH = 0x0C, SYSTEM_THRESH_LOW = 0x0E, RESULT_INTERRUPT_STATUS = 0x13, RESULT_RANGE_STATUS = 0x14,
    ALGO_PART_TO_PART_RANGE_OFFSET_MM = 0x28, FINAL_RANGE_CONFIG_MIN_COUNT_RATE_RTN_LIMIT = 0x44,
    MSRC_CONFIG_CONTROL = 0x60, GPIO_HV_MUX_ACTIVE_HIGH = 0x84, VHV_CONFIG_PAD_SCL_SDA__EXTSUP_HV = 0x89,
    I2C_SLAVE_DEVICE_ADDRESS = 0x8A, IDENTIFICATION_MODEL_ID = 0xC0, IDENTIFICATION_REVISION_ID = 0xC2
  };
  enum vcselPeriodType { VcselPeriodPreRange, VcselPeriodFinalRange };
  uint8_t last_status = 0;  // of the last transmission

  bool init(bool io_2v8 = true);
  void setAddress(uint8_t address);
  uint8_t getAddress() const { return address_; }
  void setBus(TwoWire*) {}
  TwoWire* getBus() { return &Wire; }

  bool setSignalRateLimit(float limit);
  float getSignalRateLimit();
  bool setMeasurementTimingBudget(uint32_t microseconds);
  uint32_t getMeasurementTimingBudget();
  // Of the laser: kept, they change no reading.
  bool setVcselPulsePeriod(vcselPeriodType type, uint8_t clocks);
  uint8_t getVcselPulsePeriod(vcselPeriodType type) const { return pulse_periods_[type]; }

  void startContinuous(uint32_t period_ms = 0);
  void stopContinuous();
  uint16_t readRangeContinuousMillimeters();
  uint16_t readRangeSingleMillimeters();

  void setTimeout(uint16_t milliseconds) { timeout_ = milliseconds; }
  uint16_t getTimeout() const { return timeout_; }
  bool timeoutOccurred();

  void writeReg(uint8_t reg, uint8_t value);
  void writeReg16Bit(uint8_t reg, uint16_t value);
  void writeReg32Bit(uint8_t reg, uint32_t value);
  uint8_t readReg(uint8_t reg);
  uint16_t readReg16Bit(uint8_t reg);
  uint32_t readReg32Bit(uint8_t reg);
  void writeMulti(uint8_t reg, const uint8_t* source, uint8_t count);
  void readMulti(uint8_t reg, uint8_t* target, uint8_t count);

 private:
  friend class Adafruit_VL53L0X;
  bool is_there();
  void calibrate();
  void open_page(bool open);
  void start(uint8_t mode);
  bool wait_ready();
  uint8_t address_ = 0x29;
  uint8_t pulse_periods_[2] = {14, 10};  // as the chip begins
  uint16_t timeout_ = 0;
  bool did_time_out_ = false;
};
