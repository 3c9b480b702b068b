"""Grids in a run log: small ones whole, of large ones some cells and all numbers; and their replay."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from simmer_tui.run.belief_grid import GridBelief, grid_belief
from simmer_tui.run.events import ActionName, Belief, Event
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.log_records import BrokenLine, decode_line
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import LogReader
from tests.runlog.conftest import Run, StartRun
from tests.runlog.test_rerun import rerun

SMALL, LARGE = (4, 8, 1), (24, 48, 4)


def believe(run: Run, number: int, shape: tuple[int, int, int] = LARGE) -> GridBelief:
    """Tell a grid whose best state is of this number."""
    table = np.full(shape, 0.1)
    table.flat[number] = 3.0
    pose = run.simulator.pose
    grid = grid_belief(table, (0.0, 0.0, 96.0, 48.0), 0.0, pose)
    run.engine.tell(Belief(run.engine.now(), grid.best_pose, pose, grid.spread, grid=grid))
    return grid


def events_of(reader: LogReader) -> list[Event]:
    return [each.event for each in reader if not isinstance(each, BrokenLine)]


def logged(run: Run) -> list[dict[str, Any]]:
    run.log.close()
    return [json.loads(line) for line in run.path.read_text().splitlines()]


def kinds(run: Run) -> list[str]:
    """Kinds of the lines after the header; of beliefs, if they have cells and if they are told again."""
    found = []
    for line in logged(run)[1:]:
        grid = line.get("grid")
        name = line["kind"] if grid is None else ("cells" if "log8" in grid else "numbers")
        found.append(f"{name} again" if line.get("again") else name)
    return found


def test_small_grids_are_logged_whole_and_read_back_as_they_were(start_run: StartRun) -> None:
    run = start_run()
    told = [believe(run, number, SMALL) for number in range(5)]
    run.send("d1-1")
    assert kinds(run) == [*["cells"] * 5, "plan", "end"]
    with LogReader(run.path) as reader:
        read = [each for each in events_of(reader) if isinstance(each, Belief)]
    assert [each.grid for each in read] == told
    assert read == [each for each in run.events if isinstance(each, Belief)]


def test_of_large_grids_two_a_second_keep_their_cells(start_run: StartRun) -> None:
    run = start_run(timed=True)
    run.send("d1-20")
    for number in range(21):
        run.loop.run_until(run.loop.now + 0.1)
        believe(run, number)
    found = kinds(run)
    # The movement has no belief before it; the last one keeps its cells when the log is closed.
    assert found.count("numbers") == 16
    assert found.count("cells") == 5
    assert found[-1] in ("cells", "cells again")


def test_the_last_large_grid_before_a_movement_and_the_end_keeps_its_cells(start_run: StartRun) -> None:
    run = start_run()
    for number in range(4):
        believe(run, number)
    run.send("u1", "d1-1")
    believe(run, 7)
    believe(run, 8)
    first, *_ = lines = [line for line in logged(run) if line["kind"] == "belief"]
    assert "log8" in first["grid"]
    again = [line for line in lines if line.get("again")]
    assert [line["grid"]["best"] for line in again] == [[0, 0, 3], [0, 2, 0]]
    assert all("log8" in line["grid"] for line in again)
    assert kinds(run)[4:8] == ["read", "cells again", "plan", "end"]


def test_what_was_left_out_is_left_out_of_no_number(start_run: StartRun) -> None:
    """A history from a log is the live one, whatever cells the log has left out."""
    run = start_run()
    for number in range(6):
        believe(run, number)
        run.send("u1")
    run.send("d1-3")
    run.log.close()
    with LogReader(run.path) as reader:
        events = events_of(reader)
    live = [each.grid for each in run.events if isinstance(each, Belief)]
    read = [each.grid for each in events if isinstance(each, Belief) and not each.again]
    assert len(read) == len(live) == 6
    for one, other in zip(read, live, strict=True):
        assert one is not None
        assert other is not None
        assert (one.best, one.entropy, one.spread, one.true_probability, one.above) == (
            other.best, other.entropy, other.spread, other.true_probability, other.above,
        )  # fmt: skip


def test_a_replay_shows_the_newest_cells_that_the_log_has(start_run: StartRun) -> None:
    run = start_run()
    told = [believe(run, number) for number in range(4)]
    run.send("u1", "d1-1", "u1")
    run.log.close()
    with RunLogIndex(run.path) as index:
        playback = Playback(index)
        for entry in range(index.count):
            belief = playback.state_at(entry, index.time_of(entry)).belief
            assert belief is not None
            assert belief.grid is not None
            assert belief.grid.best == told[min(entry, 3)].best
            assert belief.grid.cells == (told[0] if entry < 5 else told[3]).cells
        # From far away too.
        other = Playback(index).state_at(2, index.time_of(2)).belief
        assert other is not None
        assert other.grid is not None
        assert (other.grid.best, other.grid.cells) == (told[2].best, told[0].cells)


def beliefs(run: Run) -> list[dict[str, Any]]:
    """The lines of beliefs, without their real time."""
    return [line | {"real": 0.0} for line in logged(run) if line["kind"] == "belief"]


def test_a_log_made_of_a_log_is_the_same(start_run: StartRun) -> None:
    """A run that is taken over begins with the events of its log."""
    run = start_run()
    for number in range(4):
        believe(run, number)
    run.send("u1", "d1-1", "u1")
    believe(run, 9)
    first = beliefs(run)
    with LogReader(run.path) as reader:
        events = events_of(reader)
    other = start_run()
    for event in events:
        other.log(event)
    assert beliefs(other) == first
    assert [line.get("again", False) for line in first] == [False] * 4 + [True, False, True]


def test_a_run_with_grids_runs_again_exactly(start_run: StartRun) -> None:
    run = start_run()
    for number in range(3):
        believe(run, number)
        run.send("u1", "d1-2")
    run.perform(ActionName.RESET)
    believe(run, 9)
    run.send("u1")
    run.log.close()
    again = rerun(run.path)
    assert (again.difference, again.notes) == (None, [])


@pytest.mark.parametrize(
    "change",
    [
        {"rows": 0},
        {"rows": 300, "cols": 300},
        {"bounds": [0, 0, 0, 1]},
        {"best": [4, 0, 0]},
        {"log8": "AAAA"},
        {"log8": "?"},
        {"p_true": 1.5},
        {"entropy": -1},
    ],
)
def test_a_damaged_grid_is_a_broken_line(start_run: StartRun, change: dict[str, Any]) -> None:
    run = start_run()
    believe(run, 3, SMALL)
    line = logged(run)[1]
    assert not isinstance(decode_line(json.dumps(line).encode(), 2), BrokenLine)
    line["grid"] |= change
    assert isinstance(decode_line(json.dumps(line).encode(), 2), BrokenLine)
