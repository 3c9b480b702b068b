"""A path is the same whether its places are computed at once or at the first access."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from simmer_tui.sim import Pose
from simmer_tui.sim.path import Path

SMALL = st.floats(-100.0, 100.0)


@given(
    SMALL,
    SMALL,
    st.one_of(st.floats(-1e4, 1e4), st.sampled_from((0.0, -90.0, 450.0))),
    SMALL,
    SMALL,
    st.one_of(SMALL, st.sampled_from((0.0, 9.0, 90.0))),
    st.integers(1, 40),
)
@example(0.0, 0.0, -1e-143, 0.0, 1.0, 0.0, 32)  # plus a whole turn it is 360 degrees
def test_points_are_the_same_bit_for_bit(
    x: float, y: float, heading: float, dx: float, dy: float, turn: float, segments: int
) -> None:
    start = Pose(x, y, heading)
    at_once, one_by_one = (lay(start, dx, dy, turn, segments) for lay in (Path.of_segments, Path.lazy))
    assert np.array_equal(at_once.points, one_by_one.points)
    assert (at_once.start, at_once.turn) == (one_by_one.start, one_by_one.turn)
