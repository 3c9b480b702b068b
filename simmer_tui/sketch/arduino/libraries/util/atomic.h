// Blocks in which interrupts wait: ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { ... }
#pragma once
#include "../../core/Arduino.h"

enum BlockEnd : unsigned char { RESTORE_INTERRUPTS, INTERRUPTS_ON, INTERRUPTS_OFF };

// A loop of one pass. Its destructor runs at a `return` too.
class InterruptBlock {
 public:
  InterruptBlock(bool off, BlockEnd end);
  ~InterruptBlock();
  InterruptBlock(const InterruptBlock&) = delete;
  InterruptBlock& operator=(const InterruptBlock&) = delete;
  bool first() {
    const bool was = is_first_;
    is_first_ = false;
    return was;
  }

 private:
  bool is_first_ = true, on_at_end_;
};

#define ATOMIC_RESTORESTATE RESTORE_INTERRUPTS
#define ATOMIC_FORCEON INTERRUPTS_ON
#define NONATOMIC_RESTORESTATE RESTORE_INTERRUPTS
#define NONATOMIC_FORCEOFF INTERRUPTS_OFF
#define ATOMIC_BLOCK(end) for (InterruptBlock block_(true, end); block_.first();)
#define NONATOMIC_BLOCK(end) for (InterruptBlock block_(false, end); block_.first();)
