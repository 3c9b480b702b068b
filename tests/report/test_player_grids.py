"""Grids in the player of a page: the map over time, its numbers, and what a log has left out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simmer_tui.cli.log_reports import build_report
from simmer_tui.report.page import report_page
from simmer_tui.run.belief_grid import Probabilities, grid_belief, small_map
from simmer_tui.run.events import Belief
from simmer_tui.sim import Pose
from simmer_tui.sim.specs import MazeSpec
from tests.report.browser import slid
from tests.report.test_player import recorded

WHOLE = (0.0, 0.0, 96.0, 48.0)


def believe(run: Any, table: Probabilities) -> None:
    pose = run.simulator.pose
    grid = grid_belief(table, WHOLE, 0.0, pose)
    run.engine.tell(Belief(run.simulator.time, grid.best_pose, pose, grid.spread, grid=grid))


def one(shape: tuple[int, int, int], row: int, column: int) -> Probabilities:
    table = np.zeros(shape)
    table[row, column, 0] = 1.0
    return table


def played(run: Any) -> Any:
    """A small grid, three large ones of which the log has the cells of the first, and again of the last."""
    believe(run, one((4, 8, 1), 0, 1))
    run.send("d1-1")
    for column in (0, 1, 47):
        believe(run, one((24, 48, 4), 23, column))
    run.send("d1-1")
    return recorded(report_page(build_report(run.path), "run"))


def test_the_page_has_each_grid_with_its_map_and_numbers(start_run: Any) -> None:
    first, *rest = [row[9] for row in played(start_run())["beliefs"]]
    assert first == [0, 0, 96, 48, 0, 100, 0, 0, 4, 8, "ada30"]
    assert [row[4] for row in rest] == [1, 1, 1]
    # The second large one is without cells in the log; the third has been told again before the movement.
    assert [row[10] if len(row) > 8 else None for row in rest] == ["a1104da47", None, "a1151d"]


def test_a_page_without_grids_has_none(start_run: Any) -> None:
    run = start_run()
    run.believe(1.0)
    [row] = recorded(report_page(build_report(run.path), "run"))["beliefs"]
    assert len(row) == 9


def test_a_fine_grid_has_a_map_of_24_by_48() -> None:
    table = np.full((100, 150, 4), 1e-9)
    table[:50, :75] = 1.0
    made = small_map(grid_belief(table, WHOLE, 0.0, Pose(1.0, 1.0, 0.0)), MazeSpec(((1,) * 8,) * 4))
    assert (made.rows, made.columns) == (24, 48)
    lengths = [int(count or 1) for count in re.findall(r"[a-d](\d*)", made.runs)]
    assert sum(lengths) == 24 * 48
    # The upper left quarter.
    names = re.findall("[a-d]", made.runs)
    assert sum(n for n, name in zip(lengths, names, strict=True) if name != "a") == 288


@pytest.mark.slow
def test_a_browser_shows_the_map_of_the_moment(start_run: Any, tmp_path: Path) -> None:
    run = start_run()
    data = played(run)
    times = [row[0] / 1000 for row in data["beliefs"]]
    text = report_page(build_report(run.path), "run")
    each = """[document.querySelector(".heat-d").getAttribute("d"),
      document.querySelector(".believed").classList.contains("headless"),
      document.querySelector(".words").textContent]"""
    seen, _ = slid(text, tmp_path, [times[0], times[-1]], each)
    (small, headless, words), (large, headless_too, _) = seen
    assert (small, headless) == ("M12 48h12v-12h-12z", True)
    assert (large, headless_too) == ("M94 2h2v-2h-2z", False)
    assert "best cell 100 %, true cell 0 %, entropy 0.0 bit" in words
