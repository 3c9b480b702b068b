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
  uint32_t waited, place;
  uint64_t wait_begin;
  uint32_t wait_place, waits;
};
struct Grant {
  uint64_t horizon;
  double answer;
  uint32_t count, flags;
};
static_assert(sizeof(Request) == 40 && sizeof(Grant) == 24, "as on the channel");

constexpr size_t MOST_TOLD = 2000;  // records that wait for the next exchange: `count` has 16 bits

int channel_in = 0, channel_out = 1;
std::vector<Record> told, events;
std::vector<char> buffer;
size_t next = 0;

void receive(void* data, size_t size) {
  for (char* at = static_cast<char*>(data); size > 0;) {
    const long got = read_file(channel_in, at, size);
    if (got <= 0) std::_Exit(0);  // the simulator has ended the run
    at += got;
    size -= static_cast<size_t>(got);
  }
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

void open_channel() {
  channel_in = duplicate(0);
  channel_out = duplicate(1);
  // A board has no terminal: printf() of a sketch prints nowhere, and getchar() has nothing to read.
  if (!std::freopen(NOWHERE, "r", stdin) || !std::freopen(NOWHERE, "w", stdout)) std::_Exit(2);
#ifdef _WIN32
  _setmode(channel_in, _O_BINARY);
  _setmode(channel_out, _O_BINARY);
#endif
}

double exchange(Reason reason, Query query, int pin) {
  const Request request{now,
                        static_cast<uint8_t>(reason),
                        static_cast<uint8_t>(query),
                        static_cast<uint16_t>(told.size()),
                        pin,
                        static_cast<uint32_t>(waited / MILLISECOND),
                        place,
                        waiting.begin,
                        waiting.place,
                        static_cast<uint32_t>(waiting.kind)};
  const size_t size = told.size() * sizeof(Record);
  buffer.resize(sizeof request + size);
  std::memcpy(buffer.data(), &request, sizeof request);
  if (size) std::memcpy(buffer.data() + sizeof request, told.data(), size);
  told.clear();
  send(buffer.data(), buffer.size());
  Grant grant;
  receive(&grant, sizeof grant);
  events.resize(grant.count);
  next = 0;
  if (grant.count) receive(events.data(), grant.count * sizeof(Record));
  horizon = grant.horizon;
  grant_flags = grant.flags;
  plan_stop();
  return grant.answer;
}

void tell(Told kind, int pin, int value, Nanoseconds time) {
  told.push_back({time, static_cast<uint8_t>(kind), static_cast<uint8_t>(pin), 0, value});
  if (told.size() >= MOST_TOLD) exchange(Reason::Full);
}

void make_room(unsigned int count) {
  if (told.size() + count >= MOST_TOLD) exchange(Reason::Full);
}

void tell_span(Told kind, int pin, uint32_t place, Nanoseconds begin, Nanoseconds end) {
  make_room(2);
  tell(kind, pin, static_cast<int>(place), begin);
  tell(Told::Until, pin, 0, end);
}

Nanoseconds next_event() { return next < events.size() ? events[next].time : NEVER; }

void apply_events() {
  while (next < events.size() && events[next].time <= now) {
    const Record event = events[next++];
    ++events_applied;
    if (event.kind == static_cast<uint8_t>(Event::Edge))
      set_input(event.pin, event.value);
    else
      receive_byte(event.pin, event.value, event.time);
  }
}

}  // namespace board
