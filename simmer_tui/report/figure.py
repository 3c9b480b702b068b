"""The maze with the whole path coloured by time, and all that happened on it."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np

from simmer_tui.report import svg
from simmer_tui.report.run_statistics import SAME_PLACE, Piece, RunStatistics
from simmer_tui.sim.angles import rotation
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, TILE_SIZE, WALL, RobotSpec

WIDTH = 960.0
"""Width of every picture, points."""
_LEFT, _TOP, _RIGHT, _AXIS, _KEY = 34.0, 8.0, 14.0, 24.0, 44.0
_LARGEST_SCALE = 14.0
_TALLEST = 760.0
_NUMBERED = 30
_WALL, _TILE = "#3c3c3c", "#e6e6e6"


def maze_figure(run: RunStatistics) -> tuple[float, str]:
    """The height of the picture, and what is in it, `WIDTH` wide."""
    return _MazeFigure(run).draw()


class _MazeFigure:
    """Draws in points; `_at` takes inches in the global frame."""

    def __init__(self, run: RunStatistics) -> None:
        self.run = run
        self.spec = run.configuration.simulation
        maze = self.spec.maze
        room = WIDTH - _LEFT - _RIGHT
        self.scale = min(room / maze.width, _TALLEST / maze.height, _LARGEST_SCALE)
        self.left = _LEFT + (room - maze.width * self.scale) / 2
        self.bottom = _TOP + maze.height * self.scale
        # A robot that a wall held for the rest of the run would leave all else in one colour.
        self.pieces = [piece for piece in run.pieces.items if _extent(piece) >= SAME_PLACE]
        self.end = max((piece.end for piece in self.pieces), default=0.0)

    def draw(self) -> tuple[float, str]:
        parts = [
            self._floor(),
            self._walls(),
            self._block(),
            self._path(),
            self._jumps(),
            self._beliefs(),
            self._robot(self.run.header.pose, "#ffffff", "start"),
            self._robot(self.run.pose, "#bfe8c8", "end"),
            self._contacts(),
            self._axes(),
            self._key(),
        ]
        return self.bottom + _AXIS + _KEY, "".join(parts)

    def _at(self, x: float, y: float) -> tuple[float, float]:
        return self.left + x * self.scale, self.bottom - y * self.scale

    def _box(self, column: float, row: float, columns: float, size: float, fill: str) -> str:
        """A run of squares of a grid of `size` inches, row counted from the top."""
        side = size * self.scale
        return svg.element(
            "rect",
            x=self.left + column * side,
            y=_TOP + row * side,
            width=columns * side,
            height=side,
            fill=fill,
        )

    def _whole(self, **style: object) -> str:
        """The rectangle of the maze."""
        width, height = self.spec.maze.width * self.scale, self.spec.maze.height * self.scale
        return svg.element("rect", "", x=self.left, y=_TOP, width=width, height=height, **style)

    def _floor(self) -> str:
        tiles = Maze(self.spec.maze).tiles == 0
        return self._whole(fill="#ffffff") + "".join(self._runs(tiles.tolist(), TILE_SIZE, _TILE))

    def _walls(self) -> str:
        walls = [[cell == WALL for cell in row] for row in self.spec.maze.cells]
        frame = self._whole(fill="none", stroke=_WALL, stroke_width=2.0)
        return "".join(self._runs(walls, CELL_SIZE, _WALL)) + frame

    def _runs(self, grid: list[list[bool]], size: float, fill: str) -> list[str]:
        """Neighbours in a row as one box: no seams, and less to write."""
        boxes = []
        for row, cells in enumerate(grid):
            begin = 0
            while begin < len(cells):
                end = begin
                while end < len(cells) and cells[end] == cells[begin]:
                    end += 1
                if cells[begin]:
                    boxes.append(self._box(begin, row, end - begin, size, fill))
                begin = end
        return boxes

    def _polygon(self, corners: np.ndarray[tuple[int, int], np.dtype[np.float64]], **style: object) -> str:
        placed = [self._at(float(x), float(y)) for x, y in corners]
        return svg.element("polygon", "", points=svg.points(placed), **style)

    def _block(self) -> str:
        """The block where it ended; where it began, faintly, if that is elsewhere."""
        drawn = ""
        if not self.spec.block_size:
            return drawn
        half = self.spec.block_size / 2
        square = np.array(((half, half), (-half, half), (-half, -half), (half, -half)))
        begin, end = self.run.header.block, self.run.fold.at().block
        if math.hypot(begin.x - end.x, begin.y - end.y) > 0.01:
            corners = square @ rotation(begin.heading).T + (begin.x, begin.y)
            drawn = self._polygon(corners, fill="none", stroke="#a87800", stroke_dasharray="3 2")
        corners = square @ rotation(end.heading).T + (end.x, end.y)
        return drawn + self._polygon(corners, fill="#ffd200", stroke="#a87800")

    def _path(self) -> str:
        """The movements, those of one shade together."""
        by_shade: dict[int, list[str]] = defaultdict(list)
        for order, piece in enumerate(self.pieces):
            fraction = (piece.begin + piece.end) / 2 / self.end if self.end else order / len(self.pieces)
            line = svg.points(self._at(x, y) for x, y in piece.points)
            by_shade[round(fraction * svg.SHADES)].append(f"<polyline points='{line}'/>")
        return "".join(
            svg.element(
                "g",
                "".join(lines),
                fill="none",
                stroke=svg.shade(step / svg.SHADES),
                stroke_width=2.0,
                stroke_linecap="round",
                stroke_linejoin="round",
            )
            for step, lines in sorted(by_shade.items())
        )

    def _jumps(self) -> str:
        """Where a person put the robot elsewhere."""
        lines = []
        for jump in self.run.jumps.items:
            (x, y), (end_x, end_y) = self._at(jump.begin.x, jump.begin.y), self._at(jump.end.x, jump.end.y)
            lines.append(svg.element("line", x1=x, y1=y, x2=end_x, y2=end_y))
        return svg.element("g", "".join(lines), stroke=svg.FAINT, stroke_dasharray="1 4") if lines else ""

    def _beliefs(self) -> str:
        trace = self.run.belief_trace.items
        if not trace:
            return ""
        line = svg.points(self._at(point.believed.x, point.believed.y) for point in trace)
        drawn = svg.element(
            "polyline", points=line, fill="none", stroke=svg.BELIEF, stroke_width=1.1, stroke_dasharray="4 3"
        )
        window = svg.element("clipPath", self._whole(), id="maze")
        return window + svg.element("g", drawn, clip_path="url(#maze)")

    def _robot(self, pose: Pose, fill: str, word: str) -> str:
        x, y = self._at(pose.x, pose.y)
        nose = np.array((_front(self.spec.robot), 0.0)) @ rotation(pose.heading).T
        tip = self._at(pose.x + float(nose[0]), pose.y + float(nose[1]))
        style: dict[str, object] = {
            "fill": fill,
            "fill_opacity": 0.75,
            "stroke": "#006030",
            "stroke_width": 1.6,
        }
        if self.spec.robot.radius is not None:
            body = svg.element("circle", "", cx=x, cy=y, r=self.spec.robot.radius * self.scale, **style)
        else:
            corners = np.array(self.spec.robot.vertices) @ rotation(pose.heading).T + (pose.x, pose.y)
            body = self._polygon(corners, **style)
        mark = svg.element("line", x1=x, y1=y, x2=tip[0], y2=tip[1], stroke="#006030", stroke_width=1.6)
        return body + mark + _label(x, y + 4.0, word, "#004020")

    def _contacts(self) -> str:
        """A cross at every place touched, the first ones numbered in the order of time. Those of
        one place have one label: 3, 5-8."""
        crosses = []
        places: list[tuple[float, float, list[int]]] = []
        for order, bump in enumerate(self.run.bumps.items, 1):
            x, y = self._at(*bump.touch.point)
            crosses.append(f"<path d='M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8'/>")
            near = [place for place in places if math.dist((x, y), place[:2]) < 14]
            if near:
                near[0][2].append(order)
            elif order <= _NUMBERED:
                places.append((x, y, [order]))
        if not crosses:
            return ""
        drawn = svg.element("g", "".join(crosses), stroke="#ffffff", stroke_width=5.0)
        drawn += svg.element("g", "".join(crosses), stroke=svg.CONTACT, stroke_width=2.2)
        middle = self.left + self.spec.maze.width * self.scale / 2
        for x, y, orders in places:
            side, anchor = (8, "start") if x < middle else (-8, "end")
            words = _ranges([order for order in orders if order <= _NUMBERED])
            drawn += _label(x + side, y - 5 if y > _TOP + 16 else y + 15, words, svg.CONTACT, anchor)
        return drawn

    def _axes(self) -> str:
        maze = self.spec.maze
        step = CELL_SIZE * max(1, math.ceil(maze.columns / 20))
        parts = []
        for inches in np.arange(0.0, maze.width + 1, step).tolist():
            x = self._at(inches, 0)[0]
            parts.append(svg.text(x, self.bottom + 14, f"{inches:g}", text_anchor="middle"))
        for inches in np.arange(0.0, maze.height + 1, step).tolist():
            y = self._at(0, inches)[1]
            parts.append(svg.text(self.left - 5, y + 4, f"{inches:g}", text_anchor="end"))
        parts.append(svg.text(self.left - 16, self.bottom + 14, "in", text_anchor="end"))
        return svg.element("g", "".join(parts), fill=svg.FAINT)

    def _key(self) -> str:
        """The scale of time, and what the marks mean."""
        y = self.bottom + _AXIS + 8
        bar, steps = 260.0, 52
        parts = [
            svg.element(
                "rect", x=_LEFT + i * bar / steps, y=y, width=bar / steps + 0.4, height=9.0,
                fill=svg.shade(i / (steps - 1)),
            )
            for i in range(steps)
        ]  # fmt: skip
        parts.append(svg.text(_LEFT, y + 21, "0 s", fill=svg.FAINT))
        parts.append(svg.text(_LEFT + bar, y + 21, f"{self.end:.1f} s", text_anchor="end", fill=svg.FAINT))
        x = _LEFT + bar + 26
        marks = [
            (
                "path, coloured by time",
                f"<line x1='0' y1='0' x2='20' y2='0' stroke='{svg.shade(0.3)}' stroke-width='2'/>",
            )
        ]
        if self.run.contacts:
            cross = f"<path d='M6 -4l8 8m0 -8l-8 8' stroke='{svg.CONTACT}' stroke-width='2.2'/>"
            marks.append(("contact, numbered in order", cross))
        if self.run.belief_trace.items:
            dashes = f"stroke='{svg.BELIEF}' stroke-width='1.2' stroke-dasharray='4 3'"
            marks.append(("believed position", f"<line x1='0' y1='0' x2='20' y2='0' {dashes}/>"))
        if self.run.jumps.items:
            marks.append(
                ("put elsewhere", f"<line x1='0' x2='20' stroke='{svg.FAINT}' stroke-dasharray='1 4'/>")
            )
        for words, mark in marks:
            parts.append(svg.shifted(x, y + 5, mark) + svg.text(x + 26, y + 9, words))
            x += 50 + 5.6 * len(words)
        return "".join(parts)


def _extent(piece: Piece) -> float:
    """How far, inches, a movement gets from where it began."""
    return max(math.dist(piece.points[0], point) for point in piece.points)


def _front(robot: RobotSpec) -> float:
    """How far the robot reaches ahead of its centre."""
    return robot.radius if robot.radius is not None else max(x for x, _ in robot.vertices)


def _label(x: float, y: float, words: str, fill: str, anchor: str = "middle") -> str:
    """A word that stays readable on anything."""
    return svg.text(
        x, y, words, 11.0, fill=fill, text_anchor=anchor, font_weight="bold",
        paint_order="stroke", stroke="#ffffff", stroke_width=3.0,
    )  # fmt: skip


def _ranges(orders: list[int]) -> str:
    """3, 5-8: numbers in order, runs of them joined."""
    runs: list[list[int]] = []
    for order in orders:
        if runs and order == runs[-1][-1] + 1:
            runs[-1].append(order)
        else:
            runs.append([order])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
