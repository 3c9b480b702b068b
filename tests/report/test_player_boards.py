"""Boards over time, from a log: the replay's panel, and the player of a page, have what they showed then."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from simmer_tui.cli.log_reports import build_report
from simmer_tui.document.model import Code
from simmer_tui.report.content import try_again
from simmer_tui.report.page import report_page
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.events import Action, ActionName, DisplayChanged
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.writer import CHECKPOINT_EVERY
from simmer_tui.sketch.board_view import BoardView
from simmer_tui.tui.recorded import RecordedRun
from tests.report.browser import slid
from tests.report.test_player import recorded

EMPTY, FULL = (("    ",),), (("1 in", "\x1b[2J" + 100 * "x", *5 * ("row",)),)


def shown(run: Any, board: str = "rover", **fields: Any) -> None:
    run.engine.tell(DisplayChanged(run.simulator.time, board, **fields))


def views(path: Path, *times: float) -> list[list[tuple[float, str, bool, tuple[tuple[str, ...], ...]]]]:
    async def all_views() -> list[tuple[BoardView, ...]]:
        run = RecordedRun(RunLogIndex(path))
        found = []
        for time in times:
            run.move_to(time)
            found.append((await run.snapshot(0, False)).boards)
        run.index.close()
        return found

    return [
        [(round(each.time, 3), each.name, each.led, each.displays) for each in boards]
        for boards in asyncio.run(all_views())
    ]


def test_a_replay_shows_the_boards_of_the_moment_forwards_and_back(start_run: Any) -> None:
    run = start_run()
    shown(run)
    shown(run, "arm", led_pin="2")
    run.send("d1-5")
    half = run.simulator.time
    shown(run, led=True, displays=EMPTY)
    # Farther from the last change than a replay reads back.
    for _ in range(CHECKPOINT_EVERY):
        run.send("u1")
    run.send("d1-1")
    end = run.simulator.time
    last, first, between = views(run.path, end, half / 2, (half + end) / 2)
    assert last == [(round(end, 3), "arm", False, ()), (round(end, 3), "rover", True, EMPTY)]
    assert [each[1:] for each in first] == [("arm", False, ()), ("rover", False, ())]
    assert [each[1:] for each in between] == [each[1:] for each in last]
    # The clock is that of the moment, whatever has happened then.
    ((arm, _),) = views(run.path, half)
    assert arm[0] == round(half, 3)


def test_a_restart_forgets_what_boards_showed(start_run: Any) -> None:
    run = start_run()
    shown(run, led=True)
    run.send("d1-1")
    run.engine.perform(Action(ActionName.RESET, source="keys"))
    run.send("u1")
    with RunLogIndex(run.path) as index:
        duration = index.duration
    assert views(run.path, duration) == [[]]


def test_texts_of_a_log_are_cut_to_a_display(start_run: Any) -> None:
    run = start_run()
    shown(run, displays=FULL)
    ((board,),) = views(run.path, 0.0)
    (rows,) = board[3]
    assert len(rows) == 4
    assert all(len(row) <= 44 for row in rows)
    assert "\x1b" not in "".join(rows)


def test_the_page_has_what_boards_showed_with_the_times(start_run: Any) -> None:
    run = start_run()
    shown(run)
    run.send("d1-5")
    shown(run, led=True, displays=EMPTY)
    rows = recorded(report_page(build_report(run.path), "run"))["displays"]
    assert rows == [
        [0, "rover", "13", 0, []],
        [round(1000 * run.simulator.time), "rover", "13", 1, [["    "]]],
    ]


@pytest.mark.slow
def test_a_browser_shows_the_boards_of_the_moment(start_run: Any, tmp_path: Path) -> None:
    run = start_run()
    shown(run)
    run.send("d1-5")
    shown(run, led=True, displays=((" <b>one", "two"),))
    run.send("d1-5")
    text = report_page(build_report(run.path), "run")
    each = """[document.querySelector(".boards").textContent,
      [...document.querySelectorAll(".boards pre")].map((each) => each.textContent)]"""
    (first, last, again), _ = slid(text, tmp_path, [0.1, run.simulator.time, 0.1], each)
    assert first == again == ["rover  ·  LED 13 off", []]
    assert last == ["rover  ·  LED 13 on <b>one\ntwo", [" <b>one\ntwo"]]


@pytest.mark.parametrize(
    ("sketches", "program", "command"),
    [
        ({}, True, "simmer-tui why run.jsonl"),
        ({}, False, ""),
        ({"rover": "rover.ino 12"}, True, "simmer-tui trials --sketch DIR --run CMD --why"),
        ({"rover": "rover.ino 12"}, False, "simmer-tui trials --sketch DIR --why"),
    ],
)
def test_a_failed_run_of_boards_is_explained_by_trials(
    sketches: dict[str, str], program: bool, command: str
) -> None:
    header = SimpleNamespace(sketches=sketches, can_run_again=program, run="CMD" if program else None)
    told = try_again(cast(RunStatistics, SimpleNamespace(failed=True, header=header)), "run.jsonl")
    words = [each.words if isinstance(each, Code) else str(each) for each in told.text]
    assert "".join(words).endswith(command)
    assert bool(told.text) == bool(command)
