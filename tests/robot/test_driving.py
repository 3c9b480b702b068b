"""Continuous motion in the engine: whose velocity it is, waits, and missions that end in one."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.cli.main import build_parser
from simmer_tui.config import load_default
from simmer_tui.config.loader import Configuration, find_set, load
from simmer_tui.errors import RunLogError
from simmer_tui.live.snapshot import Recorder
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import (
    Action,
    ActionName,
    Event,
    LegBegun,
    LegEnded,
    MissionEvent,
    Notice,
    NoticeKind,
    Result,
    VelocityEnd,
    VelocityEnded,
)
from simmer_tui.run.mission import Referee, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import (
    Axes,
    Command,
    CommandResult,
    Pose,
    SimulationSpec,
    Simulator,
    Status,
    parse_command,
)
from simmer_tui.tui.maze.scene import RECENT, scene_of
from tests.in_process import simmer
from tests.manual_loop import ManualLoop


class Bench:
    """An engine whose clock the test moves, with all that happened."""

    def __init__(self, spec: SimulationSpec | None = None, **options: Any) -> None:
        self.loop = ManualLoop()
        self.simulator = Simulator(spec or exact_spec(), seed=3)
        self.simulator.advance(1000.3)
        self.engine = Engine(self.simulator, **options)
        self.events: list[Event] = []
        self.results: list[CommandResult] = []
        self.engine.watch(self.events.append)
        self.engine.start(self.loop)  # type: ignore[arg-type]  # as much of a loop as it uses
        self.session = self.engine.session()

    def send(self, *texts: str, session: Session | None = None, waits: bool = True) -> None:
        """Send commands; in instant motion until all that wait have waited."""
        for text in texts:
            (session or self.session).submit(parse_command(text), self.results.append)
        # After a slice of commands the loop has its turn, too.
        while waits:
            self.loop.run_until(self.loop.now)
            waits = not self.engine.timed and self.engine.driving.waits

    def told(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def endings(self) -> list[VelocityEnd]:
        return [event.reason for event in self.told(VelocityEnded)]


def exact_spec(**changes: object) -> SimulationSpec:
    """The default robot without errors, in the middle of a free row of the maze."""
    spec = load_default().simulation
    drives = tuple(replace(drive, error=Axes(), bias=Axes()) for drive in spec.drives)
    placed = replace(spec, drives=drives, randbias=False, bot_center=(9.5, 6.0))
    return replace(placed, **changes)  # type: ignore[arg-type]  # any field


def test_a_wait_is_answered_when_its_time_has_come() -> None:
    bench = Bench()
    bench.send("vv-6;0;0", "wt-2", "vv-0;0;0")
    assert [result.time for result in bench.results] == pytest.approx([1000.3, 1002.3, 1002.3])
    assert bench.simulator.pose.x == pytest.approx(21.5)


def test_the_legs_of_a_motion_follow_one_another() -> None:
    bench = Bench()
    bench.send("vv-6;0;20", "wt-3", "vv-0;0;0")
    legs = [event.leg for event in bench.told(LegEnded)]
    assert legs[0].start_time == 1000.3
    assert legs[-1].end_time == bench.simulator.time
    for leg, after in pairwise(legs):
        assert (leg.end_time, leg.last_pose) == (after.start_time, after.before)


def test_a_stop_cuts_a_wait_at_the_time_reached() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 42.0)))
    # Beside a wall, pressed: an hour of it takes a minute to compute.
    bench.send("vv-6;3;0", "wt-3600", waits=False)
    stopper = bench.engine.session()
    stop = replace_stops("xx")
    stopper.submit(stop, bench.results.append)
    assert bench.endings == [VelocityEnd.STOP]
    waited = next(result for result in bench.results if result.command.text == "wt-3600")
    assert waited.time < 1000.3 + 3600
    reached = bench.simulator.time
    bench.loop.run_until(bench.loop.now + 1.0)
    assert bench.simulator.time == reached


def test_an_answer_that_fails_holds_up_no_later_wait() -> None:
    bench = Bench()

    def fail(result: CommandResult) -> None:
        raise ValueError(result.command.text)

    with pytest.raises(ValueError, match="wt-2"):
        bench.session.submit(parse_command("wt-2"), fail)
    bench.send("wt-1")
    assert [result.time for result in bench.results] == pytest.approx([1003.3])


def replace_stops(text: str) -> Command:
    """A command that stops, as a dialect makes it."""
    return replace(parse_command(text), stops=True)


def test_a_velocity_that_waits_for_its_turn_does_not_begin_after_a_stop() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 42.0)))
    bench.send("vv-6;3;0", "wt-3600", "vv-2;0;0", waits=False)
    bench.engine.session().submit(replace_stops("xx"), bench.results.append)
    bench.send("u1")
    assert not bench.simulator.velocity.moves
    (late,) = [result for result in bench.results if result.command.text == "vv-2;0;0"]
    assert late.status is Status.STOPPED


def test_a_stop_goes_first_though_another_came_before_the_velocity() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 42.0)))
    bench.session.submit(replace_stops("xx"), bench.results.append)
    bench.send("vv-6;3;0", "wt-3600", waits=False)
    bench.session.submit(replace_stops("xx"), bench.results.append)
    assert bench.endings == [VelocityEnd.STOP]
    assert not bench.simulator.velocity.moves


def test_a_pause_holds_a_wait_and_a_step_ends_it() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 42.0)))
    bench.send("vv-6;3;0", "wt-3600", waits=False)
    bench.engine.perform(Action(ActionName.PAUSE))
    reached = bench.simulator.time
    bench.loop.run_until(bench.loop.now + 1.0)
    assert bench.simulator.time == reached
    assert bench.engine.driving.waits
    bench.engine.perform(Action(ActionName.STOP))
    bench.send("wt-2", waits=False)
    bench.engine.perform(Action(ActionName.RESUME))
    bench.loop.run_until(bench.loop.now + 1.0)
    assert bench.simulator.time == pytest.approx(reached + 2.0)


def test_a_step_while_paused_ends_a_wait() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 42.0)))
    bench.send("vv-6;3;0", "wt-5", waits=False)
    bench.engine.perform(Action(ActionName.PAUSE))
    bench.engine.step()
    assert bench.results[-1].command.text == "wt-5"
    assert bench.simulator.time == pytest.approx(1005.3)


def test_a_teleport_ends_a_velocity_and_a_wait() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 42.0)))
    bench.send("vv-6;3;0", "wt-3600", waits=False)
    bench.engine.perform(Action(ActionName.TELEPORT, (18.0, 42.0, 0.0)))
    assert bench.endings == [VelocityEnd.PLACED]
    assert bench.simulator.pose == Pose(18.0, 42.0, 0.0)
    assert any(result.command.text == "wt-3600" for result in bench.results)


def test_a_velocity_ends_with_its_sender_and_not_with_another() -> None:
    bench = Bench()
    other = bench.engine.session()
    bench.send("vv-6;0;0")
    bench.send("u1", session=other)
    other.close()
    assert bench.simulator.velocity.moves
    bench.session.close()
    assert bench.endings == [VelocityEnd.LEFT]
    assert not bench.simulator.velocity.moves


@pytest.mark.parametrize("timeout", [0.3, 0.5, 0.55])
def test_other_senders_do_not_keep_a_velocity_alive(timeout: float) -> None:
    bench = Bench(exact_spec(velocity_timeout=timeout))
    other = bench.engine.session()
    bench.send("vv-6;0;0")
    bench.send("wt-0.3", "u1", "wt-0.3", session=other)
    assert bench.endings == [VelocityEnd.TIMEOUT]


def test_a_movement_ends_a_velocity() -> None:
    bench = Bench()
    bench.send("vv-6;0;0", "wt-1", "d1-3")
    assert bench.endings == [VelocityEnd.MOVEMENT]
    assert bench.simulator.pose.x == pytest.approx(18.5)


def test_the_commands_of_one_message_are_one_moment() -> None:
    bench = Bench()
    bench.send("vv-1;0;0")
    pair = [parse_command("u1"), parse_command("u1")]
    for _ in range(2):
        bench.engine.submit(bench.session, pair, lambda results, data: bench.results.extend(results))
    assert [result.time for result in bench.results[1:]] == pytest.approx([1000.3, 1000.3, 1000.32, 1000.32])


def test_people_who_look_take_no_time() -> None:
    bench = Bench()
    bench.send("vv-1;0;0")
    for _ in range(3):
        bench.session.submit(parse_command("u1", "console"), bench.results.append)
    assert bench.simulator.time == 1000.3


def test_timed_motion_goes_on_by_the_clock() -> None:
    bench = Bench(timed=True)
    bench.send("vv-6;0;0")
    bench.loop.run_until(bench.loop.now + 2.0)
    bench.engine.now()
    assert bench.simulator.pose.x == pytest.approx(21.5)
    bench.send("wt-1")
    assert not [result for result in bench.results if result.command.text == "wt-1"]
    bench.loop.run_until(bench.loop.now + 1.01)
    assert bench.results[-1].time == pytest.approx(bench.results[0].time + 3.0)


def test_timed_motion_tells_contacts_though_nobody_asks() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 42.0), bot_rot=90.0), timed=True)
    bench.send("vx-6")
    bench.loop.run_until(bench.loop.now + 1.0)
    assert [event.contact is not None for event in bench.told(LegEnded)].count(True) == 1


def test_a_program_that_pauses_by_its_own_clock_is_told_once() -> None:
    bench = Bench()
    bench.send("vv-1;0;0")
    for _ in range(3):
        bench.loop.run_until(bench.loop.now + 2.0)
        bench.send("u1")
    advice = [event for event in bench.told(Notice) if event.kind is NoticeKind.HINT]
    assert len(advice) == 1
    assert "wt-2" in advice[0].text
    named = re.findall(r"--[a-z-]+", advice[0].text)
    assert named
    assert all(f"{option} " in build_parser().format_settings() for option in named)


def test_a_person_who_types_a_velocity_is_told_how_time_passes() -> None:
    """Not that a program paused: there is none."""
    bench = Bench()
    bench.session.submit(parse_command("vv-1;0;0", "console"), bench.results.append)
    bench.loop.run_until(bench.loop.now + 2.0)
    (hint,) = bench.told(Notice)
    assert "program" not in hint.text
    assert "wt-2" in hint.text
    assert not hint.advice


PROGRAM = (
    "wt-0",
    "vv-5;0;12",
    "u1",
    "u2",
    "wt-0.7",
    "u1",
    "vr--40",
    "wt-1.3",
    "o3",
    "vv-6;2;0;1.1",
    "wt-1.9",
    "g1",
    "d1-2",
    "u1",
)


def logged(
    path: Path, *, timed: bool = False, link: bool = False, drive: Callable[[Bench], None] | None = None
) -> Bench:
    """A run of `PROGRAM`, or of what `drive` does, with all its errors, logged, perhaps over a slow link."""
    configuration = load_default()
    simulator = Simulator(configuration.simulation, seed=3)
    motion = replace(configuration.settings.motion, motion="timed" if timed else "instant")
    configuration = replace(configuration, settings=replace(configuration.settings, motion=motion))
    bench = Bench.__new__(Bench)
    bench.loop, bench.simulator, bench.events, bench.results = ManualLoop(), simulator, [], []
    delay = LinkDelay(0.01, 0.02, 3) if link else None
    bench.engine = Engine(simulator, timed=timed, link=delay)
    with RunLog(path, configuration, simulator) as log:
        bench.engine.watch(log)
        bench.engine.watch(bench.events.append)
        bench.engine.start(bench.loop)  # type: ignore[arg-type]  # as much of a loop as it uses
        bench.session = bench.engine.session()
        (drive or partial(drive_program, timed=timed))(bench)
        bench.session.close()
    return bench


def drive_program(bench: Bench, *, timed: bool) -> None:
    for text in PROGRAM:
        bench.send(text)
        if timed:
            bench.loop.run_until(bench.loop.now + 0.3)
    if timed:
        bench.loop.run_until(bench.loop.now + 6.0)


@pytest.mark.parametrize(
    ("timed", "link"),
    [(False, False), (False, True), (True, False), pytest.param(True, True, marks=pytest.mark.slow)],
)
def test_a_log_holds_the_motion_and_repeats_it_bit_for_bit(tmp_path: Path, timed: bool, link: bool) -> None:
    bench = logged(tmp_path / "run.jsonl", timed=timed, link=link)
    with Rerun(tmp_path / "run.jsonl") as rerun:
        for _ in rerun.steps():
            pass
        assert rerun.difference is None
        assert rerun.commands == len(PROGRAM)
        assert rerun.simulator.pose == bench.simulator.pose
    with LogReader(tmp_path / "run.jsonl") as reader:
        events = [told.event for told in reader if not isinstance(told, BrokenLine)]
    kinds = (LegBegun, LegEnded, VelocityEnded)
    assert [shown(each) for each in events if isinstance(each, kinds)] == [
        shown(each) for each in bench.events if isinstance(each, kinds)
    ]


def a_movement_follows(bench: Bench) -> None:
    bench.send("vv-6;0;0", "d1-3", "u1", "d1-3")


def another_velocity_follows(bench: Bench) -> None:
    bench.send("vv-6;0;0", "vx-0", "d1-3", "u1", "d1-3")


def a_stop_follows(bench: Bench) -> None:
    bench.send("vv-6;0;0")
    bench.engine.perform(Action(ActionName.STOP))
    bench.send("d1-3", "u1", "d1-3")


@pytest.mark.parametrize("drive", [a_movement_follows, another_velocity_follows, a_stop_follows])
def test_a_velocity_that_ends_at_once_is_over(tmp_path: Path, drive: Callable[[Bench], None]) -> None:
    """In instant motion no time passes between two commands. A velocity that another command ends at the same
    time has moved nothing, but its leg must not stay under way."""
    bench = logged(tmp_path / "run.jsonl", drive=drive)
    with LogReader(tmp_path / "run.jsonl") as reader:
        logged_events = [told.event for told in reader if not isinstance(told, BrokenLine)]
    for events in (bench.events, logged_events):
        reducer = Reducer(checkpoint_of(Simulator(bench.simulator.spec, seed=3)))
        for event in events:
            reducer.apply(event)
        assert reducer.still
        assert reducer.at().pose == bench.simulator.pose
        assert not reducer.at().moving


def begins_to_wait(bench: Bench) -> None:
    """It drives, and waits; in instant motion the first slice of that is over."""
    bench.send("vv-3;0;2", "wt-3600", waits=False)
    if bench.engine.timed:
        bench.loop.run_until(bench.loop.now + 0.1)


def another_reads(bench: Bench) -> None:
    other = bench.engine.session()
    begins_to_wait(bench)
    bench.send("u1", "vr-5", "g1", session=other, waits=False)
    bench.engine.perform(Action(ActionName.STOP))


def a_person_intervenes(bench: Bench) -> None:
    elsewhere = Action(ActionName.TELEPORT, (18.0, 42.0, 10.0))
    for action in (elsewhere, Action(ActionName.STOP), Action(ActionName.RESET)):
        begins_to_wait(bench)
        bench.engine.perform(action)
        bench.send("u1", waits=False)


def it_leaves(bench: Bench) -> None:
    begins_to_wait(bench)
    bench.session.close()
    bench.session = bench.engine.session()
    bench.send("u1", "d1-1", waits=False)
    bench.loop.run_until(bench.loop.now + 5.0)


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize("drive", [another_reads, a_person_intervenes, it_leaves])
@pytest.mark.parametrize("timed", [False, True])
def test_what_happens_during_a_wait_is_run_again(
    tmp_path: Path, timed: bool, drive: Callable[[Bench], None]
) -> None:
    bench = logged(tmp_path / "run.jsonl", timed=timed, drive=drive)
    with Rerun(tmp_path / "run.jsonl") as rerun:
        for _ in rerun.steps():
            pass
    assert rerun.difference is None
    assert rerun.simulator.pose == bench.simulator.pose
    assert rerun.commands == len(bench.told(CommandResult))


def shown(event: Any) -> object:
    """An event without what a log leaves out: what sensors count, and an arc's time beside its leg's end."""
    if not hasattr(event, "leg"):
        return event
    return replace(event, leg=replace(event.leg, counts={}, arc=replace(event.leg.arc, duration=0.0)))


def test_a_reducer_that_reads_the_log_ends_where_the_run_did(tmp_path: Path) -> None:
    bench = logged(tmp_path / "run.jsonl")
    with LogReader(tmp_path / "run.jsonl") as reader:
        reducer = reader.reducer()
        for told in reader:
            assert not isinstance(told, BrokenLine)
            reducer.apply(told.event)
    state = reducer.at()
    assert state.pose == bench.simulator.pose
    assert state.distance == pytest.approx(bench.simulator.distance)
    assert state.contacts == bench.simulator.contacts


def test_a_time_from_elsewhere_does_not_have_a_rerun_drive_for_ever(tmp_path: Path) -> None:
    logged(tmp_path / "run.jsonl")
    lines = (tmp_path / "run.jsonl").read_text().splitlines()
    place = next(i for i, line in enumerate(lines) if '"kind":"read"' in line and '"cmd":"o3"' in line)
    lines[place] = re.sub(r'"t":[\d.]+', '"t":1e11', lines[place])
    (tmp_path / "far.jsonl").write_text("\n".join(lines) + "\n")
    with Rerun(tmp_path / "far.jsonl") as rerun, pytest.raises(RunLogError, match="the log has a gap"):
        for _ in rerun.steps():
            pass


@pytest.mark.parametrize(
    ("old", "new"),
    [('"rate":', '"rate":1e9'), ('"velocity":[', '"velocity":[1e9'), ('"to":[', '"to":[1e11')],
)
def test_a_leg_out_of_the_maze_is_a_broken_line(tmp_path: Path, old: str, new: str) -> None:
    logged(tmp_path / "run.jsonl")
    lines = (tmp_path / "run.jsonl").read_text().splitlines()
    place = next(i for i, line in enumerate(lines) if '"kind":"leg"' in line)
    lines[place] = re.sub(re.escape(old) + r"[-\d.e]+", new, lines[place])
    (tmp_path / "broken.jsonl").write_text("\n".join(lines) + "\n")
    with LogReader(tmp_path / "broken.jsonl") as reader:
        broken = [told for told in reader if isinstance(told, BrokenLine)]
    assert [each.line for each in broken] == [place + 1]
    assert "leads out of the maze" in broken[0].reason


def test_a_robot_that_steers_leaves_a_trail_whose_last_seconds_are_bright() -> None:
    bench = Bench()
    reducer = Reducer(checkpoint_of(bench.simulator))
    recorder = Recorder(bench.engine, reducer)
    bench.engine.watch(recorder.apply)
    for step in range(300):
        bench.send(f"vv-0.2;0;{step % 7}", "wt-0.02")
    bench.send("vv-0.2;0;0", "wt-15")
    scene = scene_of(bench.simulator.spec, bench.simulator.maze, recorder.snapshot())
    assert scene.trail[0][0, :2].tolist() == pytest.approx([9.5, 6.0])
    assert scene.trail[-1][-1, :2].tolist() == pytest.approx([scene.pose.x, scene.pose.y])
    bright = [np.hypot(*np.diff(piece[:, :2], axis=0).T).sum() for piece in scene.recent]
    assert sum(bright) == pytest.approx(0.2 * RECENT, rel=0.01)


def test_what_was_read_a_moment_before_a_contact_was_seen_before_it() -> None:
    bench = Bench(exact_spec(bot_center=(9.5, 44.6), bot_rot=90.0))
    reducer = Reducer(checkpoint_of(bench.simulator))
    bench.engine.watch(reducer.apply)
    seen: list[set[str]] = []

    def note(event: Event) -> None:
        if isinstance(event, LegEnded) and event.contact is not None:
            seen.append(set(reducer.seen))

    bench.engine.watch(note)
    for step in range(30):
        bench.send("u1", "u2", f"vv-6;0;{0.1 * (step % 2)}", "wt-0.005")
    assert seen == [{"u1", "u2"}]


def test_a_changed_leg_in_a_log_is_a_difference(tmp_path: Path) -> None:
    logged(tmp_path / "run.jsonl")
    lines = (tmp_path / "run.jsonl").read_text().splitlines()
    place = next(i for i, line in enumerate(lines) if '"kind":"leg"' in line and '"vr--40"' in line)
    lines[place] = lines[place].replace('"to":[', '"to":[1')
    (tmp_path / "changed.jsonl").write_text("\n".join(lines) + "\n")
    with Rerun(tmp_path / "changed.jsonl") as rerun:
        for _ in rerun.steps():
            pass
        assert rerun.difference is not None
        assert "leg of 'vr--40'" in str(rerun.difference)


# -- missions ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mission_set() -> Configuration:
    return load(find_set("mission"))


def mission(
    configuration: Configuration,
    looks: int,
    commands: tuple[str, ...],
    *,
    read: bool = True,
    **changes: object,
) -> Any:
    """The state of a mission after commands, looked at so many moments of each wait: by readings, which take
    their time, or by the truth alone."""
    assert configuration.mission is not None
    planned, plan = plan_run(
        replace(configuration, mission=replace(configuration.mission, **changes)),  # type: ignore[arg-type]
        1,
    )
    simulator = Simulator(planned.simulation, 1)
    engine = Engine(simulator)
    reducer = Reducer(checkpoint_of(simulator, mission=True))
    referee = Referee(plan, reducer, engine.tell)
    engine.driving.limit_after, engine.driving.limit_reached = referee.limit_after, referee.check
    events: list[Event] = []
    for watcher in (events.append, reducer.apply, referee.watch):
        engine.watch(watcher)
    session = engine.session()
    for command in commands:
        if command.startswith("wt-") and looks:
            begin, seconds = simulator.time, float(command[3:])
            for look in range(1, looks + 1):
                rest = begin + seconds * look / looks - simulator.time
                session.submit(parse_command(f"wt-{rest:.17g}"), lambda outcome: None)
                if read:
                    session.submit(parse_command("u1", "console"), lambda outcome: None)
                else:
                    simulator.true_values()
                    referee.state()
        else:
            session.submit(parse_command(command), lambda outcome: None)
    state = referee.state()
    said = [(event.time, event.subject) for event in events if isinstance(event, MissionEvent)]
    return state, said


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    ("commands", "looks", "limits"),
    [
        (("vv-6;0;0", "wt-12"), 7, {"contacts": 2, "time_limit": 10.0}),
        (("vv-6;0;0", "wt-12"), 7, {"contacts": 0, "time_limit": 40.0}),
        (("vv-3;0;9", "wt-20"), 37, {"contacts": 2, "time_limit": 40.0}),
        (("vv-2;1;0", "wt-15"), 37, {"contacts": 2, "time_limit": 40.0}),
        (("vv-6;0;0", "wt-60"), 37, {"contacts": 2, "time_limit": 40.0}),
    ],
)
def test_looked_at_or_not_the_verdict_is_the_same(
    mission_set: Configuration, commands: tuple[str, ...], looks: int, limits: dict[str, Any]
) -> None:
    plain, said = mission(mission_set, 0, commands, **limits)
    looked, said_then = mission(mission_set, looks, commands, **limits)
    # A look divides the leg: the time of its contact is rounded once more.
    assert [each for _, each in said] == [each for _, each in said_then]
    assert [time for time, _ in said] == pytest.approx([time for time, _ in said_then], rel=1e-12)
    assert (plain.result, plain.reason) == (looked.result, looked.reason)
    if plain.over:
        assert plain.time == pytest.approx(looked.time, rel=1e-12)


SPEED = st.floats(-6.0, 6.0).map(lambda value: round(value, 2))
LEG = st.tuples(SPEED, SPEED, SPEED.map(lambda value: 10.0 * value), st.floats(0.05, 9.0))


@pytest.mark.slow
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    steps=st.lists(LEG, min_size=1, max_size=4),
    looks=st.integers(1, 30),
    limit=st.floats(2.0, 20.0),
    contacts=st.integers(0, 3),
)
def test_a_leg_that_goes_on_beyond_the_end_of_a_mission_has_one_verdict(
    mission_set: Configuration,
    steps: list[tuple[float, float, float, float]],
    looks: int,
    limit: float,
    contacts: int,
) -> None:
    commands = tuple(
        text for x, y, r, seconds in steps for text in (f"vv-{x};{y};{r:.1f}", f"wt-{seconds:.3f}")
    )
    plain, said = mission(mission_set, 0, commands, contacts=contacts, time_limit=limit)
    looked, said_then = mission(mission_set, looks, commands, read=False, contacts=contacts, time_limit=limit)
    # A look divides the leg: the time of its contact is rounded once more.
    assert [each for _, each in said] == [each for _, each in said_then]
    assert [time for time, _ in said] == pytest.approx([time for time, _ in said_then], rel=1e-12)
    assert (plain.result, plain.reason) == (looked.result, looked.reason)
    if plain.over:
        assert plain.time == pytest.approx(looked.time, rel=1e-12)


def test_the_time_limit_ends_a_mission_inside_a_wait(mission_set: Configuration) -> None:
    state, _ = mission(mission_set, 0, ("wt-3600",), time_limit=20.0, contacts=None)
    assert (state.result, state.time) == (Result.FAILED, 20.0)
    assert math.isinf(Engine(Simulator(mission_set.simulation)).driving.limit_after(0.0))


# -- over the ports --------------------------------------------------------------------------------------

FOLLOWER = """
from simmer_tui.client import CommandRefusedError, Robot
with Robot() as robot:
    robot.send("vv-4;0;0")
    for _ in range(30):
        steer = max(-40, min(40, 8 * (robot.read("u2") - 7)))
        robot.send(f"vv-{4 if robot.read('u1') > 7 else 0.5};0;{steer:.2f}")
    robot.sleep(1.5)
    print("at", robot.read("o3"))
"""


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["binary", pytest.param("packets", marks=pytest.mark.slow)])
def test_the_same_program_drives_the_same_way_twice(tmp_path: Path, protocol: str) -> None:
    program = tmp_path / "follower.py"
    program.write_text(FOLLOWER.replace("Robot()", f"Robot(protocol={protocol!r})"))
    ends = []
    for number in range(2):
        log = tmp_path / f"{number}.jsonl"
        ports = ("--port", "--packet-port", "--reply-port", "--packet-reply-port", "--belief-port")
        words = ["--no-ui", *(word for port in ports for word in (port, "0")), "--seed", "7"]
        words += ["--listeners", protocol, "--log", str(log), "--run", f"{sys.executable} {program}"]
        done = simmer(*words)
        assert "at " in done.stdout, done.stderr
        with Rerun(log) as rerun:
            for _ in rerun.steps():
                pass
            assert rerun.difference is None
        ends.append((done.stdout, rerun.simulator.pose, rerun.simulator.time))
    assert ends[0] == ends[1]
