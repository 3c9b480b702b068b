"""Properties of every maze, robot and sequence of commands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.errors import PlacementError
from simmer_tui.sim import DriveKind, MazeSpec, Pose, RobotSpec, SimulationSpec, Simulator
from simmer_tui.sim.footprint import Footprint

calm = settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
ROBOTS = (
    RobotSpec.circle(6),
    RobotSpec.circle(11.5),
    RobotSpec.rectangle(6, 6),
    RobotSpec.rectangle(8, 4),
    RobotSpec.rectangle(12, 12),
    RobotSpec.polygon(((4, 0), (1, 1), (0, 4), (-1, 1), (-4, 0), (-1, -1), (0, -4), (1, -1))),
    RobotSpec.polygon(((5, 0.5), (-3, 3), (-3, -3))),
)
values = st.one_of(
    st.floats(-60, 60),
    st.sampled_from([0.0, 1e-12, 1e-9, 1e-6, 3.0, 6.0, 12.0, 90.0, -90.0, 360.0, 1e4, -1e6, 1e6]),
)
commands = st.tuples(st.sampled_from(["w1", "s1", "a1", "d1", "r1"]), values)
mazes = st.integers(1, 4).flatmap(
    lambda columns: st.lists(
        st.lists(st.sampled_from([0, 1, 1, 2]), min_size=columns, max_size=columns).map(tuple),
        min_size=1,
        max_size=4,
    ).map(tuple)
)


def overlap_depth(simulator: Simulator) -> float:
    """Depth of the robot in the walls, measured apart from the code under test."""
    maze = simulator.maze
    cells = maze.walls
    pose = simulator.pose
    walls = [
        shapely.box(12 * (c - 1), 12 * (r - 1), 12 * c, 12 * r) for r, c in zip(*cells.nonzero(), strict=True)
    ]
    footprint = simulator.spec.robot
    if footprint.radius is not None:
        centre = shapely.Point(pose.x, pose.y)
        return max(footprint.radius - centre.distance(wall) for wall in walls)
    turn = np.radians(math.fmod(pose.heading, 360))
    matrix = np.array(((np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))))
    body = shapely.Polygon(np.array(footprint.vertices) @ matrix.T + (pose.x, pose.y))
    deepest = 0.0
    for wall in walls:
        shared = body.intersection(wall)
        if shared.area > 0:  # the narrow side of a sliver is twice its area by its perimeter
            deepest = max(deepest, 2 * shared.area / shared.length)
    return deepest


def started(spec: SimulationSpec, x: float, y: float, heading: float, seed: int = 0) -> Simulator | None:
    try:
        return Simulator(replace(spec, bot_center=(x, y), bot_rot=heading), seed)
    except PlacementError:
        return None


ANY_PROGRAM: dict[str, st.SearchStrategy[Any]] = {
    "cells": mazes,
    "robot": st.sampled_from(ROBOTS),
    "place": st.tuples(st.floats(0, 48), st.floats(0, 48), st.sampled_from([0.0, 90.0, 45.0, 33.3, -725.0])),
    "segments": st.sampled_from([1, 3, 10, 257]),
    "sequence": st.lists(commands, min_size=1, max_size=12),
    "seed": st.integers(0, 5),
}


@calm
@given(**ANY_PROGRAM)
def test_no_commands_bring_the_robot_into_a_wall(noisy_spec: SimulationSpec, **program: Any) -> None:
    assert_stays_outside(noisy_spec, **program)


@pytest.mark.slow
@settings(calm, max_examples=150)
@given(**ANY_PROGRAM)
def test_no_commands_of_many_more_bring_the_robot_into_a_wall(
    noisy_spec: SimulationSpec, **program: Any
) -> None:
    assert_stays_outside(noisy_spec, **program)


def assert_stays_outside(
    noisy_spec: SimulationSpec,
    cells: tuple[tuple[int, ...], ...],
    robot: RobotSpec,
    place: tuple[float, float, float],
    segments: int,
    sequence: list[tuple[str, float]],
    seed: int,
) -> None:
    maze = MazeSpec(cells)
    free = [(r, c) for r, row in enumerate(cells[::-1]) for c, value in enumerate(row) if value]
    if not free:
        return
    row, column = free[seed % len(free)]
    block = (12 * column + 6, 12 * row + 6)
    spec = replace(noisy_spec, maze=maze, robot=robot, num_segments=segments, block_center=block)
    simulator = started(spec, place[0] % maze.width, place[1] % maze.height, place[2], seed)
    if simulator is None:
        simulator = started(spec, *block, 0.0, seed)
    if simulator is None:
        return
    for code, value in sequence:
        simulator.execute(f"{code}-{value!r}")
        assert overlap_depth(simulator) <= 1e-9
        assert 0 <= simulator.pose.x <= maze.width
        assert 0 <= simulator.pose.y <= maze.height


@calm
@given(
    robot=st.sampled_from(ROBOTS[:4] + ROBOTS[5:]),
    x=st.floats(40, 56),
    y=st.floats(28, 40),
    heading=st.floats(0, 360),
    code=st.sampled_from(["w1", "s1", "a1", "d1", "r1"]),
    value=st.floats(20, 400),
    segments=st.sampled_from([1, 10, 100]),
    seed=st.integers(0, 9),
)
def test_contact_is_where_a_hair_further_overlaps(
    noisy_spec: SimulationSpec,
    robot: RobotSpec,
    x: float,
    y: float,
    heading: float,
    code: str,
    value: float,
    segments: int,
    seed: int,
) -> None:
    simulator = started(replace(noisy_spec, robot=robot, num_segments=segments), x, y, heading, seed)
    if simulator is None:
        return
    outcome = simulator.execute(f"{code}-{value!r}")
    contact = outcome.contact
    if contact is None:
        return
    assert overlap_depth(simulator) <= 1e-9
    trajectory = outcome.trajectory
    assert trajectory is not None
    path = trajectory.path
    step = 1e-6 / max(float(np.hypot(*(path.points[1] - path.points[0]))), abs(path.turn), 1.0)
    if contact.translated:
        further = path.pose(contact.segment, 1.0, contact.translated + step)
    elif contact.turned < 1.0:
        further = path.pose(contact.segment, contact.turned + step, 0.0)
    else:
        further = path.pose(contact.segment, 1.0, step)
    footprint = Footprint.of(robot)
    # A grazing hit deepens slowly: what must be near is the overlap, within a thousandth inch.
    ways = [
        further,
        *(path.pose(contact.segment, 1.0, contact.translated + k * step) for k in (10, 100, 1000)),
    ]
    assert any(simulator.walls.overlap(footprint, way) for way in ways)
    assert simulator.walls.overlap(footprint, contact.pose) is False


@pytest.mark.parametrize("segments", [1, 10, 10000])
def test_a_million_inches_end_at_the_wall_exactly(course_spec: SimulationSpec, segments: int) -> None:
    simulator = Simulator(replace(course_spec, num_segments=segments))
    outcome = simulator.execute("d1-1e6")
    assert outcome.pose.x == pytest.approx(45.0, abs=1e-9)
    assert outcome.reply == math.inf
    assert outcome.contact is not None
    assert outcome.contact.point == pytest.approx((48.0, 42.0), abs=1e-6)
    assert simulator.execute("o3").reply == pytest.approx(1e6)


def test_after_contact_the_robot_backs_off_slides_and_turns(course_spec: SimulationSpec) -> None:
    simulator = Simulator(replace(course_spec, robot=RobotSpec.rectangle(6, 6)))
    assert simulator.execute("w1-100").contact is not None
    assert simulator.pose.y == pytest.approx(45.0)
    slide = simulator.execute("d1-10")
    assert slide.contact is None
    assert slide.pose.x == pytest.approx(19.5)
    assert simulator.execute("r1-30").contact is not None, "a square against a wall cannot turn"
    assert simulator.execute("s1-3").contact is None
    assert simulator.execute("r1-30").contact is None


def test_a_robot_as_wide_as_the_corridor_drives_through_it(course_spec: SimulationSpec) -> None:
    maze = MazeSpec(((0, 1, 0), (0, 1, 0), (0, 1, 1)))
    spec = replace(
        course_spec, maze=maze, robot=RobotSpec.rectangle(12, 12), bot_center=(18, 30), block_center=(18, 6)
    )
    simulator = Simulator(spec)
    assert simulator.execute("s1-24").contact is None
    assert simulator.pose.y == pytest.approx(6.0)
    assert simulator.execute("d1-12").contact is None
    assert simulator.execute("w1-1").contact is not None


def test_a_turn_stops_where_a_corner_meets_a_wall(course_spec: SimulationSpec) -> None:
    spec = replace(course_spec, robot=RobotSpec.rectangle(8, 4), bot_center=(6, 45.9))
    outcome = Simulator(spec).execute("r1-90")
    # The corner (4, 2) reaches height 2.1 at asin(2.1 / sqrt(20)) - atan(2 / 4).
    expected = math.degrees(math.asin(2.1 / math.sqrt(20)) - math.atan2(2, 4))
    assert outcome.pose.heading == pytest.approx(expected, abs=1e-6)


@calm
@given(data=st.data())
def test_many_rays_equal_single_rays_bit_for_bit(course_spec: SimulationSpec, data: st.DataObject) -> None:
    maze = Simulator(course_spec).maze
    on_grid = st.one_of(st.floats(0, 96), st.sampled_from([0.0, 6.0, 12.0, 24.0, 36.5, 48.0, 96.0]))
    points = data.draw(st.lists(st.tuples(on_grid, on_grid), min_size=1, max_size=20))
    angles = st.one_of(st.floats(-720, 720), st.sampled_from([0.0, 45.0, 90.0, 135.0, 180.0, -90.0]))
    bearings = np.array([data.draw(angles) for _ in points])
    origins = np.array(points)
    dx, dy = np.cos(np.radians(bearings)), np.sin(np.radians(bearings))
    dx[np.abs(dx) < 1e-12] = 0.0
    dy[np.abs(dy) < 1e-12] = 0.0
    many = maze.cast_many(origins[:, 0], origins[:, 1], dx, dy)
    for index, (x, y) in enumerate(points):
        if maze.is_wall(x, y):
            assert many[index] == 0.0
        else:
            assert many[index] == maze.cast(x, y, dx[index], dy[index])


@calm
@given(x=st.floats(0.01, 95.9), y=st.floats(0.01, 47.9), bearing=st.floats(0, 360))
def test_a_ray_ends_on_the_first_wall(
    course_spec: SimulationSpec, x: float, y: float, bearing: float
) -> None:
    simulator = Simulator(course_spec)
    distance = float(simulator.cast_rays(np.array([(x, y)]), np.array([bearing]))[0])
    walls = shapely.union_all(list(simulator.walls.tree.geometries))
    if simulator.maze.is_wall(x, y):
        assert distance == 0.0
        return
    towards = np.array((math.cos(math.radians(bearing)), math.sin(math.radians(bearing))))
    end = np.array((x, y)) + distance * towards
    assert walls.distance(shapely.Point(end)) < 1e-8
    short = shapely.LineString([(x, y), np.array((x, y)) + max(distance - 1e-6, 0.0) * towards])
    assert not walls.buffer(-1e-7).intersects(short)


def test_a_ray_meets_the_corner_it_touches(course_spec: SimulationSpec) -> None:
    maze = Simulator(
        replace(course_spec, maze=MazeSpec(((0, 1), (1, 1))), block_center=(18, 6), bot_center=(6, 6))
    ).maze
    up = maze.cast(12.0, 6.0, 0.0, 1.0)
    assert up == 6.0, "along the grid line the wall's corner is met"
    diagonal = maze.cast(6.0, 6.0, math.sqrt(0.5), math.sqrt(0.5))
    assert diagonal == pytest.approx(6 * math.sqrt(2)), "through the corner the wall beside it is met"


def test_every_command_text_is_answered(noisy_spec: SimulationSpec) -> None:
    @calm
    @given(st.text(max_size=20))
    def check(text: str) -> None:
        simulator = Simulator(noisy_spec, 1)
        before = simulator.pose
        outcome = simulator.execute(text)
        if math.isnan(outcome.reply):
            assert outcome.reason
            assert outcome.pose == before

    check()


@calm
@given(
    sequence=st.lists(
        st.one_of(commands, st.sampled_from([("u1", 0.0), ("i1", 0.0), ("o1", 0.0)])), max_size=15
    )
)
def test_the_same_seed_and_commands_give_the_same_replies(
    noisy_spec: SimulationSpec, sequence: list[tuple[str, float]]
) -> None:
    first, second = Simulator(noisy_spec, 11), Simulator(noisy_spec, 11)
    for code, value in sequence:
        text = f"{code}-{value!r}"
        one, other = first.execute(text), second.execute(text)
        assert np.array(one.reply).tobytes() == np.array(other.reply).tobytes()
        assert one.pose == other.pose


def test_polling_one_sensor_never_changes_another(noisy_spec: SimulationSpec) -> None:
    quiet, busy = Simulator(noisy_spec, 5), Simulator(noisy_spec, 5)
    for _ in range(20):
        busy.execute("u2")
        busy.execute("i1")
        busy.execute("zz")
        busy.execute("d1-abc")
        assert quiet.execute("u1").reply == busy.execute("u1").reply
        assert quiet.execute("d1-1").pose == busy.execute("d1-1").pose


def test_sensors_are_keyed_by_id_not_by_row(noisy_spec: SimulationSpec) -> None:
    shuffled = replace(noisy_spec, sensors=noisy_spec.sensors[::-1])
    for code in ("u1", "t1", "i2", "c1"):
        assert Simulator(noisy_spec, 3).execute(code).reply == Simulator(shuffled, 3).execute(code).reply


def test_an_obstacle_that_appears_on_the_way_stops_the_rest_of_it(course_spec: SimulationSpec) -> None:
    spec = replace(course_spec, block_solid=True, block_center=(6, 30))
    simulator = Simulator(spec)
    simulator.begin("d1-30")
    planned = simulator.trajectory
    assert planned is not None
    assert planned.pose_at(planned.end_time).x == pytest.approx(39.5)
    simulator.advance(1.0)
    assert simulator.pose.x == pytest.approx(15.5)
    simulator.move_block(30, 42)
    simulator.advance(100.0)
    assert simulator.pose.x == pytest.approx(25.5), "stopped by the block's near side at 28.5"
    assert simulator.contacts == 1
    simulator.begin("a1-3")
    simulator.advance(200.0)
    assert simulator.pose.x == pytest.approx(22.5)


@pytest.mark.parametrize("code", ["d1", "r1"])
def test_the_smallest_movement_late_in_a_run_is_as_long_as_commanded(
    course_spec: SimulationSpec, code: str
) -> None:
    simulator = Simulator(course_spec)
    simulator.advance(1e5)
    outcome = simulator.execute(f"{code}-1e-9")
    moved = outcome.pose.x - 9.5 if code == "d1" else outcome.pose.heading
    assert moved == pytest.approx(1e-9, rel=1e-5)
    assert simulator.execute("o1" if code == "r1" else "o3").reply == pytest.approx(
        1e-9 if code == "d1" else 1e-9 * math.radians(3.0), rel=1e-5
    )


def test_a_movement_is_read_mid_way_and_can_be_stopped(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    simulator.begin("d1-30")
    assert simulator.trajectory is not None
    assert simulator.trajectory.duration == 5.0
    simulator.advance(1.25)
    assert simulator.begin("o3").reply == pytest.approx(7.5)
    assert simulator.begin("d1-1").reason == "the robot is still moving"
    assert simulator.stop()
    simulator.advance(9.0)
    assert simulator.pose == Pose(17.0, 42.0, 0.0)
    assert simulator.execute("o3").reply == pytest.approx(7.5)
    assert simulator.distance == pytest.approx(7.5)


@pytest.mark.parametrize(("kind", "code"), [(DriveKind.RIGHT, "d1"), (DriveKind.ROT, "r1")])
def test_gain_multiplies_the_commanded_value(course_spec: SimulationSpec, kind: DriveKind, code: str) -> None:
    drives = tuple(replace(d, gain=-2.0) if d.kind is kind else d for d in course_spec.drives)
    simulator = Simulator(replace(course_spec, drives=drives, bot_center=(20, 42)))
    simulator.execute(f"{code}-3")
    moved = simulator.pose.x - 20 if kind is DriveKind.RIGHT else simulator.pose.heading
    assert moved == pytest.approx(-6)
    assert math.isnan(simulator.execute(f"{code}-500001").reply)
