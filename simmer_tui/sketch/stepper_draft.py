"""Steppers for the draft of a wiring.toml: objects of AccelStepper and Stepper, and pins pulsed by hand."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from simmer_tui.sketch.motion_check import forward_levels, is_inverted
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_values import Pins

_DIRECTION, _ENABLE, _STEP = (
    re.compile(word, re.IGNORECASE) for word in ("dir", r"enable|^en_?\w?(pin)?$|_en(pin)?$", "step|stp|pul")
)
_TWO_PINS, _FOUR_PINS = (Pins({1}), Pins({2})), (Pins({4}), Pins({8}))
"""Kinds of AccelStepper, its first argument, by the number of their pins."""
# Steps a turn of a 28BYJ-48, as its sketches have them: with its gear of about 1/64, or without it.
_GEARED = frozenset((32, 64, 513, 2037, 2038, 2048, 4076, 4096))


class DraftStepper(Struct, frozen=True):
    """A stepper that was read off a sketch: its driver and pins. `enable_high` is True if the sketch enables
    it by HIGH."""

    driver: str
    pins: Mapping[str, int]
    enable_high: bool = False
    reversed: bool = False
    """True if the sketch turns its direction round to drive ahead."""


def draft_steppers(facts: SketchFacts, taken: set[int]) -> list[DraftStepper]:
    """The steppers of a sketch, none at pins that are taken."""
    found = [*_objects(facts), *_pulsed(facts, taken)]
    return [each for each in found if not taken.intersection(each.pins.values())]


def _objects(facts: SketchFacts) -> Iterator[DraftStepper]:
    for call in facts.objects("AccelStepper"):
        kind = facts.pins(call)
        # Two wires make the rises of a driver as well: one in four steps, with the direction beside it.
        if kind in _TWO_PINS:
            pairs = zip(facts.ordered_pins(call, 1), facts.ordered_pins(call, 2), strict=False)
            for step, way in pairs:
                pins = {"step": step, "dir": way}
                pins |= _enable(facts, call.name)
                is_high, is_turned = _is_high(facts, call.name), is_inverted(facts, call.name)
                yield DraftStepper("step_dir", pins, is_high, is_turned)
        elif kind in _FOUR_PINS:
            yield from _coils(facts, call, is_geared=False)
    for call in facts.objects("Stepper"):
        yield from _coils(facts, call, is_geared=bool(_GEARED & (facts.pins(call) or frozenset())))


def _coils(facts: SketchFacts, call: SketchCall, *, is_geared: bool) -> Iterator[DraftStepper]:
    """The four pins of a constructor. For an ULN2003 a sketch has the middle two the other way round."""
    pins = [facts.ordered_pins(call, at) for at in range(1, 5)]
    if any(len(each) != 1 for each in pins):
        return
    one, two, three, four = (each[0] for each in pins)
    if is_geared or one < three < two < four or one > three > two > four:
        yield DraftStepper("uln2003", {"in1": one, "in2": three, "in3": two, "in4": four})
    else:
        yield DraftStepper("stepper4", {"in1": one, "in2": two, "in3": three, "in4": four})


def _enable(facts: SketchFacts, name: str) -> dict[str, int]:
    """The enable pin of an object: its own, or else one that the sketch writes."""
    for call, bound in facts.methods(name, "setEnablePin"):
        pins = facts.values(call.arguments[0], call.function, 0, bound) if call.arguments else None
        if pins is not None and len(pins) == 1:
            return {"enable": next(iter(pins))}
    # An object in an array, or behind a pointer, has no name of its own.
    others = {each.name for each in facts.objects("AccelStepper")}
    for call in facts.named("setEnablePin"):
        ordered = facts.ordered_pins(call, 0)
        if len(ordered) == 1 and call.object not in others:
            return {"enable": ordered[0]}
    return _written_enable(facts)


def _written_enable(facts: SketchFacts) -> dict[str, int]:
    for call in facts.named("digitalWrite"):
        pins = facts.ordered_pins(call, 0)
        if len(pins) == 1 and _ENABLE.search(facts.spelled(call)):
            return {"enable": pins[0]}
    return {}


def _is_high(facts: SketchFacts, name: str) -> bool:
    """True if an object enables its driver by HIGH: it has an enable pin that is not inverted."""
    if not any(facts.methods(name, "setEnablePin")):
        return False
    calls = (call for call, _ in facts.methods(name, "setPinsInverted"))
    return not any(facts.spelled(call, 2) in ("true", "1", "HIGH") for call in calls)


def _pulsed(facts: SketchFacts, taken: set[int]) -> Iterator[DraftStepper]:
    """Pins that are set HIGH and LOW in a function with delayMicroseconds, or are named so, and a direction
    each."""
    waiting = {call.function for call in facts.named("delayMicroseconds")}
    steps: dict[int, str] = {}
    ways: dict[int, str] = {}
    levels: dict[tuple[str, str], set[int]] = {}
    writes = [call for call in facts.named("digitalWrite") if len(call.arguments) > 1]
    for call in writes:
        name = facts.spelled(call)
        value = facts.pins(call, 1) or frozenset()
        pulse = levels.setdefault((call.function, name), set())
        pulse |= value
        if _DIRECTION.search(name):
            ways |= {pin: name for pin in facts.ordered_pins(call, 0) if pin not in ways}
        elif pulse >= {0, 1} and (_STEP.search(name) or call.function in waiting):
            steps |= {pin: name for pin in facts.ordered_pins(call, 0) if pin not in steps}
    enable = _written_enable(facts)
    rest = [pin for pin in steps if pin not in taken and pin not in enable.values()]
    for step, way in _paired(rest, [pin for pin in ways if pin not in taken], steps, ways):
        ahead = forward_levels(facts, steps)
        yield DraftStepper("step_dir", {"step": step, "dir": way} | enable, reversed=ahead.get(way) == 0.0)


def _paired(
    steps: Sequence[int], ways: Sequence[int], step_names: Mapping[int, str], way_names: Mapping[int, str]
) -> list[tuple[int, int]]:
    """Steps with their directions: by what their names have beside these words, else in their order."""

    def stem(name: str) -> str:
        return re.sub("step|stp|pulse?|dir(ection)?|pin|_", "", name.lower())

    by_stem = {stem(way_names[pin]): pin for pin in ways}
    if len({stem(step_names[pin]) for pin in steps}) == len(steps) == len(by_stem) and all(
        stem(step_names[pin]) in by_stem for pin in steps
    ):
        return [(pin, by_stem[stem(step_names[pin])]) for pin in steps]
    return list(zip(steps, ways, strict=False)) if len(steps) == len(ways) else []
