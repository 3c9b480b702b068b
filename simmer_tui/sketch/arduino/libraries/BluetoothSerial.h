// A serial line by Bluetooth (SPP). The laptop is connected from the beginning.
#pragma once
#include "../core/Arduino.h"

// Events of the line. Those that come here are ESP_SPP_INIT_EVT and ESP_SPP_SRV_OPEN_EVT, at begin().
enum esp_spp_cb_event_t {
  ESP_SPP_INIT_EVT = 0, ESP_SPP_UNINIT_EVT = 1, ESP_SPP_DISCOVERY_COMP_EVT = 8, ESP_SPP_OPEN_EVT = 26, ESP_SPP_CLOSE_EVT = 27,
  ESP_SPP_START_EVT = 28, ESP_SPP_CL_INIT_EVT = 29, ESP_SPP_DATA_IND_EVT = 30, ESP_SPP_CONG_EVT = 31, ESP_SPP_WRITE_EVT = 33,
  ESP_SPP_SRV_OPEN_EVT = 34, ESP_SPP_SRV_STOP_EVT = 35
};
union esp_spp_cb_param_t {
  struct { int status; } init;
  struct { int status; uint32_t handle; uint8_t rem_bda[6]; } srv_open;
  struct { int status; uint32_t handle; bool async; } close;
  struct { int status; uint32_t handle; uint16_t len; uint8_t* data; } data_ind;
};
typedef void (*esp_spp_cb_t)(esp_spp_cb_event_t event, esp_spp_cb_param_t* values);

class BluetoothSerial : public HardwareSerial {
 public:
  BluetoothSerial() : HardwareSerial(BLUETOOTH_RX, BLUETOOTH_TX) {}
  // The line has no rate of its own: it carries a byte in 87 us, as one of 115200 baud.
  bool begin(const String& = "", bool = false, bool = false) {
    open(115200);
    tell_open();
    return true;
  }
  esp_err_t register_callback(esp_spp_cb_t function) {
    function_ = function;
    if (open_) tell_open();
    return ESP_OK;
  }
  bool hasClient() const { return open_; }
  bool connected(int = 0) const { return open_; }
  bool isReady(bool = false, int = 0) const { return open_; }
  bool isClosed() const { return !open_; }
  void disconnect() {}
  void enableSSP() {}
  bool setPin(const char*, int = 0) { return true; }
  explicit operator bool() const { return open_; }

 private:
  void tell_open() {
    esp_spp_cb_param_t values = {};
    if (function_) function_(ESP_SPP_INIT_EVT, &values);
    if (function_) function_(ESP_SPP_SRV_OPEN_EVT, &values);
  }
  esp_spp_cb_t function_ = nullptr;
};
