"""Pictures left out, so that no more bytes are sent than a slow link takes."""

from __future__ import annotations

import pytest

from simmer_tui.tui.frame_pace import ByteBudget


def shown(size: int, cells: int) -> tuple[int, float]:
    """Pictures of so many bytes in 10 s of 15 ticks each, and the bytes a second."""
    budget, written, count = ByteBudget(), 0, 0
    for tick in range(150):
        if not budget.delay(written, cells, tick / 15):
            written += size
            count += 1
    return count, written / 10


@pytest.mark.parametrize(
    ("cells", "most"), [(80 * 24, 24_000), (120 * 36, 24_000), (200 * 60, 45_000), (300 * 90, 45_000)]
)
def test_bytes_keep_within_their_limit_and_no_picture_is_left_out_below_it(cells: int, most: int) -> None:
    assert shown(most // 16, cells)[0] == 150
    for size in (2_000, 3_400, 9_000):
        count, rate = shown(size, cells)
        assert rate <= most * 1.04  # what was saved up is used up
        assert rate >= min(0.9 * most, 14.9 * size)
        assert count >= 25


def test_a_whole_screen_delays_the_next_picture_by_a_moment_only() -> None:
    budget = ByteBudget()
    budget.delay(0, 120 * 36, 0.0)
    delay = budget.delay(30_000, 120 * 36, 0.05)
    assert 0.0 < delay < 0.5
    assert budget.delay(30_000, 120 * 36, 0.05 + delay / 2) == pytest.approx(delay / 2)
    assert budget.delay(30_000, 120 * 36, 0.05 + delay * 1.001) == 0.0
