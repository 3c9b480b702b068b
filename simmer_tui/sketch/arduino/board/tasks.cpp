#include "tasks.h"

#include <cstring>

#include "exchange.h"
#include "interrupts.h"
#include "task_mistakes.h"

namespace board {

namespace {
Task idle_task;  // loop(), on the stack of the process
std::deque<Task> made;  // tasks stay where they are
Task* running = &idle_task;
Task* last_blocked = nullptr;
bool is_used = false, has_begun = false, loop_has_begun = false, switch_asked = false;
unsigned int held = 0;  // vTaskSuspendAll() and its kind, one in the other
uint64_t ticks = 0, held_ticks = 0, turns = 0;
Nanoseconds next_tick = NEVER;
// The task of each core; none where the core is idle. An AVR has the idle task among the others.
Task* chosen[CORES] = {};
Nanoseconds idle_since = 0, last_idle = 0;
Nanoseconds share_end = NEVER;  // the end of a core's turn, while both work
constexpr bool IDLE_IS_A_TASK = CORES == 1;
// A pass of loop() that takes no longer has nothing in it.
constexpr Nanoseconds EMPTY_LOOP = 2 * (cost::LOOP + cost::BLOCK) + cost::SERIAL_LOOK;

bool is_before(const Task& one, const Task& other) {
  return one.priority != other.priority ? one.priority > other.priority : one.turn < other.turn;
}

bool is_waiting(const Task& task, const void* key) {
  return task.state == TaskState::Blocked && task.awaited.key == key;
}

bool is_chosen(const Task& task) {
  for (const Task* each : chosen)
    if (each == &task) return true;
  return false;
}

bool may_be_chosen(const Task& task) {
  if (task.state != TaskState::Ready || is_chosen(task)) return false;
  if (task.core != ANY_CORE) return !chosen[task.core];
  return true;
}

// The core of a task that may run on each: a free one for which no other task waits, if there is one.
int free_core() {
  int found = ANY_CORE;
  for (int core = CORES - 1; core >= 0; --core) {
    if (chosen[core]) continue;
    bool is_wanted = false;
    for (const Task& each : made) is_wanted |= each.core == core && each.state == TaskState::Ready;
    if (found == ANY_CORE || !is_wanted) found = core;
  }
  return found;
}

// Give each core the most urgent task that it may have.
void choose() {
  for (Task*& each : chosen) each = nullptr;
  for (int count = 0; count < CORES; ++count) {
    Task* best = IDLE_IS_A_TASK ? &idle_task : nullptr;
    for (Task& each : made)
      if (may_be_chosen(each) && (!best || is_before(each, *best))) best = &each;
    if (!best) break;
    chosen[best->core == ANY_CORE ? free_core() : best->core] = best;
  }
  if (!chosen[0]) last_idle = now;
}

bool both_work() { return CORES > 1 && chosen[0] && chosen[CORES - 1]; }

Task& next_to_run() {
  choose();
  if (is_chosen(*running)) return *running;
  for (Task* each : chosen)
    if (each) return *each;
  return idle_task;
}

// The other core goes on.
void share_time() {
#if defined(SIMMER_ESP32)
  halving = both_work();
#endif
  share_end = both_work() ? now + SHARE : NEVER;
}

void go_to(Task& next) {
  Task& before = *running;
  if (&before == &next) return;
  before.waiting = waiting;
  before.last_wait = last_wait;
  before.place = place;
  before.interrupts_on = interrupts_on();
  if (before.state == TaskState::Blocked) last_blocked = &before;
  if (!is_chosen(before)) before.turn = ++turns;
  before.ready_since = now;
  if (!IDLE_IS_A_TASK && &before == &idle_task) waited += now - idle_since;
  if (&next == &idle_task) idle_since = now;
  before.left = now;
  next.away += now - next.left;
  running = &next;
  waiting = next.waiting;
  last_wait = next.last_wait;
  place = next.place;
  set_interrupts(next.interrupts_on);
  share_time();
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
  Task& next = next_to_run();
  share_time();
  plan_stop();
  go_to(next);
}

void count_ticks(uint64_t count) {
  ticks += count;
  for (Task& each : made)
    if (each.state == TaskState::Blocked && each.wake <= ticks) make_ready(each);
}

// The interrupt of the tick. Ticks that come while interrupts are off merge, as the flags of pins do.
void run_tick() {
  while (next_tick <= now) next_tick += TICK;
  ++wakes;
  set_interrupts(false);
  pass(cost::TICK);
  if (held) {
    ++held_ticks;
  } else {
    count_ticks(1);
    // All equals of those that run have their turn.
    Task* before[CORES];
    for (int core = 0; core < CORES; ++core) {
      before[core] = chosen[core];
      if (chosen[core]) chosen[core]->turn = ++turns;
    }
    choose();
    for (int core = 0; core < CORES; ++core) switch_asked |= chosen[core] != before[core];
    look_at_tasks();
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
int running_core() { return running == chosen[CORES - 1] ? CORES - 1 : 0; }

void wait_for_tick() {
  pass_until(next_tick);
  waited += now - idle_since;
  idle_since = now;
}

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
    if (IDLE_IS_A_TASK) chosen[0] = &idle_task;
    next_tick = now + TICK;
    idle_since = now;
    set_interrupts(true);
    ask_for_switch();
  }
  for (;;) {
    const Nanoseconds begin = now;
    idle();
    if (!IDLE_IS_A_TASK) continue;
    if (now - begin <= EMPTY_LOOP) waited += now - begin;
    // The idle task gives way to others of its priority.
    for (const Task& each : made)
      if (each.state == TaskState::Ready && each.priority == 0) {
        yield_task();
        break;
      }
  }
}

Task* create_task(void (*function)(void*), const char* name, void* argument, unsigned int priority, int core) {
  Task* task = nullptr;
  for (Task& each : made)
    if (each.state == TaskState::Deleted && &each != running && !is_chosen(each)) task = &each;
  const uint8_t number = task ? task->number : static_cast<uint8_t>(made.size() < 255 ? made.size() + 1 : 255);
  if (!task) task = &made.emplace_back();
  task->state = TaskState::Ready;
  task->function = function;
  task->argument = argument;
  std::memset(task->name, 0, sizeof task->name);
  if (name) std::strncpy(task->name, name, sizeof task->name - 1);
  task->number = number;
  task->priority = task->own_priority = priority < PRIORITIES ? priority : PRIORITIES - 1;
  task->core = core >= 0 && core < CORES ? core : ANY_CORE;
  task->mutexes = 0;
  task->turn = ++turns;
  task->wake = NEVER;
  task->awaited = Awaited();
  task->ready_since = task->works_since = now;
  task->is_told = task->is_told_passed = task->is_told_hungry = false;
  task->fed_at = NEVER;
  task->notification = 0;
  task->is_notified = false;
  task->waiting = task->last_wait = Wait();
  task->place = 0;
  task->interrupts_on = true;
  task->critical_depth = 0;
  task->away = 0;
  task->left = now;
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

namespace {
// A task that is no longer ready gives its core to another one.
void leave_core(const Task& task) {
  if (&task == running)
    switch_tasks();
  else if (is_chosen(task))
    ask_for_switch();
}
}  // namespace

void delete_task(Task& task) {
  if (&task == &idle_task) return;
  task.state = TaskState::Deleted;
  leave_core(task);
}

void suspend_task(Task& task) {
  if (&task == &idle_task) return;
  task.state = TaskState::Suspended;
  leave_core(task);
}

void make_ready(Task& task) {
  task.state = TaskState::Ready;
  task.wake = NEVER;
  task.awaited = Awaited();
  task.ready_since = task.works_since = now;
  task.turn = ++turns;
}

void set_priority(Task& task, unsigned int priority) {
  task.priority = priority < PRIORITIES ? priority : PRIORITIES - 1;
  ask_for_switch();
}

void block(const Awaited& awaited, uint64_t wake) {
  if (is_idle()) {
    // loop() may not wait. Here it looks again at each tick, while tasks run.
    pass_until(has_begun ? next_tick + 1 : now + TICK);
    if (!has_begun) ++ticks;
    return;
  }
  running->awaited = awaited;
  running->wake = wake;
  running->state = TaskState::Blocked;
  switch_tasks();
}

Task* first_waiting(const void* key) {
  Task* first = nullptr;
  for (Task& each : made)
    if (is_waiting(each, key) && (!first || is_before(each, *first))) first = &each;
  return first;
}

bool wake_first(const void* key) {
  Task* first = first_waiting(key);
  if (!first) return false;
  make_ready(*first);
  return is_urgent(*first);
}

bool is_urgent(const Task& task) {
  for (int core = 0; core < CORES; ++core)
    if ((task.core == ANY_CORE || task.core == core) && (!chosen[core] || task.priority > chosen[core]->priority)) return true;
  return false;
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

std::deque<Task>& all_tasks() { return made; }
Task* task_on(int core) { return chosen[core]; }
bool is_on_core(const Task& task) { return is_chosen(task); }
Task* idle_loop() { return IDLE_IS_A_TASK ? &idle_task : nullptr; }
void begin_loop() { loop_has_begun = true; }
bool is_loop(const Task& task) { return loop_has_begun && &task == &made.front(); }
Nanoseconds idle_at() { return last_idle; }

Nanoseconds next_task_stop() {
  if (!has_begun || !interrupts_on()) return NEVER;
  if (switch_asked && !held) return now;
  return share_end < next_tick ? share_end : next_tick;
}

bool run_tasks() {
  if (next_task_stop() > now) return false;
  if (next_tick <= now) {
    run_tick();
  } else if (switch_asked && !held) {
    switch_tasks();
  } else {
    // The turn of the other core.
    Task& other = running == chosen[0] ? *chosen[CORES - 1] : *chosen[0];
    go_to(other);
  }
  return true;
}

}  // namespace board
