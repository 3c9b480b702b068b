// An MPU-6050 on Wire, with the motion processor (DMP) in it.
#pragma once
#include "I2Cdev.h"

#define MPU6050_ADDRESS_AD0_LOW 0x68
#define MPU6050_ADDRESS_AD0_HIGH 0x69
#define MPU6050_DEFAULT_ADDRESS MPU6050_ADDRESS_AD0_LOW

#define MPU6050_CLOCK_INTERNAL 0x00
#define MPU6050_CLOCK_PLL_XGYRO 0x01
#define MPU6050_CLOCK_PLL_ZGYRO 0x03
#define MPU6050_DLPF_BW_256 0x00
#define MPU6050_DLPF_BW_188 0x01
#define MPU6050_DLPF_BW_98 0x02
#define MPU6050_DLPF_BW_42 0x03
#define MPU6050_DLPF_BW_20 0x04
#define MPU6050_DLPF_BW_10 0x05
#define MPU6050_DLPF_BW_5 0x06
#define MPU6050_GYRO_FS_250 0x00
#define MPU6050_GYRO_FS_500 0x01
#define MPU6050_GYRO_FS_1000 0x02
#define MPU6050_GYRO_FS_2000 0x03
#define MPU6050_ACCEL_FS_2 0x00
#define MPU6050_ACCEL_FS_4 0x01
#define MPU6050_ACCEL_FS_8 0x02
#define MPU6050_ACCEL_FS_16 0x03
#define MPU6050_INTERRUPT_FIFO_OFLOW_BIT 4
#define MPU6050_INTERRUPT_DMP_INT_BIT 1
#define MPU6050_INTERRUPT_DATA_RDY_BIT 0

struct Quaternion {
  float w = 1, x = 0, y = 0, z = 0;
};
struct VectorInt16 {
  int16_t x = 0, y = 0, z = 0;
};
struct VectorFloat {
  float x = 0, y = 0, z = 0;
};

class MPU6050 {
 public:
  explicit MPU6050(uint8_t address = MPU6050_DEFAULT_ADDRESS, void* = nullptr) : address_(address) {}

  void initialize();
  bool testConnection();
  uint8_t getDeviceID();
  void reset();
  void setSleepEnabled(bool on);
  bool getSleepEnabled();
  void setClockSource(uint8_t source);
  void setRate(uint8_t divider);
  uint8_t getRate();
  void setDLPFMode(uint8_t mode);
  uint8_t getDLPFMode();
  void setFullScaleGyroRange(uint8_t range);
  uint8_t getFullScaleGyroRange();
  void setFullScaleAccelRange(uint8_t range);
  uint8_t getFullScaleAccelRange();

  void getMotion6(int16_t* ax, int16_t* ay, int16_t* az, int16_t* gx, int16_t* gy, int16_t* gz);
  void getAcceleration(int16_t* x, int16_t* y, int16_t* z);
  int16_t getAccelerationX();
  int16_t getAccelerationY();
  int16_t getAccelerationZ();
  int16_t getTemperature();
  void getRotation(int16_t* x, int16_t* y, int16_t* z);
  int16_t getRotationX();
  int16_t getRotationY();
  int16_t getRotationZ();

  // Offsets of a real chip are its own. The simulated one needs none: they are kept, and change nothing.
  void setXAccelOffset(int16_t offset) { offsets_[0] = offset; }
  void setYAccelOffset(int16_t offset) { offsets_[1] = offset; }
  void setZAccelOffset(int16_t offset) { offsets_[2] = offset; }
  void setXGyroOffset(int16_t offset) { offsets_[3] = offset; }
  void setYGyroOffset(int16_t offset) { offsets_[4] = offset; }
  void setZGyroOffset(int16_t offset) { offsets_[5] = offset; }
  int16_t getXAccelOffset() const { return offsets_[0]; }
  int16_t getYAccelOffset() const { return offsets_[1]; }
  int16_t getZAccelOffset() const { return offsets_[2]; }
  int16_t getXGyroOffset() const { return offsets_[3]; }
  int16_t getYGyroOffset() const { return offsets_[4]; }
  int16_t getZGyroOffset() const { return offsets_[5]; }
  // At rest: the gyro's rate there is taken off from then on.
  void CalibrateGyro(uint8_t loops = 15);
  void CalibrateAccel(uint8_t loops = 15);
  void PrintActiveOffsets();

  void setIntEnabled(uint8_t enabled);
  uint8_t getIntEnabled();
  void setIntDataReadyEnabled(bool on);
  void setInterruptMode(bool active_low);
  void setInterruptLatch(bool latched);
  void setInterruptLatchClear(bool by_any_read);
  uint8_t getIntStatus();
  bool getIntDataReadyStatus();

  uint16_t getFIFOCount();
  void resetFIFO();
  void getFIFOBytes(uint8_t* data, uint8_t count);
  uint8_t getFIFOByte();

  uint8_t dmpInitialize();
  void setDMPEnabled(bool on);
  bool getDMPEnabled();
  void resetDMP();
  bool dmpPacketAvailable();
  uint16_t dmpGetFIFOPacketSize();
  uint8_t dmpGetCurrentFIFOPacket(uint8_t* data);
  int8_t GetCurrentFIFOPacket(uint8_t* data, uint8_t size);
  uint8_t dmpGetQuaternion(Quaternion* q, const uint8_t* packet);
  uint8_t dmpGetQuaternion(int16_t* q, const uint8_t* packet);
  uint8_t dmpGetGravity(VectorFloat* gravity, Quaternion* q);
  uint8_t dmpGetYawPitchRoll(float* angles, Quaternion* q, VectorFloat* gravity);
  uint8_t dmpGetEuler(float* angles, Quaternion* q);
  uint8_t dmpGetGyro(VectorInt16* rate, const uint8_t* packet);
  uint8_t dmpGetGyro(int16_t* rate, const uint8_t* packet);
  uint8_t dmpGetAccel(VectorInt16* acceleration, const uint8_t* packet);
  uint8_t dmpGetAccel(int16_t* acceleration, const uint8_t* packet);
  uint8_t dmpGetLinearAccel(VectorInt16* linear, VectorInt16* raw, VectorFloat* gravity);
  uint8_t dmpGetLinearAccelInWorld(VectorInt16* world, VectorInt16* linear, Quaternion* q);

 protected:
  uint8_t packet_size_ = 42;  // of the DMP's program of version 2.0

 private:
  bool is_short() const { return packet_size_ != 42; }
  uint8_t bits(uint8_t reg, uint8_t start, uint8_t count);
  int16_t word(uint8_t reg);
  uint8_t address_;
  int16_t offsets_[6] = {};
};
