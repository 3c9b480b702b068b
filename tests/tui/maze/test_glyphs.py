"""Terminal cells: characters and colours in every mode and depth, and the runs they are sent in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from rich.color import Color, ColorSystem
from rich.color import ColorType as RichColorType
from rich.palette import Palette as RichPalette
from rich.style import Style

from simmer_tui.sim.records import FloorPatch, Pose, RangeScan
from simmer_tui.tui.maze.glyphs import (
    BRAILLE,
    Cells,
    blank_cells,
    half_cells,
    hybrid_cells,
    solid_cells,
    tint,
)
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import DEFAULT, EXACT, MIXED, Layer, pack, reduce_colors, unpack
from simmer_tui.tui.maze.scene import Scene, SensorView
from simmer_tui.tui.maze.viewport import whole_maze
from simmer_tui.tui.strips import Span, changed_spans, make_strip
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

WHITE, GREY, BLACK = 0xFFFFFF, 0xD3D3D3, 0x000000
USUAL_16 = {0xFFFFFF, 0xAAAAAA, 0xFFFF55, 0x55FF55, 0xFF5555, 0x5555FF, 0x000000}
THEIRS = Style(color="cyan", bgcolor="blue")


def flat(*rows: int) -> NDArray[np.uint8]:
    """One column of pixels in packed colours."""
    return unpack(np.array(rows, dtype=np.int32)).astype(np.uint8)[:, None, :]


def dots(rows: int, *places: tuple[int, int, Layer]) -> NDArray[np.uint8]:
    layers = np.zeros((4 * rows, 2), dtype=np.uint8)
    for row, column, layer in places:
        layers[row, column] = layer
    return layers


def test_half_blocks_carry_the_upper_pixel_in_front_and_the_lower_behind() -> None:
    cells = half_cells(flat(WHITE, BLACK, GREY, GREY), ColorDepth.TRUECOLOR)
    assert cells.text(0) + cells.text(1) == "▀ "
    assert cells.foreground[:, 0].tolist() == [WHITE, DEFAULT]
    assert cells.background[:, 0].tolist() == [BLACK, GREY]


def test_dots_become_braille_where_the_halves_match() -> None:
    layers = dots(1, (0, 0, Layer.SHORTEST_RAY), (3, 1, Layer.SHORTEST_RAY))
    cells = hybrid_cells(flat(WHITE, WHITE), layers, MIXED, ColorDepth.TRUECOLOR)
    assert cells.text(0) == chr(BRAILLE + 0x01 + 0x80)
    assert cells.background[0, 0] == WHITE
    assert unpack(cells.foreground)[0, 0].tolist() == list(MIXED.layers[Layer.SHORTEST_RAY])


def test_dots_only_tint_a_half_block_where_the_halves_differ() -> None:
    layers = dots(1, (0, 0, Layer.SHORTEST_RAY))
    cells = hybrid_cells(flat(WHITE, BLACK), layers, MIXED, ColorDepth.TRUECOLOR)
    assert cells.text(0) == "▀"
    red, green, blue = unpack(cells.foreground)[0, 0].tolist()
    assert red > 200 > 140 > green == blue > 0
    assert cells.background[0, 0] == BLACK


def test_higher_layer_hides_the_lower_one_within_a_cell() -> None:
    layers = dots(1, (0, 0, Layer.RAY), (1, 0, Layer.SHORTEST_RAY))
    cells = hybrid_cells(flat(WHITE, WHITE), layers, MIXED, ColorDepth.TRUECOLOR)
    assert cells.text(0) == chr(BRAILLE + 0x02)


def test_tint_grows_with_the_dots_in_a_pixel_and_leaves_the_input_alone() -> None:
    pixels = flat(WHITE, WHITE)
    one = tint(pixels, dots(1, (0, 0, Layer.SHORTEST_RAY)), MIXED)
    four = tint(pixels, dots(1, *((y, x, Layer.SHORTEST_RAY) for y in (0, 1) for x in (0, 1))), MIXED)
    assert four[0, 0, 1] < one[0, 0, 1] < 255
    assert (one[1] == 255).all()
    assert (pixels == 255).all()


def test_solid_cell_shows_the_pixel_that_is_not_background() -> None:
    background = flat(WHITE, WHITE, WHITE, WHITE)
    cells = solid_cells(flat(WHITE, 0xFF0000, 0x00FF00, WHITE), background, MIXED, ColorDepth.TRUECOLOR)
    assert cells.text(0) + cells.text(1) == "  "
    assert cells.background[:, 0].tolist() == [0xFF0000, 0x00FF00]


def test_dark_tiles_are_dotted_for_a_console_without_bright_backgrounds() -> None:
    pixels = flat(WHITE, WHITE, 0xAAAAAA, 0xAAAAAA)
    cells = solid_cells(pixels, pixels, EXACT, ColorDepth.COLORS_16)
    assert cells.text(0) + cells.text(1) == " ."
    assert cells.background[:, 0].tolist() == [WHITE, 0xAAAAAA]


@pytest.mark.parametrize("glyphs", [GlyphMode.HYBRID, GlyphMode.HALF, GlyphMode.SOLID])
def test_sixteen_colors_are_exact_and_the_checkerboard_stays(full_scene: Scene, glyphs: GlyphMode) -> None:
    cells = Painter(glyphs, ColorDepth.COLORS_16).cells(full_scene, whole_maze(full_scene.maze, 16))
    used = set(np.unique(cells.background).tolist())
    assert {0xFFFFFF, 0xAAAAAA, 0x000000} <= used
    assert used <= USUAL_16 | {0x00AA00, 0xAA0000, 0xAA00AA, 0xFF55FF, 0xAA5500}
    for color in used:
        triplet = (color >> 16, (color >> 8) & 255, color & 255)
        assert Color.from_rgb(*triplet).downgrade(ColorSystem.STANDARD).type is RichColorType.STANDARD
    assert cells.background[0, 0] != cells.background[0, 4]


@pytest.mark.parametrize("color", sorted(USUAL_16 | {0xAA0000, 0x00AA00, 0xAA00AA, 0xFF55FF, 0x555555}))
def test_reducing_keeps_the_usual_sixteen(color: int) -> None:
    assert reduce_colors(np.array([color, DEFAULT]), ColorDepth.COLORS_16).tolist() == [color, DEFAULT]


def shown_by_256(color: int, palette: RichPalette) -> tuple[int, ...]:
    """What a 256 colour terminal shows for a packed colour that went through reduction and Rich."""
    reduced = int(reduce_colors(np.array([color], dtype=np.int32), ColorDepth.COLORS_256)[0])
    sent = Color.from_rgb(reduced >> 16, (reduced >> 8) & 255, reduced & 255)
    number = sent.downgrade(ColorSystem.EIGHT_BIT).number
    assert number is not None
    return tuple(palette[number])


def test_colors_of_the_256_come_out_as_they_went_in() -> None:
    from rich._palettes import EIGHT_BIT_PALETTE

    for number in range(16, 256):
        red, green, blue = EIGHT_BIT_PALETTE[number]
        shown = shown_by_256((red << 16) | (green << 8) | blue, EIGHT_BIT_PALETTE)
        if red == green == blue:
            assert abs(shown[0] - red) <= 5, number  # Rich never sends the greys of the cube
        else:
            assert shown == (red, green, blue), number


def test_white_and_light_grey_tiles_differ_with_256_colors(plain_scene: Scene) -> None:
    cells = Painter(GlyphMode.HYBRID, ColorDepth.COLORS_256).cells(
        plain_scene, whole_maze(plain_scene.maze, 8)
    )
    left, right = unpack(cells.background[0])[[0, 2], 0].tolist()
    assert abs(left - right) > 30


@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_without_colors_no_cell_has_one_and_the_walls_still_show(
    full_scene: Scene, glyphs: GlyphMode
) -> None:
    cells = Painter(glyphs, ColorDepth.NONE).cells(full_scene, whole_maze(full_scene.maze, 8))
    assert (cells.foreground == DEFAULT).all()
    assert (cells.background == DEFAULT).all()
    wall = "█" if glyphs in (GlyphMode.HYBRID, GlyphMode.HALF) else "#"
    assert cells.text(0)[16:] == 8 * wall


def test_only_hybrid_has_braille_and_only_block_modes_leave_ascii(full_scene: Scene) -> None:
    viewport = whole_maze(full_scene.maze, 8)
    texts = {}
    for glyphs in GlyphMode:
        cells = Painter(glyphs, ColorDepth.TRUECOLOR).cells(full_scene, viewport)
        texts[glyphs] = "".join(cells.text(row) for row in range(viewport.rows))
    has_braille = {mode: any(BRAILLE < ord(sign) <= BRAILLE + 255 for sign in texts[mode]) for mode in texts}
    assert has_braille == {mode: mode is GlyphMode.HYBRID for mode in GlyphMode}
    assert "▀" in texts[GlyphMode.HALF]
    assert set(texts[GlyphMode.SOLID]) == {" ", "*"}, "blanks, and a sign for particles"
    assert texts[GlyphMode.ASCII].isascii()


def test_plain_characters_draw_the_whole_scene(plain_scene: Scene) -> None:
    scene = replace(
        plain_scene,
        floor=np.ones((8, 12), dtype=np.uint8),
        pose=Pose(9.0, 9.0, 0.0),
        block_centre=(31.5, 4.5),
        trail=np.array([(1.0, 20.0), (9.0, 20.0)]),
        views=(SensorView(RangeScan((12.0, 10.0), (0.0,), (12.0,))),),
        contact=(1.0, 1.0),
    )
    cells = Painter(GlyphMode.ASCII, ColorDepth.NONE).cells(scene, whole_maze(scene.maze, 8))
    assert [cells.text(row) for row in range(8)] == [
        "                ########",
        "*******         ########",
        "                ########",
        "                ########",
        "    OOOO--------        ",
        "    OOO>                ",
        "                    BB  ",
        "+                       ",
    ]


@pytest.mark.parametrize(("heading", "arrow"), [(0, ">"), (90, "^"), (180, "<"), (-90, "v"), (-725, ">")])
def test_plain_arrow_points_where_the_robot_looks(plain_scene: Scene, heading: float, arrow: str) -> None:
    scene = replace(plain_scene, pose=Pose(9.0, 9.0, heading))
    cells = Painter(GlyphMode.ASCII, ColorDepth.NONE).cells(scene, whole_maze(scene.maze, 16))
    text = "".join(cells.text(row) for row in range(16))
    assert [sign for sign in text if sign in "<>^v"] == [arrow]


@pytest.mark.parametrize(("zoom", "shown"), [(8, False), (16, True)])
def test_plain_floor_spots_show_on_the_robot_where_there_is_room(
    plain_scene: Scene, zoom: int, shown: bool
) -> None:
    points = np.array([(9.0, 10.0)])
    views = tuple(
        SensorView(FloorPatch((x, 10.0), 0.3, points, np.array([black])))
        for x, black in ((7.5, True), (8.5, False))
    )
    scene = replace(plain_scene, views=views)
    cells = Painter(GlyphMode.ASCII, ColorDepth.NONE).cells(scene, whole_maze(scene.maze, zoom))
    text = "".join(cells.text(row) for row in range(cells.shape[0]))
    assert ("x" in text, "i" in text) == (shown, shown)


@pytest.mark.parametrize(("bearing", "sign"), [(0, "-"), (90, "|"), (63, "/"), (-63, "\\")])
def test_plain_rays_slope_as_they_point(plain_scene: Scene, bearing: float, sign: str) -> None:
    fan = RangeScan((18.0, 12.0), (bearing,), (8.0,))
    scene = replace(
        plain_scene,
        floor=np.ones((8, 12), dtype=np.uint8),
        show_robot=False,
        views=(SensorView(fan),),
    )
    cells = Painter(GlyphMode.ASCII, ColorDepth.NONE).cells(scene, whole_maze(scene.maze, 16))
    text = "".join(cells.text(row)[:32] for row in range(16))
    signs = [drawn for drawn in text if drawn != " " and drawn != "#"]
    assert signs.count(sign) >= len(signs) / 2 > 0


small_cells = st.builds(
    Cells,
    arrays(np.uint32, (3, 12), elements=st.sampled_from([ord(sign) for sign in "  ▀⠿x"])),
    arrays(np.int32, (3, 12), elements=st.sampled_from([DEFAULT, 0xFF0000, 0x00FF00])),
    arrays(np.int32, (3, 12), elements=st.sampled_from([DEFAULT, 0xFFFFFF, 0x0000FF])),
)


@given(cells=small_cells)
def test_runs_show_the_same_as_the_cells_one_by_one(cells: Cells) -> None:
    for row in range(3):
        strip = make_strip(cells, row, THEIRS)
        assert strip.text == cells.text(row)
        assert strip.cell_length == 12
        column = 0
        for segment in strip:
            assert segment.style is not None
            for sign in segment.text:
                foreground, background = (
                    int(cells.foreground[row, column]),
                    int(cells.background[row, column]),
                )
                assert packed(segment.style.bgcolor) == (
                    packed(THEIRS.bgcolor) if background == DEFAULT else background
                )
                if sign != " " and foreground != DEFAULT:
                    assert packed(segment.style.color) == foreground
                elif sign != " " and background == DEFAULT:
                    assert segment.style == THEIRS
                column += 1


def packed(color: Color | None) -> int | str | None:
    if color is None or color.triplet is None:
        return color.name if color else None
    return (color.triplet.red << 16) | (color.triplet.green << 8) | color.triplet.blue


def test_blanks_join_the_run_beside_them_on_the_same_background() -> None:
    cells = blank_cells(1, 6)
    cells.write(0, 0, " a b  ")
    cells.background[:] = 0xFFFFFF
    cells.background[0, 5] = 0
    cells.foreground[0, [1, 3]] = 0xFF0000
    strip = make_strip(cells, 0, THEIRS)
    assert [segment.text for segment in strip] == [" a b ", " "]


@given(old=small_cells, new=small_cells, join=st.sampled_from([None, 0, 1, 3, 20]))
def test_pasting_the_changed_spans_turns_the_old_picture_into_the_new(
    old: Cells, new: Cells, join: int | None
) -> None:
    characters, foreground, background = (
        getattr(old, name).copy() for name in ("characters", "foreground", "background")
    )
    for span in changed_spans(old, new, join):
        place = (span.row, slice(span.start, span.stop))
        assert span.start < span.stop
        characters[place] = new.characters[place]
        foreground[place] = new.foreground[place]
        background[place] = new.background[place]
    assert (characters == new.characters).all()
    assert (foreground == new.foreground).all()
    assert (background == new.background).all()


def test_near_changes_are_one_span_and_far_ones_two() -> None:
    old, new = blank_cells(2, 20), blank_cells(2, 20)
    new.write(1, 2, "x")
    new.write(1, 5, "x")
    new.write(1, 15, "x")
    assert changed_spans(old, old, 5) == []
    assert changed_spans(old, new, 5) == [Span(1, 2, 6), Span(1, 15, 16)]
    assert changed_spans(old, new, None) == [Span(1, 2, 16)]


def test_packing_colors_is_reversible() -> None:
    pixels = np.array([[[1, 2, 3], [255, 0, 128]]], dtype=np.uint8)
    assert (unpack(pack(pixels)) == pixels).all()
    assert pack(pixels)[0, 0] == 0x010203
