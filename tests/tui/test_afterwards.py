"""After the fact, on the screen: why a movement ended, the report of the run, where a failure points to."""

from __future__ import annotations

import asyncio
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.widgets import Static

from simmer_tui.run.events import Goal, MissionEvent, OutputLine, ProgramEnded
from simmer_tui.tui.help import HelpScreen, ReportScreen

Fly = Callable[..., int | None]
Cockpit = Any


def page(cockpit: Cockpit) -> str:
    """The text of the page that is open."""
    return str(cockpit.app.screen.query_one("#report-text", Static).content)


@pytest.mark.slow
def test_why_says_what_stopped_the_robot(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("w1-40")
        await cockpit.until(lambda: "w1-40" in cockpit["log"])
        await cockpit.type(":why")
        await cockpit.until(lambda: "why w1-40" in cockpit["answer"])
        assert "asked   40.0 in left" in cockpit["answer"]
        assert "stopped by a wall left" in " ".join(cockpit["answer"].split())
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: "why w1-40" not in cockpit["answer"])
        assert cockpit.app.query_one("#line").has_focus, (
            "the first closes the answer, the next goes to the maze"
        )

    fly(scenario)


@pytest.mark.slow
@pytest.mark.parametrize("drives", [("d1-3",), ("vv-3;0;0", "wt-1", "vv-0;0;0")])
def test_an_answer_stays_while_a_program_drives_on_and_goes_when_a_person_does(
    fly: Fly, drives: tuple[str, ...]
) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        robot = cockpit.client()
        await cockpit.type("d1-2")
        await cockpit.until(lambda: "d1-2" in cockpit["log"])
        await cockpit.type(":why")
        await cockpit.until(lambda: "why d1-2" in cockpit["answer"])
        for command in drives:
            await asyncio.to_thread(robot.send, command)
        await cockpit.until(lambda: drives[-1] in cockpit["log"])
        assert "why d1-2" in cockpit["answer"]
        await cockpit.type("d1--1")
        await cockpit.until(lambda: "why d1-2" not in cockpit["answer"])

    fly(scenario)


@pytest.mark.slow
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
        await cockpit.until(lambda: isinstance(app.screen, ReportScreen))
        # What is known stands there at once; on a quick machine the whole is there before one looks.
        await cockpit.until(lambda: "Still going after" in page(cockpit))
        while "What happened" not in page(cockpit):
            await cockpit.pilot.pause(0.05)
        assert "w1-40" in page(cockpit)
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: not isinstance(app.screen, ReportScreen))
        await cockpit.type(":report")
        await cockpit.until(lambda: isinstance(app.screen, ReportScreen))
        await cockpit.pilot.press(*"d1-3")
        await cockpit.until(lambda: cockpit.line == "d1-3")
        assert cockpit.app.query_one("#line").has_focus, (
            "what is typed belongs to the console, not to the maze"
        )
        assert cockpit.commands("keys") == []

    fly(scenario)


@pytest.mark.slow
def test_keys_typed_at_once_while_a_page_is_open_close_it_once_and_none_is_lost(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        app = cockpit.app
        await app.push_screen(ReportScreen("Succeeded.", "Why", "Esc closes"))
        cockpit.burst([*":reset", "enter", *"u1", "enter"])
        await cockpit.until(lambda: cockpit.commands("console") == ["u1"])
        assert "back at the start" in cockpit["log"]
        assert len(app.screen_stack) == 1
        cockpit.burst(["escape", "question_mark"])
        await cockpit.until(lambda: isinstance(app.screen, HelpScreen))
        cockpit.burst(["escape", "escape", "enter", *"u2", "enter"])
        await cockpit.until(lambda: cockpit.commands("console") == ["u1", "u2"])

    fly(scenario)


@pytest.mark.slow
def test_the_end_of_a_crashed_program_names_the_line_and_all_of_it_can_be_read(fly: Fly) -> None:
    told = (
        "Traceback (most recent call last):",
        '  File "/home/me/robot.py", line 52, in main',
        "    steer(robot, readings)",
        '  File "/home/me/robot.py", line 37, in steer',
        "    left = readings[5]",
        '  File "/usr/lib/python3/site-packages/simmer.py", line 3, in send',
        "    raise",
        "IndexError: list index out of range",
    )

    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("c1")
        await cockpit.type(":program")
        await cockpit.until(lambda: "none has ended" in cockpit["hint"])
        lines = tuple(OutputLine(0.5, line) for line in told)
        error, place = "IndexError: list index out of range", "robot.py:37"
        cockpit.server.tell(ProgramEnded(0.5, 1, error=error, place=place, stderr=lines))
        await cockpit.until(lambda: "why it ended" in cockpit["answer"])
        assert cockpit["header"].startswith(f" ! PROGRAM CRASHED   {error} in {place}")
        assert [line.rstrip() for line in cockpit["answer"].splitlines()] == [
            "why it ended ─────────── exit code 1",
            error,
            "robot.py:37 in steer",
            "    left = readings[5]",
            "robot.py:52 in main",
            "    steer(robot, readings)",
            "0.0 s   1 command   0 contacts",
            ":program whole error  :report page",
        ]
        await cockpit.type(":program")
        await cockpit.until(lambda: isinstance(cockpit.app.screen, ReportScreen))
        assert "site-packages/simmer.py" in page(cockpit)

    fly(scenario)


@pytest.mark.slow
def test_the_end_of_a_mission_is_an_event_until_the_run_restarts(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        server = cockpit.server
        await cockpit.until(lambda: "○ pick the block up" in cockpit["run"])
        server.tell(MissionEvent(1.0, Goal.REACHED, "mission: loading zone reached"))
        await cockpit.until(lambda: "✓ reached the loading zone" in cockpit["run"])
        assert not cockpit.app.query_one("#header").has_class("failure")
        server.call(server.referee.end, "out of patience")
        await cockpit.until(lambda: "why it failed" in cockpit["answer"])
        assert cockpit["header"].startswith(" ✗ MISSION FAILED   out of patience")
        assert cockpit["header"].endswith(" of 5:00 ")
        assert cockpit.app.query_one("#header").has_class("failure")
        assert ":why more  :report page  R again" in cockpit["answer"]
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: "why it failed" not in cockpit["answer"])
        assert "MISSION FAILED" in cockpit["header"]
        await cockpit.pilot.press("R")
        await cockpit.until(lambda: "back at the start" in cockpit["log"])
        await cockpit.until(lambda: "MISSION FAILED" not in cockpit["header"])
        assert cockpit.line == ""

    fly(scenario, mission=True)


@pytest.mark.slow
def test_on_a_small_screen_the_end_stands_in_three_rows_below_the_maze(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        server = cockpit.server
        await cockpit.type("c1")
        await cockpit.until(lambda: cockpit.app.query_one("#legend").display)
        server.call(server.referee.end, "out of patience")
        await cockpit.until(lambda: cockpit.app.query_one("#answer").region.height == 2)
        assert "MISSION FAILED   out of patience" in cockpit["header"]
        assert ":why more  :report page  R again" in cockpit["answer"]
        assert not cockpit.app.query_one("#legend").display
        await cockpit.type(":why")
        await cockpit.until(lambda: isinstance(cockpit.app.screen, ReportScreen))
        told = " ".join(page(cockpit).split())
        verdict = await cockpit.server.snapshot()
        assert verdict.verdict is not None
        assert all(line in told for line in verdict.verdict.lines), "nothing of the verdict is cut"
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: not isinstance(cockpit.app.screen, ReportScreen))
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: cockpit.app.query_one("#legend").display)
        assert not cockpit.app.query_one("#answer").display

    fly(scenario, size=(80, 24), mission=True)


@pytest.mark.slow
def test_on_a_small_screen_the_reply_of_a_stopped_movement_says_so_beside_what_is_typed(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("w1-100")
        await cockpit.until(lambda: "w1-100 -> stopped after" in cockpit["reply"])
        assert cockpit["reply"].rstrip().endswith("…"), "what there is no room for is marked"

    fly(scenario, size=(80, 24))


@pytest.mark.slow
def test_on_a_small_screen_the_answer_to_an_order_is_shown_below_the_first_steps(
    fly: Fly, tmp_path: Path
) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.until(lambda: "3 or press" in cockpit["hint"])
        for order, said in (
            (f":save {tmp_path / 'a.txt'}", "log written to"),
            (":seed 5", "with seed 5"),
            (f":log {tmp_path / 'a.jsonl'}", "logging to"),
        ):
            await cockpit.type(order)
            await cockpit.until(lambda said=said: said in cockpit["hint"])  # type: ignore[misc]
            assert "2 or type below" in cockpit["answer"]
        await cockpit.type(":why")
        await cockpit.until(lambda: "logging to" not in cockpit["hint"])

    fly(scenario, size=(80, 24))


@pytest.mark.slow
def test_a_page_of_a_small_screen_keeps_no_part_of_the_answer(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.until(lambda: "3 or press" in cockpit["hint"])
        await cockpit.pilot.press("f2")
        await cockpit.until(lambda: "3 or press" not in cockpit["hint"])
        assert "u1" in cockpit["sensors"]

    fly(scenario, size=(80, 24))


@pytest.mark.slow
def test_a_failure_has_its_cause_before_the_numbers_and_fits_its_place(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        answer = cockpit.app.query_one("#answer")
        for _ in range(12):
            await cockpit.type("d1-60")
        await cockpit.until(lambda: "MISSION FAILED   1 contact" in cockpit["header"])
        await cockpit.until(lambda: ":why more" in cockpit["answer"] and cockpit["answer"].count("\n") >= 4)
        lines = cockpit["answer"].splitlines()
        assert lines[0].startswith("why it failed ")
        assert lines[1] == "1 contact with a wall, 0 allowed"
        cause = r"At 0\.\d s, no range sensor had been"
        assert re.match(cause, lines[2])
        assert lines[-1].rstrip() == ":why more  :report page  R again"
        assert re.match(r"\d+\.\d s   \d+ commands?   1 contact$", lines[-2].rstrip())
        await cockpit.until(lambda: "contacts 1 " not in f"{cockpit['robot']} ")
        assert "1 contact" in cockpit["answer"].splitlines()[-2], "what comes after the end does not count"
        assert cockpit["header"].endswith(f"{lines[0].split()[-1]} of 5:00 ")
        assert len(lines) <= answer.size.height
        await cockpit.type(":why")
        await cockpit.until(lambda: "Esc closes" in cockpit["answer"])
        assert "Failed after" in cockpit["answer"]

    fly(scenario, mission=True)


@pytest.mark.slow
def test_a_page_may_open_as_the_app_ends(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        cockpit.app.push_screen(ReportScreen("Succeeded.", "Why", "Esc closes"))
        cockpit.app.exit(0)

    assert fly(scenario) == 0


# -- try again with one change ---------------------------------------------------------------------


@pytest.mark.slow
def test_a_failed_run_is_tried_again_without_a_question(
    fly: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path / "data/simmer-tui")
    program = tmp_path / "robot.py"
    root = str(Path(__file__).parents[2])
    program.write_text(
        f"import os, sys\nsys.path.insert(0, {root!r})\nfrom simmer_tui.client import Robot\n"
        "Robot().read('u1')\nopen(f'ran{os.getpid()}', 'w').close()\nsys.exit(3)\n"
    )
    monkeypatch.chdir(tmp_path)

    async def scenario(cockpit: Cockpit) -> None:
        app = cockpit.app
        await cockpit.type(":try")
        await cockpit.until(lambda: "the run has not ended yet" in cockpit["hint"])
        cockpit.server.program_command = shlex.join([sys.executable, "robot.py"])
        app._panes.slot.tries = True
        cockpit.server.call(cockpit.server.save_run)
        await cockpit.until(lambda: cockpit.server.saved_run is not None)
        robot = cockpit.client()
        await asyncio.to_thread(robot.send, "u1")
        cockpit.server.tell(ProgramEnded(0.0, 3, stderr=(OutputLine(0.0, "lost"),)))
        await cockpit.until(lambda: "T try again with one change" in cockpit["answer"])
        await cockpit.pilot.press("T")
        await cockpit.until(lambda: isinstance(app.screen, ReportScreen))
        # On a quick machine the end is there before one looks.
        await cockpit.until(lambda: "of at most" in page(cockpit) or "with seed" in page(cockpit))
        assert len(list(tmp_path.glob("ran*"))) >= 1
        while "The likely cause is the program itself" not in " ".join(page(cockpit).split()):
            await cockpit.pilot.pause(0.05)
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: not isinstance(app.screen, ReportScreen))
        # Closed before the end: the runs end, too.
        ran = len(list(tmp_path.glob("ran*")))
        await cockpit.type(":try")
        await cockpit.until(lambda: isinstance(app.screen, ReportScreen))
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: not app.workers._workers)
        assert len(list(tmp_path.glob("ran*"))) < 2 * ran

    fly(scenario)
