"""Scans in the player of a page: small, as bent as they were, and gone when the robot is put elsewhere."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simmer_tui.cli.export_command import run_export
from simmer_tui.cli.log_reports import build_report
from simmer_tui.config import load_default
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.report.page import report_page
from simmer_tui.report.player import SCAN_RAYS, thinned
from simmer_tui.report.recording import Recording
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName
from simmer_tui.run.scan_traces import ScanTrace, range_step, ray_ends, ray_times, scan_trace
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Pose, Simulator, parse_command
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.records import CommandResult, LidarScan, Reading
from simmer_tui.sim.scan_rays import rays_of
from simmer_tui.sim.sensors import Lidar, LidarSpec
from tests.report.browser import slid
from tests.report.test_player import recorded

MAZE = load_default().simulation.maze
SPEC = LidarSpec(kind=Lidar, number=1, code="sc")

Written = Callable[..., tuple[Path, list[CommandResult]]]


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Configuration:
    """The default set with a lidar beside the robot's middle."""
    folder = tmp_path_factory.mktemp("lidar") / "set"
    init_set(folder, bundled_folder())
    with (folder / "sensors.csv").open("a", encoding="utf-8") as file:
        file.write("lidar1,sc,1,1.5,-0.5,4,20,0.01,,\n")
    return load(folder)


@pytest.fixture
def written(configuration: Configuration, tmp_path: Path) -> Written:
    """Writes the log of a run, and returns its path and its results."""

    def run(*commands: str, name: str = "run") -> tuple[Path, list[CommandResult]]:
        simulator = Simulator(configuration.simulation, 5)
        engine = Engine(simulator)
        results: list[CommandResult] = []
        with RunLog(tmp_path / f"{name}.jsonl", configuration, simulator) as log:
            engine.watch(log)
            session = engine.session()
            for command in commands:
                session.submit(parse_command(command), results.append)
        return tmp_path / f"{name}.jsonl", results

    return run


def scans_of(results: list[CommandResult]) -> list[tuple[CommandResult, LidarScan]]:
    return [(each, each.reading.scan) for each in results if each.reading is not None and each.reading.scan]


def made(recording: Recording, trace: ScanTrace, sensor: Any) -> FloatArray:
    poses = [recording.pose_at(time) for time in ray_times(trace)]
    return np.array(ray_ends(trace, sensor, range_step(recording.spec.maze), poses))


def test_the_dots_of_a_page_are_where_the_beams_ended(written: Written) -> None:
    """Also of a scan in which the robot turned: each ray has the pose of its moment."""
    path, results = written("sc", "r1-90", "sc", "d1-9", "vv-3;0;60", "wt-0.5", "sc", "wt-0.3", "sc")
    recording = build_report(path).recording
    given = scans_of(results)
    assert [trace.elapsed for trace in recording.scans.items] == [each.time for each, _ in given]
    for trace, (result, scan) in zip(recording.scans.items, given, strict=True):
        assert result.reading is not None
        exact = rays_of(scan, result.reading.sensor, result.pose).ends
        # Half a step of the range, and keyframes to 0.1 deg and 0.01 in.
        assert np.abs(made(recording, trace, result.reading.sensor) - exact).max() < 0.25


def test_a_scan_that_is_read_again_is_there_once_and_a_reset_ends_it(written: Written) -> None:
    path, results = written("sc", "vv-3;0;0", "wt-0.3", "sc", "sc-90", "wt-0.01")
    assert len(build_report(path).recording.scans.items) == len(scans_of(results)) == 2
    recording = build_report(path).recording
    assert set(recording.scan_at(1e9)) == {"sc"}
    assert recording.scan_at(-1.0) == {}


@pytest.mark.parametrize(
    ("revolution", "poses", "begin", "span"),
    [
        # The revolution before the run: the robot stood there.
        (-1, 2, 50.0, 0.0),
        # A real robot's rays: nobody knows when each was sent.
        (9, 0, 52.9, 0.0),
        (9, 2, 50 + 9 / 5.5, 1 / 5.5),
    ],
)
def test_the_times_of_its_rays(revolution: int, poses: int, begin: float, span: float) -> None:
    sent_from: FloatArray = np.zeros((poses, 3))
    ranges: FloatArray = np.array([1.0, 2.0])
    bearings: FloatArray = np.array([0.0, -180.0])
    scan = LidarScan(revolution, ranges, bearings, np.empty(0), sent_from)
    trace = scan_trace(50.0, 53.0, 52.9, Reading(SPEC, 1.0, 1.0, scan=scan), scan, MAZE)
    assert (trace.begin, trace.span) == pytest.approx((begin, span))
    assert ray_times(trace) == pytest.approx([trace.begin, trace.begin + trace.span / 2])
    ends = ray_ends(trace, SPEC, range_step(MAZE), [Pose(10.0, 10.0, 90.0)] * 2)
    assert ends == [pytest.approx((10.0, 11.0)), pytest.approx((10.0, 8.0))]


def test_a_ray_without_an_echo_has_no_place_and_a_long_one_is_outside() -> None:
    scan = LidarScan(
        9, np.array([math.inf, 0.0, 5000.0]), -120.0 * np.arange(3.0), np.empty(0), np.empty((0, 3))
    )
    trace = scan_trace(0.0, 2.0, 2.0, Reading(SPEC, 1.0, 1.0, scan=scan), scan, MAZE)
    (end,) = ray_ends(trace, SPEC, range_step(MAZE), [Pose(48.0, 24.0, 0.0)] * 3)
    assert math.dist(end, (48.0, 24.0)) > math.hypot(MAZE.width, MAZE.height)


def test_many_rays_are_thinned_evenly() -> None:
    count = 1450
    bearings = np.arange(count) * -360.0 / count
    scan = LidarScan(9, np.full(count, 6.0), bearings, np.empty(0), np.zeros((count, 3)))
    trace = scan_trace(0.0, 2.0, 2.0, Reading(SPEC, 6.0, 6.0, scan=scan), scan, MAZE)
    assert trace.rays == 484
    assert trace.turn == pytest.approx(-3 * 360.0 / count)
    assert ray_times(trace)[1] - trace.begin == pytest.approx(3 / count / 5.5)


def test_a_page_has_one_scan_in_so_many_of_a_long_run_and_the_newest() -> None:
    scans = [ScanTrace(float(each), "sc", ranges="AB" * 360) for each in range(5000)]
    kept = thinned(scans)
    assert sum(each.rays for each in kept) <= SCAN_RAYS
    assert kept[-1] is scans[-1]
    assert {b.elapsed - a.elapsed for a, b in pairwise(kept)} == {3.0}
    assert thinned(scans[:1650]) == scans[:1650]
    assert thinned([]) == []


def test_five_minutes_of_scans_are_less_than_two_megabytes(written: Written) -> None:
    path, _ = written("sc")
    row = recorded(report_page(build_report(path), "run"))["scans"][0]
    assert len(json.dumps(row, separators=(",", ":"))) * 5.5 * 300 < 1.3e6


def test_the_moving_picture_has_the_dots(written: Written, tmp_path: Path) -> None:
    from PIL import Image

    colours = []
    for name, commands in (("with", ("d1-4", "sc", "d1-4")), ("without", ("d1-4", "d1-4"))):
        log, _ = written(*commands, name=name)
        output = tmp_path / f"{name}.gif"
        assert run_export([str(log), "--gif", str(output), "--width", "300", "--speed", "4"]) == 0
        with Image.open(output) as image:
            image.seek(getattr(image, "n_frames", 1) - 1)
            pixels = np.asarray(image.convert("RGB")).astype(int)
        colours.append(int((np.abs(pixels - (0x55, 0x41, 0x00)).max(axis=-1) < 40).sum()))
    assert colours[0] > colours[1] + 50


@pytest.mark.slow
def test_a_browser_shows_the_scan_of_the_moment(written: Written, tmp_path: Path) -> None:
    path, results = written("d1-4", "sc", "r1-60", "sc", "d1-3")
    report = build_report(path)
    times = [each.time for each, _ in scans_of(results)]
    moments = [times[0] - 0.05, times[0] + 0.01, times[1] + 0.01]
    each = '[...document.querySelectorAll(".scans")].map((path) => path.getAttribute("d"))'
    (before, *shown), _ = slid(report_page(report, "run"), tmp_path, moments, each)
    assert not any(before)
    for (rim, dots), trace in zip(shown, report.recording.scans.items, strict=True):
        assert rim == dots
        places = np.array([tuple(map(float, each)) for each in re.findall(r"M(\S+) (\S+)h0", dots)])
        sensor = next(each for each in report.recording.spec.sensors if each.code == "sc")
        assert np.abs(places - made(report.recording, trace, sensor)).max() < 0.25


def test_a_teleport_ends_what_was_seen(configuration: Configuration, tmp_path: Path) -> None:
    simulator = Simulator(configuration.simulation, 5)
    engine = Engine(simulator)
    with RunLog(tmp_path / "run.jsonl", configuration, simulator) as log:
        engine.watch(log)
        engine.session().submit(parse_command("sc"), lambda _: None)
        engine.perform(Action(ActionName.TELEPORT, (30.0, 42.0, 0.0)))
        engine.session().submit(parse_command("d1-3"), lambda _: None)
    recording = build_report(tmp_path / "run.jsonl").recording
    assert [trace.rays for trace in recording.scans.items] == [360, 0]
    assert recording.scan_at(recording.end)["sc"].rays == 0
    assert ray_ends(recording.scan_at(recording.end)["sc"], SPEC, 0.05, []) == []
