#include "exchange.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#define dup _dup
#define dup2 _dup2
#define read _read
#define write _write
#else
#include <unistd.h>
#endif

#include "pins.h"
#include "port.h"

namespace board {

namespace {
struct Request {
  uint64_t now;
  uint8_t reason, query;
  uint16_t count;
  int32_t pin;
  uint32_t waited, place;
};
struct Grant {
  uint64_t horizon;
  double answer;
  uint32_t count, flags;
};
static_assert(sizeof(Request) == 24 && sizeof(Grant) == 24, "as on the channel");

constexpr size_t MOST_TOLD = 2000;  // records that wait for the next exchange: `count` has 16 bits

int channel_in = 0, channel_out = 1;
std::vector<Record> told, events;
std::vector<char> buffer;
size_t next = 0;

void receive(void* data, size_t size) {
  for (char* at = static_cast<char*>(data); size > 0;) {
    const auto got = ::read(channel_in, at, static_cast<unsigned>(size));
    if (got <= 0) _exit(0);  // the simulator has ended the run
    at += got;
    size -= static_cast<size_t>(got);
  }
}

void send(const void* data, size_t size) {
  for (const char* at = static_cast<const char*>(data); size > 0;) {
    const auto sent = ::write(channel_out, at, static_cast<unsigned>(size));
    if (sent <= 0) _exit(0);
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
  // What the sketch prints with printf() must not come between the records.
  channel_in = dup(0);
  channel_out = dup(1);
  dup2(2, 1);
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
                        place};
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
