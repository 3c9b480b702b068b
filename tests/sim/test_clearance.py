"""Room that a set keeps between a robot that was stopped and what stopped it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.errors import PlacementError
from simmer_tui.sim import Axes, ContactRule, DriveKind, MazeSpec, Pose, RobotSpec, Simulator
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import Path, PathPosition

ROOM = MazeSpec(((1,) * 4,) * 4)
WALLS = Obstacles.of_maze(Maze(ROOM).walls)


def robot_in_room(clearance: float, x: float, **changes: object) -> Simulator:
    """A square robot of 6 in without errors, facing the right wall of a room of 48 in."""
    spec = load_default().simulation
    drives = tuple(replace(drive, error=Axes(), bias=Axes()) for drive in spec.drives)
    placed = replace(
        spec, maze=ROOM, robot=RobotSpec.rectangle(6, 6), drives=drives, randbias=False,
        bot_center=(x, 24.0), bot_rot=0.0, block_size=0.0, clearance=clearance,
    )  # fmt: skip
    simulator = Simulator(replace(placed, **changes))  # type: ignore[arg-type]  # any field
    simulator.advance(1000.3)
    return simulator


@pytest.mark.parametrize("rule", list(ContactRule))
def test_a_drive_ends_so_far_before_the_wall(rule: ContactRule) -> None:
    simulator = robot_in_room(0.25, 40.0, contact=rule)
    done = simulator.execute("d1-12")
    assert simulator.pose.x == pytest.approx(45.0 - 0.25)
    assert done.contact is not None
    # What was touched is the wall; where the robot stands is before it.
    assert done.contact.point[0] == pytest.approx(48.0)
    assert (done.contact.ended, done.contact.drift) == (True, False)
    assert simulator.contacts == 1


def test_it_never_backs_behind_its_start() -> None:
    simulator = robot_in_room(0.25, 44.9)
    for _ in range(3):
        assert simulator.execute("d1-12").contact is not None
        assert simulator.pose.x == 44.9


def test_a_turn_ends_so_far_along_the_rim() -> None:
    # A corner of the square, 4.24 in from the centre, meets the wall 4 in away.
    reach, gap = 3 * math.sqrt(2), 0.25
    touching = robot_in_room(0.0, 44.0)
    touching.execute("r1-40")
    clear = robot_in_room(gap, 44.0)
    clear.execute("r1-40")
    assert touching.pose.heading == pytest.approx(45 - math.degrees(math.acos(4 / reach)))
    assert clear.pose.heading == pytest.approx(touching.pose.heading - math.degrees(gap / reach))


def test_a_robot_that_keeps_clear_can_turn_a_little_where_a_touching_one_cannot() -> None:
    turned = []
    for clearance in (0.0, 0.1):
        simulator = robot_in_room(clearance, 40.0)
        simulator.execute("d1-12")
        simulator.execute("r1-1")
        turned.append(simulator.pose.heading)
    assert turned == pytest.approx([0.0, 1.0])


def test_an_error_that_presses_against_a_wall_keeps_its_distance_too() -> None:
    # 10 % to the right on a way along the right-hand wall, 0.5 in away.
    simulator = robot_in_room(0.1, 20.0, bot_center=(20.0, 3.5))
    simulator.set_bias({DriveKind.RIGHT: Axes(y=-0.1)})
    done = simulator.execute("d1-12")
    assert done.contact is not None
    assert (done.contact.ended, done.contact.drift) == (False, True)
    assert simulator.pose.x == pytest.approx(32.0)
    # A path of 12 by -1.2 in is 0.1 in before its contact 0.1 * 1.2 / 12.06 in from the wall.
    assert simulator.pose.y == pytest.approx(3.0 + 0.1 * 1.2 / math.hypot(12, 1.2))


_POSES = st.builds(Pose, st.floats(5, 43), st.floats(5, 43), st.floats(-180, 180))


@settings(max_examples=15)
@given(
    pose=_POSES,
    commands=st.lists(
        st.tuples(st.sampled_from(["d1", "d2", "d3", "d4", "r1"]), st.floats(-60, 60)), min_size=1, max_size=6
    ),
    clearance=st.floats(0.001, 1.0),
    rule=st.sampled_from(ContactRule),
)
def test_no_robot_stands_in_a_wall_or_behind_its_start(
    pose: Pose, commands: list[tuple[str, float]], clearance: float, rule: ContactRule
) -> None:
    simulator = robot_in_room(clearance, 24.0, contact=rule)
    try:
        simulator.teleport(pose)
    except PlacementError:
        return
    for code, value in commands:
        before = simulator.pose
        simulator.execute(f"{code}-{value!r}")
        assert not WALLS.overlap(simulator.body, simulator.pose)
        gone = simulator.pose.x - before.x, simulator.pose.y - before.y
        assert math.hypot(*gone) <= abs(value) + 1e-9


@settings(max_examples=20)
@given(
    segments=st.integers(1, 10),
    move=st.floats(0, 3),
    turn=st.floats(-30, 30),
    reach=st.floats(0, 5),
    segment=st.integers(0, 9),
    turned=st.floats(0, 1),
    translated=st.floats(0, 1),
    distance=st.floats(0, 20),
)
def test_going_back_along_a_path_goes_that_far(
    segments: int,
    move: float,
    turn: float,
    reach: float,
    segment: int,
    turned: float,
    translated: float,
    distance: float,
) -> None:
    path = Path.of_segments(Pose(3.0, 4.0, 20.0), move, 0.0, turn, segments)
    arc = math.radians(abs(turn)) * reach

    def gone(place: PathPosition) -> float:
        return (place.segment + place.turned) * arc + (place.segment + place.translated) * move

    stop = PathPosition(min(segment, segments - 1), turned, translated if turned == 1.0 else 0.0)
    back = path.before(stop, distance, reach)
    assert back <= stop
    assert gone(stop) - gone(back) == pytest.approx(min(distance, gone(stop)), abs=1e-6)
    assert path.before(stop, distance, reach, stop) == stop
