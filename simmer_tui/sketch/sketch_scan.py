"""Facts of a sketch that can be read off its text: pins, calls, serial ports, interrupts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from simmer_tui.sketch.boards import BoardKind
from simmer_tui.sketch.pwm_channels import follow_channels
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_values import DEEPEST, MOST_LOOKUPS, Bindings, Pins, SketchValues


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
    reads: Pins
    """The pins that its function reads with digitalRead."""


class SketchFacts(SketchValues):
    """The facts of one sketch on a kind of board. The pins of a call are the values that its argument can
    have."""

    def __init__(self, sources: Mapping[str, str], kind: BoardKind) -> None:
        super().__init__(sources, kind)
        follow_channels(self)
        self._by_function = self.by_function()

    def calls_in(self, function: str) -> Sequence[SketchCall]:
        """The calls in one of its functions, in the order of the text."""
        return self._by_function.get(function, ())

    def is_port(self, name: str) -> bool:
        """True if an object is a serial port."""
        port = self._port_named(name)
        return port in self.kind.serial or any(each.name == port for each in self.ports())

    def methods(self, name: str, *called: str) -> Iterator[tuple[SketchCall, Bindings | None]]:
        """The calls of methods of an object by its name; those of a function that it is passed to with the
        values of its parameters there."""
        for call in self.named(*called):
            names = self.parameters.get(call.function, ())
            if call.object == name:
                yield call, None
            elif call.object in names:
                at = names.index(call.object)
                for caller in self.callers[call.function]:
                    if self.spelled(caller, at) in (name, f"&{name}"):
                        yield call, self.bindings(caller, None)

    def ordered_pins(self, call: SketchCall, index: int, depth: int = 0) -> list[int]:
        """The pins that an argument of a call can be, each once: elements of an array in their order, and
        those of a parameter in the order of the calls. One that is unknown is missing."""
        found = self._ordered(call, index, depth)
        return [*map(self.kind.analog_pin, found)] if call.name == "analogRead" else found

    def _ordered(self, call: SketchCall, index: int, depth: int) -> list[int]:
        if index >= len(call.arguments) or not call.arguments[index] or depth > DEEPEST:
            return []
        argument = call.arguments[index]
        name = argument[0].text
        names = self.parameters.get(call.function, ())
        found: list[int] = []
        if len(argument) == 1 and name in names:
            for caller in self.callers[call.function]:
                found += self._ordered(caller, names.index(name), depth + 1)
        elif (
            len(argument) > 1
            and argument[1].text == "["
            and name in self.arrays
            and self.looked_up < MOST_LOOKUPS
        ):
            items = [item for row in self.arrays[name] for item in row]
            meant = self.values(argument, call.function) or Pins()
            for each in items:
                values = self.values(each) or Pins()
                found += values if len(values) == 1 and values <= meant else ()
        elif len(argument) == 1 and (made := self.objects_with(name, call.function)):
            members = (self.member(each, argument[0], depth + 1) or Pins() for each in made)
            found += (pin for each in members if len(each) == 1 for pin in each)
        else:
            values = self.values(argument, call.function) or Pins()
            found += values if len(values) == 1 else ()
        return list(dict.fromkeys(found))

    def ports(self) -> list[SketchPort]:
        """The serial ports in hardware that it begins, those of its own objects, and Bluetooth."""
        begun: dict[str, list[SketchCall]] = defaultdict(list)
        for call in self.named("begin"):
            begun[self._port_named(call.object)].append(call)
        found = []
        for name, usual in self.kind.serial.items():
            if begun[name]:
                spot = begun[name][0].token.spot
                rx, tx = self._begun_pins(begun[name], usual)
                found.append(SketchPort(name, rx, tx, self._bauds(begun[name]), spot, spot))
        for call in self.objects("HardwareSerial"):
            begins = begun[call.name]
            spot = begins[0].token.spot if begins else ""
            number = self.whole(call, 0)
            name = f"Serial{number}" if number else "Serial"
            rx, tx = self._begun_pins(begins, None if number is None else self.kind.serial.get(name))
            found.append(SketchPort(call.name, rx, tx, self._bauds(begins), call.token.spot, spot))
        for call in self.objects("SoftwareSerial"):
            begins = begun[call.name]
            spot = begins[0].token.spot if begins else ""
            rx_pins, tx_pins = self.pins(call, 0), self.pins(call, 1)
            bauds = self._bauds(begins)
            found.append(SketchPort(call.name, rx_pins, tx_pins, bauds, call.token.spot, spot))
        if self.kind.bluetooth is not None:
            for each in self.declared:
                if each.type == "BluetoothSerial" and begun[each.name]:
                    rx, tx = (Pins({pin}) for pin in self.kind.bluetooth)
                    spot = begun[each.name][0].token.spot
                    found.append(SketchPort(each.name, rx, tx, (), each.spot, spot))
        return found

    def _port_named(self, name: str) -> str:
        """The port that a name stands for: `#define BT Serial1`, or a reference to it."""
        found = {
            "".join(token.text for token in each).lstrip("&") for each, _ in self.expressions.get(name, ())
        }
        return next(iter(found)) if len(found) == 1 and found <= self.kind.serial.keys() else name

    def _begun_pins(
        self, begins: Sequence[SketchCall], usual: tuple[int, int] | None
    ) -> tuple[Pins | None, Pins | None]:
        """The pins (rx, tx) of a port in hardware: those of its first begin, or the usual ones."""
        rx, tx = (None, None) if usual is None else (Pins({pin}) for pin in usual)
        if not begins:
            return rx, tx
        call = begins[0]
        rx, tx = (
            self.pins(call, place) if self.spelled(call, place) not in ("", "-1") else own
            for place, own in ((2, rx), (3, tx))
        )
        return rx, tx

    def objects(self, kind: str) -> Iterator[SketchCall]:
        """The definitions of objects of a class with arguments, in an array and by `new` as well."""
        for call in self.calls:
            if kind == call.type or (call.name == kind and not call.type and not call.object):
                yield call

    def interrupts(self) -> list[SketchInterrupt]:
        """Its calls of attachInterrupt."""
        found = []
        for call in self.named("attachInterrupt", "attachInterruptArg"):
            if len(call.arguments) < 2:
                continue
            first = call.arguments[0]
            is_pin = first[0].text == "digitalPinToInterrupt" if first else False
            mode = self.spelled(call, len(call.arguments) - 1)
            for bound in self.rounds(call, {}):
                values = self.values(first[2:-1] if is_pin else first, call.function, 0, bound)
                pins, number = values, None
                if not is_pin and values is not None and len(values) == 1:
                    number = next(iter(values))
                    by_number = {each: pin for pin, each in self.kind.interrupts.items()}
                    pins = Pins({by_number[number]}) if number in by_number else Pins()
                function = self._function_named(call, 1, bound)
                reads = self._read_by(call, function)
                found.append(SketchInterrupt(pins, number, function, mode, call.token.spot, reads))
        return found

    def _read_by(self, attach: SketchCall, function: str) -> Pins:
        """The pins that the function of an interrupt reads, or a lambda in the call itself."""
        inside = {id(token) for token in attach.arguments[1]} if function.startswith("[") else set()
        reads = (
            each
            for each in self.named("digitalRead")
            if each.function == function or id(each.token) in inside
        )
        return Pins(pin for each in reads for pin in self.pins(each) or ())

    def _function_named(self, call: SketchCall, index: int, bound: Bindings) -> str:
        """The function that an argument names, also in an array of them."""
        argument = call.arguments[index]
        if len(argument) > 3 and argument[1].text == "[" and argument[-1].text == "]":
            rows = self.picked(self.arrays.get(argument[0].text, ()), argument[2:-1], "", 0, bound)
            if len(rows) == 1 and len(rows[0]) == 1:
                return "".join(token.text for token in rows[0][0]).lstrip("&")
        return self.spelled(call, index)

    def _bauds(self, calls: Sequence[SketchCall]) -> tuple[int, ...]:
        rates: dict[int, None] = {}
        for call in calls:
            found = self.values(call.arguments[0], call.function) if call.arguments else None
            rates |= dict.fromkeys(sorted(found or ()))
        return tuple(rates)
