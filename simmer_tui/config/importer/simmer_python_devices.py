"""The devices of a simmer-python `config.py`: sensors, motors and drives, in our frame."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.config.importer.device_classes import DeviceClasses
from simmer_tui.config.importer.imported import Fields, Notes, OwnDevice, free_number, pair
from simmer_tui.config.importer.python_values import Call, Instance, Located, Unreadable
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
# Half of the stock robot's side, inches: the radius at which turning and driving are compared.
_HALF_ROBOT = 3.0
_DRIVE_FIELDS = _USUAL | {"velocity", "ang_velocity", "motors", "motor_direction", "bias"}


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
    for call, fields, known in _devices(table, codes, notes, tuple(kinds), classes, foreign):
        name = known or "Ultrasonic"
        fields.list_others(_FIELDS.get(name, _USUAL) | fields.read_by_class)
        values = _READERS.get(kinds[name], _usual)(fields, surroundings)
        sensors += (_placed(fields, kinds[name], taken + sensors, values),)
        for slip in classes.slips_of(call.name):
            notes.add_elsewhere(slip)
        parts = list(_origins(fields, sensors[-1], guessed=not known))
        if not known:
            parts[:0] = [
                f"{escape_word(call.name)} is taken as an ultra row, which reads the nearest distance"
            ]
        elif known != call.name:
            parts[:0] = [f"{escape_word(call.name)} is read as {known}"]
        if parts:
            fields.note("", "; ".join(parts))
    # After the known ones, so that a proposed row has a number that is still free.
    for call, fields in foreign:
        what = f"{escape_word(call.name)} {_OWN}; left out"
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
    numbers = (spec.x, spec.y, spec.z, spec.rotation, spec.error, spec.field_of_view)
    return f"{spec.id},{spec.code},1,{','.join(f'{number:g}' for number in numbers)},"


def _devices(
    table: dict[Any, Located],
    codes: set[str],
    notes: Notes,
    names: tuple[str, ...],
    classes: DeviceClasses,
    foreign: list[tuple[Call, Fields]] | None = None,
) -> Iterator[tuple[Call, Fields, str]]:
    """The devices of known classes with usable codes, each with the known class as which it is read; the
    others are noted.

    With `foreign`, a class of time-of-flight sensors counts as known, as an empty name. Readable devices of
    other classes are then added to that list instead of being noted.
    """
    for key, located in table.items():
        name = str(key)
        try:
            device = _device(key, located.value)
            given = _fields_of(device)
            # A class may make the description itself, of other arguments.
            passed = classes.description(device)
            description = passed if passed is not None else given
            made = classes.made(device, given)
            read = classes.used_by(device.name)
            fields = Fields(name, located.line, description or {}, notes, made, read)
            known = classes.kind_of(device, names)
            if not known:
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
        yield device, fields, known


def _device(key: Any, device: Any) -> Call:
    """An entry of a table as a device. Raises ValueError with the reason why it is not one."""
    try:
        CodeRule().check(key)
    except ValueError as error:
        raise ValueError(f"the code {error}") from None
    if isinstance(device, Instance) and device.call is not None:
        return device.call
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
    if not isinstance(given, dict):
        return None
    # Attributes that the file sets afterwards, of which one has another name than its key.
    changes = {"error" if key == "error_pct" else key: each for key, each in device.changes.items()}
    return given | changes


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
        "rotation": _turn(fields),
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
    return {"error": fields.number("error", 0.0, _SHARE), "rotation": _turn(fields)}


# Those whose descriptions there need more than `_usual`.
_READERS: Mapping[type[SensorKind], Callable[[Fields, Surroundings], dict[str, Any]]] = MappingProxyType(
    {Ultrasonic: _ultrasonic, LineSensor: _infrared, Gyro: _gyroscope, Compass: _compass}
)


def read_drives(
    table: dict[Any, Located], notes: Notes, classes: DeviceClasses | None = None
) -> tuple[DriveSpec, ...]:
    """The drives of a table of devices."""
    drives: list[DriveSpec] = []
    found = list(_devices(table, set(), notes, ("Drive",), classes or DeviceClasses()))
    # Those along one axis first: the others take rows that are left.
    found.sort(key=lambda each: _motion(each[1].silent()).axes != 1)
    for _, fields, _ in found:
        fields.list_others(_DRIVE_FIELDS | fields.read_by_class)
        drive = _drive(fields, {each.kind for each in drives})
        if drive is not None:
            drives.append(drive)
    order = list(table)
    return tuple(sorted(drives, key=lambda drive: order.index(drive.code)))


# The axis along which a drive moves, there and here; for ahead and back it is their y and our x.
_AXES = {DriveKind.ROT: ("rotation", "r"), DriveKind.UP: ("x", "y"), DriveKind.DOWN: ("x", "y")}


class _Motion(Struct, frozen=True):
    """A drive's motion there, for each unit of its value: inches forward and to the left, and degrees
    counter-clockwise; `speed` is units a second, `axes` the number of the three that are not 0. `kind` is the
    row that is nearest."""

    forward: float
    left: float
    turn: float
    speed: float
    axes: int
    kind: DriveKind


def _motion(fields: Fields) -> _Motion:
    left, forward = fields.point("velocity")
    turning = fields.number("ang_velocity", 0.0)
    length = math.hypot(left, forward)
    # There a drive with any turning speed turns by one degree a unit, and one with any velocity moves by one
    # inch a unit; the two speeds are added.
    along = (forward / length, left / length) if length else (0.0, 0.0)
    if math.radians(abs(turning)) * _HALF_ROBOT > length:
        kind = DriveKind.ROT
    elif abs(forward) >= abs(left):
        kind = DriveKind.LEFT if forward < 0 else DriveKind.RIGHT
    else:
        kind = DriveKind.UP if left > 0 else DriveKind.DOWN
    axes = (left != 0) + (forward != 0) + (turning != 0)
    return _Motion(*along, -1.0 if turning else 0.0, length + abs(turning), axes, kind)


def _row_for(motion: _Motion, taken: set[DriveKind]) -> DriveKind | None:
    """The free row for a motion: the nearest, else one along the same axis, else any."""
    opposite = {
        DriveKind.RIGHT: DriveKind.LEFT,
        DriveKind.LEFT: DriveKind.RIGHT,
        DriveKind.UP: DriveKind.DOWN,
        DriveKind.DOWN: DriveKind.UP,
    }
    wanted = [motion.kind, opposite.get(motion.kind, motion.kind), *DriveKind]
    return next((kind for kind in wanted if kind not in taken), None)


def _drive(fields: Fields, taken: set[DriveKind]) -> DriveSpec | None:
    motion, turning = _motion(fields), fields.silent().number("ang_velocity", 0.0)
    if not motion.axes:
        fields.note("", "does not move there: velocity and ang_velocity are 0; left out")
        return None
    kind = _row_for(motion, taken)
    if kind is None:
        fields.note("", "a set has five drives, and all are taken; left out")
        return None
    if turning < 0:
        fields.note("ang_velocity", f"is below 0, which never ends there; {-turning:g} is taken")
    bias, error = fields.axes("bias"), fields.axes("error")
    axis, ours = _AXES.get(motion.kind, ("y", "x"))
    wanted = Axes(motion.forward, motion.left, motion.turn)
    # What a unit adds on each axis there, in our frame.
    added = Axes(bias["y"], bias["x"], -bias["rotation"])
    gain, found = _row_values(kind, wanted, added)
    if motion.axes > 1:
        moved = f"{motion.forward:g} in forward, {motion.left:g} in left, {-motion.turn:g} deg clockwise"
        what = f"velocity and ang_velocity have more than one number: there each unit is {moved}"
        advice = "for a plain movement set all but one to 0"
        fields.note("", f"{what}; the row {kind} has biases for that; {advice}")
    elif kind is not motion.kind:
        fields.note(
            "", f"the row {motion.kind} is taken; the row {kind} has a gain and biases that move as it does"
        )
    if motion.axes == 1:
        _compare_wheels(fields, motion.kind)
    ignored = [name for name, value in error.items() if value and name != axis]
    if ignored:
        fields.note(
            "error", f"had no effect there across the direction of travel: {', '.join(ignored)}; left out"
        )
    return DriveSpec(
        kind=kind,
        code=fields.code,
        error=Axes(**{ours: abs(error[axis])}),
        bias=found,
        gain=gain,
        speed=motion.speed,
    )


def _row_values(kind: DriveKind, wanted: Axes, added: Axes) -> tuple[float, Axes]:
    """Gain and biases with which a row moves as wanted, and by the added biases, for each unit of value."""
    directions, motions, biases = astuple(kind.direction), astuple(wanted), astuple(added)
    own = next(index for index, each in enumerate(directions) if each)
    # The row's own motion a unit, towards the wanted one.
    sign = directions[own] * (-1.0 if motions[own] * directions[own] < 0 else 1.0)
    rest = (
        (motion - sign * (index == own) + bias) / sign + 0.0
        for index, (motion, bias) in enumerate(zip(motions, biases, strict=True))
    )
    return sign * directions[own], Axes(*rest)


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
