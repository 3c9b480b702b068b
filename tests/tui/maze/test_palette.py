"""The colours: distinct for everybody, and sent as they were chosen."""

from __future__ import annotations

from itertools import combinations, pairwise

import pytest
from rich.color import Color, ColorSystem

from simmer_tui.tui.maze.palette import (
    DEFAULT,
    FLOORS,
    GROUNDS,
    HEATS,
    STANDARD_16,
    ZONES,
    Look,
    Role,
    palette_for,
)
from simmer_tui.tui.terminal import ColorDepth
from tests.tui.maze.color_science import Rgb, contrast, difference, lab

LOOKS = list(Look)
DEPTHS = [ColorDepth.TRUECOLOR, ColorDepth.COLORS_256]
ON_SCREEN = [Role.BACKGROUND, Role.BARS]


def shown(role: Role, look: Look, depth: ColorDepth) -> Rgb:
    """Colour that the terminal shows after Rich has sent one."""
    packed = palette_for(depth, look)[role]
    color = Color.from_rgb(packed >> 16, (packed >> 8) & 255, packed & 255)
    if depth is ColorDepth.TRUECOLOR:
        assert color.triplet is not None
        return tuple(color.triplet)
    return tuple(color.downgrade(ColorSystem.EIGHT_BIT).get_truecolor())


def test_the_difference_is_that_of_the_published_pairs() -> None:
    for one, other, expected in (
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((90.8027, -2.0831, 1.4410), (91.1528, -1.6435, 0.0447), 1.4441),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ):
        assert difference(one, other) == pytest.approx(expected, abs=1e-4)
    assert contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21)


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("look", LOOKS)
def test_marks_stand_out_from_every_ground(look: Look, depth: ColorDepth) -> None:
    marks = {
        Role.ROBOT: GROUNDS,
        Role.CONTACT: GROUNDS,
        Role.BELIEF: (*GROUNDS, Role.BACKGROUND),
        Role.EDGE: (*GROUNDS, Role.BACKGROUND),
        Role.BLOCK: (*FLOORS, *ZONES),
        Role.TRAIL: (*FLOORS, *ZONES),
        Role.RAY_WEAK: (*FLOORS, *ZONES),
        Role.RAY_STRONG: (*FLOORS, *ZONES),
        Role.LOADING_LINE: (Role.LOADING_GROUND,),
        Role.DROP_LINE: (Role.DROP_GROUND,),
        Role.BACKGROUND: (Role.CONTACT,),
    }
    for mark, grounds in marks.items():
        for ground in grounds:
            ratio = contrast(shown(mark, look, depth), shown(ground, look, depth))
            assert ratio >= 3.0, (mark.name, ground.name, ratio)
    robot = shown(Role.ROBOT, look, depth)
    assert contrast(shown(Role.HEADING, look, depth), robot) >= 4.5
    # With 256 colours a robot 3:1 from the block would be too like a strong ray for deuteranopia.
    assert contrast(shown(Role.BLOCK, look, depth), robot) >= (3.0 if depth is ColorDepth.TRUECOLOR else 2.8)
    strong, weak = shown(Role.RAY_STRONG, look, depth), shown(Role.RAY_WEAK, look, depth)
    assert contrast(strong, weak) >= 1.3


HEAT = [role for pair in HEATS for role in pair]
# Least CIEDE2000 of a mark and heat.
LEAST_ON_HEAT = {Look.DARK: 20.0, Look.LIGHT: 17.0, Look.CONTRAST: 25.0}


WHERE = (Role.ROBOT, Role.BELIEF)
"""Marks for where the robot is, and where its program believes it to be."""


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("look", LOOKS)
def test_marks_stand_out_from_heat(look: Look, depth: ColorDepth) -> None:
    """Robot, trail, walls, block and all that may lie on a grid's belief."""
    marks = (
        *(Role.ROBOT, Role.TRAIL, Role.EDGE, Role.BLOCK, Role.CONTACT, Role.BELIEF),
        *(Role.RAY_WEAK, Role.RAY_STRONG, Role.LOADING_LINE),
    )
    least = max(20.0 if depth is ColorDepth.TRUECOLOR else 0.0, LEAST_ON_HEAT[look])
    for mark in marks:
        for ground in HEAT:
            one, other = shown(mark, look, depth), shown(ground, look, depth)
            assert contrast(one, other) >= (4.5 if mark in WHERE else 3.0), (mark.name, ground.name)
            assert difference(lab(one), lab(other)) >= least, (
                mark.name,
                ground.name,
            )
    for ground in HEAT:
        assert contrast(shown(Role.DROP_LINE, look, depth), shown(ground, look, depth)) >= 3.0


@pytest.mark.parametrize(("look", "highest", "steps"), [(Look.DARK, 19.0, 4.8), (Look.LIGHT, 15.0, 3.0)])
def test_levels_of_heat_differ_from_the_tile_and_from_each_other(
    look: Look, highest: float, steps: float
) -> None:
    depth = ColorDepth.TRUECOLOR
    for tile, column in ((Role.BLACK_TILE, 0), (Role.WHITE_TILE, 1)):
        colors = [lab(shown(each, look, depth)) for each in (tile, *(pair[column] for pair in HEATS))]
        assert difference(colors[0], colors[3]) >= highest
        for one, other in pairwise(colors):
            assert difference(one, other) >= steps


@pytest.mark.parametrize("look", LOOKS)
def test_with_16_colors_heat_has_no_tint(look: Look) -> None:
    palette = palette_for(ColorDepth.COLORS_16, look)
    assert {palette[role] for role in HEAT} <= {palette[Role.BLACK_TILE], palette[Role.WHITE_TILE]}


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("look", LOOKS)
def test_text_is_read_easily(look: Look, depth: ColorDepth) -> None:
    for role in (Role.TEXT, Role.DIM_TEXT, Role.ACCENT):
        for ground in ON_SCREEN:
            ratio = contrast(shown(role, look, depth), shown(ground, look, depth))
            assert ratio >= 7.0, (role.name, ground.name, ratio)


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("look", LOOKS)
def test_the_floor_is_quiet_unless_it_matters(look: Look, depth: ColorDepth) -> None:
    black, white, loud_black, loud_white = (shown(role, look, depth) for role in FLOORS)
    assert contrast(black, white) <= 1.15
    assert contrast(loud_black, loud_white) >= 1.4


# 256 colours leave no set with 20 in light; for protanopia dots, ring, square and X carry the difference of
# trail and belief, block and ray.
LEAST = {
    (ColorDepth.TRUECOLOR, "normal"): 19.9,
    (ColorDepth.TRUECOLOR, "deuteranopia"): 19.9,
    (ColorDepth.TRUECOLOR, "protanopia"): 11.9,
    (ColorDepth.COLORS_256, "normal"): 18.5,
    (ColorDepth.COLORS_256, "deuteranopia"): 17.5,
}


@pytest.mark.parametrize(("depth", "vision"), list(LEAST))
@pytest.mark.parametrize("look", LOOKS)
def test_marks_differ_for_everybody(look: Look, depth: ColorDepth, vision: str) -> None:
    marks = (Role.ROBOT, Role.TRAIL, Role.CONTACT, Role.BELIEF, Role.BLOCK, Role.RAY_STRONG)
    for one, other in combinations(marks, 2):
        apart = difference(*(lab(shown(role, look, depth), vision) for role in (one, other)))
        assert apart >= LEAST[depth, vision], (one.name, other.name, apart)


@pytest.mark.parametrize("look", LOOKS)
def test_16_colors_are_sent_as_their_numbers(look: Look) -> None:
    palette = palette_for(ColorDepth.COLORS_16, look)
    for role in Role:
        packed = palette[role]
        sent = Color.from_rgb(packed >> 16, (packed >> 8) & 255, packed & 255)
        number = sent.downgrade(ColorSystem.STANDARD).number
        assert number is not None
        assert STANDARD_16[number] == packed


@pytest.mark.parametrize("look", LOOKS)
def test_without_colors_there_is_none(look: Look) -> None:
    assert set(palette_for(ColorDepth.NONE, look).colors) == {DEFAULT}
