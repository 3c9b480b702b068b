"""Facts of a sketch that can be read off its text: pins, calls, serial ports, interrupts.

The pins of a call are the values that its argument can have: a number, a constant, an element of an array, or
what the callers of its function pass. A pin that is computed in another way is unknown, never guessed.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.set_sketches import source_paths
from simmer_tui.sketch.boards import BoardKind
from simmer_tui.sketch.cpp_tokens import SourceDirective, Token, TokenKind, tokens_of

_KEYWORDS = frozenset(
    (
        "if",
        "for",
        "while",
        "switch",
        "return",
        "catch",
        "sizeof",
        "else",
        "do",
        "case",
        "new",
        "delete",
        "throw",
    )
)
"""Names before `(` that are no calls, or before a name that are no types."""
_WHOLE = re.compile(r"(0[xX][0-9a-fA-F]+|0[bB][01]+|[0-9]+)[uUlL]*")
_ANALOG_PIN = re.compile(r"A([0-9]|1[0-5])")
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
WRITES = ("digitalWrite", "analogWrite")
"""Calls that write a pin."""
PULSES = ("pulseIn", "pulseInLong")
"""Calls that wait for a pulse at a pin."""
_CHANGED = ("++", "--", "+=", "-=", "*=", "/=")
_OPEN, _CLOSE = "([{", ")]}"
# Judged: a function of motors that calls one of a motor that calls one of a pin.
_DEEPEST = 4
"""Callers of callers that are followed for the value of a parameter."""
# More than the pins of a Mega.
_MOST_VALUES = 100
# Bounds for files that are no sketches: judged, ten times a long sketch.
_MOST_CALLS = 20_000
_LONGEST_CALL = 500
"""Most tokens of a call's arguments."""
_MOST_STEPS = 200_000
"""Most values that are looked up in a sketch; later ones are unknown."""

_CHANNEL = "ledc channel"
"""The name of the pins of an ESP32's PWM by channel, `ledc channel[0]`: no sketch can have this name."""
_MOST_CHANNELS = 16
"""Channels of its PWM."""
_MOST_LOOPED = 8
"""Most rows of an array that a loop over a function is followed for: a robot has no more motors."""

Pins = frozenset[int]
Bindings = Mapping[str, "Pins | str | None"]
"""Values of a function's parameters at one of its calls; of an array, its name."""


class SketchCall(Struct, frozen=True):
    """A call, or the definition of an object with arguments: `type` is the object's class then.

    `object` is what stands before the dot. `function` is the function that it is in, empty outside.
    """

    name: str
    object: str
    type: str
    arguments: tuple[tuple[Token, ...], ...]
    function: str
    token: Token
    order: int
    """The number of its token in the sketch."""


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


class SketchPort(Struct, frozen=True):
    """A serial port of a sketch: its pins, and the rates that it is begun with (none: it is not begun)."""

    name: str
    rx: Pins | None
    tx: Pins | None
    bauds: tuple[int, ...]
    spot: str
    begin_spot: str


class SketchInterrupt(Struct, frozen=True):
    """An attachInterrupt. `pins` is None if unknown; `number` is the interrupt's number, if that is given."""

    pins: Pins | None
    number: int | None
    function: str
    mode: str
    spot: str


_Row = tuple[tuple[Token, ...], ...]
"""A row of an array: expressions. An array with one index has rows of one."""


class DeclaredObject(Struct, frozen=True):
    """An object of a class that is declared without arguments, or an array of them: `count` has its size."""

    type: str
    name: str
    count: tuple[Token, ...]
    spot: str


class SketchFacts:
    """The facts of one sketch on a kind of board.

    Args:
        sources: The texts of its files by name, the sketch's own first.
        kind: The board, by which analog names are numbers.
    """

    def __init__(self, sources: Mapping[str, str], kind: BoardKind) -> None:
        self.file = next(iter(sources), "")
        self.files = frozenset(sources)
        self.kind = kind
        self.includes: list[tuple[str, str]] = []
        """Names of the headers that it includes, with their places."""
        self._values: dict[str, list[tuple[tuple[Token, ...], str]]] = defaultdict(list)
        """The expressions that a name is set to, each with the function that it is in."""
        self._arrays: dict[str, tuple[_Row, ...]] = {}
        self._changed: set[str] = set()
        self._parameters: dict[str, list[str]] = {}
        self._methods: dict[str, list[str]] = defaultdict(list)
        """The methods of a class with a body."""
        self._members: dict[str, int] = {}
        """Places of the members of structs among their values."""
        self.declared: list[DeclaredObject] = []
        self._steps = 0
        self._defined: tuple[int, Token] | None = None
        """The end of the last definition of an object, and its class."""
        self.calls: list[SketchCall] = []
        """Calls and definitions of objects, in the order of the text."""
        self._channels: dict[int, dict[int, tuple[Token, ...]]] = {}
        """The pins of each channel of an ESP32's PWM, with how they are written."""
        tokens: list[Token] = []
        for name, text in sources.items():
            found, directives = tokens_of(text, name)
            tokens += found
            self._read_directives(directives, name)
        self._read(tokens)
        self._callers: dict[str, list[SketchCall]] = defaultdict(list)
        for call in self.calls:
            # The definition of an object calls its class's constructor.
            self._callers[call.type or call.name].append(call)
        self._follow_channels()
        self._by_function: dict[str, list[SketchCall]] = defaultdict(list)
        for call in self.calls:
            self._by_function[call.function].append(call)

    @classmethod
    def read(cls, sketch: Path, kind: BoardKind) -> SketchFacts:
        """The facts of a sketch by its .ino file or its folder. Raises OSError, or ValueError for a source
        that is too long."""
        paths = source_paths(sketch)
        return cls({path.name: path.read_text("utf-8", "replace") for path in paths}, kind)

    @property
    def functions(self) -> frozenset[str]:
        """The names of its own functions."""
        return frozenset(self._parameters)

    # -- what it says ------------------------------------------------------------------------------

    def named(self, *names: str) -> Iterator[SketchCall]:
        """The calls of these names, in the order of the text."""
        return (call for call in self.calls if call.name in names)

    def calls_in(self, function: str) -> Sequence[SketchCall]:
        """The calls in one of its functions, in the order of the text."""
        return self._by_function.get(function, ())

    def is_port(self, name: str) -> bool:
        """True if an object is a serial port."""
        return any(each.name == name for each in self.ports()) or name in self.kind.serial

    def pins(self, call: SketchCall, index: int = 0) -> Pins | None:
        """The pins that an argument of a call can be; None if that is unknown."""
        if index >= len(call.arguments):
            return None
        return self.values(call.arguments[index], call.function)

    def values(
        self,
        expression: Sequence[Token],
        function: str = "",
        depth: int = 0,
        bound: Bindings | None = None,
    ) -> Pins | None:
        """The whole numbers that an expression in a function can be; None if that is unknown. Parameters have
        the values that are `bound`, or those of all callers."""
        self._steps += 1
        if depth > _DEEPEST or self._steps > _MOST_STEPS:
            return None
        tokens = _without_casts(expression[:_LONGEST_CALL])
        if not tokens:
            return None
        first = tokens[0]
        if len(tokens) == 1:
            return self._value_of(first, function, depth, bound)
        marks = [token.text for token in tokens]
        if marks[1:-1] == ["::"]:
            return self._value_of(tokens[2], "", depth, None)
        if first.text == _CHANNEL:
            return self._pins_of_channel(self.values(tokens[2:-1], function, depth + 1, bound))
        if "?" in marks and ":" in marks:
            half, end = marks.index("?"), marks.index(":")
            one = self.values(tokens[half + 1 : end], function, depth + 1, bound)
            other = self.values(tokens[end + 1 :], function, depth + 1, bound)
            return None if one is None or other is None else one | other
        if (
            first.is_name
            and len(marks) > 4
            and marks[1] == "["
            and marks[-2] == "."
            and marks[-1] in self._members
        ):
            # The member of a struct in an array.
            end = _partners(tokens).get(1, 0)
            if end != len(tokens) - 3:
                return None
            place = self._members[marks[-1]]
            picked_rows = [
                row
                for rows in self._arrays_of(first.text, function, bound)
                for row in self._picked(rows, tokens[2:end], function, depth, bound)
            ]
            if not picked_rows or any(place >= len(row) for row in picked_rows):
                return None
            return _union(self.values(row[place], "", depth + 1) for row in picked_rows)
        if first.is_name and marks[1] == "[" and marks[-1] == "]":
            end = _partners(tokens).get(1, len(tokens) - 1)
            items: list[tuple[Token, ...]] = []
            for rows in self._arrays_of(first.text, function, bound):
                picked = self._picked(rows, tokens[2:end], function, depth, bound)
                if end + 1 < len(tokens):
                    second = tokens[end + 2 : -1]
                    inner = (tuple((each,) for each in row) for row in picked)
                    picked = tuple(
                        row for each in inner for row in self._picked(each, second, function, depth, bound)
                    )
                items += [item for row in picked for item in row]
            return _union(self.values(item, "", depth + 1) for item in items) if items else None
        return None

    def _arrays_of(self, name: str, function: str, bound: Bindings | None) -> list[tuple[_Row, ...]]:
        """The rows of an array, by the name of a parameter those of all that it can be; none if unknown."""
        given = bound.get(name) if bound is not None else None
        if isinstance(given, str):
            return [self._arrays[given]]
        if name in self._arrays:
            return [self._arrays[name]]
        names = self._parameters.get(function, ())
        if name not in names:
            return []
        found: list[tuple[_Row, ...]] = []
        for call in self._callers[function]:
            passed = call.arguments[names.index(name)] if names.index(name) < len(call.arguments) else ()
            if len(passed) != 1 or passed[0].text not in self._arrays:
                return []
            found.append(self._arrays[passed[0].text])
        return found

    def _picked(
        self,
        rows: tuple[_Row, ...],
        index: Sequence[Token],
        function: str,
        depth: int,
        bound: Bindings | None,
    ) -> tuple[_Row, ...]:
        """The rows of an array that an index can mean."""
        found = self.values(index, function, depth + 1, bound)
        if found is None or max(found, default=0) >= len(rows):
            return rows
        return tuple(rows[each] for each in sorted(found))

    def methods(self, name: str, *called: str) -> Iterator[tuple[SketchCall, Bindings | None]]:
        """The calls of methods of an object by its name; those of a function that it is passed to with the
        values of its parameters there."""
        for call in self.named(*called):
            names = self._parameters.get(call.function, ())
            if call.object == name:
                yield call, None
            elif call.object in names:
                at = names.index(call.object)
                for caller in self._callers[call.function]:
                    if self.spelled(caller, at) in (name, f"&{name}"):
                        yield call, self.bindings(caller, None)

    def ordered_pins(self, call: SketchCall, index: int, depth: int = 0) -> list[int]:
        """The pins that an argument of a call can be, each once: elements of an array in their order, and
        those of a parameter in the order of the calls. One that is unknown is missing."""
        if index >= len(call.arguments) or not call.arguments[index] or depth > _DEEPEST:
            return []
        argument = call.arguments[index]
        name = argument[0].text
        names = self._parameters.get(call.function, ())
        found: list[int] = []
        if len(argument) == 1 and name in names:
            for caller in self._callers[call.function]:
                found += self.ordered_pins(caller, names.index(name), depth + 1)
        elif (
            len(argument) > 1
            and argument[1].text == "["
            and name in self._arrays
            and self._steps < _MOST_STEPS
        ):
            items = [item for row in self._arrays[name] for item in row]
            meant = self.values(argument, call.function) or Pins()
            for each in items:
                values = self.values(each) or Pins()
                found += values if len(values) == 1 and values <= meant else ()
        else:
            values = self.values(argument, call.function) or Pins()
            found += values if len(values) == 1 else ()
        return list(dict.fromkeys(found))

    def spelled(self, call: SketchCall, index: int = 0) -> str:
        """The text of an argument, as its author wrote it."""
        return "".join(token.text for token in call.arguments[index]) if index < len(call.arguments) else ""

    def ports(self) -> list[SketchPort]:
        """The serial ports in hardware that it begins, every SoftwareSerial, and Bluetooth."""
        begun: dict[str, list[SketchCall]] = defaultdict(list)
        for call in self.named("begin"):
            begun[call.object].append(call)
        found = []
        for name, (rx, tx) in self.kind.serial.items():
            if begun[name]:
                call = begun[name][0]
                spot = call.token.spot
                given = [self._whole(call, place) for place in (2, 3)]
                pins = [
                    usual if each in (None, -1) else each for each, usual in zip(given, (rx, tx), strict=True)
                ]
                own_rx, own_tx = (Pins({each}) for each in pins if each is not None)
                found.append(SketchPort(name, own_rx, own_tx, self._bauds(begun[name]), spot, spot))
        for call in self.objects("SoftwareSerial"):
            begins = begun[call.name]
            spot = begins[0].token.spot if begins else ""
            rx_pins, tx_pins = self.pins(call, 0), self.pins(call, 1)
            bauds = self._bauds(begins)
            found.append(SketchPort(call.name, rx_pins, tx_pins, bauds, call.token.spot, spot))
        if self.kind.bluetooth is not None:
            for each in self.declared:
                if each.type == "BluetoothSerial" and begun[each.name]:
                    rx, tx = self.kind.bluetooth
                    spot = begun[each.name][0].token.spot
                    found.append(SketchPort(each.name, Pins({rx}), Pins({tx}), (), each.spot, spot))
        return found

    def _whole(self, call: SketchCall, index: int) -> int | None:
        """The number of an argument; None if it has several, or is unknown."""
        pins = self.pins(call, index)
        return next(iter(pins)) if pins is not None and len(pins) == 1 else None

    def _follow_channels(self) -> None:
        """Take ledcWrite of an ESP32 for analogWrite: it has a pin, or the number of a channel that
        ledcAttachPin or ledcSetup has made. A channel is never taken for a pin."""
        if self.kind.int_bits == 16:
            return
        has_channels = any(self.named("ledcAttachPin", "ledcSetup"))
        if has_channels:
            for channel, pin, spelling in self._attached():
                self._channels.setdefault(channel, {}).setdefault(pin, spelling)
        made: list[SketchCall] = []
        for call in self.calls:
            if call.name != "ledcWrite" or len(call.arguments) < 2:
                made.append(call)
                continue
            argument, *rest = call.arguments
            found: list[tuple[Token, ...]] = [argument]
            if has_channels:
                whole = self._whole(call, 0)
                found = []
                for pin, spelling in self._channels.get(-1 if whole is None else whole, {}).items():
                    is_known = self.values(spelling, call.function) == Pins({pin})
                    number = replace(call.token, kind=TokenKind.NUMBER, text=str(pin))
                    found.append(spelling if is_known else (number,))
                if not found:
                    marks = (replace(call.token, kind=TokenKind.MARK, text=mark) for mark in "[]")
                    opened, closed = marks
                    found = [(replace(call.token, text=_CHANNEL), opened, *argument, closed)]
            made += [replace(call, name="analogWrite", arguments=(each, *rest)) for each in found]
        self.calls = made

    def _attached(self) -> Iterator[tuple[int, int, tuple[Token, ...]]]:
        """The channels that ledcAttachPin gives to a pin, in loops over arrays, helpers and methods as well:
        channel, pin, and how the pin is written. Those that are unknown are missing."""
        by_function: dict[str, list[SketchCall]] = {}
        for call in self.calls:
            by_function.setdefault(call.function, []).append(call)
        objects = {call.name: call for call in self.calls if call.type in self.functions}
        left = [_MOST_CALLS]

        def walk(
            function: str, bound: Bindings, names: Mapping[str, tuple[Token, ...]], depth: int
        ) -> Iterator[tuple[int, int, tuple[Token, ...]]]:
            for call in by_function.get(function, ()):
                for given in self._rounds(call, bound):
                    left[0] -= 1
                    if left[0] < 0:
                        return
                    called = call.type or call.name
                    if call.name == "ledcAttachPin" and len(call.arguments) > 1:
                        pin, channel = (self.values(each, function, 0, given) for each in call.arguments[:2])
                        if pin is not None and channel is not None and len(pin) == len(channel) == 1:
                            spelling = self._spelling(call.arguments[0], function, given, names)
                            yield next(iter(channel)), next(iter(pin)), spelling
                    elif called in self.functions and depth < _DEEPEST:
                        made = objects.get(call.object)
                        own = {} if made is None else self.bindings(made, None)
                        passed = {
                            name: self._spelling(argument, function, given, names)
                            for name, argument in zip(self._parameters[called], call.arguments, strict=False)
                        }
                        yield from walk(called, {**own, **self.bindings(call, given)}, passed, depth + 1)

        for function in by_function:
            yield from walk(function, {}, {}, 0)
        # The methods of an object without a name of its own, as those in an array.
        for call in self.calls:
            if not call.type and not call.object and call.name in self._methods[call.name]:
                for method in dict.fromkeys(self._methods[call.name]):
                    yield from walk(method, self.bindings(call, None), {}, 0)

    def _rounds(self, call: SketchCall, bound: Bindings) -> Iterator[Bindings]:
        """The values at each round of a loop whose number picks the elements of an array that are passed."""
        for argument in call.arguments:
            marks = [token.text for token in argument[:4]]
            if len(marks) < 4 or marks[1] != "[" or marks[3] != "]" or not argument[2].is_name:
                continue
            arrays = self._arrays_of(marks[0], call.function, bound)
            if arrays and self.values(argument[2:3], call.function, 0, bound) is None:
                for at in range(min(len(arrays[0]), _MOST_CHANNELS)):
                    yield {**bound, marks[2]: Pins({at})}
                return
        yield bound

    def _spelling(
        self,
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
                for each in self._arrays_of(argument[0].text, function, bound)
                for row in self._picked(each, argument[2:-1], function, 0, bound)
            ]
            if len(rows) == 1 and len(rows[0]) == 1:
                return rows[0][0]
        return argument

    def _pins_of_channel(self, channel: Pins | None) -> Pins | None:
        """The pins of a channel that is one of these, or unknown: one that is not found can be any pin that
        is attached."""
        if channel is not None and all(each in self._channels for each in channel):
            return Pins(pin for each in channel for pin in self._channels[each])
        return _union(self.pins(call) for call in self.named("ledcAttachPin"))

    def steps(self) -> Iterator[SketchStep | None]:
        """The writes and pulses of a sketch, of each function in its order, None after each. A call of one of
        its own functions is followed if it passes values; the others are read by themselves."""
        yield from self._walked(deep=False)

    def deep_steps(self) -> Iterator[SketchStep | None]:
        """The same with every call of its own functions followed."""
        yield from self._walked(deep=True)

    def _walked(self, *, deep: bool) -> Iterator[SketchStep | None]:
        by_function: dict[str, list[SketchCall]] = {}
        for call in self.calls:
            by_function.setdefault(call.function, []).append(call)
        objects = {call.name: call for call in self.calls if call.type in self.functions}
        rows = self._rows_of_motors()
        left = [_MOST_STEPS]

        def walk(function: str, bound: Bindings | None, depth: int, root: str) -> Iterator[SketchStep]:
            for call in by_function.get(function, ()):
                left[0] -= 1
                if left[0] < 0:
                    return
                if call.name in (*WRITES, *PULSES) and call.arguments:
                    pins = self.values(call.arguments[0], function, 0, bound)
                    if pins is None or len(pins) != 1:
                        continue
                    value = None
                    if call.name in WRITES and len(call.arguments) > 1:
                        value = self.values(call.arguments[1], function, 0, bound)
                    pin, name = next(iter(pins)), self.spelled(call)
                    if name.startswith(_CHANNEL):
                        written = [each[pin] for each in self._channels.values() if pin in each]
                        name = "".join(token.text for token in written[0]) if written else str(pin)
                    yield SketchStep(call.name, pin, name, value, root, call.token.spot)
                elif call.name in self.functions and not call.type and depth < _DEEPEST:
                    # A method has the values of its object.
                    made = objects.get(call.object)
                    own = {} if made is None else self.bindings(made, None)
                    if call.arguments or own or deep:
                        given = {**own, **self.bindings(call, bound)}
                        index, count = rows.get(call.name, ("", 0))
                        # A loop calls it with the number of each row, which has no value of its own.
                        if given.get(index, Pins()) is None and 1 < count <= _MOST_LOOPED:
                            for row in range(count):
                                yield from walk(call.name, {**given, index: Pins({row})}, depth + 1, root)
                        else:
                            yield from walk(call.name, given, depth + 1, root)

        for function in by_function:
            yield from walk(function, None, 0, function)
            yield None
        # An object without a name of its own, `Motor(5, 7, 8)`, has the methods of its class.
        for call in self.calls:
            if call.type or call.object or call.name not in self._methods[call.name]:
                continue
            for method in dict.fromkeys(self._methods[call.name]):
                yield from walk(method, self.bindings(call, None), 0, call.name)
                yield None

    def pulses(self) -> Iterator[tuple[int, int]]:
        """The pins of pulses, each after that of the write before it, in loops over arrays as well."""
        by_function: dict[str, list[SketchCall]] = {}
        for call in self.calls:
            by_function.setdefault(call.function, []).append(call)
        objects = {call.name: call for call in self.calls if call.type in self.functions}
        left = [_MOST_CALLS]
        written: list[int] = []

        def walk(function: str, bound: Bindings, depth: int) -> Iterator[tuple[int, int]]:
            body = by_function.get(function, ())
            pulse = next((call for call in body if call.name in PULSES), None)
            for given in [bound] if pulse is None else self._rounds(pulse, bound):
                for call in body:
                    left[0] -= 1
                    if left[0] < 0:
                        return
                    if call.name in ("digitalWrite", *PULSES) and call.arguments:
                        pins = self.values(call.arguments[0], function, 0, given) or Pins()
                        if call.name == "digitalWrite":
                            written[:] = pins
                        elif len(pins) == len(written) == 1 and not pins.issuperset(written):
                            yield written[0], next(iter(pins))
                    elif call.name in self.functions and not call.type and depth < _DEEPEST:
                        made = objects.get(call.object)
                        own = {} if made is None else self.bindings(made, None)
                        for each in self._rounds(call, given):
                            yield from walk(call.name, {**own, **self.bindings(call, each)}, depth + 1)

        for function in by_function:
            written.clear()
            yield from walk(function, {}, 0)

    def _rows_of_motors(self) -> dict[str, tuple[str, int]]:
        """Functions that write a duty to the pin in a row of an array, `analogWrite(pins[i][0], duty)`: the
        name of the row's number, and the number of rows."""
        found: dict[str, tuple[str, int]] = {}
        for call in self.named("analogWrite"):
            marks = [token.text for token in call.arguments[0][:4]] if call.arguments else []
            if len(marks) == 4 and marks[1] == "[" and marks[3] == "]":
                count = max(self._channels, default=-1) + 1 if marks[0] == _CHANNEL else 0
                found.setdefault(call.function, (marks[2], count or len(self._arrays.get(marks[0], ()))))
        return found

    def objects(self, kind: str) -> Iterator[SketchCall]:
        """The definitions of objects of a class with arguments, in an array and by `new` as well."""
        for call in self.calls:
            if kind == call.type or (call.name == kind and not call.type and not call.object):
                yield call

    def interrupts(self) -> list[SketchInterrupt]:
        """Its calls of attachInterrupt."""
        found = []
        for call in self.named("attachInterrupt"):
            if len(call.arguments) < 2:
                continue
            first = call.arguments[0]
            is_pin = first[0].text == "digitalPinToInterrupt" if first else False
            values = self.values(first[2:-1] if is_pin else first, call.function)
            pins, number = values, None
            if not is_pin and values is not None and len(values) == 1:
                number = next(iter(values))
                by_number = {each: pin for pin, each in self.kind.interrupts.items()}
                pins = Pins({by_number[number]}) if number in by_number else Pins()
            mode = self.spelled(call, 2)
            found.append(SketchInterrupt(pins, number, self.spelled(call, 1), mode, call.token.spot))
        return found

    def _bauds(self, calls: Sequence[SketchCall]) -> tuple[int, ...]:
        rates: dict[int, None] = {}
        for call in calls:
            found = self.values(call.arguments[0], call.function) if call.arguments else None
            rates |= dict.fromkeys(sorted(found or ()))
        return tuple(rates)

    def bindings(self, call: SketchCall, bound: Bindings | None) -> dict[str, Pins | str | None]:
        """The values of the parameters of its own function, or of a class's constructor, at a call."""
        names = self._parameters.get(call.type or call.name, ())
        made: dict[str, Pins | str | None] = {}
        for name, argument in zip(names, call.arguments, strict=False):
            is_array = len(argument) == 1 and argument[0].text in self._arrays
            made[name] = argument[0].text if is_array else self.values(argument, call.function, 1, bound)
        return made

    # -- values ------------------------------------------------------------------------------------

    def _value_of(self, token: Token, function: str, depth: int, bound: Bindings | None) -> Pins | None:
        if token.kind is TokenKind.NUMBER:
            number = _WHOLE.fullmatch(token.text)
            return Pins({_whole(number[1])}) if number else None
        if not token.is_name:
            return None
        name = token.text
        if bound is not None and name in bound:
            given = bound[name]
            return None if isinstance(given, str) else given
        if name in self._parameters.get(function, ()):
            index = self._parameters[function].index(name)
            calls = self._callers[function]
            passed = (
                self.values(call.arguments[index], call.function, depth + 1)
                for call in calls
                if index < len(call.arguments)
            )
            return _union(passed) if calls else None
        if name in self._changed:
            return None
        if name in self._values:
            found = self._values[name]
            return _union(self.values(each, inside, depth + 1, bound) for each, inside in found)
        if name in self._arrays:
            items = (item for row in self._arrays[name] for item in row)
            return _union(self.values(item, "", depth + 1) for item in items)
        if name in _NAMED:
            return Pins({self.kind.led if name == "LED_BUILTIN" else _NAMED[name]})
        analog = _ANALOG_PIN.fullmatch(name)
        pin = self.kind.pin(name) if analog else None
        return None if pin is None else Pins({pin})

    # -- reading -----------------------------------------------------------------------------------

    def _read_directives(self, directives: Sequence[SourceDirective], file: str) -> None:
        for each in directives:
            rest = each.rest
            if each.name == "include" and rest:
                name = "".join(token.text for token in rest).strip('<>"')
                self.includes.append((name, f"{file}:{each.line}"))
            elif each.name == "define" and len(rest) > 1 and rest[1].text != "(":
                self._values[rest[0].text].append((rest[1:], ""))
            elif each.name == "define" and len(rest) > 3 and rest[-1].text == ")":
                # `#define PIN (9)` has a blank before the bracket, which a macro with arguments has not.
                self._values[rest[0].text].append((rest[1:], ""))

    def _read(self, tokens: Sequence[Token]) -> None:
        partners = _partners(tokens)
        self._find_functions(tokens, partners)
        function, end = "", -1
        for at, token in enumerate(tokens):
            if at > end:
                function = ""
            if at in self._bodies:
                function, end = self._bodies[at], partners.get(at, len(tokens))
            after = tokens[at + 1].text if at + 1 < len(tokens) else ""
            before = tokens[at - 1].text if at else ""
            if not token.is_name:
                continue
            if at + 1 < len(tokens) and tokens[at + 1].is_name and token.text not in _KEYWORDS:
                self._read_declaration(tokens, at, partners)
            if after in _CHANGED or before in ("++", "--"):
                self._changed.add(token.text)
            elif after == "=" and (before not in (".", "->") or (at > 1 and tokens[at - 2].text == "this")):
                self._read_value(tokens, at, partners, function)
            elif after == "[":
                self._read_array(tokens, at, partners)
            elif after in ("(", "{") and token.text not in _KEYWORDS:
                self._read_call(tokens, at, partners, function)

    def _read_declaration(self, tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> None:
        """Take `Class one, two[3];`, and `Class one = Class();`."""
        place = at + 1
        while place + 1 < len(tokens) and len(self.declared) < _MOST_CALLS:
            name, mark, end = tokens[place], tokens[place + 1].text, place + 1
            count: tuple[Token, ...] = ()
            if not name.is_name:
                return
            if mark == "[":
                end = partners.get(end, end)
                count = tuple(tokens[place + 2 : end])
                end += 1
                mark = tokens[end].text if end < len(tokens) else ""
            if mark not in (",", ";", "="):
                return
            self.declared.append(DeclaredObject(tokens[at].text, name.text, count, name.spot))
            if mark != ",":
                return
            place = end + 1

    def items(self, name: str) -> list[Pins | None]:
        """The values of each element of an array, in order; none if there is no such array."""
        return [self.values(item) for row in self._arrays.get(name, ()) for item in row]

    def _find_functions(self, tokens: Sequence[Token], partners: Mapping[int, int]) -> None:
        """Find the bodies of functions, by the index of their brace, and the names of their parameters."""
        self._bodies: dict[int, str] = {}
        self._find_classes(tokens, partners)
        for at, token in enumerate(tokens):
            if token.text != "{" or at < 3 or tokens[at - 1].text != ")":
                continue
            end, members = at - 1, []
            start = partners.get(end, 0)
            # A constructor's `: en(a), in1(b)` before its body.
            while start > 2 and tokens[start - 2].text in (",", ":") and tokens[start - 3].text == ")":
                members.append((tokens[start - 1].text, tuple(tokens[start + 1 : end])))
                mark, end = tokens[start - 2].text, start - 3
                start = partners.get(end, 0)
                if mark == ":":
                    break
            name = tokens[start - 1] if start else token
            if not name.is_name or name.text in _KEYWORDS:
                continue
            self._bodies[at] = name.text
            if start > 2 and tokens[start - 2].text == "::":
                self._methods[tokens[start - 3].text].append(name.text)
            else:
                self._methods[self._class_at(start)].append(name.text)
            self._parameters[name.text] = [_parameter(each) for each in _split(tokens[start + 1 : end])]
            for member, value in members[:_MOST_VALUES]:
                self._values[member].append((value, name.text))

    def _find_classes(self, tokens: Sequence[Token], partners: Mapping[int, int]) -> None:
        """Find the bodies of classes, and the places of the members of structs among their values."""
        self._classes: list[tuple[int, int, str]] = []
        for at, token in enumerate(tokens[:-2]):
            if token.text not in ("class", "struct") or not tokens[at + 1].is_name:
                continue
            begin = at + 2
            while begin < len(tokens) and tokens[begin].text not in ("{", ";", "(", "="):
                begin += 1
            end = partners.get(begin)
            if begin == len(tokens) or tokens[begin].text != "{" or end is None:
                continue
            self._classes.append((begin, end, tokens[at + 1].text))
            body = tokens[begin + 1 : end]
            if not any(each.text in "({" for each in body):
                # Each member stands before a comma or the end of its declaration.
                members = [one.text for one, other in pairwise(body) if other.text in (",", ";", "[")]
                self._members |= {name: place for place, name in enumerate(members[:_MOST_VALUES])}

    def _class_at(self, place: int) -> str:
        """The class in whose body a token is; empty outside."""
        return next((name for begin, end, name in self._classes if begin < place < end), "")

    def _read_value(
        self, tokens: Sequence[Token], at: int, partners: Mapping[int, int], function: str
    ) -> None:
        """Take `name = value` up to the next comma or end."""
        start = end = at + 2
        while end < len(tokens) and tokens[end].text not in (",", ";", ")", "}"):
            end = partners.get(end, end) + 1
        value = tuple(tokens[start : min(end, start + _LONGEST_CALL)])
        known = self._values[tokens[at].text]
        if value and value[0].text != "{" and len(known) < _MOST_VALUES:
            known.append((value, function))

    def _read_array(self, tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> None:
        """Take the elements of `name[...] = {...}`, of inner braces as well."""
        end = at + 1
        while end < len(tokens) and tokens[end].text == "[" and end in partners:
            end = partners[end] + 1
        if end + 1 < len(tokens) and tokens[end].text == "=" and tokens[end + 1].text == "{":
            inner = tokens[end + 2 : partners.get(end + 1, end + 2)]
            rows = []
            for item in _split(inner)[:_MOST_VALUES]:
                if not item:
                    continue  # after a last comma
                is_row = item[0].text == "{"
                rows.append(tuple(_split(item[1:-1])[:_MOST_VALUES]) if is_row else (item,))
            self._arrays[tokens[at].text] = tuple(rows)

    def _read_call(
        self, tokens: Sequence[Token], at: int, partners: Mapping[int, int], function: str
    ) -> None:
        close = partners.get(at + 1)
        if close is None or not at or close - at > _LONGEST_CALL or len(self.calls) == _MOST_CALLS:
            return
        before = tokens[at - 1]
        is_definition = before.is_name and before.text not in _KEYWORDS
        if before.text == "," and self._defined is not None and self._defined[0] == at - 2:
            before, is_definition = self._defined[1], True  # `Motor left(9), right(10);`
        if close + 1 in self._bodies and tokens[close + 1].text == "{":
            return  # the head of a function
        if tokens[at + 1].text == "{" and not is_definition:
            return
        arguments = tuple(_split(tokens[at + 2 : close]))
        if is_definition and any(_is_parameter(each) for each in arguments):
            return  # the prototype of a function
        has_members = close + 1 < len(tokens) and tokens[close + 1].text == ":"
        if has_members and arguments and all(_is_parameter(each) for each in arguments):
            return  # the head of a constructor with values of members
        call = SketchCall(
            name=tokens[at].text,
            object=_object_before(tokens, at, partners),
            type=before.text if is_definition else "",
            arguments=arguments,
            function=function,
            token=tokens[at],
            order=len(self.calls),
        )
        self.calls.append(call)
        if is_definition:
            self._defined = (close, before)


def _whole(text: str) -> int:
    if text[:2] in ("0x", "0X", "0b", "0B"):
        return int(text, 0)
    # An octal number in C; nobody numbers pins so.
    return int(text[:9])


def _union(found: Iterator[Pins | None]) -> Pins | None:
    together: set[int] = set()
    for each in found:
        if each is None:
            return None
        together |= each
    return Pins(together) if len(together) <= _MOST_VALUES else None


def _without_casts(tokens: Sequence[Token]) -> Sequence[Token]:
    """An expression without brackets around it, and without `(int)` before it."""
    while len(tokens) >= 3 and tokens[0].text == "(":
        if tokens[-1].text == ")" and _partners(tokens).get(0) == len(tokens) - 1:
            tokens = tokens[1:-1]
        elif tokens[1].is_name and tokens[2].text == ")":
            tokens = tokens[3:]
        else:
            break
    return tokens


def _partners(tokens: Sequence[Token]) -> dict[int, int]:
    """The index of the other bracket, by the index of each. One without a partner is missing."""
    opened: list[int] = []
    found: dict[int, int] = {}
    for at, token in enumerate(tokens):
        if token.kind is not TokenKind.MARK:
            continue
        if token.text in _OPEN:
            opened.append(at)
        elif token.text in _CLOSE:
            wanted = _OPEN[_CLOSE.index(token.text)]
            # A bracket that an #if leaves open is passed over.
            while opened and tokens[opened[-1]].text != wanted:
                opened.pop()
            if opened:
                start = opened.pop()
                found[start], found[at] = at, start
    return found


def _split(tokens: Sequence[Token]) -> list[tuple[Token, ...]]:
    """The parts of a list at its commas; commas in inner brackets do not count."""
    parts: list[tuple[Token, ...]] = []
    current: list[Token] = []
    depth = 0
    for token in tokens:
        if token.kind is TokenKind.MARK:
            depth += (token.text in _OPEN) - (token.text in _CLOSE)
            if token.text == "," and depth == 0:
                parts.append(tuple(current))
                current = []
                continue
        current.append(token)
    return [*parts, tuple(current)] if current or parts else []


def _parameter(tokens: Sequence[Token]) -> str:
    """The name of a parameter: the last one before its default and its brackets."""
    name = ""
    for token in tokens:
        if token.text in ("=", "["):
            break
        if token.is_name:
            name = token.text
    return name


def _is_parameter(tokens: Sequence[Token]) -> bool:
    """True for `int x`: two names side by side, which no argument has."""
    return any(one.is_name and other.is_name for one, other in pairwise(tokens))


def _object_before(tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> str:
    """The name before the dot of a method: `sonar` of `sonar[1].ping(`."""
    if at < 2 or tokens[at - 1].text not in (".", "->"):
        return ""
    place = at - 2
    if tokens[place].text == "]":
        place = partners.get(place, 0) - 1
    return tokens[place].text if place >= 0 and tokens[place].is_name else ""
