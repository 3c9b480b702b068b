"""Numbers and texts of the simulation's functions, kept: whoever changes one changes it on purpose.

KEEP=1 pytest tests/sim/test_kept_numbers.py     # keeps those of today, after such a change
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.errors import printable
from simmer_tui.sim import angles, command, motion, noise, rules
from simmer_tui.sim.arc_contact import first_arc_contact
from simmer_tui.sim.arcs import Arc, Twist, poses_along
from simmer_tui.sim.block import Block
from simmer_tui.sim.contact import first_contact
from simmer_tui.sim.distance_errors import DistanceErrors, TrueVelocity, components
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.gripper import Gripper, can_take, missed_by
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import Obstacles, block_problem, placement_problems, robot_problem
from simmer_tui.sim.path import Path as RobotPath
from simmer_tui.sim.path import PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.recent_motion import BlockPlace, RecentMotion
from simmer_tui.sim.records import LidarScan, ray_bearings
from simmer_tui.sim.scan_rays import extremes, rays_of
from simmer_tui.sim.sensors import (
    Compass,
    CompassSpec,
    CountingSensor,
    Gyro,
    GyroSpec,
    Lidar,
    LidarSpec,
    LineSensor,
    LineSpec,
    LoadSensor,
    Odometer,
    OdometerSpec,
    RangeSpec,
    TimeOfFlight,
    Ultrasonic,
    UltrasonicSpec,
    sensor_of,
)
from simmer_tui.sim.sensors.base import ObservingSensor, World, parameter_value, with_parameters
from simmer_tui.sim.sensors.faults import Pings
from simmer_tui.sim.sensors.lidar import Now, Turning
from simmer_tui.sim.specs import (
    Axes,
    ContactRule,
    DriveKind,
    DriveSpec,
    GripperSpec,
    MazeSpec,
    RobotSpec,
    SensorSpec,
    VelocityKind,
    VelocitySpec,
    WheelLayout,
    WheelsSpec,
)
from simmer_tui.sim.trajectory import Trajectory, VelocityProfile
from simmer_tui.sim.velocity_commands import VelocityControl, parse_wait, velocity_shape
from simmer_tui.sim.velocity_plan import VelocityPlan, VelocityTarget, ramp_of
from simmer_tui.sim.wall_moves import wall_moves
from simmer_tui.sim.wheels import WheelKinematics, wheels_of
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_numbers.json")
CELLS = ((1, 1, 0, 1, 1, 1), (1, 0, 0, 1, 0, 1), (2, 1, 1, 1, 1, 3), (1, 1, 0, 0, 1, 1))
DISC = Footprint.of(RobotSpec.circle(6))
BOX = Footprint.of(RobotSpec.rectangle(6, 4))
ARROW = Footprint.of(RobotSpec.polygon(((3, 0), (-2, 2.5), (-1, 0), (-2, -2.5))))
LOADED = Footprint(2.5, (np.array(((2.5, 1), (4.5, 1), (4.5, -1), (2.5, -1))),), True)
BODIES = (DISC, BOX, ARROW, LOADED)
BLOCK = Block(20.0, 20.0, 3.0, 30.0)
DRIVES = tuple(
    DriveSpec(
        kind=kind,
        code=f"d{number}",
        error=Axes(0.03, 0.02, 0.04),
        bias=Axes(0.01, -0.02, 0.3),
        gain=1.0 + 0.1 * number,
        speed=3.0 + number if number < 4 else 45.0,
        start_lag=0.1 * number,
        acceleration=0.0 if number == 1 else 2.0 + number,
    )
    for number, kind in enumerate(DriveKind)
)
LIDAR = LidarSpec(
    kind=Lidar, number=1, code="l1", x=1.5, y=-0.5, z=4.0, rotation=20.0, rays=24, vertical_field_of_view=30.0
)


@cache
def maze() -> Maze:
    return Maze(MazeSpec(cells=CELLS))


@cache
def walls() -> Obstacles:
    return Obstacles.of_maze(maze().walls)


def free_poses(draw: random.Random, body: Footprint, obstacles: Obstacles, count: int) -> Iterator[Pose]:
    """Poses at which a robot stands free."""
    while count:
        pose = Pose(draw.uniform(0, 72), draw.uniform(0, 48), draw.uniform(-400, 400))
        if not obstacles.overlap(body, pose):
            count -= 1
            yield pose


def angles_in_degrees() -> Any:
    many = np.array([*range(-720, 721, 45), 0.1, 89.999, -1e-20, 359.5])
    return [
        [angles.cos_sin(each) for each in (0, 90, -90, 450, 180, -270, 37.5, -37.5, 359)],
        angles.cos_sin_array(many),
        angles.cos_sin_array(many[:5]),
        angles.cos_sin_array(np.abs(many % 360)),
        [angles.half_turn(each) for each in (180, -180, 181, 540, -190, 359, 0, -720, 90)],
        angles.rotation(30.0),
        angles.turned(np.array(((1.0, 2.0), (-3.0, 0.5))), *angles.cos_sin(75.0)),
    ]


def maze_walls() -> Any:
    hair = (0.0, 5e-7, -5e-7, 1.5e-6, -1.5e-6, 2.5e-6, -2.5e-6, 6.0)
    lines = [12.0 * k + off for k in range(7) for off in hair]
    places = np.array([(x, y) for x in lines for y in lines[:40]])
    flags = maze().are_walls(places[:, 0], places[:, 1])
    one_by_one = [maze().is_wall(*each) for each in places.tolist()]
    boxes = [
        ((x, y), (x + w, y + h))
        for x in (0.0, 2e-6, 0.5, 12.5, 24.000003, 23.99999)
        for y in (1e-6, 13.0, 24.0, 30.0)
        for w, h in ((0.5, 0.5), (11.0, 3.0), (11.499998, 0.0), (60.0, 0.0), (0.0, 20.0))
    ]
    return [
        "".join("01"[each] for each in one_by_one),
        "".join("01"[each] for each in flags.tolist()),
        [int(maze().has_walls(*box)) for box in boxes],
        maze().width,
        maze().height,
        maze().walls.astype(int),
    ]


def rays_from(places: list[tuple[float, float]]) -> np.ndarray:
    """Rays from each place in 16 directions, (4, n)."""
    directions = [angles.cos_sin(each) for each in (*range(0, 360, 30), 45, 135, 225, 315)]
    return np.array([(*place, *way) for place in places for way in directions]).T


def maze_rays() -> Any:
    places = [(6.0, 6.0), (12.0, 6.0), (6.0, 12.0), (18.0, 18.0), (54.0, 18.0), (42.0, 24.0), (12.0, 12.0)]
    places += [
        (48.0, 18.0),
        (66.0, 7.25),
        (40.5, 40.25),
        (24.0, 18.0),
        (18.0, 0.0),
        (30.0, 30.0),
        (-3.0, 7.0),
    ]
    x, y, dx, dy = rays_from(places)
    many = maze().cast_many(x, y, dx, dy)
    fan = [
        maze().cast_fan(*place, [angles.cos_sin(a) for a in (0, 90, 180, 270, 45, 200)])
        for place in places[:8]
    ]
    return [
        many,
        fan,
        [maze().cast(*place, 0.6, -0.8) for place in places[:8]],
        maze().incidence(x, y, dx, dy, many),
    ]


def floor_tiles() -> Any:
    draw = random.Random("floor")
    points = [(draw.uniform(-2, 74), draw.uniform(-2, 50)) for _ in range(60)]
    points += [(3.0 * k, 3.0 * (k % 7)) for k in range(25)]
    points += [(3.0 * k, 3.0 * k + 1.0) for k in range(16)]
    points += [(0.0, 0.0), (72.0, 48.0), (72.0, 0.0), (0.0, 48.0), (-0.1, 5.0), (5.0, 48.1)]
    tiles = Maze(MazeSpec(cells=((1,),), floor=((0, 1, 1, 0), (1, 1, 1, 1), (1, 0, 1, 1), (1, 1, 1, 0))))
    own = [(1.0, 1.0), (11.0, 1.0), (11.0, 11.0), (9.0, 9.0), (4.0, 4.0), (3.0, 3.0), (6.0, 6.0), (12.0, 0.0)]
    return [
        "".join("01"[each] for each in maze().black(np.array(points)).tolist()),
        tiles.black(np.array(own)),
    ]


def obstacles_of_a_maze() -> Any:
    found = []
    for obstacles in (walls(), walls().with_block(BLOCK), walls().with_block(Block(20, 20, 0.0))):
        corners = obstacles.corners
        near = obstacles.near(np.array((12.0, 12.0)), np.array((24.0, 21.0)))
        places = [obstacles.clearance(*each) for each in ((6, 6), (17, 20), (42.5, 7), (-3, 5), (65, 40))]
        found.append([obstacles.faces, corners, near[0].offset, near[1], places, obstacles.cells])
    alone = Maze(MazeSpec(cells=((1,),)))
    found.append([Obstacles.of_maze(alone.walls).faces, Obstacles.of_maze(alone.walls).corners])
    return found


def contacts_with_obstacles() -> Any:
    draw, found = random.Random("touch"), []
    for obstacles in (walls(), walls().with_block(BLOCK)):
        for body in BODIES:
            poses = np.array(
                [(draw.uniform(-5, 77), draw.uniform(-5, 53), draw.uniform(0, 360)) for _ in range(25)]
            )
            found.append("".join("01"[each] for each in obstacles.overlapped(body, poses).tolist()))
            for pose in (Pose(*each) for each in poses.tolist()):
                found.append(obstacles.nearest_point(body, pose))
                found.append(robot_problem(maze(), obstacles, body, pose))
                if obstacles.overlap(body, pose):
                    found.append(obstacles.touch(body, pose, pose))
            found.append(body.reach)
            found.append(body.front)
            found.append(body.edges)
    return found


def placements() -> Any:
    base = load_default().simulation
    small = replace(base, maze=MazeSpec(cells=CELLS), bot_center=(6.0, 6.0), block_center=(18.0, 18.0))
    specs = [
        small,
        replace(small, bot_center=(30.0, 6.0)),
        replace(small, bot_center=(-1.0, 6.0)),
        replace(small, bot_center=(72.0, 48.0)),
        replace(small, bot_center=(6.0, 48.01)),
        replace(small, bot_center=(17.0, 17.0), block_solid=True),
        replace(small, bot_center=(17.0, 17.0), block_solid=False),
        replace(small, block_center=(30.0, 6.0), block_solid=True),
        replace(small, block_center=(30.0, 6.0), block_size=0.0),
        replace(small, block_center=(math.nan, 6.0)),
        replace(small, block_center=(0.0, 0.0)),
        replace(small, block_center=(73.0, 0.0)),
        replace(small, bot_center=(math.inf, 0.0)),
        replace(small, robot=RobotSpec.circle(12.1), bot_center=(6.0, 7.0)),
        replace(small, robot=RobotSpec.circle(12.0), bot_center=(6.0, 7.0)),
        replace(small, robot=RobotSpec.circle(8.0), bot_center=(2.0, 2.0)),
        replace(small, maze=MazeSpec(cells=((0, 0), (0, 0)))),
        replace(small, block_center=(1.5, 1.5)),
        replace(small, block_center=(1.4, 1.5)),
    ]
    blocks = [block_problem(maze(), walls(), block) for block in (BLOCK, Block(1, 1, 3), Block(80, 1, 3))]
    return [[placement_problems(spec) for spec in specs], blocks]


def ways(draw: random.Random, start: Pose) -> Iterator[RobotPath]:
    """Random paths: with and without turn, one segment and several, short and longer than the maze."""
    for segments in (1, 4, 10):
        for length in (3.0, 15.0, 300.0):
            for turn in (0.0, draw.uniform(-30, 30), 400.0 if segments == 1 else -95.0):
                way = draw.uniform(0, 6.28)
                yield RobotPath.of_segments(
                    start,
                    length * math.cos(way) / segments,
                    length * math.sin(way) / segments,
                    turn,
                    segments,
                )


def first_contacts_of_paths() -> Any:
    draw, found = random.Random("paths"), []
    for obstacles in (walls(), walls().with_block(BLOCK)):
        for body in BODIES:
            for start in free_poses(draw, body, obstacles, 2):
                for way in ways(draw, start):
                    met = first_contact(body, obstacles, way, 87.0)
                    found.append(met)
                    if met is not None:
                        found.append(way.before(met.stop, 0.2, body.reach))
                        found.append(way.along(met.stop))
                        found.append(way.length_to(met.stop))
    return found


def first_contacts_of_arcs() -> Any:
    draw, found = random.Random("arcs"), []
    for obstacles in (walls(), walls().with_block(BLOCK)):
        for body in BODIES:
            for start in free_poses(draw, body, obstacles, 3):
                for rate in (0.0, 25.0, -80.0):
                    twist = Twist(draw.uniform(-15, 15), draw.uniform(-9, 9), rate)
                    arc = Arc.of(start, twist, 90.0 / abs(rate) if rate else 5.0)
                    met = first_arc_contact(body, obstacles, arc)
                    found.append(met)
                    if met is None:
                        continue
                    there = arc.pose_at(met.h)
                    for friction in (0.0, 0.3):
                        moves = list(wall_moves(body, obstacles, there, twist, friction))
                        found.append(moves)
                        found.append([move.arc(there, 0.5).end for move in moves])
    return found


def arcs_and_places() -> Any:
    arcs = [
        Arc.of(Pose(3, 4, 30), Twist(2, -1, 20), 3.0),
        Arc.of(Pose(3, 4, -75), Twist(5, 0.5, -40), 2.0),
        Arc.of(Pose(3, 4, 90), Twist(3, 0, 0), 4.0),
        Arc(Pose(1, 2, 45), (1.0, -2.0), 0.0, 2.0, 30.0),
        Arc.standing(Pose(7, 8, 9)),
    ]
    found: list[Any] = []
    for arc in arcs:
        last = min(arc.duration, 2.0)
        found += [arc.own_velocity, arc.turn_rate, arc.length if arc.duration < math.inf else 0]
        found += [arc.pose_after(t * last) for t in (0, 0.3, 1)]
        found += [arc.pose_at(arc.half_tangent(t * last)) for t in (0, 0.3, 1)]
        found += [arc.seconds_at(h) for h in (0.0, 0.5, 1.5)]
        for x in (0.0, 3.0, 5.0, 8.0):
            for y in (2.0, 4.5, 8.0):
                found.append(arc.seconds_in_box((x, y), (x + 1.0, y + 1.5)))
    times = np.array((1.0, 1.2, 1.5, 2.0, 2.5, 3.0))
    for some in (arcs[:3], arcs[:2], arcs[2:4], arcs[4:]):
        lots = [(arc, 0.5 + number, 6 // len(some)) for number, arc in enumerate(some)]
        found.append(poses_along(lots, times))
    found += [
        Twist(3, 4, 5).speed,
        Twist(3, 4, 5).scaled(0.5),
        Twist(r=1).moves,
        Twist(y=1).moves,
        Twist().moves,
    ]
    return found


def wheel_speeds() -> Any:
    found: list[Any] = []
    for layout in WheelLayout:
        spec = WheelsSpec(layout=layout, track=7.0, wheelbase=5.0, radius=3.5, top_speed=9.0)
        wheels = WheelKinematics.of(spec)
        found.append(wheels_of(spec))
        for twist in (Twist(4, 2, 30), Twist(-9, 1, -70), Twist(9), Twist(0, 0, 120), Twist()):
            found += [wheels.speeds(twist), wheels.share(twist), wheels.twist(wheels.speeds(twist))]
        asked = (3.0, -11.0, 7.0, 5.0)[: len(wheels.wheels)]
        found += [wheels.twist(asked), wheels.slip(asked), wheels.clamped(asked)]
    return found


def velocity_requests() -> Any:
    found: list[Any] = []
    texts = ("4", "2;3;20", "2,3,20,1.5", "-4;0.5", "1;2;3;4;5", "2;3;0;-1", "9;9;9;9", "1;0", "1e6", "1e7")
    for layout in (None, *WheelLayout):
        wheels = WheelsSpec(layout=layout, track=7.0, wheelbase=5.0, top_speed=9.0) if layout else None
        for drives in (DRIVES, DRIVES[2:3]):
            control = VelocityControl(drives, wheels)
            for kind in VelocityKind:
                spec = VelocitySpec(kind=kind, code="vv")
                found.append(velocity_shape(spec, wheels))
                found += [control.parse(spec, text, Twist(1, 2, 3)) for text in texts]
                found += [control.parse(spec, None, Twist()), control.parse(spec, "a;b;c", Twist())]
    found += [parse_wait(text) for text in ("0", "3600", "3600.1", "-0.1", "2.5", None, "x")]
    return found


def velocity_over_time() -> Any:
    found: list[Any] = [ramp_of(DRIVES), ramp_of(DRIVES[2:]), ramp_of(())]
    plan = VelocityPlan(0.05)
    orders = {
        0: VelocityTarget(Twist(4, 2, 30), 0.1, Twist(8, 8, 100)),
        2: VelocityTarget(Twist(4, 2, 30), 0.0),
        5: VelocityTarget(Twist(-4, 2, 0), 0.3, Twist(20, 0, 200)),
        6: VelocityTarget(Twist(1, 0, 0), 0.0, Twist(20, 20, 0)),
        30: VelocityTarget(Twist(), 0.02),
    }
    time = 0.0
    for step in range(40):
        if step in orders:
            found.append(plan.command(time, orders[step]))
        found += [time, plan.twist, plan.commanded, plan.moves, plan.due]
        time = min(plan.due, time + 0.1)
        plan.change(time)
    plan.halt()
    return [*found, plan.twist, plan.commanded, plan.moves, plan.due]


def errors_by_distance() -> Any:
    sensors = [
        sensor_of(OdometerSpec(kind=Odometer, number=1, code="o1", x=1.0, y=3.0, rotation=20.0, error=0.05)),
        sensor_of(GyroSpec(kind=Gyro, number=1, code="g1", error=0.02)),
    ]
    counting = [each for each in sensors if isinstance(each, CountingSensor)]
    errors = DistanceErrors(8, noise.Streams(5), counting)
    found: list[Any] = [errors.length(kind) for kind in DriveKind]
    drives = {drive.kind: drive for drive in DRIVES}
    some = {DriveKind.LEFT: drives[DriveKind.LEFT], DriveKind.UP: drives[DriveKind.UP]}
    bias = {DriveKind.RIGHT: Axes(0.1, 0.05, 2.0), DriveKind.ROT: Axes(0.01, 0.02, 0.03)}
    for rows in (drives, some):
        for twist in (Twist(3, 0, 0), Twist(-2, 1, 40), Twist(4, -3, -20), Twist(0, 0, 0)):
            parts = components(twist, rows)
            found.append(parts)
            for part in parts:
                errors.begin(part)
                found += [errors.left(part), errors.rates(part.drive.kind)]
                found += [errors.draws(part.drive.kind, sensor) for sensor in counting]
            for noisy in (True, False):
                true = TrueVelocity(twist, parts, errors, bias, noise=noisy)
                found += [true.whole, true.own]
                found += [true.counts(), true.counts(0.0), true.counts(5.0)]
            errors.advance(parts, 0.2, [part.drive.kind for part in parts[:1]])
            for part in parts:
                errors.begin(part)
                found += [errors.left(part), errors.rates(part.drive.kind)]
    found.append(noise.random_bias(3, (0.05, 1.0)))
    found += [noise.stream(3, "drive").standard_normal(2), noise.fault_stream("u1")]
    return found


def speed_profiles() -> Any:
    found: list[Any] = []
    for profile in (
        VelocityProfile(12.0, 4.0, 0.3, 8.0),
        VelocityProfile(1.0, 4.0, 0.0, 8.0),
        VelocityProfile(5.0, 2.0, 0.5),
        VelocityProfile(0.0, 2.0, 0.5, 1.0),
    ):
        found.append(profile.duration)
        found += [profile.fraction_at(t) for t in (-1, 0, 0.3, 0.5, 0.7, 0.9, 1.5, 2.5, 3.0, 3.5, 3.7, 9)]
        found += [profile.time_at(f) for f in (0, 0.01, 0.1, 0.3, 0.5, 0.8, 0.95, 1.0)]
    return found


def about(trajectory: Trajectory | Leg, times: np.ndarray) -> list[Any]:
    """All that a piece of motion says at some times."""
    found: list[Any] = [trajectory.before, trajectory.end_time, trajectory.duration]
    if isinstance(trajectory, Trajectory):
        found += [trajectory.held_at, trajectory.move, trajectory.contact, trajectory.poses_at(times)]
    for time in times.tolist():
        found += [trajectory.pose_at(time), trajectory.travelled(time), trajectory.moved(time)]
        found.append(trajectory.centres(time))
        if isinstance(trajectory, Trajectory):
            found += [[trajectory.rolled(name, time) for name in trajectory.wheels]]
            found += [[trajectory.turned(name, time) for name in trajectory.turns]]
            found += [trajectory.travel(time), trajectory.progress(time)]
    return found


def movements() -> Any:
    draw, found = random.Random("moves"), []
    sensors = [
        sensor_of(OdometerSpec(kind=Odometer, number=1, code="o1", x=1.0, y=3.0, rotation=20.0, error=0.05)),
        sensor_of(GyroSpec(kind=Gyro, number=1, code="g1", error=0.02)),
    ]
    counting = [each for each in sensors if isinstance(each, CountingSensor)]
    solid = walls().with_block(BLOCK)
    for rule in ContactRule:
        for clearance in (0.0, 0.15):
            planner = motion.Planner(4, rule, noise.Streams(9), clearance)
            for drive in DRIVES:
                body = draw.choice(BODIES)
                start = next(free_poses(draw, body, solid, 1))
                amount = draw.choice((200.0, -300.0)) if drive.kind.turns else draw.choice((9.0, 30.0))
                plan = planner.plan(drive, drive.bias, amount, start, 2.0, noise=True)
                plan = planner.counted(plan, counting, noise=True)
                before = motion.CollisionChecker(body, walls(), maze())
                after = motion.CollisionChecker(body, solid, maze())
                made = planner.checked(plan, before)
                times = 2.0 + plan.duration * np.array((-0.1, 0.0, 0.2, 0.55, 0.8, 1.0, 1.2))
                found += about(made, times[[0, 3, 5]])
                found.append([motion.rest_of(made, PathPosition(1, 1.0, 0.5))])
                for time in times.tolist()[1:5:2]:
                    found += about(made.stopped(time), times[[2, 4]])
                    found += [planner.checked_again(made, time, after).contact, made.place(time)]
                    found.append(planner.checked_again(made, time, after).rest_stop)
    still = motion.standing(Pose(6, 6, 10), 1.0, 2.0, 2.5)
    return [
        *found,
        *about(still, np.array((0.5, 1.5, 2.5, 4.0))),
        planner.standing(Pose(6, 6, 1), 1, 2, counting),
    ]


def legs() -> Any:
    found: list[Any] = []
    for twist, asked in (
        (Twist(3, 1, 20), Twist(3, 1, 20)),
        (Twist(-2, 0, 0), Twist(-2, 1, 0)),
        (Twist(0, 0, -30), Twist(0, 0, -30)),
        (Twist(0, 2, -30), Twist(0, -2, 0)),
        (Twist(1, 2, 5), Twist(2, 2, 0)),
        (Twist(1, 2, 5), Twist(0, 2, 0)),
    ):
        arc = Arc.of(Pose(6, 7, 30), twist, 2.0)
        leg = Leg(arc, 1.0, 3.0, arc.end, asked)
        found += about(leg, np.array((0.5, 1.0, 1.3, 2.9, 3.0, 4.0)))
        found += [leg.as_movement(), leg.cut(2.0), leg.cut(3.0), leg.arrival(1.5)]
    still = Leg(Arc.standing(Pose(1, 2, 3)), 1.0, math.inf, Pose(1, 2, 3), Twist())
    return [*found, still.centres(5.0), still.centres(math.inf), still.moved(math.inf), still.moved(4.0)]


def recent_motion() -> Any:
    arc = Arc.of(Pose(6, 7, 30), Twist(3, 1, 20), 2.0)
    turn = Arc.of(arc.end, Twist(0, 0, 60), 1.0)
    plan = motion.Planner(3, ContactRule.DRIVE, noise.Streams(9))
    moved = plan.plan(DRIVES[3], Axes(), 5.0, turn.end, 5.0, noise=True)
    pieces = [
        Leg(arc, 1.0, 3.0, arc.end, Twist(3, 1, 20)),
        Leg(turn, 3.5, 4.5, turn.end, Twist(0, 0, 60)),
        moved,
    ]
    times = np.array((0.0, 0.9, 1.0, 1.1, 2.9, 3.0, 3.1, 3.5, 3.6, 4.4, 4.5, 4.7, 5.0, 5.5, 6.0, 9.0))
    found: list[Any] = []
    for span in (0.0, 1.0, 3.0, 60.0):
        recent = RecentMotion(span)
        recent.add_block_place(BlockPlace(0.0, BLOCK))
        found.append(recent.poses(times, Pose(1, 2, 3), None))
        for piece in pieces:
            recent.add_motion(piece)
            found += [
                recent.poses(times, piece.pose_at(9), None),
                recent.poses(times[2:8], Pose(0, 0, 0), moved),
            ]
        for since in (1.5, 3.0, 3.2, 5.0):
            recent.add_block_place(BlockPlace(since, replace(BLOCK, x=since), held=since == 3.0))
            found.append([(part.start, part.stop, place) for part, place in recent.blocks(times)])
        found.append([place.at(Pose(5, 5, 90)) for _, place in recent.blocks(times)])
        recent.forget()
        found.append(recent.poses(times[:2], Pose(1, 2, 3), None))
    return found


SENSORS = tuple(
    sensor_of(spec)
    for spec in (
        UltrasonicSpec(
            kind=Ultrasonic, number=1, code="u1", x=2, y=1, z=2, rotation=15, field_of_view=20, error=0.02
        ),
        RangeSpec(
            kind=TimeOfFlight,
            number=1,
            code="t1",
            x=-2,
            z=4.5,
            rotation=-100,
            field_of_view=40,
            rays=4,
            max_range=30.0,
            min_range=2.0,
            gain=1.1,
            bias=0.2,
            drift=0.01,
            resolution=0.25,
            vertical_field_of_view=40.0,
            incidence_limit=50.0,
        ),
        CompassSpec(
            kind=Compass, number=1, code="c1", rotation=10, wrap=360, hard_iron=5, soft_iron=3, error=0.01
        ),
        LineSpec(kind=LineSensor, number=1, code="i1", x=1, y=1, z=2, field_of_view=60, threshold=0.4),
        LineSpec(
            kind=LineSensor, number=2, code="i2", z=3, field_of_view=70, analog=True, detects_white=True
        ),
        SensorSpec(kind=LoadSensor, number=1, code="s1", error=0.1),
        LIDAR,
    )
)


def sensors_that_observe() -> Any:
    draw, found = random.Random("sensors"), []
    poses = [(each.x, each.y, each.heading) for each in free_poses(draw, DISC, walls(), 4)]
    table = np.array([*poses, (17.0, 17.0, 40.0), (30.0, 6.0, 0.0), (14.5, 20.0, 0.0), (20.0, 15.0, 90.0)])
    for sensor in SENSORS:
        assert isinstance(sensor, ObservingSensor)
        for world in (World(maze(), BLOCK), World(maze(), replace(BLOCK, size=0.0), held=True)):
            expected = sensor.expected(world, table, 2.0)
            found += [sensor.true_values(world, table), expected, sensor.linearised(world, table)]
            found += [sensor.observe(world, Pose(*pose)) for pose in table[2:5].tolist()]
            finite = np.where(np.isfinite(expected), expected, 1.0)
            found += [sensor.model_error(finite, table), sensor.rough_likelihood(6.0, finite)]
            found.append(sensor.within_limits(finite, np.full(len(table), 0.5)).astype(int))
        found += [sensor.sees_block(size) for size in (0.0, 1.9, 2.0, 3.0, 4.5, 5.0)]
        worst = sensor.worst_case()
        found += [sensor.span, sensor.period, worst.error, worst.absolute_error]
        found += [sensor.steps, sensor.annealing]
        found += [sensor.anywhere(share) for share in (0.0, 0.3, 0.5, 0.7, 1.0)]
        for value in (-1.0, 0.0, 0.3, 0.4, 1.0, 1.6, 29.9, 30.0, 30.1, 359.999, 360.0, 361.5, math.inf):
            found += [sensor.reported(value), sensor.error(value, 1.0)]
            if math.isfinite(value):
                found.append(sensor.reading(value, None, 3.0))
            found.append(sensor.wrapped(value) if math.isfinite(value) else 0)
        generator = np.random.default_rng(4)
        found += [sensor.reading(true, generator, 3.0) for true in (0.0, 1.0, 12.0, 100.0)]
        found += [(p.field, p.label, p.kind, p.spread, p.unit, p.usual, p.step) for p in sensor.parameters]
        found += [(p.field, p.label, p.kind, p.spread, p.unit, p.usual, p.step) for p in sensor.noise_scales]
        found.append(sensor.least_error)
    spec = with_parameters(SENSORS[0].spec, {"offset": 0.5, "rotation": 40.0, "gain": 1.1})
    found += [
        spec.x,
        spec.y,
        spec.rotation,
        spec.gain,
        parameter_value(spec, "offset", (2.0, 1.0)),
        parameter_value(spec, "gain", (2.0, 1.0)),
    ]
    return found


def sensors_that_count() -> Any:
    found: list[Any] = []
    for spec in (
        OdometerSpec(kind=Odometer, number=1, code="o1", x=1, y=3, rotation=20, error=0.05, ticks_per_inch=8),
        OdometerSpec(
            kind=Odometer, number=2, code="o2", y=-3, error=0.05, drift=0.02, resolution=0.1, gain=1.2
        ),
        GyroSpec(kind=Gyro, number=1, code="g1", error=0.02, wrap=360.0, drift=0.1),
    ):
        sensor = sensor_of(spec)
        assert isinstance(sensor, CountingSensor)
        shape = (3, 2) if sensor.slips else (3,)
        draws = np.arange(1.0, 1.0 + math.prod(shape)).reshape(shape)
        found += [sensor.increments(12.0, (2.0, -1.0), draws), sensor.lever, sensor.counted_on(30, 2, -1)]
        found += [sensor.change((3.0, 1.0), (350.0, 6.0)), sensor.ideal(1.99), sensor.ideal(-0.01)]
        found += [sensor.worst_case().error, sensor.error(3.3, 3.0), sensor.reading(3.3, None, 5.0)]
        found += [sensor.least_error, sensor.period, sensor.wrapped(200.0), sensor.wrapped(-180.0)]
        found += [(p.field, p.label, p.kind, p.spread, p.unit, p.usual, p.step) for p in sensor.parameters]
        found += [(p.field, p.label, p.kind, p.spread, p.unit, p.usual, p.step) for p in sensor.noise_scales]
    return found


def lidar_turns() -> Any:
    found: list[Any] = []
    for spec in (
        LIDAR,
        replace(LIDAR, clockwise=False, missed_as_zero=True, max_range=20.0, incidence_limit=60.0, bias=0.3),
        replace(
            LIDAR, x=0.0, y=0.0, absolute_error=0.1, drift=0.01, gain=1.1, scan_rate=3.0, z=2.0, dropout=0.3
        ),
    ):
        lidar = Lidar(spec)
        found += [lidar.turned_by, lidar.moments(2), lidar.bearings]
        found += [lidar.revolution_at(t) for t in (0.0, 0.1, 0.2, 1.0, 2.0)]
        found += [lidar.complete_at(n) for n in (-1, 0, 1, 4)]
        found += [lidar.nearest_ray(b) for b in (0, 20, -20, 90, 180, 355, 1000, -7.4, -7.6)]
        found += [lidar.block_from(size) for size in (0.0, 2.0, 3.0, 4.0, 5.0)]
        for held in (False, True):
            block = replace(BLOCK, x=4.0, y=0.5) if held else BLOCK
            recent = RecentMotion(2.0)
            recent.add_block_place(BlockPlace(0.0, block, held=held))
            arc = Arc.of(Pose(16, 12.5, 30), Twist(3, 1, 40), 1.0)
            recent.add_motion(Leg(arc, 0.2, 1.2, arc.end, Twist(3, 1, 40)))
            turning = Turning(lidar, maze(), recent)
            found.append(turning.waits_until(1.0, None))
            for time in (0.6, 1.0, 3.0):
                now, generator = Now(time, arc.end, None), np.random.default_rng(3)
                read = [turning.reading(ray, now, generator) for ray in (None, 5)]
                found += [(each.value, each.true, each.view, each.took, each.scan) for each in read]
                found += [turning.waits_until(time, ray) for ray in (None, 5, 6)]
            scan = turning.scan(Now(3.0, arc.end, None), None)
            found += [extremes(scan), rays_of(scan, spec, Pose(1, 2, 3)).ends]
            found.append(rays_of(replace(scan, poses=np.empty((0, 3))), spec, Pose(1, 2, 30)))
            turning.forget()
            found += [turning.waits_until(1.0, 5), turning.ray("20"), turning.ray(None), turning.ray("x")]
            found.append(turning.ray("1e999"))
        found += [lidar.error(10.0, 9.0), lidar.error(500.0, 0.0), lidar.error(500.0, math.inf)]
        found += [lidar.reported(each) for each in (0.0, 5.9, 6.004, 20.0, 20.01, 472.4, 472.41)]
    nothing = LidarScan(0, np.array((0.0, math.inf)), np.zeros(2), np.zeros(2), np.empty((0, 3)))
    found.append(extremes(nothing))
    for like in ((5.0, 4.0), (5.0, 6.0), (5.0, 5.0), (5.0,)):
        found += [ray_bearings(np.array(like), count) for count in (1, 2, 4)]
    return found


def blocks_seen_and_taken() -> Any:
    found: list[Any] = []
    spec = GripperSpec(code="gr", reach=3.0, width=4.0)
    for block in (BLOCK, Block(20, 20, 3), Block(20, 20, 2, -45)):
        x, y, dx, dy = rays_from([(10.0, 20.0), (20.0, 20.0), (18.5, 20.0), (25.0, 15.0), (21.5, 30.0)])
        many = block.cast_many(x, y, dx, dy)
        found += [block.corners(), many, block.incidence(x, y, dx, dy, many)]
        found += [block.cast(*each) for each in zip(x, y, dx, dy, strict=True)]
    for pose in (Pose(15, 20, 0), Pose(14, 20, 0), Pose(17.2, 20, 0), Pose(15, 22.1, 0), Pose(20, 15, 90)):
        for body in (DISC, BOX):
            found += [missed_by(spec, body, pose, BLOCK), can_take(spec, body, pose, BLOCK)]
        found.append(can_take(spec, DISC, pose, Block(20, 20, 0)))
        gripper = Gripper(DISC, walls())
        for close in (True, True, False, True):
            found += [gripper.move(spec, close, BLOCK, pose, 1.5), gripper.closed, gripper.held]
            found += [gripper.block(BLOCK, Pose(10, 10, 45)), gripper.body.reach, gripper.body.holding]
    return found


def echoes_of_other_sensors() -> Any:
    # Sound goes 13504 in/s, so that 1 ms is 13.5 in.
    sent = {
        "a": (0.0, 0.004, 10.0),
        "b": (0.001, 0.005, 40.0),
        "me": (0.0, 0.1, 1.0),
        "c": (0.002, 0.009, 1.0),
    }
    pings = Pings(sent)
    return [
        pings.overheard(name, own, time)
        for name in ("me", "a", "other")
        for own in (0.2, 5.0, 30.0, 100.0)
        for time in (-0.001, 0.0, 0.0005, 0.001, 0.002, 0.004, 0.005, 0.009, 0.05)
    ]


def commands_and_rules() -> Any:
    texts = ["", "d", "d1", "d1-", "d1-3", " d1-3\r\n", "d1 3", "é-3", "d1-\x07", "\x0bd1-3", "x" * 100]
    values = [None, "", " ", "3", "+3.5e2", ".5", "5.", "nan", "1_000", "1e400", "x" * 40, " 7 ", "-0"]
    found: list[Any] = [command.parse_command(text, "console") for text in texts]
    found += [command.parse_command(text).shown for text in texts]
    found += [command.parse_value(value) for value in values]
    found += [
        printable(command.cut("a\n" * 50, 20)),
        command.cut("abcde", 5),
        command.cut("abcdef", 5),
    ]
    found.append(printable("a\x1b é\n"))
    kinds: list[rules.Rule[Any]] = [
        rules.NumberRule(),
        rules.NumberRule(0),
        rules.NumberRule(0, low_open=True),
        rules.NumberRule(0, 5),
        rules.NumberRule(0, 5, high_open=True),
        rules.NumberRule(0, 5, low_open=True),
        rules.NumberRule(0, 5, low_open=True, high_open=True),
        rules.NumberOrOffRule(1, 5),
        rules.PortOrOffRule(),
        rules.IntegerRule(0, 1),
        rules.IntegerRule(1, 3),
        rules.IntegerRule(1, 3, "a small number"),
        rules.FlagRule(),
        rules.ChoiceRule(("drive", "stop")),
        rules.WordRule(("one", "two"), (1, 2)),
        rules.WordOrRule(("all",), (math.inf,), other=rules.NumberRule(0, 5)),
        rules.PairRule(rules.NumberRule(0, 5)),
        rules.CodeRule(),
    ]
    given = [
        0,
        1,
        5,
        0.0,
        3.0,
        5.0,
        6,
        -1,
        True,
        False,
        "off",
        "3",
        "6,42",
        "0,5",
        "drvie",
        "stop",
        "one",
        "u1",
    ]
    given += ["all", "true", "70000", "65535", (1, 2), [1, 9], [1], 10**400, None, math.nan, "u 1", "u12"]
    for rule in kinds:
        found += [rule.allowed, rule.metavar, rule.schema]
        for value in given:
            for take in (rule.check, rule.from_text) if isinstance(value, str) else (rule.check,):
                try:
                    taken = take(value)  # type: ignore[arg-type]  # a text where it is one
                    found += [type(taken).__name__, taken, rule.plain(taken), rule.shown(taken)]
                except ValueError as error:
                    found.append(str(error))
    long = [
        [1] * 4,
        [1] * 5,
        [[1]],
        {"a": 1},
        10**30,
        10**30 - 1,
        -(10**30),
        "x" * 41,
        "x" * 40,
        1.5,
        True,
        False,
    ]
    found += [rules.describe(value) for value in long]
    found += [rules.listed(words) for words in (["a"], ["a", "b"], ["a", "b", "c"])]
    found += [rules.did_you_mean(word, ("Block", "maze")) for word in ("blok", "zzz", "MAZES")]
    return found


CASES: dict[str, Callable[[], Any]] = {
    case.__name__.replace("_", " "): case
    for case in (
        angles_in_degrees,
        maze_walls,
        maze_rays,
        floor_tiles,
        obstacles_of_a_maze,
        contacts_with_obstacles,
        placements,
        first_contacts_of_paths,
        first_contacts_of_arcs,
        arcs_and_places,
        wheel_speeds,
        velocity_requests,
        velocity_over_time,
        errors_by_distance,
        speed_profiles,
        movements,
        legs,
        recent_motion,
        sensors_that_observe,
        sensors_that_count,
        lidar_turns,
        blocks_seen_and_taken,
        echoes_of_other_sensors,
        commands_and_rules,
    )
}


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_those_that_were_kept(name: str) -> None:
    assert_kept(CASES[name](), KEPT, name)
