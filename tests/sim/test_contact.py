"""Effects of a contact on a movement."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.errors import PlacementError
from simmer_tui.sim import (
    Axes,
    ContactRule,
    DriveKind,
    GripperSpec,
    MazeSpec,
    Pose,
    RobotSpec,
    SimulationSpec,
    Simulator,
)
from simmer_tui.sim.motion import rebuilt
from simmer_tui.sim.path import Path
from simmer_tui.sim.trajectory import Trajectory

ROOM = MazeSpec(((1,) * 4,) * 4)
SQUARE = RobotSpec.rectangle(6, 6)
OBLONG = RobotSpec.rectangle(6, 4)


def in_room(spec: SimulationSpec, **changes: object) -> SimulationSpec:
    """An empty room of 48 by 48 in, the block in a corner, the robot at its right wall, facing it."""
    placed = replace(spec, maze=ROOM, bot_center=(45.0, 24.0), block_center=(3.0, 3.0))
    return replace(placed, **changes)  # type: ignore[arg-type]  # any field


def with_bias(spec: SimulationSpec, kind: DriveKind, bias: Axes) -> Simulator:
    simulator = Simulator(spec)
    simulator.set_bias({kind: bias})
    simulator.advance(1000.3)
    return simulator


# -- measured in numbers ---------------------------------------------------------------------


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("segments", [1, 10, 100])
def test_a_disc_at_a_wall_turns(noisy_spec: SimulationSpec, segments: int) -> None:
    turned = 0
    for seed in range(50):
        simulator = Simulator(in_room(noisy_spec, num_segments=segments), seed)
        planned = simulator.execute("r1-90")
        assert planned.trajectory is not None
        turned += simulator.pose.heading == pytest.approx(planned.trajectory.totals.r)
        assert planned.contact is None or not planned.contact.ended
    assert turned == 50


def test_by_the_letter_of_the_manual_a_disc_at_a_wall_often_does_not_turn(noisy_spec: SimulationSpec) -> None:
    held = 0
    for seed in range(50):
        simulator = Simulator(in_room(noisy_spec, contact=ContactRule.STOP), seed)
        held += simulator.execute("r1-90").contact is not None
    assert 20 <= held <= 40


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("segments", [10, 1, 100])
def test_along_a_wall_it_touches_the_robot_drives_all_the_way(
    noisy_spec: SimulationSpec, segments: int
) -> None:
    for seed in range(30):
        simulator = Simulator(in_room(noisy_spec, num_segments=segments), seed)
        outcome = simulator.execute("w1-4")
        assert outcome.trajectory is not None
        assert outcome.contact is None or not outcome.contact.ended
        assert simulator.pose.y - 24 == pytest.approx(outcome.trajectory.totals.y, abs=0.2)


@pytest.mark.parametrize(("backed_off", "least", "most"), [(0.0, 0, 3), (1.0, 30, 30)])
def test_the_corner_of_a_rectangle_truly_meets_the_wall(
    noisy_spec: SimulationSpec, backed_off: float, least: int, most: int
) -> None:
    turned = 0
    for seed in range(30):
        spec = in_room(noisy_spec, robot=OBLONG, bot_center=(45.0 - backed_off, 24.0))
        outcome = Simulator(spec, seed).execute("r1-90")
        turned += outcome.contact is None or not outcome.contact.ended
    assert least <= turned <= most


# -- step by step ----------------------------------------------------------------------------


def test_a_rotation_whose_drift_meets_a_wall_turns_on_where_it_stands(course_spec: SimulationSpec) -> None:
    # Of ten parts each goes 0.1 in to the right in the global frame at first; the wall is 0.25 in away.
    spec = in_room(course_spec, bot_center=(44.75, 24.0))
    simulator = with_bias(spec, DriveKind.ROT, Axes(x=1.0 / 90))
    outcome = simulator.execute("r1-90")
    contact, trajectory = outcome.contact, outcome.trajectory
    assert contact is not None
    assert trajectory is not None
    assert (contact.segment, contact.turned, contact.ended, contact.drift) == (2, 1.0, False, True)
    assert outcome.pose.x == pytest.approx(45.0, abs=1e-9)
    assert outcome.pose.y == contact.pose.y > 24.0
    assert outcome.pose.heading == pytest.approx(90.0)
    assert contact.time == pytest.approx(1000.3 + 3 / 10 * 0.75)
    half = trajectory.pose_at(1000.3 + 0.75 * 0.65)
    assert (half.x, half.y) == (outcome.pose.x, outcome.pose.y)
    assert half.heading == pytest.approx(58.5)
    assert simulator.execute("g1").reply == pytest.approx(90.0)
    assert simulator.contacts == 1
    assert trajectory.trail(2000.0)[-1].tolist() == [outcome.pose.x, outcome.pose.y]
    # The odometers count the plan: every part's hundredth of an inch for each degree.
    free = with_bias(replace(spec, bot_center=(24.0, 24.0)), DriveKind.ROT, Axes(x=1.0 / 90))
    free.execute("r1-90")
    for code in ("o1", "o2", "o3", "o4"):
        assert simulator.execute(code).reply == free.execute(code).reply
    assert simulator.distance == pytest.approx(0.25, abs=0.02)
    assert free.distance == pytest.approx(1.0)


def test_a_rotation_that_meets_a_wall_while_it_turns_ends_there(course_spec: SimulationSpec) -> None:
    simulator = Simulator(in_room(course_spec, robot=SQUARE))
    outcome = simulator.execute("r1-90")
    assert outcome.contact is not None
    assert (outcome.contact.ended, outcome.contact.drift) == (True, False)
    assert (outcome.pose.x, outcome.pose.y) == (45.0, 24.0)
    assert outcome.pose.heading == pytest.approx(0.0, abs=1e-9)
    assert outcome.trajectory is not None
    assert outcome.trajectory.rest is None
    assert simulator.time == pytest.approx(0.75), "its time is as planned"


def test_a_translation_that_drifts_into_a_wall_goes_on_straight(course_spec: SimulationSpec) -> None:
    # Up along the wall, 6 in of 12 to the left of the robot's own frame: towards the wall.
    simulator = with_bias(in_room(course_spec, bot_center=(43.0, 24.0)), DriveKind.UP, Axes(x=0.5, r=-0.1))
    outcome = simulator.execute("w1-12")
    contact, trajectory = outcome.contact, outcome.trajectory
    assert contact is not None
    assert trajectory is not None
    assert (contact.ended, contact.drift, contact.turned) == (False, True, 1.0)
    assert 0.0 < contact.translated < 1.0
    done = contact.segment + contact.translated
    assert outcome.pose.x == pytest.approx(45.0, abs=1e-9)
    assert outcome.pose.y == pytest.approx(contact.pose.y + 12 * (10 - done) / 10)
    assert outcome.pose.heading == contact.pose.heading < 0.0
    assert contact.time == pytest.approx(1000.3 + 2.0 * done / 10)
    assert outcome.time == pytest.approx(1002.3)
    assert simulator.execute("g1").reply == pytest.approx(contact.pose.heading), "it turned no further"
    assert simulator.distance == pytest.approx(
        math.hypot(0.5, 1.0) * 1.2 * done + 12 * (10 - done) / 10, abs=1e-6
    )
    assert trajectory.travelled(contact.time) < simulator.distance
    trail = trajectory.trail(outcome.time)
    assert trail[-2].tolist() == [contact.pose.x, contact.pose.y]
    assert trail[-1].tolist() == [outcome.pose.x, outcome.pose.y]


def test_the_commanded_direction_is_that_at_the_start_of_the_movement(course_spec: SimulationSpec) -> None:
    # It turns left into the wall above; what is left of the way is along +X still.
    simulator = with_bias(in_room(course_spec, bot_center=(10.0, 43.0)), DriveKind.RIGHT, Axes(r=2.0))
    outcome = simulator.execute("d1-20")
    assert outcome.contact is not None
    assert (outcome.contact.ended, outcome.contact.drift) == (False, True)
    left = 20 * (10 - outcome.contact.segment - outcome.contact.translated) / 10
    assert outcome.pose.x == pytest.approx(outcome.contact.pose.x + left)
    assert outcome.pose.y == pytest.approx(45.0, abs=1e-9)
    assert outcome.pose.heading == outcome.contact.pose.heading > 0.0


def test_a_contact_in_the_turn_of_a_translation_leaves_the_whole_part_to_drive(
    course_spec: SimulationSpec,
) -> None:
    # The square touches the wall with its front; the first turn of its drive up is into the wall.
    simulator = with_bias(in_room(course_spec, robot=SQUARE), DriveKind.UP, Axes(r=1.0))
    outcome = simulator.execute("w1-12")
    assert outcome.contact is not None
    assert (outcome.contact.segment, outcome.contact.translated) == (0, 0.0)
    assert outcome.contact.turned == pytest.approx(0.0, abs=1e-9)
    assert (outcome.contact.ended, outcome.contact.drift) == (False, True)
    assert (outcome.pose.x, outcome.pose.y) == pytest.approx((45.0, 36.0))
    assert outcome.pose.heading == pytest.approx(0.0, abs=1e-9)
    assert outcome.contact.time == 1000.3


def test_what_is_left_of_a_translation_may_meet_a_wall_and_end_there(course_spec: SimulationSpec) -> None:
    simulator = with_bias(in_room(course_spec, bot_center=(44.0, 40.0)), DriveKind.UP, Axes(x=0.5))
    begun = simulator.begin("w1-12")
    planned = simulator.trajectory
    assert planned is not None
    assert planned.contact is not None
    assert (planned.contact.ended, planned.contact.drift) == (True, True)
    assert planned.contact.pose.y < 44.0
    assert planned.rest_stop is not None
    assert planned.held_at == pytest.approx(1000.3 + 2.0 * 5 / 12)
    done = simulator.finish(begun)
    assert done.pose.x == pytest.approx(45.0, abs=1e-9)
    assert done.pose.y == pytest.approx(45.0, abs=1e-9)
    assert done.time == pytest.approx(1002.3)
    assert simulator.contacts == 1
    assert simulator.execute("o1").reply == pytest.approx(12.0), "the wheels slip"


def test_a_wall_ahead_ends_a_translation_at_once(course_spec: SimulationSpec) -> None:
    simulator = with_bias(in_room(course_spec, bot_center=(30.0, 24.0)), DriveKind.RIGHT, Axes(y=0.05, r=0.3))
    outcome = simulator.execute("d1-40")
    assert outcome.contact is not None
    assert (outcome.contact.ended, outcome.contact.drift) == (True, False)
    assert outcome.pose == outcome.contact.pose
    assert outcome.contact.point[0] == 48.0


def test_by_the_letter_of_the_manual_every_contact_ends_a_movement(course_spec: SimulationSpec) -> None:
    spec = in_room(course_spec, bot_center=(44.75, 24.0), contact=ContactRule.STOP)
    for code, kind, drift in (("r1-90", DriveKind.ROT, True), ("w1-12", DriveKind.UP, True)):
        simulator = with_bias(spec, kind, Axes(x=1.0 / 90))
        if kind is DriveKind.UP:
            simulator.teleport(Pose(45.0, 24.0, 0.0))
        outcome = simulator.execute(code)
        assert outcome.contact is not None
        assert (outcome.contact.ended, outcome.contact.drift) == (True, drift)
        assert outcome.pose == outcome.contact.pose
        assert simulator.contacts == 1


def test_a_touch_without_overlap_is_no_contact(course_spec: SimulationSpec) -> None:
    simulator = Simulator(in_room(course_spec))
    for text in ("w1-6", "s1-6", "r1-90", "r1--90", "a1-2", "d1-2"):
        assert simulator.execute(text).contact is None, text
    assert simulator.contacts == 0


def test_a_rotation_held_in_its_last_translation_is_over_there(course_spec: SimulationSpec) -> None:
    simulator = with_bias(in_room(course_spec, num_segments=1), DriveKind.ROT, Axes(y=-1.0 / 90))
    outcome = simulator.execute("r1-90")  # one part: it turns by 90, then goes an inch to its right
    assert outcome.contact is not None
    assert (outcome.contact.ended, outcome.contact.drift) == (False, True)
    assert outcome.pose == Pose(45.0, 24.0, 90.0)
    assert outcome.contact.time == simulator.time


# -- a block that is moved in mid-motion -----------------------------------------------------


def drifting(course_spec: SimulationSpec) -> Simulator:
    """Up along the wall from (44, 6) with an eighth of the way towards it: contact at y = 14, t = 4/3."""
    spec = in_room(course_spec, bot_center=(44.0, 6.0), block_solid=True, num_segments=8)
    simulator = with_bias(spec, DriveKind.UP, Axes(x=0.125))
    simulator.begin("w1-32")
    return simulator


def movement(simulator: Simulator) -> Trajectory:
    assert simulator.last_trajectory is not None
    return simulator.last_trajectory


def test_a_drop_still_to_come_is_forgotten(course_spec: SimulationSpec) -> None:
    simulator = drifting(course_spec)
    first = movement(simulator).contact
    assert first is not None
    assert (first.pose.y, first.time) == (pytest.approx(14.0), pytest.approx(1000.3 + 4 / 3))
    simulator.advance(1000.3 + 0.5)
    simulator.move_block(43.5, 14.0)
    contact = movement(simulator).contact
    assert contact is not None
    assert (contact.ended, contact.drift, contact.cell) == (True, False, None)
    assert contact.pose.y == pytest.approx(9.5, abs=0.1)
    simulator.move_block(3.0, 40.0)
    again = movement(simulator).contact
    assert again == first


def test_dropped_errors_stay_dropped_and_the_rest_is_searched_again(course_spec: SimulationSpec) -> None:
    simulator = drifting(course_spec)
    simulator.advance(1000.3 + 2.0)
    assert simulator.pose.y == pytest.approx(18.0)
    assert movement(simulator).contact is not None
    assert not movement(simulator).contact.ended  # type: ignore[union-attr]
    simulator.move_block(45.0, 28.0)
    assert simulator.pose.y == pytest.approx(18.0)
    held = movement(simulator)
    assert held.contact is not None
    assert held.contact.ended
    assert held.contact.pose.y == pytest.approx(14.0), "the contact counted is the first"
    simulator.advance(1000.3 + 2.5)
    simulator.move_block(3.0, 40.0)
    assert movement(simulator).held_at is None
    simulator.move_block(45.0, 32.0)
    simulator.advance(1100.0)
    assert simulator.pose.y == pytest.approx(32.0 - 4.5)
    assert simulator.contacts == 1


def test_a_movement_that_has_ended_stays_ended(course_spec: SimulationSpec) -> None:
    simulator = drifting(course_spec)
    simulator.advance(1000.3 + 2.0)
    simulator.move_block(45.0, 26.0)
    simulator.advance(1000.3 + 3.0)
    assert simulator.pose.y == pytest.approx(21.5)
    simulator.move_block(3.0, 40.0)
    simulator.advance(1100.0)
    assert simulator.pose.y == pytest.approx(21.5)


@pytest.mark.parametrize("moment", [0.1, 0.5, 0.93, 1.7])
def test_a_block_put_down_in_a_turn_of_many_circles_is_found(
    course_spec: SimulationSpec, moment: float
) -> None:
    # A part turns by 1,000 degrees and takes 8.3 s; the block comes between where no part begins.
    spec = in_room(course_spec, robot=RobotSpec.rectangle(8, 2), bot_center=(24.0, 24.0), block_solid=True)
    simulator = Simulator(spec)
    simulator.advance(1000.3)
    simulator.begin("r1-10000")
    simulator.advance(1000.3 + moment * 1000 / 120)
    before = simulator.pose.heading
    radians = math.radians(before + 100)
    simulator.move_block(24 + 4.5 * math.cos(radians), 24 + 4.5 * math.sin(radians))
    contact = movement(simulator).contact
    assert contact is not None
    assert before < contact.pose.heading < before + 100
    assert not simulator.walls.with_block(simulator.block).overlap(simulator.footprint, contact.pose)
    simulator.advance(2000.0)
    assert simulator.pose == contact.pose


def test_stopped_before_its_rest_ends_a_movement_was_not_ended_by_the_wall(
    course_spec: SimulationSpec,
) -> None:
    simulator = with_bias(in_room(course_spec, bot_center=(44.0, 40.0)), DriveKind.UP, Axes(x=0.5))
    simulator.begin("w1-12")
    planned = movement(simulator).contact
    assert planned is not None
    assert planned.ended
    simulator.advance(planned.time + 0.1)
    simulator.stop()
    stopped = movement(simulator)
    assert stopped.contact == structs.replace(planned, ended=False)
    assert stopped.held_at is None
    assert simulator.contacts == 1


# -- what it touches -------------------------------------------------------------------------


def walls_of(spec: SimulationSpec) -> shapely.Geometry:
    """Walls and the outside in full size, made apart from the code under test."""
    rows = spec.maze.rows
    cells = [
        shapely.box(12 * c, 12 * (rows - 1 - r), 12 * c + 12, 12 * (rows - r))
        for r, row in enumerate(spec.maze.cells)
        for c, value in enumerate(row)
        if value == 0
    ]
    inside = shapely.box(0, 0, spec.maze.width, spec.maze.height)
    return shapely.union_all([shapely.box(-99, -99, 999, 999) - inside, *cells])


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("robot", [RobotSpec.circle(6), SQUARE, OBLONG], ids=["disc", "square", "oblong"])
def test_a_contacts_point_is_on_the_wall_of_its_cell(noisy_spec: SimulationSpec, robot: RobotSpec) -> None:
    spec = replace(noisy_spec, robot=robot)
    walls = walls_of(spec)
    random = np.random.default_rng(4)
    seen = set()
    for seed in range(20):
        simulator = Simulator(replace(spec, bot_center=(66.0, 30.0)), seed)
        for _ in range(4):
            code = random.choice(["w1", "s1", "a1", "d1", "r1"])
            contact = simulator.execute(f"{code}-{random.uniform(-40, 40)!r}").contact
            if contact is None:
                continue
            point = shapely.Point(contact.point)
            assert walls.boundary.distance(point) <= 1e-12
            assert contact.cell is not None
            row, column = contact.cell
            seen.add(contact.cell)
            left, top = 12 * (column - 1), 12 * (spec.maze.rows - row + 1)
            cell = shapely.box(left, top - 12, left + 12, top)
            assert cell.distance(point) <= 1e-9
            inside = 1 <= row <= spec.maze.rows and 1 <= column <= spec.maze.columns
            assert not inside or spec.maze.cells[row - 1][column - 1] == 0
            assert not contact.held_block
    assert len(seen) > 5


@pytest.mark.parametrize(
    ("command", "cell", "point"),
    [
        ("d1-60", (2, 5), (48.0, 30.0)),
        ("a1-60", (2, 0), (0.0, 30.0)),
        ("w1-60", (0, 3), (30.0, 36.0)),
        ("s1-60", (4, 3), (30.0, 0.0)),
    ],
)
def test_the_outside_counts_as_rows_and_columns_around_the_maze(
    course_spec: SimulationSpec, command: str, cell: tuple[int, int], point: tuple[float, float]
) -> None:
    maze = MazeSpec(((1, 1, 1, 1), (1, 1, 1, 1), (1, 1, 1, 1)))
    y = 30.0 if command[0] in "ad" else 18.0
    spec = replace(course_spec, maze=maze, bot_center=(30.0, y), block_center=(3.0, 3.0))
    if command[0] in "ad":
        cell = (1, cell[1])
    contact = Simulator(spec).execute(command).contact
    assert contact is not None
    assert (contact.cell, contact.point) == (cell, pytest.approx(point))


def test_it_is_said_whether_the_held_block_touches_or_the_body(course_spec: SimulationSpec) -> None:
    spec = in_room(
        course_spec, bot_center=(24.0, 24.0), block_center=(28.0, 24.0), gripper=GripperSpec(code="p1")
    )
    simulator = Simulator(spec)
    simulator.execute("p1-1")
    ahead = simulator.execute("d1-60").contact
    assert ahead is not None
    assert (ahead.held_block, ahead.point[0], ahead.cell) == (True, 48.0, (2, 5))
    aside = simulator.execute("w1-60").contact
    assert aside is not None
    assert (aside.held_block, aside.point[1], aside.cell) == (False, 48.0, (0, 4))
    assert simulator.execute("r1-90").contact is not None


# -- rebuilt from a log ----------------------------------------------------------------------


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("rule", ContactRule)
@pytest.mark.parametrize("robot", [RobotSpec.circle(6), OBLONG], ids=["disc", "oblong"])
def test_a_movement_is_rebuilt_from_what_a_log_holds_of_it(
    noisy_spec: SimulationSpec, robot: RobotSpec, rule: ContactRule
) -> None:
    random = np.random.default_rng(8)
    kinds = {drive.code: drive.kind for drive in noisy_spec.drives}
    contacts = rests = 0
    for trial in range(40):
        segments = int(random.choice([1, 10, 37]))
        spec = in_room(noisy_spec, robot=robot, contact=rule, num_segments=segments, bot_center=(44.0, 24.0))
        simulator = Simulator(spec, trial)
        simulator.advance(1000.3 * trial)
        code = str(random.choice(list(kinds)))
        begun = simulator.begin(f"{code}-{random.uniform(-60, 60)!r}")
        if trial % 3 == 0:
            simulator.advance(simulator.time + random.uniform(0, 1))
            simulator.stop()
        was = movement(simulator)
        again = rebuilt(
            Path.lazy(begun.before, *was.totals.share(segments), segments),
            kinds[code],
            was.totals,
            was.start_time,
            was.duration,
            was.contact,
            was.rest_stop,
            was.cut,
        )
        contacts += was.contact is not None
        rests += was.rest is not None
        for time in np.linspace(was.start_time - 0.1, was.end_time + 0.1, 20).tolist():
            assert again.pose_at(time) == was.pose_at(time)
            assert again.trail(time).tolist() == was.trail(time).tolist()
            assert again.travelled(time) == was.travelled(time)
            way = np.linalg.norm(np.diff(was.trail(time), axis=0), axis=1).sum()
            assert was.travelled(time) == pytest.approx(way, rel=1e-12, abs=1e-12)
        assert again.held_at == was.held_at
        assert again.pose_at(was.end_time) == was.pose_at(was.end_time)
        assert not again.wheels
        assert not again.turns
    assert contacts > 7
    assert (rests > 3) is (rule is ContactRule.DRIVE)


# -- whatever happens on the way -------------------------------------------------------------


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    robot=st.sampled_from([RobotSpec.circle(6), SQUARE, RobotSpec.polygon(((5, 0.5), (-3, 3), (-3, -3)))]),
    segments=st.sampled_from([1, 3, 10, 57]),
    sequence=st.lists(
        st.tuples(
            st.sampled_from(["w1", "s1", "a1", "d1", "r1"]),
            st.one_of(st.floats(-60, 60), st.sampled_from([90.0, -90.0, 3000.0])),
            st.lists(st.tuples(st.floats(0, 1), st.floats(-8, 8), st.floats(-8, 8)), max_size=3),
        ),
        max_size=6,
    ),
    seed=st.integers(0, 5),
)
def test_the_robot_overlaps_nothing_at_any_moment_however_the_block_is_moved(
    robot: RobotSpec,
    segments: int,
    sequence: list[tuple[str, float, list[tuple[float, float, float]]]],
    seed: int,
) -> None:
    spec = load_default().simulation
    spec = replace(spec, robot=robot, num_segments=segments, bot_center=(6.0, 30.0), block_solid=True)
    simulator = Simulator(spec, seed)
    simulator.advance(1000.3)
    for code, value, changes in sequence:
        begun = simulator.begin(f"{code}-{value!r}")
        assert simulator.trajectory is not None
        start, end = simulator.time, simulator.trajectory.end_time
        for share, x, y in sorted(changes):
            simulator.advance(start + share * (end - start))
            pose = simulator.pose
            with contextlib.suppress(PlacementError):
                simulator.move_block(pose.x + x, pose.y + y)
            assert simulator.pose == pose
            solid = simulator.walls.with_block(simulator.block)
            for moment in np.linspace(simulator.time, end, 5).tolist():
                assert not solid.overlap(simulator.footprint, movement(simulator).pose_at(moment))
        simulator.finish(begun)
