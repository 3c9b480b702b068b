"""The app's colours: legible, and safe for all who look."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import simmer_tui.tui
from simmer_tui.config.settings import all_settings
from simmer_tui.tui.maze.palette import Look, Role, palette_for
from simmer_tui.tui.terminal import ColorDepth
from simmer_tui.tui.themes import LEGIBLE, THEMES, contrast, theme_name, themes, variables

TEXT = (
    *("dim", "strong-text", "belief-text", "mark-text", "robot-text"),
    *("good-text", "warning-text", "danger-text"),
)
DEPTHS = (ColorDepth.TRUECOLOR, ColorDepth.COLORS_256)


def packed(color: str) -> int:
    return int(color.removeprefix("#"), 16)


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("look", list(Look))
def test_all_text_is_at_least_7_to_1_on_its_ground(look: Look, depth: ColorDepth) -> None:
    palette = palette_for(depth, look)
    named = variables(depth, look)
    colors = [palette[Role.TEXT], *(packed(named[name]) for name in TEXT)]
    for ground in (palette[Role.BACKGROUND], palette[Role.BARS]):
        assert min(contrast(color, ground) for color in colors) >= LEGIBLE


@pytest.mark.parametrize("look", list(Look))
def test_what_went_well_and_what_went_wrong_have_their_own_colors(look: Look) -> None:
    named = variables(ColorDepth.TRUECOLOR, look)
    palette = palette_for(ColorDepth.TRUECOLOR, look)
    words = {packed(named[f"{name}-text"]) for name in ("good", "warning", "danger")}
    assert len(words - {palette[Role.TEXT], palette[Role.ACCENT]}) == 3


def test_every_setting_has_its_theme_and_every_theme_is_registered() -> None:
    setting = next(item for item in all_settings() if item.name == "screen.theme")
    assert set(THEMES) == set(setting.rule.choices)  # type: ignore[attr-defined]
    for depth in ColorDepth:
        assert [theme.name for theme in themes(depth)] == [theme_name(look) for look in Look]


def test_the_style_sheet_names_only_colors_there_are() -> None:
    sheet = (Path(simmer_tui.tui.__file__).parent / "app.tcss").read_text(encoding="utf-8")
    known = {*variables(ColorDepth.TRUECOLOR), "background", "foreground", "accent", "surface"}
    assert set(re.findall(r"\$([a-z-]+)", sheet)) <= known


def test_contrast_is_that_of_wcag() -> None:
    assert contrast(0x000000, 0xFFFFFF) == pytest.approx(21.0)
    assert contrast(0x777777, 0xFFFFFF) == pytest.approx(4.478, abs=0.001)
