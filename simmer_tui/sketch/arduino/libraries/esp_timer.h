// Timers of an ESP32's system: a task of its own calls their functions, at their time to the microsecond.
#pragma once
#include "esp_err.h"

typedef void (*esp_timer_cb_t)(void*);
enum esp_timer_dispatch_t { ESP_TIMER_TASK, ESP_TIMER_ISR };
struct esp_timer_create_args_t {
  esp_timer_cb_t callback;
  void* arg;
  esp_timer_dispatch_t dispatch_method;
  const char* name;
  bool skip_unhandled_events;
};
namespace board {
struct SystemTimer;
}
typedef board::SystemTimer* esp_timer_handle_t;

esp_err_t esp_timer_create(const esp_timer_create_args_t* values, esp_timer_handle_t* made);
esp_err_t esp_timer_start_once(esp_timer_handle_t timer, uint64_t microseconds);
esp_err_t esp_timer_start_periodic(esp_timer_handle_t timer, uint64_t microseconds);
esp_err_t esp_timer_restart(esp_timer_handle_t timer, uint64_t microseconds);
esp_err_t esp_timer_stop(esp_timer_handle_t timer);
esp_err_t esp_timer_delete(esp_timer_handle_t timer);
bool esp_timer_is_active(esp_timer_handle_t timer);
