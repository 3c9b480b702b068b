"""The picture of the maze, with the whole path in it, coloured by time, and marks for events."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import groupby

from simmer_tui.config.mission_plan import cells_of
from simmer_tui.document import svg
from simmer_tui.document.model import Figure, LegendMark
from simmer_tui.document.svg import PICTURE_WIDTH
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.attempt import Task
from simmer_tui.run.paths import PathSegment
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, TILE_SIZE, WALL, MazeSpec

LEFT, TOP, RIGHT, AXIS = 34.0, 8.0, 14.0, 24.0
"""Room around the maze, points; `AXIS` is that of the numbers below."""
# A page gives texts a size that does not scale with the picture, so places are told by an edge.
FROM_THE_TOP, AT_THE_MIDDLE = "text-before-edge", "central"
"""`dominant-baseline` of texts whose upper edge, or middle, is at their place."""
WALLS, TILES, PAPER = "#3c3c3c", "#ececec", "#ffffff"
LOADING, DROP = "#e8effb", "#dff3ea"
LOADING_LINE, DROP_LINE = "#5470a5", "#3f7a68"
# At 14 points an inch, the largest scale, it is one and a half points: as wide as a line.
_STANDING = 0.1
"""A movement that went no farther, inches, cannot be seen."""


class MazeFrame:
    """Draws in points; `at` takes inches in the global frame."""

    def __init__(self, maze: MazeSpec, *, largest_scale: float = 14.0, tallest: float = 760.0) -> None:
        """`largest_scale` is in points an inch, `tallest` in points."""
        self.maze = maze
        room = PICTURE_WIDTH - LEFT - RIGHT
        self.scale = min(room / maze.width, tallest / maze.height, largest_scale)
        self.left = LEFT + (room - maze.width * self.scale) / 2
        self.bottom = TOP + maze.height * self.scale

    @property
    def transform(self) -> str:
        """Transform from inches to points, for a group drawn in the global frame."""
        left, bottom, scale = map(svg.coordinate, (self.left, self.bottom, self.scale))
        return f"translate({left} {bottom}) scale({scale} -{scale})"

    def at(self, x: float, y: float) -> tuple[float, float]:
        return self.left + x * self.scale, self.bottom - y * self.scale

    def outline(self, **style: object) -> str:
        """The rectangle of the maze."""
        width, height = self.maze.width * self.scale, self.maze.height * self.scale
        return svg.element("rect", "", x=self.left, y=TOP, width=width, height=height, **style)

    def floor(self) -> str:
        """White, with its black tiles in grey."""
        black = (Maze(self.maze).tiles == 0).tolist()
        return self.outline(fill=PAPER) + self._squares(black, TILE_SIZE, TILES)

    def walls(self) -> str:
        frame = self.outline(fill="none", stroke=WALLS, stroke_width=2.0, class_="frame")
        return self.cells(WALL, WALLS) + frame

    def cells(self, value: int, fill: str) -> str:
        """All cells of one value."""
        grid = [[cell == value for cell in row] for row in self.maze.cells]
        return self._squares(grid, CELL_SIZE, fill)

    def zone(self, cells: Iterable[tuple[float, float]], name: str, fill: str, line: str) -> str:
        """Cells by their middles, tinted and outlined, the first one with its name."""
        parts = []
        side = CELL_SIZE * self.scale
        for order, (x, y) in enumerate(cells):
            left, top = self.at(x - CELL_SIZE / 2, y + CELL_SIZE / 2)
            square = {"x": left, "y": top, "width": side, "height": side}
            look = {"fill": fill, "fill_opacity": 0.85, "stroke": line, "stroke_dasharray": "2 3"}
            parts.append(svg.element("rect", **square, **look))
            if not order:
                look = {"fill": line, "font_weight": "bold", "dominant_baseline": FROM_THE_TOP}
                parts.append(svg.text(left + 4, top + 4, name, 11.0, **look))
        return "".join(parts)

    def zones(self, task: Task | None) -> str:
        """The zones of a mission: of the block at first, and of its delivery."""
        if task is None or task.zone is None:
            return ""
        loading = [(cell.x, cell.y) for cell in cells_of(self.maze, BLOCK)]
        # One word each: they have room in a cell on a phone.
        drawn = self.zone(loading, "LOAD", LOADING, LOADING_LINE)
        return drawn + self.zone([(task.zone.x, task.zone.y)], "DROP", DROP, DROP_LINE)

    def live(self) -> str:
        """An empty group, drawn in inches of the global frame, for the moving parts of a player."""
        return svg.element("g", class_="live", transform=self.transform)

    def _squares(self, grid: Sequence[Sequence[bool]], size: float, fill: str) -> str:
        """Squares of a grid of `size` inches, the first row on top; neighbours in a row as one box: no
        seams, and less to write."""
        boxes = ""
        side = size * self.scale
        for row, cells in enumerate(grid):
            for is_filled, run in groupby(range(len(cells)), cells.__getitem__):
                columns = list(run)
                if is_filled:
                    corner = {"x": self.left + columns[0] * side, "y": TOP + row * side}
                    width = len(columns) * side
                    boxes += svg.element("rect", **corner, width=width, height=side, fill=fill)
        # Without seams between rows, too.
        return svg.element("g", boxes, shape_rendering="crispEdges") if boxes else ""

    def axes(self) -> str:
        """Inches along the left and below."""
        maze = self.maze
        # At most about twenty numbers: more would run into each other.
        step = int(CELL_SIZE) * max(1, math.ceil(maze.columns / 20))
        parts = [
            svg.text(
                self.at(inches, 0)[0],
                self.bottom + 4,
                f"{inches}",
                text_anchor="middle",
                dominant_baseline=FROM_THE_TOP,
            )
            for inches in range(0, int(maze.width) + 1, step)
        ]
        parts += [
            svg.text(
                self.left - 5,
                self.at(0, inches)[1],
                f"{inches}",
                text_anchor="end",
                dominant_baseline=AT_THE_MIDDLE,
            )
            for inches in range(0, int(maze.height) + 1, step)
        ]
        parts.append(
            svg.text(self.left - 22, self.bottom + 4, "in", text_anchor="end", dominant_baseline=FROM_THE_TOP)
        )
        return svg.element("g", "".join(parts), fill=svg.FAINT)


# Width of the scale of time, points, and its steps.
_SCALE, _STEPS = 80.0, 40
# Contacts that have a number; crosses mark the others.
_NUMBERED = 30


def live_figure(maze: MazeSpec, task: Task | None) -> Figure:
    """The maze of a run that has just begun, for a player."""
    frame = MazeFrame(maze)
    parts = (frame.floor(), frame.zones(task), frame.walls(), frame.live(), frame.axes())
    return Figure("The maze and the robot", PICTURE_WIDTH, frame.bottom + AXIS, "".join(parts), "maze")


def maze_figure(run: RunStatistics) -> Figure:
    """The maze and the path. An empty group of the class `live`, drawn in inches of the global frame, is for
    the moving parts of a player, which hides the group `way`."""
    return _MazeFigure(run).draw()


class _MazeFigure:
    """Draws in points; `_at` takes inches in the global frame."""

    def __init__(self, run: RunStatistics) -> None:
        self.run = run
        self.spec = run.configuration.simulation
        self.frame = MazeFrame(self.spec.maze)
        self._at = self.frame.at
        # A robot that a wall held for the rest of the run would leave all else in one colour.
        self.pieces = [piece for piece in run.paths.segments if _extent(piece) >= _STANDING]
        self.end = path_end(run)

    def draw(self) -> Figure:
        start, end = (
            self._robot(self.run.header.pose, "#ffffff", "start"),
            self._robot(self.run.pose, svg.BODY, "end"),
        )
        way = (self._block(), self._path(), self._jumps(), self._beliefs(), start, end)
        frame = self.frame
        parts = (
            frame.floor(),
            frame.zones(self.run.task),
            frame.walls(),
            svg.element("g", "".join(way), class_="way"),
            frame.live(),
            svg.element("g", self._contacts(), class_="contacts"),
            frame.axes(),
        )
        height = frame.bottom + AXIS
        return Figure("The maze and the path", PICTURE_WIDTH, height, "".join(parts), "maze", self._legend())

    def _polygon(self, corners: FloatArray, **style: object) -> str:
        placed = svg.points(self._at(x, y) for x, y in corners.tolist())
        return svg.element("polygon", "", points=placed, **style)

    def _block(self) -> str:
        """The block where it ended; where it began, faintly, if that is elsewhere."""
        drawn = ""
        if not self.spec.block_size:
            return drawn
        begin, end = self.run.header.block, self.run.reducer.at().block
        # A hundredth of an inch is below a point in the picture.
        if math.hypot(begin.x - end.x, begin.y - end.y) > 0.01:
            look = {"fill": "none", "stroke": svg.BLOCK_LINE, "stroke_dasharray": "3 2"}
            corners = Block(begin.x, begin.y, self.spec.block_size, begin.heading).corners()
            drawn = self._polygon(corners, **look)
        return drawn + self._polygon(end.corners(), fill=svg.BLOCK_FILL, stroke=svg.BLOCK_LINE)

    def _path(self) -> str:
        """The movements, those of one shade together."""
        by_shade: dict[int, list[str]] = defaultdict(list)
        for order, piece in enumerate(self.pieces):
            fraction = (piece.begin + piece.end) / 2 / self.end if self.end else order / len(self.pieces)
            line = svg.points(self._at(x, y) for x, y in piece.points)
            by_shade[round(fraction * svg.SHADES)].append(f"<polyline points='{line}'/>")
        drawn, ends = "", {"stroke_linecap": "round", "stroke_linejoin": "round"}
        for step, lines in sorted(by_shade.items()):
            look = {"fill": "none", "stroke": svg.shade(step / svg.SHADES), "stroke_width": 2.4, **ends}
            drawn += svg.element("g", "".join(lines), **look)
        return svg.element("g", drawn, class_="ramp fixed")

    def _jumps(self) -> str:
        """Lines along which a person moved the robot."""
        lines = []
        for jump in self.run.paths.jumps.items:
            (x, y), (end_x, end_y) = self._at(jump.begin.x, jump.begin.y), self._at(jump.end.x, jump.end.y)
            lines.append(svg.element("line", x1=x, y1=y, x2=end_x, y2=end_y))
        return svg.element("g", "".join(lines), stroke=svg.FAINT, stroke_dasharray="1 4") if lines else ""

    def _beliefs(self) -> str:
        trace = self.run.totals.belief_trace.items
        if not trace:
            return ""
        line = svg.points(self._at(point.believed.x, point.believed.y) for point in trace)
        look = {"fill": "none", "stroke": svg.BELIEF, "stroke_width": 1.1, "stroke_dasharray": "4 3"}
        drawn = svg.element("polyline", points=line, **look)
        window = svg.element("clipPath", self.frame.outline(), id="maze")
        return window + svg.element("g", drawn, clip_path="url(#maze)")

    def _robot(self, pose: Pose, fill: str, word: str) -> str:
        x, y = self._at(pose.x, pose.y)
        footprint = Footprint.of(self.spec.robot)
        tip = self._at(*pose.place(footprint.front, 0.0))
        style = {"fill": fill, "fill_opacity": 0.75, "stroke": svg.ROBOT_LINE, "stroke_width": 1.6}
        body = "".join(self._polygon(corners, **style) for corners in footprint.placed(pose))
        if footprint.radius:
            body = svg.element("circle", "", cx=x, cy=y, r=footprint.radius * self.frame.scale, **style)
        mark = svg.element("line", x1=x, y1=y, x2=tip[0], y2=tip[1], stroke=svg.ROBOT_LINE, stroke_width=1.6)
        return body + mark + _label(x, y, word, svg.ROBOT_LINE, dominant_baseline=AT_THE_MIDDLE)

    def _contacts(self) -> str:
        """A cross at every place touched, the first ones numbered in the order of time. Those of
        one place have one label: 3, 5-8."""
        crosses = []
        places: list[tuple[float, float, list[int]]] = []
        for order, each in enumerate(self.run.history.repeated.first.items, 1):
            contact = each.first
            x, y = self._at(*contact.point)
            words = svg.tooltip(f"contact {order} at {contact.elapsed:.2f} s: {contact.shown}")
            crosses.append(f"<path d='M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8'>{words}</path>")
            near = [place for place in places if math.dist((x, y), place[:2]) < 14]
            if near:
                near[0][2].append(order)
            elif order <= _NUMBERED:
                places.append((x, y, [order]))
        if not crosses:
            return ""
        drawn = svg.element("g", "".join(crosses), stroke="#ffffff", stroke_width=5.0)
        drawn += svg.element("g", "".join(crosses), stroke=svg.CONTACT, stroke_width=2.2)
        middle = self._at(self.spec.maze.width / 2, 0.0)[0]
        for x, y, orders in places:
            side, anchor = (8, "start") if x < middle else (-8, "end")
            words = _ranges([order for order in orders if order <= _NUMBERED])
            below = {"dominant_baseline": FROM_THE_TOP} if y <= TOP + 16 else {}
            drawn += _label(x + side, y - 5 if not below else y + 4, words, svg.CONTACT, anchor, **below)
        return drawn

    def _legend(self) -> tuple[LegendMark, ...]:
        """The scale of time, and the marks."""
        size = {"y": -4.5, "width": _SCALE / _STEPS + 0.4, "height": 9.0}
        scale = "".join(
            svg.element("rect", x=step * _SCALE / _STEPS, fill=svg.shade(step / (_STEPS - 1)), **size)
            for step in range(_STEPS)
        )
        ramp = svg.element("g", scale, class_="ramp fixed")
        marks = [LegendMark(f"path, coloured by time from 0 to {self.end:.1f} s", ramp, _SCALE)]
        if self.run.totals.contacts:
            marks.append(LegendMark("contact, numbered in order", svg.cross(svg.CONTACT)))
        if self.run.totals.belief_trace.items:
            dashed = svg.dash(svg.BELIEF, 1.2, stroke_dasharray="4 3")
            marks.append(LegendMark("believed position", dashed))
        if self.run.paths.jumps.items:
            marks.append(LegendMark("put elsewhere", svg.dash(svg.FAINT, 1.0, stroke_dasharray="1 4")))
        return tuple(marks)


def path_end(run: RunStatistics) -> float:
    """Time at which the colours of a path end: that of the last movement that can be seen, seconds."""
    return max((piece.end for piece in run.paths.segments if _extent(piece) >= _STANDING), default=0.0)


def _extent(piece: PathSegment) -> float:
    """Largest distance of a movement from its start, inches."""
    return max(math.dist(piece.points[0], point) for point in piece.points)


def _label(x: float, y: float, words: str, fill: str, anchor: str = "middle", **look: object) -> str:
    """A word that stays readable on anything."""
    behind = {"paint_order": "stroke", "stroke": "#ffffff", "stroke_width": 3.0}
    return svg.text(x, y, words, 11.0, fill=fill, text_anchor=anchor, font_weight="bold", **behind, **look)


def _ranges(orders: list[int]) -> str:
    """3, 5-8: numbers in order, runs of them joined."""
    # Within a run, the numbers grow as their places do.
    grouped = groupby(enumerate(orders), lambda each: each[1] - each[0])
    runs = [[order for _, order in run] for _, run in grouped]
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
