"""The drives of a simmer-python `config.py`, in our frame."""

import math
from typing import Any

from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.config.importer.device_classes import DeviceClasses
from simmer_tui.config.importer.imported import Fields, Notes
from simmer_tui.config.importer.python_values import Call, Located
from simmer_tui.config.importer.simmer_python_devices import USUAL_FIELDS, devices_of, fields_of, turn_of
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec

# Half of the stock robot's side, inches: the radius at which turning and driving are compared.
_HALF_ROBOT = 3.0
_DRIVE_FIELDS = USUAL_FIELDS | {"velocity", "ang_velocity", "motors", "motor_direction", "bias"}


def read_drives(
    table: dict[Any, Located], notes: Notes, classes: DeviceClasses | None = None
) -> tuple[DriveSpec, ...]:
    """The drives of a table of devices."""
    drives: list[DriveSpec] = []
    found = list(devices_of(table, set(), notes, ("Drive",), classes or DeviceClasses()))
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
    counter-clockwise. `speed` is units a second; unless it is above 0, a movement never ends. `axes` is the
    number of the three that are not 0, `kind` the row that is nearest."""

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
    # There a drive with any turning speed turns clockwise by one degree a unit, however small it is and
    # whatever its sign. One with any velocity moves by one inch a unit. The speeds are added with signs.
    along = (forward / length, left / length) if length else (0.0, 0.0)
    if math.radians(abs(turning)) * _HALF_ROBOT > length:
        kind = DriveKind.ROT
    elif abs(forward) >= abs(left):
        kind = DriveKind.LEFT if forward < 0 else DriveKind.RIGHT
    else:
        kind = DriveKind.UP if left > 0 else DriveKind.DOWN
    axes = (left != 0) + (forward != 0) + (turning != 0)
    return _Motion(*along, -1.0 if turning else 0.0, length + turning, axes, kind)


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
    speed = motion.speed if motion.speed > 0 else abs(motion.speed or turning)
    if speed != motion.speed:
        what = f"makes the speed {motion.speed:g} a second, which never ends there; {speed:g} is taken"
        fields.note("ang_velocity", what)
    bias, error = fields.axes("bias"), fields.axes("error")
    axis, ours = _AXES.get(motion.kind, ("y", "x"))
    wanted = Axes(motion.forward, motion.left, motion.turn)
    # What a unit adds on each axis there, in our frame.
    added = Axes(bias["y"], bias["x"], -bias["rotation"])
    gain, found = _row_values(kind, wanted, added)
    if motion.axes > 1:
        moved = f"{motion.forward:g} in forward, {motion.left:g} in left, {-motion.turn:g} deg clockwise"
        what = f"velocity and ang_velocity have more than one number: there each unit is {moved}"
        if turning:
            what += f"; ang_velocity {turning:g} turns 1 deg a unit there, whatever its size"
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
        speed=speed,
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
        wheel = fields_of(motor) if isinstance(motor, Call) else None
        if wheel is None or not isinstance(sign, int | float):
            continue
        place = Fields(f"{fields.code}.motors[{number}]", fields.line, wheel, Notes(""))
        left, forward = place.point("position")
        heading = math.radians(turn_of(place))
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
