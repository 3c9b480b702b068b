"""Calls that an interrupt's function may not make: those that wait, that print, or that only a task may
make."""

from __future__ import annotations

import re
from collections.abc import Iterator

from simmer_tui.errors import Problem
from simmer_tui.sketch.sketch_scan import PIN_CHANGES, SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_steps import PULSES

_PRINTS = ("print", "println", "printf", "write", "flush")
"""Methods of a serial port that send."""
_BUS = ("endTransmission", "requestFrom")
"""Methods of Wire that use the bus."""
_OF_TASKS = re.compile(
    r"(?:[xv]Queue(?:Send|Receive|Peek|Overwrite)|[xv]Semaphore(?:Take|Give)"
    r"|(?:x|v|ul)Task(?:Notify(?!StateClear)|Delay|Suspend|Resume)|xEventGroup(?:Set|Clear|Wait|Sync)"
    r"|xTimer(?:Start|Stop|Reset|ChangePeriod))\w*"
)
"""Calls of FreeRTOS that wait, or that wake a task."""
_WAKES = re.compile(
    r"xQueue(?:Send|Receive|Overwrite|Reset)\w*|xSemaphoreGive\w*|[xv]TaskNotify\w*|[xv]TaskResume\w*"
    r"|xEventGroup(?:Set|Sync)\w*|xTimer\w+|xTask(?:Create|AbortDelay)\w*"
)
"""Calls of FreeRTOS by which others go on."""
_CALLED_BY_THE_CORE = ("loop", "serialEvent", "serialEvent1", "serialEvent2", "serialEvent3")
"""Functions that a sketch need not have."""
_FROM_ISR = "FromISR"
_WITH_FROM_ISR = re.compile(
    r"xQueue(?:Send|SendToBack|SendToFront|Overwrite|Receive)|xSemaphore(?:Give|Take)|xTaskNotify(?:Give)?"
    r"|vTaskResume|xEventGroup(?:Set|Clear)Bits|xTimer(?:Start|Stop|Reset|ChangePeriod)"
)
"""Calls that have another of this kind for interrupts."""
_OTHER_NAMES = {"xTaskNotifyGive": "vTaskNotifyGiveFromISR", "vTaskResume": "xTaskResumeFromISR"}


def interrupt_problems(facts: SketchFacts) -> Iterator[Problem]:
    """Calls in the functions of interrupts, and in those that they call: each once a line, and the
    prints of a function once."""
    told: set[tuple[str, str]] = set()
    attaching: dict[str, SketchCall] = {}
    for attach in _attaching(facts):
        attaching.setdefault(facts.spelled(attach, 1), attach)
    for attach in attaching.values():
        function = _function_of(facts, attach)
        own = [call for call in facts.calls_in(attach.function) if call.token in attach.arguments[1]]
        by_own = f"the function of the interrupt at {attach.token.spot}"
        for call in own if _is_lambda(attach) else _calls_from(facts, function):
            what = _fault(facts, call)
            key = (call.function, call.object) if call.object else (call.token.spot, call.name)
            if not what or key in told:
                continue
            told.add(key)
            by = f"{function}(), the function of an interrupt"
            if _is_lambda(attach):
                by = by_own
            elif call.function != function:
                by = f"{call.function}(), which the interrupt's function {function}() calls"
            yield Problem(call.token.spot, f"{_shown(call)} in {by}: {what}")


def interrupt_functions(facts: SketchFacts) -> Iterator[str]:
    """The functions of the sketch's interrupts, those of hardware timers too, as they are written."""
    return (_function_of(facts, attach) for attach in _attaching(facts))


def _attaching(facts: SketchFacts) -> Iterator[SketchCall]:
    """The calls that give an interrupt its function, the second argument."""
    names = ("attachInterrupt", "attachInterruptArg", "timerAttachInterrupt", "timerAttachInterruptArg")
    return (call for call in facts.named(*names, *PIN_CHANGES) if len(call.arguments) > 1)


def _function_of(facts: SketchFacts, attach: SketchCall) -> str:
    return facts.spelled(attach, 1).lstrip("&")


def _is_lambda(attach: SketchCall) -> bool:
    argument = attach.arguments[1]
    return bool(argument) and argument[0].text == "["


def may_wake_tasks(facts: SketchFacts, function: str) -> bool:
    """True if a function may give something that a task waits for, or make another task that does. One that
    is not among the sketch's functions may, such as a lambda; one that is not there at all does nothing."""
    if function not in facts.functions:
        return function not in _CALLED_BY_THE_CORE
    names = {call.name for call in _calls_from(facts, function)}
    return any(_WAKES.fullmatch(name) for name in names)


def _calls_from(facts: SketchFacts, function: str) -> list[SketchCall]:
    """The calls of a function, and of those that it calls, each function once."""
    found: list[SketchCall] = []
    functions, known = [function], {function}
    for each in functions:
        calls = [call for call in facts.calls_in(each) if not call.type]
        found += calls
        own = dict.fromkeys(call.name for call in calls if call.name in facts.functions)
        functions += [name for name in own if name not in known]
        known |= own.keys()
    return found


def _fault(facts: SketchFacts, call: SketchCall) -> str:
    """The fault of a call in an interrupt's function; empty without one."""
    kind = facts.kind
    if call.name in facts.functions:
        return ""
    if call.object == "Wire" and call.name in _BUS:
        return "Wire needs interrupts, which are off there; set a flag, and read in loop()"
    if call.object:
        if call.name not in _PRINTS or not facts.is_port(call.object):
            return ""
        if any(each.name == call.object for each in facts.objects("SoftwareSerial")):
            return "interrupts are off as long as its bytes last; set a flag, and print in loop()"
        if kind.int_bits == 32:
            return "a real ESP32 may crash there; set a flag, and print in loop()"
        return "it lasts as long as its bytes once the queue is full; set a flag, and print in loop()"
    if call.name == "delay":
        return "it needs interrupts, which are off there; set a flag, and wait in loop()"
    if call.name in PULSES:
        return "no other interrupt comes while it waits; set a flag, and measure in loop()"
    if is_of_tasks(call.name):
        other = from_isr(call.name)
        return f"use {other} there" if other else "it waits, which only a task may; wake a task that does it"
    return ""


def is_of_tasks(name: str) -> bool:
    """True for a call of FreeRTOS that only a task may make."""
    return _OF_TASKS.fullmatch(name) is not None and not name.endswith(_FROM_ISR)


def from_isr(name: str) -> str:
    """The call of FreeRTOS that an interrupt's function makes instead of one; empty if there is none."""
    return _OTHER_NAMES.get(name, name + _FROM_ISR) if _WITH_FROM_ISR.fullmatch(name) else ""


def _shown(call: SketchCall) -> str:
    return f"{call.object}.{call.name}" if call.object else call.name
