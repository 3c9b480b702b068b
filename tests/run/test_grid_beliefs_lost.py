"""Grids that are lost, and grids that are not: the rates are those of 3,000 beliefs of each kind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from simmer_tui.run.belief_grid import Probabilities, grid_belief
from simmer_tui.run.events import Belief
from simmer_tui.run.facts import Deviation, deviation
from simmer_tui.sim import Pose

MAZE = (0.0, 0.0, 96.0, 48.0)
ROWS, COLUMNS = 24, 48
FLOOR = 0.005
"""Share of each belief that is spread over all cells, as filters do it."""
_Y, _X = np.mgrid[0:ROWS, 0:COLUMNS]


def humps(random: np.random.Generator, count: int) -> Probabilities:
    """A belief of one hump or more, rows x columns, of sum 1."""
    table = np.zeros((ROWS, COLUMNS))
    for _ in range(count):
        x, y, spread = random.uniform(0, COLUMNS), random.uniform(0, ROWS), random.uniform(0.7, 3.0)
        away = (_X + 0.5 - x) ** 2 + (_Y + 0.5 - y) ** 2
        table += random.uniform(0.5, 1.0) * np.exp(-away / 2 / spread**2)
    return (1 - FLOOR) * table / table.sum() + FLOOR / table.size


def told(table: Probabilities, true: Pose, heading: float = 0.0) -> Deviation:
    grid = grid_belief(table.reshape(ROWS, COLUMNS, -1), MAZE, heading, true)
    return deviation(Belief(0.0, grid.best_pose, true, grid.spread, grid=grid))


def lost_share(count: int, number: int, truth: Callable[[np.random.Generator, Probabilities], Pose]) -> float:
    random = np.random.default_rng(28)
    tables = [humps(random, count) for _ in range(number)]
    return float(np.mean([told(table, truth(random, table)).wrong for table in tables]))


def drawn(random: np.random.Generator, table: Probabilities) -> Pose:
    """A truth as a calibrated belief expects it: a cell with its probability, a place in it at random."""
    row, column = divmod(int(random.choice(table.size, p=table.ravel())), COLUMNS)
    return Pose((column + random.uniform()) * 2.0, 48.0 - (row + random.uniform()) * 2.0, 0.0)


def unrelated(random: np.random.Generator, table: Probabilities) -> Pose:
    return Pose(random.uniform(0, 96), random.uniform(0, 48), 0.0)


@pytest.mark.parametrize("count", [1, 2])
def test_calibrated_beliefs_are_hardly_ever_lost(count: int) -> None:
    assert lost_share(count, 300, drawn) <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_of_3000_calibrated_beliefs_1_percent_at_most_are_lost(count: int) -> None:
    assert lost_share(count, 3000, drawn) <= 0.01


@pytest.mark.parametrize(("count", "least"), [(1, 0.85), (2, 0.78)])
def test_sure_beliefs_of_another_place_are_lost(count: int, least: float) -> None:
    assert lost_share(count, 1000, unrelated) >= least


def test_a_program_that_knows_nothing_is_unsure_and_not_lost() -> None:
    even = np.full((ROWS, COLUMNS), 1.0)
    grid = grid_belief(even[..., None], MAZE, 0.0, Pose(90.0, 6.0, 0.0))
    assert not told(even, Pose(90.0, 6.0, 0.0)).wrong
    assert grid.spread > 3.0
    assert grid.entropy == pytest.approx(np.log2(even.size))


def test_a_wrong_heading_is_lost_and_a_grid_without_headings_does_not_judge_it() -> None:
    table = np.full((ROWS, COLUMNS, 4), 1e-9)
    table[12, 24, 0] = 1.0
    here = Pose(49.0, 23.0, 0.0)
    assert not told(table, here).wrong
    assert not told(table, Pose(49.0, 23.0, 80.0)).wrong  # the next heading is a neighbour
    assert told(table, Pose(49.0, 23.0, 180.0)).wrong
    free = told(table[..., 0], Pose(49.0, 23.0, 180.0))
    assert (free.wrong, free.turn) == (False, 0.0)


def test_a_large_floor_hides_a_wrong_place_from_the_first_rule_only() -> None:
    table = np.full((ROWS, COLUMNS), 0.02 / ROWS / COLUMNS)
    table[2, 2] = 0.98
    off = told(table, Pose(90.0, 6.0, 0.0))
    assert not off.rejects_truth
    assert off.wrong
