"""The help: every key, every order, every code."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace
from rich.cells import cell_len

from simmer_tui.config.settings import KeySettings, all_settings
from simmer_tui.links.port_list import SerialPort
from simmer_tui.live.operating.orders import CONSOLE_COMMANDS
from simmer_tui.sim.specs import GripperSpec, SimulationSpec
from simmer_tui.tui.app import SimmerApp
from simmer_tui.tui.console import _ConsoleInput
from simmer_tui.tui.help import PAGE_FRAME, folded, help_text, key_settings, replay_help
from simmer_tui.tui.help_page import HelpPage, robot_cells
from simmer_tui.tui.key_table import ANYWHERE, IN_LOG, MazePane
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from tests.tui.maze.decoding import robot_cells as robot_cells_of


def test_every_key_setting_is_there_with_its_keys(course_spec: SimulationSpec) -> None:
    text = help_text(replace(KeySettings(), poll="ctrl+k, full_stop"), course_spec)
    lines = [line.strip() for line in text.splitlines()]
    for item in all_settings():
        if item.name.startswith("keys."):
            assert any(item.help in line for line in lines), item.name
    assert "ctrl+k, .         read all sensors" in lines
    assert "+, =              zoom in" in lines
    assert "up, w             drive forward  (fine with Shift)" in lines


def test_every_binding_is_in_the_help_or_a_setting() -> None:
    told = " ".join(group.shown for group in (*ANYWHERE, *IN_LOG)).replace(",", " ").split()
    told += ["colon", "1", "2", "3", "4"]
    for owner in (SimmerApp, LogPanel, _ConsoleInput):
        for binding in owner.BINDINGS:
            for key in binding.key.split(","):
                assert key in told, f"{owner.__name__}: {key}"
    settings = {item.name.removeprefix("keys.") for item in all_settings() if item.name.startswith("keys.")}
    assert {binding.id.removesuffix("_fine") for binding in MazePane.BINDINGS} == settings


def test_every_order_and_code_is_there(course_spec: SimulationSpec) -> None:
    spec = replace(course_spec, gripper=GripperSpec(code="gr"))
    text = help_text(KeySettings(), spec)
    for order in CONSOLE_COMMANDS.values():
        assert f"  {order.usage}" in text
        assert order.help in text
    for sensor in spec.sensors:
        assert f"{sensor.code}     read {sensor.id}" in text
    assert "w1-V   drive left (+Y) by V" in text
    assert "gr-1   close the gripper; gr-0 opens it" in text
    assert all(len(line) <= 84 for line in text.splitlines())
    assert text.isascii()


def test_no_word_of_the_help_is_cut_on_a_narrow_screen(course_spec: SimulationSpec) -> None:
    for text in (
        help_text(KeySettings(), course_spec),
        replay_help("/home/a/" + "long-name/" * 8 + "run.jsonl"),
    ):
        shown = folded(text, 75)
        assert max(map(len, shown.splitlines())) <= 75
        assert "".join(shown.split()) == "".join(text.split())
        assert folded(text, 200) == text
    place = "f5                run the sample program, while a simulated robot waits"
    lines = folded(help_text(KeySettings(), course_spec), 75).splitlines()
    following = lines[lines.index(f"  {place}") + 1]
    assert following == " " * 20 + "for one"


@pytest.mark.slow
def test_the_help_has_whole_lines_at_80_columns_and_after_a_change_of_size(fly: Any) -> None:
    async def scenario(cockpit: Any) -> None:
        await cockpit.type(":help")
        await cockpit.until(lambda: cockpit.app.screen.query("#help-text"))
        frame = cockpit.app.screen.query_one("#help")
        await cockpit.until(lambda: 0 < frame.virtual_size.width <= frame.scrollable_content_region.width)
        high = frame.virtual_size.height
        await cockpit.pilot.resize_terminal(120, 36)
        await cockpit.until(lambda: frame.virtual_size.height < high)

    fly(scenario, size=(80, 24))


def test_any_typed_text_is_shown_as_it_is_in_titles(fly: Any) -> None:
    async def scenario(cockpit: Any) -> None:
        for typed in ("[/", "[u0]", "[b]x[/b]", "\\[", "[@click=app.quit]x"):
            await cockpit.type(f":help {typed}")
            await cockpit.until(lambda: cockpit.app.screen.query("#help-text"))
            title = cockpit.app.screen.query_one("#help")._border_title
            assert title.plain == f"Help: {typed}"
            await cockpit.pilot.press("escape")
            await cockpit.until(lambda: len(cockpit.app.screen_stack) == 1)

    fly(scenario)


@pytest.mark.slow
def test_the_palette_shows_names_of_ports_as_they_are(fly: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    described = "[/] a robot [of ours"
    monkeypatch.setattr("simmer_tui.tui.help.list_ports", lambda: [SerialPort("/dev/[/x", described, "")])

    async def scenario(cockpit: Any) -> None:
        await cockpit.pilot.press("ctrl+p", *"robot")

        def shown() -> str:
            options = cockpit.app.screen.query("OptionList").first().options
            return "\n".join(str(option.prompt) for option in options)

        await cockpit.until(lambda: described in shown() and ":robot /dev/[/x" in shown())

    fly(scenario)


@pytest.mark.parametrize("glyphs", [GlyphMode.QUADRANT, GlyphMode.HALF, GlyphMode.ASCII])
def test_the_first_screen_has_robot_codes_signs_and_keys(
    glyphs: GlyphMode, course_spec: SimulationSpec
) -> None:
    """At 120 x 36 all of it; at 80 x 24 the robot, the codes and the signs first."""
    painter = Painter(glyphs, ColorDepth.NONE if glyphs is GlyphMode.ASCII else ColorDepth.TRUECOLOR)
    page = HelpPage(key_settings(KeySettings()), course_spec, painter)
    wide, narrow = (page.text(columns - PAGE_FRAME).plain.split("\n") for columns in (120, 80))
    assert len(wide) <= 36 - 2
    assert all(cell_len(row) <= 120 - PAGE_FRAME for row in wide)
    assert all(cell_len(row) <= 80 - PAGE_FRAME for row in narrow)
    first = "\n".join(narrow[: 24 - 2])
    for text in ("\n".join(wide), first):
        for sensor in course_spec.sensors:
            assert sensor.code in text, sensor.code
        assert "time of flight" in text
        assert "its spread" in text
    for name, keys, _ in key_settings(KeySettings()):
        assert any(keys in row for row in wide), name
    assert glyphs is not GlyphMode.ASCII or "".join(wide).isascii()


def test_the_robot_of_the_help_is_three_times_as_large_with_a_code_at_each_place(
    course_spec: SimulationSpec,
) -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    cells = robot_cells(course_spec, painter)
    text = [cells.text(row) for row in range(cells.shape[0])]
    assert robot_cells_of(cells, painter).any(axis=0).sum() >= 14
    # Front up: u1 looks up, u3 back, u2 to the front left.
    rows = {
        code: next(row for row, line in enumerate(text) if code in line) for code in ("u1", "u3", "o3", "o4")
    }
    assert rows["u1"] < 5 < 10 < rows["u3"]
    assert text[rows["o3"]].index("o3") < 12 < 20 < text[rows["o4"]].index("o4")
