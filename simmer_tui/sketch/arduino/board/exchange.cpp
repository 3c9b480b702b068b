#include "exchange.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#else
#include <unistd.h>
#endif

#include "pins.h"
#include "port.h"
#include "tasks.h"

namespace board {

namespace {
// The system's calls, which have other names on Windows.
#ifdef _WIN32
int duplicate(int file) { return _dup(file); }
const char* const NOWHERE = "NUL";
long read_file(int file, void* data, size_t size) { return _read(file, data, static_cast<unsigned>(size)); }
long write_file(int file, const void* data, size_t size) { return _write(file, data, static_cast<unsigned>(size)); }
#else
int duplicate(int file) { return dup(file); }
const char* const NOWHERE = "/dev/null";
long read_file(int file, void* data, size_t size) { return ::read(file, data, size); }
long write_file(int file, const void* data, size_t size) { return ::write(file, data, size); }
#endif

struct Request {
  uint64_t now;
  uint8_t reason, query;
  uint16_t count;
  int32_t pin;
  uint32_t place, wait_place;
  uint64_t wait_begin;
  uint32_t waits, task;
};
struct Grant {
  uint64_t horizon;
  double answer;
  uint32_t count, flags;
};
static_assert(sizeof(Request) == 40 && sizeof(Grant) == 24, "as on the channel");

constexpr size_t MOST_TOLD = 2000;  // records that wait for the next exchange: `count` has 16 bits

int channel_in = 0, channel_out = 1;
bool is_open = false;  // constructors of globals tell before that
// What is told, behind the request with which it is sent: one write, and no memory is taken.
struct {
  Request request;
  Record records[MOST_TOLD];
} told;
static_assert(sizeof told == sizeof(Request) + sizeof told.records, "no gap on the channel");
size_t told_count = 0;
// A grant, and its events behind it: mostly one read.
constexpr size_t USUAL_EVENTS = 64;
struct {
  Grant grant;
  Record events[USUAL_EVENTS];
} given;
static_assert(sizeof given == sizeof(Grant) + sizeof given.events, "no gap on the channel");
std::vector<Record> more_events;  // all of them, if they are more
const Record* events = given.events;
size_t event_count = 0;
size_t next = 0;

// Read at least `least` bytes. The simulator sends no more than one grant before the next request.
size_t receive(void* data, size_t least, size_t room) {
  size_t size = 0;
  while (size < least) {
    const long got = read_file(channel_in, static_cast<char*>(data) + size, room - size);
    if (got <= 0) std::_Exit(0);  // the simulator has ended the run
    size += static_cast<size_t>(got);
  }
  return size;
}

void send(const void* data, size_t size) {
  for (const char* at = static_cast<const char*>(data); size > 0;) {
    const long sent = write_file(channel_out, at, size);
    if (sent <= 0) std::_Exit(0);
    at += sent;
    size -= static_cast<size_t>(sent);
  }
}
}  // namespace

Nanoseconds horizon = 0;
uint64_t events_applied = 0;
uint32_t place = 0;
uint32_t grant_flags = 0;
uint64_t answers_since = 0;

void open_channel() {
  channel_in = duplicate(0);
  channel_out = duplicate(1);
  // A board has no terminal: printf() of a sketch prints nowhere, and getchar() has nothing to read.
  if (!std::freopen(NOWHERE, "r", stdin) || !std::freopen(NOWHERE, "w", stdout)) std::_Exit(2);
#ifdef _WIN32
  _setmode(channel_in, _O_BINARY);
  _setmode(channel_out, _O_BINARY);
#endif
  is_open = true;
  // What constructors of globals did was at the beginning: they take no time.
  for (size_t at = 0; at < told_count; ++at) told.records[at].time = now;
}

void send_told(Reason reason, Query query, int pin) {
  const size_t count = told_count;
  const Wait& wait = shown_wait();
  told.request = {now,
                  static_cast<uint8_t>(reason),
                  static_cast<uint8_t>(query),
                  static_cast<uint16_t>(count),
                  pin,
                  place,
                  wait.place,
                  wait.begin,
                  static_cast<uint32_t>(wait.kind) | static_cast<uint32_t>(waiting_task()) << 8,
                  running_task().number};
  told_count = 0;
  send(&told, sizeof(Request) + count * sizeof(Record));
}

double exchange(Reason reason, Query query, int pin) {
  if (!is_open) {
    if (told_count >= MOST_TOLD) told_count = 0;
    return 0.0;
  }
  send_told(reason, query, pin);
  const Grant& grant = given.grant;
  size_t size = receive(&given, sizeof grant, sizeof given);
  next = 0;
  event_count = grant.count;
  const size_t whole = sizeof grant + event_count * sizeof(Record);
  events = given.events;
  if (event_count > USUAL_EVENTS) {
    size -= sizeof grant;
    more_events.resize(event_count);
    std::memcpy(more_events.data(), given.events, size);
    receive(reinterpret_cast<char*>(more_events.data()) + size, whole - sizeof grant - size, whole - sizeof grant - size);
    events = more_events.data();
  } else if (size < whole) {
    receive(reinterpret_cast<char*>(&given) + size, whole - size, whole - size);
  }
  horizon = grant.horizon;
  grant_flags = grant.flags;
  if (!(grant.flags & ANSWER_HOLDS)) ++answers_since;
  plan_stop();
  return grant.answer;
}

void end_grant(Nanoseconds moment) {
  grant_flags &= ~STOP_WHEN_SENT;
  if (moment >= horizon) return;
  horizon = moment;
  plan_stop();
}

void tell(Told kind, int pin, int value, Nanoseconds time) { tell(kind, pin, value, time, running_task().number); }

void tell(Told kind, int pin, int value, Nanoseconds time, uint8_t task) {
  told.records[told_count] = {time, static_cast<uint8_t>(kind), static_cast<uint8_t>(pin), task, value};
  if (++told_count >= MOST_TOLD) exchange(Reason::Full);
}

void make_room(unsigned int count) {
  if (told_count + count >= MOST_TOLD) exchange(Reason::Full);
}

void tell_span(Told kind, int pin, uint32_t place, Nanoseconds begin, Nanoseconds end) {
  make_room(2);
  tell(kind, pin, static_cast<int>(place), begin);
  tell(Told::Until, pin, 0, end);
}

Nanoseconds next_event() { return next < event_count ? events[next].time : NEVER; }

void apply_events() {
  while (next < event_count && events[next].time <= now) {
    const Record event = events[next++];
    ++events_applied;
    if (event.kind == static_cast<uint8_t>(Event::Edge))
      set_input(event.pin, event.value);
    else
      receive_byte(event.pin, event.value, event.time);
  }
}

}  // namespace board
