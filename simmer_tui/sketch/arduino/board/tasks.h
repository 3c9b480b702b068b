// Tasks of FreeRTOS on the board's one clock. A task runs until it waits, or until the tick or a call makes another one
// run that is more urgent. Switches happen only where time passes, at simulated times.
#pragma once
#include <cstdint>
#include <deque>

#include "clock.h"
#include "context.h"

namespace board {

#if defined(SIMMER_ESP32)
// An ESP32 has two cores. They share one timeline: while both have work they take turns of 20 us, in each of which
// everything takes half of its time. So both go on as fast as alone, and their clock never goes back.
constexpr int CORES = 2;
constexpr Nanoseconds SHARE = 20 * MICROSECOND;
constexpr Nanoseconds TICK = MILLISECOND;
constexpr unsigned int PRIORITIES = 25;
#else
// The watchdog's oscillator of an AVR has 128 kHz: 2,048 periods.
constexpr int CORES = 1;
constexpr Nanoseconds SHARE = NEVER;
constexpr Nanoseconds TICK = 16 * MILLISECOND;
constexpr unsigned int PRIORITIES = 4;
#endif
constexpr int ANY_CORE = -1;

enum class TaskState : uint8_t { Ready, Blocked, Suspended, Deleted };

struct Task;
// Of a mutex: the task that holds it, and the place in the sketch where it took it.
struct Holder {
  Task* task = nullptr;
  uint32_t taken_at = 0;
};
// What a task waits for; the last four are for reports alone.
enum class WaitsFor : uint8_t {
  Time = 0, Item = 1, Room = 2, Semaphore = 3, Mutex = 4, Notification = 5, Bits = 6, Resume = 7, Holder = 8, Others = 9,
  Deleted = 10
};
struct Awaited {
  WaitsFor kind = WaitsFor::Time;
  const void* key = nullptr;  // those that give it look for the tasks with this one
  uint32_t at = 0;            // the place in the sketch
  const Holder* mutex = nullptr;
};

struct Task {
  Context context;
  void (*function)(void*) = nullptr;
  void* argument = nullptr;
  char name[16] = "";
  uint8_t number = 0;  // 0 is loop(): records have it
  TaskState state = TaskState::Ready;
  unsigned int priority = 0, own_priority = 0;  // `own` is without what it inherits by a mutex
  unsigned int mutexes = 0;                     // that it holds
  int core = ANY_CORE;  // where it may run
  uint64_t turn = 0;              // the smallest of those with one priority runs next
  uint64_t wake = NEVER;          // the tick at which it goes on at the latest
  Awaited awaited;
  Nanoseconds ready_since = 0;    // it has not run since
  Nanoseconds works_since = 0;    // it has not waited since
  bool is_told = false;           // that others cannot pass it
  bool is_told_passed = false;    // that it has not run
  bool is_told_hungry = false;    // that its watchdog ends the board
  Nanoseconds fed_at = NEVER;     // the last time at which it told its watchdog that it goes on; NEVER if it has none
  uint32_t notification = 0;
  bool is_notified = false;
  // State of the board, while other tasks run.
  Wait waiting, last_wait;
  uint32_t place = 0;
  bool interrupts_on = true, saved_interrupts = true;
  unsigned int critical_depth = 0;
  Nanoseconds away = 0;  // time that others had
  Nanoseconds left = 0;
};

bool use_tasks();                // called before setup() by sketches with FreeRTOS
bool uses_tasks();
bool tasks_run();                // true after the scheduler's start
[[noreturn]] void start_tasks(void (*idle)());  // `idle` is called again and again while all others wait
[[noreturn]] void start_scheduler();            // with loop() as the idle task
void report_return();                           // a task's function has returned: the board's end
void report_absent(uint32_t at);                // a queue or its kind is not there: the board's end
void report_foreign(uint32_t at, const Task& holder);  // a mutex is given back by another task: the board's end
void report_no_ticks(uint32_t at);              // an ESP32 ends at a period of no tick
uint64_t tick_count();
Task& running_task();
bool is_idle();                  // true in loop(), and before the start of the scheduler
const Wait& shown_wait();        // the call in which the sketch waits
uint8_t waiting_task();          // the task that it belongs to

Task* create_task(void (*function)(void*), const char* name, void* argument, unsigned int priority,
                  int core = ANY_CORE);
int running_core();
void wait_for_tick();  // what an idle ESP32 does
Task* task_named(const char* name);
unsigned int task_total();    // those that are there, loop() included
void delete_task(Task& task);
void suspend_task(Task& task);
void make_ready(Task& task);
void set_priority(Task& task, unsigned int priority);

// The running task waits until it is woken, or for a tick; it looks itself for what it waits for.
void block(const Awaited& awaited, uint64_t wake);
Task* first_waiting(const void* key);  // the most urgent one, of several the one that came first
// Wake the first task that waits. Returns true if it is more urgent than the running one.
bool wake_first(const void* key);
bool is_urgent(const Task& task);  // more than one that runs where it may

void ask_for_switch();           // other tasks may run, as soon as interrupts are on
void yield_task();               // those with the same priority too
void hold_switches(bool hold);
bool switches_are_held();
void enter_critical();
void exit_critical();

// For reports.
std::deque<Task>& all_tasks();   // all but the idle one, those that were deleted too
Task* task_on(int core);         // the one that runs there; none while it is idle
bool is_on_core(const Task& task);
Task* idle_loop();               // the idle task, if it is loop()
void begin_loop();               // setup() of an ESP32 is over
bool is_loop(const Task& task);  // true for the task of an ESP32 that calls loop()
Nanoseconds idle_at();           // the last time at which core 0 was idle

// For the clock.
Nanoseconds next_task_stop();    // the time at which a tick or a switch is due
bool run_tasks();                // true if one was due, and is done

}  // namespace board
