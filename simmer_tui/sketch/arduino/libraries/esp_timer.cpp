#include "esp_timer.h"

#include <deque>

#include "../board/hardware_timers.h"
#include "../board/task_waits.h"
#include "Ticker.h"

namespace board {

struct SystemTimer {
  esp_timer_cb_t function = nullptr;
  void* argument = nullptr;
  bool skips = false;             // the alarms that came meanwhile
  Nanoseconds due = NEVER, period = 0;
  bool is_deleted = false;
};

}  // namespace board

using namespace board;

namespace {
// ESP_TASK_TIMER_PRIO of the ESP32's system: 25 priorities, less three. Its task is on core 0.
constexpr unsigned int TIMER_PRIORITY = 22;
constexpr unsigned int MICROSECOND_DIVIDER = 80;
constexpr Nanoseconds SHORTEST_PERIOD = 50 * MICROSECOND;
std::deque<SystemTimer> system_timers;
char changes = 0;  // its address is what the timers' task waits for

SystemTimer* first_system_timer() {
  SystemTimer* first = nullptr;
  for (SystemTimer& each : system_timers)
    if (each.due != NEVER && (!first || each.due < first->due)) first = &each;
  return first;
}

void alarm() {
  if (wake_first(&changes)) ask_for_switch();
}

void run_system_timers(void*) {
  for (;;) {
    SystemTimer* first = first_system_timer();
    if (!first || first->due > now) {
      uint64_t wake = NEVER;
      if (first) {
        set_system_alarm(alarm, MICROSECOND_DIVIDER, (first->due - now + MICROSECOND - 1) / MICROSECOND, false);
        wake = tick_count() + (first->due - now) / TICK + 2;
      }
      block({WaitsFor::Time, &changes}, wake);
      continue;
    }
    first->due = first->period ? first->due + first->period : NEVER;
    if (first->skips && first->due <= now) first->due += ((now - first->due) / first->period + 1) * first->period;
    pass(cost::TASK_CALL);
    first->function(first->argument);
  }
}

// A call about a timer, which a sketch may have failed to create.
[[gnu::always_inline]] inline SystemTimer& called(esp_timer_handle_t timer) {
  pass(cost::TASK_CALL);
  return there(timer);
}

esp_err_t start(SystemTimer& timer, uint64_t microseconds, bool repeats, bool again) {
  if (timer.is_deleted || again != (timer.due != NEVER)) return ESP_ERR_INVALID_STATE;
  const Nanoseconds time = microseconds * MICROSECOND;
  timer.period = repeats ? (time < SHORTEST_PERIOD ? SHORTEST_PERIOD : time) : 0;
  timer.due = now + (repeats ? timer.period : time);
  pass_on(&changes);
  return ESP_OK;
}
}  // namespace

esp_err_t esp_timer_create(const esp_timer_create_args_t* values, esp_timer_handle_t* made) {
  pass(cost::TASK_CREATE);
  if (!values || !values->callback || !made) return ESP_ERR_INVALID_ARG;
  if (system_timers.empty()) create_task(run_system_timers, "esp_timer", nullptr, TIMER_PRIORITY, 0);
  SystemTimer* timer = nullptr;
  for (SystemTimer& each : system_timers)
    if (each.is_deleted) timer = &each;
  if (!timer) timer = &system_timers.emplace_back();
  *timer = SystemTimer();
  timer->function = values->callback;
  timer->argument = values->arg;
  timer->skips = values->skip_unhandled_events;
  *made = timer;
  return ESP_OK;
}
esp_err_t esp_timer_start_once(esp_timer_handle_t timer, uint64_t microseconds) {
  return start(called(timer), microseconds, false, false);
}
esp_err_t esp_timer_start_periodic(esp_timer_handle_t timer, uint64_t microseconds) {
  return start(called(timer), microseconds, true, false);
}
esp_err_t esp_timer_restart(esp_timer_handle_t timer, uint64_t microseconds) {
  return start(called(timer), microseconds, timer->period != 0, true);
}
esp_err_t esp_timer_stop(esp_timer_handle_t timer) {
  if (called(timer).due == NEVER) return ESP_ERR_INVALID_STATE;
  timer->due = NEVER;
  return ESP_OK;
}
esp_err_t esp_timer_delete(esp_timer_handle_t timer) {
  if (called(timer).due != NEVER) return ESP_ERR_INVALID_STATE;
  timer->is_deleted = true;
  return ESP_OK;
}
bool esp_timer_is_active(esp_timer_handle_t timer) { return called(timer).due != NEVER; }

// -- Ticker ------------------------------------------------------------------------------------------

namespace {
// A function may give its Ticker another one.
void call_ticker(void* function) {
  const std::function<void()> called = *static_cast<std::function<void()>*>(function);
  called();
}
}  // namespace

void Ticker::begin(uint64_t microseconds, bool repeats, std::function<void()> function) {
  detach();
  function_ = std::move(function);
  const esp_timer_create_args_t values = {call_ticker, &function_, ESP_TIMER_TASK, "Ticker", false};
  esp_timer_create(&values, &timer_);
  start(called(timer_), microseconds, repeats, false);
}
void Ticker::detach() {
  if (!timer_) return;
  esp_timer_stop(timer_);
  esp_timer_delete(timer_);
  timer_ = nullptr;
}
bool Ticker::active() const { return timer_ && timer_->due != NEVER; }
