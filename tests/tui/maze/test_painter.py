"""Order in which marks cover each other, in every glyph mode."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.live.operating.switches import SHOWN
from simmer_tui.sim.records import FloorPatch, Pose, RangeScan
from simmer_tui.sim.specs import MazeSpec, RobotSpec
from simmer_tui.tui.maze.glyphs import BRAILLE, Cells
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import DEFAULT, GROUNDS, Attribute, Role
from simmer_tui.tui.maze.scene import BeliefMark, FloorMode, Scene, SensorView
from simmer_tui.tui.maze.viewport import Viewport
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from tests.tui.maze.decoding import whole_maze


@pytest.fixture
def painter() -> Painter:
    return Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)


@pytest.fixture
def bare(plain_scene: Scene) -> Scene:
    """The floor alone: the robot is outside the window."""
    return replace(plain_scene, pose=Pose(500.0, 500.0, 0.0))


def draw(painter: Painter, scene: Scene, zoom: float = 8.0) -> Cells:
    return painter.cells(scene, whole_maze(scene.maze, zoom))


def ink(cells: Cells, painter: Painter, role: Role) -> list[tuple[int, int]]:
    """The cells with a mark of a role."""
    there = (cells.foreground == painter.palette[role]) & (cells.characters != ord(" "))
    return [(int(row), int(column)) for row, column in np.argwhere(there)]


def ray(*turns: float, length: float = 9.0, origin: tuple[float, float] = (6.2, 17.5)) -> SensorView:
    return SensorView(RangeScan(origin, turns, (length,) * len(turns)))


def test_a_wall_has_an_edge_one_pixel_wide_inside_it(painter: Painter, bare: Scene) -> None:
    cells = draw(painter, bare)
    assert cells.text(3)[16:] == "▙▄▄▄▄▄▄▄"
    assert cells.text(1)[16:] == "▌" + 7 * " "
    assert (cells.background[:4, 17:] == painter.palette[Role.WALL]).all()


def test_tiles_are_told_apart_softly_or_loudly(painter: Painter, bare: Scene) -> None:
    def pair() -> list[int]:
        return draw(painter, bare).background[0, [0, 2]].tolist()

    assert pair() == [painter.palette[Role.BLACK_TILE], painter.palette[Role.WHITE_TILE]]
    painter.floor = FloorMode.LOUD
    assert pair() == [painter.palette[Role.LOUD_BLACK], painter.palette[Role.LOUD_WHITE]]


@pytest.mark.parametrize(("glyphs", "depth", "sign"), [("quadrant", "16", "·"), ("ascii", "none", ":")])
def test_loud_black_tiles_carry_a_sign_where_there_is_one_color(
    bare: Scene, glyphs: str, depth: str, sign: str
) -> None:
    painter = Painter(GlyphMode(glyphs), ColorDepth(depth))
    assert sign not in draw(painter, bare).text(0)[:16]
    painter.floor = FloorMode.LOUD
    assert draw(painter, bare).text(0)[:4] == 2 * sign + "  "


def test_zones_have_an_outline_a_hatch_and_a_name(painter: Painter, bare: Scene) -> None:
    scene = replace(bare, loading_zone=((6.0, 18.0), (18.0, 18.0)), drop_zone=(30.0, 6.0))
    cells = draw(painter, scene)
    assert cells.text(0)[:16] == "⡏ loading ⠉⠉⠉⠉⠉⢹"
    assert {cells.text(row)[0] + cells.text(row)[15] for row in (1, 2)} == {"⡇⢸"}
    assert (cells.background[1:3, 1:15] == painter.palette[Role.LOADING_GROUND]).all()
    assert " drop " in cells.text(4)[16:]
    assert len(ink(cells, painter, Role.DROP_LINE)) > 12
    painter.floor = FloorMode.LOUD
    loud = draw(painter, scene)
    assert not (loud.background == painter.palette[Role.LOADING_GROUND]).any()
    assert loud.text(0)[:16] == cells.text(0)[:16]


def test_without_a_mission_the_mazes_own_cells_are_the_loading_zone(painter: Painter) -> None:
    maze = MazeSpec(((1, 3), (1, 1)))
    floor = np.ones((8, 8), dtype=np.uint8)
    scene = Scene(maze=maze, floor=floor, robot=RobotSpec.circle(6), pose=Pose(6, 6, 0))
    assert draw(painter, scene, 12.0).text(0)[12:] == "⡏ loading ⠉⢹"


def dots(cells: Cells, painter: Painter, role: Role, rows: slice) -> int:
    """The number of dots of a role in some rows."""
    marks = [place for place in ink(cells, painter, role) if rows.start <= place[0] < rows.stop]
    return sum(int(cells.characters[place] - BRAILLE).bit_count() for place in marks)


def test_the_trail_is_one_line_and_its_last_seconds_are_brighter(painter: Painter, bare: Scene) -> None:
    legs = [np.array([(2.0, y), (20.0, y)]) for y in (22.0, 16.0, 10.0, 4.0)]
    cells = draw(painter, replace(bare, trail=tuple(legs), recent=(legs[3],)))
    counts = [dots(cells, painter, Role.TRAIL, slice(2 * row, 2 * row + 1)) for row in range(4)]
    new = dots(cells, painter, Role.TRAIL_NEW, slice(6, 7))
    # As many dots, however old it is, and no gap in a line.
    assert counts == [new, new, new, 0]
    assert new >= 18.0 * 2 * 8 / 12
    assert not ink(
        draw(painter, replace(bare, trail=tuple(legs), shown=SHOWN - {"trail"})), painter, Role.TRAIL
    )


def test_a_trail_that_grows_is_drawn_as_one_that_is_new(painter: Painter, bare: Scene) -> None:
    """Finished pieces are drawn once; another window, or another run, begins anew."""
    legs = tuple(np.array([(2.0, y), (20.0, y), (20.0, y - 3.0)]) for y in (22.0, 16.0, 10.0, 4.0))
    for trail, zoom in ((legs[:2], 8.0), (legs[:3], 8.0), (legs, 8.0), (legs, 5.0), (legs[2:], 5.0)):
        fresh = draw(Painter(painter.glyphs, painter.depth), replace(bare, trail=trail), zoom)
        assert not fresh.differs(draw(painter, replace(bare, trail=trail), zoom)).any()


def test_turning_ages_no_trail(painter: Painter, bare: Scene) -> None:
    leg, turn = np.array([(2.0, 20.0), (20.0, 20.0)]), np.array([(20.0, 20.0)])
    fresh = draw(painter, replace(bare, trail=(leg,)))
    assert (draw(painter, replace(bare, trail=(leg, turn, turn, turn))).characters == fresh.characters).all()


def test_what_was_read_last_is_bright_and_lies_on_top(painter: Painter, bare: Scene) -> None:
    scene = replace(bare, views=(ray(270.0), ray(0.0)))
    cells = draw(painter, scene)
    strong, weak = ink(cells, painter, Role.RAY_STRONG), ink(cells, painter, Role.RAY_WEAK)
    assert {row for row, _ in strong} == {2}
    assert {column for _, column in weak} == {4}
    assert (2, 4) in strong
    turned = draw(painter, replace(scene, views=scene.views[::-1]))
    assert (2, 4) in ink(turned, painter, Role.RAY_STRONG)
    assert {column for _, column in ink(turned, painter, Role.RAY_STRONG)} == {4}


def test_what_was_read_before_a_movement_is_faint_once_the_robot_has_left(
    painter: Painter, bare: Scene
) -> None:
    views = (ray(270.0),)
    assert ink(draw(painter, replace(bare, views=views)), painter, Role.RAY_STRONG)
    old = draw(painter, replace(bare, views=views, views_are_old=True))
    assert not ink(old, painter, Role.RAY_STRONG)
    assert ink(old, painter, Role.RAY_WEAK)


def test_a_chosen_sensor_is_bright_too(painter: Painter, bare: Scene) -> None:
    views = (replace(ray(270.0), sensor="u2"), replace(ray(180.0), sensor="u3"), ray(0.0))
    cells = draw(painter, replace(bare, views=views, chosen="u2"))
    strong = ink(cells, painter, Role.RAY_STRONG)
    assert {row for row, _ in strong} >= {2, 3, 4}
    assert {column for _, column in ink(cells, painter, Role.RAY_WEAK)} <= {0, 1, 2, 3, 4}


def test_only_the_measured_ray_of_a_narrow_fan_is_drawn_and_the_sides_of_a_wide_one(
    painter: Painter, bare: Scene
) -> None:
    narrow = draw(painter, replace(bare, views=(ray(-2.0, 0.0, 2.0),)), 24.0)
    assert not ink(narrow, painter, Role.RAY_WEAK)
    wide = draw(painter, replace(bare, views=(ray(-30.0, 0.0, 30.0),)), 24.0)
    assert ink(wide, painter, Role.RAY_WEAK)
    assert ink(wide, painter, Role.RAY_STRONG)


@pytest.mark.parametrize("told", [None, math.inf])
def test_without_an_echo_there_are_three_dots_and_no_ray(
    painter: Painter, bare: Scene, told: float | None
) -> None:
    view = replace(ray(270.0, length=math.inf if told is None else 9.0), reading=told)
    cells = draw(painter, replace(bare, views=(view,)), 12.0)
    marks = ink(cells, painter, Role.RAY_STRONG)
    assert sum(int(cells.characters[place] - BRAILLE).bit_count() for place in marks) == 3
    assert {column for _, column in marks} == {6}


def test_a_ray_is_as_long_as_what_was_read_and_ends_at_a_wall(painter: Painter, bare: Scene) -> None:
    def reach(told: float) -> int:
        view = replace(ray(0.0, length=15.0, origin=(6.2, 6.0)), reading=told)
        return max(
            column for _, column in ink(draw(painter, replace(bare, views=(view,))), painter, Role.RAY_STRONG)
        )

    assert reach(6.0) == int((6.2 + 6.0) * 8 / 12)
    assert reach(25.0) == int((6.2 + 25.0) * 8 / 12), "what a sensor says, whatever its view"
    up = replace(ray(0.0, length=15.0, origin=(6.2, 18.0)), reading=40.0)
    marks = ink(draw(painter, replace(bare, views=(up,))), painter, Role.RAY_STRONG)
    assert max(column for _, column in marks) == 15, "no ray goes on behind a wall"


def test_a_ray_has_the_code_of_its_sensor_at_its_end(painter: Painter, plain_scene: Scene) -> None:
    views = (replace(ray(180.0, length=8.0, origin=(6.0, 9.0)), sensor="u3"),)
    views += (replace(ray(0.0, length=20.0, origin=(12.0, 9.0)), sensor="u1"),)
    scene = replace(plain_scene, views=views)
    small = draw(painter, scene, 8.0)
    text = "".join(small.text(row) for row in range(small.shape[0]))
    assert "u1" in text
    assert "u3" not in text, "there is room for what was read last alone"
    large = draw(painter, scene, 16.0)
    assert any("u3" in large.text(row) and "u1" in large.text(row) for row in range(large.shape[0]))
    at = next(row for row in range(large.shape[0]) if "u1" in large.text(row))
    column = large.text(at).index("u1")
    assert large.foreground[at, column] == painter.palette[Role.RAY_STRONG]
    assert abs(column - 31 * 16 / 12) <= 3
    blocked = draw(painter, replace(scene, block_centre=(31.4, 9.0)), 16.0)
    row = next(row for row in range(blocked.shape[0]) if "u1" in blocked.text(row))
    assert blocked.text(row).index("u1") < column - 2, "it gives way to the block"


def test_a_zones_name_wins_over_faint_rays_only(painter: Painter, bare: Scene) -> None:
    scene = replace(bare, loading_zone=((6.0, 18.0), (18.0, 18.0)))
    along = ray(0.0, origin=(1.0, 23.0), length=22.0)
    faint = draw(painter, replace(scene, views=(along, ray(270.0))))
    assert "loading" in faint.text(0)
    assert "loading" not in draw(painter, replace(scene, views=(along,))).text(0)


def test_lines_leave_walls_alone(painter: Painter, bare: Scene) -> None:
    scene = replace(bare, trail=(np.array([(20.0, 22.0), (34.0, 14.0)]),), views=(ray(0.0, length=30.0),))
    assert draw(painter, scene).text(1)[16:] == draw(painter, bare).text(1)[16:]


def test_a_belief_without_headings_has_no_dots_beside_its_outline(painter: Painter, bare: Scene) -> None:
    for x in (9.0, 9.7, 16.2):
        for y in (9.0, 9.9, 10.6):
            belief = BeliefMark(Pose(x, y, 30.0))
            headed = ink(draw(painter, replace(bare, belief=belief)), painter, Role.BELIEF)
            plain = replace(bare, belief=replace(belief, headed=False))
            assert set(ink(draw(painter, plain), painter, Role.BELIEF)) <= set(headed)


def test_floor_spots_show_beside_the_robot(painter: Painter, bare: Scene) -> None:
    grid = np.array([(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36])
    points = np.array((18.0, 6.0)) + grid / 6 * 2.0
    counts = []
    for black in (np.ones(len(points), dtype=bool), np.zeros(len(points), dtype=bool)):
        view = FloorPatch((18.0, 6.0), 2.0, points, black)
        cells = draw(painter, replace(bare, views=(SensorView(view),)), 24.0)
        marks = ink(cells, painter, Role.RAY_STRONG)
        counts.append(sum(int(cells.characters[place] - BRAILLE).bit_count() for place in marks))
    assert counts[0] > counts[1] > 12, "a disc on black, a ring on white"


def test_a_mark_lies_on_ground_and_on_nothing_else(painter: Painter, full_scene: Scene) -> None:
    allowed = {painter.palette[role] for role in (*GROUNDS, Role.ROBOT, Role.BLOCK, Role.CONTACT, Role.EDGE)}
    for zoom in (5.0, 8.0, 11.0, 18.0):
        assert set(np.unique(draw(painter, full_scene, zoom).background).tolist()) <= allowed


def test_the_contact_leaves_the_arrow_alone(painter: Painter, plain_scene: Scene) -> None:
    for heading in range(0, 360, 45):
        for aside in range(0, 360, 45):
            way = math.radians(aside)
            point = (9 + 3 * math.cos(way), 9 + 3 * math.sin(way))
            for zoom in (4.0, 8.0, 16.0):
                scene = replace(plain_scene, pose=Pose(9, 9, heading), contact=point, block_centre=None)
                cells = draw(painter, scene, zoom)
                assert (cells.characters == ord("X")).sum() == 1
                assert ink(cells, painter, Role.HEADING)


def test_a_contact_is_marked_beside_the_robot_that_stands_over_it(
    painter: Painter, plain_scene: Scene
) -> None:
    cells = draw(painter, replace(plain_scene, contact=(9.0, 9.0)))
    assert (cells.characters == ord("X")).sum() == 1
    robot = draw(painter, plain_scene)
    there = robot.background == painter.palette[Role.ROBOT]
    assert (cells.background[there] == robot.background[there]).all(), "it covers no part of the body"


def test_earlier_contacts_stay_as_small_crosses_one_a_cell(painter: Painter, bare: Scene) -> None:
    past = ((24.0, 20.0), (24.0, 20.1), (12.0, 2.0), (40.0, 90.0))
    cells = draw(painter, replace(bare, past_contacts=past, contact=(30.0, 12.0)))
    marks = [tuple(place) for place in np.argwhere(cells.characters == ord("×")).tolist()]
    assert marks == [(1, 15), (7, 8)], "in front of the wall"
    assert {cells.foreground[place] for place in marks} == {painter.palette[Role.CONTACT]}
    assert cells.characters[3, 20] == ord("X"), "the last one on the wall it touched"


def test_tiles_are_told_apart_under_the_robot_alone(painter: Painter, plain_scene: Scene) -> None:
    loud = [painter.palette[role] for role in (Role.LOUD_BLACK, Role.LOUD_WHITE)]
    scene = replace(plain_scene, pose=Pose(6.0, 6.0, 0.0), line_age=1.0)
    cells = draw(painter, scene)
    assert np.isin(cells.background[4:, :8], loud).any()
    assert not np.isin(cells.background[4:, 10:], loud).any()
    assert not np.isin(draw(painter, replace(scene, line_age=11.0)).background, loud).any()
    painter.floor = FloorMode.LOUD
    assert np.isin(draw(painter, scene).background[4:, 10:], loud).any()


def test_the_needle_covers_no_part_of_a_block(painter: Painter, plain_scene: Scene) -> None:
    color = painter.palette[Role.BLOCK]
    for heading in range(0, 360, 15):
        for away in (4.6, 5.5, 6.5, 8.0):
            way = math.radians(heading)
            place = (18 + away * math.cos(way), 12 + away * math.sin(way))
            scene = replace(plain_scene, pose=Pose(18, 12, heading), block_centre=place)
            alone = draw(painter, replace(scene, pose=Pose(500.0, 500.0, 0.0)), 12.0)
            both = draw(painter, scene, 12.0)
            body = (both.background == painter.palette[Role.ROBOT]) | (
                both.background == painter.palette[Role.HEADING]
            )
            body |= np.isin(both.characters, painter.signs.blocks[1:]) & (
                both.foreground == painter.palette[Role.ROBOT]
            )
            there = ((alone.foreground == color) | (alone.background == color)) & ~body
            assert (both.characters[there] == alone.characters[there]).all(), (heading, away)


def test_a_contact_at_the_outer_wall_is_seen(painter: Painter, plain_scene: Scene) -> None:
    for point in ((-1e-12, 5.0), (36.0 + 1e-12, 5.0), (30.0, -1e-12), (5.0, 24.0 + 1e-12)):
        cells = draw(painter, replace(plain_scene, contact=point))
        assert (cells.characters == ord("X")).sum() == 1


def test_a_contact_outside_the_window_leaves_nothing_in_it(painter: Painter, bare: Scene) -> None:
    window = Viewport(24.0, 24, 0, 24, 12, bare.maze.height)
    cells = painter.cells(replace(bare, contact=(11.7, 18.0)), window)
    assert not (cells.background == painter.palette[Role.CONTACT]).any()


def test_the_robot_has_one_outline_wherever_it_stands(painter: Painter, plain_scene: Scene) -> None:
    counts = set()
    for step in range(12):
        scene = replace(plain_scene, pose=Pose(8.0 + 0.17 * step, 9.0 + 0.29 * step, 90.0))
        cells = draw(painter, scene, 8.0)
        robot = painter.palette[Role.ROBOT]
        patterns = [
            painter.signs.blocks.index(int(sign)).bit_count()
            for sign, color in zip(cells.characters.flat, cells.foreground.flat, strict=True)
            if color == robot and int(sign) in painter.signs.blocks
        ]
        counts.add(sum(patterns) + 4 * int((cells.background == robot).sum()))
    assert len(counts) == 1


def test_a_held_block_rides_ahead_and_does_not_lie_anywhere_else(
    painter: Painter, plain_scene: Scene
) -> None:
    lying = replace(plain_scene, block_centre=(30.0, 4.0))
    held = replace(lying, block_held=True)
    block = painter.palette[Role.BLOCK]
    assert (draw(painter, lying).background[:, 16:] == block).any()
    cells = draw(painter, held)
    assert not (cells.background[:, 16:] == block).any()
    assert (cells.background[:, 8:12] == block).any() or (cells.foreground[:, 8:12] == block).any()
    few = draw(Painter(GlyphMode.QUADRANT, ColorDepth.COLORS_16), held)
    assert any("[]" in few.text(row) for row in range(8))


def test_a_polygon_is_drawn_as_it_is_turned(painter: Painter, plain_scene: Scene) -> None:
    shape = RobotSpec.rectangle(9.0, 4.0)
    wide, high = (
        (draw(painter, replace(plain_scene, robot=shape, pose=Pose(12, 10, heading)), 12.0).background)
        == painter.palette[Role.ROBOT]
        for heading in (0.0, 90.0)
    )
    assert wide.any(axis=0).sum() > high.any(axis=0).sum()
    assert wide.any(axis=1).sum() < high.any(axis=1).sum()


@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_without_colors_no_cell_has_one(full_scene: Scene, glyphs: GlyphMode) -> None:
    cells = draw(Painter(glyphs, ColorDepth.NONE), full_scene)
    assert (cells.foreground == DEFAULT).all()
    assert (cells.background == DEFAULT).all()
    assert ((cells.attributes & Attribute.REVERSE) > 0).any() == (glyphs is not GlyphMode.ASCII)
    assert cells.text(0)[18:22] == ("::::" if glyphs is GlyphMode.ASCII else "░░░░")


@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_only_the_modes_that_may_leave_ascii_and_have_braille(full_scene: Scene, glyphs: GlyphMode) -> None:
    cells = draw(Painter(glyphs, ColorDepth.TRUECOLOR), full_scene)
    text = "".join(cells.text(row) for row in range(8))
    assert text.isascii() == (glyphs is GlyphMode.ASCII)
    assert any(BRAILLE < ord(sign) < BRAILLE + 256 for sign in text) == (
        glyphs not in (GlyphMode.HALF, GlyphMode.ASCII)
    )


def test_plain_characters_draw_the_whole_scene(plain_scene: Scene) -> None:
    scene = replace(
        plain_scene,
        pose=Pose(9.0, 9.0, 0.0),
        block_centre=(31.5, 4.5),
        trail=(np.array([(1.0, 20.0), (9.0, 20.0)]),),
        views=(ray(0.0, length=12.0, origin=(12.0, 10.0)),),
        contact=(1.0, 1.0),
        belief=BeliefMark(Pose(9.0, 18.0, 180.0)),
    )
    painter = Painter(GlyphMode.ASCII, ColorDepth.NONE)
    cells = draw(painter, scene)
    assert [cells.text(row).rstrip() for row in range(8)] == [
        "                #:::::::",
        "....?..?        #:::::::",
        "    ?<-?        #:::::::",
        "                ########",
        "    (OO)********",
        "    (->)ooo",
        "                    BB",
        "X",
    ]


def test_the_backdrop_is_drawn_once(painter: Painter, plain_scene: Scene) -> None:
    viewport = whole_maze(plain_scene.maze, 8.0)
    first = painter.backdrop(plain_scene, viewport, loud=False)
    loud = painter.backdrop(plain_scene, viewport, loud=True)
    assert loud is not first
    assert painter.backdrop(replace(plain_scene, pose=Pose(1, 1, 1)), viewport, loud=False) is first
    assert painter.backdrop(plain_scene, viewport, loud=True) is loud


coordinates = st.floats(-60, 90) | st.sampled_from([0.0, 12.0, 24.0, 36.0, math.inf, math.nan, 1e300])


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(
    x=coordinates,
    y=coordinates,
    heading=st.floats(-1000, 1000),
    zoom=st.floats(0.2, 40),
    left=st.integers(0, 40),
    top=st.integers(0, 20),
    glyphs=st.sampled_from(list(GlyphMode)),
    depth=st.sampled_from(list(ColorDepth)),
    held=st.booleans(),
)
def test_nothing_outside_the_window_or_the_maze_does_harm(
    full_scene: Scene,
    x: float,
    y: float,
    heading: float,
    zoom: float,
    left: int,
    top: int,
    glyphs: GlyphMode,
    depth: ColorDepth,
    held: bool,
) -> None:
    viewport = Viewport(zoom, left, top, 30, 9, full_scene.maze.height)
    scene = replace(
        full_scene,
        pose=Pose(x, y, heading),
        block_centre=(y, x),
        block_held=held,
        contact=(y, x),
        belief=BeliefMark(Pose(y, x, heading), 4.0, np.array([(x, y)])),
        views=(*full_scene.views, ray(heading, origin=(x, y))),
        trail=(np.array([(x, y), (9.0, 9.0)]),),
    )
    assert Painter(glyphs, depth).cells(scene, viewport).shape == (9, 30)
