// The watchdog of tasks of an ESP32: it restarts a board whose task has not called it in time, which is told here.
#pragma once
#include "esp_err.h"

struct esp_task_wdt_config_t {
  uint32_t timeout_ms;
  uint32_t idle_core_mask;
  bool trigger_panic;
};

esp_err_t esp_task_wdt_init(uint32_t seconds, bool restarts);      // core 2
esp_err_t esp_task_wdt_init(const esp_task_wdt_config_t* values);  // core 3
esp_err_t esp_task_wdt_reconfigure(const esp_task_wdt_config_t* values);
esp_err_t esp_task_wdt_deinit();
esp_err_t esp_task_wdt_add(TaskHandle_t task);
esp_err_t esp_task_wdt_reset();
esp_err_t esp_task_wdt_delete(TaskHandle_t task);
esp_err_t esp_task_wdt_status(TaskHandle_t task);
