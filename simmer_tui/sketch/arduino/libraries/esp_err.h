// Errors of calls of the ESP32's own libraries.
#pragma once
#include <cstdlib>

#include "../core/Arduino.h"

#define ESP_ERR_NO_MEM 0x101
#define ESP_ERR_INVALID_ARG 0x102
#define ESP_ERR_INVALID_STATE 0x103
#define ESP_ERR_NOT_FOUND 0x105
#define ESP_ERROR_CHECK(call) \
  do {                        \
    if ((call) != ESP_OK) std::abort(); \
  } while (0)
