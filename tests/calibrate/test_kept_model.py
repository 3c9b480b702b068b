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
from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.geometry import displacements
from simmer_tui.calibrate.guided import SessionPlanner
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun, Readings
from simmer_tui.calibrate.model_check import check_model, conformal_factor
from simmer_tui.calibrate.parameters import parameters_of
from simmer_tui.calibrate.pose_filter import PoseFilter
from simmer_tui.calibrate.posterior import COUNTER, Iterate, Posterior, noise_scale_score, outliers_in
from simmer_tui.calibrate.rows import Model
from simmer_tui.calibrate.stretches import ARC_SEGMENTS, VelocityStretch
from simmer_tui.calibrate.suspicions import suspicions, suspicions_without_path
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import ParameterKind
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
    for number, (ahead, turned) in {
        1: (3.0, 20.0),
        2: (4.0, -9.0),
        4: (-3.5, 30.0),
        9: (4.0, 8.0),
        12: (0.5, 50.0),
    }.items():
        commanded = (ahead, 0.2 * number, turned)
        parts = ((RIGHT, ahead), (ROT, turned)) if number % 4 else ((ROT, turned), (RIGHT, ahead))
        movements[number] = MeasuredMovement(
            parts[0][0], parts[0][1], True, 2 + number, float("nan"), parts, commanded, 0.1 - 0.05j * number
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
        values[2 + number % 2] += 3.0  # an outlier
        kept = np.arange(len(values)) % (7 + number) != 5
        gaps = np.where(each.stops % 3 == 0, np.nan, each.gaps)
        readings[code] = Readings(each.stops[kept], values[kept], each.times[kept], gaps[kept])
    run = MeasuredRun(configuration, ("made up",), chains, readings, 11, False)
    chain = made.truth.chain.copy()
    chain[9, 3:] = 0.0
    chain[-1, 3:] = 0.0
    off = np.cos(1.7 * np.arange(chain.size)).reshape(chain.shape) * (0.05, 0.05, 0.3, 0.05, 0.05, 0.3)
    chain += off
    contacts = np.isin(np.arange(16), (2, 3, 5, 6, 8, 10, 11, 14))
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


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("robot", ["disc_that_stops", "polygon", "disc"])
def test_a_filtered_path_is_that_which_was_kept(robot: str) -> None:
    run, _ = run_of(robot)
    first = run.first_stops()[1]
    start = np.array((run.chains[1].start.x, run.chains[1].start.y, run.chains[1].start.heading))
    made = PoseFilter(run, run.spec, start, np.diag((0.3, 0.2, 1.0)), first)
    made.free = frozenset(range(first, first + 5))
    for stop in range(first + 1, run.stops):
        made.advance(stop)
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
    (chord,) = displacements(np.array([[12.0, 0.0, 90.0]]), ARC_SEGMENTS)
    assert abs(chord) == pytest.approx(10.804, abs=0.001)


def test_tests_of_the_model_are_those_that_were_kept() -> None:
    """Of a robot whose drives lose a third, and whose turns end 2 degrees short."""
    made = make(60)
    (chain,) = made.run.chains
    places = np.linspace(-0.5, 0.5, 60).tolist()
    asked = [
        replace(
            each, value=each.value / (1.0 - 0.3 * place) + (2.0 * np.sign(each.value)) * (each.drive == ROT)
        )
        for each, place in zip(chain.movements, places, strict=True)
    ]
    run = replace(made.run, chains=(replace(chain, movements=asked),))
    model = Model(run, parameters_of(run))
    rows = model.rows(made.truth)
    check = check_model(model, made.truth, rows)
    assert check.misfits
    found = {
        "misfits": [
            (each.kind, each.owner, each.unit, each.value, each.low, each.high, each.text)
            for each in check.misfits
        ],
        "shifts": check.shifts,
        "log_shifts": check.log_shifts,
    }
    assert_kept(found, KEPT, "model_check")


@pytest.mark.parametrize(("count", "rank"), [(10, 10), (19, 18), (49, 45), (50, 46)])
def test_the_conformal_factor_is_of_the_rank_that_holds_nine_in_ten(count: int, rank: int) -> None:
    """The rank is that of (count + 1) times 0.9, rounded up; 1.6449 is the normal one."""
    value, _, _ = conformal_factor(np.arange(1.0, count + 1.0))
    assert value == pytest.approx(rank / 1.6448536)


def test_ends_of_a_conformal_factor_are_those_of_the_binomial_distribution() -> None:
    """Of 100 scores 84 to 95 are below the true one with 95 %: the quantiles of scipy.stats.binom."""
    _, low, high = conformal_factor(np.arange(1.0, 101.0))
    assert (low, high) == pytest.approx((84 / 1.6448536, 95 / 1.6448536))


# -- a guided session ----------------------------------------------------------------------------------


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("robot", ["disc", "polygon"])
def test_a_guided_session_asks_for_what_was_kept(robot: str) -> None:
    """Without readings the pose is ever less sure, until no movement is safe."""
    run, _ = run_of(robot)
    guide = SessionPlanner(run.configuration, np.random.default_rng(6))
    asked: list[tuple[str, float, bool]] = []
    guide.settled()
    while len(asked) < 26 and (move := guide.next_move()) is not None:
        drive, amount = move
        asked.append((drive.code, amount, guide.safe(drive, 3 * amount)))
        guide.made(drive, amount, len(asked) % 5 != 4)
        guide.settled()
    found = {
        "asked": asked,
        "pose": structs.astuple(guide.pose),
        "stuck": guide.stuck,
        "looks": guide.looks(),
    }
    assert_kept(found, KEPT, f"guided_{robot}")


def test_turns_of_a_guided_session_go_either_way_by_15_to_120_degrees() -> None:
    """Half a turn there and back comes first, in steps; a robot that can only turn turns on and on."""
    run, _ = run_of("disc")
    drives = tuple(structs.replace(each, enabled=each.kind.turns) for each in run.spec.drives)
    configuration = structs.replace(run.configuration, simulation=structs.replace(run.spec, drives=drives))
    guide = SessionPlanner(configuration, np.random.default_rng(6))
    amounts = []
    for _ in range(30):
        move = guide.next_move()
        assert move is not None
        amounts.append(move[1])
    assert amounts[:7] == [45.0] * 4 + [-60.0] * 3
    drawn = np.array(amounts[7:])
    assert (min(abs(drawn)) >= 15.0, max(abs(drawn)) <= 120.0) == (True, True)
    assert drawn.tolist() == np.round(drawn, 1).tolist()
    assert (drawn > 0).any()
    assert (drawn < 0).any()


# -- suspicions ----------------------------------------------------------------------------------------


def fit_of(run: MeasuredRun, state: Iterate) -> Fit:
    """A fit that has a path, and nothing of what a suspicion does not look at."""
    space, none = parameters_of(run), np.zeros(0)
    model = Model(run, space)
    flags = none.astype(bool)
    return Fit(run, space, state, none, none, none, flags, flags, model.rows(state), none, none, model)


@pytest.mark.parametrize("wrong", ["none", "swapped", "turned", "stuck", "drive"])
def test_suspicions_of_a_robot_that_is_wired_wrongly_are_those_that_were_kept(wrong: str) -> None:
    made = make(40)
    readings, run = dict(made.run.readings), made.run
    if wrong == "swapped":
        readings |= {"u1": readings["u2"], "u2": readings["u1"], "o1": readings["o2"], "o2": readings["o1"]}
    if wrong == "turned":
        for code in ("g1", "c1", "o3"):
            readings[code] = replace(readings[code], values=-readings[code].values)
    if wrong == "stuck":
        for code in ("u3", "g1", "o1"):
            readings[code] = replace(readings[code], values=np.full(41, 7.0))
    run = replace(run, readings=readings)
    if wrong == "drive":
        (chain,) = run.chains
        moves = [
            replace(each, value=each.value * (-1 if each.drive == ROT else 1)) for each in chain.movements
        ]
        drives = tuple(structs.replace(each, gain=1.5) for each in run.spec.drives)
        configuration = structs.replace(
            run.configuration, simulation=structs.replace(run.spec, drives=drives)
        )
        run = replace(run, configuration=configuration, chains=(replace(chain, movements=moves),))
    found = {
        "with": [each.text for each in suspicions(fit_of(run, made.truth))],
        "without": [each.text for each in suspicions_without_path(run)],
    }
    assert_kept(found, KEPT, f"suspicions_{wrong}")


# -- boundaries ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "ahead", "turned", "value"),
    [
        ("o1", 0.49, 0.0, None), ("o1", 0.51, 0.0, "none"), ("c1", 0.49, 2.9, None), ("c1", 0.0, 3.1, "none"),
        ("u1", 0.19, 1.4, None), ("u1", 0.21, 0.0, "none"), ("u1", 0.0, 1.6, "none"), ("g1", 0.4, -2.9, None),
    ],
)  # fmt: skip
def test_a_reading_counts_at_a_stop_that_is_near(
    code: str, ahead: float, turned: float, value: str | None
) -> None:
    """A counter and a compass are set back to the stop by what was commanded since; others are as read."""
    spec = make(2).run.spec
    sensor = next(each for each in spec.sensors if each.code == code)
    stretch = VelocityStretch(spec.drives)
    stretch.drive(Twist(ahead, 0.0, turned), 1.0)
    found = stretch.at_stop(sensor, 8.0)
    if value == "none":
        assert found is None
    elif code in ("g1", "c1"):
        assert found == pytest.approx(8.0 - sensor.gain * turned)
    elif code == "u1":
        assert found == 8.0
    else:
        assert found is not None
        assert abs(found - 8.0) <= sensor.gain * ahead


def test_counters_are_compared_over_six_movements_and_not_over_seven() -> None:
    made = make(13)
    kept = np.array((0, 6, 13))
    one = made.run.readings["g1"]
    readings = {"g1": Readings(one.stops[kept], one.values[kept], one.times[kept], one.gaps[kept])}
    run = replace(made.run, readings=readings)
    rows = Model(run, parameters_of(run)).rows(made.truth)
    assert rows.stop[rows.family == COUNTER].tolist() == [6]


def test_the_interval_of_a_noise_scale_is_by_factors_and_ends_before_it_overflows() -> None:
    space = parameters_of(make(2).run)
    scale = next(each for each in space.noise_scales if each.kind is ParameterKind.NOISE)
    assert scale.interval(2.0, 0.5) == pytest.approx((2.0 * np.exp(-0.979982), 2.0 * np.exp(0.979982)))
    assert scale.interval(2.0, 1000.0) == pytest.approx((2.0 * np.exp(-50.0), 2.0 * np.exp(50.0)))
    bias = space.parameters[0]
    assert bias.interval(2.0, 0.5) == pytest.approx((2.0 - 0.979982, 2.0 + 0.979982))
    assert bias.name == f"{bias.owner} {bias.label}"


def test_priors_of_parameters_are_those_that_were_kept() -> None:
    space = parameters_of(run_of("disc")[0], 2.0)
    found = {
        "all": [
            (each.name, each.field, each.unit, each.present, each.prior, each.spread)
            for each in (*space.parameters, *space.noise_scales)
        ]
    }
    assert_kept(found, KEPT, "priors")
