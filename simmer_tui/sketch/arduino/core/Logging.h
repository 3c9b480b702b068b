// Messages of an ESP32's log. Arduino builds without them, unless another level is chosen in its menu.
#pragma once

enum esp_log_level_t { ESP_LOG_NONE, ESP_LOG_ERROR, ESP_LOG_WARN, ESP_LOG_INFO, ESP_LOG_DEBUG, ESP_LOG_VERBOSE };
inline void esp_log_level_set(const char*, esp_log_level_t) {}

#define log_e(...) do {} while (0)
#define log_w(...) do {} while (0)
#define log_i(...) do {} while (0)
#define log_d(...) do {} while (0)
#define log_v(...) do {} while (0)
#define ESP_LOGE(...) do {} while (0)
#define ESP_LOGW(...) do {} while (0)
#define ESP_LOGI(...) do {} while (0)
#define ESP_LOGD(...) do {} while (0)
#define ESP_LOGV(...) do {} while (0)
