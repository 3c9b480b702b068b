"""Real logs of format 1, as version 0.1 wrote them: opened, shown, reported and run again."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.report_command import build_report
from simmer_tui.cli.rerun_command import run_rerun
from simmer_tui.events import CommandResult, MovementEnded
from simmer_tui.report.content import tables
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.sim import Status

LOGS = sorted((Path(__file__).parent / "format1").glob("*.jsonl.gz"))
PACKETS = Path(__file__).parent / "format1" / "packets.jsonl.gz"
"""In it `w0:200` was accepted and stopped by `xx` after 0.12 s, long before the wall."""


def named(path: Path) -> str:
    return path.name.partition(".")[0]


@pytest.fixture(params=LOGS, ids=named)
def log_file(request: pytest.FixtureRequest) -> Path:
    path: Path = request.param
    return path


def test_every_line_is_understood(log_file: Path) -> None:
    with LogReader(log_file) as log:
        told = list(log)
        fold = log.fold()
    assert log.header.written == 1
    assert log.note == ""
    for each in told:
        assert isinstance(each, Logged), each
        fold.apply(each.event)
    outcomes = [
        each.event for each in told if isinstance(each, Logged) and isinstance(each.event, CommandResult)
    ]
    numbers = {outcome.number for outcome in outcomes}
    assert numbers == set(range(1, max(numbers) + 1))


def test_it_is_shown_at_any_time(log_file: Path) -> None:
    chance = random.Random(1)
    with RunLogIndex(log_file) as log:
        playback = Playback(log)
        assert playback.state_at_time(-1.0)[0] <= 0
        for _ in range(60):
            elapsed = chance.uniform(0.0, log.duration)
            entry, state = playback.state_at_time(elapsed)
            assert log.time_of(max(entry, 0)) <= elapsed or entry <= 0
            assert math.isfinite(state.pose.x)
            maze = playback.configuration.simulation.maze
            assert 0 <= state.pose.x <= maze.width
            assert 0 <= state.pose.y <= maze.height
        end = playback.state_at(log.count - 1, log.duration)
        again = playback.state_at_time(log.duration)[1]
        assert (again.pose, again.contacts, again.distance) == (end.pose, end.contacts, end.distance)


def test_it_is_reported(log_file: Path) -> None:
    run = build_report(log_file)
    assert run.commands > 5
    assert run.broken.given == 0
    with LogReader(log_file) as log:
        ends = [each.event for each in log if isinstance(each, Logged)]
    contacts = sum(isinstance(event, MovementEnded) and event.contact is not None for event in ends)
    assert run.contacts == contacts == sum(record.contacts for record in run.codes.values())


def test_rerun_says_by_which_rules_before_the_first_difference(log_file: Path, capsys: Any) -> None:
    assert run_rerun([str(log_file)]) in (0, 1)
    out, err = capsys.readouterr()
    assert "format 1; it is run by the rules of its time" in err
    assert "every reply the same" in out or "in the log and" in out


def test_a_contact_that_was_only_planned_is_shown_nowhere() -> None:
    with LogReader(PACKETS) as log:
        told = [each.event for each in log if isinstance(each, Logged)]
    [first] = [event for event in told if isinstance(event, MovementEnded) and event.command.text == "w0:200"]
    assert first.contact is None
    assert first.stopped_by
    assert first.pose.y == pytest.approx(6.729, abs=0.001)
    assert any(isinstance(event, CommandResult) and event.status is Status.STOPPED for event in told)
    run = build_report(PACKETS)
    assert run.contacts == 0
    assert {record.contacts for record in run.codes.values()} == {0}
    assert ("contacts", "0") in tables(run)[0].rows
    with RunLogIndex(PACKETS) as index:
        assert index.next_contact(-1) is None
        playback = Playback(index)
        for step in range(100):
            state = playback.state_at_time(index.duration * step / 100)[1]
            assert (state.contacts, state.contact_points) == (0, ())
            assert not state.touching
