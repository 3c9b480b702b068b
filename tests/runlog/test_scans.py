"""Scans of lidars in a run log: exact, small, read back from any line, and run again."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.errors import RunLogError
from simmer_tui.run.events import ActionName, CommandResult
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.logged_scans import packed_ranges, unpacked_ranges
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.sim import parse_command
from simmer_tui.sim.recent_motion import BlockPlace
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.sensors import Lidar, sensor_of
from tests.runlog.conftest import Run, StartRun


@pytest.fixture(scope="session")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Configuration:
    """The default set with a lidar, and one whose readings are not rounded."""
    folder = tmp_path_factory.mktemp("lidar") / "set"
    init_set(folder, bundled_folder())
    path = folder / "sensors.csv"
    head, *rows = path.read_text().splitlines()
    more = ("Rays", "Resolution")
    rows = [f"{row},," for row in rows]
    rows += ["lidar1,sc,1,1.5,-0.5,4,20,0.01,,,,", "lidar2,sd,1,0,0,4,0,0.01,,,24,0"]
    path.write_text("\n".join([",".join([head, *more]), *rows]))
    return load(folder)


def results(run: Run) -> list[CommandResult]:
    return [each for each in run.events if isinstance(each, CommandResult)]


def read(path: Path) -> list[CommandResult]:
    with LogReader(path) as reader:
        found = [each.event for each in reader if not isinstance(each, BrokenLine)]
    return [each for each in found if isinstance(each, CommandResult)]


def lines(run: Run) -> list[dict[str, Any]]:
    run.log.close()
    return [json.loads(line) for line in run.path.read_text().splitlines()]


def same(read: LidarScan | None, told: LidarScan | None) -> bool:
    """True if a scan of a log is that of the run, bit for bit; the log does not hold its truth."""
    if read is None or told is None:
        return read is told
    return (
        read.revolution == told.revolution
        and read.ranges.tobytes() == told.ranges.tobytes()
        and read.bearings.tobytes() == told.bearings.tobytes()
        and read.poses.tobytes() == told.poses.tobytes()
        and not len(read.true)
    )


def assert_same(path: Path, told: list[CommandResult]) -> None:
    found = read(path)
    assert len(found) == len(told)
    for one, other in zip(found, told, strict=True):
        assert one.reply == other.reply
        if other.reading is not None:
            assert one.reading is not None
            assert same(one.reading.scan, other.reading.scan), other


# -- the numbers ---------------------------------------------------------------------------------


@settings(max_examples=12)
@given(
    steps=st.lists(st.one_of(st.integers(0, 65534), st.none()), min_size=1, max_size=400),
    resolution=st.sampled_from([0.01, 0.1, 0.0254, 1.0, 0.04]),
)
def test_whole_steps_take_two_bytes_a_ray_and_read_back_exactly(
    steps: list[int | None], resolution: float
) -> None:
    ranges = np.array([math.inf if each is None else each * resolution for each in steps])
    text, floats = packed_ranges(ranges, resolution)
    assert not floats
    assert len(base64.b64decode(text)) == 2 * len(steps)
    assert unpacked_ranges(text, resolution, floats=floats).tobytes() == ranges.tobytes()


@settings(max_examples=15)
@given(
    ranges=st.lists(st.floats(), min_size=1, max_size=50),
    resolution=st.sampled_from([0.0, 0.01, 0.5]),
)
def test_any_numbers_read_back_exactly(ranges: list[float], resolution: float) -> None:
    told = np.array(ranges)
    text, floats = packed_ranges(told, resolution)
    assert unpacked_ranges(text, resolution, floats=floats).tobytes() == told.tobytes()


@pytest.mark.parametrize(
    ("text", "floats", "said"),
    [
        ("", False, "it has 0 ranges|has 0 ranges"),
        ("AAA", False, "cannot be read"),
        ("A*==", False, "cannot be read"),
        ("AAAA", False, "cannot be read"),
        ("AAA=", True, "cannot be read"),
        (base64.b64encode(bytes(8002)).decode(), False, "has 4001 ranges: it must be 1 to 4000"),
    ],
)
def test_a_scan_that_is_none_is_named(text: str, floats: bool, said: str) -> None:
    with pytest.raises(RunLogError, match=said):
        unpacked_ranges(text, 0.01, floats=floats)


# -- a run ------------------------------------------------------------------------------------------


def test_a_line_holds_the_scan_and_is_small(start_run: StartRun) -> None:
    run = start_run()
    run.send("d1-6", "sc", "sd", "sc-90")
    *_, whole, fine, one = lines(run)
    scans = [each.reading.scan for each in results(run) if each.reading is not None]
    assert whole["revolution"] == scans[0].revolution
    ticks = np.frombuffer(base64.b64decode(whole["scan"]), "<u2")
    assert np.array_equal(np.where(ticks == 65535, math.inf, ticks * 0.01), scans[0].ranges)
    assert "floats" not in whole
    assert fine["floats"]
    assert np.array_equal(np.frombuffer(base64.b64decode(fine["scan"]), "<f8"), scans[1].ranges)
    assert not {"scan", "revolution", "floats"} & set(one), "one ray is one number"
    sizes = {json.loads(line)["n"]: len(line) for line in run.path.read_bytes().splitlines()[1:]}
    assert sizes[2] <= 1100


def test_scans_read_back_as_they_were_however_the_robot_went(start_run: StartRun) -> None:
    run = start_run()
    # Instant motion: a scan that was read already waits for the next one.
    run.send("sc", "sc", "d1-6", "sc", "r1-60", "sc", "sd", "sc", "d1-60", "sc", "sc-90", "sc")
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.send("sc", "a1-3", "sc", "wt-0.05", "sc")
    run.send("vv-4;0;60", "wt-0.3", "sc", "sc", "wt-1", "sd", "vv-0;0;0", "sc", "sc")
    run.perform(ActionName.NOISE, 0.0)
    run.send("sc", "d1--2", "sc")
    run.perform(ActionName.RESET)
    run.send("sc", "r1-90", "sc", "sc")
    run.log.close()
    assert_same(run.path, results(run))


def test_scans_in_timed_motion_read_back_and_a_repeated_one_is_not_written_again(start_run: StartRun) -> None:
    run = start_run(timed=True)
    reader = run.engine.session(answer_at_end=False)
    run.send("r1-360")
    for _ in range(40):
        run.loop.run_until(run.loop.now + 0.06)
        reader.submit(parse_command("sc"), lambda outcome: None)
        reader.submit(parse_command("sc"), lambda outcome: None)
    run.loop.run_until(run.loop.now + 10)
    assert_same(run.path, results(run))
    found = [line for line in lines(run) if line.get("cmd") == "sc"]
    assert len(found) == 80
    assert sum("scan" in line for line in found) == len({line["revolution"] for line in found})


def test_a_scan_is_reachable_by_its_line_and_its_truth_can_be_worked_out(
    start_run: StartRun, configuration: Configuration
) -> None:
    run = start_run()
    for number in range(180):
        run.send("u1", "d1-2" if number % 2 else "d1--2", "r1-3", "sc")
    run.log.close()
    told = results(run)
    with RunLogIndex(run.path) as index:
        playback = Playback(index)
        wanted = [i for i in range(index.count) if getattr(index.record(i), "revolution", None) is not None]
        for entry in wanted[80::37]:
            [found] = playback.events(entry, entry + 1)
            assert not isinstance(found, BrokenLine)
            assert isinstance(found.event, CommandResult)
            [same_one] = [each for each in told if each.number == found.event.number and each.reading]
            reading, original = found.event.reading, same_one.reading
            assert reading is not None
            assert original is not None
            assert reading.scan is not None
            assert original.scan is not None
            assert reading.scan.ranges.tobytes() == original.scan.ranges.tobytes()
            state = playback.state_at(entry)
            assert state.sensors["sc"].reading.scan is not None
            lidar, lying = sensor_of(reading.sensor), BlockPlace(0.0, state.block)
            assert isinstance(lidar, Lidar)
            true = lidar.distances(run.simulator.maze, reading.scan.poses, [(slice(None), lying)])
            assert reading.scan.poses.tobytes() == original.scan.poses.tobytes()
            assert true.tobytes() == original.scan.true.tobytes()


def test_a_run_with_scans_repeats_exactly_and_a_changed_ray_is_named(
    start_run: StartRun, tmp_path: Path
) -> None:
    run = start_run()
    run.send("sc", "d1-6", "sc", "r1-60", "sc", "sd", "sc-45", "sc", "vv-4;0;60", "wt-0.3", "sc", "xx")
    run.perform(ActionName.RESET)
    run.send("d1-3", "sc", "sd", "sc")
    run.log.close()
    with Rerun(run.path) as again:
        assert list(again.steps())
        assert again.difference is None
    text = run.path.read_text().splitlines()
    place = next(i for i, line in enumerate(text) if '"scan"' in line)
    record = json.loads(text[place])
    ticks = np.frombuffer(base64.b64decode(record["scan"]), "<u2").copy()
    ticks[7] += 1
    record["scan"] = base64.b64encode(ticks.tobytes()).decode()
    text[place] = json.dumps(record)
    changed = tmp_path / "changed.jsonl"
    changed.write_text("\n".join(text) + "\n")
    with Rerun(changed) as again:
        list(again.steps())
        assert again.difference is not None
        assert (again.difference.line, again.difference.name) == (place + 1, "ray 7")


def test_a_log_that_begins_amid_a_run_repeats_from_its_reset_on(start_run: StartRun) -> None:
    run = start_run()
    run.send("sc", "d1-4", "sc")
    run.perform(ActionName.RESET)
    run.send("sc", "d1-3", "sc", "sc")
    run.log.close()
    head, *rest = run.path.read_text().splitlines()
    header = json.loads(head)
    header["number"] = 1
    run.path.write_text("\n".join([json.dumps(header), *rest[1:]]) + "\n")
    with Rerun(run.path) as again:
        list(again.steps())
        assert again.difference is None
        assert again.commands == 4


def test_a_log_without_the_scan_that_a_line_refers_to_says_so(start_run: StartRun) -> None:
    run = start_run(timed=True)
    run.send("sc", "sc")
    first, *_ = (line for line in lines(run) if line.get("scan"))
    text = [line for line in run.path.read_text().splitlines() if first["scan"] not in line]
    run.path.write_text("\n".join(text) + "\n")
    with LogReader(run.path) as reader:
        broken = [each for each in reader if isinstance(each, BrokenLine)]
    assert [str(each) for each in broken] == [
        f"line 2 is broken: the scan of revolution {first['revolution']} is not before it"
    ]


@pytest.mark.slow
def test_an_hour_of_scans_is_small_replayed_and_repeats_exactly(start_run: StartRun) -> None:
    run = start_run()
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 0.0)
    number = 0
    while run.simulator.time < 3600.0:
        # A robot that turns and drives up and down: nothing about its scans repeats.
        number += 1
        run.send("sc", *(["d1-1" if number % 400 else "d1--1", "r1-7"] if number % 200 == 0 else []))
        run.events.clear()
    run.log.close()
    sizes = [len(line) for line in run.path.read_bytes().splitlines(keepends=True) if b'"scan"' in line]
    assert len(sizes) > 5.4 * 3600
    assert max(sizes) <= 1100
    assert run.path.stat().st_size <= 22e6
    with RunLogIndex(run.path) as index:
        playback = Playback(index)
        for elapsed in np.linspace(0.0, index.duration, 40).tolist():
            state = playback.state_at(playback.index.find_time(elapsed), elapsed)
            assert elapsed < 1.0 or state.sensors["sc"].reading.scan is not None
    with LogReader(run.path) as reader:
        assert sum(not isinstance(each, BrokenLine) for each in reader) > len(sizes)
    with Rerun(run.path) as again:
        for _ in again.steps():
            pass
        assert again.difference is None
        assert again.commands > len(sizes)
