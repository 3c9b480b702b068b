// Registers of a VL53L0X, for the part and for both libraries.
#pragma once
#include <cstdint>

namespace board {
namespace vl53l0x {

enum : uint8_t {
  START = 0x00, SEQUENCE = 0x01, PERIOD = 0x04, CLEAR = 0x0B, READY = 0x13, RESULT = 0x14, RANGE = 0x1E,
  SIGNAL_LIMIT = 0x44, BUDGET = 0x71, POWER = 0x80, ADDRESS = 0x8A, STOP_VALUE = 0x91, MODEL = 0xC0, PAGE = 0xFF
};
enum : uint8_t { SINGLE = 0x01, BACK_TO_BACK = 0x02, TIMED = 0x04 };  // START
enum : uint8_t { WRONG_PHASE = 9, VALID = 11 };                       // the upper bits of RESULT
constexpr uint8_t MODEL_ID = 0xEE;
constexpr unsigned int NOTHING = 8190;          // millimetres that stand for no target in range
// The chip counts periods of its laser here. Only our own libraries write this: steps of 16 us.
constexpr unsigned int BUDGET_UNIT = 16;
constexpr unsigned int DEFAULT_BUDGET = 33000, SHORTEST_BUDGET = 20000;  // microseconds

}  // namespace vl53l0x
}  // namespace board
