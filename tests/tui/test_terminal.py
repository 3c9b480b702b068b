"""Which colours and characters are chosen for which terminal."""

from __future__ import annotations

import subprocess
import sys

import pytest

from simmer_tui.cli.main import command_named
from simmer_tui.config.settings import all_settings
from simmer_tui.tui.help import replay_help
from simmer_tui.tui.recorded import PLAYBACK_RATES
from simmer_tui.tui.terminal import (
    ColorDepth,
    GlyphMode,
    TerminalChoice,
    choose,
)
from simmer_tui.tui.themes import THEMES

XTERM_256 = {"TERM": "xterm-256color"}


@pytest.mark.parametrize(
    ("environment", "encoding", "color", "glyphs"),
    [
        ({**XTERM_256, "COLORTERM": "truecolor"}, "utf-8", "truecolor", "quadrant"),
        ({**XTERM_256, "COLORTERM": "24bit"}, "UTF-8", "truecolor", "quadrant"),
        ({"TERM": "xterm-direct"}, "utf-8", "truecolor", "quadrant"),
        ({**XTERM_256, "TERM_PROGRAM": "iTerm.app"}, "utf-8", "truecolor", "quadrant"),
        ({**XTERM_256, "WT_SESSION": "1b2c"}, "utf-8", "truecolor", "quadrant"),
        ({"TERM": "xterm-kitty"}, "utf-8", "truecolor", "quadrant"),
        (XTERM_256, "utf-8", "256", "quadrant"),
        ({**XTERM_256, "TERM_PROGRAM": "Apple_Terminal"}, "utf-8", "256", "quadrant"),
        ({"TERM": "putty-256color"}, "utf-8", "256", "half"),
        ({"TERM": "putty"}, "utf-8", "16", "half"),
        ({"TERM": "xterm"}, "utf8", "16", "quadrant"),
        ({}, "utf-8", "16", "quadrant"),
        ({"TERM": "tmux-256color"}, "utf-8", "256", "quadrant"),
        ({"TERM": "screen-256color", "WT_SESSION": "1b2c"}, "utf-8", "256", "quadrant"),
        ({"TERM": "screen", "TERM_PROGRAM": "vscode"}, "utf-8", "16", "quadrant"),
        ({"TERM": "tmux-256color", "COLORTERM": "truecolor"}, "utf-8", "truecolor", "quadrant"),
        ({"TERM": "linux"}, "utf-8", "16", "ascii"),
        ({"TERM": "linux", "COLORTERM": "truecolor"}, "utf-8", "16", "ascii"),
        ({"TERM": "dumb"}, "utf-8", "none", "ascii"),
        ({"TERM": "dumb", "COLORTERM": "truecolor"}, "utf-8", "none", "ascii"),
        ({**XTERM_256, "NO_COLOR": "1"}, "utf-8", "none", "ascii"),
        ({**XTERM_256, "NO_COLOR": ""}, "utf-8", "256", "quadrant"),
        (XTERM_256, "ascii", "none", "ascii"),
        (XTERM_256, "ANSI_X3.4-1968", "none", "ascii"),
        (XTERM_256, "iso8859-1", "none", "ascii"),
        (XTERM_256, "no-such-encoding", "none", "ascii"),
        (XTERM_256, None, "none", "ascii"),
    ],
)
def test_automatic_choice(environment: dict[str, str], encoding: str | None, color: str, glyphs: str) -> None:
    choice = choose(environment, encoding)
    assert (choice.color, choice.glyphs) == (color, glyphs)


@pytest.mark.parametrize(
    ("locale", "ascii_only"),
    [
        ("de_DE.ISO-8859-1", True),
        ("ru_RU.KOI8-R", True),
        ("ja_JP.eucJP@x", True),
        ("de_DE.utf8", False),
        ("", False),
    ],
)
def test_another_character_set_of_the_locale_counts_though_python_writes_utf8(
    locale: str, ascii_only: bool
) -> None:
    for name in ("LC_ALL", "LC_CTYPE", "LANG"):
        choice = choose(XTERM_256 | {name: locale}, "utf-8")
        assert (choice.glyphs is GlyphMode.ASCII) is ascii_only


def test_windows_console_without_term_has_all_colors_but_few_characters() -> None:
    assert choose({}, "utf-8", windows=True) == TerminalChoice(ColorDepth.TRUECOLOR, GlyphMode.HALF)
    modern = choose({"WT_SESSION": "1b2c"}, "utf-8", windows=True)
    assert modern == TerminalChoice(ColorDepth.TRUECOLOR, GlyphMode.QUADRANT)


@pytest.mark.parametrize("color", list(ColorDepth))
@pytest.mark.parametrize("glyphs", list(GlyphMode))
@pytest.mark.parametrize("environment", [{"TERM": "dumb"}, {**XTERM_256, "NO_COLOR": "1"}, {"TERM": "linux"}])
def test_explicit_options_win(environment: dict[str, str], color: str, glyphs: str) -> None:
    choice = choose(environment, "ascii", color=color, glyphs=glyphs)
    assert (choice.color, choice.glyphs) == (color, glyphs)


def test_one_explicit_option_leaves_the_other_automatic() -> None:
    assert choose({"TERM": "linux"}, "utf-8", color="256").glyphs is GlyphMode.ASCII
    assert choose(XTERM_256, "ascii", color="256").glyphs is GlyphMode.ASCII
    assert choose(XTERM_256, "utf-8", color="none").glyphs is GlyphMode.ASCII
    assert choose(XTERM_256, "utf-8", glyphs="half").color is ColorDepth.COLORS_256


def test_unknown_option_is_an_error() -> None:
    with pytest.raises(ValueError, match="millions"):
        choose(XTERM_256, "utf-8", color="millions")


@pytest.mark.parametrize(
    ("color", "system", "has_no_color"),
    [
        ("truecolor", "truecolor", False),
        ("256", "256", False),
        ("16", "standard", False),
        ("none", "standard", True),
    ],
)
def test_environment_tells_textual_the_choice(color: str, system: str, has_no_color: bool) -> None:
    environment = {"NO_COLOR": "1", "TERM": "xterm"}
    choice = choose(environment, "utf-8", color=color)
    choice.apply(environment)
    assert environment["TEXTUAL_COLOR_SYSTEM"] == choice.color_system == system
    assert ("NO_COLOR" in environment) is has_no_color
    assert choice.ansi_color is has_no_color


def test_deciding_does_not_import_textual() -> None:
    program = "import sys, simmer_tui.tui.terminal; sys.exit('textual' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_settings_and_options_offer_what_the_screen_has() -> None:
    settings = {item.name: item for item in all_settings()}
    offered: dict[str, tuple[str, ...]] = {
        "screen.color": ("auto", *ColorDepth),
        "screen.glyphs": ("auto", *GlyphMode),
        "screen.theme": tuple(THEMES),
    }
    for name, choices in offered.items():
        assert settings[name].rule.choices == choices
    of_replay = {
        name: each for each in command_named("replay").parser()._actions for name in each.option_strings
    }
    for name in ("screen.color", "screen.glyphs"):
        item, action = settings[name], of_replay[settings[name].option]
        assert (action.choices, action.default, action.help) == (item.rule.choices, item.default, item.help)


def test_the_help_of_the_replay_names_its_slowest_and_fastest_speed() -> None:
    assert f"({PLAYBACK_RATES[0]:g}x to {PLAYBACK_RATES[-1]:g}x)" in replay_help("a log")
