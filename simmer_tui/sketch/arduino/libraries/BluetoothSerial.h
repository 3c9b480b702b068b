// A serial line by Bluetooth (SPP). The laptop is connected from the beginning.
#pragma once
#include "../core/Arduino.h"

class BluetoothSerial : public HardwareSerial {
 public:
  BluetoothSerial() : HardwareSerial(BLUETOOTH_RX, BLUETOOTH_TX) {}
  // The line has no rate of its own: it carries a byte in 87 us, as one of 115200 baud.
  bool begin(const String& = "", bool = false, bool = false) {
    open(115200);
    return true;
  }
  bool hasClient() const { return open_; }
  bool connected(int = 0) const { return open_; }
  bool isReady(bool = false, int = 0) const { return open_; }
  bool isClosed() const { return !open_; }
  void disconnect() {}
  void enableSSP() {}
  bool setPin(const char*, int = 0) { return true; }
  explicit operator bool() const { return open_; }
};
