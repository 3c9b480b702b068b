#include "interrupts.h"

#include "../core/constants.h"
#include "exchange.h"
#include "pins.h"

namespace board {

namespace {
struct Vector {
  void (*function)();
  int mode;
  bool pending;
  int edges;  // those that it is meant for, so far
};
Vector vectors[PINS];
int pending_count = 0;
bool enabled = true;

void clear(Vector& vector) {
  if (vector.pending) --pending_count;
  vector.pending = false;
}

// True if an interrupt of a low level is to come: it does so at once, and again as long as the level lasts.
bool is_low(const Vector& vector, int pin) { return vector.mode == LOW && vector.function && !input_level(pin); }
}  // namespace

Nanoseconds off_since = NEVER, last_off = NEVER, last_on = 0;

bool interrupts_on() { return enabled; }

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

bool interrupt_waits() { return enabled && pending_count > 0; }

void run_interrupt() {
  for (int pin = 0; pin < PINS; ++pin) {
    Vector& vector = vectors[pin];
    if (!vector.pending) continue;
    clear(vector);
    set_interrupts(false);
    pass(cost::INTERRUPT_ENTRY);
    if (vector.function) vector.function();
    pass(cost::INTERRUPT_EXIT);
    if (is_low(vector, pin) && !vector.pending) {
      vector.pending = true;
      ++pending_count;
    }
    set_interrupts(true);
    return;
  }
}

void attach(int pin, void (*function)(), int mode) {
  if (pin < 0 || pin >= PINS) return;
  clear(vectors[pin]);
  vectors[pin].function = function;
  vectors[pin].mode = mode;
  if (!is_low(vectors[pin], pin)) return;
  vectors[pin].pending = true;
  ++pending_count;
  plan_stop();
}

void note_edge(int pin, bool high) {
  Vector& vector = vectors[pin];
  if (!vector.function) return;
  const bool meant = vector.mode == CHANGE || (vector.mode == RISING) == high;
  if (!meant) return;
  ++vector.edges;
  if (vector.pending) {
    if (vector.mode == LOW) return;  // it comes again as long as the level lasts: nothing is lost
    make_room(2);
    tell(Told::LostEdge, pin, static_cast<int>(place));
    tell(Told::Edges, pin, vector.edges);
    return;
  }
  vector.pending = true;
  ++pending_count;
}

}  // namespace board
