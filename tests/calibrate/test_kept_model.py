"""Numbers of the model, the searches and the checks for a run that has everything, kept.

Formulas are tested one by one elsewhere. Here a changed sign, factor or constant shows wherever it is.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from simmer_tui.calibrate.find_path import PathFinder
from simmer_tui.calibrate.geometry import displacement
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun, Readings
from simmer_tui.calibrate.parameters import parameters_of
from simmer_tui.calibrate.pose_filter import PoseFilter
from simmer_tui.calibrate.posterior import Iterate, Posterior, noise_scale_score, outliers_in
from simmer_tui.calibrate.rows import Model
from simmer_tui.calibrate.stretches import ARC_SEGMENTS
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import ContactRule, RobotSpec
from tests.calibrate.synthetic import START, make
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_model.json")
ROBOTS = {
    "disc": (RobotSpec.circle(6.0), ContactRule.DRIVE),
    "disc_that_stops": (RobotSpec.circle(6.0), ContactRule.STOP),
    "polygon": (RobotSpec.polygon(((3.0, 2.0), (-3.0, 2.5), (-2.5, -2.0), (2.0, -3.0))), ContactRule.DRIVE),
}
RIGHT, ROT = 3, 4


@cache
def run_of(robot: str) -> tuple[MeasuredRun, Iterate]:
    """Two chains of 9 and 8 movements, of which some are stretches of continuous motion, one is unanswered
    and some met a wall; a reading is missing now and then, and the block was moved late."""
    made = make(17)
    shape, contact = ROBOTS[robot]
    spec = structs.replace(
        made.run.spec, robot=shape, contact=contact, block_center=(70.0, 40.0), block_size=4.0
    )
    configuration = structs.replace(made.run.configuration, simulation=spec)
    movements = list(made.run.chains[0].movements)
    for number, (ahead, turned) in {1: (3.0, 20.0), 2: (4.0, -9.0), 4: (-3.5, 30.0), 12: (0.5, 50.0)}.items():
        led = (ahead, 0.2 * number, turned)
        parts = ((RIGHT, ahead), (ROT, turned)) if number % 4 else ((ROT, turned), (RIGHT, ahead))
        movements[number] = MeasuredMovement(
            parts[0][0], parts[0][1], True, 2 + number, float("nan"), parts, led, 0.1 - 0.05j * number
        )
    movements[6] = replace(movements[6], certain=False)
    poses = made.truth.chain[9, :3].tolist()
    chains = (
        Chain(START, 1, movements[:9]),
        Chain(Pose(*poses), 12, movements[9:16], (0.5, 0.25, 3.0)),
    )
    readings = {}
    for number, (code, each) in enumerate(made.run.readings.items()):
        values = each.values.copy()
        values[3 + number] = np.inf
        kept = np.arange(len(values)) % (7 + number) != 5
        gaps = np.where(each.stops % 3 == 0, np.nan, each.gaps)
        readings[code] = Readings(each.stops[kept], values[kept], each.times[kept], gaps[kept])
    run = MeasuredRun(configuration, ("made up",), chains, readings, 11, False)
    chain = made.truth.chain.copy()
    chain[9, 3:] = 0.0
    chain[-1, 3:] = 0.0
    off = np.cos(1.7 * np.arange(chain.size)).reshape(chain.shape) * (0.05, 0.05, 0.3, 0.05, 0.05, 0.3)
    chain += off
    contacts = np.isin(np.arange(16), (2, 3, 5, 8, 10, 14))
    space = parameters_of(run)
    parameters, scales = space.of(spec)
    parameters = parameters + 0.003 * np.sin(np.arange(len(parameters)))
    outliers = made.truth.outliers + 0.01 * np.arange(len(made.truth.outliers))
    return run, Iterate(chain, parameters, scales, contacts, contacts & False, outliers)


def weighed(matrix: Any) -> FloatArray:
    """A matrix times weights no two of which are alike."""
    return np.asarray(matrix @ (1.0 + np.cos(0.7 * np.arange(matrix.shape[1]))))


@pytest.mark.parametrize("robot", ["disc", "polygon"])
def test_rows_of_a_run_are_those_that_were_kept(robot: str) -> None:
    run, state = run_of(robot)
    model = Model(run, parameters_of(run))
    tight = np.where(np.arange(len(state.parameters)) % 3, 0.5, 0.0)
    found = {}
    made = {"plain": model.rows(state)} | (
        {"tight": model.rows(state, 0.7, tight)} if robot == "disc" else {}
    )
    for name, rows in made.items():
        found[name] = {
            "residuals": rows.residuals,
            "variances": rows.variances,
            "weights": rows.weights,
            "slopes": weighed(rows.jacobian),
            "shares": weighed(rows.shares),
        }
    assert_kept(found, KEPT, f"rows_{robot}")


def test_scores_of_noise_scales_and_spreads_are_those_that_were_kept() -> None:
    run, state = run_of("disc")
    model = Model(run, parameters_of(run))
    rows = model.rows(state)
    posterior = Posterior(rows, model.width, 0.01)
    gradient, information = noise_scale_score(model.space, state, rows, posterior, np.random.default_rng(3))
    found = {
        "gradient": gradient,
        "information": weighed(information),
        "outliers": outliers_in(rows, state),
        "step": posterior.step(),
        "spread": posterior.pose_spread(np.random.default_rng(4)),
        "covariance": weighed(posterior.covariance()),
    }
    assert_kept(found, KEPT, "noise_scales")


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_filtered_path_is_that_which_was_kept(robot: str) -> None:
    run, _ = run_of(robot)
    first = run.first_stops()[1]
    start = np.array((run.chains[1].start.x, run.chains[1].start.y, run.chains[1].start.heading))
    made = PoseFilter(run, run.spec, start, np.diag((0.3, 0.2, 1.0)), first)
    made.free = frozenset(range(first, first + 5))
    for stop in range(first + 1, run.stops):
        made.go_on(stop)
    found = {
        "poses": [made.poses[stop] for stop in sorted(made.poses)],
        "covariance": made.covariance,
        "errors": {f"{kind.name} {ahead}": each for (kind, ahead), each in made.errors.items()},
        "scores": {kind.name: each for kind, each in made.scores.items()},
    }
    assert_kept(found, KEPT, f"filter_{robot}")


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_searched_path_is_that_which_was_kept(robot: str) -> None:
    run, _ = run_of(robot)
    sensors = run.spec.sensors
    if robot != "disc":  # wheels alone, and no gyro
        sensors = tuple(each for each in sensors if each.kind.name != "gyro")
    wall = Pose(92.0, 20.0, 3.0)
    chain = replace(run.chains[1], start=wall)
    spec = structs.replace(run.spec, sensors=sensors)
    run = replace(run, configuration=structs.replace(run.configuration, simulation=spec))
    told: list[int] = []
    finder = PathFinder(replace(run, chains=(run.chains[0], chain)))
    path = finder.find(
        chain, run.first_stops()[1], 30, np.random.default_rng(2), wide=0.8, progress=told.append
    )
    found = {"poses": path.poses, "contacts": path.contacts, "fit": path.fit, "told": told}
    assert_kept(found, KEPT, f"path_{robot}")


def test_the_law_of_continuous_motion_is_that_of_an_arc() -> None:
    """A quarter turn over 12 in has a chord of 12 sin(45 deg) / (pi / 4)."""
    (chord,) = displacement(np.array([[12.0, 0.0, 90.0]]), ARC_SEGMENTS)
    assert abs(chord) == pytest.approx(10.804, abs=0.001)
