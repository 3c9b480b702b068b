"""Which panes a terminal of a given size has."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.sim.specs import MazeSpec, SimulationSpec
from simmer_tui.tui.sizes import SIDE_COLUMNS, arrangement


@pytest.mark.parametrize(
    ("size", "side_by_side", "too_small"),
    [
        ((39, 24), False, True),
        ((80, 11), False, True),
        ((40, 12), False, False),
        ((80, 24), False, False),
        ((109, 40), False, False),
        ((110, 30), True, False),
        ((120, 36), True, False),
        ((200, 60), True, False),
    ],
)
def test_panels_stand_beside_the_maze_where_there_is_room(
    course_spec: SimulationSpec, size: tuple[int, int], side_by_side: bool, too_small: bool
) -> None:
    plan = arrangement(course_spec.maze, *size)
    assert (plan.side_by_side, plan.too_small) == (side_by_side, too_small)


def test_the_log_gets_the_rows_the_maze_does_not_need(course_spec: SimulationSpec) -> None:
    assert [arrangement(course_spec.maze, *size).maze_rows for size in ((120, 36), (200, 60))] == [18, 38]


@given(st.integers(1, 300), st.integers(1, 120), st.integers(1, 12), st.integers(1, 12))
def test_no_size_and_no_maze_leaves_the_maze_without_a_row(
    width: int, height: int, rows: int, columns: int
) -> None:
    plan = arrangement(MazeSpec(((1,) * columns,) * rows), width, height)
    assert 1 <= plan.maze_rows <= max(height, 1)
    assert not plan.side_by_side or width > SIDE_COLUMNS
