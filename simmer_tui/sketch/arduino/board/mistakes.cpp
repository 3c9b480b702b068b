#include "mistakes.h"

#include <vector>

#include "exchange.h"
#include "interrupts.h"

namespace board {

namespace {
struct Noted {
  Mistake kind;
  uint32_t at;
  int number;
};
std::vector<Noted> noted;
constexpr size_t MOST_NOTED = 100;  // more lines than anybody reads
}  // namespace

void note_mistake(Mistake kind, uint32_t at, int number) {
  for (const Noted& each : noted)
    if (each.kind == kind && each.at == at && each.number == number) return;
  if (noted.size() >= MOST_NOTED) return;
  noted.push_back({kind, at, number});
  make_room(2);
  tell(Told::Detail, 0, number);
  tell(Told::Mistake, static_cast<int>(kind), static_cast<int>(at));
  exchange(Reason::Output);  // it has its own time, whatever the slices are
}

void note_in_interrupt(InterruptCall call, uint32_t at) {
  if (in_interrupt()) note_mistake(Mistake::InInterrupt, at, static_cast<int>(call));
}

}  // namespace board
