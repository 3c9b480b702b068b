"""Small drawings of the robot from above, its front up, with the places and directions of its sensors."""

import math
from collections.abc import Iterable, Sequence
from textwrap import dedent

from simmer_tui.sim.angles import ARROWS, PLAIN_ARROWS, eighth_of_turn, half_turn, side_name
from simmer_tui.sim.specs import RobotSpec, SensorSpec, SimulationSpec

# Size of the drawing of one sensor, characters.
_COLUMNS, _ROWS = 25, 11
# Columns an inch for a robot of the usual size; half as many rows.
_PER_INCH = 2.0
# Inches shown to either side of the middle of such a robot.
_ROOM = 7.0
# Character and length, inches, of the line along which a sensor looks.
_BEAM = (".", 2.5)
# Points of an outline: with so many, no character between two of them stays blank.
_OUTLINE_STEPS = 240

_WIDE_COLUMNS, _WIDE_ROWS = 41, 17
# Inches shown to either side of the middle of a robot of the usual size, with all of its sensors.
_WIDE_ROOM = 5.6
# Inches from a sensor with a direction to its code, along that direction.
_LABEL_AWAY = 1.7
# Columns between the picture and the words.
_GAP = 2


def robot_drawing(spec: SimulationSpec, *, ascii_only: bool = False) -> list[str]:
    """The robot with its enabled sensors, each an arrow in its direction with its code beside it. Next to the
    picture are the directions in words, and the motions of its drives."""
    words = _words(spec)
    picture = _picture(spec, PLAIN_ARROWS if ascii_only else ARROWS)
    height = max(len(picture), len(words))
    picture += [""] * (height - len(picture))
    above = (height - len(words)) // 2
    words = [""] * above + words + [""] * (height - above - len(words))
    width = max(map(len, picture)) + _GAP
    return [f"{left.ljust(width)}{right}".rstrip() for left, right in zip(picture, words, strict=True)]


def sensor_drawing(robot: RobotSpec, sensor: SensorSpec) -> list[str]:
    """One sensor, in ASCII: the outline `o`, the middle `+`, the sensor `#` and the line of its direction."""
    grid = _Grid(_ROWS, _COLUMNS, _scale(robot, [sensor], _PER_INCH, _ROOM - _BEAM[1]))
    grid.draw_outline(robot)
    if sensor.kind.has("rotation"):
        angle = math.radians(sensor.rotation)
        for step in range(1, 11):
            along = step * _BEAM[1] / 10
            grid.put(sensor.x + along * math.cos(angle), sensor.y + along * math.sin(angle), _BEAM[0])
    grid.put(sensor.x, sensor.y, "#")
    return [" " * (_COLUMNS // 2 - 2) + "front", *grid.lines()]


def _scale(robot: RobotSpec, sensors: Iterable[SensorSpec], per_inch: float, room: float) -> float:
    """Columns an inch at which the robot and its sensors fit into the drawing."""
    reach = robot.radius or max((math.hypot(*vertex) for vertex in robot.vertices), default=3.0)
    far = max((math.hypot(sensor.x, sensor.y) for sensor in sensors), default=0.0)
    return per_inch * min(1.0, room / max(reach, far, 0.1))


class _Grid:
    """Characters by their place in the robot's frame, x ahead (up) and y left, inches."""

    def __init__(self, rows: int, columns: int, scale: float) -> None:
        self._cells = [[" "] * columns for _ in range(rows)]
        self._rows, self._columns, self._scale = rows, columns, scale

    def cell(self, x: float, y: float) -> tuple[int, int]:
        return round(self._rows // 2 - x * self._scale / 2), round(self._columns // 2 - y * self._scale)

    def put(self, x: float, y: float, sign: str) -> None:
        row, column = self.cell(x, y)
        if 0 <= row < self._rows and 0 <= column < self._columns:
            self._cells[row][column] = sign

    def write(self, x: float, y: float, text: str) -> None:
        """Centre a text at a place, or as near to it as there is room; no character is overwritten."""
        row, column = self.cell(x, y)
        places = [
            (at, left)
            for at in range(self._rows)
            for left in range(self._columns - len(text) + 1)
            if self._is_free(at, left, len(text))
        ]
        if not places:
            return
        at, left = min(
            places, key=lambda place: (2 * (place[0] - row)) ** 2 + (place[1] + len(text) / 2 - column) ** 2
        )
        self._cells[at][left : left + len(text)] = text

    def _is_free(self, row: int, left: int, width: int) -> bool:
        around = self._cells[row][max(left - 1, 0) : left + width + 1]
        return all(cell == " " for cell in around)

    def draw_outline(self, robot: RobotSpec) -> None:
        for x, y in _outline(robot):
            self.put(x, y, "o")
        self.put(0.0, 0.0, "+")

    def lines(self) -> list[str]:
        """The drawing, without blank lines."""
        return [line for line in ("".join(row).rstrip() for row in self._cells) if line]


def _picture(spec: SimulationSpec, arrows: Sequence[str]) -> list[str]:
    sensors = [sensor for sensor in spec.sensors if sensor.enabled]
    room = _WIDE_ROOM - _LABEL_AWAY
    grid = _Grid(_WIDE_ROWS, _WIDE_COLUMNS, _scale(spec.robot, sensors, _WIDE_COLUMNS / 2 / _WIDE_ROOM, room))
    grid.draw_outline(spec.robot)
    # Sensors that look ahead are drawn last, so that their arrow replaces a wheel at the same place.
    for sensor in sorted(sensors, key=lambda sensor: sensor.kind.is_range):
        if _has_direction(sensor):
            # The front is up here, and to the right in the table.
            grid.put(sensor.x, sensor.y, arrows[eighth_of_turn(sensor.rotation + 90.0)])
    for place, codes in _by_place(sensors).items():
        x, y, rotation = place
        away = 0.0 if rotation is None else _LABEL_AWAY
        angle = math.radians(rotation or 0.0)
        grid.write(x + away * math.cos(angle), y + away * math.sin(angle), " ".join(codes))
    lines = [" " * (_WIDE_COLUMNS // 2 - 2) + "front", *grid.lines()]
    return dedent("\n".join(lines)).splitlines()


def _by_place(sensors: Sequence[SensorSpec]) -> dict[tuple[float, float, float | None], list[str]]:
    """Codes by place, and by direction if they look away from the robot."""
    found: dict[tuple[float, float, float | None], list[str]] = {}
    for sensor in sensors:
        if sensor.kind.has("x"):
            outward = sensor.kind.is_range
            place = (sensor.x, sensor.y, sensor.rotation % 360.0 if outward else None)
            found.setdefault(place, []).append(sensor.code)
    return found


def _words(spec: SimulationSpec) -> list[str]:
    """The directions of sensors and the motions of drives, equal ones on one line."""
    directions: dict[str, list[str]] = {}
    for sensor in spec.sensors:
        if sensor.enabled:
            directions.setdefault(_direction(sensor), []).append(sensor.code)
    lines = [(_named(codes), direction) for direction, codes in directions.items()]
    lines += movement_commands(spec)
    width = max((len(codes) for codes, _ in lines), default=0)
    return [f"{codes.ljust(width)}  {meaning}" for codes, meaning in lines]


def movement_commands(spec: SimulationSpec) -> list[tuple[str, str]]:
    """Commands that drive the robot or move its gripper, each with its meaning."""
    rows = [(f"{drive.code}-V", f"{drive.kind.meaning} by V") for drive in spec.drives if drive.enabled]
    gripper = spec.gripper
    if gripper is not None and gripper.enabled:
        rows.append((f"{gripper.code}-1", f"close the gripper; {gripper.code}-0 opens it"))
    return rows


def _named(codes: Sequence[str]) -> str:
    """Codes in words, `i1 to i4` for many consecutive ones."""
    first, last = codes[0], codes[-1]
    is_row = first[1:].isdigit() and all(
        code == f"{first[0]}{number}" for number, code in enumerate(codes, int(first[1:]))
    )
    return f"{first} to {last}" if is_row and len(codes) > 2 else " ".join(codes)


def _has_direction(sensor: SensorSpec) -> bool:
    """True if the sensor looks, or rolls, in one direction."""
    kind = sensor.kind
    return kind.is_range or (kind.counts and kind.has("rotation"))


def _direction(sensor: SensorSpec) -> str:
    kind = sensor.kind
    if not _has_direction(sensor):
        return kind.meaning
    angle = half_turn(sensor.rotation)
    if angle in (0.0, 180.0):
        return f"{kind.meaning}, {side_name(angle, 'front', 'rear')}"
    return f"{kind.meaning}, {abs(angle):g} deg {'left' if angle > 0 else 'right'}"


def _outline(robot: RobotSpec) -> list[tuple[float, float]]:
    parts = [step / _OUTLINE_STEPS for step in range(_OUTLINE_STEPS)]
    if robot.radius is not None:
        turns = [2 * math.pi * part for part in parts]
        return [(robot.radius * math.cos(turn), robot.radius * math.sin(turn)) for turn in turns]
    sides = zip(robot.vertices, (*robot.vertices[1:], robot.vertices[0]), strict=True)
    return [
        (x + part * (to_x - x), y + part * (to_y - y)) for (x, y), (to_x, to_y) in sides for part in parts
    ]
