// A stack of its own for a function, which others can leave and come back to.
#pragma once

#if !defined(_WIN32)
#include <ucontext.h>
#endif

namespace board {

class Context {
 public:
  Context() = default;  // that of the process
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  // Begin a function that never returns, at the first switch. A stack from before is used again.
  void prepare(void (*function)());
  // Leave this context, which runs, for another one.
  void switch_to(Context& other);

 private:
#if defined(_WIN32)
  void* fiber_ = nullptr;
#else
  ucontext_t state_ = {};
  char* stack_ = nullptr;
#endif
};

}  // namespace board
