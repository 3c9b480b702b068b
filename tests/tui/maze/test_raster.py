"""Pixels and dots: what is painted where."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from simmer_tui.sim.records import FloorPatch, Pose, RangeScan
from simmer_tui.sim.specs import RobotSpec, SimulationSpec
from simmer_tui.tui.maze.overlay import draw_dots
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import MIXED, Layer
from simmer_tui.tui.maze.raster import paint, paint_background, robot_coverage
from simmer_tui.tui.maze.scene import Belief, Scene, SensorView
from simmer_tui.tui.maze.shapes import distance_to_outline, front, sample_segments
from simmer_tui.tui.maze.viewport import ZOOM_LEVELS, Viewport, whole_maze
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

NO_TRAIL = np.zeros((0, 2))
L_SHAPE = RobotSpec.polygon(((3, 3), (-3, 3), (-3, -3), (0, -3), (0, -1), (3, -1)))
poses = st.builds(
    Pose,
    st.floats(-1e7, 1e7) | st.floats(0, 36),
    st.floats(-1e7, 1e7) | st.floats(0, 24),
    st.floats(-1e5, 1e5),
)
windows = st.builds(
    Viewport,
    st.sampled_from(ZOOM_LEVELS),
    st.integers(-30, 90),
    st.integers(-30, 90),
    st.integers(1, 60),
    st.integers(1, 30),
    st.just(24.0),
)


def picture(scene: Scene, viewport: Viewport | None = None) -> NDArray[np.uint8]:
    viewport = viewport or whole_maze(scene.maze, 8)
    return paint(scene, viewport, MIXED, paint_background(scene, viewport, MIXED))


def pixel_at(pixels: NDArray[np.uint8], scene: Scene, x: float, y: float) -> tuple[int, ...]:
    """The colour at a place in inches, in a picture of the whole maze."""
    scale = pixels.shape[1] / scene.maze.width
    return tuple(pixels[int((scene.maze.height - y) * scale), int(x * scale)].tolist())


@pytest.mark.parametrize("zoom", ZOOM_LEVELS)
def test_course_floor_and_walls_are_painted_tile_by_tile(
    golden: Callable[[str], dict[str, Any]], course_spec: SimulationSpec, zoom: int
) -> None:
    course_maze = course_spec.maze
    floor = np.array([list(row) for row in golden("floor")["rows"]], dtype=np.uint8)
    scene = Scene(maze=course_maze, floor=floor, robot=RobotSpec.circle(6), pose=Pose(9.5, 42, 0))
    background = paint_background(scene, whole_maze(course_maze, zoom), MIXED)
    assert background.shape == (4 * zoom, 8 * zoom, 3)
    for row in range(16):
        for column in range(32):
            size = zoom // 4
            tile = background[row * size : (row + 1) * size, column * size : (column + 1) * size]
            colors = {tuple(color) for color in tile.reshape(-1, 3).tolist()}
            wall = course_maze.cells[row // 4][column // 4] == 0
            expected = MIXED.wall if wall else (MIXED.white_tile if floor[row, column] else MIXED.black_tile)
            assert colors == {expected}


def test_robot_shines_through_by_the_alpha_formula(plain_scene: Scene) -> None:
    scene = replace(plain_scene, pose=Pose(7.5, 7.5, 0.0), robot=RobotSpec.circle(10))
    viewport = whole_maze(scene.maze, 24)
    painted = picture(scene, viewport)
    before = paint_background(scene, viewport, MIXED)
    for x, y in ((5.0, 7.5), (7.5, 4.6), (4.6, 9.1)):
        old = pixel_at(before, scene, x, y)
        expected = [
            int(below * (1 - MIXED.robot_alpha) + above * MIXED.robot_alpha + 0.5)
            for below, above in zip(old, MIXED.robot, strict=True)
        ]
        assert list(pixel_at(painted, scene, x, y)) == expected


@pytest.mark.parametrize("heading", [0, 45, 90, 135, 180, 270, 1000, -725])
def test_mark_lies_on_the_front_side_of_the_robot(plain_scene: Scene, heading: float) -> None:
    scene = replace(plain_scene, pose=Pose(10.0, 10.0, heading))
    painted = picture(scene, whole_maze(scene.maze, 16))
    direction = (math.cos(math.radians(heading)), math.sin(math.radians(heading)))
    ahead = pixel_at(painted, scene, 10 + 1.6 * direction[0], 10 + 1.6 * direction[1])
    behind = pixel_at(painted, scene, 10 - 1.6 * direction[0], 10 - 1.6 * direction[1])
    assert sum(ahead) < 150 < sum(behind)


def test_hidden_robot_and_hidden_trail_leave_the_floor_alone(full_scene: Scene) -> None:
    bare = replace(
        full_scene, show_robot=False, show_trail=False, block_centre=None, contact=None, in_contact=False
    )
    viewport = whole_maze(bare.maze, 8)
    assert (picture(bare) == paint_background(bare, viewport, MIXED)).all()
    assert (picture(replace(bare, show_trail=True)) != picture(bare)).any()
    assert (picture(replace(bare, show_robot=True)) != picture(bare)).any()


def test_trail_is_redder_where_it_is_newer(plain_scene: Scene) -> None:
    trail = np.array([(2.0, 20.0), (10.0, 20.0), (18.0, 20.0)])
    scene = replace(plain_scene, trail=trail, floor=np.ones((8, 12), dtype=np.uint8), show_robot=False)
    painted = picture(scene)
    old, new = pixel_at(painted, scene, 4, 20), pixel_at(painted, scene, 17, 20)
    assert old[0] > 200
    assert new[0] > 200
    assert new[1] < old[1] < 255


def test_block_is_translucent_yellow_where_it_stands(plain_scene: Scene) -> None:
    scene = replace(plain_scene, block_centre=(30.0, 6.0), block_size=6.0)
    viewport = whole_maze(scene.maze, 24)
    red, green, blue = pixel_at(picture(scene, viewport), scene, 29.4, 5.8)
    before = pixel_at(paint_background(scene, viewport, MIXED), scene, 29.4, 5.8)
    assert red > 180
    assert green > 150
    assert blue == int(before[2] * (1 - MIXED.block_alpha) + MIXED.block[2] * MIXED.block_alpha + 0.5)
    assert pixel_at(picture(scene, viewport), scene, 26.0, 6.0) in (MIXED.white_tile, MIXED.black_tile)


def test_contact_is_marked_and_the_robot_changes_color_while_it_lasts(plain_scene: Scene) -> None:
    touching = replace(plain_scene, contact=(9.0, 12.0), in_contact=True)
    past = replace(touching, in_contact=False)
    assert pixel_at(picture(touching), touching, 9.0, 11.9) == MIXED.contact
    assert pixel_at(picture(past), past, 9.0, 11.9) == MIXED.past_contact
    edge_now, edge_before = (pixel_at(picture(scene), scene, 6.4, 8.6) for scene in (touching, past))
    assert edge_now[0] > edge_before[0]


@settings(deadline=None, max_examples=40)
@given(
    x=st.floats(6, 30), y=st.floats(6, 18), heading=st.floats(-400, 400), zoom=st.sampled_from(ZOOM_LEVELS)
)
@pytest.mark.parametrize("robot", [RobotSpec.circle(6), RobotSpec.rectangle(8, 4), L_SHAPE])
def test_covered_area_is_the_area_of_the_robot(
    plain_scene: Scene, robot: RobotSpec, x: float, y: float, heading: float, zoom: int
) -> None:
    scene = replace(plain_scene, robot=robot, pose=Pose(x, y, heading))
    covered = robot_coverage(scene, whole_maze(scene.maze, zoom))
    assert covered is not None
    polygon = shapely.Polygon(robot.vertices) if robot.vertices else shapely.Point(0, 0).buffer(3, 64)
    # Four samples a pixel each way: an edge is at most half a sample off.
    tolerance = polygon.length * (12 / zoom) / 4 / 2
    assert float(covered[1].sum()) / (zoom / 12) ** 2 == pytest.approx(polygon.area, abs=tolerance)


@given(x=st.floats(-8, 8), y=st.floats(-8, 8))
@pytest.mark.parametrize("robot", [RobotSpec.rectangle(8, 4), L_SHAPE])
def test_distance_to_an_outline_is_what_shapely_says(robot: RobotSpec, x: float, y: float) -> None:
    polygon, point = shapely.Polygon(robot.vertices), shapely.Point(x, y)
    distance = float(distance_to_outline(np.array([[x, y]]), robot)[0])
    assert abs(distance) == pytest.approx(polygon.exterior.distance(point), abs=1e-9)
    if abs(distance) > 1e-9:
        assert (distance < 0) == polygon.contains(point)


def test_front_of_a_shape_is_where_its_outline_crosses_the_x_axis() -> None:
    assert front(RobotSpec.circle(6)) == 3
    assert front(RobotSpec.rectangle(8, 4)) == 4
    assert front(RobotSpec.polygon(((2, 0), (-1, 2), (-1, -2)))) == 2
    assert front(L_SHAPE) == 3


def test_samples_of_a_segment_hold_its_ends_and_leave_no_gap() -> None:
    starts, ends = np.array([[0.0, 0.0], [5.0, 5.0]]), np.array([[3.0, 4.0], [5.0, 5.0]])
    samples, owners = sample_segments(starts, ends, 0.5)
    first = samples[owners == 0]
    assert first[0].tolist() == [0, 0]
    assert first[-1].tolist() == [3, 4]
    assert float(np.hypot(*np.diff(first, axis=0).T).max()) <= 0.5 + 1e-12
    assert (samples[owners == 1] == 5).all()


def one_fan(scene: Scene, *distances: float) -> Scene:
    bearings = tuple(10.0 * number for number in range(len(distances)))
    fan = RangeScan((12.0, 9.0), bearings, distances)
    return replace(scene, views=(SensorView(fan),), trail=NO_TRAIL, belief=None)


def test_shortest_ray_is_brightest_and_ends_at_its_hit(plain_scene: Scene) -> None:
    dots = draw_dots(one_fan(plain_scene, 9.0, 10.0, 12.0), whole_maze(plain_scene.maze, 8))
    row = dots[int((24 - 9) / 0.75)]
    bright = np.flatnonzero(row == Layer.SHORTEST_RAY)
    assert bright.tolist() == list(range(16, 28))
    assert (dots == Layer.RAY).sum() > 10


def test_ray_that_hits_nothing_is_drawn_dim_to_the_edge_of_the_picture(plain_scene: Scene) -> None:
    dots = draw_dots(one_fan(plain_scene, math.inf), whole_maze(plain_scene.maze, 8))
    assert not (dots == Layer.SHORTEST_RAY).any()
    assert dots[int((24 - 9) / 0.75), -1] == Layer.RAY


def test_no_ray_is_drawn_over_the_robot_or_when_rays_are_off(plain_scene: Scene) -> None:
    from_the_middle = RangeScan((9.0, 9.0), (0.0,), (20.0,))
    scene = replace(plain_scene, views=(SensorView(from_the_middle),))
    viewport = whole_maze(scene.maze, 8)
    columns = np.flatnonzero(draw_dots(scene, viewport).any(axis=0))
    assert columns[0] == 16
    without_robot = draw_dots(replace(scene, show_robot=False), viewport)
    assert np.flatnonzero(without_robot.any(axis=0))[0] == 12
    assert not draw_dots(replace(scene, show_rays=False), viewport).any()


@pytest.mark.parametrize("radius", [0.36, 1.0, 4.0])
def test_floor_spot_shows_what_it_stands_on(plain_scene: Scene, radius: float) -> None:
    grid = np.array([(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36])
    points = np.array((20.0, 8.0)) + radius / 6 * grid
    viewport = whole_maze(plain_scene.maze, 24)
    layers = []
    for black in (True, False):
        spot = FloorPatch((20.0, 8.0), radius, points, np.full(len(points), black))
        scene = replace(plain_scene, views=(SensorView(spot),))
        layers.append(set(np.unique(draw_dots(scene, viewport)).tolist()) - {Layer.NOTHING})
    assert Layer.BLACK_POINT in layers[0]
    assert layers[1] == {Layer.FLOOR_SPOT}


def test_belief_is_an_outline_with_a_heading_and_particles_are_dots(plain_scene: Scene) -> None:
    belief = Belief(Pose(18.0, 18.0, 90.0), None, np.array([(30.0, 4.0)]))
    scene = replace(plain_scene, belief=belief)
    dots = draw_dots(scene, whole_maze(scene.maze, 8))
    outline = dots == Layer.BELIEF
    assert outline[int((24 - 18) / 0.75), int(21 / 0.75) - 1 : int(21 / 0.75) + 1].any()
    assert outline[int((24 - 19.5) / 0.75), int(18 / 0.75)]
    assert not outline[int((24 - 16.5) / 0.75), int(18 / 0.75)]
    assert dots[int((24 - 4) / 0.75), int(30 / 0.75)] == Layer.PARTICLE


def test_floor_and_walls_are_drawn_once_for_a_window(plain_scene: Scene) -> None:
    painter = Painter(GlyphMode.HYBRID, ColorDepth.TRUECOLOR)
    viewport = whole_maze(plain_scene.maze, 8)
    first = painter.background(plain_scene, viewport)
    assert painter.background(replace(plain_scene, pose=Pose(5, 5, 5)), viewport) is first
    assert painter.background(plain_scene, whole_maze(plain_scene.maze, 16)).shape == (32, 48, 3)


def test_scene_with_the_wrong_number_of_tiles_is_refused(plain_scene: Scene) -> None:
    with pytest.raises(ValueError, match=r"\(3, 3\), this maze needs \(8, 12\)"):
        replace(plain_scene, floor=np.zeros((3, 3), dtype=np.uint8))


@settings(deadline=None, max_examples=60)
@given(
    pose=poses,
    believed=poses,
    window=windows,
    robot=st.sampled_from([RobotSpec.circle(6), L_SHAPE]),
    glyphs=st.sampled_from(list(GlyphMode)),
    depth=st.sampled_from(list(ColorDepth)),
)
def test_any_pose_in_any_window_is_drawn_in_every_mode(
    full_scene: Scene,
    pose: Pose,
    believed: Pose,
    window: Viewport,
    robot: RobotSpec,
    glyphs: GlyphMode,
    depth: ColorDepth,
) -> None:
    trail = np.array([(pose.x, pose.y), (9.0, 9.0), (believed.x, believed.y)])
    scene = replace(
        full_scene,
        pose=pose,
        robot=robot,
        trail=trail,
        contact=(pose.x, pose.y),
        belief=Belief(believed, abs(pose.heading), trail),
    )
    cells = Painter(glyphs, depth).cells(scene, window)
    assert cells.shape == cells.foreground.shape == cells.background.shape == (window.rows, window.columns)
