"""The meaning of a command code in words: place and direction of its sensor, or motion of its drive."""

import math
from collections.abc import Iterator

from simmer_tui.sim.angles import half_turn, side_name
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.command import MISSION_QUERY, WORD, cut
from simmer_tui.sim.rules import did_you_mean
from simmer_tui.sim.specs import DriveSpec, GripperSpec, SensorSpec, SimulationSpec, VelocitySpec
from simmer_tui.sim.velocity_commands import WAIT, velocity_shape

# Inches or degrees below which descriptions show no difference.
_NEAR = 0.01


def describe_code(spec: SimulationSpec, code: str) -> list[str]:
    """Lines about a code, or an ID such as `ultra2`: kind, place, direction (degrees from the front,
    counter-clockwise), unit, errors, and the value of the command. If there is no such code, one line that
    says so."""
    parts = [(each.code, each.id, _sensor_lines(each)) for each in spec.sensors]
    parts += [(each.code, each.kind.value, _drive_lines(each)) for each in spec.drives]
    if spec.gripper is not None:
        parts.append((spec.gripper.code, "grip", _gripper_lines(spec.gripper)))
    parts += [(each.code, each.kind.value, _velocity_lines(each, spec)) for each in spec.velocities]
    for known, name, lines in parts:
        if code in (known, name):
            return lines
    if code == WAIT:
        return [f"{WAIT}  wait: simulated time advances by S seconds", f"Give   {WAIT}-S, such as {WAIT}-0.5"]
    if code == MISSION_QUERY:
        what = "the facts of the mission: drop zone, time limit, gripper, loading zone; no time passes"
        return [
            f"{MISSION_QUERY}  {what}",
            f"Give   {MISSION_QUERY} for all, or {MISSION_QUERY}-1 for the first",
        ]
    codes = [known for known, _, _ in parts]
    hint = did_you_mean(code, codes) or f"; there are {' '.join(codes)}"
    return [f"{cut(code, WORD)}: no sensor or drive has that code{hint}"]


def side_of(angle: float) -> str:
    """The side of an angle (degrees, counter-clockwise from the front) in words; with `about` unless it is in
    the middle of an eighth of a turn."""
    exact = abs(math.remainder(angle, 45.0)) < _NEAR
    return f"{'' if exact else 'about '}{side_name(angle, 'front', 'rear')}"


def _turned(angle: float) -> str:
    """An angle as degrees from the front, to the nearer side."""
    angle = half_turn(angle)
    if abs(math.remainder(angle, 180.0)) < _NEAR:
        return f"to the {side_of(angle)}"
    side = "left" if angle > 0 else "right"
    words = side_of(angle)
    plain = f"{abs(angle):g} deg to the {side}"
    return plain if words == side else f"{plain} ({words})"


def _off(enabled: bool) -> list[str]:
    return [] if enabled else ["It is switched off (Enabled is 0): the command is refused."]


def _sensor_lines(sensor: SensorSpec) -> list[str]:
    kind = sensor.kind
    lines = [f"{sensor.code}  {sensor.id}: {kind.meaning}", *_off(sensor.enabled)]
    if kind.has("x"):
        lines.append(f"Sits   {_place(sensor)}")
    if kind.has("rotation"):
        verb = "Rolls" if kind.counts else "Looks"
        lines.append(f"{verb:<6} {_turned(sensor.rotation)}{_view(sensor)}")
    elif sensor.view_words:
        lines.append(f"Looks  straight down{_view(sensor)}")
    given = "  (it takes no value)"
    if kind.is_scan:
        given = f" for all its ranges, {sensor.code}-90 for that at 90 deg from the robot's front"
    answers = [f"Says   {_answer(sensor)}", f"Errors {_errors(sensor)}", f"Give   {sensor.code}{given}"]
    return lines + answers


def _place(sensor: SensorSpec) -> str:
    """The sensor's place, by its distance and its direction from the robot's centre."""
    distance = math.hypot(sensor.x, sensor.y)
    height = f", {sensor.z:g} in up" if sensor.kind.has("z") else ""
    if distance < _NEAR:
        return f"at the robot's centre{height}"
    angle = math.degrees(math.atan2(sensor.y, sensor.x))
    at = f"x {sensor.x:g}, y {sensor.y:g}"
    return f"{round(distance, 2):g} in from the centre, {_direction(angle)} ({at}){height}"


def _direction(angle: float) -> str:
    """A direction from the centre; measured places such as (2.12, 2.12) are in an eighth except for
    rounding."""
    eighth = round(angle / 45.0) * 45.0
    if abs(angle - eighth) < 0.5:
        return f"to the {side_of(eighth)}"
    return _turned(round(angle, 1))


def _view(sensor: SensorSpec) -> str:
    return "".join(f", {part}" for part in sensor.view_words)


def _answer(sensor: SensorSpec) -> str:
    """The meaning of a reply: its unit, its limits, or yes and no."""
    if sensor.is_yes_or_no:
        return "1 for yes, 0 for no" if sensor.yes_words is None else f"1 {sensor.yes_words[1]}, else 0"
    unit = {"in": "inches", "deg": "degrees", "": "a number"}.get(sensor.unit, sensor.unit)
    limits = ""
    if sensor.min_range:
        limits += f", at least {sensor.min_range:g}"
    if math.isfinite(sensor.max_range):
        limits += f", Infinity beyond {sensor.max_range:g}"
    elif sensor.kind.is_range:
        limits += ", Infinity where nothing is hit"
    since = ", counted from the start" if sensor.kind.counts else ""
    return f"{unit}{since}{limits}"


# Fields that the lines above already describe.
_TOLD = {
    *("x", "y", "z", "rotation", "error", "field_of_view", "threshold", "rays"),
    *("min_range", "max_range", "detects_white"),
}


def _errors(sensor: SensorSpec) -> str:
    """The Percent Error, and all other columns that differ from their defaults."""
    parts = [f"{100 * sensor.error:g} %"] if sensor.kind.has("error") else []
    parts += [shown for column, shown, usual in values_of(sensor) if column.field not in _TOLD and not usual]
    return ", ".join(parts) or "none"


def values_of(sensor: SensorSpec) -> Iterator[tuple[CsvColumn, str, bool]]:
    """The columns of a sensor, each with its value in a few words, and True if that is the default."""
    defaults = type(sensor)(kind=sensor.kind, number=sensor.number, code=sensor.code)
    for column in sensor.kind.columns:
        if hasattr(defaults, column.field):
            value = getattr(sensor, column.field)
            shown = f"{column.label or column.shown} {column.rule.shown(value)}"
            yield column, shown, value == getattr(defaults, column.field)


def _drive_lines(drive: DriveSpec) -> list[str]:
    unit = "degrees" if drive.kind.turns else "inches"
    names = ("x", "y", "turn") if drive.kind.turns else ("along", "across", "turn")
    x, y, turn = drive.error.x, drive.error.y, drive.error.r
    values = (y, x, turn) if drive.kind.direction.y else (x, y, turn)
    errors = ", ".join(f"{name} {100 * value:g} %" for name, value in zip(names, values, strict=True))
    gain = f", times {drive.gain:g} (Gain)" if drive.gain != 1.0 else ""
    return [
        f"{drive.code}  {drive.kind.value}: {drive.kind.meaning}",
        *_off(drive.enabled),
        f"Moves  V {unit}{gain}; with a negative V the other way",
        f"Speed  {drive.speed:g} {drive.kind.unit}/s",
        f"Errors {errors} of V",
        f"Bias   x {drive.bias.x:g}, y {drive.bias.y:g}, r {drive.bias.r:g} of V (:bias shows those in use)",
        f"Give   {drive.code}-V, such as {drive.code}-{90 if drive.kind.turns else 3} "
        f"or {drive.code}--{90 if drive.kind.turns else 3}",
    ]


def _gripper_lines(gripper: GripperSpec) -> list[str]:
    return [
        f"{gripper.code}  grip: the gripper",
        *_off(gripper.enabled),
        f"Sits   at the front: it reaches {gripper.reach:g} in ahead of the robot, {gripper.width:g} in wide",
        f"Speed  {gripper.speed:g} openings or closings a second",
        f"Give   {gripper.code}-1 to close it, {gripper.code}-0 to open it",
    ]


def _velocity_lines(velocity: VelocitySpec, spec: SimulationSpec) -> list[str]:
    shape = velocity_shape(velocity, spec.wheels)
    if not shape:
        return [
            f"{velocity.code}  wheels: rim speeds, one a wheel",
            "It is refused: this robot's wheels are not described; see [wheels] in settings.toml",
        ]
    return [
        f"{velocity.code}  {velocity.kind.value}: a velocity that lasts until changed, or for T seconds",
        *_off(velocity.enabled),
        "Units  inches and degrees a second, in the robot's frame: ahead, to the left, counter-clockwise",
        f"Give   {shape}; zeros stop the robot",
    ]
