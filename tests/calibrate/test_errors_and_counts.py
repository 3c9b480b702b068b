"""Shares of outliers, counters over several movements, and the readings of a session."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from msgspec import structs

from simmer_tui.calibrate.estimates import timings
from simmer_tui.calibrate.find_path import PathFinder
from simmer_tui.calibrate.guided import SessionPlanner, drive_guided
from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.calibrate.posterior import COUNTER, RANGE, outliers_in
from simmer_tui.calibrate.rows import PER_STOP, Model
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim.specs import Axes
from tests.calibrate.conftest import Logged
from tests.calibrate.synthetic import Synthetic, make


@pytest.fixture(scope="module")
def known() -> Synthetic:
    return make()


def test_shares_of_outliers_stay_between_one_in_ten_thousand_and_two_fifths(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    ranges = np.flatnonzero(rows.family == RANGE)
    index = int(rows.source[ranges[0]])
    mine = np.flatnonzero((rows.family == RANGE) & (rows.source == index))
    for weight, share in ((0.0, 0.4), (0.5, 0.4)):
        weights = rows.weights.copy()
        weights[mine] = weight
        assert outliers_in(replace(rows, weights=weights), known.truth)[index] == share
    many = np.full(20_000, mine[0])
    sure = replace(rows, family=rows.family[many], source=rows.source[many], weights=np.ones(20_000))
    assert outliers_in(sure, known.truth)[index] == 1e-4
    some = replace(sure, weights=np.where(np.arange(20_000) < 2000, 0.0, 1.0))
    assert outliers_in(some, known.truth)[index] == pytest.approx(2000.5 / 20_001)


def test_counters_touch_every_movement_between_their_readings() -> None:
    """Read after 1, 2 and 3 movements in turn: derivatives are those of finite differences."""
    known = make(12)
    kept = np.array([0, 1, 3, 6, 7, 9, 12])
    readings = {
        code: replace(
            each,
            stops=each.stops[kept],
            values=each.values[kept],
            times=each.times[kept],
            gaps=each.gaps[kept],
        )
        for code, each in known.run.readings.items()
        if code in ("o1", "o3", "g1")
    }
    model = Model(replace(known.run, readings=readings), known.model.space)
    rows = model.rows(known.truth)
    mine = rows.family == COUNTER
    assert mine.sum() == 3 * 6
    jacobian = rows.jacobian.toarray()[mine]
    step, random = 1e-5, np.random.default_rng(6)
    for axis in (2, 3, 4, 5, 2, 3, 4, 5):
        direction = np.zeros((13, PER_STOP))
        direction[:, axis] = random.standard_normal(13)  # in which any wrong element shows
        sides = [
            model.rows(replace(known.truth, chain=known.truth.chain + sign * step * direction)).residuals[
                mine
            ]
            for sign in (1, -1)
        ]
        slope = (sides[0] - sides[1]) / (2 * step)
        assert jacobian[:, : direction.size] @ direction.ravel() == pytest.approx(slope, abs=2e-6), axis


def test_every_range_is_read_thrice_at_a_stop_and_nine_times_at_the_first() -> None:
    planner = SessionPlanner(load(bundled_folder()), np.random.default_rng(0))
    ranging, counters = ["u1", "u2", "u3", "u4", "u5", "t1", "c1"], ["o1", "o2", "o3", "o4", "g1"]
    first = planner.looks()
    assert sorted(first[: len(counters)]) == sorted(counters)
    assert {code: first.count(code) for code in ranging} == dict.fromkeys(ranging, 9)
    planner.count = 1
    later = planner.looks()
    assert {code: later.count(code) for code in counters} == dict.fromkeys(counters, 1)
    assert {code: later.count(code) for code in ranging} == dict.fromkeys(ranging, 3)


@pytest.mark.parametrize(("holding", "moved_at"), [(False, None), (True, 0)])
def test_a_run_that_begins_with_the_block_held_has_it_nowhere(
    logged: Logged, tmp_path: Path, holding: bool, moved_at: int | None
) -> None:
    header, *lines = logged.path.read_text().splitlines()
    told = json.loads(header)
    assert told["holding"] is False
    path = tmp_path / "log.jsonl"
    path.write_text(
        "\n".join([json.dumps({**told, "holding": holding}, separators=(",", ":")), *lines]) + "\n"
    )
    assert read_runs([path]).block_moved_at == moved_at


def test_drives_that_a_set_calls_exact_err_a_little_in_the_search(known: Synthetic) -> None:
    """Drives without error, and ranges alone: an example by a fixed seed, from 60 particles."""
    spec = known.run.spec
    drives = tuple(structs.replace(each, error=Axes(0.0, 0.0, 0.0)) for each in spec.drives)
    ranging = {each.code for each in spec.sensors if each.kind.is_range}
    readings = {code: each for code, each in known.run.readings.items() if code in ranging}
    configuration = structs.replace(known.run.configuration, simulation=structs.replace(spec, drives=drives))
    run = replace(known.run, configuration=configuration, readings=readings).before_stop(6)
    path = PathFinder(run).find(run.chains[0], 0, 60, np.random.default_rng(5), wide=1.0)
    assert path.poses[-1] == pytest.approx((38.50022, 30.70680, 56.97460), abs=1e-4)
    assert path.fit == pytest.approx(-2.1574309, abs=1e-6)


def test_turns_are_chosen_to_either_side() -> None:
    """Once spin and square are done: from 15 to 120 degrees, to the left and to the right."""
    planner = SessionPlanner(load(bundled_folder()), np.random.default_rng(0))
    turning = [drive for drive in planner.drives if drive.kind.turns]
    planner.drives = turning
    amounts = []
    for _ in range(60):
        move = planner.next_move()
        if move is not None and move[0] in turning:
            amounts.append(move[1])
    drawn = amounts[-25:]
    assert min(abs(each) for each in drawn) >= 15
    assert max(abs(each) for each in drawn) <= 120
    assert 5 <= sum(each > 0 for each in drawn) <= 20


def test_parameters_are_estimated_after_some_movements_and_not_before() -> None:
    """20 are the spin and most of the square; then less and less apart, to the last of 150."""

    class Guide:
        """A session that never has enough and reads nothing."""

        count = 0
        done = False

        def looks(self) -> list[str]:
            return []

        def settled(self) -> None:
            self.done = self.count >= 150

        def next_move(self) -> tuple[Any, float]:
            return SimpleNamespace(code="d1"), 1.0

        def made(self, drive: object, amount: float, certain: bool) -> None:
            self.count += 1

    guide = Guide()
    fitted_at = []

    async def learn() -> None:
        fitted_at.append(guide.count)

    async def ask(command: str) -> float:
        return 0.0

    asyncio.run(drive_guided(ask, cast(SessionPlanner, guide), learn, lambda: 0.0))
    assert fitted_at == [20, 45, 70, 90, 105, 120, 135, 150]


def test_the_shortest_quarter_of_the_gaps_tells_a_read_time(known: Synthetic) -> None:
    """41 gaps of 0.11 s and more, each a hundredth longer than the one before: the first ten count."""
    readings = known.run.readings["u1"]
    gaps = 0.11 + 0.01 * np.random.default_rng(1).permutation(len(readings.gaps))
    assert len(gaps) == 41
    run = replace(known.run, readings={**known.run.readings, "u1": replace(readings, gaps=gaps)})
    found = {(each.owner, each.field): each for each in timings(run)}
    assert found["ultra1", "read_time"].value == pytest.approx(0.11 + 0.045 - 0.08, abs=1e-4)


def test_a_gain_is_known_to_some_percent_before_anything_is_read(known: Synthetic) -> None:
    spreads = {
        each.name: each.spread / abs(each.present) for each in known.model.space.parameters if each.present
    }
    assert spreads["odom1 gain"] == pytest.approx(0.15)
    assert spreads["gyro1 gain"] == pytest.approx(0.1)
