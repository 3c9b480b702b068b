"""Pictures left out while the robot jumps."""

from __future__ import annotations

from itertools import pairwise

from simmer_tui.tui.frame_pace import JumpThinning


def test_eight_of_fifteen_pictures_of_jumps_are_shown_and_never_none_of_two() -> None:
    thinning = JumpThinning()
    shown = [not thinning.passes_over(True) for _ in range(150)]
    assert sum(shown) == 80
    assert all(one or other for one, other in pairwise(shown))


def test_a_movement_is_shown_in_every_picture() -> None:
    thinning = JumpThinning()
    assert thinning.passes_over(True)
    assert not any(thinning.passes_over(False) for _ in range(30))
