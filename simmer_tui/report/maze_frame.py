"""The maze as every picture has it: where it lies, its walls and zones, and the inches around it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from simmer_tui.document import svg
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.specs import CELL_SIZE, TILE_SIZE, WALL, MazeSpec

WIDTH = 960.0
"""Width of every picture, points."""
LEFT, TOP, RIGHT, AXIS = 34.0, 8.0, 14.0, 24.0
"""Room around the maze, points; `AXIS` is that of the numbers below."""
WALLS, TILES, PAPER = "#3c3c3c", "#ececec", "#ffffff"
LOADING, DROP = "#e8effb", "#dff3ea"
LOADING_LINE, DROP_LINE = "#5470a5", "#3f7a68"


class MazeFrame:
    """Draws in points; `at` takes inches in the global frame."""

    def __init__(self, maze: MazeSpec, *, largest_scale: float = 14.0, tallest: float = 760.0) -> None:
        """`largest_scale` is in points an inch, `tallest` in points."""
        self.maze = maze
        room = WIDTH - LEFT - RIGHT
        self.scale = min(room / maze.width, tallest / maze.height, largest_scale)
        self.left = LEFT + (room - maze.width * self.scale) / 2
        self.bottom = TOP + maze.height * self.scale

    @property
    def transform(self) -> str:
        """Transform from inches to points, for a group drawn in the global frame."""
        left, bottom, scale = map(svg.number, (self.left, self.bottom, self.scale))
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
        frame = self.outline(fill="none", stroke=WALLS, stroke_width=2.0)
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
            parts.append(
                svg.element(
                    "rect",
                    x=left,
                    y=top,
                    width=side,
                    height=side,
                    fill=fill,
                    fill_opacity=0.85,
                    stroke=line,
                    stroke_dasharray="2 3",
                )
            )
            if not order:
                parts.append(svg.text(left + 4, top + 13, name, 11.0, fill=line, font_weight="bold"))
        return "".join(parts)

    def _squares(self, grid: Sequence[Sequence[bool]], size: float, fill: str) -> str:
        """Without seams between rows."""
        boxes = "".join(self._runs(grid, size, fill))
        return svg.element("g", boxes, shape_rendering="crispEdges") if boxes else ""

    def _runs(self, grid: Sequence[Sequence[bool]], size: float, fill: str) -> list[str]:
        """Squares of a grid of `size` inches, the first row on top; neighbours in a row as one box: no
        seams, and less to write."""
        boxes = []
        side = size * self.scale
        for row, cells in enumerate(grid):
            begin = 0
            while begin < len(cells):
                end = begin
                while end < len(cells) and cells[end] == cells[begin]:
                    end += 1
                if cells[begin]:
                    boxes.append(
                        svg.element(
                            "rect",
                            x=self.left + begin * side,
                            y=TOP + row * side,
                            width=(end - begin) * side,
                            height=side,
                            fill=fill,
                        )
                    )
                begin = end
        return boxes

    def axes(self) -> str:
        """Inches along the left and below."""
        maze = self.maze
        step = int(CELL_SIZE) * max(1, math.ceil(maze.columns / 20))
        parts = [
            svg.text(self.at(inches, 0)[0], self.bottom + 14, f"{inches}", text_anchor="middle")
            for inches in range(0, int(maze.width) + 1, step)
        ]
        parts += [
            svg.text(self.left - 5, self.at(0, inches)[1] + 4, f"{inches}", text_anchor="end")
            for inches in range(0, int(maze.height) + 1, step)
        ]
        parts.append(svg.text(self.left - 16, self.bottom + 14, "in", text_anchor="end"))
        return svg.element("g", "".join(parts), fill=svg.FAINT)
