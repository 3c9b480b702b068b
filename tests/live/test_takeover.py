"""A run that goes on from a moment of a logged one stands exactly where that one stood."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import pytest
from msgspec.structs import replace

from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.replay_command import run_replay
from simmer_tui.cli.rerun_command import run_rerun
from simmer_tui.config import load_default
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.errors import RunLogError
from simmer_tui.live.server import Server, link_delay
from simmer_tui.live.takeover import LogPoint, TakeOver, moment_at, moment_of
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName, Belief, Notice, NoticeKind
from simmer_tui.run.mission import Referee, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import State, checkpoint_of
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.log_records import ActionRecord, AnswerRecord, EndRecord, PlanRecord
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import CommandResult, Pose, Simulator, parse_command
from tests.manual_loop import ManualLoop

SEED = 4
COMMANDS = (
    *("u1", "c1", "o1", "d1-4", "g1", "r1-30", "u2", "p1-1", "p1-0", "d1-7", "zz", "t1"),
    *("r1--75", "u1", "d1-30", "l1", "w1-2", "o2", "u4", "r1-200", "u1", "d1-3", "c1"),
)


def any_ports(configuration: Configuration) -> Configuration:
    settings = configuration.settings
    return replace(configuration, settings=replace(settings, server=replace(settings.server, port=0)))


def mission_log(path: Path) -> list[CommandResult]:
    """A mission over a link whose delays are drawn, by a client; its answers."""
    configuration, plan = plan_run(any_ports(load(bundled_sets()["mission"])), SEED)
    simulator = Simulator(configuration.simulation, SEED)
    engine = Engine(simulator, link=link_delay(configuration.settings.link, SEED))
    assert configuration.settings.link.jitter > 0, "the mission's link draws"
    reducer = Reducer(checkpoint_of(simulator, mission=True))
    session = engine.session()
    outcomes: list[CommandResult] = []
    with RunLog(path, configuration, simulator, mission=True) as log:
        referee = Referee(plan, reducer, engine.tell)
        for watcher in (reducer.apply, referee.watch, log):
            engine.watch(watcher)
        referee.begin()
        engine.tell(Notice(NoticeKind.CONNECTED, "client x connected", "x"))
        for order, text in enumerate(COMMANDS):
            session.submit(parse_command(text), outcomes.append)
            if order % 7 == 3:
                pose = simulator.pose
                engine.tell(Belief(simulator.time, Pose(pose.x + 1, pose.y, pose.heading), pose, 0.5))
            if order == 11:
                engine.perform(Action(ActionName.TELEPORT, (30.0, 18.0, 45.0)))
    return outcomes


@contextmanager
def taken_over(path: Path, moment: LogPoint, log: Path | None = None) -> Iterator[Server]:
    """A server that stands at a moment; nobody has started it."""
    chosen = TakeOver(path, moment)
    chosen.check()
    server, rerun = chosen.serve()
    try:
        if log is not None:
            server.start_log(str(log))
        server.record()
        chosen.advance(server, rerun)
        yield server
    finally:
        server.stop()


def after(index: RunLogIndex, entry: int) -> LogPoint:
    return moment_of(index, entry, index.time_of(entry))


def answered(index: RunLogIndex) -> list[int]:
    """The entries after which no answer is outstanding: what comes after one that is lost begins earlier."""
    found, is_open = [], False
    for entry in range(index.count):
        record = index.record(entry)
        is_open = isinstance(record, PlanRecord) or (is_open and not isinstance(record, AnswerRecord))
        if not is_open:
            found.append(entry)
    return found


def test_a_saved_run_has_the_real_times_of_the_part_that_was_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path)
    mission_log(tmp_path / "run.jsonl")
    with RunLogIndex(tmp_path / "run.jsonl") as index:
        chosen = TakeOver(tmp_path / "run.jsonl", after(index, index.count - 1))
    server, rerun = chosen.serve()
    server.save_run()
    server.start_log(str(tmp_path / "log.jsonl"))
    chosen.advance(server, rerun)
    server.stop()
    assert server.saved_run is not None
    times = []
    for path in (tmp_path / "log.jsonl", server.saved_run.path):
        with RunLogIndex(path) as found:
            times.append([found.record(entry).real_time for entry in range(found.count)])
    assert len(set(times[0])) > 3
    assert times[0] == times[1]


@pytest.mark.slow
def test_what_follows_is_what_followed(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    logged = mission_log(path)
    with RunLogIndex(path) as index:
        playback = Playback(index)
        for entry in answered(index)[::4]:
            state = playback.state_at(entry, index.time_of(entry))
            log = tmp_path / f"{entry}.jsonl"
            with taken_over(path, after(index, entry), log) as server:
                shown = server.recorder.snapshot().state
                assert (shown.pose, shown.commands, shown.contacts) == (
                    state.pose, state.commands, state.contacts,
                )  # fmt: skip
                assert shown.holding == state.holding
                assert shown.mission == state.mission
                assert (shown.belief is None) == (state.belief is None)
                assert shown.client == "", "who was there then is not there now"
                outcomes: list[CommandResult] = []
                session = server.engine.session()
                done = server.simulator.commands
                teleported = any(isinstance(index.record(each), ActionRecord) for each in range(entry + 1))
                for order, text in enumerate(COMMANDS[done:], done):
                    session.submit(parse_command(text), outcomes.append)
                    if order == 11 and not teleported:
                        server.engine.perform(Action(ActionName.TELEPORT, (30.0, 18.0, 45.0)))
            assert [str(each) for each in outcomes] == [str(each) for each in logged[done:]]
            assert [each.time for each in outcomes] == [each.time for each in logged[done:]]
            assert run_rerun([str(log)]) == 0


def test_the_screen_of_a_run_that_was_taken_over_shows_no_end(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    mission_log(path)
    with RunLogIndex(path) as index, taken_over(path, after(index, 8)) as server:
        server.keep_verdict(has_program=False)
        snapshot = server.recorder.snapshot()
        assert snapshot.state.client == ""
        assert not [e.event for e in snapshot.entries if getattr(e.event, "kind", None) is NoticeKind.LEFT]


@pytest.mark.slow
def test_a_movement_under_way_ends_where_it_was_seen(tmp_path: Path, capsys: Any) -> None:
    path, log = tmp_path / "run.jsonl", tmp_path / "new.jsonl"
    mission_log(path)
    with RunLogIndex(path) as index:
        playback = Playback(index)
        for part in range(1, 12):
            log = tmp_path / f"{part}.jsonl"
            moment = moment_at(index, index.duration * part / 12)
            state = playback.state_at(playback.index.find_time(moment.elapsed), moment.elapsed)
            with taken_over(path, moment, log) as server:
                assert server.simulator.pose == state.pose
                assert not server.simulator.moving
                session = server.engine.session()
                for text in ("u1", "d1-2", "o1"):
                    session.submit(parse_command(text), lambda outcome: None)
            assert run_rerun([str(log)]) == 0
    out = capsys.readouterr()
    assert "every reply the same" in out.out
    header = json.loads(log.read_text().splitlines()[0])
    assert header["taken_over"] == {"log": "run.jsonl", "line": moment.line, "elapsed": moment.elapsed}
    assert f"took over from run.jsonl at {moment.elapsed:.2f} s" in out.err
    assert any("taken over from run.jsonl" in note for note in build_report(log).notes)


def test_a_run_that_took_over_another_can_be_taken_over_too(tmp_path: Path) -> None:
    """In the middle of a movement, and while an answer was on the link: their delays are drawn again."""
    path = tmp_path / "run.jsonl"
    logged = mission_log(path)
    with RunLogIndex(path) as index:
        begins = [i for i in range(index.count) if isinstance(index.record(i), PlanRecord)][2]
        ends = next(i for i in range(begins, index.count) if isinstance(index.record(i), EndRecord))
        moments = [moment_at(index, (index.time_of(begins) + index.time_of(ends)) / 2), after(index, ends)]
    for order, moment in enumerate(moments):
        log = tmp_path / f"{order}.jsonl"
        outcomes: list[CommandResult] = []
        with taken_over(path, moment, log) as server:
            done = server.simulator.commands
            server.engine.session().submit(parse_command("u1"), outcomes.append)
        assert outcomes[0].link == logged[done].link, "the delays of the answer that was lost are drawn"
        with RunLogIndex(log) as index:
            TakeOver(log, moment_at(index, index.duration)).check()


@pytest.fixture
def timed_log(tmp_path: Path) -> Path:
    """Motion in real time, under a clock of the test: with plans and ends, and two pauses."""
    configuration = any_ports(load_default())
    motion = replace(configuration.settings.motion, motion="timed")
    configuration = replace(configuration, settings=replace(configuration.settings, motion=motion))
    simulator = Simulator(configuration.simulation, configuration.settings.seed)
    engine, loop = Engine(simulator, timed=True), ManualLoop()
    engine.start(cast("Any", loop))
    path = tmp_path / "timed.jsonl"
    with RunLog(path, configuration, simulator, clock=lambda: 1.7e9 + loop.now) as log:
        engine.watch(log)
        session = engine.session()
        for text in ("u1", "d1-6", "u1", "r1-90", "d1-6"):
            session.submit(parse_command(text), lambda outcome: None)
            loop.run_until(loop.now + 0.7)
        engine.perform(Action(ActionName.TIME_SCALE, (2.0,)))
        loop.run_until(loop.now + 1.0)
        engine.perform(Action(ActionName.PAUSE))
    return path


def test_timed_motion_is_taken_over_too(timed_log: Path, tmp_path: Path) -> None:
    with RunLogIndex(timed_log) as index:
        playback = Playback(index)
        for part in range(3):
            moment = moment_at(index, index.duration * part / 2)
            state = playback.state_at(playback.index.find_time(moment.elapsed), moment.elapsed)
            log = tmp_path / f"{part}.jsonl"
            with taken_over(timed_log, moment, log) as server:
                assert server.simulator.pose == state.pose
                assert server.engine.time_scale == state.time_scale
                assert not server.engine.paused, "it can go on at once"
                assert not server.recorder.snapshot().state.paused
            assert run_rerun([str(log)]) == 0


@pytest.fixture
def velocity_log(tmp_path: Path) -> Path:
    """Continuous motion by a client in instant motion: freely, until it expires, and into a wall."""
    configuration, path = any_ports(load(bundled_sets()["mission"])), tmp_path / "velocity.jsonl"
    simulator = Simulator(configuration.simulation, SEED)
    engine = Engine(simulator, link=link_delay(configuration.settings.link, SEED))
    with RunLog(path, configuration, simulator) as log:
        engine.watch(log)
        session = engine.session()
        for text in (
            *("u1", "vv-3;0;20", "wt-0.5", "u1", "vv-3;0;-10;0.7", "wt-1.5", "d1-1", "vv-6;0;10", "wt-0.3"),
            *("d1-1", "vx-6", "wt-4", "o1", "vv-0;0;0", "u1", "vv-3;0;0"),
        ):
            session.submit(parse_command(text), lambda outcome: None)
        session.close()
    return path


def velocity_taken_over(path: Path, log: Path, moment: LogPoint, state: State) -> None:
    """A velocity in force ends as if its program had left: it has."""
    with taken_over(path, moment, log) as server:
        shown = server.recorder.snapshot().state
        assert (shown.pose, shown.contacts, shown.velocity) == (state.pose, state.contacts, None)
        assert shown.distance == pytest.approx(state.distance, abs=1e-9)
        session = server.engine.session()
        for text in ("u1", "wt-1", "o1", "vv-2;0;9", "wt-1", "d1-2"):
            session.submit(parse_command(text), lambda outcome: None)
    assert run_rerun([str(log)]) == 0
    logged = [json.loads(line) for line in log.read_text().splitlines()]
    assert all(line["n"] for line in logged if line["kind"] == "leg"), "each leg belongs to a command"


def test_a_long_part_of_continuous_motion_without_a_reply_is_taken_over(tmp_path: Path) -> None:
    """Its legs all come after the last reply."""
    configuration, path = any_ports(load_default()), tmp_path / "run.jsonl"
    simulator = Simulator(configuration.simulation, SEED)
    engine = Engine(simulator)
    with RunLog(path, configuration, simulator) as log:
        engine.watch(log)
        for text in ("vr-90", "wt-40"):
            engine.session().submit(parse_command(text), lambda outcome: None)
    with RunLogIndex(path) as index:
        moment = moment_at(index, 35.0)
        with taken_over(path, moment) as server:
            assert server.simulator.time == 35.0


def test_continuous_motion_is_taken_over_too(velocity_log: Path, tmp_path: Path) -> None:
    with RunLogIndex(velocity_log) as index:
        playback = Playback(index)
        for part in range(3):
            moment = moment_at(index, index.duration * part / 2)
            state = playback.state_at(playback.index.find_time(moment.elapsed), moment.elapsed)
            velocity_taken_over(velocity_log, tmp_path / f"{part}.jsonl", moment, state)


@pytest.mark.slow
def test_continuous_motion_is_taken_over_at_every_command(velocity_log: Path, tmp_path: Path) -> None:
    """At a contact too, and while the answer to a new velocity is on the link."""
    with RunLogIndex(velocity_log) as index:
        playback = Playback(index)
        entries = index.find_all(EntryFlag.COMMAND | EntryFlag.CONTACT)
        for entry in entries:
            moment = after(index, entry)
            state = playback.state_at(entry, moment.elapsed)
            velocity_taken_over(velocity_log, tmp_path / f"{entry}.jsonl", moment, state)
            record = index.record(entry)
            if isinstance(record, AnswerRecord) and record.velocity is not None:
                assert record.taken is not None
                log = tmp_path / f"{entry}-asked.jsonl"
                with taken_over(velocity_log, moment_at(index, record.taken + 1e-3), log) as server:
                    server.engine.session().submit(parse_command("wt-1"), lambda outcome: None)
                assert run_rerun([str(log)]) == 0


@pytest.mark.slow
def test_ports_that_are_taken_are_others(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    mission_log(path)
    with taken_over(path, LogPoint(1, 0.0, 0.0)) as first:
        header, *lines = path.read_text().splitlines(keepends=True)
        fields = json.loads(header)
        fields["settings"]["server"] |= {"port": first.ports["commands"], "host": "0.0.0.0", "any_user": True}
        path.write_text(json.dumps(fields, separators=(",", ":")) + "\n" + "".join(lines))
        with taken_over(path, LogPoint(1, 0.0, 0.0)) as second:
            assert first.ports["commands"] != second.ports["commands"]
            assert any("other ports are used" in each for each in second.warnings)
            assert second.host == "127.0.0.1", "a log opens nothing to others"
            assert not second.configuration.settings.server.any_user


def rewrite(path: Path, line: int, **changes: Any) -> None:
    lines = path.read_text().splitlines(keepends=True)
    lines[line - 1] = json.dumps(json.loads(lines[line - 1]) | changes, separators=(",", ":")) + "\n"
    path.write_text("".join(lines))


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    ("line", "changes", "message"),
    [
        (1, {"number": 5}, "begins after 5 commands"),
        (4, {"reply": 3.0}, "does not repeat exactly: line 4"),
        (4, {"link": 9.0}, "line 4: the link took 9.0 s in the log"),
        (6, {"n": 17}, "line 6: command number 3 is missing"),
    ],
)
def test_what_cannot_be_done_again_is_not_taken_over(
    tmp_path: Path, line: int, changes: dict[str, Any], message: str, capsys: Any
) -> None:
    path = tmp_path / "run.jsonl"
    mission_log(path)
    rewrite(path, line, **changes)
    with RunLogIndex(path) as index:
        chosen = TakeOver(path, after(index, 6))
        with pytest.raises(RunLogError, match=message):
            chosen.check()
        if line > 1:  # before it all was well
            TakeOver(path, after(index, 1)).check()
    assert run_replay([str(path), "--take-over", "0.3", "--no-ui"]) == 2
    assert message in capsys.readouterr().err


def test_a_real_robot_and_a_time_beyond_the_log_are_refused(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "run.jsonl"
    mission_log(path)
    assert run_replay([str(path), "--take-over", "900", "--no-ui"]) == 2
    assert "has the times from 0 to" in capsys.readouterr().err
    settings = json.loads(path.read_text().splitlines()[0])["settings"]
    rewrite(path, 1, settings=settings | {"sim": False})
    assert run_replay([str(path), "--take-over", "0", "--no-ui"]) == 2
    assert "is the log of a real robot" in capsys.readouterr().err


def test_the_end_as_a_report_rounds_it_is_the_end(velocity_log: Path) -> None:
    with RunLogIndex(velocity_log) as index:
        end = index.duration
        assert moment_at(index, end + 0.049) == moment_at(index, end)
        with pytest.raises(RunLogError, match="has the times from 0 to"):
            moment_at(index, end + 0.051)


@pytest.mark.slow
def test_a_program_goes_on_from_there(tmp_path: Path, capfd: Any) -> None:
    path, log = tmp_path / "run.jsonl", tmp_path / "new.jsonl"
    logged = mission_log(path)
    with RunLogIndex(path) as index:
        elapsed = index.time_of(next(i for i in range(index.count) if getattr(index.record(i), "n", 0) == 3))
    program = tmp_path / "program.py"
    said = tmp_path / "said"
    program.write_text(
        "from simmer_tui.client import Robot\n"
        "with Robot() as robot:\n"
        f"    robot.send('d1-4'); open({str(said)!r}, 'w').write(repr(robot.send('g1')))\n"
    )
    options = ["--take-over", repr(elapsed), "--no-ui", "--log", str(log)]
    run_replay([str(path), *options, "--run", f"{sys.executable} {program}"])
    assert "taken over from run.jsonl" in capfd.readouterr().err
    assert float(said.read_text()) == logged[4].reply
    with Rerun(log) as rerun:
        for _ in rerun.steps():
            pass
        assert (rerun.difference, rerun.commands) == (None, 5)
