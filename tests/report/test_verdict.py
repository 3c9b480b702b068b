"""The verdict on a run: its outcome, its one sentence and its cause, from a log."""

from __future__ import annotations

import json
import queue
import re
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.report_command import run_report
from simmer_tui.client import Robot
from simmer_tui.config.dialects import COMMANDS, REPLIES
from simmer_tui.config.loader import Override, find_set, load
from simmer_tui.live.server import Server
from simmer_tui.report import live_verdict
from simmer_tui.report.causes import Kind
from simmer_tui.report.content import output
from simmer_tui.report.live_verdict import LiveVerdict
from simmer_tui.report.page import report_page
from simmer_tui.report.verdict import Outcome, Verdict, verdict_of
from simmer_tui.run.attempt import Attempt, Task, task_of
from simmer_tui.run.events import (
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
from simmer_tui.run.mission import plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import parse_command

CRASH = ProgramEnded(
    9.0, 1, error="KeyError: 'u9'", place="robot.py:12", stderr=(OutputLine(8.5, "KeyError: 'u9'"),)
)
SUCCESS = MissionEvent(8.0, Result.SUCCESS, "mission: success")
BROKEN = MissionEvent(8.0, Result.FAILED, "mission: failed", "1 contact with a wall, 0 allowed")
GONE = MissionEvent(9.0, Result.FAILED, "mission: failed", "the program ended with exit code 1")


@pytest.fixture
def mission_run(start_run: Callable[..., Any]) -> Any:
    run = start_run(files=dict(load(find_set("mission")).files))
    run.engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    return run


def verdict(run: Any) -> Verdict:
    return build_report(run.path).verdict


def test_a_python_without_the_package_is_told_what_to_take(start_run: Callable[..., Any]) -> None:
    run = start_run()
    run.engine.tell(
        ProgramEnded(0.0, 1, error="ModuleNotFoundError: No module named 'simmer_tui'", place="a.py:3")
    )
    assert verdict(run).advice.startswith("Try: Use the Python that has simmer_tui")


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


LEFT = Notice(NoticeKind.LEFT, "client a disconnected", "a")


@pytest.mark.parametrize("ends", [(), (LEFT,), (CRASH,), (LEFT, CRASH)])
def test_a_run_that_was_taken_over_has_not_ended(
    start_run: Callable[..., Any], ends: tuple[Any, ...]
) -> None:
    """Whoever drove the logged run before that moment is not there now."""
    run = start_run()
    for event in (Notice(NoticeKind.CONNECTED, "client a connected", "a"), *ends):
        run.engine.tell(event)
    run.engine.tell(Notice(NoticeKind.TAKEN_OVER, "taken over", "old.jsonl"))
    run.send("d1-3")
    assert verdict(run).outcome is Outcome.STILL_GOING
    run.engine.tell(ProgramEnded(9.0, 0))
    assert verdict(run).outcome is Outcome.ENDED


@pytest.mark.parametrize(
    ("after", "counted"),
    [("2 commands", "nothing went wrong"), ("1 command", "2 commands, nothing went wrong")],
)
def test_the_commands_of_a_client_that_left_are_counted_once(
    start_run: Callable[..., Any], after: str, counted: str
) -> None:
    run = start_run()
    run.send("u1", "d1-1")
    run.engine.tell(Notice(NoticeKind.LEFT, f"client a disconnected after {after}", "a"))
    assert verdict(run).text.endswith(f": client a disconnected after {after}; {counted}.")


@pytest.mark.parametrize(
    ("answer", "worst"),
    [("w1-1", "3 commands, nothing went wrong"), ("d1-1", "In all, 1 of 3 commands was refused")],
)
def test_what_is_sent_until_the_robot_has_stopped_is_not_refused(
    start_run: Callable[..., Any], answer: str, worst: str
) -> None:
    run = start_run()
    run.send("d1-1")
    early = run.simulator.refuse(parse_command("w1-1"))
    run.engine.tell(structs.replace(early, reason="the robot is still moving"))
    run.send(answer)
    assert verdict(run).text.endswith(f" {worst}.")


@pytest.mark.parametrize(
    ("ended", "worst"),
    [
        (ProgramEnded(9.0, 1, stderr=(OutputLine(1.0, "no wall"),)), "it printed last: no wall"),
        (ProgramEnded(9.0, 3), "it printed nothing"),
        (ProgramEnded(9.0, 143, stopped=True), "1 command until then"),
    ],
)
def test_a_program_that_failed_is_never_told_that_nothing_went_wrong(
    start_run: Callable[..., Any], ended: ProgramEnded, worst: str
) -> None:
    run = start_run()
    run.send("u1")
    run.engine.tell(ended)
    assert verdict(run).text.endswith(f"; {worst}.")


def test_a_run_without_a_mission_has_its_end_and_its_worst(start_run: Callable[..., Any]) -> None:
    run = start_run()
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "a"))
    run.send("d1-60", "d1-60", "d1-60", "d1-60")
    run.engine.tell(Notice(NoticeKind.LEFT, "client a disconnected after 4 commands", "a"))
    found = verdict(run)
    assert found.outcome is Outcome.ENDED
    assert "client a disconnected after 4 commands" in found.text
    assert " s, the robot touched the wall" in found.text
    assert found.text.endswith(" of d1-60, the last of 4 contacts.")
    assert found.cause is None


def test_a_run_that_restarted_is_judged_from_there(mission_run: Any) -> None:
    mission_run.engine.tell(CRASH)
    mission_run.perform(ActionName.RESET)
    mission_run.send("u1")
    assert verdict(mission_run).outcome is Outcome.STILL_GOING


def test_the_report_begins_with_the_verdict(mission_run: Any, capsys: Any) -> None:
    mission_run.send("u1", "d1-1")
    mission_run.engine.tell(CRASH)
    text = verdict(mission_run).text
    assert run_report([str(mission_run.path)]) == 0
    assert " ".join(capsys.readouterr().out.split()).startswith(verdict(mission_run).headline)
    assert run_report([str(mission_run.path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    told = answer["verdict"]
    assert (told["text"], told["outcome"], told["goal"]) == (text, "crashed", None)
    assert told["cause"]["kind"] == "program crashed"
    assert told["cause"]["sure"] == "certain"
    assert told["program"]["exit_code"] == 1
    assert answer["output"] == [{"time_s": 8.5, "stream": "stderr", "output": "KeyError: 'u9'"}]
    assert "output" not in answer["text"]


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
    assert note == "after the mission's end: 3 commands and 2 contacts, not counted here"
    assert before.notes == []


def test_a_program_that_goes_on_after_the_mission_takes_none_of_its_time(mission_run: Any) -> None:
    mission_run.send("u1", "d1-1")
    mission_run.engine.tell(MissionEvent(mission_run.simulator.time, Result.SUCCESS, "mission: success"))
    before = build_report(mission_run.path)
    mission_run.send("u1", "d1-60")
    mission_run.engine.tell(ProgramEnded(mission_run.simulator.time, 1, error="E"))
    after = build_report(mission_run.path)
    assert after.history.elapsed == before.history.elapsed < after.elapsed
    assert after.paths.cells == before.paths.cells
    assert after.history.programs.items[-1].elapsed == after.elapsed


def test_continuous_motion_after_the_mission_is_counted_apart(mission_run: Any) -> None:
    mission_run.send("vv-1;0;0", "wt-1", "vv-0;0;0", "d1-1")
    mission_run.engine.tell(SUCCESS)
    before = build_report(mission_run.path)
    mission_run.send("vv-6;0;0", "wt-20")
    after = build_report(mission_run.path)
    assert (after.totals.commands, after.totals.contacts, after.pose) == (4, 0, before.pose)
    assert after.totals.distance == before.totals.distance
    assert after.history.elapsed == before.history.elapsed
    [note] = after.notes
    assert re.fullmatch(r"after the mission's end: 2 commands and \d+ contacts?, not counted here", note)


def test_a_leg_under_way_at_the_missions_end_counts_to_its_own_end(mission_run: Any) -> None:
    mission_run.send("vv-1;0;0", "wt-1")
    mission_run.engine.tell(MissionEvent(1.0, Result.SUCCESS, "mission: success"))
    mission_run.send("vv-0;0;0")
    place = mission_run.simulator.pose
    mission_run.send("wt-1", "vv-6;0;0", "wt-20")
    report = build_report(mission_run.path)
    assert report.totals.contacts == 0
    assert report.reducer.still
    assert report.pose == place


def test_a_run_that_restarts_counts_again_at_the_time_of_its_replay(mission_run: Any) -> None:
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


def test_the_time_of_a_run_that_was_restarted_names_the_restart(start_run: Callable[..., Any]) -> None:
    """All other times count from the log's beginning."""
    run = start_run()
    run.send("u1", "d1-8", "a1-4")
    run.perform(ActionName.RESET)
    run.send("u1", "d1-3", *["d1-40"] * 6)
    report = build_report(run.path)
    begun, since = report.history.elapsed - run.simulator.time, run.simulator.time
    text = report.verdict.text
    assert begun > 1.0
    assert text.startswith(f"Still going {since:.1f} s after the restart at {begun:.1f} s: at ")
    [touched] = re.findall(r"at ([\d.]+) s, the robot touched", text)
    assert begun < float(touched) < begun + since
    page = report_page(report, "run")
    assert f"simulated after the restart at {begun:.1f} s" in page


def test_the_output_of_a_program_after_a_restart_has_times_from_there(mission_run: Any) -> None:
    mission_run.send("u1", "d1-8")
    mission_run.engine.tell(CRASH)
    assert output(verdict(mission_run)).heading == "The program's last output"
    mission_run.perform(ActionName.RESET)
    mission_run.engine.tell(CRASH)
    found = verdict(mission_run)
    begun = found.elapsed - CRASH.time
    assert begun > 1.0
    assert output(found).heading == f"The program's last output, times after the restart at {begun:.1f} s"


def test_a_run_that_was_too_slow_after_a_restart_has_its_own_seconds(mission_run: Any) -> None:
    mission_run.send("u1", "d1-8", "a1-8")
    mission_run.perform(ActionName.RESET)
    mission_run.engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    mission_run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "a"))
    mission_run.send("u1", "d1-3")
    history = build_report(mission_run.path).history
    found = verdict_of(history, task_of(load(find_set("mission")), 7), cut_off=True)
    assert found.text.startswith("Failed 0.")
    assert "after the restart at " in found.text


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


def test_the_legs_of_a_continuous_motion_are_no_commands(mission_run: Any) -> None:
    mission_run.send("vv-3;0;9", "wt-4")
    run = build_report(mission_run.path)
    assert Attempt(run.history, None).commands == 2


def test_a_slow_robot_that_steers_often_makes_progress(mission_run: Any) -> None:
    for step in range(600):
        mission_run.send(f"vv-1;0;{step % 3 - 1}", "wt-0.05")
    run = build_report(mission_run.path)
    attempt = Attempt(run.history, None)
    assert run.totals.legs >= 600
    assert run.pose.x > 30.0
    assert attempt.stalled.since > 20.0, "it came to new ground to the end"
    assert attempt.stalled.movements < 5


def test_a_robot_that_steers_to_and_fro_makes_none(mission_run: Any) -> None:
    for step in range(470):
        mission_run.send(f"vv-{3 - 6 * (step % 2)};0;0", "wt-0.5")
    attempt = Attempt(build_report(mission_run.path).history, None)
    assert attempt.stalled.since < 60.0
    assert attempt.stalled.movements > 100


MANY = 600
"""Contacts: a run keeps its newest 500, and those that do not count must not push out the one that does."""


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("commands", [1, MANY])
def test_contacts_after_the_mission_change_no_verdict_of_a_run(commands: int) -> None:
    configuration, plan = plan_run(load(find_set("mission"), {"server.port": Override("--port", 0)}), 1)
    server = Server(configuration, plan=plan)
    history = server.keep_history()
    server.start(lambda event: None)
    try:
        with Robot(port=server.ports[COMMANDS.purpose], reply_port=server.ports[REPLIES.purpose]) as robot:
            for _ in range(commands):
                robot.drive("d1", 60)
    finally:
        server.stop()
    task = task_of(configuration, server.seed, plan)
    assert Attempt(history, task).commands == 1, "its answer came after the mission's end"
    found = verdict_of(history, task)
    assert found.cause is not None
    assert "d1-60 was sent" in found.text


@pytest.mark.slow
def test_contacts_after_the_mission_change_no_verdict_on_screen(mission_run: Any) -> None:
    simulator, engine = mission_run.simulator, mission_run.engine
    calls: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
    checkpoint = checkpoint_of(simulator, mission=True)
    live = LiveVerdict(
        Reducer(checkpoint),
        RunHistory(checkpoint),
        Task(0, 300.0, None, tuple(Goal)),
        lambda *call: calls.put(call),
        lambda event: None,
    )
    engine.watch(live.apply)
    engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    texts = []
    mission_run.send("u1", "d1-60")
    for ends in (BROKEN, Notice(NoticeKind.LEFT, "client a disconnected", "a")):
        engine.tell(ends)
        tell, *found = calls.get(timeout=20)
        tell(*found)
        assert live.verdict is not None
        texts.append(live.verdict.text)
        mission_run.send(*("d1-60",) * MANY)
    assert texts[0] == texts[1]
    assert re.search(r"d1-60 was sent\. At \d+\.\d s, the robot touched", texts[1])


def test_the_end_waits_for_a_search_of_the_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """The libraries that the search is in must not be taken down under it: the process would die of that."""
    begun, over = threading.Event(), threading.Event()

    def search(history: RunHistory, task: Task | None) -> Verdict:
        begun.set()
        threading.Event().wait(0.3)  # a search takes a while
        over.set()
        raise ValueError("there is none")

    monkeypatch.setattr(live_verdict, "verdict_of", search)
    server = Server(load(find_set("default"), {"server.port": Override("--port", 0)}))
    server.keep_verdict(has_program=True)
    server.start(lambda event: None)
    server.call(server.engine.tell, ProgramEnded(8.0, 0))
    assert begun.wait(20.0)
    server.stop()
    assert over.is_set()


def test_a_program_that_ends_with_its_mission_is_told_one_verdict(mission_run: Any) -> None:
    engine = mission_run.engine
    calls: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
    checkpoint = checkpoint_of(mission_run.simulator, mission=True)
    told: list[Any] = []
    live = LiveVerdict(
        Reducer(checkpoint),
        RunHistory(checkpoint),
        Task(0, 300.0, None, tuple(Goal)),
        lambda *call: calls.put(call),
        told.append,
    )
    engine.watch(live.apply)
    engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    mission_run.send("u1")
    for ends in (ProgramEnded(8.0, 0), SUCCESS):  # the second comes while the first is searched
        engine.tell(ends)
    for _ in range(2):
        found, *of_search = calls.get(timeout=20)
        found(*of_search)
    assert live.verdict is not None
    assert [event.text for event in told] == [live.verdict.text]
