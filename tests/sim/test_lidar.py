"""The lidar: each ray at its own moment and pose, one draw a revolution, and what it waits for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim import Pose, Reading, SimulationSpec, Simulator
from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.noise import stream
from simmer_tui.sim.records import LidarScan, Status
from simmer_tui.sim.sensors import Lidar, LidarSpec

LIDAR = LidarSpec(kind=Lidar, number=1, code="sc", x=1.5, y=-0.7, z=2.0, rotation=20.0)
EXACT = replace(LIDAR, error=0.0, dropout=0.0, resolution=0.0, min_range=0.0, max_range=math.inf)
SPEC = replace(load(bundled_folder() / "mission").simulation, bot_center=(66.0, 18.0), bot_rot=33.0)
PLACE = Pose(SPEC.bot_center[0], SPEC.bot_center[1], SPEC.bot_rot)
Look = Callable[[float], None]


def made(lidar: LidarSpec = EXACT, seed: int = 5, **changes: Any) -> Simulator:
    spec: SimulationSpec = replace(SPEC, sensors=(*SPEC.sensors, lidar), **changes)
    return Simulator(spec, seed)


def begun(simulator: Simulator) -> LidarScan:
    """The scan that there is now, without a wait."""
    reading = simulator.begin("sc").reading
    assert reading is not None
    assert reading.scan is not None
    return reading.scan


def read(simulator: Simulator, text: str = "sc") -> Reading:
    reading = simulator.execute(text).reading
    assert reading is not None
    return reading


def scanned(simulator: Simulator, text: str = "sc") -> LidarScan:
    scan = read(simulator, text).scan
    assert scan is not None
    return scan


def follow(simulator: Simulator, program: Sequence[str], moments: Sequence[float], look: Look) -> None:
    """Go through a program, and look at each of some ascending simulated times on the way."""
    left = list(moments)

    def until(time: float) -> None:
        while left and left[0] <= time:
            simulator.advance(left[0])
            look(left.pop(0))
        simulator.advance(time)

    until(simulator.time)
    for text in program:
        word, *numbers = text.split()
        if word == "wait":
            until(simulator.time + float(numbers[0]))
        elif word == "block":
            simulator.move_block(float(numbers[0]), float(numbers[1]))
        else:
            outcome = simulator.begin(text)
            assert outcome.status is not Status.REFUSED, outcome.reason
            if outcome.status is Status.ACCEPTED:
                assert simulator.trajectory is not None
                until(simulator.trajectory.end_time)


HELD: dict[str, Any] = {"block_center": (66.5, 23.0), "bot_rot": 90.0}


def no_look(time: float) -> None:
    """Nothing."""


def each_ray_alone(
    program: Sequence[str], lidar: LidarSpec = EXACT, **changes: Any
) -> tuple[LidarScan, list[float]]:
    """A scan at the end of a program, and its rays each cast alone, by a robot that goes through the same
    program and is looked at at the moment of each ray."""
    simulator = made(lidar, **changes)
    follow(simulator, program, (), no_look)
    scan = scanned(simulator)
    times = [(scan.revolution + ray / lidar.rays) / lidar.scan_rate for ray in range(lidar.rays)]
    twin, alone = made(lidar, **changes), []

    def look(time: float) -> None:
        pose, ray = twin.pose, len(alone)
        assert (pose.x, pose.y, pose.heading) == tuple(scan.poses[ray].tolist())
        cos, sin = cos_sin(pose.heading)
        place = (pose.x + cos * lidar.x - sin * lidar.y, pose.y + sin * lidar.x + cos * lidar.y)
        bearing = pose.heading + (lidar.rotation - ray * 360.0 / lidar.rays)
        alone.append(float(twin.cast_rays(np.array([place]), np.array([bearing]), lidar.z)[0]))

    follow(twin, program, times, look)
    return scan, alone


CASES = {
    "at rest from time 0": [],
    "an arc at 1000.3": ["wait 999.6", "vv-4;0;-60", "wait 0.7"],
    "across movements": ["wait 1000.3", "d1-1", "r1-20", "d1-0.7"],
    "ended by a stop": ["vv-6;0;40", "wait 0.35", "d1-0.3", "vv-0;0;-50", "wait 0.1"],
    "into a wall": ["vv-8;0;15", "wait 2.2"],
    "a movement into a wall": ["d1-14"],
    "a block put down": ["vv-0;0;90", "wait 0.3", "block 78 30", "wait 0.05"],
    "at rest": ["wait 1000.3"],
    "turning": ["vv-0;0;126.5", "wait 1.03"],
    "driving": ["vv-6;0;0", "wait 0.7"],
    "an arc": ["vv-6;2;60", "wait 0.7"],
    "amid a short movement": ["wait 0.3", "r1-7"],
    "movement, then rest": ["r1-40", "wait 0.09"],
}


@pytest.mark.quick_cases(7)
@pytest.mark.parametrize("name", CASES)
def test_a_scan_is_each_ray_alone_from_where_the_robot_was_at_its_moment(name: str) -> None:
    scan, alone = each_ray_alone(CASES[name])
    assert len(alone) == EXACT.rays
    assert np.abs(scan.true - alone).max() == 0.0
    assert np.abs(scan.ranges - alone).max() == 0.0


def test_a_block_in_the_gripper_goes_with_the_robot() -> None:
    simulator = made(**HELD)
    assert not simulator.holding
    simulator.execute("p1-1")
    assert simulator.holding
    program = ["p1-1", "vv-1;0;70", "wait 0.3", "p1-0"]
    scan, alone = each_ray_alone(program, **HELD)
    assert np.abs(scan.true - alone).max() == 0.0
    free, _ = each_ray_alone(program, replace(EXACT, z=9.0), **HELD)
    assert (free.true > scan.true).any()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("name", ["across movements", "amid a short movement"])
def test_movements_that_speed_up_and_oblique_faces_without_an_echo(name: str) -> None:
    drives = tuple(replace(drive, acceleration=40.0, start_lag=0.05) for drive in SPEC.drives)
    scan, alone = each_ray_alone(CASES[name], drives=drives)
    assert np.abs(scan.true - alone).max() == 0.0
    silent, _ = each_ray_alone(CASES[name], replace(EXACT, incidence_limit=60.0), drives=drives)
    heard = np.isfinite(silent.ranges)
    assert 0 < heard.sum() < EXACT.rays
    assert (silent.ranges[heard] == scan.ranges[heard]).all()


legs = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-150, 150), st.floats(0.01, 0.4)).map(
    lambda leg: ["vv-" + ";".join(f"{each:.6f}" for each in leg[:3]), f"wait {leg[3]}"]
)
movements = st.sampled_from(["d1-0.6", "a1-2", "w1-1.1", "r1--15", "r1-200", "wait 0.07"]).map(
    lambda each: [each]
)


@settings(max_examples=12, deadline=None)
@given(
    st.lists(legs | movements, min_size=1, max_size=5),
    st.sampled_from([1.0, 5.5, 20.0]),
    st.sampled_from([0.0, 1000.3]),
)
def test_any_way_gives_each_ray_alone(parts: list[list[str]], rate: float, start: float) -> None:
    program = [f"wait {start}", *(text for part in parts for text in part)]
    scan, alone = each_ray_alone(program, replace(EXACT, rays=36, scan_rate=rate))
    assert np.abs(scan.true - alone).max() == 0.0


def test_a_lidar_beside_the_centre_goes_round_it_while_the_robot_turns_on_the_spot() -> None:
    """Also where the first heading, in degrees, is the number of inches of a coordinate."""
    headings = np.array([30.0, 75.0, 120.0])
    x, y = Lidar(EXACT).origins(np.column_stack((np.full(3, 30.0), np.full(3, 30.0), headings)))
    distance, direction = math.hypot(1.5, 0.7), math.degrees(math.atan2(-0.7, 1.5))
    assert np.hypot(x - 30.0, y - 30.0) == pytest.approx(distance)
    assert np.degrees(np.arctan2(y - 30.0, x - 30.0)) == pytest.approx(headings + direction)


def test_the_last_complete_revolution_counts_from_time_0() -> None:
    simulator = made()
    assert scanned(simulator).revolution == -1
    for time, revolution in ((0.1, -1), (1 / 5.5, 0), (0.5, 1), (1000.3, 5500), (1000.37, 5501)):
        simulator.advance(time)
        assert begun(simulator).revolution == revolution


def test_one_revolution_says_the_same_again_and_draws_once() -> None:
    simulator = made(LIDAR)
    simulator.advance(0.5)
    first, again = simulator.begin("sc").reading, begun(simulator)
    assert first is not None
    assert first.scan is again
    assert first.value == again.ranges[0]
    simulator.advance(0.6)
    once = made(LIDAR)
    once.advance(0.5)
    once.begin("sc")
    once.advance(0.6)
    assert (begun(once).ranges == begun(simulator).ranges).all()


def test_errors_are_drawn_sort_by_sort_from_its_own_stream() -> None:
    lidar = replace(LIDAR, absolute_error=0.2, dropout=0.1, bias=0.5, gain=1.1)
    scan = scanned(made(lidar, seed=11))
    random = stream(11, "lidar1")
    percent, absolute = random.standard_normal(360), random.standard_normal(360)
    missed = random.random(360) < 0.1
    expected = np.maximum(scan.true * (1 + 0.01 * percent) * 1.1 + 0.2 * absolute + 0.5, 5.9)
    expected = np.where(missed, math.inf, np.rint(expected / 0.01) * 0.01)
    assert scan.ranges == pytest.approx(expected, abs=1e-9)
    assert np.isinf(scan.ranges).any()
    quiet = made(lidar, seed=11)
    quiet.noise = False
    assert np.isfinite(scanned(quiet).ranges).all()


def test_other_sensors_read_as_they_did_without_a_lidar() -> None:
    plain, beside = Simulator(replace(SPEC, sensors=SPEC.sensors), 5), made()
    for text in ("u1", "t1", "d1-1", "c1", "u3", "o3"):
        beside.begin("sc")
        assert plain.execute(text).reply == beside.execute(text).reply


def test_ranges_are_whole_steps_within_the_limits_and_what_is_beyond_is_missed() -> None:
    simulator = made(replace(EXACT, resolution=0.25, min_range=5.9, max_range=20.0))
    scan = scanned(simulator)
    finite = np.isfinite(scan.ranges)
    assert (np.rint(scan.ranges[finite] / 0.25) * 0.25 == scan.ranges[finite]).all()
    assert scan.ranges.min() == 6.0
    assert (finite == (np.rint(np.maximum(scan.true, 5.9) / 0.25) * 0.25 <= 20.0)).all()
    zeros = scanned(made(replace(EXACT, max_range=20.0, missed_as_zero=True)))
    assert (zeros.ranges[~(zeros.true <= 20.0)] == 0.0).all()


def test_a_bearing_asks_for_the_ray_nearest_to_it() -> None:
    for clockwise in (True, False):
        simulator = made(replace(EXACT, clockwise=clockwise))
        scan = scanned(simulator)
        for bearing in (20, 20.4, 20.6, -20, 200, 379.7, 90, -1000.3):
            reading = read(simulator, f"sc-{bearing}")
            off = (scan.bearings - bearing + 180.0) % 360.0 - 180.0
            assert reading.scan is None
            nearest = int(np.abs(off).argmin())
            assert abs(off[nearest]) <= 0.5
            assert reading.value == begun(simulator).ranges[nearest]


def test_any_finite_bearing_is_a_direction() -> None:
    simulator = made(replace(EXACT, rays=2000))
    scan = scanned(simulator)
    for bearing in (1e308, -1e308, 1e9, -1e-320):
        value = read(simulator, f"sc-{bearing:.20g}").value
        assert value == begun(simulator).ranges[int(turned_least(scan, math.fmod(bearing, 360.0)))]


def turned_least(scan: LidarScan, bearing: float) -> np.intp:
    """The ray of a scan that is nearest to a bearing."""
    return np.abs((scan.bearings - bearing + 180.0) % 360.0 - 180.0).argmin()


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("sc-x", "is not a finite decimal number"),
        ("sc-", "the value is missing, as in sc-90"),
        ("sc-1e999", "no direction"),
    ],
)
def test_a_bearing_that_is_no_number_is_refused(text: str, what: str) -> None:
    simulator = made()
    outcome = simulator.execute(text)
    assert outcome.status is Status.REFUSED
    assert math.isnan(outcome.reply)
    assert what in outcome.reason
    assert simulator.time == 0.0


def test_what_has_been_read_is_waited_for_in_instant_motion() -> None:
    simulator = made()
    simulator.advance(0.3)
    assert scanned(simulator).revolution == 0
    assert simulator.time == 0.3
    # Each ray counts by itself, so that a program may ask for all of them one by one.
    for bearing in (0, 90, 180, 270):
        read(simulator, f"sc-{bearing}")
    assert simulator.time == 0.3
    read(simulator, "sc-90")
    assert simulator.time == 2 / 5.5
    assert scanned(simulator).revolution == 1
    assert simulator.time == 2 / 5.5


def test_a_read_time_of_its_own_is_taken_and_nothing_waited_for() -> None:
    simulator = made(replace(EXACT, read_time=0.02))
    simulator.advance(0.3)
    times = []
    for _ in range(3):
        scanned(simulator)
        times.append(simulator.time)
    assert times == pytest.approx([0.32, 0.34, 0.36])


def test_a_robot_put_elsewhere_counts_as_if_it_had_stood_there() -> None:
    simulator = made()
    simulator.execute("vv-6;0;60")
    simulator.advance(0.7)
    simulator.teleport(PLACE)
    still = made()
    still.advance(0.7)
    assert (scanned(simulator).true == scanned(still).true).all()
    # What was read of a revolution counts no more.
    simulator.teleport(Pose(66.0, 30.0, 10.0))
    assert simulator.execute("sc-20").time == 0.7
    assert begun(simulator).poses[0].tolist() == [66.0, 30.0, 10.0]
    simulator.reset()
    assert scanned(simulator).revolution == -1
