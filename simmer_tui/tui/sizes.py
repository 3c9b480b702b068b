"""Division of a terminal of any size among the panes: a box of cells for each, by name.

The maze grows first, then the column beside it: the place for answers, sensors, a radar around the robot,
robot and mission. Events and console are below. Nothing here draws; the shell puts each widget into its box
and hides those without one.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from msgspec import Struct

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.viewport import arrange, best_zoom

PAGES = ("maze", "sensors", "robot", "events")
"""Pages of a small screen, in the order of the key F2; the first shows everything in brief."""
# Half of the usual 80 x 24: the cells of a maze of 8 x 4 are just visible.
SMALLEST_COLUMNS, SMALLEST_ROWS = 40, 12
# Code, direction, value of five, and a gauge of three columns.
BRIEF_SENSORS = 13
"""Least width of the sensors beside the maze."""
# A maze of 8 x 4 cells at 8 columns a cell, 36 columns of panels, and 9 rows below.
_FULL = (110, 30)
"""Least columns and rows for panels beside the maze with all their lines."""
# Eight cells of 3 columns, and the frame.
_LEAST_MAZE = 26
"""Columns that the maze keeps before the sensors get any."""
# An event with its time and command, and 48 columns for its result.
_LEAST_BELOW = 66
"""Columns of the part under a narrow maze."""
_CONTROLS = 2
"""Rows of console or timeline at the bottom."""
# A heading and two events: fewer rows are more useful for the sensors.
_LEAST_EVENTS = 3
# Its outer ring is then ten columns from the middle: 3.6 in a column.
_RADAR = (40, 13)
"""Least columns and rows of the radar."""
# A name of nine characters, its clock, busy share and LED.
_LEAST_BOARDS = 40
"""Columns of the panel with boards."""
# A heading, place, direction, reading and last values of a sensor.
_FACTS_ROWS = 5
# A heading and two lines of output: fewer say nothing.
_LEAST_PROGRAM = 3
# A heading and six lines of 36 columns: an error, the frames before it, and the possible actions.
ANSWER_ROWS = 7
"""Rows of the place for answers beside the maze."""
# The rows of legend and pose, which show nothing new while an answer is read, and the line below them.
BRIEF_ANSWER = 3
"""Rows of an answer on a small screen."""
# A heading and the first sensors, even beside a long answer.
_LEAST_SENSORS = 4

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
    """Boxes of the panes. `has_pages` is true if the first page cannot hold everything."""

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
    answer: int = 0,
) -> Arrangement:
    """Panes of a terminal of `width` columns and `height` rows.

    Args:
        sensors: rows of the sensors.
        panels: name and rows of the other panels beside the maze.
        page: the page shown, on a small screen.
        answer: rows that an answer wants; 0 without one. Beside the maze it has a place in any case.
    """
    if width < SMALLEST_COLUMNS or height < SMALLEST_ROWS:
        return Arrangement({"small": Box(0, 0, width, height)}, False)
    boxes = {"header": Box(0, 0, width, 1), "keys": Box(0, height - 1, width, 1)}
    if width >= _FULL[0] and height >= _FULL[1]:
        return Arrangement(boxes | _full(maze, width, height, sensors, panels, answer), False)
    if page == "maze":
        brief = _brief(maze, width, height, answer)
        return Arrangement(boxes | _with_boards(brief, sensors, dict(panels).get("boards", 0)), True)
    body = Box(0, 1, width, height - 2 - _CONTROLS)
    boxes |= {"console": Box(0, body.bottom, width, _CONTROLS)}
    if page == "robot":
        return Arrangement(boxes | _stacked(body, panels), True)
    return Arrangement(boxes | {page: body}, True)


def _fit(maze: MazeSpec, columns: int, rows: int) -> tuple[int, int]:
    """Cells that the maze and its frame take of the available ones."""
    zoom = best_zoom(maze, columns, rows)
    wide, high = arrange(maze, zoom, columns, rows).virtual_size
    return max(min(wide, columns), 1), max(min(high, rows), 1)


def _brief(maze: MazeSpec, width: int, height: int, answer: int) -> dict[str, Box]:
    """Everything at once, in brief: sensors beside the maze, one line each for the rest, or an answer in
    their place."""
    # From 13 columns at 80 to the 36 of panels with all their lines at 120.
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
    if answer:
        legend, pose, events = boxes.pop("legend"), boxes.pop("pose"), boxes.get("events")
        # The console's line above the typed text is the third row, unless there are events between.
        boxes["answer"] = Box(0, legend.y, width, legend.height + pose.height + (events is not None))
        if events is not None:
            boxes["events"] = events._replace(y=events.y + 1, height=events.height - 1)
    return boxes


def _with_boards(boxes: dict[str, Box], sensors: int, rows: int) -> dict[str, Box]:
    """The boxes of a small screen, with the boards in the rows that the sensors leave free."""
    beside = boxes.get("sensors")
    if not rows or beside is None or beside.width < _LEAST_BOARDS or beside.height - sensors < rows:
        return boxes
    sensed = beside._replace(height=beside.height - rows)
    return boxes | {"sensors": sensed, "boards": Box(beside.x, sensed.bottom, beside.width, rows)}


def _full(
    maze: MazeSpec, width: int, height: int, sensors: int, panels: Panels, answer: int
) -> dict[str, Box]:
    """Panels beside the maze and below it."""
    # 36 columns hold all parts of a sensor's row. At 200 columns they are 51; the rest is the maze's.
    beside = min(36 + max(0, (width - 120) * 15 // 80), 60)
    # A third of the rows beyond 36, since the maze grows with its width as well.
    lower = max(8, 11 + (height - 36) // 3)
    columns, rows = _fit(maze, width - beside - 2, height - 3 - lower)
    left = max(columns, min(_LEAST_BELOW, width - beside - 2))
    boxes = {"maze": Box(0, 1, columns, rows), "legend": Box(0, 1 + rows, left, 1)}
    room = width - left - 2
    # One column more does not help a panel; a gap of two beside the maze does.
    room = beside if room == beside + 1 else room
    boxes |= _beside(Box(width - room - 1, 1, room, height - 2), sensors, panels, answer)
    top = 2 + rows
    return boxes | _below(Box(0, top, left, height - 1 - top))


def _beside(side: Box, sensors: int, panels: Panels, answer: int) -> dict[str, Box]:
    """The column beside the maze: answers, sensors, radar, robot, and the state of the run."""
    wanted = sum(rows for _, rows in panels)
    # A longer answer than usual takes the gaps, then the radar's rows and those of the sensors.
    said = min(max(ANSWER_ROWS, answer), side.height - _LEAST_SENSORS)
    sensors = min(sensors, side.height - said)
    # A sketch reads its sensors by pins: its boards are worth more than rows of sensors without a value.
    if answer > ANSWER_ROWS or any(name == "boards" for name, _ in panels):
        sensors = max(min(sensors, side.height - said - wanted), _LEAST_SENSORS)
    rest = side.height - said - sensors
    gaps = min(max(rest - wanted, 0), 2)
    boxes = {"answer": Box(side.x, side.y, side.width, said)}
    at = side.y + said + (gaps > 0)
    boxes["sensors"] = Box(side.x, at, side.width, sensors)
    at += sensors + (gaps > 1)
    rest -= gaps
    # As wide as high, with a heading.
    radar = min(rest - wanted, side.width // 2 - 2)
    if side.width >= _RADAR[0] and radar >= _RADAR[1]:
        boxes["radar"] = Box(side.x, at, side.width, radar)
        # The radar has the remaining rows, without gaps below it.
        at, rest = at + radar, wanted
    return boxes | _stacked(Box(side.x, at, side.width, rest), panels)


def _stacked(room: Box, panels: Panels) -> dict[str, Box]:
    """Panels below one another, with a row between them if there is room. One without rows has no box."""
    boxes = {}
    panels = [(name, rows) for name, rows in panels if rows]
    at, rest = room.y, room.height
    gap = 1 if rest >= sum(rows + 1 for _, rows in panels) - 1 else 0
    for name, rows in panels:
        if rest >= min(rows, 3):  # a heading and two lines
            boxes[name] = Box(room.x, at, room.width, min(rows, rest))
            at, rest = at + rows + gap, rest - rows - gap
    return boxes


def _below(low: Box) -> dict[str, Box]:
    """Boxes under the maze: events and console, side by side if there is room."""
    console = _CONTROLS + 1  # with a heading
    # 142 columns of 200 are divided into 86 and 54: an event's line is the longer one.
    if low.width >= 130 and low.height >= 12:
        left, top = low.width * 86 // 142, low.y + 1
        right = low.width - left - 2
        boxes = {
            "events": Box(0, top, left, low.bottom - top),
            "console-head": Box(left + 2, top, right, 1),
            "console": Box(left + 2, top + 1, right, _CONTROLS),
        }
        facts = top + console + 2
        if low.bottom - facts >= _FACTS_ROWS:
            boxes["facts"] = Box(left + 3, facts, right - 1, _FACTS_ROWS)
        program = facts + _FACTS_ROWS + 1
        if low.bottom - program >= _LEAST_PROGRAM:
            boxes["program"] = Box(left + 3, program, right - 1, low.bottom - program)
        return boxes
    at = low.bottom - console
    return {
        "events": Box(0, low.y, low.width, at - low.y),
        "console-head": Box(0, at, low.width, 1),
        "console": Box(0, at + 1, low.width, _CONTROLS),
    }
