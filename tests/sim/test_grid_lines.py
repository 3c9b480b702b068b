"""Points and rays on the lines between cells, where the cells on both sides count."""

import math
from itertools import product

import numpy as np
import pytest

from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.specs import MazeSpec

MAZE = Maze(MazeSpec(((1, 1, 1, 0), (1, 0, 1, 1), (1, 1, 1, 1), (0, 1, 0, 1))))


def distance_to_walls(maze: Maze, x: float, y: float) -> float:
    """By the rectangles of all wall cells, the ring outside among them."""
    cells = np.argwhere(maze.walls) - 1
    return min(
        math.hypot(max(12 * j - x, 0, x - 12 * j - 12), max(12 * i - y, 0, y - 12 * i - 12)) for i, j in cells
    )


def test_a_point_is_on_a_wall_within_a_millionth_of_an_inch() -> None:
    """At all lines and crossings of lines, a little on either side of them, and in the middles of cells."""
    places = [12.0 * k + off for k in range(5) for off in (-3e-6, -5e-7, 0.0, 5e-7, 3e-6, 6.0)]
    points = [(x, y) for x, y in product(places, places) if -1.0 < x < 49.0 and -1.0 < y < 49.0]
    # At a crossing a square of a millionth counts, not a disc: these offsets are inside or outside of both.
    expected = [distance_to_walls(MAZE, x, y) <= 1e-6 for x, y in points]
    assert [MAZE.is_wall(x, y) for x, y in points] == expected
    found = MAZE.are_walls(*(np.array(each) for each in zip(*points, strict=True)))
    assert found.tolist() == expected


def test_a_box_without_walls_has_no_point_on_one() -> None:
    """Boxes that end at lines between cells, a little on either side of them, and in the middles of cells."""
    places = [12.0 * k + off for k in range(5) for off in (-3e-6, -5e-7, 0.0, 5e-7, 3e-6, 6.0)]
    places = [each for each in places if -1.0 < each < 49.0]
    spans = [(low, high) for low, high in product(places, places) if low <= high <= low + 13.0]
    free = 0
    for (left, right), (below, above) in product(spans, spans):
        if not MAZE.has_walls((left, below), (right, above)):
            free += 1
            middle = ((left + right) / 2, (below + above) / 2)
            corners = product((left, right), (below, above))
            assert not any(MAZE.is_wall(*point) for point in (middle, *corners))
    assert free
    assert MAZE.has_walls((13.0, 13.0), (23.0, 25.0))
    assert not MAZE.has_walls((13.0, 13.0), (23.0, 23.0))


@pytest.mark.parametrize(
    ("cells", "rays"),
    [
        # One wall below the middle line, from (12, 0) to (24, 12).
        (
            ((1, 1, 1), (1, 0, 1)),
            [
                (6.0, 12.0, 1.0, 0.0, 6.0),
                (30.0, 12.0, -1.0, 0.0, 6.0),
                (12.0, 18.0, 0.0, -1.0, 6.0),
                (24.0, 18.0, 0.0, -1.0, 6.0),
                (12.0, 18.0, 0.0, 1.0, 6.0),
                (6.0, 12.0, -1.0, 0.0, 6.0),
                (6.0, 12.5, 1.0, 0.0, 30.0),
                (11.5, 18.0, 0.0, -1.0, 18.0),
            ],
        ),
        # The same above it.
        (
            ((1, 0, 1), (1, 1, 1)),
            [
                (6.0, 12.0, 1.0, 0.0, 6.0),
                (30.0, 12.0, -1.0, 0.0, 6.0),
                (12.0, 6.0, 0.0, 1.0, 6.0),
                (24.0, 6.0, 0.0, 1.0, 6.0),
                (12.0, 6.0, 0.0, -1.0, 6.0),
                (6.0, 11.5, 1.0, 0.0, 30.0),
                (24.5, 6.0, 0.0, 1.0, 18.0),
            ],
        ),
    ],
    ids=["below", "above"],
)
def test_a_ray_along_a_line_ends_at_walls_on_both_sides(
    cells: tuple[tuple[int, ...], ...], rays: list[tuple[float, ...]]
) -> None:
    maze = Maze(MazeSpec(cells))
    for x, y, dx, dy, distance in rays:
        assert maze.cast(x, y, dx, dy) == distance
    assert maze.cast_many(*np.array(rays).T[:4]).tolist() == [ray[4] for ray in rays]


def test_headings_are_read_as_angles_from_minus_to_plus_half_a_turn() -> None:
    degrees = [0.0, 90.0, 179.5, 180.0, 180.5, -180.0, -179.5, 270.0, 540.0, 725.0, -190.0]
    assert [half_turn(each) for each in degrees] == [
        0.0, 90.0, 179.5, 180.0, -179.5, 180.0, -179.5, -90.0, 180.0, 5.0, 170.0,
    ]  # fmt: skip
