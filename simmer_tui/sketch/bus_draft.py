"""Parts on a board's I2C bus, as a sketch shows them: for `init --sketch`.

An XSHUT pin is the one that was released last, to HIGH or as an input, and not pulled low again, before its
ranger is begun or gets its address.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from msgspec import Struct

from simmer_tui.sketch.bus_check import BEGUN_GYRO_CLASS, GYRO_CLASS, RANGER_CLASSES, addresses
from simmer_tui.sketch.cpp_tokens import Token
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.wiring import GYRO_ADDRESSES, RANGER_ADDRESS

_OF_A_GYRO = re.compile(r"dmp|mpu|imu|gyro|dataready", re.IGNORECASE)
_SHUT = re.compile(r"x?_?shu?t|shdn", re.IGNORECASE)
# More than a bus of 32 parts has.
_MOST_RANGERS = 16


class DraftGyro(Struct, frozen=True):
    """An MPU6050 that was read off a sketch; `interrupt` is None without a pin."""

    address: int
    interrupt: int | None


class DraftRanger(Struct, frozen=True):
    """A VL53L0X that was read off a sketch; None for what it does not show."""

    xshut: int | None
    address: int | None


def draft_gyros(facts: SketchFacts) -> list[DraftGyro]:
    """The gyros of a sketch, by its objects, or by the addresses that it calls."""
    declared = [GYRO_ADDRESSES[0] for each in facts.declared if each.type == GYRO_CLASS]
    named = [pins for call in facts.objects(GYRO_CLASS) for pins in (facts.pins(call),) if pins]
    begun = {each.name for each in facts.declared if each.type == BEGUN_GYRO_CLASS}
    begins = {call.object: facts.pins(call) for call in facts.named("begin") if call.object in begun}
    named += [begins.get(name) or Pins({GYRO_ADDRESSES[0]}) for name in sorted(begun)]
    found = {*declared, *(min(each) for each in named)} & {*GYRO_ADDRESSES}
    found = found or {each for pins in addresses(facts) for each in pins or ()} & {*GYRO_ADDRESSES}
    pins = [
        pin
        for each in facts.interrupts()
        if _OF_A_GYRO.search(each.function)
        for pin in each.pins or ()
        if len(each.pins or ()) == 1
    ]
    return [
        DraftGyro(address, pins[at] if at < len(pins) else None) for at, address in enumerate(sorted(found))
    ]


def draft_rangers(facts: SketchFacts) -> list[DraftRanger]:
    """The rangers of a sketch, in the order of their objects."""
    counts: dict[str, int] = {}
    for each in facts.declared:
        if each.type in RANGER_CLASSES:
            size = facts.values(each.count) if each.count else None
            counts[each.name] = min(max(size), _MOST_RANGERS) if size else 1
    pins: dict[str, list[int | None]] = {}
    named: dict[str, list[int | None]] = {}
    released: list[list[int | None]] = []
    edged = {pin for each in facts.interrupts() for pin in each.pins or ()}
    function = ""
    for call in facts.calls:
        if call.function != function:
            function, released = call.function, []
        if _releases(facts, call):
            freed = _elements(facts, call.arguments[0], call.function)
            # An input with a pull-up is mostly an encoder's.
            if edged.isdisjoint(each for each in freed if each is not None):
                released.append(freed)
        elif _holds(facts, call):
            held = _elements(facts, call.arguments[0], call.function)
            released = [each for each in released if each != held]
        elif call.object in counts and call.name in ("init", "begin", "setAddress"):
            free = [each for each in released if each not in pins.values()]
            if free and free[-1]:
                pins.setdefault(call.object, free[-1])
            released = []
            if call.arguments and call.name != "init":
                given = _elements(facts, call.arguments[0], call.function)
                if given:
                    named.setdefault(call.object, given)
    unknown = [pin for pin in _shut_pins(facts) if not any(pin in each for each in pins.values())]
    found = []
    for name, count in counts.items():
        own = pins.get(name, [])
        for at in range(count):
            xshut = own[at] if at < len(own) else None
            if xshut is None and unknown:
                xshut = unknown.pop(0)
            given = named.get(name, [])
            found.append(DraftRanger(xshut, given[at] if at < len(given) else None))
    # One address for several parts was not understood.
    twice = [each.address for each in found]
    return [
        each
        if twice.count(each.address) == 1 and each.address != RANGER_ADDRESS
        else DraftRanger(each.xshut, None)
        for each in found
    ]


def _releases(facts: SketchFacts, call: SketchCall) -> bool:
    """True for a call that lets a pin be high."""
    if call.name == "pinMode":
        return facts.spelled(call, 1) in ("INPUT", "INPUT_PULLUP")
    return call.name == "digitalWrite" and facts.pins(call, 1) == Pins({1})


def _holds(facts: SketchFacts, call: SketchCall) -> bool:
    """True for a call that pulls a pin low."""
    return call.name == "digitalWrite" and facts.pins(call, 1) == Pins({0})


def _shut_pins(facts: SketchFacts) -> Iterator[int]:
    """Pins whose names are those of an XSHUT, in the order of the text."""
    seen: set[int] = set()
    for call in facts.named("pinMode", "digitalWrite"):
        if call.arguments and _SHUT.search(facts.spelled(call)):
            for pin in _elements(facts, call.arguments[0], call.function):
                if pin is not None and pin not in seen:
                    seen.add(pin)
                    yield pin


def _elements(facts: SketchFacts, expression: Sequence[Token], function: str) -> list[int | None]:
    """The values of an expression for each turn of a loop: of `pins[i]` the array's elements, of `0x30 + i`
    numbers that go on, else its one value."""
    marks = [token.text for token in expression]
    members = facts.each_member(expression, function)
    if members:
        return [min(each) if each is not None and len(each) == 1 else None for each in members]
    if len(marks) == 4 and marks[1] == "[" and marks[3] == "]" and facts.items(marks[0]):
        values = facts.items(marks[0])
        # Another index than a number is a loop's variable.
        number = int(marks[2]) if marks[2].isdecimal() else len(values)
        chosen = [values[number]] if number < len(values) else values
        return [min(each) if each is not None and len(each) == 1 else None for each in chosen]
    if len(marks) == 3 and marks[1] == "+":
        first = facts.values(expression[:1], function) or facts.values(expression[2:], function)
        if first is not None and len(first) == 1:
            return [min(first) + turn for turn in range(_MOST_RANGERS)]
    one = facts.values(expression, function)
    return [min(one)] if one is not None and len(one) == 1 else []
