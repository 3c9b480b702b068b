"""Which box each pane has in a terminal of a given size."""

from __future__ import annotations

from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.sim.specs import MazeSpec, SimulationSpec
from simmer_tui.tui.panes import PANELS
from simmer_tui.tui.sizes import PAGES, Arrangement, Box, arrangement


def planned(maze: MazeSpec, width: int, height: int, *, sensors: int = 17, page: str = "maze") -> Arrangement:
    """Arrangement with the panels of the app."""
    panels = [(kind.name, kind.rows) for kind in PANELS]
    return arrangement(maze, width, height, sensors=sensors, panels=panels, page=page)


@pytest.mark.parametrize(
    ("size", "has_pages", "too_small"),
    [
        ((39, 24), False, True),
        ((80, 11), False, True),
        ((40, 12), True, False),
        ((80, 24), True, False),
        ((109, 40), True, False),
        ((110, 30), False, False),
        ((120, 36), False, False),
        ((200, 60), False, False),
    ],
)
def test_small_screens_have_pages_and_smaller_ones_say_so(
    course_spec: SimulationSpec, size: tuple[int, int], has_pages: bool, too_small: bool
) -> None:
    plan = planned(course_spec.maze, *size)
    assert (plan.has_pages, "small" in plan.boxes) == (has_pages, too_small)


def test_80_x_24_shows_all_at_once(course_spec: SimulationSpec) -> None:
    boxes = planned(course_spec.maze, 80, 24).boxes
    assert boxes == {
        "header": Box(0, 0, 80, 1),
        "maze": Box(0, 1, 66, 18),
        "sensors": Box(67, 1, 13, 18),
        "legend": Box(0, 19, 80, 1),
        "pose": Box(0, 20, 80, 1),
        "console": Box(0, 21, 80, 2),
        "keys": Box(0, 23, 80, 1),
    }


@pytest.mark.parametrize(
    ("size", "maze", "panes"),
    [
        ((120, 36), (82, 22), {"sensors", "robot", "run", "events", "console"}),
        ((160, 45), (106, 28), {"sensors", "robot", "run", "radar", "events", "console"}),
        ((200, 60), (146, 38), {"sensors", "robot", "run", "radar", "events", "console", "facts"}),
    ],
)
def test_larger_screens_grow_the_maze_and_add_panes(
    course_spec: SimulationSpec, size: tuple[int, int], maze: tuple[int, int], panes: set[str]
) -> None:
    boxes = planned(course_spec.maze, *size).boxes
    assert (boxes["maze"].width, boxes["maze"].height) == maze
    assert set(boxes) - {"header", "maze", "legend", "console-head", "keys"} == panes


def test_every_page_has_its_pane_and_the_console(course_spec: SimulationSpec) -> None:
    for page in PAGES[1:]:
        boxes = planned(course_spec.maze, 80, 24, page=page).boxes
        assert {page, "console", "header", "keys"} <= set(boxes)
        assert "maze" not in boxes


def overlaps(plan: Arrangement) -> list[tuple[str, str]]:
    found = []
    for (one, a), (other, b) in combinations(plan.boxes.items(), 2):
        beside = a.x + a.width <= b.x or b.x + b.width <= a.x
        if not (beside or a.bottom <= b.y or b.bottom <= a.y):
            found.append((one, other))
    return found


@given(
    st.integers(1, 300),
    st.integers(1, 120),
    st.integers(1, 40),
    st.integers(1, 80),
    st.integers(1, 40),
    st.sampled_from(PAGES),
)
def test_no_box_overlaps_another_or_leaves_the_screen(
    width: int, height: int, rows: int, columns: int, sensors: int, page: str
) -> None:
    plan = planned(MazeSpec(((1,) * columns,) * rows), width, height, sensors=sensors, page=page)
    for name, box in plan.boxes.items():
        assert box.width >= 1, name
        assert box.height >= 1, name
        assert 0 <= box.x <= width - box.width, name
        assert 0 <= box.y <= height - box.height, name
    assert overlaps(plan) == []
