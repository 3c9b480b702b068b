// The board's start, and its end.
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#ifndef _WIN32
#include <signal.h>
#endif
#if defined(__linux__)
#include <ucontext.h>
#endif

#include "../core/Arduino.h"
#include "clock.h"
#include "exchange.h"
#include "i2c.h"
#include "pins.h"
#include "tasks.h"

__attribute__((weak)) void serialEvent();
#if defined(SIMMER_MEGA) || defined(SIMMER_ESP32)
__attribute__((weak)) void serialEvent1();
__attribute__((weak)) void serialEvent2();
#endif
#if defined(SIMMER_MEGA)
__attribute__((weak)) void serialEvent3();
#endif

void serialEventRun() {
  if (serialEvent && Serial.available()) serialEvent();
#if defined(SIMMER_MEGA) || defined(SIMMER_ESP32)
  if (serialEvent1 && Serial1.available()) serialEvent1();
  if (serialEvent2 && Serial2.available()) serialEvent2();
#endif
#if defined(SIMMER_MEGA)
  if (serialEvent3 && Serial3.available()) serialEvent3();
#endif
}

// Called by the compiler's instrumentation in each basic block of the sketch.
extern "C" void __sanitizer_cov_trace_pc() {
  using namespace board;
  place = CALLED_AT;
  if (now + cost::BLOCK < next_stop)
    now += cost::BLOCK >> halving;
  else if (next_stop != NEVER)
    pass(cost::BLOCK);
}

namespace {
// The address at which it died, where that can be had.
#if defined(__linux__) && (defined(__x86_64__) || defined(__aarch64__))
constexpr bool KNOWS_ADDRESS = true;
uint32_t fault_address(const void* context) {
  const mcontext_t& machine = static_cast<const ucontext_t*>(context)->uc_mcontext;
#if defined(__x86_64__)
  return static_cast<uint32_t>(machine.gregs[REG_RIP]);
#else
  return static_cast<uint32_t>(machine.pc);
#endif
}
#else
constexpr bool KNOWS_ADDRESS = false;
uint32_t fault_address(const void*) { return 0; }
#endif

constexpr int NO_TASK = -1;
constexpr int TASK_RETURNED = 200, RESTARTED = 201, ABSENT = 202, FOREIGN = 203, NO_TICKS = 204, JUMPED_TO_START = 205, TIMER_MODE = 206;  // beyond the signals of all systems

// `task` is the number of another one that had a part in it.
void report_death(int number, uint32_t address, int task = NO_TASK) {
  // Only what is safe in a signal handler. First what the sketch did before; the simulator finds the line by the addresses.
  board::send_told(board::Reason::Full);
  char text[80];
  const uint32_t clock = static_cast<uint32_t>(board::now / board::MICROSECOND);
  const int size = avr_snprintf(text, sizeof text, "simmer-board died %d %lu %lu %lu %d\n", number, address, board::place, clock, task);
  std::fwrite(text, 1, static_cast<size_t>(size), stderr);
  std::fflush(stderr);
  std::_Exit(3);
}

#ifndef _WIN32
// A stack of its own: a sketch that calls itself without end has filled the other.
char handler_stack[1 << 16];
void died(int number, siginfo_t*, void* context) {
  const uint32_t address = fault_address(context);
  // `void (*restart)() = 0; restart();`
  const bool is_jump = KNOWS_ADDRESS && number == SIGSEGV && address == 0;
  report_death(is_jump ? JUMPED_TO_START : number, address);
}
void listen_for_death(int number) {
  stack_t stack = {};
  stack.ss_sp = handler_stack;
  stack.ss_size = sizeof handler_stack;
  sigaltstack(&stack, nullptr);
  struct sigaction action = {};
  action.sa_sigaction = died;
  action.sa_flags = SA_SIGINFO | SA_ONSTACK;
  sigaction(number, &action, nullptr);
}
#else
void died(int number) { report_death(number, 0); }
void listen_for_death(int number) { std::signal(number, died); }
#endif

// A sketch that calls exit(): the board has no system to go back to.
void left() { report_death(0, 0); }

void run_loop() {
  if (sketch_start.loop) sketch_start.loop();
  board::pass(board::cost::LOOP);
  serialEventRun();
}

#if defined(SIMMER_ESP32)
void run_sketch(void*) {
  sketch_start.setup();
  board::begin_loop();
  for (;;) run_loop();
}
#endif

// "--drives 5,6,7": the pins of a list, each passed to a function.
void for_pins(const char* list, void (*mark)(int)) {
  for (const char* at = list; *at;) {
    char* end = nullptr;
    mark(static_cast<int>(std::strtol(at, &end, 10)));
    at = *end ? end + 1 : end;
  }
}
}  // namespace

#if defined(SIMMER_ESP32)
EspClass ESP;
void EspClass::restart() {
  report_death(RESTARTED, CALLED_AT - 1);
  for (;;) {}
}
#endif
#if !defined(SIMMER_ESP32)
TimerRateRegister& TimerRateRegister::operator=(int value) {
  if (value & ~7) report_death(TIMER_MODE, CALLED_AT - 1);
  value_ = static_cast<uint8_t>(value);
  return *this;
}
#endif
void board::report_return() { report_death(TASK_RETURNED, 0); }
void board::report_absent(uint32_t at) { report_death(ABSENT, at); }
void board::report_foreign(uint32_t at, const Task& holder) { report_death(FOREIGN, at, holder.number); }
void board::report_no_ticks(uint32_t at) { report_death(NO_TICKS, at); }
void board::start_scheduler() { start_tasks(run_loop); }

int main(int count, char** arguments) {
  for (int number : {SIGSEGV, SIGFPE, SIGILL, SIGABRT}) listen_for_death(number);
#ifndef _WIN32
  for (int number : {SIGBUS, SIGTRAP}) listen_for_death(number);
#endif
  for (int at = 1; at + 1 < count; at += 2) {
    if (!std::strcmp(arguments[at], "--drives")) for_pins(arguments[at + 1], board::mark_driving);
    if (!std::strcmp(arguments[at], "--triggers")) for_pins(arguments[at + 1], board::mark_trigger);
    if (!std::strcmp(arguments[at], "--steps")) for_pins(arguments[at + 1], board::mark_stepping);
    if (!std::strcmp(arguments[at], "--boot")) board::boot = std::strtoull(arguments[at + 1], nullptr, 10);
    if (!std::strcmp(arguments[at], "--asked")) for_pins(arguments[at + 1], board::mark_asked);
    if (!std::strcmp(arguments[at], "--mpu6050")) board::add_mpu6050(arguments[at + 1]);
    if (!std::strcmp(arguments[at], "--vl53l0x")) board::add_vl53l0x(arguments[at + 1]);
  }
  std::atexit(left);
  std::signal(SIGINT, SIG_IGN);  // Ctrl-C is for the simulator, which ends its boards
  board::begin_clock();
  board::open_channel();
  board::exchange(board::Reason::Horizon);
  if (sketch_start.main) {
    sketch_start.main();
    noInterrupts();
    for (;;) board::pass(board::MILLISECOND);
  }
#if defined(SIMMER_ESP32)
  board::create_task(run_sketch, "", nullptr, 1, 1);
  board::start_tasks(board::wait_for_tick);
#endif
  sketch_start.setup();
  // A sketch with FreeRTOS has its loop() in the idle task.
  if (board::uses_tasks()) board::start_tasks(run_loop);
  for (;;) run_loop();
}
