"""The parts on a board's I2C bus compared with the text of its sketch, without a compiler."""

from __future__ import annotations

from collections.abc import Iterator

from simmer_tui.errors import Problem
from simmer_tui.sim.rules import listed
from simmer_tui.sketch.known_headers import is_provided
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.wiring import GYRO_ADDRESSES, RANGER_ADDRESS, WiredI2c, Wiring

GYRO_CLASS, RANGER_CLASSES = "MPU6050", ("VL53L0X", "Adafruit_VL53L0X")
"""The classes of the libraries' objects."""
BEGUN_GYRO_CLASS = "Adafruit_MPU6050"
"""The class of a gyro whose address is given to `begin`."""
_CALLED = ("beginTransmission", "requestFrom", "setAddress")
"""Calls whose first argument is an address."""
_PIN_CALLS = ("digitalWrite", "analogWrite", "digitalRead", "analogRead", "tone", "attach")
_BUSES = ("Wire", "&Wire")
"""Arguments of a constructor that are no address."""
_BY_NUMBER = (
    "readByte",
    "readWord",
    "readBit",
    "readBits",
    "writeByte",
    "writeWord",
    "writeBit",
    "writeBits",
)
"""Calls of I2Cdev, which have the address too."""


def bus_problems(wiring: Wiring, board: str, facts: SketchFacts) -> Iterator[Problem]:
    """The problems of a board's bus."""
    parts = [each for each in wiring.sensors if isinstance(each, WiredI2c) and each.board == board]
    begun = _begins(facts)
    if parts or begun:
        yield from _other_uses(facts)
    # What a library of the team's own does is not known.
    if not parts or not all(is_provided(name, facts.files) for name, _ in facts.includes):
        return
    if not begun:
        what = f"the sketch never begins Wire ({facts.file}), so nobody answers on its bus"
        yield Problem(parts[0].place, f"{what}; add Wire.begin() to setup()")
        return
    spoken = spoken_addresses(facts)
    for part in parts:
        if spoken is not None and part.address not in spoken:
            there = listed([f"{each:#x}" for each in sorted(spoken)]) if spoken else "nobody"
            what = f"the sketch never speaks to {part.address:#x} ({facts.file}); it speaks to {there}"
            yield Problem(part.place_of("address"), what)


def _begins(facts: SketchFacts) -> bool:
    """True if a sketch begins Wire, itself or by a library that does."""
    libraries = ("Adafruit_VL53L0X", BEGUN_GYRO_CLASS, "LiquidCrystal_I2C")
    objects = {"Wire", *(each.name for each in facts.declared if each.type in libraries)}
    return any(call.object in objects for call in facts.named("begin", "init"))


def _other_uses(facts: SketchFacts) -> Iterator[Problem]:
    """Calls that use the wires of the bus as pins."""
    kind = facts.kind
    for name, pin in zip(("SDA", "SCL"), kind.i2c, strict=True):
        remedy = f"pin {kind.pin_name(pin)} is {name} of Wire"
        for call in facts.named(*_PIN_CALLS):
            pins = facts.pins(call)
            if pins == Pins({pin}):
                yield Problem(call.token.spot, f"{remedy}, and {call.name} uses it too; take another pin")
                break
        for port in facts.ports():
            if pin in (port.rx or ()) or pin in (port.tx or ()):
                yield Problem(port.spot, f"{remedy}, and {port.name} uses it too; take another pin")


def spoken_addresses(facts: SketchFacts) -> Pins | None:
    """The addresses that a sketch speaks to; None if one of them is not known."""
    found = list(addresses(facts))
    return None if None in found else Pins(each for pins in found if pins is not None for each in pins)


def addresses(facts: SketchFacts) -> Iterator[Pins | None]:
    """The addresses that each object and call of a sketch speaks to; None where they are not known."""
    rangers = {each.name for each in facts.declared if each.type in RANGER_CLASSES}
    if rangers or any(call for each in RANGER_CLASSES for call in facts.objects(each)):
        yield Pins({RANGER_ADDRESS})
    # An object without arguments has the usual address.
    if any(each.type == GYRO_CLASS for each in facts.declared):
        yield Pins({GYRO_ADDRESSES[0]})
    gyros = {each.name for each in facts.declared if each.type == BEGUN_GYRO_CLASS}
    for call in facts.calls:
        is_gyro = call.object in gyros or GYRO_CLASS in (call.name, call.type)
        if not _has_address(call, rangers | gyros):
            continue
        if call.arguments and facts.spelled(call) not in _BUSES:
            yield facts.pins(call)
        else:
            yield Pins({GYRO_ADDRESSES[0] if is_gyro else RANGER_ADDRESS})


def _has_address(call: SketchCall, begun: set[str]) -> bool:
    """True for a call whose first argument, if it has one, is an address on the bus."""
    if call.name == "begin":
        return call.object in begun
    return (
        call.name in _CALLED
        or GYRO_CLASS in (call.type, "" if call.object else call.name)
        or (call.name in _BY_NUMBER and not call.object)
    )
