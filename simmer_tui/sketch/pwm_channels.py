"""Channels of an ESP32's PWM: their pins, and ledcWrite taken for analogWrite. A channel is never taken for a
pin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from simmer_tui.sketch.cpp_tokens import Token, TokenKind
from simmer_tui.sketch.sketch_source import MOST_CALLS, SketchCall
from simmer_tui.sketch.sketch_values import CHANNEL, DEEPEST, Bindings, Pins, SketchValues

_Attached = tuple[int, int, tuple[Token, ...]]
"""A channel, a pin of it, and how the pin is written."""


def follow_channels(sketch: SketchValues) -> None:
    """Take ledcWrite of an ESP32 for analogWrite: it has a pin, or the number of a channel that ledcAttachPin
    or ledcSetup has made."""
    if sketch.kind.int_bits == 16:
        return
    has_channels = any(sketch.named("ledcAttachPin", "ledcSetup"))
    if has_channels:
        for channel, pin, spelling in _attached(sketch):
            sketch.channels.setdefault(channel, {}).setdefault(pin, spelling)
    made: list[SketchCall] = []
    for call in sketch.calls:
        if call.name != "ledcWrite" or len(call.arguments) < 2:
            made.append(call)
            continue
        argument, *rest = call.arguments
        found: list[tuple[Token, ...]] = [argument]
        if has_channels:
            whole = sketch.whole(call, 0)
            found = []
            for pin, spelling in sketch.channels.get(-1 if whole is None else whole, {}).items():
                is_known = sketch.values(spelling, call.function) == Pins({pin})
                number = replace(call.token, kind=TokenKind.NUMBER, text=str(pin))
                found.append(spelling if is_known else (number,))
            if not found:
                marks = (replace(call.token, kind=TokenKind.MARK, text=mark) for mark in "[]")
                opened, closed = marks
                found = [(replace(call.token, text=CHANNEL), opened, *argument, closed)]
        made += [replace(call, name="analogWrite", arguments=(each, *rest)) for each in found]
    sketch.calls = made


def _attached(sketch: SketchValues) -> Iterator[_Attached]:
    """The channels that ledcAttachPin gives to a pin, in loops over arrays, helpers and methods as well:
    channel, pin, and how the pin is written. Those that are unknown are missing."""
    by_function = sketch.by_function()
    left = [MOST_CALLS]

    def walk(
        function: str, bound: Bindings, names: Mapping[str, tuple[Token, ...]], depth: int
    ) -> Iterator[_Attached]:
        for call in by_function.get(function, ()):
            for given in sketch.rounds(call, bound):
                left[0] -= 1
                if left[0] < 0:
                    return
                called = call.type or call.name
                if call.name == "ledcAttachPin" and len(call.arguments) > 1:
                    pin, channel = (sketch.values(each, function, 0, given) for each in call.arguments[:2])
                    if pin is not None and channel is not None and len(pin) == len(channel) == 1:
                        spelling = _spelling(sketch, call.arguments[0], function, given, names)
                        yield next(iter(channel)), next(iter(pin)), spelling
                elif called in sketch.functions and depth < DEEPEST:
                    made = sketch.objects_of(call.owner, function, given)
                    own = sketch.own_values(made[0]) if len(made) == 1 else {}
                    passed = {
                        name: _spelling(sketch, argument, function, given, names)
                        for name, argument in zip(sketch.parameters[called], call.arguments, strict=False)
                    }
                    yield from walk(called, {**own, **sketch.bindings(call, given)}, passed, depth + 1)

    for function in by_function:
        yield from walk(function, {}, {}, 0)
    # The methods of an object without a name of its own, as those in an array.
    for call in sketch.calls:
        if not call.type and not call.object and call.name in sketch.class_methods[call.name]:
            for method in dict.fromkeys(sketch.class_methods[call.name]):
                yield from walk(method, sketch.bindings(call, None), {}, 0)


def _spelling(
    sketch: SketchValues,
    argument: tuple[Token, ...],
    function: str,
    bound: Bindings,
    names: Mapping[str, tuple[Token, ...]],
) -> tuple[Token, ...]:
    """The argument as it is written where its value is given: in an array, or by a caller."""
    if len(argument) == 1:
        return names.get(argument[0].text, argument)
    if len(argument) > 3 and argument[1].text == "[" and argument[-1].text == "]":
        rows = [
            row
            for each in sketch.arrays_of(argument[0].text, function, bound)
            for row in sketch.picked(each, argument[2:-1], function, 0, bound)
        ]
        if len(rows) == 1 and len(rows[0]) == 1:
            return rows[0][0]
    return argument
