"""The devices of a simmer-python `config.py`: sensors, motors and drives, in our frame."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

from simmer_tui.importer.device_classes import ClassNumbers
from simmer_tui.importer.imported import Fields, Notes, OwnDevice, free_number, pair
from simmer_tui.importer.python_values import Call, Located, Unreadable
from simmer_tui.sim.command import escape_word
from simmer_tui.sim.rules import CodeRule, IntegerRule, NumberRule
from simmer_tui.sim.sensors import KINDS, Compass, Gyro, LineSensor, Ultrasonic
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, SensorKind, SensorSpec

_SHARE = NumberRule(0, 1)
# Degrees of a vertical field of view; one of 180 has no slope.
_WIDEST = 179.0
_LENGTH = NumberRule(0)
# Fields that a class of theirs uses: those of any device, those of one that shows its measurement, its own.
_USUAL = frozenset(
    {"id", "visible", "color", "outline", "outline_thickness", "position", "rotation", "error"}
)
_SHOWN = _USUAL | {"visible_measurement", "visible_measurement_time", "height"}
_FIELDS = {
    "Ultrasonic": _SHOWN | {"num_rays", "min_range", "max_range", "beamwidth", "fov"},
    "Infrared": _SHOWN | {"fov", "threshold", "bias"},
    "Gyroscope": _USUAL | {"bias"},
    "Compass": _USUAL | {"bias"},
}
# Classes of a team's own whose devices are read as `Ultrasonic` ones: there is none for them there.
_TIME_OF_FLIGHT = re.compile(r"(?i)(.*_)?(tof|time_?of_?flight|vl53l\d\w*)(_?sensor)?")
_OWN = "is a device of the team's own or belongs elsewhere"
_DRIVE_FIELDS = _USUAL | {"velocity", "ang_velocity", "motors", "motor_direction", "bias"}


def read_sensors(
    table: dict[Any, Located],
    codes: set[str],
    block_size: float,
    notes: Notes,
    taken: tuple[SensorSpec, ...] = (),
    classes: Mapping[str, ClassNumbers] = MappingProxyType({}),
    own: list[OwnDevice] | None = None,
) -> tuple[SensorSpec, ...]:
    """The sensors of a table of devices; motors become wheel encoders.

    `codes` has the codes in use and is added to; `taken` are the existing sensors, `classes` numbers of the
    team's device classes. Devices of classes without a kind here are added to `own`.
    """
    kinds = {device: kind for kind in KINDS.values() for device in kind.devices}
    sensors: tuple[SensorSpec, ...] = ()
    foreign: list[tuple[Call, Fields]] = []
    for call, fields in _devices(table, codes, notes, frozenset(kinds), foreign, classes):
        name = call.name if call.name in kinds else "Ultrasonic"
        fields.list_others(_FIELDS.get(name, _USUAL))
        values = _READERS.get(kinds[name], _usual)(fields, block_size)
        sensors += (_placed(fields, kinds[name], taken + sensors, values),)
        guessed = name != call.name
        parts = list(_origins(fields, sensors[-1], guessed))
        if guessed:
            parts[:0] = [
                f"{escape_word(call.name)} is taken as an ultra row, which reads the nearest distance"
            ]
        if parts:
            fields.note("", "; ".join(parts))
    # After the known ones, so that a proposed row has a number that is still free.
    for call, fields in foreign:
        what = f"{escape_word(call.name)} {_OWN}; left out"
        silent = fields.silent()
        if pair(silent.value("position")) is not None:
            row = _placed(silent, Ultrasonic, taken + sensors, _ultrasonic(silent, block_size))
            known = _origins(silent, row, guessed=True)
            what = "; ".join((f"{what}. If it tells a distance, add to sensors.csv: {_row(row)}", *known))
        note = fields.note("", what)
        if own is not None and call.name in classes:
            row = _placed(silent, Ultrasonic, taken, _usual(silent, block_size))
            own.append(OwnDevice(call.name, row, silent.class_numbers, silent.numbers, note))
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
    numbers = (spec.x, spec.y, spec.z, spec.rotation, spec.error, spec.field_of_view)
    return f"{spec.id},{spec.code},1,{','.join(f'{number:g}' for number in numbers)},"


def _devices(
    table: dict[Any, Located],
    codes: set[str],
    notes: Notes,
    classes: frozenset[str],
    foreign: list[tuple[Call, Fields]] | None = None,
    own: Mapping[str, ClassNumbers] = MappingProxyType({}),
) -> Iterator[tuple[Call, Fields]]:
    """The devices of known classes with usable codes; the others are noted.

    With `foreign`, a class of time-of-flight sensors counts as known. Readable devices of other classes are
    then added to that list instead of being noted.
    """
    for key, located in table.items():
        name = str(key)
        try:
            device = _device(key, located.value)
            description = _fields_of(device)
            fields = Fields(name, located.line, description or {}, notes, own.get(device.name, {}))
            if device.name not in classes:
                is_ranging = _TIME_OF_FLIGHT.fullmatch(device.name)
                if foreign is not None and not is_ranging:
                    foreign.append((device, fields))
                    continue
                if foreign is None:
                    raise ValueError(f"{escape_word(device.name)} {_OWN}")
            if key in codes:
                raise ValueError("the code is in use already")
            if description is None:
                raise ValueError("its description cannot be read")
        except ValueError as error:
            notes.add(located.line, name, f"{error}; left out")
            continue
        codes.add(name)
        yield device, fields


def _device(key: Any, device: Any) -> Call:
    """An entry of a table as a device. Raises ValueError with the reason why it is not one."""
    try:
        CodeRule().check(key)
    except ValueError as error:
        raise ValueError(f"the code {error}") from None
    if isinstance(device, Unreadable):
        raise ValueError(f"cannot be read: {device.why}")
    if not isinstance(device, Call):
        raise ValueError("is not a device")
    return device


def _fields_of(device: Call) -> dict[Any, Located] | None:
    """The dict from which a device is made: its argument, or its keywords."""
    given = device.arguments[0] if device.arguments else None
    if given is None and "info" in device.keywords:
        given = device.keywords["info"].value
    elif given is None:
        given = dict(device.keywords)
    return given if isinstance(given, dict) else None


def _placed(
    fields: Fields, kind: type[SensorKind], taken: tuple[SensorSpec, ...], values: Mapping[str, Any]
) -> SensorSpec:
    """A sensor at the place of its description: their front is +y, their left +x, their turns clockwise."""
    left, forward = fields.point("position")
    number = free_number(kind, fields.code, taken)
    return SensorSpec(kind=kind, number=number, code=fields.code, x=forward + 0.0, y=left + 0.0, **values)


def _turn(fields: Fields) -> float:
    return 0.0 - fields.number("rotation", 0.0)


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


def _ultrasonic(fields: Fields, block_size: float) -> dict[str, Any]:
    rays = fields.checked("num_rays", 7, IntegerRule(1, 1000))
    # Its name in files of the first year was fov.
    name = "fov" if fields.value("beamwidth") is None and fields.value("fov") is not None else "beamwidth"
    beam = fields.number(name, 15.0, NumberRule(0, 360))
    least = fields.number("min_range", 0.0, _LENGTH)
    most = fields.number("max_range", math.inf, _LENGTH)
    if most < least:
        fields.note("max_range", "is below min_range; left out")
        most = math.inf
    return {
        "z": fields.number("height", block_size, _LENGTH),
        "rotation": _turn(fields),
        "error": _doubled(fields, 0.02),
        # Their rays are in the middles of equal parts of the beam, ours go from edge to edge.
        "field_of_view": beam * (rays - 1) / rays,
        "vertical_field_of_view": min(beam, _WIDEST),
        "rays": rays,
        "min_range": least,
        "max_range": most,
    }


def _infrared(fields: Fields, _: float) -> dict[str, Any]:
    if fields.value("bias"):
        fields.note("bias", "had no effect there; left out")
    return {
        "z": fields.number("height", 3.0, _LENGTH),
        "error": _doubled(fields, 0.02),
        "field_of_view": _same_disc(fields.number("fov", 60.0, NumberRule(0, 180, high_open=True))),
        "threshold": fields.number("threshold", 0.8, _SHARE),
        "detects_white": True,
    }


def _gyroscope(fields: Fields, _: float) -> dict[str, Any]:
    error, drift = _doubled(fields, 0.2), fields.number("bias", 0.1)
    return {"error": error, "gain": -1.0, "drift": drift, "wrap": 360.0}


def _compass(fields: Fields, _: float) -> dict[str, Any]:
    return {
        # Headings there are -heading - 90 of ours: gain and rotation convert one into the other.
        "rotation": 90.0,
        "gain": -1.0,
        "bias": fields.number("bias", 0.1),
        "absolute_error": 2 * 360.0 * fields.number("error", 0.2, _LENGTH),
        "wrap": 360.0,
    }


def _usual(fields: Fields, _: float) -> dict[str, Any]:
    """A device such as a motor: only its place, direction and error are used here."""
    return {"error": fields.number("error", 0.0, _SHARE), "rotation": _turn(fields)}


# Those whose descriptions there need more than `_usual`.
_READERS: Mapping[type[SensorKind], Callable[[Fields, float], dict[str, Any]]] = MappingProxyType(
    {Ultrasonic: _ultrasonic, LineSensor: _infrared, Gyro: _gyroscope, Compass: _compass}
)


def read_drives(table: dict[Any, Located], notes: Notes) -> tuple[DriveSpec, ...]:
    """The drives of a table of devices."""
    drives: list[DriveSpec] = []
    for _, fields in _devices(table, set(), notes, frozenset({"Drive"})):
        fields.list_others(_DRIVE_FIELDS)
        drive = _drive(fields)
        if drive is None:
            continue
        same = next((other for other in drives if other.kind is drive.kind), None)
        if same is not None:
            fields.note("", f"moves as {same.code} does, and a set has one drive a direction; left out")
            continue
        _compare_wheels(fields, drive.kind)
        drives.append(drive)
    return tuple(drives)


# The axis along which a drive moves, there and here; for ahead and back it is their y and our x.
_AXES = {DriveKind.ROT: ("rotation", "r"), DriveKind.UP: ("x", "y"), DriveKind.DOWN: ("x", "y")}


def _drive(fields: Fields) -> DriveSpec | None:
    left, forward = fields.point("velocity")
    turning = fields.number("ang_velocity", 0.0)
    kind = _direction(left, forward, turning)
    if kind is None:
        fields.note("", "moves along no single axis, or not at all; left out")
        return None
    if turning < 0:
        fields.note("ang_velocity", f"is below 0, which never ends there; {-turning:g} is taken")
    bias, error = fields.axes("bias"), fields.axes("error")
    axis, ours = _AXES.get(kind, ("y", "x"))
    ignored = [name for name, value in error.items() if value and name != axis]
    if ignored:
        fields.note(
            "error", f"had no effect there across the direction of travel: {', '.join(ignored)}; left out"
        )
    sign = 1.0 if kind in (DriveKind.RIGHT, DriveKind.UP) else -1.0
    return DriveSpec(
        kind=kind,
        code=fields.code,
        error=Axes(**{ours: abs(error[axis])}),
        bias=Axes(x=sign * bias["y"] + 0.0, y=sign * bias["x"] + 0.0, r=-sign * bias["rotation"] + 0.0),
        gain=-1.0 if kind is DriveKind.ROT else 1.0,
        speed=abs(turning) or math.hypot(left, forward),
    )


def _direction(left: float, forward: float, turning: float) -> DriveKind | None:
    if (left != 0) + (forward != 0) + (turning != 0) != 1:
        return None
    if turning:
        return DriveKind.ROT
    if forward:
        return DriveKind.RIGHT if forward > 0 else DriveKind.LEFT
    return DriveKind.UP if left > 0 else DriveKind.DOWN


def _compare_wheels(fields: Fields, kind: DriveKind) -> None:
    """Note each motor whose count would differ: there a list determines its sign, here its place."""
    motors, signs = fields.value("motors"), fields.value("motor_direction")
    if not isinstance(motors, list) or not isinstance(signs, list):
        return
    for number, (motor, sign) in enumerate(zip(motors, signs, strict=False)):
        wheel = _fields_of(motor) if isinstance(motor, Call) else None
        if wheel is None or not isinstance(sign, int | float):
            continue
        place = Fields(f"{fields.code}.motors[{number}]", fields.line, wheel, Notes(""))
        left, forward = place.point("position")
        heading = math.radians(_turn(place))
        travel = {
            DriveKind.RIGHT: math.cos(heading),
            DriveKind.LEFT: -math.cos(heading),
            DriveKind.UP: math.sin(heading),
            DriveKind.DOWN: -math.sin(heading),
            DriveKind.ROT: left * math.cos(heading) - forward * math.sin(heading),
        }[kind]
        # Far above the rounding of a cosine; wheels perpendicular to the motion count nothing.
        if travel * sign < 1e-9:
            what = f"motor {number + 1} of the list counts by its place and direction here, not by {sign:g}"
            fields.note("motor_direction", what)
