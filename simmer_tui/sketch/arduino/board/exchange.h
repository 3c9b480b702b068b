// The channel to the simulator: standard input and output, before the sketch can use them.
//
// The board may not pass its horizon without asking. All numbers are little-endian.
//
//   board -> simulator   u64 now, u8 reason, u8 query, u16 count, i32 pin, u32 place, u32 wait_place,
//                        u64 wait_begin, u32 waits, u32 task; count x Record
//   simulator -> board   u64 horizon, f64 answer, u32 count, u32 flags; count x Record
//   Record               u64 time, u8 kind, u8 pin, u16 task, i32 value
//
// `place` is the address of the last basic block. `waits` is the call in which it waits now in its low byte, then the
// number of the task that waits. `wait_begin` and `wait_place` are the beginning of the wait. `task` is the task that
// runs, and of a record the one that it is of; those of the simulator have none. A grant replaces all events of the one
// before it.
#pragma once
#include <cstdint>

#include "clock.h"

namespace board {

enum class Reason : uint8_t { Horizon = 0, Output = 1, Query = 2, Full = 3 };
// Of a part on the bus, `pin` is the number of its row: a distance in inches, an angle, a turning rate in degrees a second.
// That of a rate has the number of the gyro's low-pass filter in the second byte.
enum class Query : uint8_t { None = 0, Sonar = 1, Analog = 2, Digital = 3, Range = 4, Angle = 5, Rate = 6 };
// Records of the board: a pin's level, a duty, a servo's pulse, a byte that was sent, what was lost, long waits, and
// bytes that waited long to be read. `Until` is the end of the wait before it, and `Edges` the number of edges at the
// pin of a lost one. `Step` is the rise of a stepper's step pin, with the place in the sketch, and
// `Text` an operation on a display (see display.h), whose number is in the place of a pin.
// `FifoOverflow` has the number of a part's row for its pin. `BusStuck` is a use of the bus while interrupts are off.
// `TaskName` has the number of a task for its pin, and four characters of its name, of four records.
// `FineDuty` is a duty as a share of 65,535.
// `Busy` is the time that the board has waited in the last second, microseconds.
// `Mistake` has its kind for its pin, and the place in the sketch (see mistakes.h). The `Detail`s of a mistake come before
// it: a number, or a task with what it waits for.
enum class Told : uint8_t {
  Level = 1, Duty = 2, Servo = 3, Byte = 4, LostEdge = 5, LostByte = 6, Baud = 7, Mode = 8, Waited = 9, LateByte = 10, Until = 11,
  Edges = 12, Step = 13, Text = 14, FifoOverflow = 15, BusStuck = 16, TaskName = 17, FineDuty = 18, Mistake = 19, Detail = 20, Busy = 21
};
// Records of the simulator: an edge of an input, a byte that has arrived.
enum class Event : uint8_t { Edge = 1, Byte = 2 };

constexpr uint32_t STOP_WHEN_SENT = 0x100;  // flag: the first byte of the pin in the low byte ends the slice when it has arrived
// Flag: until the next grant without it, questions that were asked since the last one without it have the same answers.
constexpr uint32_t ANSWER_HOLDS = 0x200;

struct Record {
  uint64_t time;
  uint8_t kind, pin;
  uint16_t task;
  int32_t value;
};
static_assert(sizeof(Record) == 16, "as on the channel");

extern Nanoseconds horizon;
extern uint64_t events_applied;
extern uint32_t place;  // address of the last basic block of the sketch
extern uint32_t grant_flags;
extern uint64_t answers_since;  // the number of grants so far after which no earlier answer holds

void open_channel();
void send_told(Reason reason, Query query = Query::None, int pin = 0);  // safe in a signal handler
double exchange(Reason reason, Query query = Query::None, int pin = 0);
void end_grant(Nanoseconds moment);  // go no farther than that without asking, though the simulator allows it
void tell(Told kind, int pin, int value, Nanoseconds time = now);
void tell(Told kind, int pin, int value, Nanoseconds time, uint8_t task);  // of another task than the running one
void make_room(unsigned int count);  // the next records are of one exchange
void tell_span(Told kind, int pin, uint32_t place, Nanoseconds begin, Nanoseconds end);
Nanoseconds next_event();
void apply_events();

}  // namespace board
