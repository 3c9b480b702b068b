"""The first screen of the help: the robot with its sensors, the signs of the picture, and the keys."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from rich.color import Color
from rich.style import Style
from rich.text import Text

from simmer_tui.config.keys import DRIVING
from simmer_tui.config.robot_drawing import movement_commands
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import ObservingSensor, World, modelled_sensor
from simmer_tui.sim.specs import CELL_SIZE, MazeSpec, SensorSpec, SimulationSpec
from simmer_tui.tui.key_table import ANYWHERE, IN_LOG, WITH_THE_MOUSE, KeyGroup
from simmer_tui.tui.maze.glyphs import Cells
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import DEFAULT, Role
from simmer_tui.tui.maze.scene import Scene, SensorView
from simmer_tui.tui.maze.viewport import Viewport
from simmer_tui.tui.sensor_readouts import direction_sign, kind_name
from simmer_tui.tui.strips import make_strips

_ROBOT = (32, 16)
"""Columns and rows of the robot's picture: one maze cell, three times as large as beside 120 columns."""
# A key, and the shortest sentences about it.
_COLUMN = 36
"""Least columns of a column of keys."""
_GAP = 2
_KEYS = {
    "drive": (*DRIVING, "stop", "poll"),
    "run": ("reset", "pause", "step", "slower", "faster", "full_speed"),
}
"""Settings of keys by the group that they are shown in; the others are of the picture."""

_MORE = re.compile(r"; | \(")
"""Ends of the first sentence of a text."""

Lines = list[Text]


class HelpPage:
    """Makes the screen for one robot and one kind of terminal."""

    def __init__(self, keys: Sequence[tuple[str, str, str]], spec: SimulationSpec, painter: Painter) -> None:
        """`keys` are settings of keys: name, keys, meaning."""
        self._keys, self._spec, self._painter = keys, spec, painter
        self._plain = not painter.signs.has_blocks

    def text(self, width: int) -> Text:
        """All of it, in columns; on a narrow screen the robot comes first."""
        robot = self._heading("robot, from above, front up", _ROBOT[0])
        robot += robot_rows(self._spec, self._painter)
        columns = max((width + _GAP) // (_COLUMN + _GAP), 1)
        wide = (width + _GAP) // columns - _GAP
        keys = list(self._keys_by_group(wide))
        if columns < 3:
            beside = width - _ROBOT[0] - _GAP
            rows = side_by_side([robot, self._codes(beside)], [_ROBOT[0], beside])
            rows += [Text(), *self._signs(width), Text()]
            rows += side_by_side(divided(keys, columns), [wide] * columns)
        else:
            # Two columns of codes with the longest words, "time of flight".
            left = wide + 2 * _GAP
            wide = (width - left - (columns - 1) * _GAP) // (columns - 1)
            keys = list(self._keys_by_group(wide))
            first = [*robot, Text(), *self._codes(left)]
            others = divided([*keys, self._signs(wide)], columns - 1)
            rows = side_by_side([first, *others], [left, *[wide] * (columns - 1)])
        return Text("\n").join(rows)

    # -- parts -----------------------------------------------------------------------------------

    def _style(self, role: Role, *, bold: bool = False) -> Style:
        return style_of(self._painter, role, bold=bold)

    def _heading(self, title: str, width: int) -> Lines:
        rule = ("-" if self._plain else "─") * max(width - len(title) - 1, 0)
        line = Text(title, self._style(Role.ACCENT, bold=True))
        return [line.append(f" {rule}", self._style(Role.GRID))]

    def _row(self, left: str, right: str, width: int, column: int) -> Text:
        """A row of two columns: the first sentence, as far as there is room. All of it is further down."""
        row = Text(left.ljust(column) if len(left) < column else f"{left} ", self._style(Role.ACCENT))
        row.append(_MORE.split(right)[0], self._style(Role.TEXT))
        row.truncate(width, overflow="crop" if self._plain else "ellipsis")
        return row

    def _in_columns(self, lines: Lines, width: int, least: int) -> Lines:
        """Lines in as many columns of at least a width as there is room for."""
        count = max((width + _GAP) // (least + _GAP), 1)
        half = (width + _GAP) // count - _GAP
        return side_by_side(divided([[line] for line in lines], count), [half] * count)

    def _codes(self, width: int) -> Lines:
        """Sensors, in the words of the sensor panel, and drives."""
        used = [sensor for sensor in self._spec.sensors if sensor.enabled]
        room = 5 if self._plain else 4
        codes = [f"{sensor.code}{direction_sign(sensor, plain=self._plain)}" for sensor in used]
        words = map(sensor_words, used)
        rows = [self._row(code, word, width, room) for code, word in zip(codes, words, strict=True)]
        drives = [self._row(command, meaning, width, 7) for command, meaning in movement_commands(self._spec)]
        shown = self._in_columns(rows, width, 17)
        return [*self._heading("codes", width), *shown, *drives]

    def _signs(self, width: int) -> Lines:
        """The signs of the picture."""
        signs, plain = self._painter.signs, self._plain

        def line(role: Role) -> str:
            return "⠒⠂" if signs.dotted else chr(signs.line(role))

        marks = (
            (signs.arrows[0], Role.BELIEF, "belief"),
            ("⠢⠔" if signs.dotted else "??", Role.BELIEF, "its spread"),
            (line(Role.TRAIL), Role.TRAIL_NEW, "last 10 s"),
            (line(Role.TRAIL), Role.TRAIL, "trail"),
            (line(Role.RAY_STRONG), Role.RAY_STRONG, "read last"),
            (line(Role.RAY_WEAK), Role.RAY_WEAK, "read before"),
            ("BB" if plain else "■", Role.BLOCK, "block"),
            ("X", Role.CONTACT, "last contact"),
            ("x" if plain else "×", Role.CONTACT, "earlier ones"),
            (2 * signs.heats[2], Role.HEAT_DOTS, "most likely"),
            (2 * signs.heats[0], Role.HEAT_DOTS, "possible"),
        )
        text = self._style(Role.TEXT)
        lines = [Text(f"{sign:<3}", self._style(role)).append(word, text) for sign, role, word in marks]
        return [*self._heading("signs", width), *self._in_columns(lines, width, 15)]

    def _keys_by_group(self, width: int) -> Iterator[Lines]:
        """Groups of keys, each with its heading."""
        grouped = {name for names in _KEYS.values() for name in names}
        rest = tuple(name for name, _, _ in self._keys if name not in grouped)
        for title, names in (*_KEYS.items(), ("picture", rest)):
            rows = [self._row(keys, text, width, 12) for name, keys, text in self._keys if name in names]
            note = "drive; finer with Shift" if title == "drive" else title
            yield [*self._heading(note, width), *rows]
        groups: tuple[tuple[str, Sequence[KeyGroup]], ...] = (
            ("anywhere", ANYWHERE), ("mouse", WITH_THE_MOUSE), ("events", IN_LOG),
        )  # fmt: skip
        for title, of_group in groups:
            rows = [self._row(each.shown, each.help, width, 12) for each in of_group if each.shown]
            yield [*self._heading(title, width), *rows]


def sensor_words(sensor: SensorSpec) -> str:
    """Words for a sensor, those of the sensor panel."""
    return kind_name(sensor.kind).removesuffix(" sensor")


def style_of(painter: Painter, role: Role, *, bold: bool = False) -> Style:
    """Style of a role; without colours only its weight."""
    packed = painter.palette[role]
    if packed == DEFAULT:
        return Style(bold=bold or None)
    return Style(color=Color.from_rgb(packed >> 16, packed >> 8 & 255, packed & 255), bold=bold or None)


def side_by_side(columns: Sequence[Lines], widths: Sequence[int]) -> Lines:
    """Columns of lines beside each other."""
    rows = []
    for number in range(max(map(len, columns))):
        row = Text()
        for lines, width in zip(columns, widths, strict=True):
            part = lines[number].copy() if number < len(lines) else Text()
            part.truncate(width, pad=True)
            row.append_text(part).append(" " * (_GAP if lines is not columns[-1] else 0))
        rows.append(row)
    return rows


def divided(groups: Sequence[Lines], columns: int) -> list[Lines]:
    """Groups of lines in columns of about the same height, in order; a blank line between groups of more
    than one line."""
    wanted = math.ceil(sum(len(group) + (len(group) > 1) for group in groups) / columns)
    shown: list[Lines] = [[]]
    for group in groups:
        gap = [Text()] if shown[-1] and len(group) > 1 else []
        if shown[-1] and len(shown) < columns and len(shown[-1]) + len(group) / 2 > wanted:
            shown.append([])
            gap = []
        shown[-1] += [*gap, *group]
    return shown + [[] for _ in range(columns - len(shown))]


# -- the robot -------------------------------------------------------------------------------------


def robot_rows(spec: SimulationSpec, painter: Painter) -> Lines:
    """Picture of the robot with its rays and the codes of its sensors."""
    cells = robot_cells(spec, painter)
    default = style_of(painter, Role.TEXT)
    strips = make_strips(cells, range(cells.shape[0]), default)
    return [Text.assemble(*((text, style or default) for text, style, _ in strip)) for strip in strips]


def robot_cells(spec: SimulationSpec, painter: Painter) -> Cells:
    """The robot in the middle of a maze cell, front up, as the painter of the maze draws it, with the rays of
    its sensors to the walls around it, and a code at the place of each other sensor."""
    columns, rows = _ROBOT
    size = MazeSpec(((1,),))
    maze, pose = Maze(size), Pose(CELL_SIZE / 2, CELL_SIZE / 2, 90.0)
    world = World(maze, Block(-100.0, -100.0, 0.0, 0.0))
    views = []
    for sensor in spec.sensors:
        model = modelled_sensor(sensor)
        looks = sensor.enabled and sensor.kind.is_range and not sensor.kind.is_scan
        view = model.observe(world, pose)[1] if looks and isinstance(model, ObservingSensor) else None
        views += [SensorView(view, sensor.code)] if view is not None else []
    floor = np.ones((4, 4), dtype=np.uint8)
    scene = Scene(maze=size, floor=floor, robot=spec.robot, pose=pose, views=tuple(views))
    viewport = Viewport(float(columns), 0, 0, columns, rows, CELL_SIZE)
    cells = painter.cells(scene, viewport)
    _write_codes(cells, spec, painter, viewport, pose)
    return cells


def _write_codes(
    cells: Cells, spec: SimulationSpec, painter: Painter, viewport: Viewport, pose: Pose
) -> None:
    """Write the code of each sensor that has none yet, as near to its place as there is room."""
    text = "\n".join(cells.text(row) for row in range(cells.shape[0]))
    taken = np.isin(cells.characters, [ord(each) for each in "abcdefghijklmnopqrstuvwxyz0123456789"])
    palette, rows, columns = painter.palette, *cells.shape
    for sensor in spec.sensors:
        if not sensor.enabled or sensor.code in text or not sensor.kind.has("x"):
            continue
        # Front up: x is up, y is to the left.
        x, y = viewport.place(pose.x - sensor.y, pose.y + sensor.x)
        middle = min(max(round(y / 2 - 0.5), 0), rows - 1), round(x - len(sensor.code) / 2)
        across = (0, 3, -3, 6, -6)
        places = [(middle[0] + down, middle[1] + right) for down in (0, 1, -1, 2, -2) for right in across]
        for row, column in sorted(places, key=partial(_apart, middle)):
            room = slice(column, column + len(sensor.code))
            inside = 0 <= row < rows and 0 <= column <= columns - len(sensor.code)
            if not inside or taken[row, max(column - 1, 0) : room.stop + 1].any():
                continue
            on_body = bool((cells.background[row, room] == palette[Role.ROBOT]).all()) and not palette.is_mono
            role = Role.HEADING if on_body else Role.TEXT
            if not on_body and not palette.is_mono:
                cells.background[row, room] = palette[Role.BLACK_TILE]
            cells.write(row, column, sensor.code, palette[role])
            taken[row, room] = True
            break


def _apart(one: tuple[int, int], other: tuple[int, int]) -> float:
    """Distance of two cells, (row, column), in columns: a row is as high as two."""
    return math.hypot(2 * (one[0] - other[0]), one[1] - other[1])
