"""Moves of a robot at a wall, by hand: one wall cell, from 12 to 24 inches in x and y."""

from __future__ import annotations

import math

import pytest

from simmer_tui.sim import MazeSpec, Pose, RobotSpec
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.wall_moves import WallMove, wall_moves

WALL = Obstacles.of_maze(Maze(MazeSpec(((1, 1, 1), (1, 0, 1), (1, 1, 1)))).walls)
DISC = Footprint.of(RobotSpec.circle(6))
BOX = Footprint.of(RobotSpec.rectangle(6, 4))


def slides(body: Footprint, pose: Pose, own: Twist, friction: float = 0.3) -> list[tuple[float, float]]:
    """Velocities of the moves along an obstacle, each once, to a millionth."""
    found = [move.velocity for move in wall_moves(body, WALL, pose, own, friction)][1:]
    rounded = [(round(x, 6) + 0.0, round(y, 6) + 0.0) for x, y in found if x or y]
    return list(dict.fromkeys(rounded))


@pytest.mark.parametrize(
    ("place", "heading", "low", "high"),
    [((9.0, 0.0), 0.0, 12.0, 24.0), ((27.0, 0.0), 180.0, 12.0, 24.0), ((3.0, 0.0), 180.0, 0.0, 36.0)],
)
@pytest.mark.parametrize("across", [False, True])
def test_a_disc_slides_along_a_face_as_far_as_it_reaches(
    place: tuple[float, float], heading: float, low: float, high: float, across: bool
) -> None:
    """At 1 in/s into the wall and 2 in/s along it: 2 - 0.3 in/s."""

    def at(along: float) -> list[tuple[float, float]]:
        x, y, turn = (along, place[0], heading + 90.0) if across else (place[0], along, heading)
        moves = slides(DISC, Pose(x, y, turn), Twist(1.0, 2.0, 0.0))
        return [(y, x) for x, y in moves] if across else moves

    sign = (-1.0 if heading else 1.0) * (-1.0 if across else 1.0)
    expected = [(0.0, sign * 1.7)]
    inside = (low, low + 0.001, 18.0, high - 0.001, high) if low else (3.5, 18.0, 32.5)
    for along in inside:
        assert at(along) == expected, along
    for along in (low - 0.001, high + 0.001) if low else ():
        assert at(along) == [], along


def test_a_disc_slides_around_a_corner() -> None:
    """From the corner at (12, 24), its centre 3 in away at 135 degrees."""
    apart = 3.0 / math.sqrt(2.0)
    place = (12.0 - apart, 24.0 + apart)
    half = round((2.0 - 0.3) / math.sqrt(2.0), 6)
    along = Twist((1.0 + 2.0) / math.sqrt(2.0), (2.0 - 1.0) / math.sqrt(2.0))  # 2 along, 1 into the corner
    assert slides(DISC, Pose(*place, 0.0), along) == [(half, half)]
    for off, moves in ((1e-9, 1), (3e-9, 0), (-1e-9, 1), (-3e-9, 0)):
        far = (12.0 - apart - off / math.sqrt(2.0), 24.0 + apart + off / math.sqrt(2.0))
        assert len(slides(DISC, Pose(*far, 0.0), along)) == moves, off


@pytest.mark.parametrize(("off", "count"), [(0.0, 1), (1.9e-9, 1), (2.2e-9, 0), (-1.9e-9, 1), (-2.2e-9, 0)])
@pytest.mark.parametrize("body", [DISC, BOX], ids=["disc", "box"])
def test_a_robot_touches_a_wall_within_two_billionths_of_an_inch(
    body: Footprint, off: float, count: int
) -> None:
    moves = slides(body, Pose(9.0 - off, 18.0, 0.0), Twist(1.0, 2.0))
    assert moves == [(0.0, 1.7)] * count


@pytest.mark.parametrize(
    ("y", "around"),
    [
        *((25.0, None), (26.0, True), (26.0 + 1.9e-9, True), (26.0 + 2.2e-9, False)),
        *((10.0, True), (10.0 - 1.9e-9, True), (10.0 - 2.2e-9, False)),
    ],
)
def test_a_box_touches_a_face_with_its_corners_and_a_corner_with_its_edges(
    y: float, around: bool | None
) -> None:
    """Two faces are touched where the corners of both meet; the other face is across the motion."""
    expected = {None: [(0.0, 1.7)], True: [(0.0, 1.7), (0.4, 0.0)], False: []}[around]
    assert slides(BOX, Pose(9.0, y, 0.0), Twist(1.0, 2.0)) == expected


def test_a_turned_box_slides_along_its_own_edge_at_a_corner() -> None:
    """Its front, 3 in ahead, touches the corner (12, 24) with the middle: heading -45 degrees."""
    apart = 3.0 / math.sqrt(2.0)
    half = 1.7 / math.sqrt(2.0)
    pose = Pose(12.0 - apart, 24.0 + apart, -45.0)
    assert slides(BOX, pose, Twist(1.0, 2.0)) == [(round(half, 6), round(half, 6))]
    beside = 2.01 / math.sqrt(2.0)  # the corner is beyond the end of the edge
    assert slides(BOX, Pose(pose.x + beside, pose.y + beside, -45.0), Twist(1.0, 2.0)) == []


def test_friction_leaves_no_move_to_a_robot_that_hits_the_wall_nearly_squarely() -> None:
    """Along it 1.5 in/s, into it 5 in/s: with a friction of 0.3 exactly nothing is left."""
    pose = Pose(9.0, 18.0, 0.0)
    assert slides(DISC, pose, Twist(5.0, 1.5), 0.25) == [(0.0, 0.25)]
    assert slides(DISC, pose, Twist(4.0, 1.0), 0.25) == []
    assert slides(DISC, pose, Twist(5.0, -1.5), 0.25) == [(0.0, -0.25)]
    assert slides(DISC, pose, Twist(-5.0, 1.5), 0.25) == [(0.0, 0.25)]


def test_moves_are_tried_in_their_order() -> None:
    """The commanded motion, turning on the spot, and slides, the fastest first. A disc turns as it slides."""
    pose = Pose(3.0, 9.0, 30.0)  # it touches the outside, and the line of the wall below it, but not the wall
    own = Twist(2.0, -1.0, 20.0)
    velocity = (2.0 * math.cos(math.pi / 6) + 0.5, 1.0 - math.cos(math.pi / 6))
    first = WallMove(pytest.approx(velocity), 20.0, brief=False)  # type: ignore[arg-type]  # compared
    moves = list(wall_moves(DISC, WALL, pose, own, 0.0))
    assert moves[0] == first
    assert [(move.rate, move.spin, move.brief) for move in moves[1:]] == [(0.0, 20.0, True)] * len(moves[1:])
    assert moves[-1].velocity == (0.0, 0.0)
    corner = Pose(3.0, 3.0, 30.0)
    in_corner = list(wall_moves(DISC, WALL, corner, own, 0.0))
    speeds = [math.hypot(*move.velocity) for move in in_corner[1:]]
    assert speeds == pytest.approx([velocity[0], velocity[1], 0.0])
    box = list(wall_moves(BOX, WALL, Pose(3.0, 2.0, 0.0), own, 0.0))
    assert [(move.velocity, move.rate, move.spin, move.brief) for move in box] == [
        ((2.0, -1.0), 20.0, 0.0, False),
        ((0.0, 0.0), 20.0, 0.0, True),
        *[((2.0, 0.0), 0.0, 0.0, True)] * len(box[2:-2]),
        *[((0.0, -1.0), 0.0, 0.0, True)] * 2,
    ]
    still = list(wall_moves(BOX, WALL, Pose(3.0, 18.0, 0.0), Twist(1.0, 0.0), 0.0))
    assert [(move.velocity, move.rate) for move in still] == [((1.0, 0.0), 0.0)]
    arc = moves[1].arc(pose, 0.5)
    assert (arc.start, arc.velocity, arc.rate, arc.duration, arc.spin) == (
        pose,
        moves[1].velocity,
        0.0,
        0.5,
        20.0,
    )
