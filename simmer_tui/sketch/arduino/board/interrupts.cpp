#include "interrupts.h"

#include "../core/constants.h"
#include "exchange.h"
#include "hardware_timers.h"
#include "pins.h"

namespace board {

namespace {
struct Vector {
  InterruptFunction function;
  int mode;
  bool pending;
  int edges;  // those that it is meant for, so far
};
Vector vectors[PINS];
int pending_count = 0;
bool enabled = true, is_inside = false;
// After an interrupt the processor carries out an instruction of the program, of about two cycles, before the next
// one: so a program goes on, slowly, while a level interrupt comes again and again.
constexpr Nanoseconds INSTRUCTION = 125;
Nanoseconds instruction_end = 0;  // after a level interrupt

void clear(Vector& vector) {
  if (vector.pending) --pending_count;
  vector.pending = false;
}

void set(Vector& vector) {
  if (!vector.pending) ++pending_count;
  vector.pending = true;
}
}  // namespace

Nanoseconds off_since = NEVER, last_off = NEVER, last_on = 0;
uint64_t wakes = 0, pin_interrupts = 0;
Nanoseconds waited_for_sei = NEVER;

bool interrupts_on() { return enabled; }
bool in_interrupt() { return is_inside; }
bool has_interrupts() {
  for (const Vector& each : vectors)
    if (each.function.is_there()) return true;
  return has_alarms();
}

void set_interrupts(bool on) {
  if (on == enabled) return;
  enabled = on;
  if (on) {
    last_off = off_since;
    last_on = now;
    off_since = NEVER;
  } else {
    off_since = now;
  }
  plan_stop();
}

Nanoseconds next_interrupt() {
  if (enabled && alarm_waits()) return now;
  if (!enabled || pending_count == 0) return NEVER;
  return now < instruction_end ? instruction_end : now;
}

bool interrupt_waits() { return next_interrupt() <= now; }

namespace {
// The function of an interrupt, with the interrupts off.
template <class Call>
void run_function(Call call) {
  ++wakes;
  set_interrupts(false);
  pass(cost::INTERRUPT_ENTRY);
  const bool was_inside = is_inside;  // one that lets others in
  is_inside = true;
  call();
  is_inside = was_inside;
  pass(cost::INTERRUPT_EXIT);
}
}  // namespace

void run_interrupt() {
  if (alarm_waits()) {
    run_function(run_alarm_function);
    set_interrupts(true);
    return;
  }
  for (int pin = 0; pin < PINS; ++pin) {
    Vector& vector = vectors[pin];
    if (!vector.pending) continue;
    const bool by_level = vector.mode == LOW;
    if (by_level && input_level(pin)) {
      clear(vector);  // a level is not remembered
      continue;
    }
    if (!by_level) clear(vector);
    ++pin_interrupts;
    run_function([&] { vector.function.call(); });
    if (by_level) instruction_end = now + INSTRUCTION;
    set_interrupts(true);
    return;
  }
}

void attach(int pin, const InterruptFunction& function, int mode) {
  if (pin < 0 || pin >= PINS) return;
  clear(vectors[pin]);
  vectors[pin].function = function;
  vectors[pin].mode = mode;
  // A level that is there already counts: the interrupt comes at once, and again as long as the level lasts.
  if (function.is_there() && mode == LOW && !input_level(pin)) set(vectors[pin]);
  plan_stop();
}

void note_edge(int pin, bool high) {
  Vector& vector = vectors[pin];
  if (!vector.function.is_there()) return;
  if (vector.mode == LOW) {
    high ? clear(vector) : set(vector);
    return;
  }
  const bool meant = vector.mode == CHANGE || (vector.mode == RISING) == high;
  if (!meant) return;
  ++vector.edges;
  if (vector.pending) {
    make_room(2);
    tell(Told::LostEdge, pin, static_cast<int>(place));
    tell(Told::Edges, pin, vector.edges);
    return;
  }
  set(vector);
}

}  // namespace board
