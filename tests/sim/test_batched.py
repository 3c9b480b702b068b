"""One reading, and the same among many at once: the same bits, whatever the angle and the place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.sim import (
    Block,
    Maze,
    MazeSpec,
    Pose,
    RangeSensor,
    TimeOfFlight,
    Ultrasonic,
    World,
)
from simmer_tui.sim.angles import cos_sin, cos_sin_array

COURSE = MazeSpec(
    (
        (3, 3, 1, 1, 0, 2, 0, 2),
        (3, 3, 0, 1, 1, 1, 1, 1),
        (1, 0, 2, 0, 0, 1, 0, 1),
        (1, 1, 1, 1, 1, 1, 0, 2),
    )
)
PILLARS = MazeSpec(tuple(tuple(int(row % 2 or column % 2) for column in range(9)) for row in range(9)))
"""A wall cell at every other place: rays along diagonals go exactly through corners."""
BLOCKS = (Block(25.0, 41.0, 3.0), Block(30.0, 30.0, 4.0, 45.0), Block(6.0, 30.0, 3.0, 17.0))
angles = st.one_of(
    st.integers(-16, 40).map(lambda eighth: 45.0 * eighth),
    st.floats(-1e4, 1e4),
    st.sampled_from([1e-17, -1e-17, 90.0 + 2e-14, 1e6, -1e6, 44.99999999999999, 359.99999999999994]),
)


def sensors() -> list[RangeSensor]:
    made: list[RangeSensor] = []
    for kind in (Ultrasonic, TimeOfFlight):
        for x, y, rotation, view, rays in (
            (0.0, 0.0, 0.0, 90.0, 3),
            (0.0, 0.0, 45.0, 0.0, 1),
            (3.0, 0.0, 0.0, 5.0, 5),
            (2.12, -2.12, 315.0, 25.0, 7),
        ):
            for z, vertical, limit in ((2.0, 0.0, 0.0), (6.0, 0.0, 0.0), (4.0, 30.0, 25.0)):
                spec = kind.spec_type(
                    kind=kind, number=1, code="u1", x=x, y=y, z=z, rotation=rotation, rays=rays,
                    field_of_view=view, vertical_field_of_view=vertical, incidence_limit=limit,
                )  # fmt: skip
                made.append(kind(spec))
    return made


def assert_agree(world: World, poses: Sequence[Pose]) -> int:
    table = np.array([(pose.x, pose.y, pose.heading) for pose in poses])
    for sensor in sensors():
        one_by_one = [sensor.observe(world, pose)[0] for pose in poses]
        assert sensor.true_values(world, table).tolist() == one_by_one
    return len(poses)


@pytest.mark.parametrize(
    ("maze", "step", "least"),
    [
        pytest.param(COURSE, 24.0, 150, id="few places"),
        pytest.param(COURSE, 6.0, 1000, id="course", marks=pytest.mark.slow),
        pytest.param(PILLARS, 12.0, 1000, id="pillars", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("block", BLOCKS[:2])
def test_ranges_agree_at_multiples_of_45_degrees_and_through_corners(
    maze: MazeSpec, step: float, least: int, block: Block
) -> None:
    world = World(Maze(maze), block)
    places = [
        (x, y)
        for begin, every in ((step / 2, step), (0.0, 2 * step))  # diagonals through corners, and corners
        for x in np.arange(begin, world.maze.width + 1, every).tolist()
        for y in np.arange(begin, world.maze.height + 1, every).tolist()
    ]
    poses = [Pose(x, y, heading) for x, y in places for heading in range(-90, 450, 45)]
    assert assert_agree(world, poses) > least


some_places = st.lists(st.tuples(st.floats(-1, 97), st.floats(-1, 49), angles), min_size=1, max_size=20)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(some_places, st.sampled_from(BLOCKS))
def test_ranges_agree_anywhere(places: list[tuple[float, float, float]], block: Block) -> None:
    assert_agree(World(Maze(COURSE), block), [Pose(*place) for place in places])


@pytest.mark.slow
@settings(max_examples=150, deadline=None, derandomize=True)
@given(some_places, st.sampled_from(BLOCKS))
def test_ranges_agree_at_many_more_places(places: list[tuple[float, float, float]], block: Block) -> None:
    assert_agree(World(Maze(COURSE), block), [Pose(*place) for place in places])


@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.floats(0.1, 107.9), st.integers(1, 17).map(lambda half: 6.0 * half)),
            st.one_of(st.floats(0.1, 107.9), st.integers(1, 17).map(lambda half: 6.0 * half)),
            angles,
        ),
        min_size=1,
        max_size=30,
    )
)
def test_rays_agree_with_single_casts(rays: list[tuple[float, float, float]]) -> None:
    world = World(Maze(PILLARS), BLOCKS[1])
    many = world.rays(np.array([ray[:2] for ray in rays]), np.array([ray[2] for ray in rays]), 0.0)
    for (x, y, bearing), distance in zip(rays, many.tolist(), strict=True):
        if world.maze.is_wall(x, y):
            assert distance == 0.0
        else:
            assert distance == world.fan(x, y, [cos_sin(bearing)], 0.0)[0]
            assert math.copysign(1.0, distance) == 1.0


@given(st.lists(angles, max_size=20))
def test_cosines_of_many_angles_are_those_of_each(degrees: list[float]) -> None:
    cos, sin = cos_sin_array(np.array(degrees))
    assert list(zip(cos.tolist(), sin.tolist(), strict=True)) == [cos_sin(angle) for angle in degrees]
