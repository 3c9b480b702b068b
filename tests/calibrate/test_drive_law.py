"""The drive law in closed form is that of the simulator, and clearance is what shapely measures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import Point, box
from shapely.ops import unary_union

from simmer_tui.calibrate.geometry import (
    SHARES,
    Clearance,
    chord_factor,
    displacements,
    moved,
    totals_between,
)
from simmer_tui.sim.path import Path
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import MazeSpec, RobotSpec

inches = st.floats(-30, 30)
degrees = st.floats(-170, 170)


@given(inches, inches, degrees, inches, inches, degrees, st.integers(1, 40))
def test_it_leads_where_the_simulator_goes(
    x: float, y: float, heading: float, ahead: float, aside: float, turn: float, segments: int
) -> None:
    path = Path.of_segments(
        Pose(x, y, heading), ahead / segments, aside / segments, turn / segments, segments
    )
    there = moved(np.array([[x, y, heading]]), np.array([[ahead, aside, turn]]), segments)[0]
    assert there[:2] == pytest.approx(path.points[-1], abs=1e-8)
    assert there[2] == pytest.approx(heading + turn)


@given(inches, inches, degrees, inches, inches, degrees, st.integers(1, 40))
def test_totals_follow_from_poses(
    x: float, y: float, heading: float, ahead: float, aside: float, turn: float, segments: int
) -> None:
    pose, totals = np.array([[x, y, heading]]), np.array([[ahead, aside, turn]])
    again = totals_between(pose, moved(pose, totals, segments), segments)
    assert again == pytest.approx(totals, abs=1e-6)


@given(degrees, st.integers(1, 40))
def test_its_derivative_is_one(turn: float, segments: int) -> None:
    step = 1e-4
    sides = [chord_factor(np.array([turn + sign * step]), segments)[0] for sign in (1, -1)]
    slope = chord_factor(np.array([turn]), segments)[1]
    assert abs((sides[0] - sides[1]) / (2 * step) - slope).max() < 1e-7
    assert displacements(np.zeros((1, 3)), segments) == 0


@pytest.mark.parametrize("turn", [0.0, 0.002, -0.011, 0.0117, 0.02, -3.0, 170.0])
@pytest.mark.parametrize("segments", [1, 2, 7])
def test_it_is_the_mean_of_its_parts_however_straight(turn: float, segments: int) -> None:
    """By the sum itself; below 0.0115 degrees or so the first terms of its series stand for it."""
    parts = np.arange(1, segments + 1) / segments
    directions = np.exp(1j * np.radians(turn) * parts)
    factor, slope = chord_factor(np.array([turn]), segments)
    assert abs(factor[0] - directions.mean()) < 1e-14
    assert abs(slope[0] - (1j * parts * directions).mean() * np.pi / 180) < 1e-13


def test_totals_lead_on_from_any_pose_by_hand() -> None:
    """Facing up, a quarter turn to the left in one part, then 3 in ahead and 2 in to the left."""
    pose, totals = np.array([[10.0, 20.0, 90.0]]), np.array([[3.0, 2.0, 90.0]])
    assert moved(pose, totals, 1)[0] == pytest.approx((7.0, 18.0, 180.0))
    assert displacements(totals, 1)[0] == pytest.approx(-2.0 + 3.0j)
    assert totals_between(pose, np.array([[7.0, 18.0, 180.0]]), 1)[0] == pytest.approx(totals[0])


@given(st.floats(0.1, 35.9), st.floats(0.1, 23.9))
def test_clearance_is_the_distance_to_the_walls(x: float, y: float) -> None:
    cells = ((1, 1, 0), (1, 0, 1))
    walls = [box(12 * j, 12 * (1 - i), 12 * j + 12, 24 - 12 * i) for i, j in ((0, 2), (1, 1))]
    outside = box(-50, -50, 90, 80).difference(box(0, 0, 36, 24))
    obstacle = unary_union([*walls, outside])
    clear = Clearance(MazeSpec(cells), RobotSpec.circle(2.0)).of(np.array([[x, y, 0.0]]))[0]
    distance = obstacle.distance(Point(x, y))
    if distance:
        assert clear == pytest.approx(distance - 1.0)
    else:
        assert clear <= -1.0


def test_clearance_of_a_polygon_is_that_of_points_an_inch_apart() -> None:
    """A square of 6 in, at the middle of a cell: 3 in from its walls, a corner 3 sqrt(2) from the middle."""
    square = RobotSpec.rectangle(6.0, 6.0)
    clear = Clearance(MazeSpec(((0, 0, 0), (0, 1, 0), (0, 0, 0))), square)
    poses = np.array([[18.0, 18.0, 0.0], [18.0, 18.0, 45.0], [19.0, 17.5, 0.0], [21.5, 18.0, 0.0]])
    assert clear.of(poses) == pytest.approx([3.0, 6.0 - 3.0 * np.sqrt(2), 2.0, -0.5])
    # The corner of a wall, at (12, 12), stands a quarter of an inch in the middle of a side.
    corner = Clearance(MazeSpec(((1, 1), (0, 1))), square)
    middle = 11.75 + 3.0 / np.sqrt(2)
    assert corner.of(np.array([[middle, middle, 45.0]]))[0] == pytest.approx(-0.25)


def test_clearance_outside_the_maze_and_in_the_middle_of_walls() -> None:
    maze = MazeSpec(((1, 1), (1, 1)))
    point = Clearance(maze, RobotSpec.circle(2.0))
    places = np.array(
        [[-3.0, 6.0, 0.0], [6.0, -4.0, 0.0], [26.0, 6.0, 0.0], [6.0, 29.0, 0.0], [-3.0, -4.0, 0.0]]
    )
    assert point.of(places) == pytest.approx([-4.0, -5.0, -3.0, -6.0, -6.0])
    # As far from any wall as the cells around are looked at: a cell's width.
    hall = Clearance(MazeSpec(((1,) * 7,) * 7), RobotSpec.circle(2.0))
    assert hall.of(np.array([[42.0, 42.0, 0.0]])) == pytest.approx([11.0])


def test_clearance_along_a_way_is_that_at_every_eighth_of_it() -> None:
    clear = Clearance(MazeSpec(((1, 1, 1),)), RobotSpec.circle(2.0))
    found = clear.along(np.array([[3.0, 6.0, 0.0]]), np.array([[30.0, 0.0, 0.0]]), 5)[0]
    assert SHARES.tolist() == [k / 8 for k in range(1, 9)]
    ahead = [3.0 + 30.0 * k / 8 for k in range(1, 9)]
    assert found == pytest.approx([min(6.0, x, 36.0 - x) - 1.0 for x in ahead])
