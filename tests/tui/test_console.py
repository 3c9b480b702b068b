"""The console under a pilot: history, completion, meanings, and errors in place."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.events import Paste
from textual.widgets import Input

from simmer_tui.run.events import ProgramEnded
from simmer_tui.tui.help import HelpScreen
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.terminal import GlyphMode

Fly = Callable[..., int | None]
Cockpit = Any


@pytest.mark.slow
def test_history_comes_back_in_the_next_session(fly: Fly, tmp_path: Path) -> None:
    file = tmp_path / "data" / "history.txt"

    async def first(cockpit: Cockpit) -> None:
        for line in ("u1", "d1-1", "d1-1", ":noise off"):
            await cockpit.type(line)
        await cockpit.pilot.press("x", "up", "up")
        assert cockpit.line == "d1-1"
        await cockpit.pilot.press("down", "down")
        assert cockpit.line == "x"

    async def second(cockpit: Cockpit) -> None:
        seen = []
        for _ in range(4):
            await cockpit.pilot.press("up")
            seen.append(cockpit.line)
        assert seen == [":noise off", "d1-1", "u1", "u1"]

    fly(first, history=file)
    assert file.read_text(encoding="utf-8") == "u1\nd1-1\n:noise off\n"
    fly(second, history=file)


@pytest.mark.slow
def test_an_error_gives_way_to_what_happens_once_the_console_is_left(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        console = cockpit.app.query_one("#line", Input)
        console.focus()
        cockpit.app.post_message(Paste("foo\nu3\nu4\n"))
        await cockpit.until(lambda: "foo: " in cockpit["hint"])
        await cockpit.until(lambda: "u4" in cockpit["log"])
        await cockpit.pilot.press("escape", "up")
        await cockpit.until(lambda: "forward" in cockpit["hint"])
        await cockpit.type("foo")
        assert "foo: " in cockpit["hint"]
        robot = cockpit.client()
        await asyncio.to_thread(robot.send, "r1-5")
        await cockpit.until(lambda: "r1-5" in cockpit["log"])
        assert "foo: " in cockpit["hint"], "the line may still be mended"
        await cockpit.pilot.press("escape")
        await asyncio.to_thread(robot.send, "r1-6")
        await cockpit.until(lambda: "foo: " not in cockpit["hint"])

    fly(scenario, size=(80, 24))


@pytest.mark.slow
def test_the_last_reply_and_its_age_stay_beside_what_is_typed(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("c1")
        await cockpit.until(lambda: "last reply  c1 -> 0.00 deg  now" in cockpit["hint"])
        cockpit.app.query_one("#line", Input).value = "u2"
        await cockpit.until(lambda: re.fullmatch(r"u2 ultra2 .*   c1 -> 0\.00 deg  now", cockpit["hint"]))

    fly(scenario, size=(120, 36))


@pytest.mark.slow
def test_codes_and_orders_are_offered_with_their_meaning(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        console = cockpit.app.query_one("#line", Input)
        for typed, offered in (
            ("u", "u1 ultra1   u2 ultra2"),
            ("r1-4", "r1 turn counter-clockwise"),
            ("q", "no such code"),
            ("q9-3", "no such code q9; :help lists them"),
            ("wt-1", "wt wait so many seconds"),
            (":se", ":seed N back to the start with another seed"),
            (":teleprt", ":teleport X Y HEADING put the robot there"),
            (":noise o", ":noise on random errors of sensors and drives"),
            (":xyz", "no such order"),
            (":xyz 3", "no such order :xyz; :help lists them"),
        ):
            console.value = typed
            await cockpit.until(lambda offered=offered: cockpit["hint"].startswith(offered))

    fly(scenario)


@pytest.mark.slow
def test_tab_completes_and_else_goes_to_the_next_pane(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.pilot.press(*":te", "tab")
        assert cockpit.line == ":teleport"
        await cockpit.pilot.press("tab")
        await cockpit.until(lambda: not cockpit.app.query_one("#line").has_focus)

    fly(scenario)


@pytest.mark.slow
def test_what_is_not_an_order_stays_to_be_mended(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        for line, mistake in (
            (":telport 1 2 3", 'did you mean "teleport"?'),
            (":teleport 1 2", ":teleport takes 3 numbers; :teleport X Y HEADING"),
            (":block 1 x", ":block each must be a number"),
            (":noise maybe", ":noise takes on or off"),
            (":shot", ":shot takes a file name"),
            (":reset now", ":reset takes nothing after it"),
        ):
            await cockpit.type(line)
            await cockpit.until(lambda mistake=mistake: mistake in cockpit["hint"])
            assert cockpit.line == line
        await cockpit.pilot.press("x")
        await cockpit.until(lambda: "takes nothing" not in cockpit["hint"])
        assert cockpit.line == "x"

    fly(scenario)


@pytest.mark.slow
def test_two_commands_in_a_line_are_refused_and_neither_is_done(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("u1 u2")
        await cockpit.until(lambda: "one command a line" in cockpit["hint"])
        assert cockpit.line == "u1 u2"
        await cockpit.pilot.press(*"u2", "enter")
        await cockpit.until(lambda: cockpit.commands("console") == ["u2"])

    fly(scenario)


@pytest.mark.slow
@pytest.mark.parametrize("bursts", [3, pytest.param(50, marks=pytest.mark.slow)])
def test_lines_typed_ahead_are_all_carried_out_whole_and_in_order(fly: Fly, bursts: int) -> None:
    lines = ["o1", "o2", "o3", "zz", "d1-1", "u1"]

    async def scenario(cockpit: Cockpit) -> None:
        for times in range(1, bursts + 1):
            cockpit.burst([key for line in lines for key in (*line, "enter")])
            await cockpit.until(lambda times=times: cockpit.commands("console") == lines * times)
        assert cockpit.line == ""

    fly(scenario)


@pytest.mark.slow
def test_keys_beside_letters_keep_their_place_too(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        # One letter taken back, one line given up, one given; then out of the console, a key that drives,
        # back by the colon, an order whose letters are all keys that drive, and a command.
        typed = [*"u13", "backspace", "enter", *"d1-9", "ctrl+u", *"u2", "enter", "escape", "w"]
        cockpit.burst([*typed, *":trail", "enter", *"u3", "enter", "escape", "up"])
        await cockpit.until(lambda: len(cockpit.commands("keys")) == 2)
        assert cockpit.commands("console") == ["u1", "u2", "u3"]
        assert cockpit.commands("keys") == ["d1-3", "d1-3"]
        assert "reset" not in cockpit["log"]
        order = [command.shown for command in cockpit.given]
        assert order == ["u1", "u2", "d1-3", "u3", "d1-3"]

    fly(scenario)


@pytest.mark.slow
def test_a_command_typed_ahead_from_the_maze_drives_nothing_by_keys(
    fly: Fly,
) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press()
        cockpit.burst(["enter", *"d1-3", "enter"])
        await cockpit.until(lambda: cockpit.given)
        assert [(each.source, each.shown) for each in cockpit.given] == [("console", "d1-3")]

    fly(scenario)


@pytest.mark.slow
def test_a_filter_typed_ahead_is_whole_and_its_letters_have_no_other_meaning(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        log = cockpit.app.query_one(LogPanel)
        cockpit.server.call(cockpit.server.tell, ProgramEnded(0.5, 0))
        await cockpit.until(lambda: "verdict" in cockpit["log"])
        log.focus()
        await cockpit.pilot.pause()
        cockpit.burst([*"/R:1", "enter", "escape", "w"])
        await cockpit.until(lambda: cockpit.commands("keys") == ["d1-3"])
        assert log.filter == "R:1"
        assert "back at the start" not in log.text
        assert cockpit.line == ""

    fly(scenario)


@pytest.mark.slow
def test_a_paste_gives_each_whole_line_and_leaves_the_rest_in_the_line(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.pilot.press(*"o")
        cockpit.app.post_message(Paste("1\no2\r\n\nzz\ro3\nd1-"))
        cockpit.burst(["2", "enter"])
        await cockpit.until(lambda: len(cockpit.commands("console")) == 5)
        assert cockpit.commands("console") == ["o1", "o2", "zz", "o3", "d1-2"]
        await cockpit.press()  # while the maze has the focus, too
        cockpit.app.post_message(Paste("u1\nu"))
        await cockpit.until(lambda: cockpit.commands("console")[-1] == "u1")
        assert cockpit.line == "u"

    fly(scenario)


@pytest.mark.slow
def test_a_paste_tells_of_lines_that_were_refused(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        cockpit.app.post_message(Paste("o1\nu1 u2\n:nonsense\no2\n"))
        await cockpit.until(lambda: cockpit.commands("console") == ["o1", "o2"])
        assert cockpit["hint"].startswith("2 of 4 lines refused; first u1 u2: u1 takes nothing after it")
        assert cockpit.line == ""
        cockpit.app.post_message(Paste("o1\nu1 u2\n"))
        await cockpit.until(lambda: cockpit["hint"].startswith("u1 u2: u1 takes"))
        assert cockpit.line == "u1 u2"

    fly(scenario)


@pytest.mark.slow
def test_the_console_understands_words_without_a_colon_and_describes_codes(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("help u2")
        await cockpit.until(lambda: isinstance(cockpit.app.screen, HelpScreen))
        assert "Looks  45 deg to the left (front left)" in cockpit.app.screen.text
        await cockpit.pilot.press("escape")
        await cockpit.type("exit")

    assert fly(scenario) == 0


@pytest.mark.slow
def test_the_cursor_is_to_be_seen_without_colour(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        console = cockpit.app.query_one("#line", Input)
        for keys in ((), ("u", "1"), ("left",)):
            await cockpit.pilot.press(*keys)
            reversed_text = [
                each.text for each in console.render_line(0) if each.style and each.style.reverse
            ]
            assert len("".join(reversed_text)) == 1

    fly(scenario, glyphs=GlyphMode.ASCII)


@pytest.mark.slow
def test_a_refused_command_is_explained_above_the_line(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("zz")
        await cockpit.until(lambda: cockpit["hint"] == "zz: no sensor or drive has the code zz")
        await cockpit.until(lambda: cockpit.line == "zz")
        await cockpit.pilot.press(*"d1-x", "enter")  # what was refused is marked: typing replaces it
        await cockpit.until(lambda: "not a finite decimal number" in cockpit["hint"])
        await cockpit.until(lambda: cockpit.line == "d1-x")
        await cockpit.type("   ")
        assert cockpit.commands("console") == ["zz", "d1-x"]

    fly(scenario)


@pytest.mark.slow
def test_a_typed_reading_does_not_wait_for_a_programs_drive(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("d1-12")
        await cockpit.until(lambda: "moving" in cockpit["robot"])
        await cockpit.type("u1")
        await cockpit.until(lambda: cockpit.commands("console")[-1:] == ["u1"])
        assert cockpit.server.simulator.moving

    fly(scenario, motion__motion="timed", motion__time_scale=0.1)
