"""The player within the page of a report: what it holds, and what a browser shows of it."""

from __future__ import annotations

import html
import json
import math
import re
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui import read_log
from simmer_tui.cli.log_reports import build_report
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.report import keyframes, recording
from simmer_tui.report.page import report_page
from simmer_tui.robot.engine import Engine
from simmer_tui.run import paths
from simmer_tui.run.events import Action, ActionName, Belief, MissionEvent, Result
from simmer_tui.run.mission import Referee, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Pose, SimulationSpec, Simulator, parse_command
from tests.report.browser import opened, slid

HOSTILE = "</script><script>document.title='taken'</script>\u2028\x07<b>"
TIMES = 20


def mission_log(path: Path, seed: int = 3, result: Result = Result.FAILED) -> None:
    """A mission in whose run all that a player shows happens: contacts, refusals, a held block, beliefs
    with particles, a teleport, a reset."""
    configuration, plan = plan_run(load(bundled_sets()["mission"]), seed)
    # A player ends with the mission, so this one goes on through its contacts.
    plan = replace(plan, contacts=None)
    engine = Engine(Simulator(configuration.simulation, seed))
    simulator = engine.simulator
    reducer = Reducer(checkpoint_of(simulator, mission=True))
    session = engine.session()
    with RunLog(path, configuration, simulator, mission=True) as log:
        referee = Referee(plan, reducer, engine.tell)
        for watcher in (reducer.apply, referee.watch, log):
            engine.watch(watcher)
        referee.begin()

        def give(*texts: str) -> None:
            for text in texts:
                session.submit(parse_command(text), lambda outcome: None)

        for turn in range(6):
            give("u1", "u2", "t1", "l1", "c1", "o1", "d1-7.5", f"r1-{40 + 13 * turn}", "zz", HOSTILE)
            pose = simulator.pose
            cloud = tuple((pose.x + 0.1 * i, pose.y - 0.1 * i, 5.0) for i in range(40))
            told = Pose(pose.x + 1, pose.y, pose.heading + 10)
            engine.tell(Belief(simulator.time, told, pose, 2.0, cloud, HOSTILE))
        engine.perform(Action(ActionName.TELEPORT, (18.0, 40.0, 90.0)))
        engine.perform(Action(ActionName.BLOCK, (18.0, 45.0)))
        give("p1-1", "r1-60", "d1--4", "d1-60", "p1-0")
        engine.perform(Action(ActionName.RESET))
        give("d1-3", "u1", "r1--75")
        engine.tell(MissionEvent(simulator.time, result, f"mission: {result.value}", "time is up"))


@pytest.mark.parametrize("result", [Result.FAILED, Result.SUCCESS])
def test_a_run_is_taken_over_only_where_something_is_left_to_do(result: Result, tmp_path: Path) -> None:
    mission_log(tmp_path / "run.jsonl", result=result)
    assert ("--take-over" in page_of(tmp_path / "run.jsonl")) == (result is Result.FAILED)


def page_of(log: Path) -> str:
    return report_page(build_report(log), log.name)


def recorded(page: str) -> dict[str, Any]:
    found = re.search(r"<script type='application/json' id='recording'>(.*?)</script>", page)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def logged_poses(log: Path, times: list[float]) -> list[Pose]:
    with RunLogIndex(log) as index:
        playback = Playback(index)
        return [playback.state_at(playback.index.find_time(each), each).pose for each in times]


@pytest.mark.slow
def test_a_browser_shows_the_poses_of_the_log(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    mission_log(log)
    text = page_of(log)
    end = recorded(text)["end"] / 1000
    times = [round(end * (each + 0.37) / TIMES, 2) for each in range(TIMES)]
    each = """[document.querySelector(".live .robot").getAttribute("transform"),
      document.querySelector(".clock").textContent, document.querySelector(".words").textContent]"""
    last = """{ title: document.title, scripts: document.scripts.length,
      marks: document.querySelectorAll(".marks button").length }"""
    seen, shown = slid(text, tmp_path, times, each, last)
    assert shown["title"] == "Run run.jsonl"
    assert shown["scripts"] == 3, "nothing of the log became a script"
    assert shown["marks"] == len(recorded(text)["marks"]) > 10
    for time, pose, (transform, clock, words) in zip(times, logged_poses(log, times), seen, strict=True):
        x, y, heading = map(float, re.findall(r"-?[\d.]+(?:e-?\d+)?", transform))
        assert math.hypot(x - pose.x, y - pose.y) < 0.05, time
        assert abs((heading - pose.heading + 180) % 360 - 180) < 0.5, time
        assert clock.startswith(f"{time:.2f} / ")
        assert f"({x:.2f}, {y:.2f})" in words
        # As the terminal, the log and a compass have it: not wrapped.
        told = re.search(r"heading (-?[\d.]+)°", words)
        assert told is not None
        assert abs(float(told[1]) - pose.heading) < 0.5, time


@pytest.mark.slow
def test_an_address_with_a_time_opens_at_that_moment(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    mission_log(log)
    page = tmp_path / "run.html"
    # What comes after # is part of an address, not of a file's name.
    page.write_text(page_of(log).replace("<body>", "<body><script>location.hash = 't=1.50'</script>"))
    dom = opened(page)
    assert "at-moment" in dom[:400]
    assert re.search(r'<output class="clock">1.50 / ', dom)
    assert "taken" not in dom[:400]


def test_text_of_a_log_ends_no_element(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    mission_log(log)
    text = page_of(log)
    assert text.count("</script>") == 2
    assert "\u2028" not in text
    assert "\x07" not in text
    data = recorded(text)
    assert {mark[1] for mark in data["marks"]} >= {"contact", "refused", "person", "failed"}
    assert any("</script>" in mark[2] for mark in data["marks"])
    assert len(text) < 300_000


def test_keyframes_give_every_pose_of_the_log(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    mission_log(log)
    run = build_report(log)
    times = [run.history.elapsed * each / 499 for each in range(500)]
    for time, pose in zip(times, logged_poses(log, times), strict=True):
        shown = run.recording.pose_at(time)
        assert math.hypot(shown.x - pose.x, shown.y - pose.y) < 0.05
        assert abs(shown.heading - pose.heading) < 0.5
    block = run.recording.block_at(run.history.elapsed)
    assert (block.x, block.y) == (run.reducer.at().block.x, run.reducer.at().block.y)


@pytest.fixture(scope="module")
def mission_spec() -> SimulationSpec:
    return load(bundled_sets()["mission"]).simulation


@settings(max_examples=12)
@given(
    moves=st.lists(st.tuples(st.sampled_from(("d1", "r1", "w1")), st.floats(-40, 40)), min_size=1, max_size=6)
)
def test_keyframes_of_any_movement(mission_spec: SimulationSpec, moves: list[tuple[str, float]]) -> None:
    simulator = Simulator(mission_spec, 5)
    for code, value in moves:
        outcome = simulator.execute(f"{code}-{value:.3f}")
        trajectory = outcome.trajectory
        if trajectory is None:
            continue
        until = outcome.time
        way = [keyframes.Keyframe(time, pose) for time, pose in keyframes.keyframes_of(trajectory, until)]
        times = [frame.elapsed for frame in way]
        for part in range(40):
            time = trajectory.start_time + (until - trajectory.start_time) * part / 39
            pose, shown = trajectory.pose_at(time), keyframes.pose_at(way, times, time)
            assert math.hypot(shown.x - pose.x, shown.y - pose.y) < 0.05
            assert abs(shown.heading - pose.heading) < 0.75


def test_keyframes_of_a_movement_cost_as_much_as_it_has_segments() -> None:
    """Each frame was compared with all before it: pages of runs took longer than the runs."""
    calls = []
    for segments in (100, 200):
        spec = replace(load(bundled_sets()["mission"]).simulation, num_segments=segments)
        outcome = Simulator(spec, 5).execute("d1-4")
        assert outcome.trajectory is not None
        counted: Counter[str] = Counter()
        sys.setprofile(lambda frame, event, _, counted=counted: counted.update((event,)))
        try:
            way = keyframes.keyframes_of(outcome.trajectory, outcome.time)
        finally:
            sys.setprofile(None)
        assert way[-1] == (outcome.time, outcome.trajectory.pose_at(outcome.time))
        calls.append(counted["call"] + counted["c_call"])
    assert calls[1] < 2.5 * calls[0]


def test_a_long_run_stays_small_and_says_what_is_left_out(
    start_run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name, most in (
        (paths, "MOVEMENTS", 20),
        (recording, "READINGS", 30),
        (recording, "MARKS", 5),
        (paths, "MOST_BELIEFS", 30),
    ):
        monkeypatch.setattr(module, name, most)
    run = start_run()
    for _ in range(40):
        run.send("u1", "d1-1", "zz", "d1--1")
        run.believe(0.5)
    report = build_report(run.path)
    made = report.recording
    assert len(made.readings.items) == 30
    assert len(made.marks.items) == 5
    assert 0 < made.begin < made.end
    text = report_page(report, "run")
    assert f"last {made.end - made.begin:.0f} of {made.end:.0f} s" in text
    assert "earlier marks are left out" in text
    data = recorded(text)
    assert data["begin"] == round(1000 * made.begin)
    times = [made.begin + (made.end - made.begin) * each / 49 for each in range(1, 50)]
    for time, pose in zip(times, logged_poses(run.path, times), strict=True):
        shown = made.pose_at(time)
        assert math.hypot(shown.x - pose.x, shown.y - pose.y) < 0.05


def test_a_page_counts_down_no_mission_that_has_not_begun(start_run: Callable[..., Any]) -> None:
    run = start_run(files=dict(load(bundled_sets()["mission"]).files))
    run.send("u1", "d1-3")
    report = build_report(run.path)
    assert report.configuration.mission is not None
    assert '"limit":null' in report_page(report, "run.jsonl")
    run.engine.tell(MissionEvent(run.simulator.time, Result.UNDER_WAY, "mission: begun"))
    assert '"limit":300.0' in report_page(build_report(run.path), "run.jsonl")


def test_a_notebook_shows_a_log_as_its_page(start_run: Callable[..., Any]) -> None:
    run = start_run()
    run.send("u1", "d1-3")
    with read_log(run.path) as log:
        next(iter(log))  # it has been read a little already
        shown = log._repr_html_()
        assert len(list(log)) > 0
    frame = re.fullmatch(r'<iframe sandbox="allow-scripts" [^>]*srcdoc="([^"]*)"></iframe>', shown)
    assert frame is not None
    assert html.unescape(frame[1]) == report_page(build_report(run.path), "run.jsonl")


def test_many_particles_are_thinned_and_none_of_the_beliefs_lost(
    start_run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paths, "PARTICLES_SHOWN", 100)
    run = start_run()
    cloud = tuple((float(each), 1.0) for each in range(40))
    for _ in range(9):
        run.send("d1-1")
        pose = run.simulator.pose
        run.engine.tell(Belief(run.simulator.time, pose, pose, 1.0, cloud))
    report = build_report(run.path)
    beliefs = report.recording.beliefs.items
    assert [len(each.particles) for each in beliefs] == [10] * 9
    assert report.recording.begin == 0
    assert "shows one in 4" in report_page(report, "run")
