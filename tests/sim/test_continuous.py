"""Continuous motion: the same bits however often one looks, errors by distance, and what walls do to it."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import astuple, replace

from simmer_tui.config import load_default
from simmer_tui.sim import Axes, ContactRule, DriveKind, MazeSpec, Pose, RobotSpec, Simulator
from simmer_tui.sim.arc_contact import first_arc_contact
from simmer_tui.sim.arcs import Arc, Twist
from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.specs import VelocityKind, VelocitySpec, WheelLayout, WheelsSpec

SPEC = replace(
    load_default().simulation,
    velocities=tuple(
        VelocitySpec(kind=kind, code=code)
        for kind, code in zip(VelocityKind, ("vv", "vx", "vy", "vr", "ww"), strict=True)
    ),
    wheels=WheelsSpec(layout=WheelLayout.OMNI_4, top_speed=40.0),
)
ROOM = MazeSpec(((1,) * 8,) * 8)
WALLS = Obstacles.of_maze(Maze(SPEC.maze).walls)
BODIES = {
    "disc": RobotSpec.circle(6),
    "rectangle": RobotSpec.rectangle(6, 4),
    "L": RobotSpec.polygon(((3, 3), (-3, 3), (-3, -3), (3, -3), (3, 0), (0.5, 0.5))),
}


def robot(seed: int = 7, **changes: object) -> Simulator:
    """A robot of the default set, at a time other than 0."""
    simulator = Simulator(replace(SPEC, **changes), seed=seed)  # type: ignore[arg-type]  # any field
    simulator.advance(1000.3)
    return simulator


def exact_robot(**changes: object) -> Simulator:
    """A robot without errors in an empty room of 96 in, in its middle."""
    drives = tuple(replace(drive, error=Axes(), bias=Axes()) for drive in SPEC.drives)
    sensors = tuple(replace(sensor, error=0.0) for sensor in SPEC.sensors)
    fixed = {
        "sensors": sensors,
        "maze": ROOM,
        "drives": drives,
        "randbias": False,
        "bot_center": (48.0, 48.0),
        "block_size": 0.0,
    }
    return robot(**(fixed | changes))


def readings(simulator: Simulator) -> list[float]:
    return [simulator.true_value(code) for code in ("o1", "o2", "o3", "o4", "g1")]


def test_a_velocity_goes_on_until_it_is_changed() -> None:
    simulator = exact_robot()
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-2")
    assert simulator.pose.x == pytest.approx(60.0)
    simulator.execute("vv-0;0;0")
    simulator.execute("wt-2")
    assert simulator.pose.x == pytest.approx(60.0)
    assert simulator.time == pytest.approx(1004.3)


def test_commas_separate_values_too() -> None:
    simulator = exact_robot()
    simulator.execute("vv-6, 0,30")
    assert simulator.velocity == Twist(6.0, 0.0, 30.0)
    assert "vv has 3 or 4 values" in simulator.execute("vv-6,0").reason


def test_a_velocity_ends_after_its_time() -> None:
    simulator = exact_robot()
    simulator.execute("vv-6;0;0;1.5")
    simulator.execute("wt-5")
    assert simulator.pose.x == pytest.approx(57.0)
    assert simulator.velocity == Twist()


@pytest.mark.parametrize("before", ["vv-0;0;45", "vv-0;4;0", "vv-3;0;0"])
@pytest.mark.parametrize("slow", [{"start_lag": 0.4}, {"start_lag": 0.05, "acceleration": 40.0}])
def test_a_velocity_that_ends_by_its_time_ends_as_by_a_velocity_of_0(
    before: str, slow: dict[str, float]
) -> None:
    ends = []
    for timed in (("vv-3;0;0;1", "wt-3"), ("vv-3;0;0", "wt-1", "vv-0;0;0", "wt-2")):
        drives = exact_robot().spec.drives
        quick = tuple(
            replace(each, start_lag=0.05) if each.kind is DriveKind.RIGHT else replace(each, **slow)
            for each in drives
        )
        simulator = exact_robot(drives=quick)
        for command in (before, "wt-1", *timed):
            simulator.execute(command)
        ends.append(simulator.pose)
    for ended, halted in zip(*map(astuple, ends), strict=True):
        assert ended == pytest.approx(halted, abs=1e-9)


def test_a_velocity_that_is_not_sent_again_times_out() -> None:
    simulator = exact_robot(velocity_timeout=0.5)
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-0.4")
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-3")
    assert simulator.pose.x == pytest.approx(48.0 + 6 * 0.9)


def test_components_change_one_by_one() -> None:
    simulator = exact_robot()
    for command in ("vx-3", "vy-2", "vr-10", "vx-0"):
        simulator.execute(command)
    assert simulator.velocity == Twist(0.0, 2.0, 10.0)


def test_rim_speeds_drive_and_their_slip_is_told() -> None:
    simulator = exact_robot()
    done = simulator.execute("ww-1;2;3;4")
    assert done.velocity is not None
    assert done.velocity.slip == pytest.approx((-0.5, 0.5, -0.5, 0.5))
    assert simulator.velocity.x == pytest.approx(3.5)


@pytest.mark.parametrize(
    ("command", "part"),
    [
        ("vv-1;2", "vv has 3 or 4 values"),
        ("vx-1;0", "T, the seconds"),
        ("ww-1;2;3", "ww-W1;W2;W3;W4[;T]"),
        ("vv", "the value is missing, as in vv-VX;VY;OMEGA[;T]"),
        ("vv-1;;2", "the value is missing, as in vv-VX;VY;OMEGA[;T]"),
        ("vv-1e7;0;0", "beyond the limit"),
        ("wt--1", "a wait has 0 to"),
        ("wt", "the value is missing, as in wt-1"),
    ],
)
def test_a_velocity_that_makes_no_sense_is_refused(command: str, part: str) -> None:
    simulator = exact_robot()
    refused = simulator.execute(command)
    assert part in refused.reason
    assert (math.isnan(refused.reply), simulator.velocity) == (True, Twist())


def test_a_direction_without_a_drive_is_refused() -> None:
    drives = tuple(drive for drive in SPEC.drives if drive.kind in (DriveKind.RIGHT, DriveKind.ROT))
    simulator = exact_robot(drives=drives, wheels=None)
    assert "VY must be 0" in simulator.execute("vv-1;1;0").reason
    assert simulator.execute("vv--1;0;0").velocity is not None


def test_a_velocity_is_scaled_as_a_whole_to_the_rows_speed() -> None:
    simulator = exact_robot(wheels=None)
    simulator.execute("vv-12;3;60")
    assert simulator.velocity == Twist(6.0, 1.5, 30.0)


def test_a_movement_ends_a_velocity_and_a_velocity_waits_for_a_movement() -> None:
    simulator = exact_robot()
    simulator.execute("vv-6;0;0")
    simulator.begin("d1-12")
    assert simulator.velocity == Twist()
    assert simulator.begin("vx-3").status == "busy"


def test_a_stop_ends_a_velocity_at_once() -> None:
    simulator = exact_robot()
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-1")
    assert simulator.stop()
    simulator.execute("wt-1")
    assert simulator.pose.x == pytest.approx(54.0)


def test_instant_time_goes_on_by_the_loop_of_a_program_that_drives() -> None:
    simulator = exact_robot()
    for _ in range(3):
        simulator.execute("u1")
    assert simulator.time == 1000.3
    simulator.execute("vx-6")
    for _ in range(51):
        simulator.execute("u1")
        simulator.execute("u2")
        simulator.execute("vx-6")
    assert simulator.time == pytest.approx(1000.3 + 51 * 0.02)


def program(random_numbers: random.Random, seconds: float) -> list[tuple[float, str]]:
    """Times, after the start, and commands of a program that drives about at random."""
    time, commands = 0.0, []
    while time < seconds:
        x, y, r = (random_numbers.uniform(-8, 8) for _ in range(3))
        commands.append((time, f"vv-{x:.3f};{y * random_numbers.choice((0, 1)):.3f};{r * 15:.2f}"))
        time += random_numbers.uniform(0.05, 2.5)
    return commands


def driven(
    simulator: Simulator, commands: Sequence[tuple[float, str]], end: float, looks: Sequence[float]
) -> int:
    """Run a program, looking at the robot at some times; the number of looks at which it overlapped."""
    begin, overlaps, last = simulator.time, 0, ""
    for time, command in sorted([*commands, *((look, "") for look in looks)]):
        simulator.advance(begin + time)
        if command:
            last = command
        else:
            overlaps += WALLS.overlap(simulator.body, simulator.pose)
            simulator.begin("u1")
        if last:
            simulator.begin(last)
    simulator.advance(begin + end)
    return overlaps


def outcome(simulator: Simulator) -> tuple[object, ...]:
    return simulator.pose, simulator.contacts, simulator.distance, readings(simulator)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("rule", list(ContactRule))
@pytest.mark.parametrize("seed", [1, pytest.param(range(2, 26), marks=pytest.mark.slow)])
def test_looking_and_sending_again_change_no_bit_and_nothing_overlaps(
    body: str, rule: ContactRule, seed: int | range
) -> None:
    for each in [seed] if isinstance(seed, int) else seed:
        random_numbers = random.Random(f"{body} {each}")
        commands = program(random_numbers, 8.0)
        looks = [random_numbers.uniform(0.0, 8.0) for _ in range(60)]
        plain, watched = (robot(each, robot=BODIES[body], contact=rule, wheels=None) for _ in range(2))
        driven(plain, commands, 8.0, ())
        assert driven(watched, commands, 8.0, looks) == 0
        assert outcome(plain) == outcome(watched)


def test_forced_cuts_change_next_to_nothing() -> None:
    plain, cut = (exact_robot(drives=SPEC.drives, randbias=True) for _ in range(2))
    for simulator in (plain, cut):
        simulator.execute("vv-4;1;20")
    plain.advance(1003.3)
    for step in range(1, 451):
        cut.advance(1000.3 + 3.0 * step / 451)
        cut.set_bias({})
    cut.advance(1003.3)
    assert (cut.pose.x, cut.pose.y, cut.pose.heading) == pytest.approx(
        (plain.pose.x, plain.pose.y, plain.pose.heading), abs=1e-12
    )


def test_old_commands_keep_their_bits_with_continuous_motion_in_between() -> None:
    plain, mixed = (exact_robot(randbias=True, drives=SPEC.drives) for _ in range(2))
    for command in ("d1-3", "r1-40", "w1-2", "a1-3.5", "u1", "r1--15", "d1-2"):
        expected = plain.execute(command)
        mixed.execute("vv-0.5;0.2;5;0.3")
        mixed.execute("wt-0.3")
        mixed.teleport(expected.before)
        went = mixed.execute(command)
        if command != "u1":
            assert went.pose == expected.pose


def spread(simulator: Simulator, command: Sequence[str], count: int) -> np.ndarray:
    """Ends of `count` runs of commands, with odometers and gyro: (count, 6)."""
    rows = []
    for seed in range(count):
        simulator.reset(seed)
        for each in command:
            simulator.execute(each)
        pose = simulator.pose
        counted = [simulator.true_value(code) for code in ("o1", "o3", "g1")]
        rows.append((pose.x - 48.0, pose.y - 48.0, pose.heading, *counted))
    return np.array(rows)


@pytest.mark.parametrize(
    ("count", "within"), [(150, 0.245), pytest.param(20_000, 0.02, marks=pytest.mark.slow)]
)
def test_the_spread_over_a_cell_is_that_of_one_movement(count: int, within: float) -> None:
    drives = tuple(
        replace(drive, bias=Axes(0.01, 0.005, 0.1)) if drive.kind is DriveKind.RIGHT else drive
        for drive in SPEC.drives
    )
    simulator = exact_robot(drives=drives)
    ratios = spread(simulator, ["vv-6;0;0;2", "wt-2"], count).std(axis=0) / spread(
        simulator, ["d1-12"], count
    ).std(axis=0)
    assert ratios == pytest.approx(np.ones(6), abs=within)


def test_sending_a_velocity_fifty_times_a_second_does_not_drive_better() -> None:
    once, often = (exact_robot(drives=SPEC.drives) for _ in range(2))
    once.execute("vx-6")
    once.execute("wt-2")
    for _ in range(100):
        often.execute("vx-6")
        often.execute("wt-0.02")
    assert (often.pose.x, often.pose.y) == pytest.approx((once.pose.x, once.pose.y), abs=1e-9)


# -- contacts --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*BODIES, "disc with block"])
@pytest.mark.parametrize("block", [False, True])
@pytest.mark.parametrize("count", [25, pytest.param(400, marks=pytest.mark.slow)])
def test_no_contact_is_missed_late_or_within_an_obstacle(name: str, block: bool, count: int) -> None:
    if name in BODIES:
        body = Footprint.of(BODIES[name])
    else:
        held = np.array([(3, 1.5), (6, 1.5), (6, -1.5), (3, -1.5)], dtype=float)
        body = Footprint(radius=3.0, polygons=(held,), holding=True)
    obstacles = WALLS.with_block(Block(54.0, 18.0, 3.0, 17.0)) if block else WALLS
    numbers = random.Random(f"{name} {block}")
    contacts = 0
    for _ in range(count):
        pose = Pose(numbers.uniform(0, 96), numbers.uniform(0, 48), numbers.uniform(-180, 540))
        if obstacles.overlap(body, pose):
            continue
        rate = numbers.choice((0.0, 1e-14, 1e-6, numbers.uniform(-150, 150)))
        twist = Twist(numbers.uniform(-14, 14), numbers.uniform(-14, 14), rate)
        seconds = min(numbers.uniform(0.01, 3.0), 90.0 / abs(rate) if rate else 9.0)
        arc = Arc.of(pose, twist, seconds)
        met = first_arc_contact(body, obstacles, arc)
        samples = [seconds * step / 400 for step in range(1, 401)]
        inside = next((at for at in samples if obstacles.overlap(body, arc.pose_after(at))), math.inf)
        if met is None:
            assert inside == math.inf
            continue
        contacts += 1
        assert arc.seconds_at(met.h) <= inside
        assert not obstacles.overlap(body, arc.pose_at(met.h))
        assert obstacles.overlap(body, met.beyond)
        nearest = min(
            float(geometry.distance(part.geometry)) - part.margin
            for part in body.shapes(arc.pose_at(met.h))
            for geometry in obstacles.tree.geometries
        )
        # The tree's geometries are 1e-10 smaller than the obstacles, at a corner by the diagonal.
        assert nearest <= 1e-9
    assert contacts > count / 10


@pytest.mark.parametrize(("room", "touches"), [(5.0, True), (5.7, True), (5.9, False)])
def test_the_crest_of_an_arc_meets_a_wall_that_its_ends_are_far_from(room: float, touches: bool) -> None:
    """A quarter of a circle of 20 in, 90 degrees a second: the crest is 20 (1 - cos 45) = 5.86 in up."""
    body, obstacles = Footprint.of(BODIES["disc"]), Obstacles.of_maze(Maze(ROOM).walls)
    arc = Arc.of(Pose(30.0, 96.0 - 3.0 - room, 45.0), Twist(10.0 * math.pi, 0.0, -90.0), 1.0)
    met = first_arc_contact(body, obstacles, arc)
    assert (met is not None) is touches
    if met is not None:
        direction = math.degrees(math.acos(math.cos(math.radians(45.0)) + room / 20.0))
        assert arc.seconds_at(met.h) == pytest.approx((45.0 - direction) / 90.0, abs=1e-9)


def at_wall(heading: float, **changes: object) -> Simulator:
    """A disc 10 in from the lower wall of the room, facing it at an angle."""
    return exact_robot(bot_center=(48.0, 13.0), bot_rot=-heading, **changes)


def test_a_robot_that_meets_a_wall_slides_along_it_less_friction() -> None:
    simulator = at_wall(30.0, loop_time=1.0)
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-6")
    meets = 10.0 / 3.0
    slides = 6 * (math.cos(math.radians(30)) - 0.3 * 0.5)
    # A choice at a wall holds for 0.02 s, and one that is cut short for no less.
    assert simulator.pose.x == pytest.approx(
        48.0 + 6 * math.cos(math.radians(30)) * meets + slides * (6 - meets), abs=0.15
    )
    assert (simulator.pose.y, simulator.contacts) == (pytest.approx(3.0, abs=1e-8), 1)


def test_a_robot_that_meets_a_wall_squarely_stands_while_its_wheels_turn() -> None:
    simulator = at_wall(80.0)
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-9")
    assert simulator.pose.x - 48.0 < 10.0 / math.tan(math.radians(80)) + 1e-9
    assert simulator.true_value("o3") == pytest.approx(54.0)
    assert simulator.contacts == 1


def test_a_contact_ends_the_motion_where_the_rule_says_so() -> None:
    simulator = at_wall(30.0, contact=ContactRule.STOP)
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-9")
    stopped = simulator.pose
    simulator.execute("wt-3")
    assert simulator.pose == stopped
    simulator.execute("vv--6;0;0")
    simulator.execute("wt-1")
    assert simulator.pose.y > stopped.y


@pytest.mark.parametrize("examples", [8, pytest.param(60, marks=pytest.mark.slow)])
def test_a_pressed_robot_never_overlaps(examples: int) -> None:
    walls = Obstacles.of_maze(Maze(ROOM).walls)

    @settings(max_examples=examples, deadline=None)
    @given(st.floats(1.0, 89.0), st.sampled_from(sorted(BODIES)), st.floats(-100.0, 100.0))
    def check(angle: float, body: str, rate: float) -> None:
        simulator = at_wall(angle, robot=BODIES[body])
        simulator.execute(f"vv-6;0;{rate:.2f}")
        for _ in range(30):
            simulator.execute("wt-0.11")
            assert not walls.overlap(simulator.body, simulator.pose)

    check()


def test_a_gyro_counts_only_what_really_turned() -> None:
    simulator = at_wall(90.0, robot=RobotSpec.rectangle(6, 4))
    simulator.execute("vv-6;0;0")
    simulator.execute("wt-3")
    simulator.execute("vv-0;0;40")
    simulator.execute("wt-1")
    # Its front lies flush with the wall: it cannot turn.
    assert simulator.pose.heading == -90.0
    assert simulator.true_value("g1") == pytest.approx(0.0, abs=1e-9)
    assert simulator.true_value("o3") != pytest.approx(18.0)


def test_a_block_put_in_the_way_is_met() -> None:
    simulator = exact_robot(block_size=3.0, block_center=(20.0, 20.0), block_solid=True)
    simulator.execute("vx-6")
    simulator.execute("wt-1")
    simulator.move_block(70.0, 48.0)
    simulator.execute("wt-9")
    assert simulator.pose.x == pytest.approx(65.5)
    simulator.move_block(20.0, 20.0)
    simulator.execute("wt-1")
    assert simulator.pose.x == pytest.approx(71.5)


def test_noise_that_is_switched_off_leaves_a_straight_way() -> None:
    simulator = exact_robot(drives=SPEC.drives)
    simulator.execute("vx-6")
    simulator.noise = False
    simulator.execute("wt-3")
    assert (simulator.pose.y, simulator.pose.heading) == (48.0, 0.0)
    simulator.noise = True
    simulator.execute("wt-1")
    assert simulator.pose.heading != 0.0


@pytest.mark.parametrize(
    ("command", "wheels", "limited"),
    [
        ("vv-12;0;0", None, 0.5),  # 6 in/s is the row's Speed
        ("vv-3;0;0", None, 1.0),
        ("ww-20;5", WheelsSpec(layout=WheelLayout.DIFF, track=6.0, top_speed=10.0), 0.5),
        ("vv-20;0;0", WheelsSpec(layout=WheelLayout.DIFF, track=6.0, top_speed=10.0), 0.5),
    ],
)
def test_a_velocity_says_how_much_of_it_the_robot_can_do(
    command: str, wheels: WheelsSpec | None, limited: float
) -> None:
    done = exact_robot(wheels=wheels).execute(command)
    assert done.velocity is not None
    assert done.velocity.limited == pytest.approx(limited)
