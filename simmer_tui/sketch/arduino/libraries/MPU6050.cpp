#include "MPU6050.h"

#include "../board/i2c.h"

// -- I2Cdev ------------------------------------------------------------------------------------------

int8_t I2Cdev::readBytes(uint8_t address, uint8_t reg, uint8_t count, uint8_t* data, uint16_t) {
  uint8_t done = 0;
  // Wire takes 32 bytes at a time. The register of a FIFO stays the same; of others nobody reads as many.
  while (done < count) {
    Wire.beginTransmission(address);
    Wire.write(reg);
    Wire.endTransmission();
    const uint8_t got = Wire.requestFrom(address, min(count - done, BUFFER_LENGTH));
    if (got == 0) return -1;
    while (Wire.available()) data[done++] = static_cast<uint8_t>(Wire.read());
  }
  return static_cast<int8_t>(done);
}
int8_t I2Cdev::readByte(uint8_t address, uint8_t reg, uint8_t* data, uint16_t) { return readBytes(address, reg, 1, data); }
int8_t I2Cdev::readBit(uint8_t address, uint8_t reg, uint8_t bit, uint8_t* data, uint16_t) {
  uint8_t value = 0;
  const int8_t count = readByte(address, reg, &value);
  *data = value & 1u << bit;
  return count;
}
int8_t I2Cdev::readBits(uint8_t address, uint8_t reg, uint8_t start, uint8_t count, uint8_t* data, uint16_t) {
  uint8_t value = 0;
  const int8_t got = readByte(address, reg, &value);
  if (got > 0) *data = static_cast<uint8_t>(value >> (start + 1 - count) & ((1u << count) - 1));
  return got;
}
int8_t I2Cdev::readWord(uint8_t address, uint8_t reg, uint16_t* data, uint16_t) {
  uint8_t bytes[2] = {};
  const int8_t got = readBytes(address, reg, 2, bytes);
  if (got > 0) *data = static_cast<uint16_t>(bytes[0] << 8 | bytes[1]);
  return got < 0 ? got : 1;
}
bool I2Cdev::writeBytes(uint8_t address, uint8_t reg, uint8_t count, const uint8_t* data) {
  Wire.beginTransmission(address);
  Wire.write(reg);
  Wire.write(data, count);
  return Wire.endTransmission() == 0;
}
bool I2Cdev::writeByte(uint8_t address, uint8_t reg, uint8_t data) { return writeBytes(address, reg, 1, &data); }
bool I2Cdev::writeBit(uint8_t address, uint8_t reg, uint8_t bit, uint8_t data) {
  return writeBits(address, reg, bit, 1, data ? 1 : 0);
}
bool I2Cdev::writeBits(uint8_t address, uint8_t reg, uint8_t start, uint8_t count, uint8_t data) {
  uint8_t value = 0;
  if (readByte(address, reg, &value) < 0) return false;
  const int shift = start + 1 - count;
  const unsigned int mask = ((1u << count) - 1) << shift;
  return writeByte(address, reg, static_cast<uint8_t>((value & ~mask) | (static_cast<unsigned int>(data) << shift & mask)));
}
bool I2Cdev::writeWord(uint8_t address, uint8_t reg, uint16_t data) {
  const uint8_t bytes[] = {highByte(data), lowByte(data)};
  return writeBytes(address, reg, 2, bytes);
}

// -- MPU6050 -----------------------------------------------------------------------------------------

namespace {
// The DMP's program of some 2,000 bytes goes to the chip in pieces of 16, and each is read back: 49 bytes on the bus.
constexpr unsigned int DMP_LOAD = 6000;
constexpr unsigned int LONGEST_WAIT = 11000;  // microseconds for a packet: one comes each 10 ms
constexpr unsigned int FEW_BYTES = 200;       // of old packets: more are dropped all at once
constexpr uint8_t SHORT_PROGRAM = 0x04;       // where the program of short packets begins, in pages
constexpr float PACKET_ONE = 16384, PACKET_G = 8192, SHORT_G = 16384;
int16_t word_at(const uint8_t* data) { return static_cast<int16_t>(data[0] << 8 | data[1]); }
}  // namespace

uint8_t MPU6050::bits(uint8_t reg, uint8_t start, uint8_t count) {
  uint8_t value = 0;
  I2Cdev::readBits(address_, reg, start, count, &value);
  return value;
}
int16_t MPU6050::word(uint8_t reg) {
  uint16_t value = 0;
  I2Cdev::readWord(address_, reg, &value);
  return static_cast<int16_t>(value);
}

void MPU6050::initialize() {
  setClockSource(MPU6050_CLOCK_PLL_XGYRO);
  setFullScaleGyroRange(MPU6050_GYRO_FS_250);
  setFullScaleAccelRange(MPU6050_ACCEL_FS_2);
  setSleepEnabled(false);
}
bool MPU6050::testConnection() { return getDeviceID() == 0x34; }
uint8_t MPU6050::getDeviceID() { return bits(0x75, 6, 6); }
void MPU6050::reset() { I2Cdev::writeBit(address_, 0x6B, 7, true); }
void MPU6050::setSleepEnabled(bool on) { I2Cdev::writeBit(address_, 0x6B, 6, on); }
bool MPU6050::getSleepEnabled() { return bits(0x6B, 6, 1); }
void MPU6050::setClockSource(uint8_t source) { I2Cdev::writeBits(address_, 0x6B, 2, 3, source); }
void MPU6050::setRate(uint8_t divider) { I2Cdev::writeByte(address_, 0x19, divider); }
uint8_t MPU6050::getRate() { return bits(0x19, 7, 8); }
void MPU6050::setDLPFMode(uint8_t mode) { I2Cdev::writeBits(address_, 0x1A, 2, 3, mode); }
uint8_t MPU6050::getDLPFMode() { return bits(0x1A, 2, 3); }
void MPU6050::setFullScaleGyroRange(uint8_t range) { I2Cdev::writeBits(address_, 0x1B, 4, 2, range); }
uint8_t MPU6050::getFullScaleGyroRange() { return bits(0x1B, 4, 2); }
void MPU6050::setFullScaleAccelRange(uint8_t range) { I2Cdev::writeBits(address_, 0x1C, 4, 2, range); }
uint8_t MPU6050::getFullScaleAccelRange() { return bits(0x1C, 4, 2); }

void MPU6050::getMotion6(int16_t* ax, int16_t* ay, int16_t* az, int16_t* gx, int16_t* gy, int16_t* gz) {
  uint8_t data[14] = {};
  I2Cdev::readBytes(address_, 0x3B, sizeof data, data);
  int16_t* const values[] = {ax, ay, az, nullptr, gx, gy, gz};
  for (int each = 0; each < 7; ++each)
    if (values[each]) *values[each] = word_at(data + 2 * each);
}
void MPU6050::getAcceleration(int16_t* x, int16_t* y, int16_t* z) {
  uint8_t data[6] = {};
  I2Cdev::readBytes(address_, 0x3B, sizeof data, data);
  *x = word_at(data);
  *y = word_at(data + 2);
  *z = word_at(data + 4);
}
int16_t MPU6050::getAccelerationX() { return word(0x3B); }
int16_t MPU6050::getAccelerationY() { return word(0x3D); }
int16_t MPU6050::getAccelerationZ() { return word(0x3F); }
int16_t MPU6050::getTemperature() { return word(0x41); }
void MPU6050::getRotation(int16_t* x, int16_t* y, int16_t* z) {
  uint8_t data[6] = {};
  I2Cdev::readBytes(address_, 0x43, sizeof data, data);
  *x = word_at(data);
  *y = word_at(data + 2);
  *z = word_at(data + 4);
}
int16_t MPU6050::getRotationX() { return word(0x43); }
int16_t MPU6050::getRotationY() { return word(0x45); }
int16_t MPU6050::getRotationZ() { return word(0x47); }

void MPU6050::CalibrateGyro(uint8_t loops) {
  const int count = 100 * (loops ? loops : 1);
  const int range = getFullScaleGyroRange();
  int32_t sum = 0;
  for (int each = 0; each < count; ++each) {
    sum += getRotationZ();
    delay(1);
  }
  // The register counts 32.8 for a degree a second, a reading 131 in its smallest range.
  const float mean = static_cast<float>(sum) / static_cast<float>(count) * static_cast<float>(1 << range) / 4;
  I2Cdev::writeWord(address_, 0x17, static_cast<uint16_t>(word(0x17) - static_cast<int16_t>(round(mean))));
}
void MPU6050::CalibrateAccel(uint8_t loops) {
  // Its accelerations have no error: only the time.
  int16_t x, y, z;
  for (int each = 0; each < 100 * (loops ? loops : 1); ++each) {
    getAcceleration(&x, &y, &z);
    delay(1);
  }
}
void MPU6050::PrintActiveOffsets() {
  Serial.print(F("\n//           X Accel  Y Accel  Z Accel   X Gyro   Y Gyro   Z Gyro\n//OFFSETS   "));
  for (const int16_t each : offsets_) {
    Serial.print(' ');
    Serial.print(each);
  }
  Serial.println();
}

void MPU6050::setIntEnabled(uint8_t enabled) { I2Cdev::writeByte(address_, 0x38, enabled); }
uint8_t MPU6050::getIntEnabled() { return bits(0x38, 7, 8); }
void MPU6050::setIntDataReadyEnabled(bool on) { I2Cdev::writeBit(address_, 0x38, 0, on); }
void MPU6050::setInterruptMode(bool active_low) { I2Cdev::writeBit(address_, 0x37, 7, active_low); }
void MPU6050::setInterruptLatch(bool latched) { I2Cdev::writeBit(address_, 0x37, 5, latched); }
void MPU6050::setInterruptLatchClear(bool by_any_read) { I2Cdev::writeBit(address_, 0x37, 4, by_any_read); }
uint8_t MPU6050::getIntStatus() { return bits(0x3A, 7, 8); }
bool MPU6050::getIntDataReadyStatus() { return bits(0x3A, 0, 1); }

uint16_t MPU6050::getFIFOCount() { return static_cast<uint16_t>(word(0x72)); }
void MPU6050::resetFIFO() { I2Cdev::writeBit(address_, 0x6A, 2, true); }
void MPU6050::getFIFOBytes(uint8_t* data, uint8_t count) {
  if (count)
    I2Cdev::readBytes(address_, 0x74, count, data);
  else
    *data = 0;
}
uint8_t MPU6050::getFIFOByte() { return bits(0x74, 7, 8); }

// -- its motion processor ------------------------------------------------------------------------------

uint8_t MPU6050::dmpInitialize() {
  if (!testConnection()) return 1;
  reset();
  delay(30);
  setSleepEnabled(false);
  board::i2c_pass(DMP_LOAD);
  I2Cdev::writeByte(address_, 0x70, is_short() ? SHORT_PROGRAM : 0x03);
  setClockSource(MPU6050_CLOCK_PLL_ZGYRO);
  setIntEnabled(1 << MPU6050_INTERRUPT_FIFO_OFLOW_BIT | 1 << MPU6050_INTERRUPT_DMP_INT_BIT);
  setRate(4);
  setDLPFMode(MPU6050_DLPF_BW_42);
  setFullScaleGyroRange(MPU6050_GYRO_FS_2000);
  I2Cdev::writeBit(address_, 0x6A, 6, true);
  resetFIFO();
  return 0;
}
void MPU6050::setDMPEnabled(bool on) { I2Cdev::writeBit(address_, 0x6A, 7, on); }
bool MPU6050::getDMPEnabled() { return bits(0x6A, 7, 1); }
void MPU6050::resetDMP() { I2Cdev::writeBit(address_, 0x6A, 3, true); }
bool MPU6050::dmpPacketAvailable() { return getFIFOCount() >= packet_size_; }
uint16_t MPU6050::dmpGetFIFOPacketSize() { return packet_size_; }
uint8_t MPU6050::dmpGetCurrentFIFOPacket(uint8_t* data) {
  return static_cast<uint8_t>(GetCurrentFIFOPacket(data, packet_size_));
}
int8_t MPU6050::GetCurrentFIFOPacket(uint8_t* data, uint8_t size) {
  // The newest packet. What is older is read and dropped, or with all the rest if it is much: then it waits for another.
  const unsigned int begin = micros();
  unsigned int count = getFIFOCount();
  while (count != size) {
    if (count > FEW_BYTES) {
      resetFIFO();
      count = 0;
    }
    while (count > size) {
      uint8_t dropped[BUFFER_LENGTH];
      const unsigned int piece = min(count - size, sizeof dropped);
      getFIFOBytes(dropped, static_cast<uint8_t>(piece));
      count -= piece;
    }
    if (count == 0 && getFIFOCount() == 0 && micros() - begin > LONGEST_WAIT) return 0;
    const unsigned int now_there = getFIFOCount();
    if (now_there == 0 && micros() - begin > LONGEST_WAIT) return 0;
    count = now_there;
  }
  getFIFOBytes(data, size);
  return 1;
}

uint8_t MPU6050::dmpGetQuaternion(int16_t* q, const uint8_t* packet) {
  for (int each = 0; each < 4; ++each) q[each] = word_at(packet + 4 * each);
  return 0;
}
uint8_t MPU6050::dmpGetQuaternion(Quaternion* q, const uint8_t* packet) {
  int16_t parts[4];
  dmpGetQuaternion(parts, packet);
  q->w = parts[0] / PACKET_ONE;
  q->x = parts[1] / PACKET_ONE;
  q->y = parts[2] / PACKET_ONE;
  q->z = parts[3] / PACKET_ONE;
  return 0;
}
uint8_t MPU6050::dmpGetGravity(VectorFloat* gravity, Quaternion* q) {
  // The third row of the rotation's matrix: the world's Z in the chip's frame.
  gravity->x = 2 * (q->x * q->z - q->w * q->y);
  gravity->y = 2 * (q->w * q->x + q->y * q->z);
  gravity->z = q->w * q->w - q->x * q->x - q->y * q->y + q->z * q->z;
  return 0;
}
uint8_t MPU6050::dmpGetYawPitchRoll(float* angles, Quaternion* q, VectorFloat* gravity) {
  // Its yaw grows to the right, unlike the rate of the gyro's Z.
  angles[0] = std::atan2(2 * (q->x * q->y - q->w * q->z), 2 * (q->w * q->w + q->x * q->x) - 1);
  angles[1] = std::atan2(gravity->x, std::sqrt(gravity->y * gravity->y + gravity->z * gravity->z));
  angles[2] = std::atan2(gravity->y, gravity->z);
  return 0;
}
uint8_t MPU6050::dmpGetEuler(float* angles, Quaternion* q) {
  angles[0] = std::atan2(2 * (q->x * q->y - q->w * q->z), 2 * (q->w * q->w + q->x * q->x) - 1);
  angles[1] = -std::asin(constrain(2 * (q->x * q->z + q->w * q->y), -1.0f, 1.0f));
  angles[2] = std::atan2(2 * (q->y * q->z - q->w * q->x), 2 * (q->w * q->w + q->z * q->z) - 1);
  return 0;
}
uint8_t MPU6050::dmpGetGyro(int16_t* rate, const uint8_t* packet) {
  for (int each = 0; each < 3; ++each) rate[each] = word_at(packet + (is_short() ? 22 + 2 * each : 16 + 4 * each));
  return 0;
}
uint8_t MPU6050::dmpGetGyro(VectorInt16* rate, const uint8_t* packet) {
  int16_t axes[3];
  dmpGetGyro(axes, packet);
  *rate = {axes[0], axes[1], axes[2]};
  return 0;
}
uint8_t MPU6050::dmpGetAccel(int16_t* acceleration, const uint8_t* packet) {
  for (int each = 0; each < 3; ++each) acceleration[each] = word_at(packet + (is_short() ? 16 + 2 * each : 28 + 4 * each));
  return 0;
}
uint8_t MPU6050::dmpGetAccel(VectorInt16* acceleration, const uint8_t* packet) {
  int16_t axes[3];
  dmpGetAccel(axes, packet);
  *acceleration = {axes[0], axes[1], axes[2]};
  return 0;
}
uint8_t MPU6050::dmpGetLinearAccel(VectorInt16* linear, VectorInt16* raw, VectorFloat* gravity) {
  const float g = is_short() ? SHORT_G : PACKET_G;
  linear->x = static_cast<int16_t>(raw->x - gravity->x * g);
  linear->y = static_cast<int16_t>(raw->y - gravity->y * g);
  linear->z = static_cast<int16_t>(raw->z - gravity->z * g);
  return 0;
}
uint8_t MPU6050::dmpGetLinearAccelInWorld(VectorInt16* world, VectorInt16* linear, Quaternion* q) {
  // v + 2 u x (u x v + w v), with u = (x, y, z) of a unit quaternion.
  const float v[] = {static_cast<float>(linear->x), static_cast<float>(linear->y), static_cast<float>(linear->z)};
  const float u[] = {q->x, q->y, q->z};
  float inner[3], outer[3];
  for (int i = 0, j = 1, k = 2; i < 3; ++i, j = (j + 1) % 3, k = (k + 1) % 3) inner[i] = u[j] * v[k] - u[k] * v[j] + q->w * v[i];
  for (int i = 0, j = 1, k = 2; i < 3; ++i, j = (j + 1) % 3, k = (k + 1) % 3) outer[i] = u[j] * inner[k] - u[k] * inner[j];
  *world = {static_cast<int16_t>(v[0] + 2 * outer[0]), static_cast<int16_t>(v[1] + 2 * outer[1]),
            static_cast<int16_t>(v[2] + 2 * outer[2])};
  return 0;
}
