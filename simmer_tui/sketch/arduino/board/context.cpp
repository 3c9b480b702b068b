#include "context.h"

#include <cstddef>
#include <cstdlib>

#if !defined(_WIN32)
#include <sys/mman.h>
#endif

#if defined(_WIN32)
// Three functions of the system, without its header, whose macros are names of Arduino's core.
extern "C" {
__declspec(dllimport) void* __stdcall ConvertThreadToFiber(void*);
__declspec(dllimport) void* __stdcall CreateFiber(size_t, void(__stdcall*)(void*), void*);
__declspec(dllimport) void __stdcall DeleteFiber(void*);
__declspec(dllimport) void __stdcall SwitchToFiber(void*);
}
#elif defined(__linux__) && !defined(__GLIBC__)
// musl has none of these. Sketches without tasks run there all the same.
#pragma weak getcontext
#pragma weak makecontext
#pragma weak swapcontext
#endif

namespace board {

namespace {
// A task of an AVR has 100 to 500 bytes, but numbers and addresses are larger here, and printf() needs kilobytes.
constexpr std::size_t STACK = 256 * 1024;
#if !defined(_WIN32)
constexpr std::size_t GUARD = 64 * 1024;  // no system has larger pages
#endif
}  // namespace

#if defined(_WIN32)
namespace {
void __stdcall begin(void* function) { reinterpret_cast<void (*)()>(function)(); }
}  // namespace

void Context::prepare(void (*function)()) {
  if (fiber_) DeleteFiber(fiber_);
  fiber_ = CreateFiber(STACK, begin, reinterpret_cast<void*>(function));
  if (!fiber_) std::abort();
}

void Context::switch_to(Context& other) {
  if (!fiber_) fiber_ = ConvertThreadToFiber(nullptr);
  SwitchToFiber(other.fiber_);
}
#else
void Context::prepare(void (*function)()) {
  if (!stack_) {
    void* made = mmap(nullptr, GUARD + STACK, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANON, -1, 0);
    // Below the stack nothing can be used: one that is full ends the board there.
    if (made == MAP_FAILED || mprotect(made, GUARD, PROT_NONE)) std::abort();
    stack_ = static_cast<char*>(made) + GUARD;
  }
  getcontext(&state_);
  state_.uc_stack.ss_sp = stack_;
  state_.uc_stack.ss_size = STACK;
  state_.uc_link = nullptr;
  makecontext(&state_, function, 0);
}

void Context::switch_to(Context& other) { swapcontext(&state_, &other.state_); }
#endif

}  // namespace board
