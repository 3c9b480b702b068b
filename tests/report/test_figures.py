"""The figures of a report are those of the run, whatever its length."""

from __future__ import annotations

import functools
import gc
import json
import math
import re
import statistics
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.cli.log_reports import build_report
from simmer_tui.config.loader import find_set, load
from simmer_tui.document.formats import HISTOGRAM
from simmer_tui.report import recording, run_statistics
from simmer_tui.report.causes import Kind
from simmer_tui.report.content import report_tables
from simmer_tui.run import paths, run_history, table
from simmer_tui.run.events import Action, ActionName, Belief, MissionEvent, Result
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import BINS, Errors, First, Thinned
from simmer_tui.sim import Axes, DriveKind, Pose

MODERATE = st.floats(-1e6, 1e6).filter(lambda value: value == 0 or abs(value) > 1e-6)


@settings(max_examples=12)
@given(st.lists(MODERATE, min_size=2, max_size=60))
def test_mean_and_std_need_no_list(values: list[float]) -> None:
    errors = Errors()
    for begin in range(0, len(values), 7):
        errors.add(np.array(values[begin : begin + 7]))
    assert errors.count == sum(errors.bins) == len(values)
    assert errors.mean == pytest.approx(statistics.fmean(values), rel=1e-9, abs=1e-6)
    assert errors.std == pytest.approx(statistics.stdev(values), rel=1e-6, abs=1e-3)
    assert abs(errors.worst) == max(map(abs, values))
    assert errors.width == 0 or errors.reach > abs(errors.worst)


@settings(max_examples=12)
@given(st.lists(MODERATE, min_size=1, max_size=60))
def test_widened_bins_hold_what_fell_into_them(values: list[float]) -> None:
    errors = Errors()
    for begin in range(0, len(values), 7):
        errors.add(np.array(values[begin : begin + 7]))
    again = [0] * BINS
    for value in values:
        again[BINS // 2 + (math.floor(value / errors.width) if value else 0)] += 1
    assert errors.bins == again


def test_a_histogram_is_sixteen_characters_around_zero(start_run: Any) -> None:
    run = start_run()
    run.send(*("u1",) * 20)
    [table] = [each for each in report_tables(build_report(run.path)) if each.key == "sensor_errors"]
    [row] = table.objects()
    assert (row["sensor"], row["sensor_code"]) == ("ultra1", "u1")
    counts = row["histogram"]
    assert isinstance(counts, list)
    assert (len(counts), sum(counts)) == (16, 20)
    assert len(HISTOGRAM.text(counts)) == 16
    assert HISTOGRAM.text([0] * 8 + [3, 1] + [0] * 6) == " " * 8 + "█▃" + " " * 6


@given(st.integers(0, 500), st.integers(2, 40).map(lambda half: 2 * half))
def test_thinning_keeps_an_even_choice(count: int, limit: int) -> None:
    thinned: Thinned[int] = Thinned(limit)
    for begin in range(0, count, 9):
        items = range(begin, min(begin + 9, count))
        thinned.keep(items[place] for place in thinned.wanted(len(items)))
    assert thinned.items == list(range(0, count, thinned.stride))
    assert len(thinned.items) <= limit
    assert thinned.given == count
    assert thinned.stride == 1 or len(thinned.items) >= limit // 2


def test_the_first_are_kept_and_the_others_counted() -> None:
    first: First[int] = First(3)
    for item in range(5):
        first.add(item)
    assert (first.items, first.given, first.more) == ([0, 1, 2], 5, 2)


def test_the_sums_are_those_of_the_simulator(start_run: Any) -> None:
    run = start_run()
    run.send("u1", "d1-10", "zz", "r1-90", "d1-50", "r1--30", "a1-3", "d1-x")
    report = build_report(run.path)
    assert report.totals.commands == 8
    assert report.totals.distance == pytest.approx(run.simulator.distance)
    assert report.totals.contacts == run.simulator.contacts > 0
    assert report.history.elapsed == pytest.approx(run.simulator.time)
    assert report.pose == run.simulator.pose
    assert report.history.refusals.first.given == 2
    assert report.totals.codes["d1"].count == 3
    assert report.totals.codes["d1"].refused == 1
    assert report.totals.codes["other"].count == 1
    assert report.real_seconds == pytest.approx(run.simulator.time)


def test_time_by_cell_adds_up_to_the_whole(start_run: Any) -> None:
    run = start_run()
    run.send("d1-10", "r1-90", "d1-60", "d1-3", "r1-90", "d1-8")
    report = build_report(run.path)
    assert sum(report.paths.cells.values()) == pytest.approx(report.history.elapsed)
    assert (1, 1) in report.paths.cells
    assert all(1 <= row <= 4 and 1 <= column <= 8 for row, column in report.paths.cells)


def test_time_by_cell_of_a_velocity_adds_up_after_a_reset(start_run: Any) -> None:
    run = start_run()
    run.send("vv-6;0;0", "wt-2", "vv-0;0;0", "d1-3")
    run.perform(ActionName.RESET)
    run.send("vv-6;0;0", "wt-2", "vv-0;0;0", "d1-3")
    report = build_report(run.path)
    assert sum(report.paths.cells.values()) == pytest.approx(report.history.elapsed)


def test_errors_are_those_of_the_sensors(start_run: Any, configuration: Any) -> None:
    run = start_run()
    for _ in range(300):
        run.send("u1", "c1")
    report = build_report(run.path)
    [true] = {outcome.reading.true for outcome in run.outcomes if outcome.command.code == "u1"}
    errors = report.totals.sensors["ultra1"].errors
    assert errors.std == pytest.approx(0.02 * true, rel=0.15)
    assert abs(errors.mean) < 0.02 * true / 5
    assert report.totals.sensors["comp1"].errors.worst == 0.0  # a compass errs in proportion to the heading


def quiet(configuration: Any) -> dict[str, Any]:
    """Sensors that do not err, in the files as well: a log is read by these."""
    simulation = configuration.simulation
    header, *rows = configuration.files["sensors.csv"].splitlines()
    columns = [name.strip() for name in header.split(",")]
    error = next(place for place, name in enumerate(columns) if "Error" in name and "Percent" in name)
    written = [row.split(",") for row in rows if row.strip()]
    lines = [",".join((*row[:error], "0", *row[error + 1 :])) for row in written]
    return {
        "sensors": tuple(replace(sensor, error=0.0) for sensor in simulation.sensors),
        "files": {"sensors.csv": "\n".join((header, *lines, ""))},
    }


def test_counters_without_errors_have_none(start_run: Any, configuration: Any) -> None:
    run = start_run(**quiet(configuration))
    for text in ("d1-5", "r1-35", "w1-3", "a1-2", "r1--80", "s1-2", "d1-3"):
        run.send(text, "o1", "o2", "o3", "o4", "g1")
    assert run.simulator.contacts == 0
    report = build_report(run.path)
    for name in ("odom1", "odom2", "odom3", "odom4", "gyro1"):
        assert report.totals.sensors[name].errors.count == 7
        assert abs(report.totals.sensors[name].errors.worst) < 1e-9


def test_wheels_that_slip_show_as_an_error(start_run: Any, configuration: Any) -> None:
    run = start_run(**quiet(configuration))
    run.send("d1-60", "o3", "g1")
    report = build_report(run.path)
    slipped = run.outcomes[1].reply - run.simulator.distance
    assert slipped > 10
    assert report.totals.sensors["odom3"].errors.worst == pytest.approx(slipped, rel=0.2)
    assert abs(report.totals.sensors["gyro1"].errors.worst) < 1e-9


def test_counters_restart_with_the_run_and_ignore_teleports(start_run: Any, configuration: Any) -> None:
    run = start_run(**quiet(configuration))
    run.send("d1-5", "r1-30", "o3", "g1")
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 10.0)
    run.send("d1-2", "o3", "g1")
    run.perform(ActionName.RESET)
    run.send("o3", "d1-2", "o3", "g1")
    report = build_report(run.path)
    assert report.totals.sensors["odom3"].errors.count == 4
    assert abs(report.totals.sensors["odom3"].errors.worst) < 1e-9
    assert abs(report.totals.sensors["gyro1"].errors.worst) < 1e-9
    assert [jump.name for jump in report.paths.jumps.items] == ["teleport", "reset"]


def test_the_belief_is_held_against_the_truth(start_run: Any) -> None:
    run = start_run()
    for off in (3.0, 5.0, 10.0):
        run.send("d1-1")
        run.believe(off, 0.0, 350.0)
    report = build_report(run.path)
    assert report.totals.beliefs.mean == pytest.approx(6.0)
    assert report.totals.belief_turns.worst == pytest.approx(-10.0)


def test_one_report_has_one_word_for_being_lost(start_run: Any) -> None:
    """Its first line said that the program was lost, its last that its belief was never off."""
    mission = load(find_set("mission"))
    run = start_run(files=dict(mission.files))
    run.engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    run.send("u1", "u2", "u4", "d1-1")
    pose = run.simulator.pose
    run.engine.tell(Belief(run.simulator.time, Pose(pose.x - 4.0, pose.y, pose.heading), pose, 0.3))
    run.send("u1", "d1-36")
    run.engine.tell(MissionEvent(run.simulator.time, Result.FAILED, "mission: failed", "1 contact"))
    report = build_report(run.path)
    assert report.cause is not None
    assert report.cause.kind is Kind.LOST
    assert re.search(r"At 0\.\d s, it believed .*: it never found its place\.", report.verdict.text)


def test_the_last_of_many_contacts_is_the_first_thing_said(start_run: Any) -> None:
    run = start_run()
    run.send("u1", *("d1-60",) * 6)
    report = build_report(run.path)
    assert re.search(r": at [\d.]+ s, the robot touched the wall", report.verdict.text)
    assert report.verdict.text.endswith(", after 0.0 in of d1-60, the last of 6 contacts.")
    [repeated] = report.history.repeated.first.items
    assert repeated.count == 6


def test_a_solid_block_that_stops_the_robot_is_called_the_block(start_run: Any) -> None:
    run = start_run(block_solid=True)
    run.send("u1", *("d1-30",) * 6)
    report = build_report(run.path)
    assert "the robot touched the block at (23.5, 42.5)" in report.verdict.text
    assert report.verdict.text.endswith(", the last of 6 contacts.")


def test_a_velocity_pressed_against_a_wall_is_stuck(start_run: Any) -> None:
    mission = load(find_set("mission"))
    assert mission.mission is not None
    limit, shorter = mission.mission.time_limit, 50.0
    files = {
        name: text.replace("contacts = 0", "contacts = 20").replace(
            f"time_limit = {limit:g}", f"time_limit = {shorter:g}"
        )
        for name, text in mission.files.items()
    }
    free = start_run(files=files)
    free.engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    free.send("vv-6;0;0", f"wt-{shorter / 5:g}", "vv--6;0;0;1", "wt-1", "vv-6;0;0", f"wt-{shorter / 5:g}")
    free.engine.tell(MissionEvent(free.simulator.time, Result.FAILED, "mission: failed", "gave up"))
    backed_off = build_report(free.path)
    assert backed_off.cause is None or backed_off.cause.kind is not Kind.GOT_NOWHERE

    run = start_run("stuck.jsonl", files=files)
    run.engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: begun"))
    run.send("vv-6;0;0", f"wt-{shorter / 2:g}", "u1")
    run.engine.tell(MissionEvent(run.simulator.time, Result.FAILED, "mission: failed", "gave up"))
    report = build_report(run.path)
    assert report.cause is not None
    assert report.cause.kind is Kind.GOT_NOWHERE
    stuck = r"At \d\.\d s, it was stuck at \(45\.0, 44\.4\): it pressed against a wall for 19 s "
    assert re.search(stuck, report.cause.text)


def test_accepted_movements_count_as_far_as_they_went(packets_run: Any) -> None:
    run = packets_run
    run.send("d1-12")
    run.loop.run_until(run.loop.now + 1.0)
    run.send("u1")
    run.loop.run_until(run.loop.now + 3.5)
    run.send("w1-6")
    run.loop.run_until(run.loop.now + 0.5)
    run.engine.perform(Action(ActionName.STOP))
    run.send("d1-3")
    run.loop.run_until(run.loop.now + 10.0)
    report = build_report(run.path)
    assert report.totals.commands == 4
    assert report.totals.movements == 3
    assert report.totals.distance == pytest.approx(run.simulator.distance)
    assert report.pose == run.simulator.pose
    assert abs(report.totals.sensors["ultra1"].errors.worst) < 3


def test_a_contact_that_was_only_planned_is_none(packets_run: Any) -> None:
    run = packets_run
    run.send("d1-200")
    assert run.simulator.trajectory.contact is not None, "it would meet the wall"
    run.loop.run_until(run.loop.now + 0.33)
    run.stop()
    report = build_report(run.path)
    assert report.totals.contacts == 0
    assert {code: record.contacts for code, record in report.totals.codes.items()} == {"d1": 0, "stop": 0}
    [commands] = [table for table in report_tables(report) if table.title == "Commands"]
    assert [(row["code"], row["contacts"], row["refused"]) for row in commands.objects()] == [
        ("d1", 0, 0),
        ("stop", 0, 0),
    ]
    assert [row[3:] for row in commands.texts()] == [["", ""], ["", ""]]
    [record] = report_tables(report)[0].objects()
    assert record["contacts"] == 0


def test_contacts_in_a_row_are_over_when_a_movement_is_free(start_run: Any) -> None:
    run = start_run()
    run.send(*("d1-60",) * 3, "d1--5")
    report = build_report(run.path)
    assert (report.totals.contacts, report.history.blocked()[0]) == (3, 0)
    run.send("d1-60")
    report = build_report(run.path)
    assert report.history.blocked()[0] == 1


@pytest.mark.slow
def test_long_runs_take_bounded_memory(
    eventful_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ("SEGMENTS", "MOVEMENTS", "MOST_BELIEFS"):
        monkeypatch.setattr(paths, limit, 20)
    for limit in ("TRACE_POINTS", "KEPT_BELIEFS", "KEPT_OBJECTS", "KEPT_BLOCKS"):
        monkeypatch.setattr(run_history, limit, 5)
    monkeypatch.setattr(run_statistics, "RunHistory", functools.partial(RunHistory, kept=5))
    for limit in ("READINGS", "MARKS"):
        monkeypatch.setattr(recording, limit, 20)
    monkeypatch.setattr(table, "CHUNK", 16)
    monkeypatch.setattr(table, "LISTED", 5)
    monkeypatch.setattr(paths, "LISTED", 5)
    monkeypatch.setattr("simmer_tui.run.reducer.CONTACT_POINTS", 20)
    header, *lines = eventful_log.read_bytes().splitlines(keepends=True)
    peaks = []
    # The samples of devices, and what they work with, are full by then.
    for repeats in (160, 640):
        path = tmp_path / f"long{repeats}.jsonl"
        path.write_bytes(header + b"".join(lines) * repeats)
        build_report(path)  # what is imported on the way is not the run's
        # Else how much garbage waits for the collector depends on what other tests have left in this process.
        gc.collect()
        gc.freeze()
        tracemalloc.start()
        try:
            report = build_report(path)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
            gc.unfreeze()
        # A movement has a line when it begins too.
        logged = [line for line in lines if b'"cmd":' in line and b'"kind":"plan"' not in line]
        assert report.totals.commands == repeats * len(logged)
    assert peaks[1] < 1.3 * peaks[0]


@pytest.mark.slow
def test_only_a_few_long_lines_are_held_at_once(eventful_log: Path, tmp_path: Path) -> None:
    particles = json.dumps([[150] * 2000, [250] * 2000, [350] * 2000])
    belief = f'{{"t":0.0,"kind":"belief","believed":[9,42,0],"pose":[9,42,0],"particles":{particles}}}\n'
    header = eventful_log.read_bytes().splitlines(keepends=True)[0]
    peaks = []
    # More lines than the 256 KB that are held at once, so that only what grows with them shows.
    for lines in (20, 60):
        path = tmp_path / f"beliefs{lines}.jsonl"
        path.write_bytes(header + lines * belief.encode())
        if not peaks:
            build_report(path, recorded=False)  # what is imported on the way is not counted
        tracemalloc.start()
        try:
            report = build_report(path, recorded=False)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        assert report.totals.beliefs.count == lines
    assert peaks[1] < 1.2 * peaks[0]


def test_broken_lines_are_skipped_and_noted(eventful_log: Path) -> None:
    lines = eventful_log.read_bytes().splitlines(keepends=True)
    lines[5] = b"{]\n"
    eventful_log.write_bytes(b"".join(lines)[:-20])
    report = build_report(eventful_log)
    assert any(note.startswith("line 6 is broken") for note in report.notes)
    assert any("cut off" in note for note in report.notes)


def test_a_log_of_a_header_alone_makes_a_report(start_run: Callable[..., Any]) -> None:
    report = build_report(start_run().path)
    # The findings have a key in every answer, with or without rows.
    assert [table.title for table in report_tables(report) if table.rows] == ["Run"]


def test_a_contact_that_a_movement_went_on_from_is_counted_but_ends_nothing(start_run: Any) -> None:
    run = start_run(bot_center=(9.5, 44.9), block_center=(6.0, 30.0))
    run.simulator.set_bias({DriveKind.RIGHT: Axes(y=0.1)})
    run.send("d1-3", "d1-3", "d1-3")
    report = build_report(run.path)
    assert (report.totals.contacts, report.totals.contacts_that_ended, report.history.blocked()[0]) == (
        3,
        0,
        0,
    )
    assert report.pose == run.simulator.pose


@pytest.mark.slow
def test_contacts_of_continuous_motion_are_told_without_the_number_of_its_legs(start_run: Any) -> None:
    run = start_run()
    run.send("vv-3;0;9", "wt-30", "d1-1")
    report = build_report(run.path)
    assert report.totals.legs > 10
    assert report.totals.movements == 1
