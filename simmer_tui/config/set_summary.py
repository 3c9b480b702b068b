"""A configuration in plain text: the maze drawn in characters, the robot, sensors, drives, settings."""

from collections.abc import Sequence

import numpy as np
import shapely
from msgspec import Struct
from shapely.geometry.base import BaseGeometry

from simmer_tui.config import dialects
from simmer_tui.config.describe_code import values_of
from simmer_tui.config.loader import Configuration
from simmer_tui.config.maze_csv import CELLS
from simmer_tui.config.mission_plan import mission_text
from simmer_tui.config.robot_drawing import robot_drawing
from simmer_tui.config.set_warnings import set_warnings
from simmer_tui.config.settings import Settings, all_settings, value_of
from simmer_tui.dialect.dialect_rules import DialectRules
from simmer_tui.dialect.inverse import InverseRules
from simmer_tui.dialect.messages import dictionary
from simmer_tui.errors import printable
from simmer_tui.sim.angles import ARROWS, PLAIN_ARROWS
from simmer_tui.sim.columns import BASE, LESS_USUAL, THRESHOLD
from simmer_tui.sim.command import cut
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.specs import (
    CELL_SIZE,
    WALL,
    Axes,
    DriveSpec,
    GripperSpec,
    RobotSpec,
    SensorSpec,
    SimulationSpec,
)
from simmer_tui.sim.velocity_commands import WAIT, velocity_shape

# 100 columns with the frame.
MAX_WIDTH = 98
"""Greatest width of a drawn maze, characters without its frame; a larger maze is drawn smaller."""
# Characters across and down a cell; the first pair that fits is used. A character is about twice as high as
# wide.
_SCALES = ((8, 4), (6, 3), (4, 2), (2, 1), (1, 1))


class _Glyphs(Struct, frozen=True):
    """The characters of a drawing; `arrows` begin at +X and go counter-clockwise."""

    wall: str
    block: str
    arrows: Sequence[str]


_UNICODE = _Glyphs(wall="█", block="■", arrows=ARROWS)
_ASCII = _Glyphs(wall="#", block="B", arrows=PLAIN_ARROWS[::2])
# Columns of sensors.csv that the table has too.
_IN_TABLE = {column.name for column in BASE} - {THRESHOLD.name}
_EMPTY, _ROBOT = " ", "o"
_MARKED = {value: kind for value, kind in CELLS.items() if kind.letter}


def summarize(configuration: Configuration, *, ascii_only: bool = False) -> str:
    """The summary as lines of text, ended by a newline. With `ascii_only`, in ASCII characters only."""
    spec = configuration.simulation
    lines = [
        f"Configuration: {configuration.name}",
        "",
        f"Maze: {spec.maze.columns} x {spec.maze.rows} cells, {spec.maze.width:g} x {spec.maze.height:g} in, "
        f"floor {'generated' if spec.maze.floor is None else 'from floor.csv'}",
        *_draw(spec, _ASCII if ascii_only else _UNICODE),
        "",
        f"Robot: {_outline(spec.robot)}; centre {_point(spec.bot_center)} in, heading {spec.bot_rot:g} deg",
        f"Block: {_block(spec)}",
        "",
        *robot_drawing(spec, ascii_only=ascii_only),
        "",
        "Sensors",
        *_table(
            ("code", "id", "x in", "y in", "z in", "rotation deg", "error", "fov deg", "notes"),
            [_sensor_row(sensor) for sensor in spec.sensors],
        ),
        *_devices(configuration),
        "",
        "Drives",
        *_table(
            ("code", "id", "moves", "error x/y/r", "bias x/y/r", "speed", "notes"),
            [_drive_row(drive, spec.randbias) for drive in spec.drives],
        ),
        *_gripper(spec.gripper),
        *_velocities(spec),
        "",
        *_settings(configuration),
        *([] if configuration.mission is None else [mission_text(configuration.mission)]),
        *_dialect(configuration.dialect),
        *(f"Warning: {each}." for each in set_warnings(configuration)),
    ]
    text = "\n".join(printable(line.rstrip()) for line in lines) + "\n"
    return text.encode("ascii", "backslashreplace").decode() if ascii_only else text


def _draw(spec: SimulationSpec, glyphs: _Glyphs) -> list[str]:
    """The maze from above, and a line that explains its characters."""
    maze = spec.maze
    across, down = next((s for s in _SCALES if s[0] * maze.columns <= MAX_WIDTH), _SCALES[-1])
    canvas = [[_EMPTY] * (across * maze.columns) for _ in range(down * maze.rows)]
    for row, cells in enumerate(maze.cells):
        for column, value in enumerate(cells):
            top, left = row * down, column * across
            if value == WALL:
                for line in canvas[top : top + down]:
                    line[left : left + across] = glyphs.wall * across
            elif value in _MARKED:
                canvas[top][left] = _MARKED[value].letter
    # The middle of every character, global, inches; rows from the top down.
    xs = (np.arange(len(canvas[0])) + 0.5) * CELL_SIZE / across
    ys = maze.height - (np.arange(len(canvas)) + 0.5) * CELL_SIZE / down
    middles = shapely.points(*np.meshgrid(xs, ys))

    def fill(shape: BaseGeometry, margin: float, glyph: str) -> None:
        for row, column in np.argwhere(np.asarray(shapely.distance(shape, middles)) <= margin):
            canvas[row][column] = glyph

    def put(place: tuple[float, float], glyph: str) -> None:
        column = int(place[0] * across / CELL_SIZE)
        row = int((maze.height - place[1]) * down / CELL_SIZE)
        canvas[min(row, len(canvas) - 1)][min(column, len(canvas[0]) - 1)] = glyph

    if spec.block_size:
        fill(shapely.Polygon(spec.start_block.corners()), 0.0, glyphs.block)
    for part in Footprint.of(spec.robot).shapes(spec.start_pose):
        fill(part.geometry, part.margin, _ROBOT)
    if spec.block_size:
        put(spec.block_center, glyphs.block)
    directions = len(glyphs.arrows)
    arrow = glyphs.arrows[round(spec.bot_rot % 360 / (360 / directions)) % directions]
    put(spec.bot_center, arrow)
    edge = "+" + "-" * (across * maze.columns) + "+"
    legend = (
        *(f"{glyphs.wall} wall", f"{_ROBOT} robot ({arrow} heading)", f"{glyphs.block} block"),
        *(f"{kind.letter} {kind.label}" for kind in _MARKED.values()),
    )
    return [edge, *(f"|{''.join(line)}|" for line in canvas), edge, ", ".join(legend)]


def _point(place: tuple[float, float]) -> str:
    return f"({place[0]:g}, {place[1]:g})"


def _block(spec: SimulationSpec) -> str:
    if not spec.block_size:
        return "none"
    solid = "solid" if spec.block_solid else "not solid"
    return f"side {spec.block_size:g} in, centre {_point(spec.block_center)} in, {solid}"


def _outline(robot: RobotSpec) -> str:
    if robot.radius is not None:
        return f"circle, diameter {2 * robot.radius:g} in"
    xs, ys = [x for x, _ in robot.vertices], [y for _, y in robot.vertices]
    return f"polygon of {len(xs)} vertices, {max(xs) - min(xs):g} x {max(ys) - min(ys):g} in"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows in aligned columns, or a line that says there are none."""
    if not rows:
        return ["  none"]
    lines = [header, *rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    return [
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))
        for line in lines
    ]


def _sensor_row(sensor: SensorSpec) -> tuple[str, ...]:
    return (
        sensor.code,
        sensor.id,
        *(f"{each:g}" for each in (sensor.x, sensor.y, sensor.z, sensor.rotation, sensor.error)),
        "" if sensor.beam is None else f"{sensor.beam:g}",
        ", ".join(_sensor_notes(sensor)),
    )


def _sensor_notes(sensor: SensorSpec) -> list[str]:
    notes = [] if sensor.enabled else ["disabled"]
    return notes + [
        shown
        for column, shown, usual in values_of(sensor)
        if column.name not in _IN_TABLE and (column.needed or not usual)
    ]


def _devices(configuration: Configuration) -> list[str]:
    """The set's own device files: their kinds, their hashes, skipped checks and unfinished methods."""
    if not configuration.device_statuses:
        return []
    lines = ["", "Devices of its own"]
    for each in configuration.device_statuses:
        lines.append(f"  {each.path}: {', '.join(each.kinds) or 'no kinds'}, SHA-256 {each.sha256}")
        lines += [f"    {note}" for note in each.notes]
    return lines


def _drive_row(drive: DriveSpec, has_random_bias: bool) -> tuple[str, ...]:
    notes = [] if drive.enabled else ["disabled"]
    if drive.gain != 1:
        notes.append(f"gain {drive.gain:g}")
    for column in LESS_USUAL:
        value, unit = getattr(drive, column.field), column.unit
        if value:
            unit = f"{drive.kind.unit}/{column.per_time}" if column.per_time else unit
            notes.append(f"{column.shown} {value:g} {unit}".rstrip())
    return (
        drive.code,
        drive.kind.value,
        drive.kind.meaning,
        _axes(drive.error),
        "random" if has_random_bias else _axes(drive.bias),
        f"{drive.speed:g} {drive.kind.unit}/s",
        ", ".join(notes),
    )


def _gripper(gripper: GripperSpec | None) -> list[str]:
    if gripper is None:
        return []
    return [
        "",
        f"Gripper: {gripper.code}-1 closes, {gripper.code}-0 opens; it takes a block whose centre is within "
        f"{gripper.reach:g} in of the front and {gripper.width / 2:g} in to either side"
        f"{'' if gripper.enabled else ' (disabled)'}",
    ]


def _velocities(spec: SimulationSpec) -> list[str]:
    """Commands of continuous motion, as a program sends them."""
    shown = [velocity_shape(each, spec.wheels) for each in spec.velocities if each.enabled]
    if not shown:
        return []
    return ["", f"Continuous motion: {', '.join(each for each in shown if each)}; {WAIT}-S waits"]


def _axes(axes: Axes) -> str:
    return f"{axes.x:g}/{axes.y:g}/{axes.r:g}"


def _settings(configuration: Configuration) -> list[str]:
    settings = configuration.settings
    noise = "differ from run to run" if settings.randerror else f"repeat, seed {settings.seed}"
    bias = "not used"
    if settings.randbias:
        bias = f"drawn at start, strength {settings.strength[0]:g} and {settings.strength[1]:g}"
    profiles = filter(None, (settings.drive_profile, *settings.sensor_profile, settings.link_profile))
    return [
        *([f"Profiles: {', '.join(profiles)}."] if settings.uses_profiles else []),
        f"Random errors: {noise}. Random drive bias: {bias}.",
        f"Movement: {settings.num_segments} segments a command, pause after each {settings.step_time:g} s.",
        *_ports(settings),
    ]


def _ports(settings: Settings) -> list[str]:
    """A line for each served dialect, first the ones that every server has."""
    table = "server."
    names = (item.name for item in all_settings() if item.name.startswith(table))
    values = {name.removeprefix(table): value_of(settings, name) for name in names}
    served = sorted(dialects.served(settings.server.listeners), key=lambda each: bool(each.typed))
    return [each.summary.format_map(values) for each in served]


def _dialect(dialect: DialectRules | None) -> list[str]:
    """The messages that a team's robot knows."""
    if dialect is None:
        return []
    if dialect.protocol is not None:
        return ["", f"Messages of the dialect: the course's protocol {dialect.protocol.value}"]
    rows = [tuple(cut(cell) for cell in row) for row in dictionary(dialect)]
    turned = [tuple(cut(cell) for cell in row) for row in InverseRules(dialect).dictionary()]
    lines = ["", "Messages of the dialect", *_table(("message", "does", "replies, for example"), rows), ""]
    if not turned:
        return [
            *lines,
            'With --serial only its program drives the robot: no rule is a plain stop (do = "stop")',
        ]
    driven = _table(("command", "message"), turned)
    return [*lines, "Commands of console, keys and TCP programs for a real robot (--serial)", *driven]
