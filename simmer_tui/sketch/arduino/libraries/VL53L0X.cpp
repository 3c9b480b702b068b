#include "VL53L0X.h"

#include "../board/i2c.h"
#include "../board/vl53l0x.h"
#include "Adafruit_VL53L0X.h"

namespace reg = board::vl53l0x;

namespace {
// The chip's settings at its start, and two calibrations of 5 ms: 40 ms in all at 100 kHz.
constexpr unsigned int SETTINGS = 300, CALIBRATIONS = 10;
constexpr uint32_t LONGEST_BUDGET = 0xFFFFu * reg::BUDGET_UNIT;
constexpr uint16_t NO_ANSWER = 65535;
}  // namespace

// -- registers ---------------------------------------------------------------------------------------

void VL53L0X::writeMulti(uint8_t reg, const uint8_t* source, uint8_t count) {
  Wire.beginTransmission(address_);
  Wire.write(reg);
  Wire.write(source, count);
  last_status = Wire.endTransmission();
}
void VL53L0X::readMulti(uint8_t reg, uint8_t* target, uint8_t count) {
  Wire.beginTransmission(address_);
  Wire.write(reg);
  last_status = Wire.endTransmission();
  Wire.requestFrom(address_, count);
  // Where nobody answers Wire reads -1.
  for (uint8_t each = 0; each < count; ++each) target[each] = static_cast<uint8_t>(Wire.read());
}
void VL53L0X::writeReg(uint8_t reg, uint8_t value) { writeMulti(reg, &value, 1); }
void VL53L0X::writeReg16Bit(uint8_t reg, uint16_t value) {
  const uint8_t bytes[] = {highByte(value), lowByte(value)};
  writeMulti(reg, bytes, 2);
}
void VL53L0X::writeReg32Bit(uint8_t reg, uint32_t value) {
  const uint8_t bytes[] = {static_cast<uint8_t>(value >> 24), static_cast<uint8_t>(value >> 16),
                           static_cast<uint8_t>(value >> 8), static_cast<uint8_t>(value)};
  writeMulti(reg, bytes, 4);
}
uint8_t VL53L0X::readReg(uint8_t reg) {
  uint8_t value = 0;
  readMulti(reg, &value, 1);
  return value;
}
uint16_t VL53L0X::readReg16Bit(uint8_t reg) {
  uint8_t bytes[2];
  readMulti(reg, bytes, 2);
  return static_cast<uint16_t>(bytes[0] << 8 | bytes[1]);
}
uint32_t VL53L0X::readReg32Bit(uint8_t reg) {
  uint8_t bytes[4];
  readMulti(reg, bytes, 4);
  return static_cast<uint32_t>(bytes[0]) << 24 | static_cast<uint32_t>(bytes[1] << 16 | bytes[2] << 8 | bytes[3]);
}

// -- VL53L0X -----------------------------------------------------------------------------------------

bool VL53L0X::is_there() { return readReg(reg::MODEL) == reg::MODEL_ID; }

void VL53L0X::calibrate() {
  delay(CALIBRATIONS);
  setSignalRateLimit(0.25f);
  setMeasurementTimingBudget(reg::DEFAULT_BUDGET);
}

bool VL53L0X::init(bool) {
  if (!is_there()) return false;
  board::i2c_pass(SETTINGS);
  calibrate();
  return true;
}

void VL53L0X::setAddress(uint8_t address) {
  writeReg(reg::ADDRESS, address & 0x7F);
  address_ = address & 0x7F;
}

bool VL53L0X::setSignalRateLimit(float limit) {
  if (limit < 0 || limit > 511.99f) return false;
  writeReg16Bit(reg::SIGNAL_LIMIT, static_cast<uint16_t>(limit * 128));  // seven bits behind the point
  return true;
}
float VL53L0X::getSignalRateLimit() { return static_cast<float>(readReg16Bit(reg::SIGNAL_LIMIT)) / 128; }

bool VL53L0X::setMeasurementTimingBudget(uint32_t microseconds) {
  if (microseconds < reg::SHORTEST_BUDGET || microseconds > LONGEST_BUDGET) return false;
  writeReg16Bit(reg::BUDGET, static_cast<uint16_t>(microseconds / reg::BUDGET_UNIT));
  return true;
}
uint32_t VL53L0X::getMeasurementTimingBudget() { return readReg16Bit(reg::BUDGET) * reg::BUDGET_UNIT; }

bool VL53L0X::setVcselPulsePeriod(vcselPeriodType type, uint8_t clocks) {
  const int low = type == VcselPeriodPreRange ? 12 : 8;
  if (clocks % 2 || clocks < low || clocks > low + 6) return false;
  pulse_periods_[type] = clocks;
  return true;
}

// Registers behind a page, which the chip needs before a start.
void VL53L0X::open_page(bool open) {
  if (open) {
    writeReg(reg::POWER, 1);
    writeReg(reg::PAGE, 1);
    writeReg(reg::START, 0);
    return;
  }
  writeReg(reg::START, 1);
  writeReg(reg::PAGE, 0);
  writeReg(reg::POWER, 0);
}

void VL53L0X::start(uint8_t mode) {
  open_page(true);
  writeReg(reg::STOP_VALUE, 0x3C);
  open_page(false);
  writeReg(reg::START, mode);
}

void VL53L0X::startContinuous(uint32_t period_ms) {
  if (period_ms) {
    writeReg32Bit(reg::PERIOD, period_ms);
    start(reg::TIMED);
  } else {
    start(reg::BACK_TO_BACK);
  }
}
void VL53L0X::stopContinuous() {
  writeReg(reg::START, reg::SINGLE);
  writeReg(reg::PAGE, 1);
  writeReg(reg::START, 0);
  writeReg(reg::STOP_VALUE, 0);
  writeReg(reg::START, 1);
  writeReg(reg::PAGE, 0);
}

// Wait for the end of a measurement. False after the time limit, if there is one.
bool VL53L0X::wait_ready() {
  const unsigned int begin = millis();
  while (!(readReg(reg::READY) & 7)) {
    if (timeout_ && millis() - begin > timeout_) {
      did_time_out_ = true;
      return false;
    }
  }
  return true;
}

uint16_t VL53L0X::readRangeContinuousMillimeters() {
  if (!wait_ready()) return NO_ANSWER;
  const uint16_t range = readReg16Bit(reg::RANGE);
  writeReg(reg::CLEAR, 1);
  return range;
}
uint16_t VL53L0X::readRangeSingleMillimeters() {
  start(reg::SINGLE);
  // The bit of a part that has begun clears itself.
  return readRangeContinuousMillimeters();
}
bool VL53L0X::timeoutOccurred() {
  const bool did = did_time_out_;
  did_time_out_ = false;
  return did;
}

// -- Adafruit_VL53L0X --------------------------------------------------------------------------------

bool Adafruit_VL53L0X::begin(uint8_t address, bool, TwoWire*, VL53L0X_Sense_config_t config) {
  Wire.begin();
  sensor_.address_ = VL53L0X_I2C_ADDR;
  // It writes the settings whether somebody answers or not: meanwhile a part that was just released has begun.
  board::i2c_pass(SETTINGS);
  bool is_there = sensor_.is_there();
  if (is_there) {
    sensor_.calibrate();
    is_there = setAddress(address) && configSensor(config);
  }
  Status = is_there ? VL53L0X_ERROR_NONE : VL53L0X_ERROR_CONTROL_INTERFACE;
  return is_there;
}

bool Adafruit_VL53L0X::setAddress(uint8_t address) {
  address &= 0x7F;
  if (address == sensor_.address_) return true;
  sensor_.setAddress(address);
  return sensor_.last_status == 0;
}

bool Adafruit_VL53L0X::configSensor(VL53L0X_Sense_config_t config) {
  const uint32_t budget = config == VL53L0X_SENSE_HIGH_SPEED      ? 20000
                          : config == VL53L0X_SENSE_HIGH_ACCURACY ? 200000
                                                                  : reg::DEFAULT_BUDGET;
  return setMeasurementTimingBudgetMicroSeconds(budget);
}

VL53L0X_Error Adafruit_VL53L0X::getRangingMeasurement(VL53L0X_RangingMeasurementData_t* measure, bool debug) {
  uint8_t data[12];
  sensor_.readMulti(reg::RESULT, data, sizeof data);
  Status = sensor_.last_status ? VL53L0X_ERROR_CONTROL_INTERFACE : VL53L0X_ERROR_NONE;
  if (Status != VL53L0X_ERROR_NONE) return Status;
  measure->RangeMilliMeter = static_cast<uint16_t>(data[10] << 8 | data[11]);
  measure->RangeStatus = data[0] >> 3 == reg::VALID ? 0 : 4;
  if (debug) printRangeStatus(measure);
  return Status;
}
VL53L0X_Error Adafruit_VL53L0X::getSingleRangingMeasurement(VL53L0X_RangingMeasurementData_t* measure, bool debug) {
  if (!startRange() || !waitRangeComplete()) return Status;
  getRangingMeasurement(measure, debug);
  sensor_.writeReg(reg::CLEAR, 1);
  return Status;
}
void Adafruit_VL53L0X::printRangeStatus(VL53L0X_RangingMeasurementData_t* measure) {
  Serial.print(F("Range Status: "));
  Serial.print(measure->RangeStatus);
  Serial.println(measure->RangeStatus ? F(" : Phase Fail") : F(" : Range Valid"));
}

uint16_t Adafruit_VL53L0X::readRange() {
  VL53L0X_RangingMeasurementData_t measure;
  getSingleRangingMeasurement(&measure);
  range_status_ = measure.RangeStatus;
  return Status == VL53L0X_ERROR_NONE ? measure.RangeMilliMeter : NO_ANSWER;
}
bool Adafruit_VL53L0X::startRange() {
  sensor_.start(reg::SINGLE);
  Status = sensor_.last_status ? VL53L0X_ERROR_CONTROL_INTERFACE : VL53L0X_ERROR_NONE;
  return Status == VL53L0X_ERROR_NONE;
}
bool Adafruit_VL53L0X::isRangeComplete() { return sensor_.readReg(reg::READY) & 7; }
bool Adafruit_VL53L0X::waitRangeComplete() {
  const bool is_done = sensor_.wait_ready();
  if (!is_done) Status = VL53L0X_ERROR_TIME_OUT;
  return is_done;
}
uint16_t Adafruit_VL53L0X::readRangeResult() {
  VL53L0X_RangingMeasurementData_t measure;
  getRangingMeasurement(&measure);
  range_status_ = measure.RangeStatus;
  if (Status == VL53L0X_ERROR_NONE) sensor_.writeReg(reg::CLEAR, 1);
  return Status == VL53L0X_ERROR_NONE && range_status_ != 4 ? measure.RangeMilliMeter : NO_ANSWER;
}
bool Adafruit_VL53L0X::startRangeContinuous(uint16_t period_ms) {
  sensor_.startContinuous(period_ms);
  Status = sensor_.last_status ? VL53L0X_ERROR_CONTROL_INTERFACE : VL53L0X_ERROR_NONE;
  return Status == VL53L0X_ERROR_NONE;
}
void Adafruit_VL53L0X::stopRangeContinuous() { sensor_.stopContinuous(); }
bool Adafruit_VL53L0X::setMeasurementTimingBudgetMicroSeconds(uint32_t budget) {
  return sensor_.setMeasurementTimingBudget(budget) && sensor_.last_status == 0;
}
uint32_t Adafruit_VL53L0X::getMeasurementTimingBudgetMicroSeconds() { return sensor_.getMeasurementTimingBudget(); }
