"""Values on both sides of a threshold, and close to it: by hand."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.sim import (
    Axes,
    DriveKind,
    DriveSpec,
    MazeSpec,
    Pose,
    RobotSpec,
    SensorSpec,
    Simulator,
    columns,
)
from simmer_tui.sim.angles import cos_sin, half_turn
from simmer_tui.sim.arcs import Arc, Twist
from simmer_tui.sim.block import Block
from simmer_tui.sim.contact import first_contact
from simmer_tui.sim.distance_errors import components
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.motion import AT_ONCE, CollisionChecker, rebuilt
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import Contact, Path, PathPosition
from simmer_tui.sim.recent_motion import BlockPlace, RecentMotion
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.scan_rays import extremes
from simmer_tui.sim.sensors import (
    Gyro,
    GyroSpec,
    ObservingSensor,
    TimeOfFlight,
    Ultrasonic,
    UltrasonicSpec,
    World,
)
from simmer_tui.sim.sensors.faults import Faults, Pings, has_faults
from simmer_tui.sim.specs import VelocityKind, VelocitySpec, WheelLayout, WheelsSpec
from simmer_tui.sim.trajectory import Trajectory, VelocityProfile
from simmer_tui.sim.velocity_commands import VelocityControl, VelocityRequest
from simmer_tui.sim.wheels import WheelKinematics

ALL = VelocitySpec(kind=VelocityKind.ALL, code="vv")
DRIVES = tuple(DriveSpec(kind=kind, code=kind.value[:2], speed=4.0) for kind in DriveKind)
ULTRA = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1")
WALL = MazeSpec(((1, 1, 1), (1, 0, 1), (1, 1, 1)))


@pytest.mark.parametrize("size", [0.25, 1.0, -0.25, -1.0])
def test_any_component_moves(size: float) -> None:
    assert Twist(size).moves
    assert Twist(0.0, size).moves
    assert Twist(0.0, 0.0, size).moves
    assert not Twist(0.0, -0.0, 0.0).moves


@pytest.mark.parametrize(
    ("asked", "kind"),
    [
        (Twist(0.5), DriveKind.RIGHT), (Twist(-0.5), DriveKind.LEFT), (Twist(0.0, 0.5), DriveKind.UP),
        (Twist(0.0, -0.5), DriveKind.DOWN), (Twist(0.5, -0.5), DriveKind.RIGHT),
        (Twist(0.4, 0.5, 9.0), DriveKind.UP), (Twist(-0.5, 0.4, 9.0), DriveKind.LEFT),
        (Twist(0.0, 0.0, 0.5), DriveKind.ROT), (Twist(), DriveKind.ROT),
    ],
)  # fmt: skip
def test_a_leg_is_a_movement_of_its_greatest_direction(asked: Twist, kind: DriveKind) -> None:
    arc = Arc.of(Pose(1.0, 2.0, 30.0), Twist(0.3, 0.1, 5.0), 2.0)
    movement = Leg(arc, 1.0, 3.0, arc.end, asked).as_movement()
    assert (movement.kind, movement.path.segments, movement.start_time) == (kind, 1, 1.0)
    assert (movement.totals.x, movement.totals.y, movement.totals.r) == pytest.approx((0.6, 0.2, 10.0))


@pytest.mark.parametrize(
    ("seconds", "points"), [(0.0, 2), (1.0, 2), (1.01, 3), (2.0, 3), (2.01, 4), (9.0, 4)]
)
def test_a_leg_is_drawn_with_a_piece_for_each_six_degrees(seconds: float, points: int) -> None:
    arc = Arc.of(Pose(0.0, 0.0, 0.0), Twist(1.0, 0.0, 6.0), 2.5)
    assert len(Leg(arc, 5.0, 7.5, arc.end, Twist()).centres(5.0 + seconds)) == points


@pytest.mark.parametrize("value", [0.5, -0.5])
def test_components_use_the_row_of_their_direction(value: float) -> None:
    rows = {drive.kind: drive for drive in DRIVES}
    ahead, back = (DriveKind.RIGHT, DriveKind.LEFT)[:: 1 if value > 0 else -1]
    up, down = (DriveKind.UP, DriveKind.DOWN)[:: 1 if value > 0 else -1]
    found = components(Twist(value, value, value), rows)
    assert [part.drive.kind for part in found] == [ahead, up, DriveKind.ROT]
    assert [(part.speed, part.commanded_speed) for part in found] == [(value, 0.5)] * 3
    left = components(Twist(value, value, value), {kind: rows[kind] for kind in (back, down)})
    assert [part.drive.kind for part in left] == [back, down]


@pytest.mark.parametrize(
    ("text", "limited", "seconds"),
    [
        ("3.9;0;0", 1.0, math.inf), ("4;0;0", 1.0, math.inf), ("-4.4;0;0;0.5", 1 / 1.1, 0.5),
        ("2;6;0", 2 / 3, math.inf), ("0;0;4.1", 4 / 4.1, math.inf), ("0;0;0", 1.0, math.inf),
    ],
)  # fmt: skip
def test_a_velocity_is_limited_by_the_fastest_of_its_rows(text: str, limited: float, seconds: float) -> None:
    request = VelocityControl(DRIVES, None).parse(ALL, text, Twist())
    assert isinstance(request, VelocityRequest)
    assert request.limited == pytest.approx(limited)
    assert request.seconds == seconds
    x, y, r = (float(each) for each in text.split(";")[:3])
    target = request.target.twist
    assert (target.x, target.y, target.r) == pytest.approx((x * limited, y * limited, r * limited))


@pytest.mark.parametrize(("text", "taken"), [("1;0;0;0.5", True), ("1;0;0;0", False), ("1;0;0;-0.5", False)])
def test_a_velocity_lasts_more_than_no_time(text: str, taken: bool) -> None:
    request = VelocityControl(DRIVES, None).parse(ALL, text, Twist())
    assert isinstance(request, VelocityRequest) == taken


@pytest.mark.parametrize(("x", "share"), [(8.9, 1.0), (9.0, 1.0), (9.5, 9.0 / 9.5)])
def test_rims_are_as_fast_as_their_top_speed(x: float, share: float) -> None:
    wheels = WheelKinematics.of(WheelsSpec(layout=WheelLayout.DIFF, top_speed=9.0))
    assert wheels.share(Twist(x)) == pytest.approx(share)


@pytest.mark.parametrize(
    ("x", "distance"), [(0.75, 0.25), (0.6, 0.1), (0.4, 0.9), (0.0, 0.5), (-0.4, 0.1), (-0.6, math.inf)]
)
@pytest.mark.parametrize("turn", range(4))
def test_a_ray_meets_a_small_block_near_its_origin(x: float, distance: float, turn: int) -> None:
    """A block of 1 in, its centre `x` ahead: from outside its near side, from inside the far one."""
    cos, sin = cos_sin(90.0 * turn)
    block = Block(x * cos, x * sin, 1.0)
    assert block.cast(0.0, 0.0, cos, sin) == pytest.approx(distance)
    many = block.cast_many(*(np.array([each]) for each in (0.0, 0.0, cos, sin)))
    assert many.tolist() == [block.cast(0.0, 0.0, cos, sin)]


def test_the_cosine_of_an_angle_is_that_of_the_angle_within_a_turn() -> None:
    for angle, within in ((-0.5, 359.5), (0.5, 0.5), (-1.5, 358.5), (360.5, 0.5), (-720.5, 359.5)):
        assert cos_sin(angle) == (math.cos(math.radians(within)), math.sin(math.radians(within)))
    assert [half_turn(each) for each in (180.5, -179.5, -180.0, 180.0)] == [-179.5, -179.5, 180.0, 180.0]
    assert half_turn(np.array((180.5, -180.0, 540.0))).tolist() == [-179.5, 180.0, 180.0]
    assert math.isnan(half_turn(math.inf))


def test_a_short_echo_counts_and_a_range_of_0_does_not() -> None:
    empty = np.zeros(3)
    scan = LidarScan(0, np.array((0.5, 0.0, math.inf)), np.array((10.0, 20.0, 30.0)), empty, empty)
    found = extremes(scan)
    assert (found.nearest, found.farthest, found.missed) == ((0.5, 10.0), (0.5, 10.0), 2)


def test_the_block_was_where_it_lay_before_the_run_and_moves_at_once() -> None:
    times = np.array((-0.5, 0.0, 0.4, 0.5, 0.6))
    recent = RecentMotion(2.0)
    first, second, third = (BlockPlace(since, Block(since, 1.0, 1.0)) for since in (-0.5, 0.0, 0.5))
    for place in (first, second, third):
        recent.add_block_place(place)
    assert [(part.start, part.stop, place) for part, place in recent.blocks(times)] == [
        (0, 4, second),
        (4, 5, third),
    ]


def test_a_leg_ends_where_it_ended_also_for_the_last_of_many_times() -> None:
    arc = Arc.of(Pose(0.0, 0.0, 0.0), Twist(2.0), 1.0)
    recent = RecentMotion(9.0)
    recent.add_motion(Leg(arc, 1.0, 2.0, arc.end, Twist(2.0)))
    for times in ((0.5, 1.5, 2.5), (1.5, 2.0), (1.0, 2.0, 7.0), (1.5, 1.75)):
        poses = recent.poses(np.array(times), arc.end, None)
        expected = [2.0 * min(max(time - 1.0, 0.0), 1.0) for time in times]
        assert poses[:, 0].tolist() == pytest.approx(expected), times


def test_a_thin_robot_meets_a_corner_that_is_near_its_centre() -> None:
    """A body of 8 x 1 in turns clockwise beside a corner 0.8 in from its centre: by acos(0.5 / 0.8)."""
    body = Footprint.of(RobotSpec.rectangle(8.0, 1.0))
    walls = Obstacles.of_maze(Maze(WALL).walls)
    start = Pose(12.0 - 0.8, 24.0, 90.0)
    turn = Path.of_segments(start, 0.0, 0.0, -80.0, 1)
    met = first_contact(body, walls, turn, 60.0)
    assert met is not None
    assert met.stop.turned * 80.0 == pytest.approx(math.degrees(math.acos(0.5 / 0.8)), abs=1e-6)
    later = first_contact(body, walls, turn, 60.0, PathPosition(0, 0.5, 0.0))
    assert later == met


def test_a_rest_is_blocked_at_once_within_a_millionth_of_an_inch() -> None:
    maze = Maze(WALL)
    checker = CollisionChecker(Footprint.of(RobotSpec.circle(6.0)), Obstacles.of_maze(maze.walls), maze)
    assert checker.size == pytest.approx(math.hypot(36.0, 36.0))
    for gap, blocked in ((0.0, True), (0.5 * AT_ONCE, True), (1.5 * AT_ONCE, False), (1.0, False)):
        for length in (0.5, 5.0):
            end = (9.0 - gap + length, 18.0)
            rest = Path(0.0, 0.0, ((9.0 - gap, 18.0), end))
            assert checker.blocked_at_once(rest) == blocked, (gap, length)
    assert not checker.blocked_at_once(Path(0.0, 0.0, ((9.0, 18.0), (9.0, 18.0))))


@pytest.mark.parametrize(
    ("profile", "duration", "shares"),
    [
        # 0.5 s of lag, ramps of 0.5 s up to 2 in/s (0.5 in each), and 0.25 s at full speed.
        (VelocityProfile(1.5, 2.0, 0.5, 4.0), 1.75, {0.5: 0.0, 0.75: 1 / 12, 1.0: 1 / 3, 1.5: 11 / 12}),
        # A triangle: 0.5 in, of which half within sqrt(0.125) s.
        (VelocityProfile(0.5, 2.0, 0.0, 4.0), math.sqrt(0.5), {math.sqrt(0.125): 0.5, 0.25: 0.25, 0.0: 0.0}),
        (VelocityProfile(0.5, 2.0, 0.25), 0.5, {0.25: 0.0, 0.375: 0.5, 0.5: 1.0, 0.6: 1.0}),
        (VelocityProfile(0.0, 2.0, 0.25), 0.0, {0.0: 0.0}),
    ],
)  # fmt: skip
def test_a_profile_by_hand(profile: VelocityProfile, duration: float, shares: dict[float, float]) -> None:
    assert profile.duration == pytest.approx(duration)
    for elapsed, share in shares.items():
        assert profile.fraction_at(elapsed) == pytest.approx(share, abs=1e-12)
        if 0.0 < share < 1.0:
            assert profile.time_at(share) == pytest.approx(elapsed)


def test_a_small_solid_block_is_in_the_way() -> None:
    base = load_default().simulation
    spec = replace(base, block_solid=True, block_size=0.5, block_center=(15.0, 42.0), randbias=False)
    drives = tuple(replace(drive, error=replace(drive.error, x=0.0, y=0.0, r=0.0)) for drive in base.drives)
    simulator = Simulator(replace(spec, drives=drives))
    assert simulator.execute("d1-9").pose.x == pytest.approx(15.0 - 0.25 - 3.0)
    read = Simulator(replace(spec, drives=drives, block_center=(15.0, 41.5))).execute("d1-9")
    assert read.contact is not None
    assert read.contact.cell is None


@pytest.mark.parametrize(("rays", "bearings"), [(1, [20.0]), (2, [5.0, 35.0]), (3, [5.0, 20.0, 35.0])])
def test_rays_are_spread_over_the_field_of_view(rays: int, bearings: list[float]) -> None:
    spec = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", rotation=20.0, field_of_view=30.0, rays=rays)
    assert Ultrasonic(spec).bearings == bearings


@pytest.mark.parametrize(("least", "contradicts"), [(3.9, False), (4.0, False), (4.1, True)])
def test_a_least_range_is_not_above_the_greatest(least: float, contradicts: bool) -> None:
    spec = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", min_range=least, max_range=4.0)
    what = "the least range, 4.1, must not be above the greatest, 4"
    for asked in (Ultrasonic, Ultrasonic(spec)):
        found = asked.contradiction(spec)
        assert found == (((columns.MIN_RANGE, columns.MAX_RANGE), what) if contradicts else None)
    assert Gyro(spec).contradiction(spec) is None


AHEAD = Path.lazy(Pose(0.0, 0.0, 0.0), 2.0, 0.0, 0.0, 5)


def slid(ended: bool, drift: bool = True) -> Trajectory:
    """Ten inches ahead in two seconds from 1 s on; a contact in the middle, and its rest ends at 2.5 s."""
    contact = Contact(Pose(5.0, 0.0, 0.0), (8.0, 0.0), 2, 1.0, 0.5, 2.0, ended, drift)
    stop = PathPosition(0, 1.0, 0.5) if ended else None
    return rebuilt(AHEAD, DriveKind.RIGHT, Axes(10.0), 1.0, 2.0, contact, stop)


def test_a_movement_is_cut_short_before_its_end_only() -> None:
    free = rebuilt(AHEAD, DriveKind.RIGHT, Axes(10.0), 1.0, 2.0)
    assert free.stopped(3.0) is free
    assert [free.stopped(time).cut for time in (2.9, 1.0, 0.5)] == [2.9, 1.0, 1.0]
    assert [free.stopped(2.0).pose_at(time).x for time in (1.5, 2.0, 2.5)] == pytest.approx([2.5, 5.0, 5.0])
    assert free.stopped(2.5).stopped(2.5).cut == 2.5


def test_a_movement_that_is_stopped_has_the_contacts_that_it_had_until_then() -> None:
    held = slid(True)
    assert held.held_at == pytest.approx(2.5)
    for time, touched, blocked in (
        (1.9, False, False),
        (2.0, True, False),
        (2.4, True, False),
        (2.6, True, True),
    ):
        stopped = held.stopped(time)
        assert (stopped.contact is not None) == touched, time
        assert (stopped.contact is not None and stopped.contact.ended) == blocked, time
        assert (stopped.rest is not None) == touched
        assert (stopped.rest_stop is not None) == blocked
    went = [held.pose_at(time).x for time in (1.5, 2.0, 2.25, 2.5, 2.75, 3.0)]
    assert went == pytest.approx([2.5, 5.0, 6.25, 7.5, 7.5, 7.5])
    assert [held.travelled(time) for time in (1.5, 2.25, 3.0)] == pytest.approx([2.5, 6.25, 7.5])
    assert slid(False).held_at is None
    assert slid(False).pose_at(3.0).x == pytest.approx(10.0)
    ended = replace(slid(True), rest=None, rest_stop=None)
    assert ended.held_at == 2.0
    assert ended.pose_at(2.5).x == pytest.approx(5.0)
    assert [len(ended.centres(time)) for time in (1.0, 1.5, 2.5)] == [2, 3, 4]
    assert [len(held.centres(time)) for time in (1.0, 1.5, 2.5)] == [2, 3, 5]


class FixedDraws:
    """A generator whose draws are given."""

    def __init__(self, *draws: float) -> None:
        self.draws = list(draws)

    def random(self, size: int | None = None) -> Any:
        return self.draws.pop(0) if size is None else np.array([self.draws.pop(0) for _ in range(size)])

    def standard_normal(self) -> float:
        return self.draws.pop(0)


@pytest.mark.parametrize(
    ("draws", "reading"),
    [
        ((0.1, 0.9, 0.25), math.inf), ((0.2, 0.9, 0.25), 12.0), ((0.3, 0.1, 0.25), 11.0),
        ((0.3, 0.3, 0.25), 12.0), ((0.3, 0.29, 0.75), 31.0), ((0.19, 0.0, 0.75), math.inf),
    ],
)  # fmt: skip
def test_a_reading_is_missed_or_any_value_by_its_draws(draws: tuple[float, ...], reading: float) -> None:
    """Dropouts of 0.2 come before outliers of 0.3, which are from 1 to 41 in."""
    row = replace(ULTRA, dropout=0.2, outlier=0.3, min_range=1.0, max_range=41.0)
    faults = Faults(Ultrasonic(row), cast(Any, FixedDraws(*draws)), Pings())
    assert faults.reading(12.0, cast(Any, FixedDraws(0.7)), 5.0) == reading


def test_a_walk_goes_with_the_root_of_the_time_since_the_last_reading() -> None:
    row = GyroSpec(kind=Gyro, number=1, code="g1", random_walk=0.5)
    faults = Faults(Gyro(row), cast(Any, FixedDraws(1.0, -3.0, 9.0)), Pings())
    nothing = cast(Any, FixedDraws())
    read = [faults.reading(10.0, nothing, time) for time in (0.0, 0.25, 0.25, 4.25)]
    assert read == pytest.approx([10.0, 10.0 + 0.5 * 0.5, 10.25, 10.25 - 3.0 * 0.5 * 2.0])


@pytest.mark.parametrize(("draw", "heard"), [(0.29, True), (0.3, False)])
def test_an_echo_of_another_is_read_by_its_probability(draw: float, heard: bool) -> None:
    """Sound of 1 ms earlier, from a reflector 15 in away: (15 + 20 - 13.504) / 2 in."""
    row = replace(ULTRA, read_time=0.06, cross_talk=0.3)
    pings = Pings({"ultra9": (4.999, 5.02, 15.0)})
    faults = Faults(Ultrasonic(row), cast(Any, FixedDraws(draw)), pings)
    read = faults.reading(20.0, cast(Any, FixedDraws(0.0)), 5.0)
    assert read == pytest.approx((15.0 + 20.0 - 13.503937) / 2.0 if heard else 20.0)
    assert pings.sent["ultra1"] == (5.0, 5.06, 20.0)


def test_readings_have_faults_only_if_a_column_says_so() -> None:
    assert not has_faults(Ultrasonic(ULTRA))
    assert has_faults(Ultrasonic(replace(ULTRA, read_time=0.1)))
    assert not has_faults(TimeOfFlight(replace(ULTRA, kind=TimeOfFlight, read_time=0.1)))
    for column in ("dropout", "outlier"):
        assert has_faults(TimeOfFlight(replace(ULTRA, kind=TimeOfFlight, **{column: 0.1})))
    assert has_faults(Gyro(GyroSpec(kind=Gyro, number=1, code="g1", random_walk=0.1)))


@pytest.mark.parametrize(
    ("body", "reach"),
    [(RobotSpec.circle(6.0), 3.0), (RobotSpec.rectangle(6.0, 4.0), 3.0)],
    ids=["disc", "box"],
)
def test_touching_is_not_overlapping_within_a_ten_billionth_of_an_inch(body: RobotSpec, reach: float) -> None:
    walls, footprint = Obstacles.of_maze(Maze(WALL).walls), Footprint.of(body)
    depths = (-1e-9, 0.0, 0.9e-10, 1.2e-10, 1e-9)
    for x, sign in ((12.0 - reach, 1.0), (24.0 + reach, -1.0), (reach, -1.0), (36.0 - reach, 1.0)):
        poses = [(x + sign * depth, 18.0, 180.0) for depth in depths]
        expected = [False, False, False, True, True]
        assert walls.overlapped(footprint, np.array(poses)).tolist() == expected, x
        assert [walls.overlap(footprint, Pose(*pose)) for pose in poses] == expected, x
    far = np.array([(6.0, 6.0, 0.0), (6.0, 6.0, 90.0), (18.0, 18.0, 0.0), (18.0, 18.0, 45.0)])
    assert walls.overlapped(footprint, far).tolist() == [False, False, True, True]
    assert walls.overlapped(footprint, np.empty((0, 3))).tolist() == []


def test_a_deviation_of_readings_is_at_least_that_of_a_grid() -> None:
    assert Ultrasonic(replace(ULTRA, error=0.2)).worst_case().error == pytest.approx(math.hypot(0.2, 0.05))
    assert Gyro(GyroSpec(kind=Gyro, number=1, code="g1", error=0.3)).worst_case().error == 0.3
    assert Gyro(GyroSpec(kind=Gyro, number=1, code="g1", error=0.05)).worst_case().error == 0.1
    expected, poses = np.array((0.0, 3.0)), np.zeros((2, 3))
    row = replace(ULTRA, error=0.1, absolute_error=0.3)
    assert Ultrasonic(row).model_error(expected, poses).tolist() == pytest.approx([0.4, 0.5])
    limits = Ultrasonic(replace(ULTRA, min_range=1.0, max_range=9.0))
    values = np.array((1.5, 1.6, 8.4, 8.5))
    assert limits.within_limits(values, np.full(4, 0.5)).tolist() == [False, True, True, False]
    assert Ultrasonic(ULTRA).within_limits(values - 1.0, np.full(4, 0.5)).tolist() == [
        False,
        True,
        True,
        True,
    ]


class Legs:
    """A listener that keeps the legs that have ended."""

    def __init__(self) -> None:
        self.ended: list[Leg] = []

    def leg_begun(self, leg: Leg) -> None:
        """Nothing is kept of a leg that may still be cut short."""

    def leg_ended(self, leg: Leg) -> None:
        self.ended.append(leg)

    def velocity_expired(self, time: float) -> None:
        """Nothing is kept of it."""


def exact(**changes: Any) -> tuple[Simulator, Legs]:
    """A robot without errors in the middle of a room of 96 in."""
    base = load_default().simulation
    drives = tuple(replace(drive, error=Axes()) for drive in base.drives)
    spec = replace(base, drives=drives, randbias=False, maze=MazeSpec(((1,) * 8,) * 8), velocities=(ALL,))
    simulator = Simulator(replace(spec, bot_center=(48.0, 48.0), block_size=0.0, **changes))
    simulator.noise = False
    simulator.listener = legs = Legs()
    return simulator, legs


@pytest.mark.parametrize("body", [RobotSpec.circle(6.0), RobotSpec.rectangle(6.0, 4.0)], ids=["disc", "box"])
@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_a_turn_is_a_chain_of_quarter_turns(body: RobotSpec, speed: float) -> None:
    simulator, legs = exact(robot=body)
    simulator.begin(f"vv-{speed};0;100;3")
    simulator.advance(10.0)
    assert [leg.duration for leg in legs.ended] == pytest.approx([0.9, 0.9, 0.9, 0.3])
    radius = speed / math.radians(100.0)
    angle = math.radians(300.0)
    there = (48.0 + radius * math.sin(angle), 48.0 + radius * (1.0 - math.cos(angle)))
    assert (simulator.pose.x, simulator.pose.y) == pytest.approx(there)
    assert simulator.pose.heading == pytest.approx(300.0)
    assert simulator.distance == pytest.approx(3.0 * speed)


def test_velocities_of_one_moment_make_one_leg() -> None:
    simulator, legs = exact()
    for text in ("vv-3;0;0", "vv-4;0;0", "vv-5;0;0"):
        simulator.begin(text)
    simulator.advance(0.5)
    for text in ("vv-5;0;0", "vv-2;0;0;0.5"):
        simulator.begin(text)
    simulator.advance(1.0)
    simulator.advance(2.0)
    assert [(leg.start_time, leg.end_time) for leg in legs.ended] == [(0.0, 0.5), (0.5, 1.0)]
    assert [leg.commanded.x for leg in legs.ended] == [5.0, 2.0]
    assert simulator.pose.x == pytest.approx(48.0 + 2.5 + 1.0)
    assert (simulator.leg, simulator.next_event, simulator.velocity.moves) == (None, math.inf, False)


def test_a_contact_counts_once_while_a_robot_stays_at_a_wall() -> None:
    """It leaves the wall for less than 0.1 s, which belongs to the same contact, or for longer."""
    for away, contacts in ((0.05, 1), (0.09, 1), (0.11, 2), (0.5, 2)):
        simulator, _ = exact()
        simulator.teleport(Pose(90.0, 48.0, 0.0))
        simulator.begin("vv-6;0;0")
        simulator.advance(1.0)
        assert simulator.pose.x == pytest.approx(93.0)
        assert simulator.contacts == 1
        simulator.begin("vv--6;0;0")
        simulator.advance(1.0 + away / 2)
        assert simulator.pose.x == pytest.approx(93.0 - 3.0 * away)
        simulator.begin("vv-6;0;0")
        simulator.advance(3.0)
        assert simulator.pose.x == pytest.approx(93.0)
        assert simulator.contacts == contacts, away


def test_the_held_block_is_the_last_part_of_a_body() -> None:
    square = np.array(((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)))
    body = Footprint(2.5, (square, square + np.array((4.0, 0.0))), True)
    parts = body.shapes(Pose(10.0, 20.0, 90.0))
    assert [part.held for part in parts] == [False, False, True]
    assert [part.margin for part in parts] == [2.5, 0.0, 0.0]
    assert [part.geometry.bounds for part in parts] == [
        pytest.approx(bounds) for bounds in ((10, 20, 10, 20), (9, 19, 11, 21), (9, 23, 11, 25))
    ]
    assert body.reach == pytest.approx(math.hypot(5.0, 1.0))
    assert body.front == 5.0
    assert [part.held for part in replace(body, holding=False).shapes(Pose(0.0, 0.0, 0.0))] == [False] * 3


class Dial(ObservingSensor):
    """A sensor whose readings are from 20 to 50."""

    name = "dial"
    meaning = "a dial"
    columns = ()

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return 20.0 + pose.x, None

    def anywhere(self, fraction: float) -> float:
        return 50.0 - 30.0 * fraction


def test_the_span_of_a_sensor_is_that_of_its_values() -> None:
    row = SensorSpec(kind=Dial, number=1, code="d1", gain=2.0, bias=1.0, drift=0.5)
    dial = Dial(row)
    assert dial.span == 30.0
    world = World(Maze(WALL), Block(0.0, 0.0, 0.0))
    poses = np.array([(3.0, 1.0, 0.0), (5.0, 1.0, 0.0)])
    assert dial.expected(world, poses, 4.0).tolist() == [49.0, 53.0]
    assert dial.linearised(world, poses).by_pose.tolist() == [
        pytest.approx([1.0, 1.0]),
        [0.0, 0.0],
        [0.0, 0.0],
    ]
    assert (dial.sees_block(3.0), dial.within_limits(poses[:, 0], poses[:, 0]).tolist()) == (
        False,
        [True, True],
    )
