"""The pose filter at walls and after it lost the robot, and the particle filter: worked examples."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from simmer_tui.calibrate.find_path import PathFinder
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun, Readings
from simmer_tui.calibrate.pose_filter import PoseFilter
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import ObservingSensor, sensor_of
from simmer_tui.sim.specs import Axes, SimulationSpec
from tests.calibrate.synthetic import Synthetic, make

EAST_WALL = 96.0
RADIUS = 3.0
RIGHT, ROT = 3, 4
LOST_POSE = (30.9631932, 20.1228102, 10.2512322)
LOST_SPREAD = (0.1482811, 0.1615156, 0.4847985)
MENDED_POSE = (37.3156775, 21.1800331, 9.9321565)
PATH = (
    (39.54448, 30.52888, 19.09422),
    (35.24300, 26.39268, 56.39002),
    (36.68666, 31.26770, 51.50169),
)
PATH_FIT = -1.7580940
WALL_PATH = (
    (91.69137, 20.74302, -1.62418),
    (93.02366, 20.83369, 0.37534),
    (93.05629, 20.88700, 39.53855),
    (91.34252, 19.37196, 37.82425),
    (93.12346, 20.84196, 40.30247),
)
WALL_FIT = -1.2308836
"""Rows of the drives that go ahead and that turn."""


@pytest.fixture(scope="module")
def known() -> Synthetic:
    return make(12)


def without_bias(spec: SimulationSpec) -> SimulationSpec:
    drives = tuple(structs.replace(each, bias=Axes(0.0, 0.0, 0.0)) for each in spec.drives)
    return structs.replace(spec, drives=drives)


def filter_at(
    known: Synthetic, pose: tuple[float, float, float], *movements: tuple[int, float]
) -> PoseFilter:
    """A filter of a robot without biases or readings, which is to make these movements (drive and value)."""
    spec = without_bias(known.run.spec)
    assert spec.robot.radius == RADIUS
    made = [MeasuredMovement(drive, value, True, 2 + k, 1.0) for k, (drive, value) in enumerate(movements)]
    configuration = structs.replace(known.run.configuration, simulation=spec)
    run = MeasuredRun(configuration, ("made up",), (Chain(Pose(*pose), 1, made),), {}, None, False)
    return PoseFilter(run, spec, np.array(pose), np.diag((0.04, 0.09, 4.0)), 0)


def grown(known: Synthetic, asked: float, gone: float) -> FloatArray:
    """The covariance of `filter_at` after a drive ahead along x, if no wall is met."""
    error = known.run.spec.drives[RIGHT].error
    across = np.eye(3)
    across[1, 2] = math.radians(gone)
    noise = np.diag(np.square([asked * error.x, asked * error.y, asked * error.r]) + 1e-8)
    return np.asarray(across @ np.diag((0.04, 0.09, 4.0)) @ across.T + noise)


# -- walls -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [1.0, 1.4, 2.9])
def test_a_movement_ends_where_the_wall_is(known: Synthetic, gap: float) -> None:
    """Of 4 in ahead only `gap` are free; the pose is less sure by 0.3 in and a fifth of what was left."""
    made = filter_at(known, (EAST_WALL - RADIUS - gap, 20.0, 0.0), (RIGHT, 4.0))
    made.advance(1)
    assert made.pose == pytest.approx((EAST_WALL - RADIUS, 20.0, 0.0), abs=1e-9)
    left = 1.0 - gap / 4.0
    shifted = np.diag((0.3 + 0.2 * left, 0.3 + 0.2 * left, 0.3)) ** 2
    assert made.covariance == pytest.approx(grown(known, 4.0, gap) + shifted, abs=1e-9)


@pytest.mark.parametrize("gap", [4.0, 3.96])
def test_a_wall_that_is_only_just_touched_is_none(known: Synthetic, gap: float) -> None:
    """Poses are off by 0.05 in at a wall."""
    made = filter_at(known, (EAST_WALL - RADIUS - gap, 20.0, 0.0), (RIGHT, 4.0))
    made.advance(1)
    assert made.pose == pytest.approx((EAST_WALL - RADIUS - gap + 4.0, 20.0, 0.0), abs=1e-9)
    assert made.covariance == pytest.approx(grown(known, 4.0, 4.0), abs=1e-9)


def test_a_robot_that_stands_in_a_wall_may_leave_it_but_goes_no_deeper(known: Synthetic) -> None:
    inside = EAST_WALL - RADIUS + 0.2
    out = filter_at(known, (inside, 20.0, 180.0), (RIGHT, 4.0))
    out.advance(1)
    assert out.pose[0] == pytest.approx(inside - 4.0)
    along = filter_at(known, (inside, 20.0, 90.0), (RIGHT, 4.0))
    along.advance(1)
    assert along.pose[:2] == pytest.approx((inside, 24.0))
    deeper = filter_at(known, (inside, 20.0, 0.0), (RIGHT, 4.0))
    deeper.advance(1)
    assert deeper.pose[:2] == pytest.approx((inside, 20.0))


def test_a_turn_on_the_spot_meets_no_wall(known: Synthetic) -> None:
    made = filter_at(known, (EAST_WALL - RADIUS + 0.2, 20.0, 0.0), (ROT, 40.0))
    made.advance(1)
    assert made.pose == pytest.approx((EAST_WALL - RADIUS + 0.2, 20.0, 40.0))


def test_a_gyro_tells_the_turn_that_a_wall_left(known: Synthetic) -> None:
    spec = next(each for each in known.run.spec.sensors if each.kind.name == "gyro")
    made = filter_at(known, (EAST_WALL - RADIUS - 1.0, 20.0, 0.0), (RIGHT, 4.0))
    made.values_at_stops["g1"] = {0: (10.0, 0.0), 1: (10.0 + 3.0 * spec.gain + 2.0 * spec.drift, 2.0)}
    made.advance(1)
    assert made.pose[2] == pytest.approx(3.0)
    assert made.pose[0] == pytest.approx(EAST_WALL - RADIUS, abs=0.02)


def test_an_unanswered_movement_may_have_been_made_or_not(known: Synthetic) -> None:
    made = filter_at(known, (40.0, 20.0, 0.0), (RIGHT, 4.0))
    made.movements[1] = replace(made.movements[1], certain=False)
    made.advance(1)
    expected = grown(known, 4.0, 4.0)
    expected[0, 0] += 16.0
    assert made.covariance == pytest.approx(expected, abs=1e-9)


# -- predictions -------------------------------------------------------------------------------------


def test_movements_ahead_are_counted_from_where_the_filter_was(known: Synthetic) -> None:
    """Three movements ahead by 3 in, of which the encoder that rolls along them counted 2.9 each; it has a
    gain of its own. One movement ahead it is off by that, and five ahead there is nothing to compare."""
    made = filter_at(known, (20.0, 30.0, 0.0), *[(RIGHT, 3.0)] * 3)
    wheel = next(each for each in known.run.spec.sensors if each.kind.name == "odom" and each.rotation == 0.0)
    made.values_at_stops[wheel.code] = {
        stop: ((wheel.gain * 2.9 + 2.0 * wheel.drift) * stop, 2.0 * stop) for stop in range(4)
    }
    for stop in (1, 2, 3):
        made.advance(stop)
    assert made.errors[wheel.kind, 1] == pytest.approx([wheel.gain * 0.1] * 3)
    assert made.errors[wheel.kind, 0] == pytest.approx([wheel.gain * 0.1] * 3)
    assert not made.errors[wheel.kind, 5]


def test_only_errors_in_degrees_are_those_of_the_shorter_way_round(known: Synthetic) -> None:
    """A wheel that counted 200 in is wrong by these, and a gyro that counted 200 degrees by -160."""
    made = filter_at(known, (20.0, 30.0, 0.0), (RIGHT, 0.0))
    for code in ("o1", "g1"):
        made.values_at_stops[code] = {0: (0.0, 0.0), 1: (200.0, 0.0)}
    made.advance(1)
    off = {kind.name: errors for (kind, ahead), errors in made.errors.items() if ahead == 1}
    assert off["odom"] == pytest.approx([200.0])
    assert off["gyro"] == pytest.approx([160.0])


def test_a_reading_five_movements_ahead_is_predicted_by_commands_alone(known: Synthetic) -> None:
    made = filter_at(known, (20.0, 30.0, 0.0), *[(RIGHT, 1.0)] * 6)
    compass = next(each for each in known.run.spec.sensors if each.kind.name == "comp")
    flat = structs.replace(compass, hard_iron=0.0, soft_iron=0.0, bias=0.0, drift=0.0)
    sensors = tuple(flat if each is compass else each for each in made.spec.sensors)
    spec = structs.replace(made.spec, sensors=sensors)
    made = PoseFilter(made.run, spec, made.pose, made.covariance, 0)
    made.values_at_stops["c1"] = {5: (7.0, 1.0), 6: (357.0, 1.0)}
    for stop in range(1, 7):
        made.advance(stop)
    assert made.errors[compass.kind, 5][0] == pytest.approx(7.0)
    # The reading of 7 degrees has turned the filter's pose of stop 5, not that of stop 1.
    assert made.errors[compass.kind, 5][1] == pytest.approx(3.0)
    assert 3.0 < made.errors[compass.kind, 1][1] < 10.0


# -- searches ----------------------------------------------------------------------------------------
# A fixed seed makes an example of each. Whoever changes how it searches finds other numbers here, and is to
# see to it that the new ones are no farther off.


def ranges_at(known: Synthetic, spec: SimulationSpec, pose: FloatArray, time: float) -> dict[str, float]:
    """Readings of the range sensors at a pose, by code."""
    sensors = [sensor_of(each) for each in spec.sensors if each.kind.is_range]
    world = known.model.world
    return {
        each.spec.code: float(each.expected(world, pose[None], time)[0])
        for each in sensors
        if isinstance(each, ObservingSensor)
    }


def test_a_lost_pose_is_found_by_an_example(known: Synthetic) -> None:
    """Something that no map shows stopped the robot after 1 of 9 in, facing 10 degrees."""
    made = filter_at(known, (30.0, 20.0, 10.0), (RIGHT, 9.0))
    angle = math.radians(10.0)
    stands = np.array([30.0 + math.cos(angle), 20.0 + math.sin(angle), 10.0])
    for code, value in ranges_at(known, made.spec, stands, 2.0).items():
        made.values_at_stops[code] = {1: (value, 2.0)}
    made.advance(1)
    assert made.pose == pytest.approx(LOST_POSE, abs=1e-6)
    assert np.sqrt(np.diag(made.covariance)) == pytest.approx(LOST_SPREAD, abs=1e-6)
    assert np.hypot(*(made.pose - stands)[:2]) < 0.2


def test_a_pose_that_is_a_little_off_is_not_searched_for(known: Synthetic) -> None:
    """It is 1.6 in off, which ranges mend by the usual way: what they leave follows from the spreads."""
    made = filter_at(known, (30.0, 20.0, 10.0), (RIGHT, 9.0))
    angle = math.radians(10.0)
    stands = np.array([30.0 + 7.4 * math.cos(angle), 20.0 + 7.4 * math.sin(angle), 10.0])
    for code, value in ranges_at(known, made.spec, stands, 2.0).items():
        made.values_at_stops[code] = {1: (value, 2.0)}
    made.advance(1)
    assert made.pose == pytest.approx(MENDED_POSE, abs=1e-6)
    assert np.hypot(*(made.pose - stands)[:2]) < 0.2


def test_a_pose_is_not_searched_for_by_sensors_that_see_a_moved_block(known: Synthetic) -> None:
    """Nobody knows what they should read, however far it is from what they would without the block."""
    made = filter_at(known, (30.0, 20.0, 10.0), (RIGHT, 4.0))
    moved = replace(made.run, block_moved_at=0)
    spec = structs.replace(made.spec, block_size=4.0)
    made = PoseFilter(moved, spec, made.pose, made.covariance, 0)
    ranging = [each.code for each in spec.sensors if each.kind.is_range]
    made.values_at_stops.update({code: {1: (5.0, 2.0)} for code in ranging})
    made.advance(1)
    angle = math.radians(10.0)
    there = (30.0 + 4.0 * math.cos(angle), 20.0 + 4.0 * math.sin(angle), 10.0)
    assert made.pose == pytest.approx(there)


def test_a_path_is_found_by_an_example(known: Synthetic) -> None:
    """By wheels, gyro and ranges, from 60 particles."""
    path = PathFinder(known.run).find(known.run.chains[0], 0, 60, np.random.default_rng(7), wide=1.5)
    assert path.poses[[0, 5, 12]] == pytest.approx(np.array(PATH), abs=1e-4)
    assert path.fit == pytest.approx(PATH_FIT, abs=1e-6)
    assert not path.contacts.any()


def test_a_path_along_a_wall_is_found_by_an_example(known: Synthetic) -> None:
    """By ranges alone: 4 in ahead of which 1 was free, a turn, 3 in back without an answer, 5 in ahead."""
    movements = ((RIGHT, 4.0), (ROT, 40.0), (RIGHT, -3.0), (RIGHT, 5.0))
    run = filter_at(known, (EAST_WALL - RADIUS - 1.0, 20.0, 0.0), *movements).run
    chain = run.chains[0]
    unsure = [*chain.movements[:2], replace(chain.movements[2], certain=False), chain.movements[3]]
    stands = [(92.0, 20.0, 0.0), (93.0, 20.0, 0.0), (93.0, 20.0, 40.0)]
    stands += [(93.0 - 3 * math.cos(math.radians(40)), 20.0 - 3 * math.sin(math.radians(40)), 40.0)]
    stands += [(93.0, 20.0 + 2 * math.sin(math.radians(40)), 40.0)]
    seen = [ranges_at(known, run.spec, np.array(pose), 2.0 * k) for k, pose in enumerate(stands)]
    stops, times = np.arange(5), 2.0 * np.arange(5)
    readings = {
        code: Readings(stops, np.array([each[code] for each in seen]), times, np.full(5, np.nan))
        for code in seen[0]
    }
    run = replace(run, chains=(replace(chain, movements=unsure),), readings=readings)
    path = PathFinder(run).find(run.chains[0], 0, 200, np.random.default_rng(3), wide=0.5)
    assert path.poses == pytest.approx(np.array(WALL_PATH), abs=1e-4)
    assert path.fit == pytest.approx(WALL_FIT, abs=1e-6)
    assert path.contacts.tolist() == [True, True, False, True]
    assert np.hypot(*(path.poses - np.array(stands))[:, :2].T).max() < 1.5
