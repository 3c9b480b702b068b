"""The gripper's angles for the draft of a wiring.toml, and the guesses among them that are left."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import chain

from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_values import Bindings, Pins
from simmer_tui.sketch.wiring import Wiring

_OPEN, _CLOSED = (re.compile(word, re.IGNORECASE) for word in ("open|release", "clos|grab|hold"))
_GRIPPER = re.compile("grip|claw|greif|jaw|zange", re.IGNORECASE)
_LOOKS = re.compile("scan|pan|sonar|head|neck|look|radar|turret", re.IGNORECASE)
"""Names of a servo that turns a sensor, or of a function that does it."""
_DISTANCE = re.compile("pulseIn|ping|dist|sonar|ultra", re.IGNORECASE)
"""Calls that measure a distance."""
_HALF_TURN = 180
"""The largest angle of a servo; a larger number is a pulse."""
# Judged: the jaws of most grippers turn by less.
_QUARTER_TURN = 90
"""Degrees between two angles of which the sketch has one at most."""
_GUESS = re.compile(r"gripper\b.*# \? a guess: (.*)")


def gripper_of(facts: SketchFacts, pins: Sequence[int]) -> int | None:
    """The servo that is most likely the gripper's, by its pin: the first one with such a name, else the first
    one that does not look about; None without one."""
    names = {
        pin: " ".join(
            (
                *(f"{call.object} {facts.spelled(call)}" for call, at, _ in _attached(facts) if at == pin),
                *(call.function for call in _writes(facts, pin)),
            )
        )
        for pin in pins
    }
    named = [pin for pin in pins if _GRIPPER.search(names[pin])]
    others = (pin for pin in pins if not _LOOKS.search(names[pin]) and not _looks_about(facts, pin))
    return next(chain(named, others), None)


def _looks_about(facts: SketchFacts, pin: int) -> bool:
    """True if a servo turns a sensor: a distance is measured after one of its writes, in the same function,
    or loop, or after two angles, or the function is named so."""
    looked: set[str] = set()
    for write in _writes(facts, pin):
        after = [call for call in facts.calls_in(write.function) if call.order > write.order]
        is_own = write.function not in ("setup", "loop") or write.loops
        if is_own and any(_DISTANCE.search(call.name) and call.loops == write.loops for call in after):
            return True
        following = next((call.name for call in after if not call.name.startswith("delay")), "")
        looked |= {facts.spelled(write)} if _DISTANCE.search(following) else set()
        if _LOOKS.search(write.function) or len(looked) > 1:
            return True
    return False


def _attached(facts: SketchFacts) -> Iterator[tuple[SketchCall, int, str]]:
    """The calls that attach servos, in loops as well: with the pin, and the servo as its writes name it."""
    for call in facts.named("attach"):
        for bound in facts.rounds(call, {}):
            found = facts.values(call.arguments[0], call.function, 0, bound) if call.arguments else None
            if found is not None and len(found) == 1:
                yield call, next(iter(found)), _servo_named(facts, call, bound)


def _servo_named(facts: SketchFacts, call: SketchCall, bound: Bindings) -> str:
    """The name of a call's object, with the number of its index: `servos[1]`."""
    index = facts.values(call.owner[2:-1], call.function, 0, bound) if len(call.owner) > 1 else None
    return f"{call.object}[{min(index)}]" if index else call.object


def _writes(facts: SketchFacts, pin: int) -> list[SketchCall]:
    """The writes of the servo at a pin."""
    servos = {name for _, each, name in _attached(facts) if each == pin}
    return [call for call in facts.named("write") if _servo_named(facts, call, {}) in servos]


def drafted_angles(facts: SketchFacts, pin: int) -> str:
    """The line with the angles of the servo at a pin, and a mark: which is open, or that it is a guess."""
    names = _written_angles(facts, pin)
    mark = "which is open"
    if not names:
        opened, closed, mark = 0, _QUARTER_TURN, "a guess: no angle was found in the sketch"
    elif len(names) == 1:
        ((angle, name),) = names.items()
        other = angle - _QUARTER_TURN if angle >= _QUARTER_TURN else angle + _QUARTER_TURN
        is_open = _OPEN.search(name) and not _CLOSED.search(name)
        opened, closed = (angle, other) if is_open else (other, angle)
        mark = f"a guess: the sketch writes {angle} alone"
    else:
        opened, closed = list(names) if len(names) == 2 else (min(names), max(names))
        if _CLOSED.search(names[opened]) or _OPEN.search(names[closed]):
            opened, closed = closed, opened
    return f"gripper = {{ open = {opened}, closed = {closed} }}  # ? {mark}\n"


def _written_angles(facts: SketchFacts, pin: int) -> dict[int, str]:
    """The angles that a sketch writes to the servo at a pin, each with the names at its writes."""
    names: dict[int, str] = {}
    for write in _writes(facts, pin):
        found = facts.pins(write) or Pins()
        calls = [write] if len(found) == 1 else list(facts.named(write.function))
        for call in calls:
            angles = facts.pins(call) or Pins()
            angle = next(iter(angles)) if len(angles) == 1 else _HALF_TURN + 1
            if angle in found and angle <= _HALF_TURN:
                names[angle] = f"{names.get(angle, '')} {call.function} {facts.spelled(call)}"
    return names


def guess_lines(wiring: Wiring, text: str) -> Iterator[str]:
    """Lines about the angles of a gripper that are the draft's own, by the mark in the file's text."""
    lines = text.splitlines()
    for servo in wiring.servos:
        line = re.match(rf"{re.escape(WIRING_FILE)}:(\d+):", servo.place_of("gripper"))
        guess = (
            _GUESS.search(lines[int(line[1]) - 1]) if line is not None and servo.open is not None else None
        )
        if guess is not None:
            angles = f"open = {servo.open:g}, closed = {servo.closed:g}"
            told = f"{angles} is a guess of the draft: {guess[1]}"
            yield f"{servo.label}: {told}; correct it, and take the mark away"
