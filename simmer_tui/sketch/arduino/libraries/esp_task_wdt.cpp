#include "esp_task_wdt.h"

#include "../board/task_mistakes.h"
#include "../board/task_waits.h"

using namespace board;

namespace {
Task& meant_task(TaskHandle_t task) { return task ? *task : running_task(); }
esp_err_t set_watchdog(uint32_t milliseconds, bool restarts) {
  pass(cost::TASK_CALL);
  watch_tasks(milliseconds, restarts);
  return ESP_OK;
}
}  // namespace

esp_err_t esp_task_wdt_init(uint32_t seconds, bool restarts) { return set_watchdog(1000 * seconds, restarts); }
esp_err_t esp_task_wdt_init(const esp_task_wdt_config_t* values) { return esp_task_wdt_reconfigure(values); }
esp_err_t esp_task_wdt_reconfigure(const esp_task_wdt_config_t* values) {
  if (!values) return ESP_ERR_INVALID_ARG;
  watch_core_0(values->idle_core_mask & 1u);
  return set_watchdog(values->timeout_ms, values->trigger_panic);
}
esp_err_t esp_task_wdt_deinit() {
  pass(cost::TASK_CALL);
  return ESP_OK;
}
esp_err_t esp_task_wdt_add(TaskHandle_t task) {
  pass(cost::TASK_CALL);
  Task& each = meant_task(task);
  if (each.fed_at != NEVER) return ESP_ERR_INVALID_ARG;
  each.fed_at = now;
  return ESP_OK;
}
esp_err_t esp_task_wdt_reset() {
  pass(cost::TASK_CALL);
  Task& each = running_task();
  if (each.fed_at == NEVER) return ESP_ERR_NOT_FOUND;
  each.fed_at = now;
  return ESP_OK;
}
esp_err_t esp_task_wdt_delete(TaskHandle_t task) {
  pass(cost::TASK_CALL);
  Task& each = meant_task(task);
  if (each.fed_at == NEVER) return ESP_ERR_INVALID_ARG;
  each.fed_at = NEVER;
  return ESP_OK;
}
esp_err_t esp_task_wdt_status(TaskHandle_t task) {
  pass(cost::TASK_CALL);
  return meant_task(task).fed_at == NEVER ? ESP_ERR_NOT_FOUND : ESP_OK;
}
