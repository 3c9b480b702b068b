"""The verdict on a run: its outcome, its one sentence and its cause, from a log."""

from __future__ import annotations

import json
import queue
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.log_commands import build_report, run_report
from simmer_tui.client import Robot
from simmer_tui.config.dialects import COMMANDS, REPLIES
from simmer_tui.config.loader import Override, find_set, load
from simmer_tui.events import (
    ActionName,
    Event,
    Goal,
    MissionEvent,
    Notice,
    NoticeKind,
    OutputLine,
    ProgramEnded,
    Result,
)
from simmer_tui.mission import plan_run
from simmer_tui.report.causes import Kind
from simmer_tui.report.verdict import Outcome, Verdict
from simmer_tui.server import Server

CRASH = ProgramEnded(
    9.0, 1, error="KeyError: 'u9'", place="robot.py:12", stderr=(OutputLine(8.5, "KeyError: 'u9'"),)
)
SUCCESS = MissionEvent(8.0, Result.SUCCESS, "mission: success")
BROKEN = MissionEvent(8.0, Result.FAILED, "mission: failed", "1 contact with a wall, 0 allowed")
GONE = MissionEvent(9.0, Result.FAILED, "mission: failed", "the program has ended with exit code 1")


@pytest.fixture
def mission_run(start_run: Callable[..., Any]) -> Any:
    run = start_run(files=dict(load(find_set("mission")).files))
    run.engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    return run


def verdict(run: Any) -> Verdict:
    return build_report(run.path).verdict


@pytest.mark.parametrize(
    ("events", "outcome", "begins"),
    [
        ((), Outcome.STILL_GOING, "Still going after"),
        ((SUCCESS,), Outcome.SUCCEEDED, "Succeeded after 8.0 s"),
        ((SUCCESS, CRASH), Outcome.SUCCEEDED, "Succeeded after 8.0 s"),
        ((BROKEN,), Outcome.FAILED, "Failed after 8.0 s"),
        ((BROKEN, CRASH), Outcome.FAILED, "Failed after 8.0 s"),
        ((CRASH,), Outcome.CRASHED, "Crashed after 9.0 s: KeyError: 'u9' in robot.py:12."),
        ((CRASH, GONE), Outcome.CRASHED, "Crashed after 9.0 s: KeyError: 'u9' in robot.py:12."),
        ((ProgramEnded(9.0, 0),), Outcome.ENDED, "Ended after"),
        ((ProgramEnded(9.0, 0), GONE), Outcome.FAILED, "Failed after 9.0 s"),
    ],
)
def test_the_first_that_decides_is_the_outcome(
    mission_run: Any, events: tuple[Any, ...], outcome: Outcome, begins: str
) -> None:
    mission_run.send("u1", "d1-1")
    for event in events:
        mission_run.engine.tell(event)
    found = verdict(mission_run)
    assert found.outcome is outcome
    assert found.text.startswith(begins)
    assert any("After that" in note for note in found.notes) == (len(events) == 2 and events[1] is CRASH)


def test_a_crash_is_the_cause_and_its_place_is_what_to_fix(mission_run: Any) -> None:
    mission_run.engine.tell(MissionEvent(1.0, Goal.REACHED, "mission: loading zone reached"))
    mission_run.send("u1", "d1-1")
    mission_run.engine.tell(CRASH)
    found = verdict(mission_run)
    assert found.goal is Goal.REACHED
    assert "(last goal: loading zone reached)" in found.text
    assert found.cause is not None
    assert found.cause.kind is Kind.CRASHED
    assert found.program == CRASH


def test_a_run_without_a_mission_has_its_end_and_its_worst(start_run: Callable[..., Any]) -> None:
    run = start_run()
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "a"))
    run.send("d1-60", "d1-60", "d1-60", "d1-60")
    run.engine.tell(Notice(NoticeKind.LEFT, "client a disconnected after 4 commands", "a"))
    found = verdict(run)
    assert found.outcome is Outcome.ENDED
    assert "client a disconnected after 4 commands" in found.text
    assert "stuck at" in found.text
    assert found.cause is None


def test_a_run_that_began_anew_is_judged_from_there(mission_run: Any) -> None:
    mission_run.engine.tell(CRASH)
    mission_run.perform(ActionName.RESET)
    mission_run.send("u1")
    assert verdict(mission_run).outcome is Outcome.STILL_GOING


def test_the_report_begins_with_the_verdict(mission_run: Any, capsys: Any) -> None:
    mission_run.send("u1", "d1-1")
    mission_run.engine.tell(CRASH)
    text = verdict(mission_run).text
    assert run_report([str(mission_run.path)]) == 0
    assert " ".join(capsys.readouterr().out.split()).startswith(text)
    assert run_report([str(mission_run.path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["verdict"]
    assert (told["text"], told["outcome"], told["goal"]) == (text, "crashed", None)
    assert told["cause"]["kind"] == "program crashed"
    assert told["cause"]["sure"] == "certain"
    assert told["program"]["exit_code"] == 1
    assert told["program"]["stderr"] == [{"time_s": 8.5, "text": "KeyError: 'u9'"}]


def test_output_that_would_steer_a_terminal_is_escaped(mission_run: Any, capsys: Any) -> None:
    line = OutputLine(1.0, "\x1b[2J<script>")
    mission_run.engine.tell(ProgramEnded(1.0, 1, error="E: \x1b[2J", place="\x07.py:1", stderr=(line,)))
    assert run_report([str(mission_run.path)]) == 0
    out = capsys.readouterr().out
    assert "\x1b[2J" not in out
    assert "\x07" not in out
    assert "\\x1b[2J<script>" in out


def test_what_comes_after_the_mission_is_counted_apart(mission_run: Any) -> None:
    mission_run.send("u1", "d1-1")
    mission_run.engine.tell(SUCCESS)
    before = build_report(mission_run.path)
    mission_run.send("u1", "d1-60", "d1-60")
    after = build_report(mission_run.path)
    assert (after.totals.commands, after.totals.contacts, after.pose) == (2, 0, before.pose)
    assert after.verdict == before.verdict
    [note] = after.notes
    assert note == "after the mission's end came 3 commands and 2 contacts, which do not count here"
    assert before.notes == []


def test_a_run_that_begins_anew_counts_again_at_the_time_of_its_replay(mission_run: Any) -> None:
    mission_run.send("u1", "d1-1")
    mission_run.engine.tell(SUCCESS)
    mission_run.send("d1-2", "d1--2")
    gone = max(SUCCESS.time, mission_run.simulator.time)
    mission_run.perform(ActionName.RESET)
    mission_run.send("u1", "d1-3")
    run = build_report(mission_run.path)
    assert run.totals.commands == 4
    # The mission's own second, what does not count, and three inches after the reset.
    assert run.history.elapsed == pytest.approx(gone + mission_run.simulator.time)


def test_the_verdict_on_screen_sees_what_the_report_sees(tmp_path: Path) -> None:
    """In this set u1 and u4 have changed places, which a program that knows the nominal set cannot know."""
    folder = tmp_path / "swapped"
    shutil.copytree(find_set("mission"), folder)
    sensors = folder / "sensors.csv"
    swapped = {"u1": "u4", "u4": "u1"}
    sensors.write_text(re.sub(r"(?<=,)u[14](?=,)", lambda code: swapped[code[0]], sensors.read_text()))
    configuration = load(folder, {"server.port": Override("--port", 0), "seed": Override("--seed", 1)})
    configuration, plan = plan_run(configuration)
    server = Server(configuration, plan=plan)
    verdicts: queue.SimpleQueue[str] = queue.SimpleQueue()

    def watch(event: Event) -> None:
        if isinstance(event, Notice) and event.kind is NoticeKind.VERDICT:
            verdicts.put(event.text)

    server.keep_verdict(has_program=False)
    server.start(watch)
    try:
        with Robot(port=server.ports[COMMANDS.purpose], reply_port=server.ports[REPLIES.purpose]) as robot:
            for _ in range(10):
                robot.read("u1", "u4")
                robot.drive("r1", 36)
            robot.drive("w1", 60)  # against a wall: the mission has failed
        assert "the nominal set mission" in verdicts.get(timeout=20)
    finally:
        server.stop()
