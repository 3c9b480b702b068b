// FreeRTOS: queues, semaphores, mutexes, and groups of events.
#include <algorithm>
#include <cstring>
#include <vector>

#include "../../board/clock.h"
#include "../../board/tasks.h"
#include "event_groups.h"
#include "semphr.h"
#include "../../board/task_waits.h"

namespace board {

struct Queue {
  unsigned int length, item_size, count = 0, first = 0;
  std::vector<uint8_t> items;
  bool is_mutex = false;
  Holder holder;             // of a mutex
  unsigned int depth = 0;    // of a recursive one
  char senders = 0, receivers = 0;  // their addresses are what tasks wait for

  Queue(unsigned int places, unsigned int size) : length(places), item_size(size), items(places * size) {}

  bool put(const void* item, bool in_front) {
    if (count >= length) return false;
    if (in_front) first = (first + length - 1) % length;
    write(item, in_front ? 0 : count);
    ++count;
    return true;
  }
  bool take(void* item, bool keep) {
    if (count == 0) return false;
    if (item && item_size) std::memcpy(item, &items[first * item_size], item_size);
    if (!keep) {
      first = (first + 1) % length;
      --count;
    }
    return true;
  }
  void write(const void* item, unsigned int at) {
    if (item && item_size) std::memcpy(&items[(first + at) % length * item_size], item, item_size);
  }
};

struct EventGroup {
  // A task that waits, until its bits have come.
  struct Waiter {
    Task* task;
    EventBits_t bits;
    bool all, clear, has_come;
    EventBits_t found;

    bool fits(EventBits_t set) const { return all ? (set & bits) == bits : (set & bits) != 0; }
  };
  EventBits_t bits = 0;
  std::vector<Waiter*> waiters;

  // Returns true if a task that now goes on is more urgent than the running one.
  bool set(EventBits_t more) {
    bits |= more;
    EventBits_t cleared = 0;
    bool wakes_urgent = false;
    for (Waiter* each : waiters) {
      if (each->has_come || !each->fits(bits)) continue;
      each->has_come = true;
      each->found = bits;
      if (each->clear) cleared |= each->bits;
      if (each->task->state == TaskState::Blocked) make_ready(*each->task);
      wakes_urgent |= is_urgent(*each->task);
    }
    bits &= static_cast<EventBits_t>(~cleared);
    return wakes_urgent;
  }
};

}  // namespace board

using namespace board;

// -- queues ------------------------------------------------------------------------------------------

namespace {
[[gnu::always_inline]] inline BaseType_t send(QueueHandle_t queue, const void* item, TickType_t ticks, bool in_front) {
  begin_call();
  const Awaited room = {WaitsFor::Room, &there(queue).senders, CALLED_AT};
  if (!wait_for(room, ticks, [&] { return queue->put(item, in_front); })) return errQUEUE_FULL;
  pass_on(&queue->receivers);
  return pdTRUE;
}

[[gnu::always_inline]] inline BaseType_t send_from_isr(QueueHandle_t queue, const void* item, BaseType_t* is_woken, bool in_front) {
  pass(cost::TASK_CALL);
  if (!there(queue).put(item, in_front)) return errQUEUE_FULL;
  pass_on_from_isr(&queue->receivers, is_woken);
  return pdTRUE;
}

[[gnu::always_inline]] inline BaseType_t receive(QueueHandle_t queue, void* item, TickType_t ticks, bool keep) {
  begin_call();
  const Awaited one = {WaitsFor::Item, &there(queue).receivers, CALLED_AT};
  if (!wait_for(one, ticks, [&] { return queue->take(item, keep); })) return errQUEUE_EMPTY;
  pass_on(keep ? &queue->receivers : &queue->senders);
  return pdTRUE;
}

// A queue of one item: the new one takes its place.
[[gnu::always_inline]] inline void replace(QueueHandle_t queue, const void* item) {
  pass(cost::TASK_CALL);
  if (there(queue).count)
    queue->write(item, 0);
  else
    queue->put(item, false);
}
}  // namespace

QueueHandle_t xQueueCreate(unsigned int length, unsigned int item_size) {
  pass(cost::TASK_CREATE);
  return length ? new Queue(length, item_size) : nullptr;
}
void vQueueDelete(QueueHandle_t queue) { delete queue; }
BaseType_t xQueueSend(QueueHandle_t queue, const void* item, TickType_t ticks) { return send(queue, item, ticks, false); }
BaseType_t xQueueSendToBack(QueueHandle_t queue, const void* item, TickType_t ticks) {
  return send(queue, item, ticks, false);
}
BaseType_t xQueueSendToFront(QueueHandle_t queue, const void* item, TickType_t ticks) {
  return send(queue, item, ticks, true);
}
BaseType_t xQueueOverwrite(QueueHandle_t queue, const void* item) {
  note_in_interrupt(InterruptCall::Task, CALLED_AT);
  replace(queue, item);
  pass_on(&queue->receivers);
  return pdTRUE;
}
BaseType_t xQueueReceive(QueueHandle_t queue, void* item, TickType_t ticks) { return receive(queue, item, ticks, false); }
BaseType_t xQueuePeek(QueueHandle_t queue, void* item, TickType_t ticks) { return receive(queue, item, ticks, true); }
BaseType_t xQueueReset(QueueHandle_t queue) {
  begin_call();
  there(queue).count = 0;
  pass_on(&queue->senders);
  return pdPASS;
}
UBaseType_t uxQueueMessagesWaiting(QueueHandle_t queue) {
  pass(cost::MILLIS);
  return static_cast<UBaseType_t>(there(queue).count);
}
UBaseType_t uxQueueSpacesAvailable(QueueHandle_t queue) {
  pass(cost::MILLIS);
  return static_cast<UBaseType_t>(there(queue).length - queue->count);
}

BaseType_t xQueueSendFromISR(QueueHandle_t queue, const void* item, BaseType_t* is_woken) {
  return send_from_isr(queue, item, is_woken, false);
}
BaseType_t xQueueSendToBackFromISR(QueueHandle_t queue, const void* item, BaseType_t* is_woken) {
  return send_from_isr(queue, item, is_woken, false);
}
BaseType_t xQueueSendToFrontFromISR(QueueHandle_t queue, const void* item, BaseType_t* is_woken) {
  return send_from_isr(queue, item, is_woken, true);
}
BaseType_t xQueueOverwriteFromISR(QueueHandle_t queue, const void* item, BaseType_t* is_woken) {
  replace(queue, item);
  pass_on_from_isr(&queue->receivers, is_woken);
  return pdTRUE;
}
BaseType_t xQueueReceiveFromISR(QueueHandle_t queue, void* item, BaseType_t* is_woken) {
  pass(cost::TASK_CALL);
  if (!there(queue).take(item, false)) return errQUEUE_EMPTY;
  pass_on_from_isr(&queue->senders, is_woken);
  return pdTRUE;
}
UBaseType_t uxQueueMessagesWaitingFromISR(QueueHandle_t queue) { return uxQueueMessagesWaiting(queue); }
BaseType_t xQueueIsQueueEmptyFromISR(QueueHandle_t queue) { return there(queue).count == 0; }
BaseType_t xQueueIsQueueFullFromISR(QueueHandle_t queue) { return there(queue).count == queue->length; }

// -- semaphores and mutexes --------------------------------------------------------------------------

namespace {
SemaphoreHandle_t make_semaphore(unsigned int most, unsigned int first, bool is_mutex) {
  pass(cost::TASK_CREATE);
  Queue* made = new Queue(most, 0);
  made->count = first;
  made->is_mutex = is_mutex;
  return made;
}

// The holder of a mutex is as urgent as those that wait for it.
void lend_priority(Queue& mutex) {
  Task* holder = mutex.holder.task;
  if (mutex.is_mutex && holder && holder->priority < running_task().priority) holder->priority = running_task().priority;
}
}  // namespace

SemaphoreHandle_t xSemaphoreCreateBinary() { return make_semaphore(1, 0, false); }
SemaphoreHandle_t xSemaphoreCreateCounting(unsigned int most, unsigned int first) {
  return most && first <= most ? make_semaphore(most, first, false) : nullptr;
}
SemaphoreHandle_t xSemaphoreCreateMutex() { return make_semaphore(1, 1, true); }
SemaphoreHandle_t xSemaphoreCreateRecursiveMutex() { return make_semaphore(1, 1, true); }
void vSemaphoreDelete(SemaphoreHandle_t semaphore) { delete semaphore; }

namespace {
[[gnu::always_inline]] inline BaseType_t take(SemaphoreHandle_t semaphore, TickType_t ticks) {
  begin_call();
  const uint32_t at = CALLED_AT;
  Queue& taken = there(semaphore);
  const Awaited awaited = {taken.is_mutex ? WaitsFor::Mutex : WaitsFor::Semaphore, &taken.receivers, at,
                           taken.is_mutex ? &taken.holder : nullptr};
  const bool is_taken = wait_for(awaited, ticks, [&] {
    if (taken.take(nullptr, false)) return true;
    if (ticks) lend_priority(taken);
    return false;
  });
  if (is_taken && taken.is_mutex) {
    taken.holder = {&running_task(), at};
    ++running_task().mutexes;
  }
  return is_taken;
}

// A mutex that another task holds: FreeRTOS asserts that nobody else gives it back.
[[gnu::always_inline]] inline void expect_own(const Queue& semaphore, bool by_interrupt) {
  const Task* holder = semaphore.is_mutex ? semaphore.holder.task : nullptr;
  if (holder && (by_interrupt || holder != &running_task())) report_foreign(CALLED_AT - 1, *holder);
}

[[gnu::always_inline]] inline BaseType_t give(SemaphoreHandle_t semaphore) {
  begin_call();
  expect_own(there(semaphore), false);
  if (!semaphore->put(nullptr, false)) return pdFALSE;
  const bool returns_priority = semaphore->is_mutex && semaphore->holder.task;
  semaphore->holder = Holder();
  pass_on(&semaphore->receivers);
  if (!returns_priority) return pdTRUE;
  Task& task = running_task();
  if (task.mutexes && --task.mutexes == 0 && task.priority != task.own_priority) set_priority(task, task.own_priority);
  return pdTRUE;
}
}  // namespace

BaseType_t xSemaphoreTake(SemaphoreHandle_t semaphore, TickType_t ticks) { return take(semaphore, ticks); }
BaseType_t xSemaphoreGive(SemaphoreHandle_t semaphore) { return give(semaphore); }

BaseType_t xSemaphoreTakeRecursive(SemaphoreHandle_t semaphore, TickType_t ticks) {
  if (there(semaphore).holder.task == &running_task()) {
    begin_call();
    ++semaphore->depth;
    return pdTRUE;
  }
  const BaseType_t taken = take(semaphore, ticks);
  if (taken) semaphore->depth = 1;
  return taken;
}

BaseType_t xSemaphoreGiveRecursive(SemaphoreHandle_t semaphore) {
  if (there(semaphore).holder.task != &running_task()) return pdFALSE;
  if (--semaphore->depth == 0) return give(semaphore);
  begin_call();
  return pdTRUE;
}

BaseType_t xSemaphoreTakeFromISR(SemaphoreHandle_t semaphore, BaseType_t* is_woken) {
  return xQueueReceiveFromISR(semaphore, nullptr, is_woken);
}
BaseType_t xSemaphoreGiveFromISR(SemaphoreHandle_t semaphore, BaseType_t* is_woken) {
  expect_own(there(semaphore), true);
  return send_from_isr(semaphore, nullptr, is_woken, false);
}
UBaseType_t uxSemaphoreGetCount(SemaphoreHandle_t semaphore) { return uxQueueMessagesWaiting(semaphore); }
TaskHandle_t xSemaphoreGetMutexHolder(SemaphoreHandle_t semaphore) { return semaphore ? semaphore->holder.task : nullptr; }

// -- groups of events --------------------------------------------------------------------------------

EventGroupHandle_t xEventGroupCreate() {
  pass(cost::TASK_CREATE);
  return new EventGroup;
}
void vEventGroupDelete(EventGroupHandle_t group) { delete group; }

EventBits_t xEventGroupSetBits(EventGroupHandle_t group, EventBits_t bits) {
  begin_call();
  if (there(group).set(bits)) ask_for_switch();
  return group->bits;
}
EventBits_t xEventGroupClearBits(EventGroupHandle_t group, EventBits_t bits) {
  begin_call();
  const EventBits_t before = there(group).bits;
  group->bits &= static_cast<EventBits_t>(~bits);
  return before;
}
EventBits_t xEventGroupGetBits(EventGroupHandle_t group) {
  pass(cost::MILLIS);
  return there(group).bits;
}
namespace {
[[gnu::always_inline]] inline EventBits_t wait_for_bits(EventGroupHandle_t group, EventBits_t bits, bool clear, bool all,
                                                        TickType_t ticks) {
  begin_call();
  EventGroup::Waiter waiter = {&running_task(), bits, all, clear, false, there(group).bits};
  if (waiter.fits(group->bits)) {
    if (clear) group->bits &= static_cast<EventBits_t>(~bits);
    return waiter.found;
  }
  group->waiters.push_back(&waiter);
  wait_for({WaitsFor::Bits, group, CALLED_AT}, ticks, [&] { return waiter.has_come; });
  group->waiters.erase(std::find(group->waiters.begin(), group->waiters.end(), &waiter));
  return waiter.has_come ? waiter.found : group->bits;
}
}  // namespace

EventBits_t xEventGroupWaitBits(EventGroupHandle_t group, EventBits_t bits, BaseType_t clear, BaseType_t all,
                                TickType_t ticks) {
  return wait_for_bits(group, bits, clear != 0, all != 0, ticks);
}
EventBits_t xEventGroupSync(EventGroupHandle_t group, EventBits_t set, EventBits_t bits, TickType_t ticks) {
  // The last one that comes is as free to go on as the others: its own bits count before they are cleared.
  begin_call();
  const EventBits_t found = static_cast<EventBits_t>(there(group).bits | set);
  if (group->set(set)) ask_for_switch();
  if ((found & bits) != bits) return wait_for_bits(group, bits, true, true, ticks);
  group->bits &= static_cast<EventBits_t>(~bits);
  return found;
}
BaseType_t xEventGroupSetBitsFromISR(EventGroupHandle_t group, EventBits_t bits, BaseType_t* is_woken) {
  pass(cost::TASK_CALL);
  if (there(group).set(bits) && is_woken) *is_woken = pdTRUE;
  return pdPASS;
}
EventBits_t xEventGroupGetBitsFromISR(EventGroupHandle_t group) { return xEventGroupGetBits(group); }
