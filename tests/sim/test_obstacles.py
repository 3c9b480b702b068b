"""Walls as obstacles, the outside among them: faces, corners, cells and messages, worked out by hand."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import SKIN, Obstacles, block_problem, robot_problem
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.specs import MazeSpec, RobotSpec, SimulationSpec

MAZE = Maze(MazeSpec(((1, 1, 1), (1, 0, 1))))
"""36 by 24 inches, with one wall from (12, 0) to (24, 12)."""
WALLS = Obstacles.of_maze(MAZE.walls)
DISC = Footprint.of(RobotSpec.circle(6.0))
SQUARE = Footprint.of(RobotSpec.rectangle(6.0, 4.0))


def ends(obstacles: Obstacles) -> set[tuple[tuple[float, float], tuple[float, float]]]:
    faces = obstacles.faces
    foot = faces.normal * faces.offset[:, None]
    pairs = (foot + faces.tangent * faces.low[:, None], foot + faces.tangent * faces.high[:, None])
    return {
        ((x, y), (u, v))
        for (x, y), (u, v) in zip(*(np.round(each, 9).tolist() for each in pairs), strict=True)
    }


def test_faces_of_walls_and_of_the_outside() -> None:
    """Neighbouring cells' faces are one; each goes from left to right or from below to above."""
    upright = {((0, 0), (0, 24)), ((12, 0), (12, 12)), ((24, 0), (24, 12)), ((36, 0), (36, 24))}
    level = {((0, 0), (12, 0)), ((24, 0), (36, 0)), ((12, 12), (24, 12)), ((0, 24), (36, 24))}
    assert ends(WALLS) == upright | level
    corners = {(x, y) for face in upright | level for x, y in face}
    assert {(x, y) for x, y in WALLS.corners.tolist()} == corners
    assert WALLS.cells == (2, 3)


def test_a_maze_of_a_hundred_cells_a_side_has_all_its_faces() -> None:
    """Every second cell is a wall that stands alone: four faces each, and those of the outside in pieces."""
    cells = np.ones((100, 100), int)
    cells[1:99:2, 1:99:2] = 0
    maze = Maze(MazeSpec(tuple(map(tuple, cells.tolist()))))
    made = Obstacles.of_maze(maze.walls)
    assert len(made.faces.offset) == 4 * 49 * 49 + 4
    assert len(made.corners) == 4 * 49 * 49 + 4
    assert len(made.tree.geometries) == 49 * 49 + 4
    # The last wall of the pattern, and the outer wall beyond it.
    assert made.overlap(DISC, Pose(98 * 12 - 0.1, 98 * 12 - 0.1, 0.0))
    assert not made.overlap(DISC, Pose(99 * 12 + 6.0, 99 * 12 + 6.0, 0.0))
    assert made.overlap(DISC, Pose(99 * 12 + 9.1, 99 * 12 + 6.0, 0.0))


def test_edges_have_their_normals_on_the_left() -> None:
    edges = SQUARE.edges
    assert edges.tangent.round(12).tolist() == [[-1, 0], [0, -1], [1, 0], [0, 1]]
    assert edges.normal.round(12).tolist() == [[0, -1], [1, 0], [0, 1], [-1, 0]]
    assert edges.offset == pytest.approx([-2.0, -3.0, -2.0, -3.0])
    assert edges.low == pytest.approx([-3.0, -2.0, -3.0, -2.0])
    assert edges.high == pytest.approx([3.0, 2.0, 3.0, 2.0])
    # A slope of 3 to 4: all of it by the triangle of 3, 4 and 5.
    slope = Footprint.of(RobotSpec.polygon(((1.0, 1.0), (5.0, 4.0), (0.0, 4.0)))).edges
    assert slope.tangent[0] == pytest.approx((0.8, 0.6))
    assert slope.normal[0] == pytest.approx((-0.6, 0.8))
    assert (slope.offset[0], slope.low[0], slope.high[0]) == pytest.approx((0.2, 1.4, 6.4))


@pytest.mark.parametrize(
    ("x", "y", "wrong"),
    [
        (3.0, 3.0, False),
        (33.0, 21.0, False),
        (3.0 - 2e-9, 12.0, True),
        (33.0 + 2e-9, 12.0, True),
        (6.0, 21.0 + 2e-9, True),
        (6.0, 3.0 - 2e-9, True),
        (9.0, 6.0, False),
        (9.0 + 2e-9, 6.0, True),
        (27.0, 6.0, False),
        (27.0 - 2e-9, 6.0, True),
        (18.0, 15.0, False),
        (18.0, 15.0 - 2e-9, True),
    ],
)
def test_a_robot_may_touch_a_wall_but_not_overlap_it(x: float, y: float, wrong: bool) -> None:
    assert WALLS.overlap(DISC, Pose(x, y, 0.0)) is wrong


def test_the_outside_has_no_end() -> None:
    """No robot stands beyond it, however long it is."""
    for x, y in ((-50.0, 12.0), (100.0, 12.0), (18.0, -60.0), (18.0, 90.0), (-100.0, -100.0)):
        assert WALLS.overlap(DISC, Pose(x, y, 0.0))


@pytest.mark.parametrize(
    ("pose", "beyond", "point", "cell"),
    [
        (Pose(33.0, 18.0, 0.0), Pose(33.1, 18.0, 0.0), (36.0, 18.0), (1, 4)),
        (Pose(3.0, 18.0, 0.0), Pose(2.9, 18.0, 0.0), (0.0, 18.0), (1, 0)),
        (Pose(6.0, 21.0, 0.0), Pose(6.0, 21.1, 0.0), (6.0, 24.0), (0, 1)),
        (Pose(30.0, 3.0, 0.0), Pose(30.0, 2.9, 0.0), (30.0, 0.0), (3, 3)),
        (Pose(9.0, 5.0, 0.0), Pose(9.1, 5.0, 0.0), (12.0, 5.0), (2, 2)),
        (Pose(27.0, 5.0, 0.0), Pose(26.9, 5.0, 0.0), (24.0, 5.0), (2, 2)),
        (Pose(18.0, 15.0, 0.0), Pose(18.0, 14.9, 0.0), (18.0, 12.0), (2, 2)),
    ],
)
def test_what_is_touched_is_named_by_its_cell(
    pose: Pose, beyond: Pose, point: tuple[float, float], cell: tuple[int, int]
) -> None:
    """Rows count from 1 at the top, columns from the left; the outside has 0 and one more than the last."""
    found = WALLS.touch(DISC, pose, beyond)
    assert found.point == pytest.approx(point, abs=1e-9)
    assert found.cell == cell
    assert found.held_block is False


def test_of_two_walls_the_nearer_one_is_touched() -> None:
    """In the corner between the wall and the floor of the maze, nearer to one or to the other."""
    floor = WALLS.touch(DISC, Pose(8.9, 3.0, 0.0), Pose(9.1, 2.8, 0.0))
    assert (floor.point, floor.cell) == (pytest.approx((8.9, 0.0)), (3, 1))
    wall = WALLS.touch(DISC, Pose(9.0, 3.1, 0.0), Pose(9.2, 2.9, 0.0))
    assert (wall.point, wall.cell) == (pytest.approx((12.0, 3.1)), (2, 2))


def test_a_solid_block_is_an_obstacle_of_no_cell() -> None:
    block = Block(6.0, 18.0, 4.0)
    with_block = WALLS.with_block(block)
    assert len(with_block.faces.offset) == len(WALLS.faces.offset) + 4
    assert len(with_block.corners) == len(WALLS.corners) + 4
    found = with_block.touch(DISC, Pose(11.0, 18.0, 0.0), Pose(10.9, 18.0, 0.0))
    assert (found.point, found.cell) == (pytest.approx((8.0, 18.0), abs=1e-9), None)
    assert not with_block.overlap(DISC, Pose(11.0, 18.0, 0.0))
    assert with_block.overlap(DISC, Pose(11.0 - 2e-9, 18.0, 0.0))
    assert WALLS.with_block(Block(6.0, 18.0, 2 * SKIN)) is WALLS
    assert WALLS.with_block(Block(6.0, 18.0, 3 * SKIN)) is not WALLS


def test_only_what_reaches_into_a_box_is_near() -> None:
    edges, corners = WALLS.near(np.array((20.0, 5.0)), np.array((30.0, 11.0)))
    assert len(edges.offset) == 1
    assert abs(edges.offset[0]) == pytest.approx(24.0)
    assert corners.tolist() == []
    edges, corners = WALLS.near(np.array((24.0, 12.0)), np.array((25.0, 13.0)))
    assert len(edges.offset) == 2
    assert corners.tolist() == [[24.0, 12.0]]


# -- messages ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "y", "said"),
    [
        (0.0, 12.0, "overlaps a wall or solid block near (0, 12)"),
        (0.5, 12.0, "overlaps a wall or solid block near (0, 12)"),
        (-0.5, 12.0, "(-0.5, 12) lies outside the maze, which reaches from (0, 0) to (36, 24)"),
        (36.0, 12.0, "overlaps a wall or solid block near (36, 12)"),
        (36.5, 12.0, "(36.5, 12) lies outside the maze"),
        (6.0, 0.0, "overlaps a wall or solid block near (6, 0)"),
        (6.0, -0.5, "(6, -0.5) lies outside the maze"),
        (6.0, 24.5, "(6, 24.5) lies outside the maze"),
        (math.nan, 12.0, "x, y and heading must be finite numbers"),
        (6.0, math.inf, "x, y and heading must be finite numbers"),
        (10.0, 6.0, "overlaps a wall or solid block near (12, 6)"),
        (6.0, 12.0, ""),
    ],
)
def test_why_a_robot_cannot_stand_somewhere(x: float, y: float, said: str) -> None:
    found = robot_problem(MAZE, WALLS, DISC, Pose(x, y, 0.0))
    assert said in found
    assert bool(found) == bool(said)


def test_a_robot_without_a_place_is_told_a_free_one() -> None:
    advice = "it must stand clear of walls, as in the middle of a free cell, (6, 6)"
    assert robot_problem(MAZE, WALLS, DISC, Pose(10.0, 6.0, 0.0)).endswith(advice)
    long = Footprint.of(RobotSpec.rectangle(13.0, 2.0))
    assert robot_problem(MAZE, WALLS, long, Pose(6.0, 6.0, 0.0)).endswith("it must stand clear of walls")


@pytest.mark.parametrize(
    ("x", "y", "wrong"),
    [
        (1.5, 1.5, False),
        (34.5, 22.5, False),
        (10.5, 6.0, False),
        (25.5, 6.0, False),
        (18.0, 13.5, False),
        (1.4, 12.0, True),
        (34.6, 12.0, True),
        (6.0, 1.4, True),
        (6.0, 22.6, True),
        (10.6, 6.0, True),
        (18.0, 13.4, True),
    ],
)
def test_a_block_of_three_inches_stands_clear_of_walls(x: float, y: float, wrong: bool) -> None:
    said = block_problem(MAZE, WALLS, Block(x, y, 3.0))
    assert said == (f"the block of 3 in at ({x:g}, {y:g}) overlaps a wall" if wrong else "")


def test_a_block_outside_and_one_that_is_not_there() -> None:
    outside = "lies outside the maze, which reaches from (0, 0) to (36, 24)"
    for x, y in ((-0.5, 12.0), (36.5, 12.0), (6.0, -0.5), (6.0, 24.5)):
        assert block_problem(MAZE, WALLS, Block(x, y, 3.0)) == f"({x:g}, {y:g}) {outside}"
        assert block_problem(MAZE, WALLS, Block(x, y, 0.0)) == ""
    for x, y in ((0.0, 12.0), (36.0, 12.0), (6.0, 0.0), (6.0, 24.0)):
        assert "overlaps a wall" in block_problem(MAZE, WALLS, Block(x, y, 3.0))
    assert block_problem(MAZE, WALLS, Block(math.nan, 1.0, 3.0)) == "x and y must be finite numbers"
    assert block_problem(MAZE, WALLS, Block(1.0, math.inf, 3.0)) == "x and y must be finite numbers"


# -- the block's own outline --------------------------------------------------------------------------


def test_rays_meet_a_turned_block_by_hand() -> None:
    """A square of 2 in at (5, 5), turned by 45 degrees: its corners are sqrt(2) from the middle."""
    block, straight = Block(5.0, 5.0, 2.0, 45.0), Block(5.0, 5.0, 2.0)
    root = math.sqrt(2)
    rays = [
        (0.0, 5.0, 1.0, 0.0, 5.0 - root, 4.0),
        (0.0, 5.5, 1.0, 0.0, 5.0 - root + 0.5, 4.0),
        (0.0, 6.2, 1.0, 0.0, 5.0 - root + 1.2, math.inf),
        (0.0, 5.0, -1.0, 0.0, math.inf, math.inf),
        (5.0, 5.0, 0.0, 1.0, root, 1.0),
        (5.5, 9.0, 0.0, -1.0, 4.0 - root + 0.5, 3.0),
        (4.0, 5.0, 1.0, 0.0, 1.0 + root, 0.0),
    ]
    for x, y, dx, dy, turned, upright in rays:
        assert block.cast(x, y, dx, dy) == pytest.approx(turned)
        assert straight.cast(x, y, dx, dy) == pytest.approx(upright)
    columns = [np.array([ray[k] for ray in rays]) for k in range(6)]
    assert block.cast_many(*columns[:4]) == pytest.approx(columns[4])
    assert straight.cast_many(*columns[:4]) == pytest.approx(columns[5])


# -- corners of walls --------------------------------------------------------------------------------


def robot_at(course_spec: SimulationSpec, maze: MazeSpec, robot: RobotSpec, pose: Pose) -> Simulator:
    """A robot without errors in a maze with no block."""
    return Simulator(
        replace(
            course_spec,
            maze=maze,
            robot=robot,
            bot_center=(pose.x, pose.y),
            bot_rot=pose.heading,
            block_size=0.0,
        ),
        seed=1,
    )


@pytest.mark.parametrize(("turn", "stopped"), [(90.0, 46.869898), (-90.0, -9.376007)])
def test_a_side_of_a_turning_robot_meets_the_corner_of_a_wall(
    course_spec: SimulationSpec, turn: float, stopped: float
) -> None:
    """The wall's corner (12, 24) is 2.5 in from the robot's centre, 100 degrees to its left: its side, 2 in
    off, meets it where it is at asin(2 / 2.5) = 53.13 degrees. The other way round the robot's corner,
    sqrt(13) in off and 146.31 degrees to the left, meets the wall's lower side, 2.462 in above."""
    maze = MazeSpec(((0, 1, 1), (1, 1, 1), (1, 1, 1)))
    angle = math.radians(100.0)
    pose = Pose(12.0 - 2.5 * math.cos(angle), 24.0 - 2.5 * math.sin(angle), 0.0)
    simulator = robot_at(course_spec, maze, RobotSpec.rectangle(6.0, 4.0), pose)
    simulator.execute(f"r1-{turn:g}")
    assert simulator.pose.heading == pytest.approx(stopped, abs=1e-3)


@pytest.mark.parametrize(
    ("away", "asked", "gone"), [(3.2, 3.0, 3.0), (3.2, -3.0, -0.2), (4.0, 2.0, 2.0), (4.0, -0.9, -0.9)]
)
def test_a_disc_meets_a_corner_that_it_drives_at_and_none_that_it_leaves(
    course_spec: SimulationSpec, away: float, asked: float, gone: float
) -> None:
    """From `away` inches off the corner (24, 12) of a pillar, on the diagonal: a disc of 3 in stops there."""
    start = Pose(24.0 + away / math.sqrt(2), 12.0 + away / math.sqrt(2), 45.0)
    maze = MazeSpec(((1, 1, 1, 1), (1, 1, 1, 1), (1, 0, 1, 1)))
    simulator = robot_at(course_spec, maze, RobotSpec.circle(6.0), start)
    code = "d1" if asked > 0 else "a1"
    simulator.execute(f"{code}-{abs(asked):g}")
    moved = (simulator.pose.x - start.x) * math.sqrt(2)
    assert moved == pytest.approx(gone, abs=1e-6)
