"""A contact that was planned and never came is told nowhere: `d1-200` in real time, then `xx`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pytest
from msgspec.structs import replace

from simmer_tui.cli.headless import EventLines
from simmer_tui.cli.log_reports import build_report
from simmer_tui.config import load_default
from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.live.snapshot import LogEntry
from simmer_tui.report.content import report_tables
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command
from simmer_tui.trials.run import TrialRun
from simmer_tui.trials.trial import Trial
from simmer_tui.tui.event_text import entry_line
from simmer_tui.tui.line_panel import text_of
from tests.manual_loop import ManualLoop


@dataclass
class Stopped:
    """A run in which a movement was stopped before the wall: what was told, and its log."""

    events: list[Event]
    log: Path
    reducer: Reducer


@pytest.fixture
def stopped(tmp_path: Path) -> Stopped:
    configuration = load_default()
    settings = configuration.settings
    settings = replace(settings, motion=replace(settings.motion, motion="timed"))
    simulator = Simulator(configuration.simulation, 7)
    simulator.advance(50.0)
    engine, loop = Engine(simulator, timed=True), ManualLoop()
    engine.start(cast("Any", loop))
    run = Stopped([], tmp_path / "run.jsonl", Reducer(checkpoint_of(simulator)))
    with RunLog(run.log, replace(configuration, settings=settings), simulator) as log:
        for watcher in (run.reducer.apply, log, run.events.append):
            engine.watch(watcher)
        session = engine.session(answer_at_end=False)
        session.submit(parse_command("d1-200"), lambda outcome: None)
        assert simulator.trajectory is not None
        assert simulator.trajectory.contact is not None, "it would meet the wall"
        loop.run_until(loop.now + 0.33)
        session.submit(replace(parse_command("xx"), stops=True), lambda outcome: None)
        loop.run_until(loop.now + 60.0)
        session.submit(parse_command("u1"), lambda outcome: None)
    return run


def test_the_lines_of_a_headless_run(stopped: Stopped) -> None:
    assert [line for line in map(EventLines().handle, stopped.events) if line] == []


def test_the_log_on_the_screen(stopped: Stopped) -> None:
    lines = [entry_line(LogEntry(0, 0.0, event)) for event in stopped.events]
    texts = [text_of(line) for line in lines if line is not None]
    assert any("stopped by xx" in text for text in texts)
    assert not any("wall" in text or "contact" in text for text in texts)


def test_the_state_that_screens_show(stopped: Stopped) -> None:
    state = stopped.reducer.at()
    assert (state.contacts, state.contact, state.touching, state.contact_points) == (0, None, False, ())


def test_the_report(stopped: Stopped) -> None:
    run = build_report(stopped.log)
    first, *others = report_tables(run)
    assert next(first.objects())["contacts"] == 0
    [commands] = [table for table in others if table.title == "Commands"]
    assert [row[3] for row in commands.texts()] == ["", "", ""]
    assert not [table for table in others if table.title == "Contacts"]


def test_the_replay(stopped: Stopped) -> None:
    with RunLogIndex(stopped.log) as log:
        assert log.find_next(-1, EntryFlag.CONTACT) is None
        assert log.find_previous(log.count, EntryFlag.CONTACT) is None
        playback = Playback(log)
        for entry in range(log.count):
            assert playback.state_at(entry, log.time_of(entry)).contacts == 0


PROGRAM = """
import os, socket
for message in (b"w0:200", b"u0", b"xx", b"u0"):
    with socket.create_connection((os.environ["SIMMER_HOST"], int(os.environ["SIMMER_PACKET_PORT"]))) as link:
        link.sendall(message)
        link.shutdown(socket.SHUT_WR)
        link.recv(1)
"""


def test_the_contact_points_of_trials(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    trial = Trial(
        number=0,
        seed=1,
        configuration=load(find_set("simmer-python")),
        maze="",
        command=f"{sys.executable} {program}",
        fixed_ports=False,
        time_limit=30.0,
    )
    result = TrialRun(trial, tmp_path).run()
    assert result.commands == 4
    assert (result.contacts, result.contact_points) == (0, ())
