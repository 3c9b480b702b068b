#include "tasks.h"

#include <cstring>
#include <deque>

#include "exchange.h"
#include "interrupts.h"

namespace board {

namespace {
Task idle_task;  // loop(), on the stack of the process
std::deque<Task> made;  // tasks stay where they are
Task* running = &idle_task;
Task* last_blocked = nullptr;
bool is_used = false, has_begun = false, switch_asked = false;
unsigned int held = 0;  // vTaskSuspendAll() and its kind, one in the other
uint64_t ticks = 0, held_ticks = 0, turns = 0;
Nanoseconds next_tick = NEVER;
// A pass of loop() that takes no longer has nothing in it.
constexpr Nanoseconds EMPTY_LOOP = 2 * (cost::LOOP + cost::BLOCK) + cost::SERIAL_LOOK;

bool is_before(const Task& one, const Task& other) {
  return one.priority != other.priority ? one.priority > other.priority : one.turn < other.turn;
}

Task& next_to_run() {
  Task* best = &idle_task;
  for (Task& each : made)
    if (each.state == TaskState::Ready && is_before(each, *best)) best = &each;
  return *best;
}

void go_to(Task& next) {
  Task& before = *running;
  if (&before == &next) return;
  before.waiting = waiting;
  before.last_wait = last_wait;
  before.place = place;
  before.interrupts_on = interrupts_on();
  if (before.state == TaskState::Blocked) last_blocked = &before;
  before.turn = ++turns;
  running = &next;
  waiting = next.waiting;
  last_wait = next.last_wait;
  place = next.place;
  set_interrupts(next.interrupts_on);
  plan_stop();
  before.context.switch_to(next.context);
}

// Save the registers of one task, look for the next one, and load its registers.
void switch_tasks() {
  switch_asked = false;
  const bool were_on = interrupts_on();
  set_interrupts(false);
  pass(cost::TASK_SWITCH);
  set_interrupts(were_on);
  go_to(next_to_run());
}

void count_ticks(uint64_t count) {
  ticks += count;
  for (Task& each : made)
    if (each.state == TaskState::Blocked && each.wake <= ticks) make_ready(each);
}

// The interrupt of the tick. Ticks that come while interrupts are off merge, as the flags of pins do.
void run_tick() {
  while (next_tick <= now) next_tick += TICK;
  set_interrupts(false);
  pass(cost::TICK);
  if (held) {
    ++held_ticks;
  } else {
    count_ticks(1);
    running->turn = ++turns;
    switch_asked = &next_to_run() != running;
  }
  set_interrupts(true);
}

void begin_task() {
  running->function(running->argument);
  report_return();
}

void tell_name(const Task& task) {
  for (unsigned int at = 0; at < sizeof task.name; at += 4) {
    uint32_t part = 0;
    std::memcpy(&part, task.name + at, 4);
    tell(Told::TaskName, task.number, static_cast<int>(part));
  }
}
}  // namespace

bool use_tasks() { return is_used = true; }
bool uses_tasks() { return is_used; }
bool tasks_run() { return has_begun; }
uint64_t tick_count() { return ticks; }
Task& running_task() { return *running; }
bool is_idle() { return running == &idle_task; }

namespace {
// While all tasks wait, the board is where the last one waits.
bool shows_blocked() {
  return is_idle() && waiting.kind == Waits::Not && last_blocked && last_blocked->state == TaskState::Blocked;
}
}  // namespace

const Wait& shown_wait() { return shows_blocked() ? last_blocked->waiting : waiting; }
uint8_t waiting_task() { return shows_blocked() ? last_blocked->number : running->number; }

void start_tasks(void (*idle)()) {
  if (!has_begun) {
    has_begun = true;
    next_tick = now + TICK;
    set_interrupts(true);
    ask_for_switch();
  }
  for (;;) {
    const Nanoseconds begin = now;
    idle();
    if (now - begin <= EMPTY_LOOP) waited += now - begin;
    // The idle task gives way to others of its priority.
    for (const Task& each : made)
      if (each.state == TaskState::Ready && each.priority == 0) {
        yield_task();
        break;
      }
  }
}

Task* create_task(void (*function)(void*), const char* name, void* argument, unsigned int priority) {
  Task* task = nullptr;
  for (Task& each : made)
    if (each.state == TaskState::Deleted && &each != running) task = &each;
  const uint8_t number = task ? task->number : static_cast<uint8_t>(made.size() < 255 ? made.size() + 1 : 255);
  if (!task) task = &made.emplace_back();
  task->state = TaskState::Ready;
  task->function = function;
  task->argument = argument;
  std::memset(task->name, 0, sizeof task->name);
  if (name) std::strncpy(task->name, name, sizeof task->name - 1);
  task->number = number;
  task->priority = task->own_priority = priority < PRIORITIES ? priority : PRIORITIES - 1;
  task->mutexes = 0;
  task->turn = ++turns;
  task->wake = NEVER;
  task->waits_for = nullptr;
  task->notification = 0;
  task->is_notified = false;
  task->waiting = task->last_wait = Wait();
  task->place = 0;
  task->interrupts_on = true;
  task->critical_depth = 0;
  task->context.prepare(begin_task);
  tell_name(*task);
  return task;
}

Task* task_named(const char* name) {
  for (Task& each : made)
    if (each.state != TaskState::Deleted && !std::strcmp(each.name, name)) return &each;
  return nullptr;
}

unsigned int task_total() {
  unsigned int count = 1;
  for (const Task& each : made) count += each.state != TaskState::Deleted;
  return count;
}

void delete_task(Task& task) {
  if (&task == &idle_task) return;
  task.state = TaskState::Deleted;
  if (&task == running) switch_tasks();
}

void suspend_task(Task& task) {
  if (&task == &idle_task) return;
  task.state = TaskState::Suspended;
  if (&task == running) switch_tasks();
}

void make_ready(Task& task) {
  task.state = TaskState::Ready;
  task.wake = NEVER;
  task.waits_for = nullptr;
  task.turn = ++turns;
}

void set_priority(Task& task, unsigned int priority) {
  task.priority = priority < PRIORITIES ? priority : PRIORITIES - 1;
  ask_for_switch();
}

void block(const void* waits_for, uint64_t wake) {
  if (is_idle()) {
    // loop() may not wait. Here it looks again at each tick, while tasks run.
    pass_until(has_begun ? next_tick + 1 : now + TICK);
    if (!has_begun) ++ticks;
    return;
  }
  running->waits_for = waits_for;
  running->wake = wake;
  running->state = TaskState::Blocked;
  switch_tasks();
}

Task* first_waiting(const void* waits_for) {
  Task* first = nullptr;
  for (Task& each : made)
    if (each.state == TaskState::Blocked && each.waits_for == waits_for && (!first || is_before(each, *first)))
      first = &each;
  return first;
}

bool wake_first(const void* waits_for) {
  Task* first = first_waiting(waits_for);
  if (!first) return false;
  make_ready(*first);
  return first->priority > running->priority;
}

void ask_for_switch() {
  switch_asked = has_begun;
  if (!switch_asked) return;
  plan_stop();
  if (next_task_stop() <= now) service();
}

void yield_task() {
  running->turn = ++turns;
  ask_for_switch();
}

void hold_switches(bool hold) {
  if (hold) {
    ++held;
    return;
  }
  if (held == 0 || --held) return;
  count_ticks(held_ticks);
  held_ticks = 0;
  ask_for_switch();
}

void enter_critical() {
  Task& task = *running;
  if (task.critical_depth++ == 0) task.saved_interrupts = interrupts_on();
  set_interrupts(false);
}

void exit_critical() {
  Task& task = *running;
  if (task.critical_depth == 0 || --task.critical_depth || !task.saved_interrupts) return;
  set_interrupts(true);
  service();
}

bool switches_are_held() { return held != 0; }

Nanoseconds next_task_stop() {
  if (!has_begun || !interrupts_on()) return NEVER;
  return switch_asked && !held ? now : next_tick;
}

bool run_tasks() {
  if (next_task_stop() > now) return false;
  if (next_tick <= now)
    run_tick();
  else
    switch_tasks();
  return true;
}

}  // namespace board
