"""Which box each pane has in a terminal of a given size."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.sim.specs import MazeSpec, SimulationSpec
from simmer_tui.tui.panes import PANELS
from simmer_tui.tui.sizes import PAGES, Arrangement, Box, arrangement


def planned(
    maze: MazeSpec, width: int, height: int, *, sensors: int = 17, page: str = "maze", boards: int = 0
) -> Arrangement:
    """Arrangement with the panels of the app, and that of so many boards."""
    panels = [(kind.name, kind.rows or 2 * boards + bool(boards)) for kind in PANELS]
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
        ((120, 36), (82, 22), {"answer", "sensors", "robot", "run", "events", "console"}),
        ((160, 45), (106, 28), {"answer", "sensors", "robot", "run", "events", "console"}),
        (
            (200, 60),
            (146, 38),
            {"answer", "sensors", "robot", "run", "radar", "events", "console", "facts", "program"},
        ),
    ],
)
def test_larger_screens_grow_the_maze_and_add_panes(
    course_spec: SimulationSpec, size: tuple[int, int], maze: tuple[int, int], panes: set[str]
) -> None:
    boxes = planned(course_spec.maze, *size).boxes
    assert (boxes["maze"].width, boxes["maze"].height) == maze
    assert set(boxes) - {"header", "maze", "legend", "console-head", "keys"} == panes


def places(boxes: Mapping[str, Box], *names: str) -> dict[str, tuple[int, int]]:
    """First and last row of some panes."""
    return {name: (boxes[name].y, boxes[name].bottom - 1) for name in names}


def test_120_x_36_stands_as_composed(course_spec: SimulationSpec) -> None:
    mission = [("robot", 3), ("run", 7)]
    boxes = arrangement(course_spec.maze, 120, 36, sensors=14, panels=mission).boxes
    assert (boxes["answer"].x, boxes["answer"].width) == (83, 36)
    assert places(boxes, "maze", "answer", "sensors", "legend", "events", "robot", "run") == {
        "maze": (1, 22),
        "answer": (1, 7),
        "sensors": (9, 22),
        "legend": (23, 23),
        "events": (24, 31),
        "robot": (24, 26),
        "run": (28, 34),
    }
    assert places(boxes, "console-head", "console", "keys") == {
        "console-head": (32, 32),
        "console": (33, 34),
        "keys": (35, 35),
    }


def test_200_x_60_stands_as_composed(course_spec: SimulationSpec) -> None:
    mission = [("robot", 4), ("run", 7)]
    boxes = arrangement(course_spec.maze, 200, 60, sensors=14, panels=mission).boxes
    assert (boxes["answer"].x, boxes["answer"].width) == (148, 51)
    assert (boxes["maze"].x, boxes["maze"].width) == (0, 146)
    names = "maze", "answer", "sensors", "radar", "robot", "run", "events", "console-head", "facts", "program"
    assert places(boxes, *names) == {
        "maze": (1, 38),
        "answer": (1, 7),
        "sensors": (9, 22),
        "radar": (24, 46),
        "robot": (47, 50),
        "run": (51, 57),
        "events": (41, 58),
        "console-head": (41, 41),
        "facts": (46, 50),
        "program": (52, 58),
    }


def test_on_a_small_screen_an_answer_takes_the_rows_of_legend_and_pose(course_spec: SimulationSpec) -> None:
    boxes = arrangement(course_spec.maze, 80, 24, sensors=14, panels=[], answer=1).boxes
    assert places(boxes, "maze", "answer", "console") == {
        "maze": (1, 18),
        "answer": (19, 20),
        "console": (21, 22),
    }
    assert not {"legend", "pose"} & set(boxes)


@given(st.integers(110, 300), st.integers(30, 120), st.integers(1, 40), st.integers(0, 60))
def test_a_long_answer_takes_rows_of_others_and_covers_none(
    course_spec: SimulationSpec, width: int, height: int, sensors: int, answer: int
) -> None:
    panels = [("robot", 3), ("run", 7)]
    plan = arrangement(course_spec.maze, width, height, sensors=sensors, panels=panels, answer=answer)
    assert overlaps(plan) == []
    assert plan.boxes["answer"].height >= min(answer, 20)
    for box in plan.boxes.values():
        assert box.height >= 1
        assert box.bottom <= height


def test_boards_of_a_mission_are_seen_before_the_last_sensors(course_spec: SimulationSpec) -> None:
    panels = (("robot", 3), ("run", 7), ("boards", 3))
    plan = arrangement(course_spec.maze, 120, 36, sensors=17, panels=panels)
    assert {name: plan.boxes[name].height for name, _ in panels} == dict(panels)
    assert plan.boxes["sensors"].height == 14
    page = arrangement(course_spec.maze, 80, 24, sensors=17, panels=panels, page="robot")
    assert {name: page.boxes[name].height for name, _ in panels} == dict(panels)


def test_boards_are_below_few_sensors_on_a_small_screen(course_spec: SimulationSpec) -> None:
    maze = MazeSpec(((1,) * 4,) * 4)
    panels = (("robot", 6), ("run", 4), ("boards", 3))
    for rows, is_seen in ((14, True), (16, False)):
        boxes = arrangement(maze, 80, 24, sensors=rows, panels=panels).boxes
        assert ("boards" in boxes) == is_seen
        assert sum(boxes[name].height for name in ("sensors", "boards") if name in boxes) == 18
    # Beside the maze of the course there is no room for them.
    assert "boards" not in arrangement(course_spec.maze, 80, 24, sensors=2, panels=panels).boxes


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
    st.integers(0, 3),
)
def test_no_box_overlaps_another_or_leaves_the_screen(
    width: int, height: int, rows: int, columns: int, sensors: int, page: str, boards: int
) -> None:
    maze = MazeSpec(((1,) * columns,) * rows)
    plan = planned(maze, width, height, sensors=sensors, page=page, boards=boards)
    for name, box in plan.boxes.items():
        assert box.width >= 1, name
        assert box.height >= 1, name
        assert 0 <= box.x <= width - box.width, name
        assert 0 <= box.y <= height - box.height, name
    assert overlaps(plan) == []
