"""The report says how far scans were bent by motion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.report.bent_scans import scans_table
from simmer_tui.report.content import report_document
from simmer_tui.report.run_statistics import report_of
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command


def scans(tmp_path: Path, commands: Sequence[str]) -> dict[str, Any]:
    """The row of the report about the lidar, after some commands."""
    configuration = load(find_set("lidar"))
    simulator = Simulator(configuration.simulation, 7)
    engine = Engine(simulator)
    path = tmp_path / "run.jsonl"
    with RunLog(path, configuration, simulator) as log:
        engine.watch(log)
        for text in commands:
            engine.session().submit(parse_command(text), lambda outcome: None)
    with LogReader(path) as read:
        run = report_of(read)
    table = scans_table(run.bent)
    assert table.rows
    assert any(
        part.title == table.title for part in report_document(run, "a").parts if hasattr(part, "title")
    )
    return dict(zip((column.key for column in table.columns), table.rows[0], strict=True))


def test_a_robot_that_stands_bends_nothing(tmp_path: Path) -> None:
    row = scans(tmp_path, ["wt-1.3", "sc", "sc", "sc-90"])
    assert row == {
        "sensor": "sc lidar1",
        "scans": 2,
        "moved": 0,
        **dict.fromkeys(("rays_off", "rms_in", "worst_in")),
    }


def test_a_robot_that_turns_by_23_degrees_a_scan_has_many_of_its_rays_off(tmp_path: Path) -> None:
    row = scans(tmp_path, ["vv-0;0;126.5", "wt-1", "sc", *["sc"] * 9, "vv-0;0;0"])
    assert row["scans"] == row["moved"] == 10
    # In mid-maze it is a third, in the corner where this robot starts half.
    assert 0.3 < row["rays_off"] < 0.6
    assert row["rms_in"] > 3.0


def test_between_movements_a_scan_is_bent_by_what_came_last(tmp_path: Path) -> None:
    row = scans(tmp_path, ["wt-1", "sc", "r1-30", "sc", "wt-1", "sc"])
    assert (row["scans"], row["moved"]) == (3, 1)
    assert row["rays_off"] > 0.1
