"""The route of a run: all of it, by its shape."""

from __future__ import annotations

import numpy as np
import pytest

from simmer_tui.live.route import TOLERANCE, RouteKeeper, merged_pieces, simplified


def distances(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of each point (n, 2) to a line through points (m, 2)."""
    starts, chords = line[:-1], np.diff(line, axis=0)
    away = points[:, None] - starts
    share = (away * chords).sum(axis=2) / np.maximum((chords**2).sum(axis=1), 1e-12)
    near = starts + np.clip(share, 0.0, 1.0)[..., None] * chords
    return np.asarray(np.hypot(*(points[:, None] - near).T).min(axis=0))


@pytest.mark.parametrize("tolerance", [0.05, 0.5])
def test_a_simplified_line_stays_near_all_points(tolerance: float) -> None:
    turn = np.linspace(0.0, 9.0, 400)
    spiral = np.column_stack((turn * np.cos(turn), turn * np.sin(turn)))
    found = simplified(spiral, tolerance)
    assert distances(spiral, found).max() <= tolerance
    assert len(found) < len(spiral) / 5


def test_a_route_that_turns_back_is_kept() -> None:
    line = np.array([(0.0, 0.0), (9.0, 0.0), (3.0, 0.0)])
    assert simplified(line, 0.1).tolist() == line.tolist()


def test_the_whole_route_stays_with_few_points_and_its_times() -> None:
    """Movements of half an inch for an hour: as one that steers."""
    keeper, points = RouteKeeper(), [(0.0, 0.0)]
    for number in range(2000):
        side = number // 48 % 4
        x, y = points[-1]
        points.append((x + 0.5 * (side == 0) - 0.5 * (side == 2), y + 0.5 * (side == 1) - 0.5 * (side == 3)))
        keeper.add(points[-2:], float(number), number + 1.0)
    pieces = keeper.route.pieces
    assert distances(np.array(points), np.concatenate(pieces)[:, :2]).max() <= TOLERANCE
    assert sum(map(len, pieces)) < 150
    recent = keeper.route.since(1990.0)
    assert recent[0][0, 2] == 1990.0
    assert recent[-1][-1].tolist() == [*points[-1], 2000.0]
    assert sum(float(np.hypot(*np.diff(piece[:, :2], axis=0).T).sum()) for piece in recent) == pytest.approx(
        5.0
    )


@pytest.mark.parametrize("step", [0.02, 0.08, 0.5])
def test_an_arc_of_many_small_movements_stays_an_arc(step: float) -> None:
    turn = np.arange(0.0, 40.0, step) / 20.0
    points = np.column_stack((20.0 * np.cos(turn), 20.0 * np.sin(turn)))
    keeper = RouteKeeper()
    for number in range(len(points) - 1):
        keeper.add(list(map(tuple, points[number : number + 2])), 7.0 + number, 8.0 + number)
    pieces = keeper.route.pieces
    assert distances(points[:-1], np.concatenate(pieces)[:, :2]).max() <= TOLERANCE
    assert sum(map(len, pieces)) < 30
    assert [first[-1].tolist() for first in pieces[:-1]] == [later[0].tolist() for later in pieces[1:]]
    assert keeper.route is keeper.route, "it is simplified once"


def test_old_pieces_are_joined_where_their_ends_meet() -> None:
    first, second = np.array([(0.0, 0.0, 7.0), (9.0, 0.0, 8.0)]), np.array([(9.0, 0.0, 8.0), (9.0, 9.0, 9.0)])
    far = np.array([(60.0, 0.0, 9.0), (70.0, 0.0, 10.0)])
    assert [len(each) for each in merged_pieces([first, second, far])] == [4, 2]


def test_a_robot_put_elsewhere_leaves_no_line_between() -> None:
    keeper = RouteKeeper()
    keeper.add([(0.0, 0.0), (2.0, 0.0)], 0.0, 1.0)
    keeper.add([(50.0, 20.0), (52.0, 20.0)], 1.0, 2.0)
    assert [piece[:, 0].tolist() for piece in keeper.route.pieces] == [[0.0, 2.0], [50.0, 52.0]]
    keeper.clear()
    assert keeper.route.pieces == ()
