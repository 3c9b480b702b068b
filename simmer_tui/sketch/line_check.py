"""Serial lines of a wiring compared with the text of its sketches: the laptop's, and those between boards."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from simmer_tui.errors import Problem
from simmer_tui.sim.rules import listed
from simmer_tui.sketch.sketch_scan import SketchFacts, SketchPort
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.wiring import BoardWire, LaptopLine, Wiring, WiringRow


def line_problems(wiring: Wiring, facts: Mapping[str, SketchFacts]) -> Iterator[Problem]:
    """Serial lines whose pins are no port, or whose two ends have different rates."""
    line = wiring.laptop
    if line is not None and line.board in facts:
        yield from _laptop(line, facts[line.board])
    for wire in wiring.wires:
        if wire.from_board not in facts or wire.to_board not in facts:
            continue
        sender, receiver = facts[wire.from_board], facts[wire.to_board]
        ends = (
            (sender, _port(sender, tx=wire.tx), wire.tx, "from", "sends"),
            (receiver, _port(receiver, rx=wire.rx), wire.rx, "to", "receives"),
        )
        missing = [
            Problem(wire.place_of(key), _no_port(end, pin, verb))
            for end, port, pin, key, verb in ends
            if port is None and _are_known(end)
        ]
        if len(missing) == len(ends):
            yield Problem(wire.place, _dead(wire, sender, receiver))
            continue
        yield from missing
        one, other = ends[0][1], ends[1][1]
        if one is not None and other is not None:
            yield from _rates(wire, one, other)


def dead_wires(wiring: Wiring, facts: Mapping[str, SketchFacts]) -> Iterator[str]:
    """Wires between pins of which neither is a serial port's, each in a sentence: nothing goes over them."""
    for wire in wiring.wires:
        sender, receiver = facts.get(wire.from_board), facts.get(wire.to_board)
        if sender is None or receiver is None or not (_are_known(sender) and _are_known(receiver)):
            continue
        if _port(sender, tx=wire.tx) is None and _port(receiver, rx=wire.rx) is None:
            yield _dead(wire, sender, receiver)


def _dead(wire: BoardWire, sender: SketchFacts, receiver: SketchFacts) -> str:
    one = f"{wire.from_board}.{sender.kind.pin_name(wire.tx)}"
    other = f"{wire.to_board}.{receiver.kind.pin_name(wire.rx)}"
    return f"{one} and {other} are no serial ports: wires carry bytes of serial ports alone, and no levels"


def _laptop(line: LaptopLine, facts: SketchFacts) -> Iterator[Problem]:
    kind = facts.kind
    port = _port(facts, rx=line.rx, tx=line.tx)
    shown = f"rx {kind.pin_name(line.rx)} and tx {kind.pin_name(line.tx)}"
    if port is None and _are_known(facts):
        swapped = _port(facts, rx=line.tx, tx=line.rx)
        if swapped is not None:
            what = f"{shown} are the other way round in the sketch: {swapped.name} at {swapped.spot}"
            yield Problem(line.place, what)
            return
        there = ", ".join(_pins_of(facts, each) for each in facts.ports()) or "no port that is begun"
        yield Problem(
            line.place, f"the sketch has no serial port with {shown}; it has {there} ({facts.file})"
        )
    if port is None:
        return
    if not port.bauds:
        yield from _not_begun(line, port)
    elif line.baud is not None and line.baud not in port.bauds:
        what = f"the laptop has {line.baud} baud, {port.name} has {_bauds(port)} ({port.begin_spot})"
        yield Problem(line.place_of("baud"), what)


def _rates(row: WiringRow, one: SketchPort, other: SketchPort) -> Iterator[Problem]:
    for port in (one, other):
        if not port.begin_spot:
            yield from _not_begun(row, port)
    if one.bauds and other.bauds and not set(one.bauds) & set(other.bauds):
        ends = " and ".join(f"{port.name} {_bauds(port)} baud ({port.begin_spot})" for port in (one, other))
        yield Problem(row.place, f"its two ends differ: {ends}")


def _not_begun(row: WiringRow, port: SketchPort) -> Iterator[Problem]:
    if not port.begin_spot:
        yield Problem(row.place, f"{port.name} ({port.spot}) is never begun; add {port.name}.begin(9600)")


def _no_port(facts: SketchFacts, pin: int, verb: str) -> str:
    there = ", ".join(_pins_of(facts, each) for each in facts.ports()) or "no port that is begun"
    shown = facts.kind.pin_name(pin)
    return f"no serial port of the sketch {verb} at pin {shown}; it has {there} ({facts.file})"


def _are_known(facts: SketchFacts) -> bool:
    """True if the pins of all ports of a sketch are known."""
    return all(port.rx is not None and port.tx is not None for port in facts.ports())


def _port(facts: SketchFacts, rx: int | None = None, tx: int | None = None) -> SketchPort | None:
    """The port of a sketch that has these pins."""
    for port in facts.ports():
        if all(pin is None or pins == Pins({pin}) for pin, pins in ((rx, port.rx), (tx, port.tx))):
            return port
    return None


def _pins_of(facts: SketchFacts, port: SketchPort) -> str:
    rx, tx = (", ".join(map(facts.kind.pin_name, sorted(pins or ()))) or "?" for pins in (port.rx, port.tx))
    return f"{port.name} with rx {rx} and tx {tx}"


def _bauds(port: SketchPort) -> str:
    return listed(map(str, port.bauds))
