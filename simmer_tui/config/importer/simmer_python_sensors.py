"""The sensors and motors of a simmer-python `config.py`, in our frame."""

import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

from msgspec import Struct

from simmer_tui.config.importer.device_classes import DeviceClasses
from simmer_tui.config.importer.imported import Fields, Notes, OwnDevice, free_number, pair
from simmer_tui.config.importer.python_values import Call, Located
from simmer_tui.config.importer.simmer_python_devices import OWN_DEVICE, USUAL_FIELDS, devices_of, turn_of
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import IntegerRule, NumberRule
from simmer_tui.sim.sensors import KINDS, Compass, Gyro, LineSensor, Ultrasonic
from simmer_tui.sim.specs import SensorKind, SensorSpec

_SHARE = NumberRule(0, 1)
# Degrees of a vertical field of view; one of 180 has no slope.
_WIDEST = 179.0
_LENGTH = NumberRule(0)
# Fields of a device that shows its measurement.
_SHOWN = USUAL_FIELDS | {"visible_measurement", "visible_measurement_time", "height"}
_FIELDS = {
    "Ultrasonic": _SHOWN | {"num_rays", "min_range", "max_range", "beamwidth", "fov"},
    "Infrared": _SHOWN | {"fov", "threshold", "bias"},
    "Gyroscope": USUAL_FIELDS | {"bias"},
    "Compass": USUAL_FIELDS | {"bias"},
}


class Surroundings(Struct, frozen=True):
    """The things around a sensor that its numbers depend on: the block's side and the maze's longest
    distance, inches, and the team's device classes."""

    block_size: float
    longest: float
    classes: DeviceClasses


def read_sensors(
    table: dict[Any, Located],
    codes: set[str],
    surroundings: Surroundings,
    notes: Notes,
    taken: tuple[SensorSpec, ...] = (),
    own: list[OwnDevice] | None = None,
) -> tuple[SensorSpec, ...]:
    """The sensors of a table of devices; motors become wheel encoders.

    `codes` has the codes in use and is added to; `taken` are the existing sensors. Devices of classes without
    a kind here are added to `own`.
    """
    kinds = {device: kind for kind in KINDS.values() for device in kind.devices}
    classes = surroundings.classes
    sensors: tuple[SensorSpec, ...] = ()
    foreign: list[tuple[Call, Fields]] = []
    for call, fields, known in devices_of(table, codes, notes, tuple(kinds), classes, foreign):
        name = known or "Ultrasonic"
        fields.list_others(_FIELDS.get(name, USUAL_FIELDS) | fields.read_by_class)
        values = _READERS.get(kinds[name], _usual)(fields, surroundings)
        sensors += (_placed(fields, kinds[name], taken + sensors, values),)
        for slip in classes.slips_of(call.name):
            notes.add_elsewhere(slip)
        parts = list(_origins(fields, sensors[-1], guessed=not known))
        if not known:
            parts[:0] = [f"{cut(call.name, WORD)} is taken as an ultra row, which reads the nearest distance"]
        elif known != call.name:
            parts[:0] = [f"{cut(call.name, WORD)} is read as {known}"]
        if parts:
            fields.note("", "; ".join(parts))
    # After the known ones, so that a proposed row has a number that is still free.
    for call, fields in foreign:
        what = f"{cut(call.name, WORD)} {OWN_DEVICE}; left out"
        silent = fields.silent()
        if pair(silent.value("position")) is not None:
            row = _placed(silent, Ultrasonic, taken + sensors, _ultrasonic(silent, surroundings))
            origins = _origins(silent, row, guessed=True)
            what = "; ".join((f"{what}. If it tells a distance, add to sensors.csv: {_row(row)}", *origins))
        note = fields.note("", what)
        if own is not None and call.name in classes.numbers:
            row = _placed(silent, Ultrasonic, taken, _usual(silent, surroundings))
            own.append(OwnDevice(call.name, row, classes.numbers[call.name], silent.numbers, note))
    return sensors


def _origins(fields: Fields, spec: SensorSpec, guessed: bool) -> Iterator[str]:
    """Sources of a row's numbers that are not in its description."""
    if fields.of_class:
        listed = [f"{key} {each.value:g} ({each.where})" for key, each in fields.of_class.items()]
        yield f"numbers of {spec.id} from its class: {', '.join(listed)}"
    # Numbers of simmer-python's own classes are known; a number of a team's own class is a guess.
    if guessed and fields.assumed:
        listed = [f"{key} {value:g}" for key, value in fields.assumed.items()]
        why = "that are assumed, because no file gives them as numbers"
        yield f"numbers of {spec.id} {why}: {', '.join(listed)}"


def _row(spec: SensorSpec) -> str:
    """The first ten columns of sensors.csv for a range sensor."""
    numbers = (spec.x, spec.y, spec.z, spec.rotation, spec.error, spec.beam or 0.0)
    return f"{spec.id},{spec.code},1,{','.join(f'{number:g}' for number in numbers)},"


def _placed(
    fields: Fields, kind: type[SensorKind], taken: tuple[SensorSpec, ...], values: Mapping[str, Any]
) -> SensorSpec:
    """A sensor at the place of its description: their front is +y, their left +x, their turns clockwise."""
    left, forward = fields.point("position")
    number = free_number(kind, fields.code, taken)
    return kind.spec_type(kind=kind, number=number, code=fields.code, x=forward + 0.0, y=left + 0.0, **values)


def _doubled(fields: Fields, default: float) -> float:
    """The error of a sensor there: since Dec 2023 it is drawn with a standard deviation of 2, so it is twice
    the file's value."""
    error = 2 * fields.number("error", default, _SHARE)
    if error > 1:
        fields.note("error", f"doubled, as it is there, would be {error:g}; 1 is taken")
    return min(error, 1.0)


def _same_disc(fov: float) -> float:
    """The field of view, degrees, whose disc has the radius that theirs has: height * cos(fov / 2)
    there, height * tan(fov / 2) here."""
    return round(2 * math.degrees(math.atan(math.cos(math.radians(fov / 2)))), 6)


def _ultrasonic(fields: Fields, surroundings: Surroundings) -> dict[str, Any]:
    rays = fields.checked("num_rays", 7, IntegerRule(1, 1000))
    # Its name in files of the first year was fov.
    name = "fov" if fields.value("beamwidth") is None and fields.value("fov") is not None else "beamwidth"
    beam = fields.number(name, 15.0, NumberRule(0, 360))
    least = fields.number("min_range", 0.0, _LENGTH)
    most = fields.number("max_range", math.inf, _LENGTH)
    if most >= surroundings.longest and fields.of_class.pop("max_range", None) is not None:
        most = math.inf  # a default of the class without an effect in this maze
    if least >= surroundings.longest:
        what = f"{least:g} in is at or above the longest distance in the maze, {surroundings.longest:.1f} in"
        fields.note("min_range", f"{what}: the sensor could not read anything; 0 is taken")
        least = 0.0
    if most <= least:
        what = f"{most:g} in is at or below min_range, {least:g} in"
        fields.note("max_range", f"{what}: the sensor could not read anything; left out")
        most = math.inf
    return {
        "z": fields.number("height", surroundings.block_size, _LENGTH),
        "rotation": turn_of(fields),
        "error": _doubled(fields, 0.02),
        # Their rays are in the middles of equal parts of the beam, ours go from edge to edge.
        "field_of_view": beam * (rays - 1) / rays,
        "vertical_field_of_view": min(beam, _WIDEST),
        "rays": rays,
        "min_range": least,
        "max_range": most,
    }


def _infrared(fields: Fields, _: Surroundings) -> dict[str, Any]:
    if fields.value("bias"):
        fields.note("bias", "had no effect there; left out")
    return {
        "z": fields.number("height", 3.0, _LENGTH),
        "error": _doubled(fields, 0.02),
        "field_of_view": _same_disc(fields.number("fov", 60.0, NumberRule(0, 180, high_open=True))),
        "threshold": fields.number("threshold", 0.8, _SHARE),
        "detects_white": True,
    }


def _gyroscope(fields: Fields, _: Surroundings) -> dict[str, Any]:
    error, drift = _doubled(fields, 0.2), fields.number("bias", 0.1)
    return {"error": error, "gain": -1.0, "drift": drift, "wrap": 360.0}


def _compass(fields: Fields, _: Surroundings) -> dict[str, Any]:
    return {
        # Headings there are -heading - 90 of ours: gain and rotation convert one into the other.
        "rotation": 90.0,
        "gain": -1.0,
        "bias": fields.number("bias", 0.1),
        "absolute_error": 2 * 360.0 * fields.number("error", 0.2, _LENGTH),
        "wrap": 360.0,
    }


def _usual(fields: Fields, _: Surroundings) -> dict[str, Any]:
    """A device such as a motor: only its place, direction and error are used here."""
    return {"error": fields.number("error", 0.0, _SHARE), "rotation": turn_of(fields)}


# Those whose descriptions there need more than `_usual`.
_READERS: Mapping[type[SensorKind], Callable[[Fields, Surroundings], dict[str, Any]]] = MappingProxyType(
    {Ultrasonic: _ultrasonic, LineSensor: _infrared, Gyro: _gyroscope, Compass: _compass}
)
