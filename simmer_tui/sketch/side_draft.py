"""Places of motors and encoders on the robot, for the draft of a wiring.toml: by the names that their pins,
objects and own functions have, or by the functions that turn the robot."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from msgspec import Struct

from simmer_tui.sketch.motion_check import forward_levels, levels_of_functions, promised_turn
from simmer_tui.sketch.motor_draft import DraftMotor
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_steps import WRITES, deep_steps
from simmer_tui.sketch.sketch_values import Pins

LEFT_SIDE, RIGHT_SIDE, FRONT_END, REAR_END = "left", "right", "front", "rear"
_WORDS = {
    LEFT_SIDE: re.compile("left|links", re.IGNORECASE),
    RIGHT_SIDE: re.compile("(?<!b)right|rechts", re.IGNORECASE),
    FRONT_END: re.compile("front|vorn", re.IGNORECASE),
    REAR_END: re.compile("rear|back(?!w)|hind|hinten", re.IGNORECASE),
}
_PARTS = {
    LEFT_SIDE: frozenset(("l", "fl", "rl", "bl", "lf", "lb", "lr")),
    RIGHT_SIDE: frozenset(("r", "fr", "rr", "br", "rf", "rb")),
    FRONT_END: frozenset(("fl", "lf", "fr", "rf")),
    REAR_END: frozenset(("rl", "bl", "lb", "lr", "rr", "br", "rb")),
}
"""Parts of a name that tell a place: of `motorL`, `EN_R`, and of the four wheels `FL` to `RR`."""
_NO_WHEEL = frozenset(
    ("arm", "lift", "claw", "grip", "gripper", "jaw", "pump", "fan", "brush", "belt", "intake", "winch")
)
"""Parts of a name that tell that a motor turns no wheel."""
_PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_OWN = re.compile("mot|wheel|set|speed|pwm|rad|side|seite", re.IGNORECASE)
"""Words in the name of a function that sets the motors of a side: `left()` may as well turn the robot."""
_ONE_PIN = (*WRITES, "pinMode", "attach", "digitalRead")
"""Calls whose first argument is a pin."""


def parts_of_name(name: str) -> set[str]:
    """The words of a name, in small letters: `motor` and `l` of `motorL`."""
    return {part.lower() for part in _PART.findall(name)}


Written = Mapping[str, set[int]]
"""The pins that each function of a sketch writes."""


class PartPlace(Struct, frozen=True):
    """The place of a motor or an encoder: its side and its end. They are empty where nothing tells them."""

    side: str = ""
    end: str = ""
    is_wheel: bool = True


def place_of_pins(facts: SketchFacts, pins: Iterable[int], written: Written | None = None) -> PartPlace:
    """The place of a part by all names that a sketch has for its pins, and by those of the functions that
    write these and not those of all parts."""
    found = {*pins}
    return told_place([*names_of_pins(facts, found), *_functions(written or {}, found)])


def written_by_functions(facts: SketchFacts) -> Written:
    """The pins that each function writes, itself and by those that it calls."""
    found: dict[str, set[int]] = {}
    for step in deep_steps(facts):
        if step is not None and step.call in WRITES:
            found.setdefault(step.root, set()).add(step.pin)
    return found


def _functions(written: Written, pins: set[int]) -> Iterator[str]:
    every = set().union(*written.values())
    yield from (name for name, each in written.items() if pins <= each < every and _OWN.search(name))


def told_place(names: Sequence[str]) -> PartPlace:
    """The place that names tell. Whole words come before single letters: both inputs of a BTS7960 have these,
    `R_EN` and `L_EN`."""
    parts = [*map(parts_of_name, names)]
    if any(each & _NO_WHEEL for each in parts):
        return PartPlace(is_wheel=False)
    by_words = [{place for place, word in _WORDS.items() if word.search(name)} for name in names]
    by_parts = [{place for place, known in _PARTS.items() if each & known} for each in parts]
    for told in (by_words, by_parts):
        sides = [each for each in told if each & {LEFT_SIDE, RIGHT_SIDE}]
        if sides:
            # `leftBack` beside `leftForward` is a direction: all names that tell the side tell the end.
            return PartPlace(_only(sides, LEFT_SIDE, RIGHT_SIDE), _only(sides, FRONT_END, REAR_END))
    return PartPlace("", _only([each for each in by_words if each], FRONT_END, REAR_END))


def _only(told: Sequence[set[str]], one: str, other: str) -> str:
    """The one of two places that all names tell; empty if they differ."""
    found = {frozenset(each & {one, other}) for each in told}
    return next(iter(min(found))) if len(found) == 1 and len(min(found)) == 1 else ""


def names_of_pins(facts: SketchFacts, pins: set[int]) -> Iterator[str]:
    """All names that a sketch has for these pins: of constants, objects, arrays, functions of interrupts."""
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
    yield from _index_names(facts, pins)
    for name in (*facts.arrays, *facts.aggregates):
        items = {pin for each in facts.items(name) for pin in each or ()}
        if len(pins) > 1 and pins <= items:
            yield name


def _index_names(facts: SketchFacts, pins: set[int]) -> Iterator[str]:
    """Names of the number of a part whose pins are elements of arrays: `LEFT` of `drive(LEFT, 90)`."""
    places: list[set[int]] = []
    for pin in pins:
        rows = (rows for rows in facts.arrays.values() if len(rows) > 1)
        found = ((at, row) for each in rows for at, row in enumerate(each))
        places.append({at for at, row in found if any(facts.values(item) == Pins({pin}) for item in row)})
    together = set.intersection(*places) if places else set()
    if len(pins) < 2 or len(together) != 1:
        return
    for call in facts.calls:
        if call.name not in facts.functions or call.type:
            continue
        for argument in call.arguments:
            # Also of `&motors[LEFT]`.
            index = argument[-2:-1] if argument and argument[-1].text == "]" else argument
            is_name = len(index) == 1 and index[0].is_name
            if is_name and facts.values(index, call.function) == Pins(together):
                yield index[0].text


def sides_by_turns(facts: SketchFacts, motors: Sequence[DraftMotor]) -> list[str]:
    """The sides of motors by a function that turns the robot: the right ones go forward to turn left. They
    are empty where no function drives ahead, which tells what forward is."""
    ahead = forward_levels(facts)
    if len(motors) > 1 and all({*each.pins.values()} & ahead.keys() for each in motors):
        for function, _, levels in levels_of_functions(facts):
            turn = promised_turn(function)
            ways = [way for each in motors if (way := _direction(each, levels)) is not None]
            if turn and len(ways) == len(motors) and max(ways) > min(ways):
                faster, slower = (RIGHT_SIDE, LEFT_SIDE) if turn == LEFT_SIDE else (LEFT_SIDE, RIGHT_SIDE)
                middle = (max(ways) + min(ways)) / 2
                return [faster if way > middle else slower for way in ways]
    return ["" for _ in motors]


def ends_differ(facts: SketchFacts, motors: Sequence[DraftMotor], places: Sequence[PartPlace]) -> bool:
    """True if a function turns the two wheels of a side against each other, as mecanum wheels do."""
    for _, _, levels in levels_of_functions(facts):
        ways: dict[str, list[float]] = {}
        for motor, place in zip(motors, places, strict=True):
            ways.setdefault(place.side, []).append(_direction(motor, levels) or 0.0)
        if any(min(each) < 0.0 < max(each) for side, each in ways.items() if side):
            return True
    return False


def _direction(motor: DraftMotor, levels: Mapping[int, float]) -> float | None:
    """The direction of a motor at these levels of pins, positive ahead; None if they do not tell it."""
    given = {name: levels.get(pin) for name, pin in motor.pins.items()}
    power = 1.0 if (duty := given.get("en", given.get("pwm"))) is None else duty
    if (way := given.get("dir")) is not None:
        return power * (1.0 - 2.0 * way if motor.reversed else 2.0 * way - 1.0)
    one, other = given.get("in1"), given.get("in2")
    return None if one is None or other is None else power * (one - other)
