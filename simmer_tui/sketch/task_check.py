"""Mistakes with the tasks of FreeRTOS that can be read off a sketch."""

from __future__ import annotations

from collections.abc import Iterator

from simmer_tui.errors import Problem
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall

TASK_HEADERS = ("Arduino_FreeRTOS.h", "FreeRTOS.h")
"""Headers by which a sketch for an AVR board has tasks."""
_DELAYS = {"vTaskDelay": 0, "vTaskDelayUntil": 1, "xTaskDelayUntil": 1}
_TIMERS = {"xTimerCreate": 1, "xTimerChangePeriod": 1, "xTimerChangePeriodFromISR": 1}
TICKED = {**_DELAYS, **_TIMERS}
"""Calls that want one tick at least, and the place of their ticks among their arguments."""
_LIMITS = {
    **dict.fromkeys(
        ("xQueueSend", "xQueueSendToBack", "xQueueSendToFront", "xQueueReceive", "xQueuePeek"), 2
    ),
    **dict.fromkeys(("xSemaphoreTake", "xSemaphoreTakeRecursive", "ulTaskNotifyTake"), 1),
    "xTaskNotifyWait": 3,
    "xEventGroupSync": 3,
    "xEventGroupWaitBits": 4,
}
"""Calls that wait for others, and the place of the ticks that they wait at most."""
_PERIODS = ("portTICK_PERIOD_MS", "portTICK_RATE_MS")
_TICK_RATE = 62
"""Ticks of an AVR in a second, without their fraction: pdMS_TO_TICKS multiplies by it."""


def task_problems(facts: SketchFacts) -> Iterator[Problem]:
    """Waits and timers of no tick, and waits in loop(), which the idle task of an AVR calls."""
    # An ESP32 has a tick of 1 ms, and its loop() is a task like others.
    if facts.kind.int_bits == 32 or not any(name in TASK_HEADERS for name, _ in facts.includes):
        return
    tick = facts.kind.tick
    places = {**TICKED, **_LIMITS}
    for call in facts.named(*places):
        milliseconds, is_macro = _milliseconds(facts, call, places[call.name])
        does = "makes no timer" if call.name in _TIMERS else "does not wait"
        ticks = milliseconds * _TICK_RATE // 1000 if is_macro else milliseconds // tick
        is_none = milliseconds > 0 and ticks == 0
        if is_none and milliseconds < tick:
            what = f"{call.name} of {milliseconds} ms {does}: a tick of the {facts.kind.title} has"
            yield Problem(call.token.spot, f"{what} {tick} ms, and this is less than one")
        elif is_none:
            macro = f"{call.name} of {milliseconds} ms {does}: pdMS_TO_TICKS counts {_TICK_RATE}"
            yield Problem(
                call.token.spot, f"{macro} ticks a second, so this is less than one; {tick + 1} ms are one"
            )
        if call.name in _DELAYS and call.function in ("setup", "loop"):
            yield Problem(call.token.spot, f"{call.name} in {call.function}(): {_WHY[call.function]}")


_WHY = {
    "loop": "the idle task calls it, which may not wait; put this into a task of its own",
    "setup": "the scheduler starts after it; use delay() here, or wait in a task",
}


def _milliseconds(facts: SketchFacts, call: SketchCall, place: int) -> tuple[int, bool]:
    """The milliseconds of a wait, if its ticks are computed from them, and true if pdMS_TO_TICKS does it;
    0 if they are not known."""
    argument = call.arguments[place] if place < len(call.arguments) else ()
    marks = [token.text for token in argument]
    if len(marks) > 2 and marks[-2] == "/" and marks[-1] in _PERIODS:
        found, is_macro = facts.values(argument[:-2], call.function), False
    elif len(marks) > 3 and marks[0] == "pdMS_TO_TICKS" and marks[1] == "(" and marks[-1] == ")":
        found, is_macro = facts.values(argument[2:-1], call.function), True
    else:
        return 0, False
    return max(found or (0,)), is_macro
