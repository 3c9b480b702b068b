"""Faults of readings: each column, how often and how far it strikes, and that its absence changes
nothing. The formulas and their sources are in docs/sensors.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.sim import (
    Block,
    Compass,
    Gyro,
    LineSensor,
    Maze,
    MazeSpec,
    Odometer,
    Pose,
    RangeSensor,
    SensorSpec,
    SimulationSpec,
    Simulator,
    Status,
    TimeOfFlight,
    Ultrasonic,
    World,
)
from simmer_tui.sim.sensors import CompassSpec, GyroSpec, LineSpec, OdometerSpec, UltrasonicSpec

COUNT = 3_000
ULTRA = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", z=6.0, rays=1)


def with_sensors(spec: SimulationSpec, *sensors: SensorSpec, seed: int = 3, **changes: Any) -> Simulator:
    return Simulator(replace(spec, sensors=sensors, **changes), seed)


def assert_distributed(draws: Sequence[float], share_below: Callable[[float], float]) -> None:
    """Kolmogorov-Smirnov at a level of one in a thousand."""
    ordered = np.sort(np.asarray(draws))
    expected = np.array([share_below(value) for value in ordered.tolist()])
    steps = np.arange(len(ordered) + 1) / len(ordered)
    distance = max((steps[1:] - expected).max(), (expected - steps[:-1]).max())
    assert distance < 1.95 / math.sqrt(len(ordered))


def assert_as_often(times: int, probability: float) -> None:
    """Within 3.3 standard deviations of the expected number: one in a thousand is outside."""
    spread = math.sqrt(COUNT * probability * (1 - probability))
    assert abs(times - COUNT * probability) < 3.3 * spread


# -- absent means as before ------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {"dropout": 0.3},
        {"outlier": 0.3},
        {"read_time": 0.06},
        {"cross_talk": 1.0, "read_time": 0.06},
        {"incidence_limit": 1.0},
    ],
)
def test_one_sensors_faults_change_no_other_nor_its_own_errors(
    noisy_spec: SimulationSpec, changes: dict[str, float]
) -> None:
    faulty = replace(
        noisy_spec,
        sensors=tuple(replace(s, **changes) if s.code == "u3" else s for s in noisy_spec.sensors),
    )
    plain, struck = Simulator(noisy_spec, 5), Simulator(faulty, 5)
    same = 0
    for command in ("u3", "u1", "i1", "d1-2", "u3", "c1", "o1", "g1", "r1-20", "u3", "u2", "t1") * 10:
        before, after = plain.execute(command), struck.execute(command)
        if command != "u3":
            assert after.reply == before.reply
        same += command == "u3" and after.reply == before.reply
    assert plain.pose == struck.pose
    if "incidence_limit" not in changes:
        assert same > 5, "what is not struck errs as it did"


# -- how often, and where --------------------------------------------------------------------


def test_readings_drop_out_as_often_as_the_column_says(course_spec: SimulationSpec) -> None:
    simulator = with_sensors(course_spec, replace(ULTRA, dropout=0.03))
    true = simulator.true_value("u1")
    replies = [simulator.execute("u1").reply for _ in range(COUNT)]
    assert set(replies) == {true, math.inf}
    assert_as_often(replies.count(math.inf), 0.03)


def test_outliers_are_anywhere_in_the_range(course_spec: SimulationSpec) -> None:
    sensor = replace(ULTRA, outlier=1.0, min_range=2.0, max_range=102.0)
    simulator = with_sensors(course_spec, sensor)
    draws = [simulator.execute("u1").reply for _ in range(COUNT)]
    assert_distributed(draws, lambda value: (value - 2.0) / 100.0)


def test_outliers_strike_as_often_as_the_column_says(course_spec: SimulationSpec) -> None:
    simulator = with_sensors(course_spec, replace(ULTRA, outlier=0.2, dropout=0.1))
    true = simulator.true_value("u1")
    replies = [simulator.execute("u1").reply for _ in range(COUNT)]
    assert_as_often(replies.count(math.inf), 0.1)
    assert_as_often(COUNT - replies.count(true) - replies.count(math.inf), 0.9 * 0.2)


def test_a_line_sensors_outliers_are_yes_or_no_and_of_an_analog_one_any_fraction(
    course_spec: SimulationSpec,
) -> None:
    sensor = LineSpec(
        kind=LineSensor, number=1, code="i1", z=1.0, field_of_view=40, threshold=0.5, outlier=1.0
    )
    simulator = with_sensors(course_spec, sensor)
    assert_as_often(sum(simulator.execute("i1").reply == 1.0 for _ in range(COUNT)), 0.5)
    simulator = with_sensors(course_spec, replace(sensor, analog=True))
    assert_distributed([simulator.execute("i1").reply for _ in range(COUNT)], lambda value: value)


def test_a_compasss_outliers_are_all_around(course_spec: SimulationSpec) -> None:
    sensor = CompassSpec(kind=Compass, number=1, code="c1", outlier=1.0)
    simulator = with_sensors(course_spec, sensor)
    assert_distributed([simulator.execute("c1").reply for _ in range(COUNT)], lambda value: value / 360.0)
    assert with_sensors(course_spec, replace(sensor, dropout=1.0)).execute("c1").reply == 0.0


def test_without_noise_nothing_strikes(course_spec: SimulationSpec) -> None:
    gyro = GyroSpec(kind=Gyro, number=1, code="g1", random_walk=5.0)
    simulator = with_sensors(course_spec, replace(ULTRA, dropout=0.5, outlier=0.5), gyro)
    simulator.noise = False
    simulator.execute("d1-1")
    assert {simulator.execute("u1").reply for _ in range(50)} == {simulator.true_value("u1")}
    assert simulator.execute("g1").reply == 0.0


# -- the incidence limit ---------------------------------------------------------------------


def looking(kind: type[RangeSensor], pose: Pose, **columns: Any) -> float:
    """The true range in the course's maze, 8 in before the wall at x = 48, alone and batched."""
    maze = Maze(MazeSpec(((1, 1, 1, 1, 0), (1, 1, 1, 1, 0))))
    world = World(maze, columns.pop("block", Block(6.0, 6.0, 3.0)))
    sensor = kind(replace(ULTRA, kind=kind, **columns))
    (batched,) = sensor.true_values(world, np.array([(pose.x, pose.y, pose.heading)])).tolist()
    alone = sensor.observe(world, pose)[0]
    assert batched == alone
    return alone


@pytest.mark.parametrize("kind", [Ultrasonic, TimeOfFlight])
@pytest.mark.parametrize("turn", [10.0, 20.0, 30.0, -10.0, -20.0, -30.0])
@pytest.mark.parametrize("limit", [5.0, 15.0, 25.0, 35.0, 0.0])
def test_a_wall_met_too_obliquely_sends_no_echo(kind: type[RangeSensor], turn: float, limit: float) -> None:
    found = looking(kind, Pose(40.0, 12.0, turn), incidence_limit=limit)
    echo = limit == 0.0 or abs(turn) <= limit
    assert found == pytest.approx(8.0 / math.cos(math.radians(turn)) if echo else math.inf)


@pytest.mark.parametrize("turn", [10.0, 20.0, 30.0])
def test_the_same_at_a_wall_along_x(turn: float) -> None:
    pose = Pose(20.0, 20.0, 90.0 + turn)
    assert looking(Ultrasonic, pose, incidence_limit=turn + 1) == pytest.approx(
        4.0 / math.cos(math.radians(turn))
    )
    assert looking(Ultrasonic, pose, incidence_limit=turn - 1) == math.inf


@pytest.mark.parametrize(("limit", "steepest"), [(35.0, 10.0), (25.0, 10.0), (15.0, 10.0), (5.0, None)])
def test_the_rays_that_do_echo_are_read(limit: float, steepest: float | None) -> None:
    # Rays at 10, 20 and 30 degrees from the wall's normal.
    columns = {"field_of_view": 20.0, "rays": 3, "incidence_limit": limit}
    echoes = [8.0 / math.cos(math.radians(angle)) for angle in (10, 20, 30) if angle <= limit]
    pose = Pose(40.0, 12.0, 20.0)
    assert looking(Ultrasonic, pose, **columns) == (pytest.approx(min(echoes)) if steepest else math.inf)
    mean = sum(echoes) / len(echoes) if echoes else math.inf
    assert looking(TimeOfFlight, pose, **columns) == pytest.approx(mean)


@pytest.mark.parametrize(
    ("heading", "limit", "echo"), [(0.0, 1.0, True), (20.0, 19.0, False), (20.0, 21.0, True)]
)
def test_a_turned_block_is_met_on_its_own_face(heading: float, limit: float, echo: bool) -> None:
    block = Block(30.0, 12.0, 4.0, heading)
    columns = {"z": 1.0, "block": block, "incidence_limit": limit}
    found = looking(Ultrasonic, Pose(20.0, 12.0, 0.0), **columns)
    assert found == (pytest.approx(10.0 - 2.0 / math.cos(math.radians(heading))) if echo else math.inf)


def test_where_cells_of_a_flat_wall_meet_it_is_flat() -> None:
    # At 70 degrees from the wall's normal, on the line between two of its cells.
    slope = math.tan(math.radians(70.0))
    pose = Pose(45.0, 12.0 - 3.0 * slope, 70.0)
    assert looking(Ultrasonic, pose, incidence_limit=60.0) == math.inf
    assert looking(Ultrasonic, pose, incidence_limit=71.0) == pytest.approx(math.hypot(3.0, 3.0 * slope))


def test_a_ray_square_to_a_wall_echoes_at_a_corner_too() -> None:
    maze = Maze(MazeSpec(((1, 0, 1), (1, 1, 1))))
    sensor = Ultrasonic(replace(ULTRA, incidence_limit=1.0))
    for x in (12.0, 24.0):
        assert sensor.observe(World(maze, Block(6, 6, 3)), Pose(x, 6.0, 90.0))[0] == 6.0


# -- encoders, compass, gyro, line sensor ----------------------------------------------------


@pytest.mark.parametrize(("go", "ticks", "reading"), [(1.0, 4.0, 1.0), (1.3, 4.0, 1.25), (-0.1, 4.0, -0.25)])
def test_an_encoder_counts_whole_ticks(
    course_spec: SimulationSpec, go: float, ticks: float, reading: float
) -> None:
    wheel = OdometerSpec(kind=Odometer, number=1, code="o1", ticks_per_inch=ticks)
    simulator = with_sensors(course_spec, wheel)
    simulator.execute(f"d1-{go}")
    assert simulator.execute("o1").reply == pytest.approx(reading)


def test_ticks_do_not_get_lost_on_the_way(course_spec: SimulationSpec) -> None:
    wheel = OdometerSpec(kind=Odometer, number=1, code="o1", ticks_per_inch=3.0)
    simulator = with_sensors(course_spec, wheel)
    for _ in range(50):
        simulator.execute("d1-0.1")
        simulator.execute("o1")
    assert simulator.execute("o1").reply == pytest.approx(5.0, abs=1 / 3)


@pytest.mark.parametrize("heading", [0.0, 30.0, 90.0, 135.0, 270.0, -725.0])
def test_iron_turns_a_compass_once_and_twice_a_turn(course_spec: SimulationSpec, heading: float) -> None:
    compass = CompassSpec(kind=Compass, number=1, code="c1", hard_iron=8.0, soft_iron=3.0)
    angle = math.radians(heading)
    deviation = 8.0 * math.sin(angle) + 3.0 * math.sin(2 * angle)
    simulator = with_sensors(course_spec, compass, bot_rot=heading)
    assert simulator.execute("c1").reply == pytest.approx(heading + deviation, abs=1e-9)
    assert simulator.true_value("c1") == heading
    simulator.noise = False
    assert simulator.execute("c1").reply == pytest.approx(heading + deviation, abs=1e-9), "it is no noise"


def test_a_gyro_walks_with_the_root_of_time(course_spec: SimulationSpec) -> None:
    gyro = GyroSpec(kind=Gyro, number=1, code="g1", random_walk=0.2)
    simulator = with_sensors(course_spec, gyro)
    steps, last, time = [], 0.0, 50.0
    simulator.advance(time)
    simulator.execute("g1")
    last = simulator.execute("g1").reply
    for index in range(COUNT):
        wait = 0.25 + (index % 4)
        time += wait
        simulator.advance(time)
        reply = simulator.execute("g1").reply
        assert simulator.execute("g1").reply == reply, "at one moment it is in one place"
        steps.append((reply - last) / (0.2 * math.sqrt(wait)))
        last = reply
    assert_distributed(steps, lambda z: 0.5 * math.erfc(-z / math.sqrt(2.0)))


def test_a_walk_restarts_with_a_run(course_spec: SimulationSpec) -> None:
    gyro = GyroSpec(kind=Gyro, number=1, code="g1", random_walk=0.2)
    simulator = with_sensors(course_spec, gyro)

    def run() -> list[float]:
        return [simulator.execute(command).reply for command in ("g1", "d1-6", "g1", "d1--6", "g1")]

    first = run()
    assert first[0] == 0.0
    assert len(set(first)) == 4
    simulator.reset()
    assert run() == first
    simulator.reset(99)
    assert run() != first


def test_an_analog_line_sensor_says_the_fraction(course_spec: SimulationSpec) -> None:
    sensor = LineSpec(
        kind=LineSensor, number=1, code="i1", z=1.0, field_of_view=90, threshold=0.9, analog=True
    )
    simulator = with_sensors(course_spec, sensor, bot_center=(6.0, 41.5))
    true = simulator.true_value("i1")
    assert 0.0 < true < 0.9
    assert simulator.execute("i1").reply == true
    assert not sensor.is_yes_or_no
    wild = with_sensors(course_spec, replace(sensor, error=1.0, resolution=0.25), bot_center=(6.0, 41.5))
    assert {wild.execute("i1").reply for _ in range(300)} == {0.0, 0.25, 0.5, 0.75, 1.0}


# -- the time that readings take -------------------------------------------------------------


def test_a_reading_takes_its_time(course_spec: SimulationSpec) -> None:
    compass = CompassSpec(kind=Compass, number=1, code="c1", drift=1.0)
    simulator = with_sensors(course_spec, replace(ULTRA, read_time=0.06), compass)
    simulator.advance(1000.3)
    outcome = simulator.execute("u1")
    assert (outcome.status, outcome.time, outcome.duration) == (Status.READING, 1000.3 + 0.06, 0.06)
    assert outcome.reading is not None
    assert outcome.reading.took == 0.06
    assert simulator.time == 1000.3 + 0.06
    assert simulator.execute("c1").reply == pytest.approx(1000.36)
    assert simulator.execute("c1").time == 1000.3 + 0.06, "a compass without the column takes none"


def test_a_reading_that_has_begun_is_finished_when_its_time_is_over(course_spec: SimulationSpec) -> None:
    simulator = with_sensors(course_spec, replace(ULTRA, read_time=0.5))
    simulator.begin("d1-6")
    simulator.advance(0.25)
    begun = simulator.begin("u1")
    assert (begun.time, simulator.time, begun.duration) == (0.25, 0.25, 0.5)
    finished = simulator.finish(begun)
    assert finished.time == simulator.time == 0.75
    assert finished.reply == begun.reply, "it is what was seen at the beginning"
    assert finished.pose.x == pytest.approx(begun.pose.x + 0.5 * 6.0)
    assert simulator.finish(begun).time == 0.75, "time never goes back"


# -- cross-talk ------------------------------------------------------------------------------


def test_a_sensor_hears_the_burst_of_another_that_still_listens(course_spec: SimulationSpec) -> None:
    near = replace(ULTRA, code="u1", rotation=90.0, read_time=0.06)
    far = replace(ULTRA, code="u2", number=2, read_time=0.06, cross_talk=1.0)
    simulator = with_sensors(course_spec, near, far, bot_center=(6.0, 6.0))
    simulator.advance(7.0)
    d1, d2 = simulator.true_value("u1"), simulator.true_value("u2")
    assert (d1, d2) == (42.0, 66.0)
    simulator.begin("u1")
    simulator.advance(7.0 + 1e-4)
    sound = 343.0 / 0.0254 * 1e-4
    assert simulator.begin("u2").reply == pytest.approx((d1 + d2 - sound) / 2)
    simulator.advance(7.0 + 1e-4 + 0.06)
    assert simulator.begin("u2").reply == d2, "nobody else listens any more"


def test_cross_talk_strikes_as_often_as_the_column_says(course_spec: SimulationSpec) -> None:
    near = replace(ULTRA, code="u1", rotation=90.0, read_time=0.06)
    far = replace(ULTRA, code="u2", number=2, read_time=0.06, cross_talk=0.25)
    simulator = with_sensors(course_spec, near, far, bot_center=(6.0, 6.0))
    struck = 0
    for turn in range(COUNT):
        simulator.advance(float(turn))
        simulator.begin("u1")
        struck += simulator.begin("u2").reply < simulator.true_value("u2")
    assert_as_often(struck, 0.25)


def test_polled_one_after_the_other_sensors_do_not_disturb_each_other(course_spec: SimulationSpec) -> None:
    sensors = [
        replace(ULTRA, code=f"u{n}", number=n, rotation=90.0 * n, read_time=0.06, cross_talk=1.0)
        for n in range(1, 5)
    ]
    simulator = with_sensors(course_spec, *sensors)
    for _ in range(5):
        for sensor in sensors:
            assert simulator.execute(sensor.code).reply == simulator.true_value(sensor.code)
