#include "i2c.h"

#include "exchange.h"
#include "interrupts.h"

namespace board {

namespace {
constexpr unsigned int MOST_PARTS = 32;  // rows of sensors in a wiring.toml
I2cPart* parts[MOST_PARTS];
unsigned int part_count = 0;

// The chip's own bus goes on by interrupts. Without them a call waits forever, and so does the sketch.
void need_interrupts() {
  if (interrupts_on()) return;
  tell(Told::BusStuck, 0, static_cast<int>(place));
  for (;;) pass(SECOND);
}
}  // namespace

Nanoseconds i2c_byte = cost::I2C_BYTE;

void I2cPart::receive(const uint8_t* data, unsigned int count) {
  if (count == 0) return;
  register_ = data[0];
  for (unsigned int byte = 1; byte < count; ++byte) {
    const uint8_t reg = register_;
    if (!stays_at(reg)) ++register_;
    set(reg, data[byte]);
  }
}

void I2cPart::send(uint8_t* data, unsigned int count) {
  begin_send(register_, count);
  for (unsigned int byte = 0; byte < count; ++byte) {
    const uint8_t reg = register_;
    if (!stays_at(reg)) ++register_;
    data[byte] &= get(reg);  // of several parts at one address, each pulls the wire low for its zeros
  }
}

void i2c_pass(unsigned int bytes) {
  need_interrupts();
  pass_until(now + bytes * i2c_byte);
}

namespace {
// The address byte: true if somebody answers.
bool call(int address) {
  i2c_pass(1);
  for (unsigned int each = 0; each < part_count; ++each)
    if (parts[each]->answers(address)) return true;
  return false;
}
}  // namespace

bool i2c_write(int address, const uint8_t* data, unsigned int count) {
  if (!call(address)) return false;
  i2c_pass(count);
  // A part that gets another address by this answers there only from the next transmission on.
  I2cPart* called[MOST_PARTS];
  unsigned int called_count = 0;
  for (unsigned int each = 0; each < part_count; ++each)
    if (parts[each]->answers(address)) called[called_count++] = parts[each];
  for (unsigned int each = 0; each < called_count; ++each) called[each]->receive(data, count);
  plan_stop();
  return true;
}

bool i2c_read(int address, uint8_t* data, unsigned int count) {
  if (!call(address)) return false;
  for (unsigned int byte = 0; byte < count; ++byte) data[byte] = 0xFF;  // pulled up
  for (unsigned int each = 0; each < part_count; ++each)
    if (parts[each]->answers(address)) parts[each]->send(data, count);
  plan_stop();
  i2c_pass(count);
  return true;
}

void add_part(I2cPart* part) {
  if (part_count < MOST_PARTS) parts[part_count++] = part;
}

Nanoseconds next_part() {
  Nanoseconds first = NEVER;
  for (unsigned int each = 0; each < part_count; ++each)
    if (parts[each]->due() < first) first = parts[each]->due();
  return first;
}

void run_parts() {
  for (unsigned int each = 0; each < part_count; ++each)
    while (parts[each]->due() <= now) parts[each]->run();
}

void parts_see_pin(int pin, bool high) {
  for (unsigned int each = 0; each < part_count; ++each) parts[each]->pin_changed(pin, high);
  if (part_count) plan_stop();
}

}  // namespace board
