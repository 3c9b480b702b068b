"""The console under a pilot: history, completion, meanings, and errors in place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from textual.widgets import Input

Fly = Callable[..., int | None]
Cockpit = Any


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


def test_codes_and_orders_are_offered_with_their_meaning(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        console = cockpit.app.query_one("#line", Input)
        for typed, offered in (
            ("u", "u1 ultra1   u2 ultra2"),
            ("r1-4", "r1 turn counter-clockwise"),
            ("q", "no such code"),
            (":se", ":seed N back to the start with another seed"),
            (":teleprt", ":teleport X Y HEADING put the robot there"),
            (":noise o", ":noise on random errors of sensors and drives"),
            (":xyz", "no such order"),
        ):
            console.value = typed
            await cockpit.until(lambda offered=offered: cockpit["hint"].startswith(offered))

    fly(scenario)


def test_tab_completes_and_else_goes_to_the_next_pane(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.pilot.press(*":te", "tab")
        assert cockpit.line == ":teleport"
        await cockpit.pilot.press("tab")
        await cockpit.until(lambda: not cockpit.app.query_one("#line").has_focus)

    fly(scenario)


def test_what_is_not_an_order_stays_to_be_mended(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        for line, complaint in (
            (":telport 1 2 3", 'did you mean "teleport"?'),
            (":teleport 1 2", ":teleport takes 3 numbers; :teleport X Y HEADING"),
            (":block 1 x", ":block each must be a number"),
            (":noise maybe", ":noise takes on or off"),
            (":shot", ":shot takes a file name"),
            (":reset now", ":reset takes nothing after it"),
        ):
            await cockpit.type(line)
            await cockpit.until(lambda complaint=complaint: complaint in cockpit["hint"])
            assert cockpit.line == line
        await cockpit.pilot.press("x")
        await cockpit.until(lambda: "takes nothing" not in cockpit["hint"])

    fly(scenario)


def test_a_refused_command_is_explained_above_the_line(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("zz")
        await cockpit.until(lambda: cockpit["hint"] == "zz: no sensor or drive has the code zz")
        assert cockpit.line == ""
        await cockpit.type("d1-x")
        await cockpit.until(lambda: "not a finite decimal number" in cockpit["hint"])
        await cockpit.type("   ")
        assert cockpit.commands("console") == ["zz", "d1-x"]

    fly(scenario)


def test_a_typed_reading_does_not_wait_for_a_programs_drive(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("d1-12")
        await cockpit.until(lambda: "moving" in cockpit["robot"])
        await cockpit.type("u1")
        await cockpit.until(lambda: cockpit.commands("console")[-1:] == ["u1"])
        assert cockpit.server.simulator.moving

    fly(scenario, motion__motion="timed", motion__time_scale=0.1)
