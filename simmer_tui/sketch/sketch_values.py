"""Values of a sketch's expressions, as far as its text tells them: numbers, constants, elements of arrays,
sums and products of these, and what the callers of a function pass. Others are unknown, never guessed."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence

from msgspec import Struct

from simmer_tui.sketch.boards import BoardKind
from simmer_tui.sketch.cpp_arithmetic import combined, last_operator
from simmer_tui.sketch.cpp_tokens import Token, TokenKind
from simmer_tui.sketch.sketch_source import (
    LONGEST_CALL,
    MOST_VALUES,
    Row,
    SketchCall,
    SketchLoop,
    SketchSource,
)
from simmer_tui.sketch.token_lists import partners_of, split, without_casts

_WHOLE = re.compile(r"(0[xX][0-9a-fA-F]+|0[bB][01]+|[0-9]+)[uUlL]*")
_ANALOG_PIN = re.compile(r"A([0-9]|1[0-9])")
_NAMED = {
    "LED_BUILTIN": 13,
    "HIGH": 1,
    "LOW": 0,
    "true": 1,
    "false": 0,
    **dict.fromkeys(("MPU6050_ADDRESS_AD0_LOW", "MPU6050_DEFAULT_ADDRESS"), 0x68),
    "MPU6050_ADDRESS_AD0_HIGH": 0x69,
    "VL53L0X_I2C_ADDR": 0x29,
    # Kinds of AccelStepper.
    "DRIVER": 1,
    "FULL2WIRE": 2,
    "FULL4WIRE": 4,
    "HALF4WIRE": 8,
}
"""Constants of the core and of libraries."""
# Judged: a function of motors that calls one of a motor that calls one of a pin.
DEEPEST = 4
"""Callers of callers that are followed for the value of a parameter."""
MOST_LOOKUPS = 200_000
"""Most values that are looked up in a sketch; later ones are unknown."""
CHANNEL = "ledc channel"
"""The name of the pins of an ESP32's PWM by channel, `ledc channel[0]`: no sketch can have this name."""
MOST_ROUNDS = 16
"""Rounds of a loop that are followed: the channels of an ESP32's PWM."""

_NAMED_VALUE = 3
"""Tokens before the value of `.en = 5`."""

Pins = frozenset[int]
Bindings = Mapping[str, "Pins | str | SketchObject | None"]
"""Values of a function's parameters at one of its calls; of an array, its name."""


class SketchObject(Struct, frozen=True):
    """An object of one of the sketch's classes: the values of its members as its braces have them, or those
    of the parameters of its constructor."""

    type: str
    members: Mapping[str, tuple[Token, ...]]
    bound: Bindings


class SketchValues(SketchSource):
    """The text of one sketch, with the values of its expressions."""

    def __init__(self, sources: Mapping[str, str], kind: BoardKind) -> None:
        super().__init__(sources, kind)
        self.looked_up = 0
        """Values that were looked up so far."""
        self.channels: dict[int, dict[int, tuple[Token, ...]]] = {}
        """The pins of each channel of an ESP32's PWM, with how they are written."""
        self.callers: dict[str, list[SketchCall]] = defaultdict(list)
        for call in self.calls:
            # The definition of an object calls its class's constructor.
            self.callers[call.type or call.name].append(call)
        self.bases: dict[str, list[tuple[str, list[tuple[Token, ...]]]]] = {}
        """The values that a constructor gives to those of its base classes, by class."""
        for constructor, base, value in self.values_of_members:
            if base in self.functions:
                self.bases.setdefault(constructor, []).append((base, split(value)))
        self._objects: dict[str, list[SketchObject]] = {}
        """The objects of each class that was asked for."""
        self._definitions = {
            call.name: call for call in self.calls if call.type in self.classes or call.type in self.functions
        }

    def named(self, *names: str) -> Iterator[SketchCall]:
        """The calls of these names, in the order of the text."""
        return (call for call in self.calls if call.name in names)

    def by_function(self) -> dict[str, list[SketchCall]]:
        """The calls in each of its functions, in the order of the text."""
        found: dict[str, list[SketchCall]] = {}
        for call in self.calls:
            found.setdefault(call.function, []).append(call)
        return found

    def pins(self, call: SketchCall, index: int = 0) -> Pins | None:
        """The pins that an argument of a call can be; None if that is unknown."""
        if index >= len(call.arguments):
            return None
        loops = {loop.name: values for loop in call.loops if (values := self._looped(loop, call.function))}
        bound = {name: Pins(values) for name, values in loops.items()}
        found = self.values(call.arguments[index], call.function, 0, bound or None)
        if found is not None and call.name == "analogRead":
            return Pins(map(self.kind.analog_pin, found))
        return found

    def whole(self, call: SketchCall, index: int) -> int | None:
        """The number of an argument; None if it has several, or is unknown."""
        pins = self.pins(call, index)
        return next(iter(pins)) if pins is not None and len(pins) == 1 else None

    def spelled(self, call: SketchCall, index: int = 0) -> str:
        """The text of an argument, as its author wrote it."""
        return "".join(token.text for token in call.arguments[index]) if index < len(call.arguments) else ""

    def values(
        self,
        expression: Sequence[Token],
        function: str = "",
        depth: int = 0,
        bound: Bindings | None = None,
    ) -> Pins | None:
        """The whole numbers that an expression in a function can be; None if that is unknown. Parameters have
        the values that are `bound`, or those of all callers."""
        self.looked_up += 1
        if depth > DEEPEST or self.looked_up > MOST_LOOKUPS:
            return None
        tokens = without_casts(expression[:LONGEST_CALL])
        if not tokens:
            return None
        first = tokens[0]
        if len(tokens) == 1:
            return self._value_of(first, function, depth, bound)
        marks = [token.text for token in tokens]
        if marks[1:-1] == ["::"]:
            return self._value_of(tokens[2], "", depth, None)
        if first.text == CHANNEL:
            return self.pins_of_channel(self.values(tokens[2:-1], function, depth + 1, bound))
        if first.text == "sizeof":
            return self._count_of(marks)
        if "?" in marks and ":" in marks:
            half, end = marks.index("?"), marks.index(":")
            chosen = self._is_true(tokens[:half], function, depth, bound)
            if chosen is not None:
                part = tokens[half + 1 : end] if chosen else tokens[end + 1 :]
                return self.values(part, function, depth + 1, bound)
            one = self.values(tokens[half + 1 : end], function, depth + 1, bound)
            other = self.values(tokens[end + 1 :], function, depth + 1, bound)
            return None if one is None or other is None else one | other
        at = last_operator(tokens)
        if at:
            one = self.values(tokens[:at], function, depth + 1, bound)
            other = self.values(tokens[at + 1 :], function, depth + 1, bound)
            return None if one is None or other is None else combined(one, marks[at], other)
        if marks[-2] in (".", "->") and tokens[-1].is_name:
            if marks[:-2] == ["this"]:
                return self._value_of(tokens[-1], function, depth, bound)
            found = self.objects_of(tokens[:-2], function, bound, depth)
            return union(self.member(each, tokens[-1], depth) for each in found) if found else None
        if first.text in self.returned and marks[1] == "(" and partners_of(tokens).get(1) == len(tokens) - 1:
            names, given = self.parameters[first.text], split(tokens[2:-1])
            passed = self._bound(names, given, function, bound)
            returned = self.returned[first.text]
            return union(self.values(each, first.text, depth + 1, passed) for each in returned)
        if first.is_name and marks[1] == "[" and marks[-1] == "]":
            end = partners_of(tokens).get(1, len(tokens) - 1)
            items: list[tuple[Token, ...]] = []
            for rows in self.arrays_of(first.text, function, bound):
                picked = self.picked(rows, tokens[2:end], function, depth, bound)
                if end + 1 < len(tokens):
                    second = tokens[end + 2 : -1]
                    inner = (tuple((each,) for each in row) for row in picked)
                    picked = tuple(
                        row for each in inner for row in self.picked(each, second, function, depth, bound)
                    )
                items += [item for row in picked for item in row]
            return union(self.values(item, "", depth + 1) for item in items) if items else None
        return None

    def _is_true(
        self, condition: Sequence[Token], function: str, depth: int, bound: Bindings | None
    ) -> bool | None:
        """True or False if both sides of `a == b` or `a != b` are known; None for another condition."""
        tokens = without_casts(condition)
        at = next((place for place, each in enumerate(tokens) if each.text in ("==", "!=")), 0)
        if not at:
            return None
        one, other = (
            self.values(each, function, depth + 1, bound) for each in (tokens[:at], tokens[at + 1 :])
        )
        if one is None or other is None or len(one) != 1 or len(other) != 1:
            return None
        return (one == other) == (tokens[at].text == "==")

    def objects_of_class(self, kind: str) -> list[SketchObject]:
        """The objects of one of the sketch's own classes, in the order of the text, or of their array."""
        if kind in self._objects:
            return self._objects[kind]
        found = self._objects[kind] = []
        for name, own in self.types.items():
            if own == kind and name in self.arrays:
                found += self.objects_in(name)
            elif own == kind and name in self.aggregates:
                found += self._made(kind, self.aggregates[name], "", None)
            elif own == kind and name in self._definitions:
                call = self._definitions[name]
                found += self._made(kind, call.arguments, call.function, None)
        return found

    def objects_in(self, array: str) -> list[SketchObject]:
        """The objects of the sketch's own classes in an array; none of another array."""
        kind = self.types.get(array, "")
        return [made for row in self.arrays.get(array, ()) for made in self._of_row(kind, row, 1)]

    def _of_row(self, kind: str, row: Row, depth: int) -> list[SketchObject]:
        """The object in a row of an array: by its own expression, or by the values in its braces."""
        own = self.objects_of(row[0], "", None, depth + 1) if len(row) == 1 else []
        return own or self._made(kind, row, "", None)

    def objects_of(
        self, expression: Sequence[Token], function: str, bound: Bindings | None, depth: int = 0
    ) -> list[SketchObject]:
        """The objects of the sketch's own classes that an expression can mean; none if that is unknown."""
        self.looked_up += 1
        if self.looked_up > MOST_LOOKUPS:
            return []
        tokens = without_casts(expression)
        if tokens and tokens[0].text in ("&", "*"):
            tokens = without_casts(tokens[1:])
        if not tokens or not tokens[0].is_name or depth > DEEPEST:
            return []
        name, kind = tokens[0].text, self.types.get(tokens[0].text, "")
        if len(tokens) > 1:
            if tokens[1].text in ("(", "{") and name in self.classes:
                return self._made(name, split(tokens[2:-1]), function, bound)
            if tokens[1].text != "[" or tokens[-1].text != "]":
                return []
            rows = [
                row
                for each in self.arrays_of(name, function, bound)
                for row in self.picked(each, tokens[2:-1], function, depth, bound)
            ]
            return [made for row in rows for made in self._of_row(kind, row, depth)]
        given = bound.get(name) if bound is not None else None
        if isinstance(given, SketchObject):
            return [given]
        names = self.parameters.get(function, ())
        if name in names:
            at = names.index(name)
            passed = [call for call in self.callers[function] if at < len(call.arguments)]
            return [
                made
                for call in passed
                for made in self.objects_of(call.arguments[at], call.function, None, depth + 1)
            ]
        if name in self.aggregates:
            return self._made(kind, self.aggregates[name], "", None)
        if name in self._definitions:
            call = self._definitions[name]
            return self._made(call.type, call.arguments, call.function, None)
        return [
            made
            for value, inside in self.expressions.get(name, ())
            for made in self.objects_of(value, inside, None, depth + 1)
        ]

    def _made(
        self, kind: str, given: Sequence[tuple[Token, ...]], function: str, bound: Bindings | None
    ) -> list[SketchObject]:
        """The object of a class with these values; none of another class."""
        if kind in self.parameters:
            own = self._bound(self.parameters[kind], given, function, bound)
            for base, values in self.bases.get(kind, ()):
                own |= self._bound(self.parameters.get(base, ()), values, kind, own)
            return [SketchObject(kind, {}, own)]
        if kind not in self.classes:
            return []
        members = dict(zip(self.classes[kind].members, given, strict=False))
        if given and given[0] and given[0][0].text == ".":
            members = {each[1].text: each[3:] for each in given if len(each) > _NAMED_VALUE}
        return [SketchObject(kind, members, {})]

    def member(self, made: SketchObject, name: Token, depth: int) -> Pins | None:
        """The value of an object's member."""
        if name.text in made.members:
            return self.values(made.members[name.text], "", depth + 1)
        return self._value_of(name, made.type, depth, made.bound)

    def objects_with(self, name: str, function: str) -> list[SketchObject]:
        """The objects that a method may have, if a name in it is a member; none of another name."""
        kind = self.scopes.get(function, "")
        is_member = kind in self.classes and name in self.classes[kind].members
        return self.objects_of_class(kind) if is_member else []

    def own_values(self, made: SketchObject) -> Bindings:
        """The values of names in the methods of an object: its members, or its constructor's parameters."""
        return {**made.bound, **{name: self.values(value) for name, value in made.members.items()}}

    def arrays_of(self, name: str, function: str, bound: Bindings | None) -> list[tuple[Row, ...]]:
        """The rows of an array, by the name of a parameter those of all that it can be; none if unknown."""
        given = bound.get(name) if bound is not None else None
        if isinstance(given, str):
            return [self.arrays[given]]
        if name in self.arrays:
            return [self.arrays[name]]
        names = self.parameters.get(function, ())
        if name not in names:
            return []
        found: list[tuple[Row, ...]] = []
        for call in self.callers[function]:
            passed = call.arguments[names.index(name)] if names.index(name) < len(call.arguments) else ()
            if len(passed) != 1 or passed[0].text not in self.arrays:
                return []
            found.append(self.arrays[passed[0].text])
        return found

    def picked(
        self,
        rows: tuple[Row, ...],
        index: Sequence[Token],
        function: str,
        depth: int,
        bound: Bindings | None,
    ) -> tuple[Row, ...]:
        """The rows of an array that an index can mean."""
        found = self.values(index, function, depth + 1, bound)
        if found is None or max(found, default=0) >= len(rows):
            return rows
        return tuple(rows[each] for each in sorted(found))

    def rounds(self, call: SketchCall, bound: Bindings) -> Iterator[Bindings]:
        """The values at each round of the loops around a call, or of a loop whose number picks the elements
        of an array that are passed."""
        for loop in call.loops:
            made = self.objects_in(loop.array) if loop.name not in bound else []
            if made:
                for each in made[:MOST_ROUNDS]:
                    yield from self.rounds(call, {**bound, loop.name: each})
                return
            found = self._looped(loop, call.function, bound)
            if 1 < len(found) <= MOST_ROUNDS and loop.name not in bound:
                for value in found:
                    yield from self.rounds(call, {**bound, loop.name: Pins({value})})
                return
        for argument in call.arguments:
            marks = [token.text for token in argument[:4]]
            if len(marks) < 4 or marks[1] != "[" or marks[3] != "]" or not argument[2].is_name:
                continue
            arrays = self.arrays_of(marks[0], call.function, bound)
            if arrays and self.values(argument[2:3], call.function, 0, bound) is None:
                for at in range(min(len(arrays[0]), MOST_ROUNDS)):
                    yield {**bound, marks[2]: Pins({at})}
                return
        yield bound

    def _count_of(self, marks: Sequence[str]) -> Pins | None:
        """The number of rows of an array, `sizeof(pins) / sizeof(pins[0])`; None for another expression."""
        if len(marks) < 9 or marks[3:6] != [")", "/", "sizeof"] or marks[1] != "(" or marks[6] != "(":
            return None
        rows = self.arrays.get(marks[2], ())
        return Pins({len(rows)}) if rows and marks[7:] == [marks[2], "[", "0", "]", ")"] else None

    def _looped(self, loop: SketchLoop, function: str, bound: Bindings | None = None) -> list[int]:
        """The values of a loop's name, in their order; none if they are unknown, or too many."""
        if loop.array:
            items = [each for each in self.items(loop.array) if each is not None and len(each) == 1]
            is_whole = len(items) == len(self.items(loop.array))
            return [value for each in items for value in each] if is_whole else []
        first, limit = (self.values(each, function, 1, bound) for each in (loop.first, loop.limit))
        if first is None or limit is None or len(first) != 1 or len(limit) != 1:
            return []
        found = range(min(first), min(limit) + loop.is_inclusive)
        return list(found) if len(found) <= MOST_VALUES else []

    def pins_of_channel(self, channel: Pins | None) -> Pins | None:
        """The pins of a channel that is one of these, or unknown: one that is not found can be any pin that
        is attached."""
        if channel is not None and all(each in self.channels for each in channel):
            return Pins(pin for each in channel for pin in self.channels[each])
        return union(self.pins(call) for call in self.named("ledcAttachPin"))

    def items(self, name: str) -> list[Pins | None]:
        """The values of each element of an array, or of an object in braces, in order; none without such."""
        rows = self.arrays.get(name) or (self.aggregates.get(name, ()),)
        return [self.values(item) for row in rows for item in row]

    def bindings(
        self, call: SketchCall, bound: Bindings | None
    ) -> dict[str, Pins | str | SketchObject | None]:
        """The values of the parameters of its own function, or of a class's constructor, at a call."""
        names = self.parameters.get(call.type or call.name, ())
        return self._bound(names, call.arguments, call.function, bound)

    def _bound(
        self,
        names: Sequence[str],
        given: Sequence[tuple[Token, ...]],
        function: str,
        bound: Bindings | None,
    ) -> dict[str, Pins | str | SketchObject | None]:
        made: dict[str, Pins | str | SketchObject | None] = {}
        for name, argument in zip(names, given, strict=False):
            is_array = len(argument) == 1 and argument[0].text in self.arrays
            found = [] if is_array else self.objects_of(argument, function, bound)
            value = argument[0].text if is_array else self.values(argument, function, 1, bound)
            made[name] = found[0] if len(found) == 1 else value
        return made

    def _value_of(self, token: Token, function: str, depth: int, bound: Bindings | None) -> Pins | None:
        if token.kind is TokenKind.NUMBER:
            number = _WHOLE.fullmatch(token.text)
            return Pins({_whole(number[1])}) if number else None
        if not token.is_name:
            return None
        name = token.text
        if bound is not None and name in bound:
            given = bound[name]
            return given if isinstance(given, frozenset) else None
        if name in self.parameters.get(function, ()):
            index = self.parameters[function].index(name)
            calls = self.callers[function]
            passed = (
                self.values(call.arguments[index], call.function, depth + 1)
                for call in calls
                if index < len(call.arguments)
            )
            return union(passed) if calls else None
        if name in self.changed:
            return None
        if name in self.expressions:
            found = self.expressions[name]
            if scope := self.scopes.get(function, ""):
                # A member that another class has too.
                found = [each for each in found if self.scopes.get(each[1], "") == scope] or found
            return union(self.values(each, inside, depth + 1, bound) for each, inside in found)
        if name in self.arrays:
            items = (item for row in self.arrays[name] for item in row)
            return union(self.values(item, "", depth + 1) for item in items)
        if made := [each for each in self.objects_with(name, function) if name in each.members]:
            return union(self.member(each, token, depth) for each in made)
        if name in _NAMED:
            return Pins({self.kind.led if name == "LED_BUILTIN" else _NAMED[name]})
        analog = _ANALOG_PIN.fullmatch(name)
        pin = self.kind.pin(name) if analog else None
        return None if pin is None else Pins({pin})


def _whole(text: str) -> int:
    if text[:2] in ("0x", "0X", "0b", "0B"):
        return int(text, 0)
    # An octal number in C; nobody numbers pins so.
    return int(text[:9])


def union(found: Iterable[Pins | None]) -> Pins | None:
    together: set[int] = set()
    for each in found:
        if each is None:
            return None
        together |= each
    return Pins(together) if len(together) <= MOST_VALUES else None
