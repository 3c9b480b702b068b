"""Terminal cells: the characters of every glyph mode, and the runs they are sent in."""

from __future__ import annotations

import unicodedata

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rich.color import Color
from rich.style import Style
from textual.geometry import Region

from simmer_tui.tui.maze.glyphs import Cells, blank_cells, heading_arrow, side_arrow, signs_for
from simmer_tui.tui.maze.palette import DEFAULT, Attribute
from simmer_tui.tui.strips import changed_spans, make_strips
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

THEIRS = Style(color="cyan", bgcolor="blue")


@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_every_pattern_of_pixels_has_a_character_of_its_own(glyphs: GlyphMode) -> None:
    signs = signs_for(glyphs, ColorDepth.TRUECOLOR)
    assert len(signs.blocks) == 2**signs.pixels == len(set(signs.blocks))
    assert signs.blocks[0] == ord(" ")


def test_sextants_are_those_of_unicode() -> None:
    signs = signs_for(GlyphMode.SEXTANT, ColorDepth.TRUECOLOR)
    for pattern, code in enumerate(signs.blocks):
        if code < 0x1FB00:
            continue
        cells = "".join(str(bit + 1) for bit in range(6) if pattern >> bit & 1)
        assert unicodedata.name(chr(code)) == f"BLOCK SEXTANT-{cells}"


def test_octants_fill_their_block_of_unicode_and_take_the_rest_from_elsewhere() -> None:
    blocks = signs_for(GlyphMode.OCTANT, ColorDepth.TRUECOLOR).blocks
    numbered = [code for code in blocks if 0x1CD00 <= code <= 0x1CDE5]
    assert numbered == list(range(0x1CD00, 0x1CDE6))
    # BLOCK OCTANT-3, BLOCK OCTANT-2345678 and what is older.
    assert (blocks[0x04], blocks[0xFE]) == (0x1CD00, 0x1CDE5)
    named = {0x0F: "▀", 0xF0: "▄", 0x55: "▌", 0xAA: "▐", 0x05: "▘", 0xFF: "█", 0xC0: "▂", 0xFC: "▆"}
    assert {pattern: chr(blocks[pattern]) for pattern in named} == named


@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_eight_arrows_point_eight_ways(glyphs: GlyphMode) -> None:
    signs = signs_for(glyphs, ColorDepth.TRUECOLOR)
    assert len({heading_arrow(signs, 45.0 * step) for step in range(8)}) == 8
    assert heading_arrow(signs, -725.0) == heading_arrow(signs, 0.0) == signs.arrows[0]
    sides = [side_arrow(signs, *side) for side in ((1, 0), (-1, 0), (0, -1), (0, 1))]
    assert sides == (list("><^v") if glyphs is GlyphMode.ASCII else list("→←↑↓"))


def test_ascii_is_ascii_and_half_keeps_to_wgl4() -> None:
    wgl4 = set(" ▀▄█·•←↑→↓░■▐▌?/")
    for depth in ColorDepth:
        plain = signs_for(GlyphMode.ASCII, depth)
        used = [*map(chr, plain.blocks), *plain.lines.values(), *plain.arrows]
        assert all(sign.isascii() for sign in (*used, *(sign for sign, _ in plain.fills.values())))
        half = signs_for(GlyphMode.HALF, depth)
        used = [*map(chr, half.blocks), *half.lines.values(), *half.arrows]
        assert set("".join((*used, *(sign for sign, _ in half.fills.values())))) <= wgl4


small_cells = st.builds(
    Cells,
    arrays(np.uint32, (3, 12), elements=st.sampled_from([ord(sign) for sign in "  ▀⠿x"])),
    arrays(np.int32, (3, 12), elements=st.sampled_from([DEFAULT, 0xFF0000, 0x00FF00])),
    arrays(np.int32, (3, 12), elements=st.sampled_from([DEFAULT, 0xFFFFFF, 0x0000FF])),
    arrays(np.uint8, (3, 12), elements=st.sampled_from([0, 0, int(Attribute.BOLD), int(Attribute.REVERSE)])),
)


@settings(max_examples=20)
@given(cells=small_cells)
def test_runs_show_the_same_as_the_cells_one_by_one(cells: Cells) -> None:
    for row in range(3):
        strip = make_strips(cells, [row], THEIRS)[0]
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
                attributes = int(cells.attributes[row, column])
                assert bool(segment.style.bold) == bool(attributes & Attribute.BOLD)
                assert bool(segment.style.reverse) == bool(attributes & Attribute.REVERSE)
                if sign != " " and foreground != DEFAULT:
                    assert packed(segment.style.color) == foreground
                elif sign != " " and background == DEFAULT and not attributes:
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
    strip = make_strips(cells, [0], THEIRS)[0]
    assert [segment.text for segment in strip] == [" a b ", " "]


@settings(max_examples=20)
@given(old=small_cells, new=small_cells)
def test_pasting_the_changed_spans_turns_the_old_picture_into_the_new(old: Cells, new: Cells) -> None:
    names = ("characters", "foreground", "background", "attributes")
    shown = {name: getattr(old, name).copy() for name in names}
    for span in changed_spans(old, new):
        place = (span.y, slice(span.x, span.right))
        assert span.width > 0
        for name in names:
            shown[name][place] = getattr(new, name)[place]
    assert all((shown[name] == getattr(new, name)).all() for name in names)


def test_a_row_has_one_span() -> None:
    old, new = blank_cells(2, 20), blank_cells(2, 20)
    new.write(1, 2, "x")
    new.write(1, 15, "x")
    assert changed_spans(old, old) == []
    assert changed_spans(old, new) == [Region(2, 1, 14, 1)]
