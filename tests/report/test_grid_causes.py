"""Grids that are wrong, in causes and in the report's table."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.cli.log_reports import build_report
from simmer_tui.report.causes import Kind
from simmer_tui.report.content import report_tables
from simmer_tui.run.belief_grid import grid_belief
from simmer_tui.run.events import Belief
from tests.report.test_causes import begin

READ = ("u1", "u2", "u4", "u3")


def believe(run: Any, row: int, column: int, heading: int | None = None, share: float = 0.999) -> None:
    """A grid that is sure of one cell of the maze (counted from 0), and of a heading if there is one."""
    table = np.full((4, 8, 1 if heading is None else 4), 1.0)
    rest = (1.0 - share) / (table.size - 1)
    table *= rest
    table[row, column, heading or 0] = share
    pose = run.simulator.pose
    grid = grid_belief(table, (0.0, 0.0, 96.0, 48.0), 0.0, pose)
    run.engine.tell(Belief(run.simulator.time, grid.best_pose, pose, grid.spread, grid=grid))


def test_the_cause_says_since_when_a_grid_gave_the_true_cell_nearly_nothing() -> None:
    mission = begin()
    mission.give(*READ)
    believe(mission, 0, 2, 0)  # where it is
    mission.give("u1")
    believe(mission, 3, 5, 0)
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert re.match(r"At 50\.\d s, its belief gave the true cell 0 %: it was lost from then on\.", cause.text)
    assert mission.history.beliefs[-1].elapsed == cause.elapsed


def test_a_flat_grid_is_unsure() -> None:
    mission = begin()
    mission.give(*READ)
    believe(mission, 0, 2, share=1 / 32)
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert ": it was not sure of its place." in cause.text
    assert not any(" deg; its spread" in each for each in cause.evidence)


def belief_rows(path: Path) -> dict[str, tuple[Any, ...]]:
    [table] = [each for each in report_tables(build_report(path)) if each.key == "belief"]
    return {row[0]: row[1:] for row in table.rows}


def test_the_report_has_probability_at_the_truth_and_entropy(start_run: Any) -> None:
    run = start_run()
    believe(run, 0, 0, 0, share=0.75)
    believe(run, 0, 0, 0, share=0.25)
    rows = belief_rows(run.path)
    unit, mean, _, worst, end = rows["probability at the truth"]
    assert (unit, round(mean, 4), round(worst, 4), round(end, 4)) == ("%", 50.0, 25.0, 25.0)
    assert rows["entropy"][0] == "bit"
    assert rows["entropy"][-1] > rows["entropy"][1]


def test_without_grids_the_table_is_as_it_was(start_run: Any) -> None:
    run = start_run()
    run.believe(1.0)
    assert belief_rows(run.path).keys() == {"position", "heading"}


def test_the_report_gives_no_heading_where_none_was_sent(start_run: Any) -> None:
    run = start_run()
    run.send("d1-3", "r1-20")
    believe(run, 0, 2)
    assert "heading" not in belief_rows(run.path)
    assert re.search(r": at 0\.7 s, it believed .*, [\d.]+ in off: ", build_report(run.path).verdict.text)


def test_the_error_of_the_heading_is_that_of_beliefs_with_one(start_run: Any) -> None:
    run = start_run()
    run.send("r1-20")
    pose = run.simulator.pose
    run.engine.tell(Belief(0.0, replace(pose, heading=pose.heading + 6.0), pose))
    believe(run, 0, 2)
    unit, mean, std, worst, end = belief_rows(run.path)["heading"]
    assert (unit, mean, std, worst, end) == ("deg", pytest.approx(6.0), None, pytest.approx(6.0), None)
