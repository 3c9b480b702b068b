"""Steps of a sketch: writes and pulses at its pins in the order of its functions, with their values."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from simmer_tui.sketch.sketch_source import MOST_CALLS, SketchCall
from simmer_tui.sketch.sketch_values import CHANNEL, DEEPEST, MOST_LOOKUPS, Bindings, Pins, SketchValues

WRITES = ("digitalWrite", "analogWrite")
"""Calls that write a pin."""
PULSES = ("pulseIn", "pulseInLong")
"""Calls that wait for a pulse at a pin."""
_MOST_LOOPED = 8
"""Most rows of an array that a loop over a function is followed for: a robot has no more motors."""


class SketchStep(Struct, frozen=True):
    """A write or a pulse at one pin, as the sketch does it in one of its functions, `root`, or in a function
    that this one calls."""

    call: str
    pin: int
    name: str
    """The argument, as its author wrote it."""
    value: Pins | None
    """The values that it can write; None if unknown, and for a pulse."""
    root: str
    spot: str
    block: int = -1
    """The innermost braces that it is in."""


def steps(sketch: SketchValues) -> Iterator[SketchStep | None]:
    """The writes and pulses of a sketch, of each function in its order, None between them. A call of one of
    its own functions is followed if it passes values; the others are read by themselves."""
    yield from _walked(sketch, deep=False)


def deep_steps(sketch: SketchValues) -> Iterator[SketchStep | None]:
    """The same with every call of its own functions followed."""
    yield from _walked(sketch, deep=True)


def _walked(sketch: SketchValues, *, deep: bool) -> Iterator[SketchStep | None]:
    by_function = sketch.by_function()
    rows = _rows_of_motors(sketch)
    left = [MOST_LOOKUPS]

    def followed(call: SketchCall, bound: Bindings, depth: int, root: str) -> Iterator[SketchStep | None]:
        """The steps of a function that is called: apart from others if it writes levels and duties."""
        found = [*walk(call.name, bound, depth, root)]
        is_apart = {step.call for step in found if step is not None} >= {*WRITES}
        yield from (None, *found, None) if is_apart else found

    def walk(function: str, bound: Bindings | None, depth: int, root: str) -> Iterator[SketchStep | None]:
        for call in by_function.get(function, ()):
            left[0] -= 1
            if left[0] < 0:
                return
            if call.name in (*WRITES, *PULSES) and call.arguments:
                pins = sketch.values(call.arguments[0], function, 0, bound)
                if pins is None or len(pins) != 1:
                    continue
                value = None
                if call.name in WRITES and len(call.arguments) > 1:
                    value = sketch.values(call.arguments[1], function, 0, bound)
                pin, name = next(iter(pins)), sketch.spelled(call)
                if name.startswith(CHANNEL):
                    written = [each[pin] for each in sketch.channels.values() if pin in each]
                    name = "".join(token.text for token in written[0]) if written else str(pin)
                yield SketchStep(call.name, pin, name, value, root, call.token.spot, call.block)
            elif call.name in sketch.functions and not call.type and depth < DEEPEST:
                for own in _owners(sketch, call, bound):
                    if not call.arguments and not own and not deep:
                        continue
                    given = {**own, **sketch.bindings(call, bound)}
                    index, count = rows.get(call.name, ("", 0))
                    # A loop calls it with the number of each row, which has no value of its own.
                    if given.get(index, Pins()) is None and 1 < count <= _MOST_LOOPED:
                        for row in range(count):
                            yield from followed(call, {**given, index: Pins({row})}, depth + 1, root)
                    else:
                        yield from followed(call, given, depth + 1, root)

    for function in by_function:
        yield from walk(function, None, 0, function)
        yield None
    # An object without a name of its own, `Motor(5, 7, 8)`, has the methods of its class.
    for call in sketch.calls:
        if call.type or call.object or call.name not in sketch.class_methods[call.name]:
            continue
        for method in dict.fromkeys(sketch.class_methods[call.name]):
            yield from walk(method, sketch.bindings(call, None), 0, call.name)
            yield None


def _owners(sketch: SketchValues, call: SketchCall, bound: Bindings | None) -> list[Bindings]:
    """The values that a method has of its object: of each one that it can be, and of its own caller's if it
    has none."""
    scope = sketch.scopes.get(call.name, "")
    if call.object in ("", "this"):
        return [bound or {}] if scope and scope == sketch.scopes.get(call.function, "") else [{}]
    found = sketch.objects_of(call.owner, call.function, bound)[:_MOST_LOOPED]
    # A method of a base class is another class's.
    own = (each for each in found if each.type == scope or call.name not in sketch.class_methods[each.type])
    return [sketch.own_values(each) for each in own] or [{}]


def pulses(sketch: SketchValues) -> Iterator[tuple[int, int]]:
    """The pins of pulses, each after that of the write before it, in loops over arrays as well."""
    by_function = sketch.by_function()
    left = [MOST_CALLS]
    written: list[int] = []

    def walk(function: str, bound: Bindings, depth: int) -> Iterator[tuple[int, int]]:
        body = by_function.get(function, ())
        pulse = next((call for call in body if call.name in PULSES), None)
        for given in [bound] if pulse is None else sketch.rounds(pulse, bound):
            for call in body:
                left[0] -= 1
                if left[0] < 0:
                    return
                if call.name in ("digitalWrite", *PULSES) and call.arguments:
                    pins = sketch.values(call.arguments[0], function, 0, given) or Pins()
                    if call.name == "digitalWrite":
                        written[:] = pins
                    elif len(pins) == len(written) == 1 and not pins.issuperset(written):
                        yield written[0], next(iter(pins))
                elif call.name in sketch.functions and not call.type and depth < DEEPEST:
                    for each in sketch.rounds(call, given):
                        for own in _owners(sketch, call, each):
                            yield from walk(call.name, {**own, **sketch.bindings(call, each)}, depth + 1)

    for function in by_function:
        written.clear()
        yield from walk(function, {}, 0)


def _rows_of_motors(sketch: SketchValues) -> dict[str, tuple[str, int]]:
    """Functions that write a duty to the pin in a row of an array, `analogWrite(pins[i][0], duty)`: the
    name of the row's number, and the number of rows."""
    found: dict[str, tuple[str, int]] = {}
    for call in sketch.named("analogWrite"):
        marks = [token.text for token in call.arguments[0][:4]] if call.arguments else []
        if len(marks) == 4 and marks[1] == "[" and marks[3] == "]":
            count = max(sketch.channels, default=-1) + 1 if marks[0] == CHANNEL else 0
            found.setdefault(call.function, (marks[2], count or len(sketch.arrays.get(marks[0], ()))))
    return found
