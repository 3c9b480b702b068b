"""After the fact, on the screen: why a movement ended, the report of the run, where a failure points to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.widgets import Static
from textual.widgets._toast import Toast

from simmer_tui.events import Goal, MissionEvent, Result
from simmer_tui.tui.app import ReportScreen
from simmer_tui.tui.event_text import POINTER

Fly = Callable[..., int | None]
Cockpit = Any


def toasts(cockpit: Cockpit) -> str:
    return "\n".join(str(toast._notification.message) for toast in cockpit.app.query(Toast))


def test_why_says_what_stopped_the_robot(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("w1-40")
        await cockpit.until(lambda: "w1-40" in cockpit["log"])
        await cockpit.type(":why")
        await cockpit.until(lambda: "the robot met the maze's outer wall" in toasts(cockpit))

    fly(scenario)


def test_the_report_of_this_run_opens_and_closes(
    fly: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path / "data")

    async def scenario(cockpit: Cockpit) -> None:
        app = cockpit.app
        await cockpit.type(":report")
        await cockpit.until(lambda: "this run is not saved" in cockpit["hint"])
        cockpit.server.call(cockpit.server.save_run)
        await cockpit.until(lambda: cockpit.server.saved_run is not None)
        await cockpit.type("w1-40")
        await cockpit.until(lambda: "w1-40" in cockpit["log"])
        await cockpit.type(":report")
        while not isinstance(app.screen, ReportScreen):
            await cockpit.pilot.pause(0.05)
        text = str(app.screen.query_one("#report-text", Static).content)
        assert "What happened" in text
        assert "w1-40" in text
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: not isinstance(app.screen, ReportScreen))

    fly(scenario)


def test_a_failed_mission_points_to_why_and_report(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        cockpit.server.tell(MissionEvent(1.0, Goal.REACHED, "mission: loading zone reached"))
        await cockpit.until(lambda: "loading zone" in cockpit["log"])
        assert POINTER not in toasts(cockpit)
        cockpit.server.tell(MissionEvent(2.0, Result.FAILED, "mission: failed", "no time"))
        await cockpit.until(lambda: POINTER in toasts(cockpit))

    fly(scenario)
