"""Each column of sensors.csv, and what the six types of sensor make of the world."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.sim import (
    Block,
    FloorPatch,
    Maze,
    MazeSpec,
    Pose,
    RangeScan,
    SensorSpec,
    SimulationSpec,
    Simulator,
)
from simmer_tui.sim.sensors import (
    KINDS,
    Compass,
    CompassSpec,
    LineSensor,
    LineSpec,
    RangeSensor,
    TimeOfFlight,
    Ultrasonic,
    UltrasonicSpec,
    World,
    sensor_of,
)

ULTRA = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", x=3.0, z=6.0, field_of_view=5.0)


def with_sensor(spec: SimulationSpec, sensor: SensorSpec, **changes: Any) -> Simulator:
    return Simulator(replace(spec, sensors=(sensor,), **changes))


def world_with_block(spec: SimulationSpec, x: float = 25.0, y: float = 41.0) -> World:
    return World(Maze(spec.maze), Block(x, y, 3.0))


# -- what the electronics make of a value ----------------------------------------------------


@pytest.mark.parametrize(
    ("columns", "value", "reading"),
    [
        ({}, 12.34, 12.34),
        ({"wrap": 360.0}, 725.0, 5.0),
        ({"wrap": 360.0}, -30.0, 330.0),
        ({"resolution": 0.5}, 12.26, 12.5),
        ({"kind": Compass, "resolution": 0.5}, -12.26, -12.5),
        ({"kind": Compass, "wrap": 360.0}, -1e-17, 0.0),
        ({"kind": Compass, "wrap": 360.0}, -1e-300, 0.0),
        ({"kind": Compass, "wrap": 360.0, "resolution": 1.0}, 359.6, 0.0),
        ({"kind": Compass, "wrap": 360.0, "resolution": 100.0}, 355.0, 0.0),
        ({"kind": Compass, "resolution": 1e-320}, 2.5, 2.5),
        ({}, -0.3, 0.0),
        ({"resolution": 1.0}, -0.3, 0.0),
        ({}, -math.inf, math.inf),
        ({"wrap": 360.0, "resolution": 10.0}, 723.0, 0.0),
        ({"min_range": 2.0}, 1.5, 2.0),
        ({"min_range": 2.0}, 2.0, 2.0),
        ({"max_range": 40.0}, 40.0, 40.0),
        ({"max_range": 40.0}, 40.1, math.inf),
        ({"min_range": 2.0, "max_range": 40.0}, math.inf, math.inf),
        ({"max_range": 40.0, "resolution": 1.0}, 40.4, 40.0),
        ({"min_range": 2.0, "resolution": 1.0}, 1.6, 2.0),
    ],
)
def test_wrap_then_resolution_then_range(columns: dict[str, Any], value: float, reading: float) -> None:
    columns = {"kind": Ultrasonic} | columns
    sensor = sensor_of(columns["kind"].spec_type(number=1, code="u1", **columns))
    assert sensor.reported(value) == pytest.approx(reading, abs=1e-12)
    assert math.copysign(1.0, sensor.reported(value)) == math.copysign(1.0, reading), "no -0.0"


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"gain": -2.0}, -20.0),
        ({"bias": 0.5}, 10.5),
        ({"drift": 0.1}, 10.4),
        ({"gain": 3.0, "bias": 1.0, "drift": -0.5}, 29.0),
        ({"gain": -1.0, "bias": 5.0, "wrap": 7.0}, 2.0),
    ],
)
def test_gain_bias_and_drift_by_simulated_time(columns: dict[str, Any], expected: float) -> None:
    compass = CompassSpec(kind=Compass, number=1, code="c1", **columns)
    assert Compass(compass).reading(10.0, None, 4.0) == pytest.approx(expected)


def test_both_errors_come_before_bias_and_wrap_and_are_drawn_in_order() -> None:
    sensor = CompassSpec(
        kind=Compass,
        number=1,
        code="c1",
        error=0.1,
        gain=2.0,
        absolute_error=3.0,
        bias=50.0,
        wrap=40.0,
    )
    first, second = np.random.default_rng(5).standard_normal(2)
    reading = Compass(sensor).reading(10.0, np.random.default_rng(5), 0.0)
    assert reading == pytest.approx((10.0 * (1 + 0.1 * first) * 2.0 + 3.0 * second + 50.0) % 40.0)


def test_drift_grows_with_what_movements_take(course_spec: SimulationSpec) -> None:
    compass = CompassSpec(kind=Compass, number=1, code="c1", drift=0.5)
    simulator = with_sensor(course_spec, compass)
    assert simulator.execute("c1").reply == 0.0
    simulator.execute("d1-12")
    assert simulator.execute("c1").reply == pytest.approx(0.5 * 2.0)


# -- range sensors ---------------------------------------------------------------------------


def test_an_ultrasonic_sensor_takes_the_nearest_of_its_rays(course_spec: SimulationSpec) -> None:
    sensor = replace(ULTRA, field_of_view=60.0, rays=7)
    true, view = Ultrasonic(sensor).observe(world_with_block(course_spec), Pose(30.0, 42.0, 10.0))
    assert view.bearings == pytest.approx((-20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0)), "edges included"
    assert true == min(view.distances)
    assert len(set(view.distances)) > 3


def test_one_ray_looks_straight_ahead(course_spec: SimulationSpec) -> None:
    sensor = replace(ULTRA, field_of_view=60.0, rays=1, rotation=90.0)
    _, view = Ultrasonic(sensor).observe(world_with_block(course_spec), Pose(30.0, 42.0, 10.0))
    assert view.bearings == (100.0,)


def test_a_time_of_flight_sensor_takes_the_mean(course_spec: SimulationSpec) -> None:
    sensor = replace(ULTRA, kind=TimeOfFlight, field_of_view=60.0)
    true, view = TimeOfFlight(sensor).observe(world_with_block(course_spec), Pose(30.0, 42.0, 0.0))
    assert true == pytest.approx(sum(view.distances) / 5)
    assert true > min(view.distances)


def test_beyond_its_greatest_range_a_reading_is_infinite(course_spec: SimulationSpec) -> None:
    # Facing right from (4, 30) there is nothing before the wall at 24.
    far = replace(ULTRA, max_range=10.0)
    near = replace(ULTRA, max_range=47.0)
    assert with_sensor(course_spec, far, bot_center=(30, 42)).execute("u1").reply == math.inf
    assert with_sensor(course_spec, near, bot_center=(30, 42)).execute("u1").reply == pytest.approx(15.0)


def test_below_its_least_range_a_reading_is_that(course_spec: SimulationSpec) -> None:
    simulator = with_sensor(course_spec, replace(ULTRA, min_range=4.0), bot_center=(43, 42))
    outcome = simulator.execute("u1")
    assert outcome.reply == 4.0
    assert outcome.reading is not None
    assert outcome.reading.true == pytest.approx(2.0)


@pytest.mark.parametrize(("z", "expected"), [(2.0, 2.5), (3.0, 2.5), (3.01, 14.0)])
def test_the_block_is_seen_by_sensors_no_higher_than_it(
    course_spec: SimulationSpec, z: float, expected: float
) -> None:
    # The block's near face is at 35.5; the wall is at 48, the sensor at 33 or 34.
    simulator = with_sensor(
        course_spec,
        replace(ULTRA, z=z, x=0.0, rays=1),
        bot_center=(34 if z > 3 else 33, 42),
        block_center=(37, 42),
    )
    assert simulator.execute("u1").reply == pytest.approx(expected)


@settings(max_examples=20)
@given(
    st.floats(-1e9, 1e9) | st.sampled_from([-1e-17, 360.0, -360.0, 720.0 - 1e-13, 359.99999999999994]),
    st.sampled_from([7.0, 360.0, 0.1]),
    st.sampled_from([0.0, 0.1, 0.3, 7.0]),
)
def test_a_wrapped_reading_never_reaches_its_wrap(value: float, wrap: float, resolution: float) -> None:
    spec = CompassSpec(kind=Compass, number=1, code="c1", wrap=wrap, resolution=resolution)
    assert 0.0 <= Compass(spec).reported(value) < wrap


@pytest.mark.parametrize("kind", [Ultrasonic, TimeOfFlight])
@pytest.mark.parametrize("columns", [{"error": 1.0}, {"absolute_error": 30.0}, {"bias": -40.0}])
def test_no_distance_is_below_0(
    course_spec: SimulationSpec, kind: type[RangeSensor], columns: dict[str, float]
) -> None:
    simulator = with_sensor(course_spec, replace(ULTRA, kind=kind, **columns))
    replies = [simulator.execute("u1").reply for _ in range(300)]
    assert min(replies) == 0.0
    assert all(math.copysign(1.0, reply) == 1.0 for reply in replies)


@pytest.mark.parametrize(
    ("z", "view", "x", "expected"),
    [
        # The block's near face is at 35.5, 3 in high; a sensor at z sees it from (z - 3) / tan(view / 2)
        # on. The wall is at 48.
        (4.0, 0.0, 25.0, 23.0),
        (4.0, 15.0, 35.5 - 7.6, 7.6),
        (4.0, 15.0, 35.5 - 7.5, 20.0),
        (4.0, 90.0, 35.5 - 1.01, 1.01),
        (4.0, 90.0, 35.5 - 0.99, 13.49),
        (9.0, 60.0, 25.0, 10.5),
        (9.0, 59.0, 25.0, 23.0),
        (2.0, 1.0, 35.0, 0.5),
        (3.0, 0.0, 35.0, 0.5),
    ],
)
@pytest.mark.parametrize("kind", [Ultrasonic, TimeOfFlight])
def test_a_high_sensor_sees_the_block_from_where_its_view_reaches_down_to_it(
    course_spec: SimulationSpec, kind: type[RangeSensor], z: float, view: float, x: float, expected: float
) -> None:
    spec = replace(ULTRA, kind=kind, x=0.0, z=z, rays=1, vertical_field_of_view=view)
    world = world_with_block(course_spec, 37.0, 42.0)
    assert kind(spec).observe(world, Pose(x, 42.0, 0.0))[0] == pytest.approx(expected)
    assert kind(spec).true_values(world, np.array([(x, 42.0, 0.0)]))[0] == pytest.approx(expected)


@pytest.mark.parametrize(("command", "code", "rotation"), [("d1-100", "u1", 0.0), ("w1-100", "u2", 90.0)])
def test_a_sensor_on_the_outline_at_contact_reads_nothing_but_0(
    course_spec: SimulationSpec, command: str, code: str, rotation: float
) -> None:
    cos, sin = math.cos(math.radians(rotation)), math.sin(math.radians(rotation))
    sensor = replace(ULTRA, code=code, x=3 * cos, y=3 * sin, rotation=rotation)
    simulator = with_sensor(course_spec, sensor, bot_center=(30, 41))
    assert simulator.execute(command).contact is not None
    outcome = simulator.execute(code)
    assert outcome.reply == 0.0
    assert outcome.reading is not None
    assert isinstance(outcome.reading.view, RangeScan)
    assert set(outcome.reading.view.distances) == {0.0}
    assert simulator.true_ranges(np.array([(simulator.pose.x, simulator.pose.y, 0.0)]))[0, 0] == 0.0


@pytest.mark.parametrize("kind", [Ultrasonic, TimeOfFlight])
@pytest.mark.parametrize("place", [(-5.0, 42.0), (54.0, 42.0), (48.0, 42.0), (48.0 - 9e-7, 42.0)])
def test_inside_a_wall_or_outside_a_range_is_0(
    course_spec: SimulationSpec, kind: type[RangeSensor], place: tuple[float, float]
) -> None:
    sensor = kind(replace(ULTRA, kind=kind, x=0.0))
    assert sensor.observe(world_with_block(course_spec), Pose(*place, 180.0))[0] == 0.0
    assert sensor.true_values(world_with_block(course_spec), np.array([(*place, 180.0)]))[0] == 0.0


def test_a_hair_off_the_wall_a_sensor_looks_away_from_it(course_spec: SimulationSpec) -> None:
    sensor = Ultrasonic(replace(ULTRA, x=0.0, rays=1))
    true, _ = sensor.observe(world_with_block(course_spec), Pose(48.0 - 2e-6, 42.0, 180.0))
    assert true == pytest.approx(48.0 - 2e-6), "to the far wall, over the block"


def test_rays_cross_the_largest_maze(course_spec: SimulationSpec) -> None:
    maze = MazeSpec(((1,) * 100,))
    simulator = with_sensor(
        course_spec, replace(ULTRA, x=0.0, rays=1), maze=maze, bot_center=(6, 6), block_center=(600, 6)
    )
    assert simulator.execute("u1").reply == pytest.approx(1194.0)


# -- line sensors ----------------------------------------------------------------------------

BLACK, WHITE = 0, 1


def on_floor(left: int, right: int) -> World:
    """One cell whose two left columns of tiles have one colour, the right ones another."""
    row = (left, left, right, right)
    return World(Maze(MazeSpec(((1,),), (row,) * 4)), Block(6, 6, 3))


def line_sensor(**columns: Any) -> LineSensor:
    return LineSensor(
        LineSpec(kind=LineSensor, number=1, code="i1", z=1.0, field_of_view=90.0, threshold=0.8, **columns)
    )


def test_a_line_sensor_tests_113_points_of_a_disc() -> None:
    sensor = line_sensor()
    assert sensor.radius == pytest.approx(1.0)
    fraction, patch = sensor.observe(on_floor(BLACK, BLACK), Pose(6, 6, 30))
    assert fraction == 1.0
    assert patch.points.shape == (113, 2)
    assert np.hypot(*(patch.points - (6, 6)).T).max() == pytest.approx(1.0)


def test_the_points_do_not_turn_with_the_robot() -> None:
    sensor = line_sensor(x=0.0)
    floor = on_floor(BLACK, WHITE)
    straight, turned = (sensor.observe(floor, Pose(6, 6, heading))[1] for heading in (0.0, 33.0))
    assert np.array_equal(straight.points, turned.points)


def test_points_at_the_edge_of_black_count_as_black() -> None:
    fraction, _ = line_sensor().observe(on_floor(BLACK, WHITE), Pose(6, 6, 0))
    column = 13  # the points on the edge itself
    assert fraction == pytest.approx(((113 - column) / 2 + column) / 113)


def test_detecting_white_is_the_rest() -> None:
    black, _ = line_sensor().observe(on_floor(BLACK, WHITE), Pose(5.6, 6, 0))
    white, patch = line_sensor(detects_white=True).observe(on_floor(BLACK, WHITE), Pose(5.6, 6, 0))
    assert 0.0 < white < 1.0
    assert white == pytest.approx(1.0 - black)
    assert isinstance(patch, FloorPatch)
    assert patch.black.sum() == pytest.approx(black * 113)


def test_the_floor_outside_the_maze_is_not_black() -> None:
    fraction, _ = line_sensor().observe(on_floor(BLACK, BLACK), Pose(0, 6, 0))
    assert fraction == pytest.approx(((113 - 13) / 2 + 13) / 113)
    assert line_sensor().observe(on_floor(BLACK, BLACK), Pose(-2, 6, 0))[0] == 0.0
    for far in (Pose(-40, 6, 0), Pose(60, 6, 0), Pose(6, -40, 0), Pose(6, 60, 0)):
        assert line_sensor().observe(on_floor(BLACK, BLACK), far)[0] == 0.0


@pytest.mark.parametrize(
    ("columns", "value", "reading"),
    [
        ({}, 0.8, 1.0),
        ({}, 0.79, 0.0),
        ({"threshold": 1.0}, 1.2, 1.0),
        ({"threshold": 0.0}, -0.1, 1.0),
        ({"threshold": 1.01}, 5.0, 0.0),
    ],
)
def test_a_line_sensor_says_1_from_its_threshold_on(
    columns: dict[str, Any], value: float, reading: float
) -> None:
    assert LineSensor(replace(line_sensor().spec, **columns)).reported(value) == reading


# -- compass, odometers, gyro ----------------------------------------------------------------


@pytest.mark.parametrize("heading", [0.0, -725.0, 1000.0])
def test_a_compass_is_not_wrapped_unless_asked(course_spec: SimulationSpec, heading: float) -> None:
    compass = CompassSpec(kind=Compass, number=1, code="c1", rotation=30.0)
    assert with_sensor(course_spec, compass, bot_rot=heading).execute("c1").reply == heading + 30.0
    wrapped = with_sensor(course_spec, replace(compass, wrap=360.0), bot_rot=heading)
    assert wrapped.execute("c1").reply == pytest.approx((heading + 30.0) % 360.0)


def test_odometers_slip_at_a_wall_and_the_gyro_counts_what_was_turned(course_spec: SimulationSpec) -> None:
    square = replace(course_spec, robot=type(course_spec.robot).rectangle(6, 6), bot_center=(9.5, 45.0))
    simulator = Simulator(square)
    assert simulator.execute("w1-5").contact is not None
    assert simulator.execute("o1").reply == pytest.approx(5.0)
    assert simulator.execute("r1-90").contact is not None
    assert simulator.execute("g1").reply == pytest.approx(0.0, abs=1e-6)
    assert simulator.execute("o1").reply == pytest.approx(5.0 + 2 * math.pi * 3 * 90 / 360)


def test_wheel_and_gyro_start_at_0(course_spec: SimulationSpec) -> None:
    simulator = Simulator(replace(course_spec, bot_rot=123.0))
    assert [simulator.execute(code).reply for code in ("o1", "o2", "o3", "o4", "g1")] == [0.0] * 5


def test_disabled_sensors_and_drives_answer_nan_and_say_so(course_spec: SimulationSpec) -> None:
    spec = replace(
        course_spec,
        sensors=tuple(replace(each, enabled=each.code != "u1") for each in course_spec.sensors),
        drives=tuple(replace(each, enabled=each.code != "d1") for each in course_spec.drives),
    )
    simulator = Simulator(spec)
    for command in ("u1", "d1-3"):
        outcome = simulator.execute(command)
        assert math.isnan(outcome.reply)
        assert "disabled" in outcome.reason
    assert simulator.pose == Pose(9.5, 42.0, 0.0)
    assert simulator.ranging_codes() == ["u2", "u3", "u4", "u5", "t1"]


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((14.0, 17.0), (24.0, 12.0)), ((26.0, 43.0), (36.0, 48.0)),
        ((17.0, 14.0), (12.0, 24.0)), ((43.0, 26.0), (48.0, 36.0)),
    ],
)  # fmt: skip
def test_a_flat_face_is_met_at_the_same_angle_where_two_cells_join(
    start: tuple[float, float], end: tuple[float, float]
) -> None:
    ring = Maze(MazeSpec(((0,) * 5, *[(0, 1, 1, 1, 0)] * 3, (0,) * 5)))
    way = math.dist(start, end)
    x, y = np.array([start[0]]), np.array([start[1]])
    dx, dy = np.array([(end[0] - start[0]) / way]), np.array([(end[1] - start[1]) / way])
    assert ring.incidence(x, y, dx, dy, np.array([way])) == pytest.approx([5.0 / way])


@pytest.mark.parametrize("cells", [((0, 1), (1, 1)), ((1, 0), (1, 1)), ((1, 1), (0, 1)), ((1, 1), (1, 0))])
def test_a_crossing_is_wall_if_one_of_its_four_cells_is(cells: tuple[tuple[int, int], ...]) -> None:
    assert Maze(MazeSpec(cells)).is_wall(12.0, 12.0)


def test_kinds_say_what_analyses_ask_of_them() -> None:
    said = {
        name: (kind.is_heading, kind.detects_block, kind.detects_floor)
        for name, kind in KINDS.items()
        if kind.is_heading or kind.detects_block or kind.detects_floor
    }
    assert said == {"comp": (True, False, False), "load": (False, True, False), "ir": (False, False, True)}
