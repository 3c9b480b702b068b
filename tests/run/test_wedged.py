"""Contacts that all happen in one place."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.run.facts import is_wedged
from simmer_tui.sim import Pose

_SMALL = st.floats(-0.35, 0.35)


@pytest.mark.parametrize(
    ("poses", "wedged"),
    [
        ([Pose(6, 6, 0)] * 4, False),
        ([Pose(6, 6, 0)] * 5, True),
        # Only the last five count.
        ([Pose(30, 6, 90), *[Pose(6, 6, 0)] * 5], True),
        ([*[Pose(6, 6, 0)] * 5, Pose(30, 6, 90)], False),
        ([*[Pose(6, 6, 0)] * 4, Pose(6.5, 6, 0)], True),
        ([*[Pose(6, 6, 0)] * 4, Pose(6.51, 6, 0)], False),
        ([*[Pose(6, 6, 358)] * 4, Pose(6, 6, 3)], True),
        ([*[Pose(6, 6, 358)] * 4, Pose(6, 6, 3.1)], False),
    ],
)
def test_five_contacts_within_half_an_inch_and_five_degrees(poses: list[Pose], wedged: bool) -> None:
    assert is_wedged(poses) is wedged


@settings(max_examples=15)
@given(st.lists(st.tuples(_SMALL, st.floats(-5, 5)), min_size=5, max_size=5), st.integers(-3, 3))
def test_whole_turns_make_no_difference(offsets: list[tuple[float, float]], turns: int) -> None:
    poses = [Pose(10 + off / 2, 10, 180 + turn / 2 + 360 * turns * (place % 2)) for place, (off, turn)
             in enumerate(offsets)]  # fmt: skip
    assert is_wedged(poses)
