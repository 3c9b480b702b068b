"""The drive law in closed form is that of the simulator, and clearance is what shapely measures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import Point, box
from shapely.ops import unary_union

from simmer_tui.calibrate.geometry import Clearance, chord_factor, displacement, moved, totals_between
from simmer_tui.sim.path import Path
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import MazeSpec, RobotSpec

inches = st.floats(-30, 30)
degrees = st.floats(-170, 170)


@given(inches, inches, degrees, inches, inches, degrees, st.integers(1, 40))
def test_it_leads_where_the_simulator_goes(
    x: float, y: float, heading: float, ahead: float, aside: float, turn: float, segments: int
) -> None:
    path = Path.laid(Pose(x, y, heading), ahead / segments, aside / segments, turn / segments, segments)
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
    assert displacement(np.zeros((1, 3)), segments) == 0


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
