"""Waits of tasks that nothing can end, read off the text of a sketch.

A board knows which tasks wait for ever, and where. The text knows which calls could give what they wait for,
and which functions still run. Whatever the text leaves open counts as a call that could.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from enum import IntEnum

from msgspec import Struct

from simmer_tui.sketch.cpp_tokens import Token
from simmer_tui.sketch.known_headers import is_provided
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall


class WaitsFor(IntEnum):
    """Things that a task waits for (`arduino/board/tasks.h`); the last three are of a report alone."""

    TIME = 0
    ITEM = 1
    ROOM = 2
    SEMAPHORE = 3
    MUTEX = 4
    NOTIFICATION = 5
    BITS = 6
    RESUME = 7
    HOLDER = 8
    OTHERS = 9
    DELETED = 10


HAS_INTERRUPTS, LOOP_GOES_ON, SETUP_GOES_ON = 1, 2, 4
"""Flags of what is left while tasks wait."""
LOOPS = ("loop", "serialEvent", "serialEvent1", "serialEvent2", "serialEvent3")
"""Functions that the core calls again and again."""


class _Kind(Struct, frozen=True):
    """The calls that wait for a kind of thing, those that give it, and how a sentence says that."""

    waits: re.Pattern[str]
    gives: re.Pattern[str]
    nobody: str


_KINDS = {
    WaitsFor.ITEM: _Kind(
        re.compile(r"xQueue(?:Receive|Peek)"), re.compile(r"xQueue(?:Send|Overwrite)\w*"), "sends to it"
    ),
    WaitsFor.ROOM: _Kind(
        re.compile(r"xQueueSend(?:ToBack|ToFront)?"),
        re.compile(r"xQueue(?:Receive(?:FromISR)?|Reset)"),
        "receives from it",
    ),
    WaitsFor.SEMAPHORE: _Kind(
        re.compile(r"xSemaphoreTake"), re.compile(r"xSemaphoreGive\w*|xQueueSend\w*"), "gives it"
    ),
    WaitsFor.NOTIFICATION: _Kind(
        re.compile(r"ulTaskNotifyTake|xTaskNotifyWait"),
        re.compile(r"xTaskNotify(?:Give)?(?:FromISR)?|vTaskNotifyGiveFromISR"),
        "notifies that task",
    ),
    WaitsFor.BITS: _Kind(
        re.compile(r"xEventGroup(?:WaitBits|Sync)"),
        re.compile(r"xEventGroup(?:SetBits\w*|Sync)"),
        "sets its bits",
    ),
}
_CREATES = re.compile(r"x(?:Queue|Semaphore|EventGroup)Create\w*")
_EMPTY = ("NULL", "nullptr", "0")
"""Values of a handle before it is created."""
_CREATES_TASK = ("xTaskCreate", "xTaskCreatePinnedToCore")
_ATTACHES = ("attachInterrupt", "attachInterruptArg", "timerAttachInterrupt", "timerAttachInterruptArg")
_ABORTS = "xTaskAbortDelay"
_OF_TIMERS = ("Tmr Svc", "esp_timer")
"""Tasks of the system."""
_LONGEST_TASK = 15
"""Characters of a task's name that a board knows."""


class WaitingTask(Struct):
    """A task that has waited for ever, at a line, and for a mutex the name of the task that holds it."""

    name: str
    line: str
    kind: WaitsFor
    holder: str = ""
    has_holder: bool = False


class HopelessWait(Struct, frozen=True):
    """A wait that nothing can end: what for, and why."""

    task: WaitingTask
    handle: str
    reason: str


def hopeless_waits(
    facts: SketchFacts, waiting: Sequence[WaitingTask], others: Collection[str], flags: int
) -> list[HopelessWait]:
    """The waits that nothing can end, of tasks that wait for ever.

    Args:
        facts: The facts of the sketch.
        waiting: Those tasks.
        others: The names of all other tasks that are left; "" is the one of setup() and loop().
        flags: What else is left.
    """
    text = _TaskText(facts)
    if text.is_open:
        return []
    stuck = {each.name: each for each in waiting if text.is_known(each)}
    # Two tasks of one name cannot be told apart.
    if len({each.name for each in waiting}) < len(waiting) or stuck.keys() & set(others):
        return []
    goes_on = {*others, *(each.name for each in waiting if each.name not in stuck)}
    while True:
        roots = text.roots(goes_on, flags)
        if roots is None:
            return []
        alive = text.calls_from(roots)
        freed = [name for name, each in stuck.items() if text.can_end(each, alive, goes_on)]
        if not freed:
            break
        for name in freed:
            del stuck[name]
            goes_on.add(name)
    return [made for each in stuck.values() if (made := text.explained(each, stuck))]


class _TaskText:
    """The calls of FreeRTOS in a sketch, and the functions that make them."""

    def __init__(self, facts: SketchFacts) -> None:
        self._facts = facts
        self._tasks: dict[str, set[str]] = {}
        """The functions of tasks by the tasks' names; a name that is no text is empty."""
        self._told_to: dict[str, set[str]] = {}
        """The functions of tasks by the handles that they are created with."""
        made = [call for call in facts.named(*_CREATES_TASK) if call.arguments]
        for call in made:
            function = "" if _has_lambda(call, 0) else _last_name(call.arguments[0])
            name = facts.spelled(call, 1).strip('"')[:_LONGEST_TASK]
            self._tasks.setdefault(name, set()).add(function)
            if len(call.arguments) > 5:
                self._told_to.setdefault(_last_name(call.arguments[5]), set()).add(function)
        self._created = {name for name in facts.expressions if self._is_created(name)}
        self._created |= {_last_name(call.arguments[0]) for call in facts.named("vSemaphoreCreateBinary")}
        self._always = self._always_called(made)

    @property
    def is_open(self) -> bool:
        """True if something may give that no call in the text shows."""
        facts = self._facts
        gives = [each.gives for each in _KINDS.values()]
        return (
            any(facts.named(_ABORTS))
            or any(each.fullmatch(name) for each in gives for name in facts.in_macros)
            or not self._tasks.keys().isdisjoint(("", *_EMPTY))
            or not all(is_provided(header, facts.files) for header, _ in facts.includes)
        )

    def _is_created(self, name: str) -> bool:
        """True for a handle that is set by its creation alone."""
        values = [value for value, _ in self._facts.expressions[name]]
        made = [value for value in values if value and _CREATES.fullmatch(value[0].text)]
        return bool(made) and all(
            value in made or "".join(token.text for token in value) in _EMPTY for value in values
        )

    def _always_called(self, made: Iterable[SketchCall]) -> set[str]:
        """Functions that may be called at any time: by a pointer, an object, a macro, or a timer."""
        facts = self._facts
        known = facts.mentions.copy()
        known.subtract(_last_name(call.arguments[0]) for call in made)
        known.subtract(
            _last_name(call.arguments[1]) for call in facts.named(*_ATTACHES) if len(call.arguments) > 1
        )
        methods = {each for name, own in facts.class_methods.items() if name for each in own}
        return methods | {name for name in facts.functions if known[name] > 0 or name in facts.in_macros}

    def roots(self, tasks: Iterable[str], flags: int) -> set[str] | None:
        """The functions that these tasks, and what else is left, begin in; None if they are not known."""
        functions = set(self._always)
        for name in tasks:
            if name and name not in self._tasks:
                if name in _OF_TIMERS:
                    continue  # what they call is among the functions of pointers
                return None
            own = self._tasks.get(name, set()) if name else set()
            if not own <= {"", *self._facts.functions}:
                return None
            functions |= own
        if flags & LOOP_GOES_ON:
            functions |= set(LOOPS)
        if flags & SETUP_GOES_ON:
            functions |= {"setup", *LOOPS}
        if flags & HAS_INTERRUPTS:
            attached = self._facts.named(*_ATTACHES)
            functions |= {_last_name(call.arguments[1]) for call in attached if len(call.arguments) > 1}
        return functions

    def calls_from(self, roots: Iterable[str]) -> list[SketchCall]:
        """The calls of these functions and of those that they call or name, and those of lambdas."""
        facts = self._facts
        functions = list(roots)
        known = set(functions)
        found = [call for call in facts.calls if self._is_anyones(call)]
        for each in functions:
            for call in facts.calls_in(each):
                found.append(call)
                named = {call.name, call.type}
                named |= {token.text for argument in call.arguments for token in argument}
                for name in sorted(named & facts.functions - known):
                    known.add(name)
                    functions.append(name)
        return found

    def is_known(self, task: WaitingTask) -> bool:
        """True if the text knows what a task waits for."""
        return task.has_holder if task.kind is WaitsFor.MUTEX else bool(self._handle_of(task))

    def _handle_of(self, task: WaitingTask) -> str:
        """The handle that a task waits for, of a notification its function; empty if it is not known."""
        kind = _KINDS.get(task.kind)
        if kind is None or not task.line:
            return ""
        calls = [
            call
            for call in self._facts.calls
            if call.token.spot == task.line and kind.waits.fullmatch(call.name)
        ]
        if task.kind is WaitsFor.NOTIFICATION:
            functions = self._tasks.get(task.name, set())
            return next(iter(functions)) if calls and len(functions) == 1 else ""
        handles = {self._handle_in(call) for call in calls}
        return handles.pop() if len(handles) == 1 else ""

    def _handle_in(self, call: SketchCall) -> str:
        """The handle that a call is about; empty if another name may stand for it."""
        name = _last_name(call.arguments[0]) if call.arguments else ""
        is_parameter = name in self._facts.parameters.get(call.function, ())
        return name if name in self._created and not is_parameter else ""

    def _gives(self, task: WaitingTask, call: SketchCall) -> bool:
        """True if a call may give what a task waits for."""
        if not _KINDS[task.kind].gives.fullmatch(call.name):
            return False
        wanted = self._handle_of(task)
        if task.kind is WaitsFor.NOTIFICATION:
            given = _last_name(call.arguments[0]) if call.arguments else ""
            functions = self._told_to.get(given)
            is_other = functions is not None and wanted not in functions
            return not (is_other and given not in self._facts.expressions)
        return self._handle_in(call) in ("", wanted)

    def can_end(self, task: WaitingTask, alive: Iterable[SketchCall], goes_on: Collection[str]) -> bool:
        """True if one of these calls may end a wait, or if the holder of a mutex goes on."""
        if task.kind is WaitsFor.MUTEX:
            return task.holder in goes_on
        return any(self._gives(task, call) for call in alive)

    def explained(self, task: WaitingTask, stuck: Mapping[str, WaitingTask]) -> HopelessWait | None:
        """The wait with its reason; None for a task that may be meant to wait."""
        if task.kind is WaitsFor.MUTEX:
            return HopelessWait(task, "", "")
        handle = "" if task.kind is WaitsFor.NOTIFICATION else self._handle_of(task)
        gives = [call for call in self._facts.calls if self._gives(task, call)]
        nobody = _KINDS[task.kind].nobody
        if not gives:
            # A task may wait for nothing on purpose, as loop() does in a sketch that is all tasks.
            if task.kind is WaitsFor.NOTIFICATION and not task.name:
                return None
            return HopelessWait(task, handle, f"nothing in the sketch {nobody}")
        by = [name for name in stuck if any(call in gives for call in self._calls_of(name))]
        spots = ", ".join(dict.fromkeys(call.token.spot for call in gives))
        if by == [task.name]:
            return HopelessWait(task, handle, f"only this task itself could end it, at {spots}")
        if by:
            wait = "it waits" if len(by) == 1 else "they wait"
            reason = f"only {_listed(by)} could end it, at {spots}, and {wait} too"
            return HopelessWait(task, handle, reason)
        return HopelessWait(task, handle, f"no task that is left {nobody}; that is at {spots}")

    def _calls_of(self, name: str) -> list[SketchCall]:
        functions = self._tasks.get(name, set()) if name else set(LOOPS)
        return [call for call in self.calls_from(functions) if not self._is_anyones(call)]

    def _is_anyones(self, call: SketchCall) -> bool:
        """True for a call that may come at any time: in a lambda, or outside of functions."""
        return call.order in self._facts.in_lambdas or not call.function


def _last_name(tokens: Sequence[Token]) -> str:
    """The name that an argument ends with, outside of brackets: `queue` of `&robot.queue[1]`; empty for a
    call."""
    name, depth = "", 0
    for token in tokens:
        if token.text in "([":
            depth += 1
        elif token.text in ")]":
            depth -= 1
        elif depth == 0 and token.is_name:
            name = token.text
    return name if not tokens or tokens[-1].text != ")" else ""


def _has_lambda(call: SketchCall, place: int) -> bool:
    """True if an argument is a lambda, `[](...) {...}` or `+[](...) {...}`."""
    marks = [token.text for token in call.arguments[place][:2]]
    return marks[:1] == ["["] or marks == ["+", "["]


def _listed(names: Iterable[str]) -> str:
    shown: Iterator[str] = (each or "loop()" for each in names)
    return " and ".join(shown)
