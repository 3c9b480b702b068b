"""Sides of the robot for the draft of a wiring.toml: the wheel of a motor or an encoder by the names that its
pins, its object and its own functions have, or by the functions that turn the robot."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from simmer_tui.sketch.motion_check import forward_levels, levels_of_functions, promised_turn
from simmer_tui.sketch.motor_draft import DraftMotor
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_steps import WRITES
from simmer_tui.sketch.sketch_values import Pins

WHEELS = ("left", "right")
"""The wheels of a draft, in the order in which motors without a name get them."""
_WORDS = (re.compile("left|links", re.IGNORECASE), re.compile("(?<!b)right|rechts", re.IGNORECASE))
_SHORT = (frozenset(("l", "fl", "rl", "bl", "lf", "lb")), frozenset(("r", "fr", "rr", "br", "rf", "rb")))
"""Parts of a name that tell the side: of `motorL`, `EN_R`, and of the four wheels `FL` to `RR`."""
_PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_OWN = re.compile("mot|wheel|set|speed|pwm|rad", re.IGNORECASE)
"""Words in the name of a function that sets one motor: `left()` alone may as well turn the robot."""
_ONE_PIN = (*WRITES, "pinMode", "attach", "digitalRead")
"""Calls whose first argument is a pin."""


def told_side(names: Iterable[str]) -> str:
    """The side that names tell, `left` or `right`; empty if they tell none, or both. Whole words come before
    single letters: both inputs of a BTS7960 have these, `R_EN` and `L_EN`."""
    given = [*names]
    parts = {part.lower() for name in given for part in _PART.findall(name)}
    words = [any(word.search(name) for name in given) for word in _WORDS]
    for is_left, is_right in (words, [bool(parts & each) for each in _SHORT]):
        if is_left or is_right:
            return "" if is_left and is_right else WHEELS[is_right]
    return ""


def side_of_pins(facts: SketchFacts, pins: Iterable[int]) -> str:
    """The side of a part by all names that a sketch has for its pins; empty if it is not known."""
    return told_side(_names(facts, {*pins}))


def _names(facts: SketchFacts, pins: set[int]) -> Iterator[str]:
    together = min(len(pins), 2)
    for call in facts.named(*_ONE_PIN):
        found = facts.pins(call)
        if found is not None and len(found) == 1 and found <= pins:
            yield facts.spelled(call)
            if call.name == "attach":
                yield call.object
    for interrupt in facts.interrupts():
        if interrupt.pins is not None and len(interrupt.pins) == 1 and interrupt.pins <= pins:
            yield interrupt.function
    for call in facts.calls:
        if not call.type and call.name not in facts.functions:
            continue
        # One number may be a speed: two pins of the part tell that the call is about it.
        passed = [facts.pins(call, at) or Pins() for at in range(len(call.arguments))]
        places = [at for at, each in enumerate(passed) if len(each) == 1 and each <= pins]
        if len({pin for at in places for pin in passed[at]}) >= together:
            yield from (facts.spelled(call, at) for at in places)
            if call.type:
                yield call.name
    for name in facts.arrays:
        items = {pin for each in facts.items(name) for pin in each or ()}
        if len(pins) > 1 and pins <= items:
            yield name
    written: dict[str, set[int]] = {}
    for call in facts.named(*WRITES):
        written.setdefault(call.function, set()).update(facts.pins(call) or {-1})
    yield from (name for name, each in written.items() if each <= pins and _OWN.search(name))


def sides_by_turns(facts: SketchFacts, motors: Sequence[DraftMotor]) -> list[str]:
    """The sides of two motors by a function that turns the robot: the right one goes forward to turn left.
    They are empty where no function drives ahead, which tells what forward is."""
    ahead = forward_levels(facts)
    if len(motors) == 2 and all({*each.pins.values()} & ahead.keys() for each in motors):
        for function, _, levels in levels_of_functions(facts):
            turn = promised_turn(function)
            one, other = (_direction(each, levels) for each in motors)
            if turn and one is not None and other is not None and one != other:
                is_first_right = (one > other) == (turn == "left")
                return [*reversed(WHEELS)] if is_first_right else [*WHEELS]
    return ["" for _ in motors]


def _direction(motor: DraftMotor, levels: Mapping[int, float]) -> float | None:
    """The direction of a motor at these levels of pins, positive ahead; None if they do not tell it."""
    given = {name: levels.get(pin) for name, pin in motor.pins.items()}
    power = 1.0 if (duty := given.get("en", given.get("pwm"))) is None else duty
    if (way := given.get("dir")) is not None:
        return power * (1.0 - 2.0 * way if motor.reversed else 2.0 * way - 1.0)
    one, other = given.get("in1"), given.get("in2")
    return None if one is None or other is None else power * (one - other)
