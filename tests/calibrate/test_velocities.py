"""Logs of robots that drive until the next command, as stretches from one reading to another."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.calibrate.estimates import estimates_of
from simmer_tui.calibrate.fit import fit
from simmer_tui.calibrate.geometry import moved
from simmer_tui.calibrate.measured_run import MeasuredRun, read_runs
from simmer_tui.calibrate.parameters import parameters_of
from simmer_tui.calibrate.posterior import PROCESS, Iterate
from simmer_tui.calibrate.rows import PER_STOP, Model
from simmer_tui.calibrate.stretches import (
    ARC_SEGMENTS,
    LEAST_DISTANCE,
    VelocityStretch,
    prediction,
    share_of_variance,
)
from simmer_tui.config import load_default
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command
from simmer_tui.sim.arcs import Arc, Twist
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import Compass, sensor_of
from simmer_tui.sim.specs import SimulationSpec

DRIVES = load_default().simulation.drives
RIGHT, ROT = (
    next(i for i, each in enumerate(DRIVES) if each.kind.value == name) for name in ("right", "rot")
)


def log(path: Path, texts: Iterable[str], hidden: SimulationSpec | None = None) -> Path:
    """A log of a robot that is `hidden` under the default set."""
    configuration = load_default()
    simulator = Simulator(configuration.simulation if hidden is None else hidden, 7)
    engine = Engine(simulator)
    with RunLog(path, configuration, simulator, clock=lambda: 1.8e9 + simulator.time) as written:
        engine.watch(written)
        session = engine.session()
        for text in texts:
            session.submit(parse_command(text), lambda outcome: None)
    return path


@given(st.floats(1, 8), st.floats(-4, 4), st.floats(-60, 60), st.integers(1, 7))
def test_a_stretch_asks_for_what_its_velocity_leads_over(
    vx: float, vy: float, omega: float, parts: int
) -> None:
    stretch, seconds, twist = VelocityStretch(DRIVES), 1.2, Twist(vx, vy, omega)
    for _ in range(parts):
        stretch.drive(twist, seconds / parts)
    assert stretch.asked == pytest.approx((vx * seconds, vy * seconds, omega * seconds))
    assert abs(stretch.bend) < 0.02
    stretch.drive(Twist(vx, vy, -omega), seconds)
    middle = Arc.of(Pose(0.0, 0.0, 0.0), twist, seconds).end
    end = Arc.of(middle, Twist(vx, vy, -omega), seconds).end
    assert stretch.asked == pytest.approx((2 * vx * seconds, 2 * vy * seconds, 0.0), abs=1e-9)
    there = moved(np.zeros((1, 3)), np.array([stretch.asked]), ARC_SEGMENTS, stretch.bend)[0]
    assert there == pytest.approx((end.x, end.y, end.heading), abs=1e-9)


def test_a_stretch_has_the_distance_of_each_drive() -> None:
    stretch = VelocityStretch(DRIVES)
    stretch.drive(Twist(5.0, 0.0, 20.0), 1.0)
    stretch.drive(Twist(5.0, 0.0, -50.0), 1.0)
    assert dict(stretch.distances) == pytest.approx({RIGHT: 10.0, ROT: -30.0})
    assert stretch.distances[0][0] == RIGHT  # 10 of 12 in are more than 30 of 90 deg
    stretch.clear()
    assert not stretch.has_moved


def test_a_heading_is_corrected_only_of_a_kind_whose_meaning_is_known() -> None:
    class OwnCompass(Compass):
        """A team's own kind, which analyses do not look into."""

        is_opaque = True

    stretch = VelocityStretch(DRIVES)
    stretch.drive(Twist(0.0, 0.0, 20.0), 0.1)
    known = next(each for each in load_default().simulation.sensors if each.kind is Compass)
    assert stretch.at_stop(known, 40.0) == pytest.approx(38.0)
    assert stretch.at_stop(replace(known, kind=OwnCompass), 40.0) is None


def test_its_errors_are_those_of_the_simulator() -> None:
    # The table that the process was chosen by: standard deviations by distance, in those of a command.
    for length, spread in ((3, 3.36), (6, 6.47), (12, 12.0), (24, 21.06)):
        share = float(share_of_variance(np.array([float(length)]), turns=False)[0])
        assert length * share**0.5 == pytest.approx(spread, rel=0.005)
    factor, left = prediction(np.array([3.0, 12.0, 1000.0]), turns=False)
    assert factor[0] > factor[1] > factor[2] > 0.0
    # Over many stretches, in variances of one: what an exponential covariance integrates to.
    assert (left / (1 - factor) ** 2)[:2] == pytest.approx([8.680, 2.718], rel=1e-3)


def test_readings_make_stops_after_enough_way(tmp_path: Path) -> None:
    texts = ["d1-2", "u1", "vv-3.1;0;0"]
    for _ in range(10):
        texts += ["wt-0.5", "u1", "u2"]
    run = read_runs([log(tmp_path / "run.jsonl", [*texts, "vv-0;0;0", "u1", "d1-2", "u1"])])
    kinds = [each.is_continuous for each in run.movements]
    # 15.5 in, cut after 3 in or some more: readings between are left out.
    assert kinds == [False, *[True] * 4, False]
    values = [each.value for each in run.movements[1:5]]
    assert sum(values) == pytest.approx(15.5)
    assert all(LEAST_DISTANCE <= each <= 1.6 * LEAST_DISTANCE for each in values[:-1])
    assert run.readings["u1"].stops.tolist() == [1, 2, 3, 4, 5, 6]
    assert run.readings["u2"].stops.tolist() == [2, 3, 4]


def test_what_a_velocity_led_over_is_kept_without_a_reading(tmp_path: Path) -> None:
    texts = ["u1", "vv-3;0;40", "wt-1", "vv-0;0;0", "d1-2", "u1"]
    first, second = read_runs([log(tmp_path / "run.jsonl", texts)]).movements
    assert first.asked(DRIVES) == pytest.approx((3.0, 0.0, 40.0), abs=0.02)
    assert (second.drive, second.value) == (RIGHT, 2.0)


@pytest.fixture(scope="module")
def continuous(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    texts = ["u1"]
    for _ in range(6):
        for velocity in ("3;0;0", "3;0;20", "3;0;0", "-3;0;-20", "-3;0;0"):
            texts += [f"vv-{velocity}", "wt-1", *("u1", "u2", "u3", "u4", "c1", "o1", "o2", "g1")]
    return read_runs([log(tmp_path_factory.mktemp("logs") / "run.jsonl", texts)])


def test_the_rows_of_stretches_have_their_derivatives(continuous: MeasuredRun) -> None:
    run = continuous
    model = Model(run, parameters_of(run))
    random = np.random.default_rng(3)
    parameters, scales = model.space.start()
    chain = np.zeros((run.stops, PER_STOP))
    chain[:, :3] = (30.0, 20.0, 10.0)
    chain[model.before, 3:] = model.asked + 0.1 * random.standard_normal(model.asked.shape)
    still = np.zeros(len(model.before), bool)
    state = Iterate(chain, parameters, scales, still, still, np.full(len(run.spec.sensors), 0.02))
    rows = model.rows(state)
    mine = np.flatnonzero(rows.family == PROCESS)
    jacobian = rows.jacobian.toarray()[mine]
    for direction in random.standard_normal((6, jacobian.shape[1])):  # in which any wrong element shows
        step = 1e-4 * direction
        end = chain + step[: model.width].reshape(chain.shape)
        there = model.rows(
            Iterate(end, parameters + step[model.width :], scales, still, still, state.outliers)
        )
        slope = (there.residuals[mine] - rows.residuals[mine]) / 1e-4
        assert slope == pytest.approx(jacobian @ direction, abs=1e-6)


def test_errors_that_last_are_taken_out(continuous: MeasuredRun) -> None:
    model = Model(continuous, parameters_of(continuous))
    drive = model.amount * 0.05  # the same error rate all the way
    left = model.innovations(drive)
    for index in set(model.drive.tolist()):
        first, *later = np.flatnonzero(model.drive == index)
        assert left[first] == drive[first]
        assert (np.abs(left[later]) < 0.5 * np.abs(drive[later])).all()


def follower(hidden: SimulationSpec, seconds: float) -> Iterable[str]:
    """Commands of a robot that keeps to the middle between walls and turns before one."""
    simulator = Simulator(hidden, 7)  # the same robot as in the log, asked the same
    codes = ("u1", "u2", "u3", "u4", "u5", "c1", "o1", "o2", "o3", "o4", "g1")
    random = np.random.default_rng(7)
    engine, seen = Engine(simulator), dict.fromkeys(codes, 6.0)
    session = engine.session()

    def ask(text: str) -> str:
        session.submit(parse_command(text), lambda told: seen.update({text: told.reply}))
        return text

    while simulator.time < seconds:
        for code in codes:
            yield ask(code)
        if min(seen["u1"], seen["u5"]) < 5:
            yield ask(f"vv-0;0;{50 if seen['u2'] > seen['u4'] else -50}")
            for _ in range(int(random.integers(6, 22))):
                yield ask("wt-0.1")
                for code in codes:
                    yield ask(code)
        else:
            steer = float(np.clip(4 * (min(seen["u2"], 12) - min(seen["u4"], 12)), -25, 25))
            yield ask(f"vv-5;0;{steer:.1f}")
            yield ask("wt-0.2")
    yield ask("vv-0;0;0")


@pytest.mark.slow
def test_a_robot_that_drives_by_velocities_is_learned(tmp_path: Path) -> None:
    base = load_default().simulation
    drives = []
    for each in base.drives:
        small = 0.1 if each.kind.turns else 1.0
        bias = replace(each.bias, x=-0.06 * small, y=0.02 * small, r=0.3 * small)
        error = replace(each.error, x=0.03 * small, y=0.02 * small, r=0.2 * small)
        drives.append(replace(each, bias=bias, error=error))
    hidden = replace(base, drives=tuple(drives), randbias=False)
    found = fit(read_runs([log(tmp_path / "run.jsonl", follower(hidden, 200.0), hidden)]))
    told = {(each.owner, each.field): each for each in estimates_of(found) if each.identified}
    true = {"right": hidden.drives[RIGHT], "rot": hidden.drives[ROT]}
    held = []
    for (owner, field), each in told.items():
        if owner in true:
            table, axis = field.split(".")
            value = getattr(getattr(true[owner], table), axis)
            held.append(each.low <= value <= each.high)
            if (owner, field) in {("right", "error.x"), ("rot", "error.r")}:
                assert 0.6 < each.value / value < 1.6
    assert ("right", "bias.x") in told
    assert ("rot", "bias.r") in told
    assert np.mean(held) >= 0.75


def test_sensors_that_are_asked_one_after_the_other_tell_of_one_stop(tmp_path: Path) -> None:
    base = load_default().simulation
    sensors = [replace(each, read_time=0.02, error=0.0, absolute_error=0.0) for each in base.sensors]
    drives = [replace(each, error=replace(each.error, x=0.0, y=0.0, r=0.0)) for each in base.drives]
    hidden = replace(base, sensors=tuple(sensors), drives=tuple(drives), randbias=False)
    texts = ["u1", "g1", "o1", "vv-0.5;0;50"]
    for _ in range(20):
        texts += ["u1", "u2", "g1", "o1", "wt-0.1"]
    run = read_runs([log(tmp_path / "run.jsonl", texts, hidden)])
    for code, sensor in (("g1", "g1"), ("o1", "o1")):
        row = next(each for each in base.sensors if each.code == sensor)
        lever = sensor_of(row).lever  # type: ignore[attr-defined]
        counted = np.diff([value for value, _ in run.values_at_stops[code].values()])
        stops = list(run.values_at_stops[code])
        asked = [sum(run.movements[k].asked(DRIVES) @ lever for k in range(a, b)) for a, b in pairwise(stops)]
        assert counted == pytest.approx(asked, abs=0.02)
    # Not always the same sensor comes first.
    one, other = (set(run.readings[code].stops.tolist()) for code in ("u1", "u2"))
    assert one != other
