"""What the panels say, as strings."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.sets import MISSION_SET, bundled_sets
from simmer_tui.engine import Engine
from simmer_tui.events import Action, ActionName, Belief, Event, Notice, NoticeKind, Result, TwinReading
from simmer_tui.mission import MissionState, Referee, plan_run
from simmer_tui.sim import Pose, SimulationSpec, Simulator, parse_command
from simmer_tui.snapshot import LogEntry, Recorder, Snapshot
from simmer_tui.state import StateFold, beginning_of
from simmer_tui.tui.line_panel import Line, text_of
from simmer_tui.tui.readouts import (
    complaint_of,
    entry_line,
    entry_source,
    link_lines,
    mission_lines,
    number_text,
    range_role,
    robot_lines,
    sensor_lines,
    sparkline,
    status_line,
)


class Run:
    """A simulator whose recorder is asked for snapshots."""

    def __init__(self, spec: SimulationSpec) -> None:
        self.engine = Engine(Simulator(spec, 5))
        fold = StateFold(beginning_of(self.engine.simulator))
        self.recorder = Recorder(self.engine, fold)
        self.engine.watch(fold.take)
        self.engine.watch(self.recorder.watch)
        self._session = self.engine.session()

    def give(self, *commands: str, source: str = "client") -> Run:
        for command in commands:
            self._session.submit(parse_command(command, source), lambda outcome: None)
        return self

    def snapshot(self, true_values: bool = False) -> Snapshot:
        return self.recorder.snapshot(0, true_values)

    def log(self) -> list[Line]:
        lines = [entry_line(entry) for entry in self.snapshot().entries]
        return [line for line in lines if line is not None]


@pytest.fixture
def run(course_spec: SimulationSpec) -> Run:
    return Run(course_spec)


def texts(lines: list[Line]) -> list[str]:
    return [text_of(line) for line in lines]


def roles(line: Line) -> dict[str, str]:
    return {text.strip(): role for text, role in line}


def test_the_robot_panel_of_a_run_that_has_not_begun(run: Run) -> None:
    assert texts(robot_lines(run.snapshot())) == [
        "pose     (9.50, 42.00) in, 0.0 deg",
        "state    standing",
        "driven   0.0 in, 0 contacts",
        "time     0.00 s, 0 commands",
        "seed     5",
    ]


def test_the_robot_panel_after_a_contact(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    lines = robot_lines(run.give("w1-100").snapshot())
    assert texts(lines) == [
        "pose     (9.50, 45.00) in, 0.0 deg",
        "state    at a wall",
        "last     w1-100 -> done",
        "driven   3.0 in, 1 contact",
        "time     16.67 s, 1 command",
        "seed     5, noise off",
    ]
    assert roles(lines[1])["at a wall"] == "danger"
    assert roles(lines[3])["1 contact"] == "warning"


def test_a_refusal_and_a_belief_stand_out(run: Run) -> None:
    run.engine.tell(Belief(0.0, Pose(6.5, 46.0, 350.0), Pose(9.5, 42.0, 0.0), 2.0))
    lines = robot_lines(run.give("\x1b").snapshot())
    assert texts(lines)[2:5] == [
        "believed (6.50, 46.00) in, 350.0 deg",
        "off by   5.00 in, 10.0 deg, spread 2.0 in",
        "last     \\x1b -> NaN",
    ]
    assert roles(lines[4])["\\x1b -> NaN"] == "danger"


def test_paused_says_whether_a_command_waits(run: Run) -> None:
    run.engine.perform(Action(ActionName.PAUSE))
    assert texts(robot_lines(run.snapshot()))[1] == "state    paused"
    assert texts(robot_lines(run.give("u1").snapshot()))[1] == "state    paused, a command waits"


def test_sensors_show_reading_unit_truth_and_history(run: Run) -> None:
    run.give("u1", "i1", "d1-1", "u1", "c1", "o1")
    snapshot = run.snapshot(true_values=True)
    sensors = run.engine.simulator.spec.sensors
    lines = texts(sensor_lines(sensors, snapshot, 46, truth=False, plain=False))
    assert lines[0] == " u1 ultra1    34.50 in  ▇▁"
    assert lines[1] == " u2 ultra2           –"
    assert lines[5].startswith(" i1 ir1              0")
    assert next(line for line in lines if "c1" in line).startswith(" c1 comp1     0.00 deg")
    newest = [line for line in lines if line.startswith(">")]
    assert [line[1:3] for line in newest] == ["o1"]
    true = texts(sensor_lines(sensors, snapshot, 46, truth=True, plain=True))
    assert true[0].startswith(" u1 ultra1    34.50 in    34.50")
    assert all(line.isascii() for line in true)
    assert all(len(line) <= 46 for line in true)


def test_short_ranges_are_coloured(course_spec: SimulationSpec) -> None:
    ultra, ir = course_spec.sensors[0], course_spec.sensors[5]
    assert [range_role(ultra, value) for value in (2.9, 5.9, 6.0, math.inf)] == [
        "danger",
        "warning",
        "value",
        "value",
    ]
    assert range_role(ir, 0.0) == "value"


@pytest.mark.parametrize(
    ("values", "width", "bars"),
    [
        ((), 5, ""),
        ((1.0,), 5, "▄"),
        ((0.0, 1.0), 5, "▁▇"),
        ((0.0, 1.0, 2.0), 2, "▁▇"),
        ((0.0, math.inf, math.nan, 8.0), 9, "▁▇?▇"),
        ((math.inf,), 3, "▇"),
        ((1.0, 2.0), 0, ""),
        ((1.0, 2.0), -3, ""),
    ],
)
def test_a_sparkline_goes_from_the_least_to_the_greatest(
    values: tuple[float, ...], width: int, bars: str
) -> None:
    assert sparkline(values, width, plain=False) == bars
    assert len(sparkline(values, width, plain=True)) == len(bars)


def test_numbers_of_any_kind_have_a_text() -> None:
    assert [number_text(value) for value in (1.005, -0.5, math.inf, -math.inf, math.nan)] == [
        f"{1.005:.2f}",
        "-0.50",
        "inf",
        "-inf",
        "nan",
    ]


def test_the_link_panel_names_client_rate_and_ports(run: Run) -> None:
    ports = {"commands": 9000, "replies": 9001, "beliefs": 9002}
    assert texts(link_lines(run.snapshot(), ports)) == [
        "client   waiting, 0 commands/s",
        "ports    9000 commands, 9001 replies",
        "         9002 beliefs",
    ]
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "127.0.0.1:5"))
    assert texts(link_lines(run.snapshot(), ports))[0].startswith("client   127.0.0.1:5, ")
    run.engine.tell(Notice(NoticeKind.LEFT, "client a left", "127.0.0.1:5"))
    assert "waiting" in texts(link_lines(run.snapshot(), ports))[0]


@pytest.mark.parametrize("width", [40, 80, 200])
def test_the_status_line_holds_pose_and_last_command_in_any_width(run: Run, width: int) -> None:
    text = text_of(status_line(run.give("zz").snapshot(), width))
    assert text.startswith("(9.5, 42.0) 0 deg standing zz -> NaN")
    assert len(text) <= width
    assert ("no sensor or drive" in text) == (width > 40)


def test_log_lines_name_time_source_command_reply_and_reason(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.give("u1", "w1-100", "d1-x")
    run.give("r1-5", source="keys")
    run.engine.perform(Action(ActionName.TELEPORT, (54.0, 42.0, 0.0)))
    lines = texts(run.log())
    assert lines[:3] == [
        "    0.00 console noise 0      noise off",
        "    0.00 client  u1           35.50 in",
        "   16.67 client  w1-100       done  stopped by the wall at (9.5, 48.0)",
    ]
    assert lines[3].startswith("   16.67 client  d1-x         NaN  'x' is not a finite decimal number")
    assert lines[4] == "   16.71 keys    r1-5         done"
    assert lines[5].startswith("   16.71 console teleport 54 42 0 ")
    assert "wall" in lines[5]


@pytest.mark.parametrize(
    ("event", "source", "text"),
    [
        (Notice(NoticeKind.FAULT, "it broke"), "robot", "12:34:56 robot   it broke"),
        (Notice(NoticeKind.PROGRAM, "printed\x1b[2J"), "program", "12:34:56 program printed\\x1b[2J"),
        (
            Belief(1.0, Pose(1, 2, 3), Pose(1, 2, 3), None, (), "[b]\x07é"),
            "belief",
            "    1.00 belief  (1.00, 2.00) in, 3.0 deg, off 0.00 in, 0.0 deg  [b]\\x07\\xe9",
        ),
        (
            TwinReading(2.0, parse_command("u1"), "u1", 3.0, math.nan),
            "client",
            "    2.00 client  u1           robot 3.00, simulated nan",
        ),
    ],
)
def test_other_events_in_the_log(event: Event, source: str, text: str) -> None:
    noon = time.mktime((2024, 5, 1, 12, 34, 56, 0, 0, -1))
    entry = LogEntry(1, noon, event)
    assert entry_source(entry) == source
    assert text_of(entry_line(entry)) == text


def test_only_what_people_asked_for_is_complained_about_in_the_console(run: Run) -> None:
    assert complaint_of(run.give("zz").snapshot().entries) is None
    run.give("d1-", source="console")
    assert complaint_of(run.snapshot().entries) == "d1-: the value is missing, as in d1-3"
    run.give("u1", source="keys")
    assert complaint_of(run.snapshot().entries) == ""
    run.engine.perform(Action(ActionName.SPEED, (0.0,), source="console"))
    assert str(complaint_of(run.snapshot().entries)).startswith("speed: the speed is between")


@pytest.fixture
def mission() -> Callable[..., MissionState]:
    configuration, plan = plan_run(load(bundled_sets()[MISSION_SET]), seed=7)
    simulator = Simulator(configuration.simulation, 7)
    state = Referee(plan, StateFold(beginning_of(simulator, mission=True))).state()

    def changed(**changes: object) -> MissionState:
        return replace(state, **changes)  # type: ignore[arg-type]

    return changed


def test_a_mission_shows_the_time_left_and_the_next_goal(mission: Callable[..., MissionState]) -> None:
    state = mission()
    assert texts(mission_lines(state)) == [
        f"mission  {state.plan.time_limit:.0f} s left",
        "goals    0 of 3 met, next: loading zone reached",
    ]
    assert "holding the block" in texts(mission_lines(mission(holding=True)))[0]


def test_a_mission_that_is_over_says_how_it_went(mission: Callable[..., MissionState]) -> None:
    lost = mission_lines(mission(result=Result.FAILED, reason="too many\x1b contacts"))
    assert texts(lost) == ["mission  failed: too many\\x1b contacts"]
    assert lost[0][1][1] == "danger"
    won = mission_lines(mission(result=Result.SUCCESS))
    assert texts(won) == ["mission  success"]
    assert won[0][1][1] == "good"
