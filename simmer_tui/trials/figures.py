"""Pictures of a set of trials: the maze with where runs failed, and how times are spread."""

from __future__ import annotations

import math
from collections.abc import Sequence

from simmer_tui.report import svg
from simmer_tui.report.markup import escape
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, START, WALL, MazeSpec
from simmer_tui.trials.intervals import counted, histogram
from simmer_tui.trials.record import TrialResult
from simmer_tui.trials.story import color_of, counted_causes
from simmer_tui.trials.trials_summary import start_cell

WIDTH = 960.0
"""Width of every picture, points."""
_LEFT, _TOP, _RIGHT, _AXIS, _KEY = 34.0, 8.0, 14.0, 24.0, 26.0
_LARGEST_SCALE, _TALLEST = 10.0, 700.0
_WALL, _START, _BLOCK = "#3c3c3c", "#e8f0ff", "#fff3c4"
_SUCCESS, _FAILURE = "#0a968c", "#f5a500"
_BAR_HEIGHT = 130.0


def map_figure(maze: MazeSpec, results: Sequence[TrialResult]) -> tuple[float, str]:
    """The height of the picture, and what is in it, `WIDTH` wide: walls, where contacts happened,
    where failed runs ended, and at every start cell how many of its runs succeeded."""
    room = WIDTH - _LEFT - _RIGHT
    scale = min(room / maze.width, _TALLEST / maze.height, _LARGEST_SCALE)
    left, bottom = _LEFT + (room - maze.width * scale) / 2, _TOP + maze.height * scale

    def at(x: float, y: float) -> tuple[float, float]:
        return left + x * scale, bottom - y * scale

    parts = [_cells(maze, left, scale)]
    parts += [_fraction(*at(*cell), group, scale) for cell, group in _by_start(results).items()]
    causes = counted_causes(results)
    parts += [
        svg.element(
            "g",
            "".join(_end(*at(*result.end[:2]), result) for result in group),
            fill=color_of(name),
            fill_opacity=0.7,
            stroke="#222222",
            stroke_width=0.8,
        )
        for name, group in causes
    ]
    crosses = "".join(
        f"<path d='M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8'/>"
        for x, y in (at(*point) for result in results for point in result.contact_points)
    )
    parts.append(svg.element("g", crosses, stroke=svg.CONTACT, stroke_width=1.8, stroke_opacity=0.7))
    parts.append(_axes(maze, left, bottom, scale))
    height = bottom + _AXIS
    parts.append(_key(height + 8))
    if causes:
        height += _KEY
        parts.append(_causes_key(height + 8, [(name, len(group)) for name, group in causes]))
    return height + _KEY, "".join(parts)


def _end(x: float, y: float, result: TrialResult) -> str:
    """Where a failed run ended, with why in a tooltip."""
    why = f"run {result.number}: {result.why or result.reason}"
    return svg.element("circle", svg.element("title", escape(why)), cx=x, cy=y, r=5.0)


def _causes_key(y: float, causes: Sequence[tuple[str, int]]) -> str:
    """The colours of the causes; those that find no room stand in the table."""
    parts, x = [], _LEFT
    for name, count in causes:
        words = f"{name} {count}"
        if x + 40 + 5.6 * len(words) > WIDTH:
            break
        mark = svg.element("circle", cx=10.0, r=5.0, fill=color_of(name), stroke="#222222")
        parts.append(svg.shifted(x, y + 5, mark) + svg.text(x + 22, y + 9, escape(words)))
        x += 40 + 5.6 * len(words)
    return "".join(parts)


def _cells(maze: MazeSpec, left: float, scale: float) -> str:
    fills = {WALL: _WALL, START: _START, BLOCK: _BLOCK}
    side = CELL_SIZE * scale
    boxes = [
        svg.element(
            "rect",
            x=left + column * side,
            y=_TOP + row * side,
            width=side + 0.3,  # no seams
            height=side + 0.3,
            fill=fills[cell],
        )
        for row, cells in enumerate(maze.cells)
        for column, cell in enumerate(cells)
        if cell in fills
    ]
    frame = svg.element(
        "rect", x=left, y=_TOP, width=maze.width * scale, height=maze.height * scale,
        fill="none", stroke=_WALL, stroke_width=2.0,
    )  # fmt: skip
    return "".join(boxes) + frame


def _by_start(results: Sequence[TrialResult]) -> dict[tuple[float, float], list[TrialResult]]:
    groups: dict[tuple[float, float], list[TrialResult]] = {}
    for result in results:
        groups.setdefault(start_cell(result), []).append(result)
    return groups


def _fraction(x: float, y: float, group: Sequence[TrialResult], scale: float) -> str:
    """A start cell's successes as a ring that is closed where all runs succeeded: 9/10."""
    successes = sum(result.success for result in group)
    radius = min(CELL_SIZE * scale * 0.42, 40.0)
    length = math.tau * radius
    ring = svg.element("circle", cx=x, cy=y, r=radius, fill="none", stroke="#c8c8c8", stroke_width=4.0)
    if successes:
        done = length * successes / len(group)
        ring += svg.element(
            "circle", cx=x, cy=y, r=radius, fill="none", stroke=_SUCCESS, stroke_width=4.0,
            stroke_dasharray=f"{done:.2f} {length - done + 0.01:.2f}",
            transform=f"rotate(-90 {svg.number(x)} {svg.number(y)})",
        )  # fmt: skip
    return ring + svg.text(
        x, y + radius * 0.72, f"{successes}/{len(group)}", 11.0, text_anchor="middle", font_weight="bold",
        paint_order="stroke", stroke="#ffffff", stroke_width=3.0,
    )  # fmt: skip


def _axes(maze: MazeSpec, left: float, bottom: float, scale: float) -> str:
    step = int(CELL_SIZE) * max(1, math.ceil(maze.columns / 20))
    parts = [
        svg.text(left + inches * scale, bottom + 14, f"{inches}", text_anchor="middle")
        for inches in range(0, int(maze.width) + 1, step)
    ]
    parts += [
        svg.text(left - 5, bottom - inches * scale + 4, f"{inches}", text_anchor="end")
        for inches in range(0, int(maze.height) + 1, step)
    ]
    parts.append(svg.text(left - 16, bottom + 14, "in", text_anchor="end"))
    return svg.element("g", "".join(parts), fill=svg.FAINT)


def _key(y: float) -> str:
    marks = (
        (
            "contact",
            f"<path d='M6 -4l8 8m0 -8l-8 8' stroke='{svg.CONTACT}' stroke-width='1.8'/>",
        ),
        ("where a failed run ended, by cause", "<circle cx='10' r='5' fill='#fff' stroke='#222222'/>"),
        (
            "start cell, its successes of its runs",
            f"<circle cx='10' r='7' fill='none' stroke='{_SUCCESS}' stroke-width='3'/>",
        ),
    )
    parts, x = [], _LEFT
    for words, mark in marks:
        parts.append(svg.shifted(x, y + 5, mark) + svg.text(x + 26, y + 9, words))
        x += 60 + 5.6 * len(words)
    return "".join(parts)


def histogram_figure(successes: Sequence[float], failures: Sequence[float], unit: str) -> tuple[float, str]:
    """The height of the picture, and what is in it, `WIDTH` wide: how values of successful and
    failed runs are spread. There must be a value."""
    edges, decimals = histogram([*successes, *failures])
    counts = [counted(values, edges) for values in (successes, failures)]
    tallest = max(a + b for a, b in zip(*counts, strict=True))
    bottom, width = _TOP + 12 + _BAR_HEIGHT, (WIDTH - _LEFT - _RIGHT) / len(counts[0])
    parts = []
    for index, (done, failed) in enumerate(zip(*counts, strict=True)):
        x, base = _LEFT + index * width, bottom
        for count, fill in ((done, _SUCCESS), (failed, _FAILURE)):
            height = _BAR_HEIGHT * count / tallest
            base -= height
            if count:
                parts.append(svg.element("rect", x=x + 1, y=base, width=width - 2, height=height, fill=fill))
        if done + failed:
            middle = x + width / 2
            parts.append(svg.text(middle, base - 3, f"{done + failed}", 10.0, text_anchor="middle"))
    every = max(1, math.ceil(len(edges) / 16))
    parts += [
        svg.text(_LEFT + index * width, bottom + 14, f"{edge:.{decimals}f}", text_anchor="middle")
        for index, edge in enumerate(edges)
        if index % every == 0
    ]
    parts.append(svg.text(_LEFT - 14, bottom + 14, unit, text_anchor="end", fill=svg.FAINT))
    y, x = bottom + 30, _LEFT
    for words, fill in (("successful runs", _SUCCESS), ("failed runs", _FAILURE)):
        parts.append(svg.element("rect", x=x, y=y - 9, width=10.0, height=10.0, fill=fill))
        parts.append(svg.text(x + 16, y, words))
        x += 130
    return bottom + 40, "".join(parts)
