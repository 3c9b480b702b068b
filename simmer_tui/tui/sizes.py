"""Division of a terminal of any size among the panes: a box of cells for each, by name.

The maze grows first, then the sensors beside it, then a radar around the robot, then the events
below. Nothing here draws; the shell puts each widget into its box and hides those without one.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from msgspec import Struct

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.viewport import arrange, best_zoom

PAGES = ("maze", "sensors", "robot", "events")
"""Pages of a small screen, by F2 one after the other; the first shows all at once, in brief."""
# Half of the usual 80 x 24: a maze of 8 x 4 cells is just to be told apart.
SMALLEST_COLUMNS, SMALLEST_ROWS = 40, 12
# Code, direction, value of five, and a gauge of three.
BRIEF_SENSORS = 13
"""Least width of the sensors beside the maze."""
# A maze of 8 x 4 cells at 8 columns a cell, 36 columns of panels, and 9 rows below.
_FULL = (110, 30)
"""Least columns and rows at which panels stand beside the maze in full."""
# Eight cells of 3 columns, and the frame.
_LEAST_MAZE = 26
"""Columns that the maze keeps before it gives any to the sensors."""
# An event with its time and command, and 48 columns for what happened.
_LEAST_BELOW = 66
"""Columns of what stands under a narrow maze."""
_CONTROLS = 2
"""Rows of console or timeline at the bottom."""
# A heading and two events: fewer rows are better given to the sensors.
_LEAST_EVENTS = 3
# A heading and two lines.
_LEAST_PAGE = 3
"""Rows that a page keeps, whatever is said in passing."""
# Its outer ring is then ten columns from the middle: 3.6 in a column.
_RADAR = (40, 13)
"""Least columns and rows of the radar."""
# A heading and the six lines of a range sensor.
_FACTS_ROWS = 7


Panels = Sequence[tuple[str, int]]


class Box(NamedTuple):
    """Cells of the screen: the first column and row, and how many."""

    x: int
    y: int
    width: int
    height: int

    @property
    def bottom(self) -> int:
        return self.y + self.height


class Arrangement(Struct, frozen=True):
    """Boxes of the panes. `has_pages` is true where the first page cannot hold all there is to know."""

    boxes: Mapping[str, Box]
    has_pages: bool


def arrangement(
    maze: MazeSpec,
    width: int,
    height: int,
    *,
    sensors: int,
    panels: Panels,
    page: str = "maze",
    said: int = 0,
) -> Arrangement:
    """Panes of a terminal of `width` columns and `height` rows.

    Args:
        sensors: rows of the sensors.
        panels: name and rows of the other panels beside the maze.
        page: the page shown, on a small screen.
        said: rows of notifications. They stand over a maze; where there is none they get rows of their own.
    """
    if width < SMALLEST_COLUMNS or height < SMALLEST_ROWS:
        return Arrangement({"small": Box(0, 0, width, height)}, False)
    boxes = {"header": Box(0, 0, width, 1), "keys": Box(0, height - 1, width, 1)}
    if width >= _FULL[0] and height >= _FULL[1]:
        return Arrangement(boxes | _full(maze, width, height, sensors, panels), False)
    if page == "maze":
        return Arrangement(boxes | _brief(maze, width, height), True)
    rows = height - 2 - _CONTROLS
    said = max(min(said, rows - _LEAST_PAGE), 0)
    body = Box(0, 1 + said, width, rows - said)
    boxes |= {"console": Box(0, body.bottom, width, _CONTROLS)}
    if page == "robot":
        return Arrangement(boxes | _stacked(body, panels), True)
    return Arrangement(boxes | {page: body}, True)


def _fit(maze: MazeSpec, columns: int, rows: int) -> tuple[int, int]:
    """Cells that the maze and its frame take of those there are."""
    zoom = best_zoom(maze, columns, rows)
    wide, high = arrange(maze, zoom, columns, rows).virtual_size
    return max(min(wide, columns), 1), max(min(high, rows), 1)


def _brief(maze: MazeSpec, width: int, height: int) -> dict[str, Box]:
    """Everything at once, in brief: sensors beside the maze, one line each for the rest."""
    # From 13 columns at 80 to the 36 that full panels have at 120.
    beside = BRIEF_SENSORS + max(0, (width - 80) * 23 // 40)
    beside = 0 if width - beside - 1 < _LEAST_MAZE else beside
    room = width - beside - (1 if beside else 0)
    lines = 2 + _CONTROLS  # legend and pose
    columns, rows = _fit(maze, room, height - 2 - lines)
    boxes = {"maze": Box(0, 1, columns, rows)}
    below = 1 + rows
    if beside:
        at = min(columns + 1, width - beside)
        boxes["sensors"] = Box(at, 1, width - at, rows)
    boxes["legend"] = Box(0, below, width, 1)
    boxes["pose"] = Box(0, below + 1, width, 1)
    console = height - 1 - _CONTROLS
    spare = console - below - 2
    if spare >= _LEAST_EVENTS:
        boxes["events"] = Box(0, below + 2, width, spare)
    elif spare and beside:
        boxes["sensors"] = boxes["sensors"]._replace(height=rows + spare)
        boxes |= {name: boxes[name]._replace(y=boxes[name].y + spare) for name in ("legend", "pose")}
    boxes["console"] = Box(0, console, width, _CONTROLS)
    return boxes


def _full(maze: MazeSpec, width: int, height: int, sensors: int, panels: Panels) -> dict[str, Box]:
    """Panels beside the maze and below it."""
    # 36 columns hold a full row of a sensor; 51 at 200, the rest is the maze's.
    beside = min(36 + max(0, (width - 120) * 15 // 80), 60)
    # A third of the rows beyond 36, since the maze grows with its width as well.
    lower = max(8, 11 + (height - 36) // 3)
    columns, rows = _fit(maze, width - beside - 2, height - 3 - lower)
    left = max(columns, min(_LEAST_BELOW, width - beside - 2))
    boxes = {"maze": Box(0, 1, columns, rows), "legend": Box(0, 1 + rows, left, 1)}
    boxes |= _beside(Box(left + 1, 1, width - left - 2, height - 2), sensors, panels)
    top = 2 + rows
    return boxes | _below(Box(0, top, left, height - 1 - top))


def _beside(side: Box, sensors: int, panels: Panels) -> dict[str, Box]:
    """The column beside the maze: sensors, radar, robot, and how the run stands."""
    boxes = {}
    rest = side.height - min(sensors, side.height)
    at = side.y + min(sensors, side.height)
    boxes["sensors"] = Box(side.x, side.y, side.width, side.height - rest)
    wanted = sum(rows for _, rows in panels) + 1
    radar = min(rest - wanted, side.width // 2 + 1)
    if side.width >= _RADAR[0] and radar >= _RADAR[1]:
        boxes["radar"] = Box(side.x, at, side.width, radar)
        at, rest = at + radar, rest - radar
    return boxes | _stacked(Box(side.x, at, side.width, rest), panels)


def _stacked(room: Box, panels: Panels) -> dict[str, Box]:
    """Panels below one another, with a row between them where there is room for it."""
    boxes = {}
    at, rest = room.y, room.height
    gap = 1 if rest >= sum(rows + 1 for _, rows in panels) - 1 else 0
    for name, rows in panels:
        if rest >= min(rows, 3):
            boxes[name] = Box(room.x, at, room.width, min(rows, rest))
            at, rest = at + rows + gap, rest - rows - gap
    return boxes


def _below(low: Box) -> dict[str, Box]:
    """Boxes under the maze: events and console, side by side where there is room."""
    console = _CONTROLS + 1  # with a heading
    # 142 columns of 200 are divided as 86 and 54: an event's line is the longer one.
    if low.width >= 130 and low.height >= 12:
        left, top = low.width * 86 // 142, low.y + 1
        right = low.width - left - 2
        boxes = {
            "events": Box(0, top, left, low.bottom - top),
            "console-head": Box(left + 2, top, right, 1),
            "console": Box(left + 2, top + 1, right, _CONTROLS),
        }
        facts = top + console + 1
        if low.bottom - facts >= _FACTS_ROWS:
            boxes["facts"] = Box(left + 2, facts, right, low.bottom - facts)
        return boxes
    at = low.bottom - console
    return {
        "events": Box(0, low.y, low.width, at - low.y),
        "console-head": Box(0, at, low.width, 1),
        "console": Box(0, at + 1, low.width, _CONTROLS),
    }
