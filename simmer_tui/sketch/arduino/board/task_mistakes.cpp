#include "task_mistakes.h"

#include <algorithm>
#include <vector>

#include "exchange.h"
#include "interrupts.h"
#include "mistakes.h"

namespace board {

namespace {
// Judged: a robot that nobody drives for a second has a mistake, and no usual wait is as long.
constexpr Nanoseconds TOO_LONG = SECOND;
// CONFIG_ESP_TASK_WDT_TIMEOUT_S of Arduino's core: the watchdog of the idle task of core 0.
constexpr Nanoseconds WATCHDOG = 5 * SECOND;
// Judged: no run of a maze lasts as long. vTaskDelay(portMAX_DELAY) of an AVR lasts 17 minutes.
constexpr uint64_t FOR_EVER = 600 * SECOND / TICK;
constexpr int NEVER_WAITS = 1, ON_CORE_0 = 2;  // flags of a task that others cannot pass
constexpr int HAS_INTERRUPTS = 1, LOOP_GOES_ON = 2, SETUP_GOES_ON = 4;  // flags of what is left while others wait

// Tasks that wait for ever: one notice a board. A circle says more than that all wait.
bool circle_is_told = false, all_are_told = false;
Nanoseconds all_wait_since = NEVER;
// Sums over the tasks that waited for ever whenever that was told, and what for.
std::vector<uint64_t> told_waits;
constexpr size_t MOST_TOLD_WAITS = 100;  // more than anybody reads
bool has_watchdog = CORES > 1;
Nanoseconds fed_within = WATCHDOG;
bool watchdog_restarts = true;

bool waits_for_ever(const Task& task) {
  if (task.state == TaskState::Suspended) return true;
  return task.state == TaskState::Blocked && (task.wake == NEVER || task.wake - tick_count() > FOR_EVER);
}

void tell_wait(const Task& task, const Awaited& awaited) {
  const bool is_suspended = task.state == TaskState::Suspended;
  make_room(3);
  tell(Told::Detail, static_cast<int>(is_suspended ? WaitsFor::Resume : awaited.kind), static_cast<int>(awaited.at), now,
       task.number);
  if (awaited.mutex && awaited.mutex->task)
    tell(Told::Detail, static_cast<int>(WaitsFor::Holder), static_cast<int>(awaited.mutex->taken_at), now,
         awaited.mutex->task->number);
}

void tell_mistake(Mistake kind, const Task& task, uint32_t at) {
  tell(Told::Mistake, static_cast<int>(kind), static_cast<int>(at), now, task.number);
  exchange(Reason::Output);
}

void look_for_waits() {
  // loop() may go on: the simulator knows whether it can wake others.
  bool is_waited_for = false, loop_goes_on = idle_loop() != nullptr;
  for (const Task& each : all_tasks()) {
    if (each.state == TaskState::Deleted) continue;
    if (!waits_for_ever(each)) {
      if (is_loop(each)) {
        loop_goes_on = true;
        continue;
      }
      all_wait_since = NEVER;
      return;
    }
    is_waited_for |= each.state == TaskState::Blocked && each.awaited.kind != WaitsFor::Time;
  }
  if (!is_waited_for) {
    all_wait_since = NEVER;
    return;
  }
  if (all_wait_since == NEVER) all_wait_since = now;
  if (now - all_wait_since < TOO_LONG) return;
  all_are_told = true;
  for (const Task& each : all_tasks())
    if (waits_for_ever(each) && (each.state == TaskState::Suspended || each.awaited.kind != WaitsFor::Time))
      tell_wait(each, each.awaited);
  // So could the function of an interrupt.
  make_room(2);
  tell(Told::Detail, static_cast<int>(WaitsFor::Others), (has_interrupts() ? HAS_INTERRUPTS : 0) | (loop_goes_on ? LOOP_GOES_ON : 0));
  tell_mistake(Mistake::AllWait, running_task(), place);
}

// One that waits for what others give, for so long that a report may ask who they are.
bool is_left_waiting(const Task& task) {
  return task.state == TaskState::Blocked && task.awaited.kind != WaitsFor::Time && waits_for_ever(task) &&
         now - task.left >= TOO_LONG;
}

// The simulator reads off the sketch whether a task that is left can end such a wait: it is told all tasks again when
// others wait than before.
void look_for_lone_waits() {
  if (all_wait_since != NEVER && !all_are_told) return;  // that all wait says more
  if (told_waits.size() >= MOST_TOLD_WAITS) return;
  const std::deque<Task>& tasks = all_tasks();
  if (std::none_of(tasks.begin(), tasks.end(), is_left_waiting)) return;
  uint64_t waits = 0;
  bool loop_goes_on = idle_loop() != nullptr, setup_goes_on = false;
  for (const Task& each : tasks) {
    const bool is_left = is_left_waiting(each), is_deleted = each.state == TaskState::Deleted;
    if (!idle_loop() && &each == &tasks.front() && !is_left && !is_deleted)
      (is_loop(each) ? loop_goes_on : setup_goes_on) = true;
    // Numbers of FNV-1a.
    waits = (waits ^ (is_left ? each.awaited.at : is_deleted)) * 1099511628211u;
  }
  for (uint64_t each : told_waits)
    if (each == waits) return;
  told_waits.push_back(waits);
  make_room(3 * task_total() + 2);
  for (const Task& each : tasks) {
    if (each.state == TaskState::Deleted) continue;
    if (is_left_waiting(each))
      tell_wait(each, each.awaited);
    else
      tell(Told::Detail, static_cast<int>(WaitsFor::Time), 0, now, each.number);
  }
  tell(Told::Detail, static_cast<int>(WaitsFor::Others),
       (has_interrupts() ? HAS_INTERRUPTS : 0) | (loop_goes_on ? LOOP_GOES_ON : 0) | (setup_goes_on ? SETUP_GOES_ON : 0));
  tell_mistake(Mistake::SomeWait, running_task(), place);
}

uint32_t place_of(const Task& task) { return &task == &running_task() ? place : task.place; }

bool is_passed_over(const Task& task) {
  return task.state == TaskState::Ready && !task.is_told_passed && !is_on_core(task) &&
         now - task.ready_since >= TOO_LONG;
}

// A task that runs on a core where others may not.
void look_for_starved(Task& runs, int core) {
  if (runs.is_told) return;
  const auto is_starved = [&](const Task& each) {
    return is_passed_over(each) && each.priority < runs.priority && (each.core == ANY_CORE || each.core == core);
  };
  Task* idle = idle_loop();
  bool is_found = idle && is_starved(*idle);
  for (const Task& each : all_tasks()) is_found |= is_starved(each);
  if (!is_found) return;
  runs.is_told = true;
  const auto tell_task = [](Task& each) {
    each.is_told_passed = true;
    tell(Told::Detail, 0, static_cast<int>(each.place), now, each.number);
  };
  make_room(task_total() + 2);
  for (Task& each : all_tasks())
    if (is_starved(each)) tell_task(each);
  if (idle && is_starved(*idle)) tell_task(*idle);
  const bool never_waits = now - runs.works_since >= TOO_LONG;
  tell(Told::Detail, (never_waits ? NEVER_WAITS : 0) | (has_watchdog && core == 0 ? ON_CORE_0 : 0), -1);
  tell_mistake(Mistake::Starved, runs, place_of(runs));
}

void look_at_watchdog() {
  Task* runs = task_on(0);
  if (!has_watchdog || !runs || runs->is_told || now - idle_at() < WATCHDOG) return;
  runs->is_told = true;
  make_room(1);
  tell_mistake(Mistake::Watchdog, *runs, place_of(*runs));
}

void look_for_hungry() {
  for (Task& each : all_tasks()) {
    if (each.fed_at == NEVER || each.state == TaskState::Deleted || now - each.fed_at < fed_within) continue;
    each.fed_at = NEVER;
    if (each.is_told_hungry) continue;
    each.is_told_hungry = true;
    make_room(2);
    tell(Told::Detail, watchdog_restarts, static_cast<int>(fed_within / MILLISECOND), now, each.number);
    tell_mistake(Mistake::NotFed, each, place_of(each));
  }
}
}  // namespace

void look_for_circle(const Awaited& awaited) {
  if (circle_is_told || is_idle()) return;
  const Task* const first = &running_task();
  unsigned int length = 0;
  for (const Awaited* each = &awaited;; ++length) {
    const Task* holder = each->mutex ? each->mutex->task : nullptr;
    if (!holder || length > all_tasks().size()) return;
    if (holder == first || holder->state == TaskState::Deleted) break;
    if (holder->state != TaskState::Blocked || !waits_for_ever(*holder)) return;
    each = &holder->awaited;
  }
  circle_is_told = true;
  const Task* task = first;
  for (const Awaited* each = &awaited;; each = &task->awaited) {
    tell_wait(*task, *each);
    task = each->mutex->task;
    if (length-- == 0) break;
  }
  make_room(2);
  tell(Told::Detail, static_cast<int>(WaitsFor::Deleted), task->state == TaskState::Deleted);
  tell_mistake(Mistake::Circle, *first, awaited.at);
}

void watch_core_0(bool on) { has_watchdog = on; }
void watch_tasks(uint32_t milliseconds, bool restarts) {
  fed_within = milliseconds * MILLISECOND;
  watchdog_restarts = restarts;
}

void look_at_tasks() {
  if (!circle_is_told && !all_are_told) look_for_waits();
  look_for_lone_waits();
  for (int core = 0; core < CORES; ++core)
    if (Task* runs = task_on(core)) look_for_starved(*runs, core);
  look_at_watchdog();
  look_for_hungry();
}

}  // namespace board
