"""Lines of the panels, as strings."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.sets import MISSION_SET, bundled_sets
from simmer_tui.live.snapshot import EVENTS, LogEntry, Recorder, Snapshot
from simmer_tui.report.verdict import Outcome, Verdict
from simmer_tui.robot.engine import Engine
from simmer_tui.run.belief_grid import grid_belief
from simmer_tui.run.events import (
    Action,
    ActionName,
    Belief,
    Event,
    Goal,
    MissionEvent,
    Notice,
    NoticeKind,
    ProgramEnded,
    Result,
    TwinReading,
)
from simmer_tui.run.mission import MissionState, Referee, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import TimeSpent, checkpoint_of
from simmer_tui.sim import Pose, SimulationSpec, Simulator, parse_command
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.noise import SEEDS
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sim.wheels import WheelKinematics
from simmer_tui.tui.answers import end_answer, now_answer
from simmer_tui.tui.event_text import (
    clock_text,
    entry_line,
    event_words,
    kept_lines,
    last_event_line,
    refusal_of,
)
from simmer_tui.tui.gauges import gauge, reading_text, scale_end, sparkline
from simmer_tui.tui.headline import RunPhase, header_line, phase_of
from simmer_tui.tui.line_panel import StyledLine, text_of
from simmer_tui.tui.readouts import (
    Room,
    mission_lines,
    pose_line,
    robot_lines,
    run_lines,
    status_line,
)
from simmer_tui.tui.sensor_readouts import (
    SensorsView,
    age_of_reading,
    direction_sign,
    range_role,
    rows_wanted,
    sensor_lines,
)
from simmer_tui.tui.terminal import GlyphMode


class Run:
    """A simulator whose recorder is asked for snapshots."""

    def __init__(self, spec: SimulationSpec) -> None:
        self.engine = Engine(Simulator(spec, 5))
        reducer = Reducer(checkpoint_of(self.engine.simulator))
        self.recorder = Recorder(self.engine, reducer)
        self.engine.watch(self.recorder.apply)
        self._session = self.engine.session()

    def give(self, *commands: str, source: str = "client") -> Run:
        for command in commands:
            self._session.submit(parse_command(command, source), lambda outcome: None)
        return self

    def snapshot(self, true_values: bool = False) -> Snapshot:
        return self.recorder.snapshot(0, true_values)

    def log(self) -> list[StyledLine]:
        return [entry_line(entry) for entry in self.snapshot().entries]

    def sensors(self, width: int, rows: int = 17, **view: object) -> list[str]:
        """The lines of the sensors panel."""
        shown = SensorsView(**view)  # type: ignore[arg-type]
        snapshot = self.snapshot(shown.truth)
        lines = sensor_lines(self.engine.simulator.spec.sensors, snapshot, width, rows, shown)
        assert all(len(text_of(line.line)) <= width for line in lines)
        return [text_of(line.line).rstrip() for line in lines]


@pytest.fixture
def run(course_spec: SimulationSpec) -> Run:
    return Run(course_spec)


def texts(lines: list[StyledLine]) -> list[str]:
    return [text_of(line) for line in lines]


def roles(line: StyledLine) -> dict[str, str]:
    return {text.strip(): role for text, role in line}


def test_the_robot_panel_of_a_run_that_has_not_begun(run: Run) -> None:
    assert texts(robot_lines(run.snapshot(), Room(36, plain=True))) == [
        "robot ------------------------------",
        "pose     9.5, 42.0 in  0 deg E",
        "belief   none sent",
        "state    standing   driven 0.0 in",
        "contacts 0",
        "block    lies at 25.0, 41.0 in",
    ]


def test_the_robot_panel_has_the_wheels_while_the_robot_drives(run: Run) -> None:
    room = Room(36, plain=True, wheels=WheelKinematics.of(WheelsSpec(layout=WheelLayout.DIFF, track=6.0)))
    assert texts(robot_lines(run.snapshot(), room))[4] == "contacts 0"
    snapshot = run.snapshot()
    drives = dataclasses.replace(snapshot, state=replace(snapshot.state, velocity=Twist(4.0, 0.0, 30.0)))
    lines = robot_lines(drives, room)
    assert texts(lines)[4] == "wheels   2.4 5.6 in/s"


def test_the_robot_panel_after_a_contact(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    lines = robot_lines(run.give("w1-100").snapshot(), Room(36, plain=False))
    assert texts(lines)[1:5] == [
        "pose     9.5, 45.0 in  0 deg →",
        "belief   none sent",
        "state    at a wall   driven 3.0 in",
        "contacts 1, last 00:00.5 left",
    ]
    assert roles(lines[3])["at a wall"] == "danger"
    assert roles(lines[4])["1"] == "danger"
    snapshot = run.snapshot()
    assert snapshot.state.contact is not None
    block = replace(snapshot.state, contact=replace(snapshot.state.contact, cell=None))
    lines = robot_lines(dataclasses.replace(snapshot, state=block), Room(36, plain=False))
    assert texts(lines)[3] == "state    at the block   driven 3.0 in"


@pytest.mark.parametrize("heading", [350.0, -10.0, 710.0])
def test_people_read_headings_from_minus_180_to_180(run: Run, heading: float) -> None:
    run.engine.perform(Action(ActionName.TELEPORT, (20.0, 42.0, heading)))
    assert "-10 deg" in texts(robot_lines(run.snapshot(), Room(36, plain=True)))[1]
    assert "-10 deg" in text_of(pose_line(run.snapshot(), Room(80, plain=True)))
    run.engine.perform(Action(ActionName.TELEPORT, (20.0, 42.0, -180.0)))
    assert " 180 deg" in text_of(pose_line(run.snapshot(), Room(80, plain=True)))


def test_how_far_a_belief_is_off_is_always_said(run: Run) -> None:
    run.engine.tell(Belief(0.0, Pose(6.5, 46.0, 350.0), Pose(9.5, 42.0, 0.0), 2.0))
    assert (
        texts(robot_lines(run.snapshot(), Room(36, plain=True)))[2] == "belief   off 5.0 in 10 deg, spread 2"
    )
    line = text_of(pose_line(run.snapshot(), Room(80, plain=True)))
    assert line.startswith(" pose 9.5, 42.0 in  0 deg E  belief off 5.0 in 10 deg")
    assert line.endswith("0 contacts ")
    assert len(line) == 80


def test_a_belief_that_is_off_by_more_than_it_allows_for_is_lost(run: Run) -> None:
    run.engine.tell(Belief(0.0, Pose(69.5, 42.0, 0.0), Pose(9.5, 42.0, 0.0), 2.0))
    assert texts(robot_lines(run.snapshot(), Room(36, plain=True)))[2] == "belief   off 60.0 in 0 deg, lost"
    line = pose_line(run.snapshot(), Room(80, plain=True))
    assert roles(line)["60.0 in 0 deg, lost"] == "danger"


def believe_grid(run: Run, headings: int) -> None:
    table = np.full((4, 8, headings), 0.25 / (32 * headings - 1))
    table[0, 2, 0] = 0.75
    true = Pose(9.5, 42.0, 30.0)
    grid = grid_belief(table, (0.0, 0.0, 96.0, 48.0), 0.0, true)
    run.engine.tell(Belief(0.0, grid.best_pose, true, grid.spread, grid=grid))


def test_a_grid_has_its_best_cell_the_chance_of_the_truth_entropy_and_spread(run: Run) -> None:
    believe_grid(run, 4)
    told = texts(robot_lines(run.snapshot(), Room(36, plain=True)))[2]
    assert told == "belief   off 20.5 in 30 deg, <1 % true"
    believe_grid(run, 1)
    assert texts(robot_lines(run.snapshot(), Room(36, plain=True)))[2] == "belief   off 20.5 in, <1 % true"
    lines = texts(now_answer(run.snapshot(), plain=True).lines)
    assert lines[:3] == [
        "belief is off 20.5 in", "best 30.0, 42.0 in 75 %, <1 % true", "entropy 2.0 of 5.0 bit, spread 20",
    ]  # fmt: skip


@pytest.mark.parametrize("width", [40, 60, 80, 110])
def test_the_pose_line_fits_any_width(run: Run, width: int) -> None:
    run.engine.tell(Belief(0.0, Pose(6.5, 46.0, 350.0), Pose(9.5, 42.0, 0.0), 2.0))
    assert len(text_of(pose_line(run.snapshot(), Room(width, plain=True)))) <= width


def header(snapshot: Snapshot, width: int, **given: object) -> str:
    paced = dataclasses.replace(snapshot, pace_text="pace 4x")
    return text_of(header_line(paced, Room(width, name="maze", **given)))  # type: ignore[arg-type]


def test_row_0_is_the_state(run: Run) -> None:
    ports = {"commands": 9000, "replies": 9001, "beliefs": 9002}
    assert header(run.snapshot(), 80, ports=ports) == (
        " ○ WAITING for a program   ports 9000, 9001, 9002              seed 5   00:00.0 "
    )
    assert "ports 9000 commands, 9001 replies, 9002 beliefs" in header(run.snapshot(), 120, ports=ports)
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "127.0.0.1:5"))
    assert header(run.snapshot(), 120, ports=ports).startswith(
        " ● standing   127.0.0.1:5   0 commands/s   pace 4x   seed 5  "
    )
    assert header(run.snapshot(), 80, ports=ports, plain=True).startswith(
        " * standing   127.0.0.1   0/s   pace 4x  "
    )
    run.engine.perform(Action(ActionName.PAUSE))
    assert header(run.snapshot(), 120, ports=ports).startswith(
        " ‖ PAUSED   the robot is at 9.5, 42.0; b continues"
    )
    for width in range(20, 130):
        assert len(header(run.snapshot(), width, ports=ports, plain=True)) <= width


def test_row_0_tells_what_a_new_program_does_wrong(run: Run) -> None:
    ports = {"commands": 9000}
    text = "a is connected to the reply port 9001 alone: connect to port 9000 too, which takes commands"
    run.engine.tell(Notice(NoticeKind.FAULT, text, advice=True))
    assert header(run.snapshot(), 120, ports=ports).startswith(f" ? CHECK THE PROGRAM   {text[:78]}")
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "127.0.0.1:5"))
    line = header_line(run.snapshot(), Room(80, plain=True, ports=ports))
    assert roles(line)["? CHECK THE PROGRAM"] == "warning"
    run.engine.perform(Action(ActionName.PAUSE))
    assert header(run.snapshot(), 120, ports=ports).startswith(" ‖ PAUSED")
    for width in range(20, 130):
        assert len(header(run.snapshot(), width, ports=ports, plain=True)) <= width


def test_a_replay_waits_for_nobody(run: Run) -> None:
    assert header(run.snapshot(), 120).startswith(" ● standing   maze   pace 4x   seed 5  ")


def test_the_clock_counts_minutes() -> None:
    assert [clock_text(each) for each in (0.0, 59.96, 95.25, -3.0, 6000.0)] == [
        "00:00.0",
        "01:00.0",
        "01:35.2",
        "-00:03.0",
        "100:00.0",
    ]


# -- sensors ---------------------------------------------------------------------------------


def test_sensors_are_listed_with_their_directions_before_they_were_read(run: Run) -> None:
    assert run.sensors(36) == [
        "sensors ─── range 0–48   last values",
        "u1 ↑   –   ultrasonic       not read",
        "u2 ↖   –   ultrasonic       not read",
        "u3 ↓   –   ultrasonic       not read",
        "u4 ↗   –   ultrasonic       not read",
        "u5 ↑   –   ultrasonic       not read",
        "t1 ↑   –   time of flight   not read",
        "i1–4   –   line, 1 is black not read",
        "o1 ←   –   odometer         not read",
        "o2 ←   –   odometer         not read",
        "o3 ↑   –   odometer         not read",
        "o4 ↑   –   odometer         not read",
        "c1 ↑   –   compass          not read",
        "g1     –   gyro             not read",
    ]
    assert len(run.sensors(36)) == rows_wanted(run.engine.simulator.spec.sensors)
    assert run.sensors(13)[:3] == ["range    0–48", "u1 ↑    –", "u2 ↖    –"]


def test_in_brief_sensors_have_way_value_and_gauge(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    codes = [sensor.code for sensor in run.engine.simulator.spec.sensors]
    assert run.give(*codes).sensors(13) == [
        "range    0–48",
        "u1 ↑ 35.5 ━━─",
        "u2 ↖  5.3 ╸──",
        "u3 ↓  6.5 ╸──",
        "u4 ↗ 16.8 ━──",
        "u5 ↑ 11.0 ╸──",
        "t1 ↑ 44.0 ━━━",
        "line  0 0 1 1",
        "odom     0–24",
        "o1 ←  0.0 ───",
        "o2 ←  0.0 ───",
        "o3 ↑  0.0 ───",
        "o4 ↑  0.0 ───",
        "c1 ↑  0.0 deg",
        "g1    0.0 deg",
    ]


def test_in_full_there_are_units_history_and_its_range(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.give("u1", "d1-10", "u1", "u4", "i1", "c1")
    full = run.sensors(36)
    assert full[1] == "u1 ↑  25.5 in ━━━━━──── ▇▁     26–36"
    assert full[7] == "i1–4   0  –  –  –         1 is black"
    assert full[12] == "c1 ↑   0.0 deg compass →"
    plain = run.sensors(36, glyphs=GlyphMode.ASCII)
    assert plain[1] == "u1F   25.5 in =====.... #.     26-36"
    assert all(line.isascii() for line in plain)


@pytest.mark.parametrize("values", [(364.0, 437.0), (2.0, 35.0)])
def test_history_and_its_range_never_touch(run: Run, values: tuple[float, float]) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    past = tuple(values) * 10
    (o3,) = (line for line in run.give("o3").sensors(36, past={"o3": past}) if line.startswith("o3"))
    bars, _, span = o3.rpartition(" ")
    assert span == f"{values[0]:.0f}–{values[1]:.0f}"
    assert bars.rstrip()[-1] in "▁▇"


def test_a_range_without_an_echo_is_a_word_and_no_bar(run: Run) -> None:
    run.give("u1")
    snapshot = run.snapshot()
    row = snapshot.state.sensors["u1"]
    limited = replace(row.reading.sensor, max_range=47.0)
    silent = replace(row, reading=replace(row.reading, value=math.inf, sensor=limited))
    shown = dataclasses.replace(snapshot, state=replace(snapshot.state, sensors={"u1": silent}))
    sensors = (limited, *run.engine.simulator.spec.sensors[1:])
    lines = [text_of(line.line) for line in sensor_lines(sensors, shown, 36, 17, SensorsView())]
    assert lines[1] == "u1 ↑   no echo · · ·       beyond 47"
    assert [text_of(line.line) for line in sensor_lines(sensors, shown, 13, 17, SensorsView())][1] == (
        "u1 ↑  no echo"
    )


def test_too_few_rows_leave_out_what_kinds_are_called(run: Run) -> None:
    codes = [sensor.code for sensor in run.engine.simulator.spec.sensors]
    run.give(*codes)
    assert not any("0–48" in line for line in run.sensors(13, 14))
    assert run.sensors(13, 8)[-1] == "6 more: F2"
    assert len(run.sensors(13, 8)) == 8


def test_what_was_read_last_and_what_was_picked_stand_out(run: Run) -> None:
    run.give("u1", "u4")
    view = SensorsView(chosen="u1")
    lines = sensor_lines(run.engine.simulator.spec.sensors, run.snapshot(), 36, 17, view)
    by_code = {line.code: roles(line.line) for line in lines if line.code}
    assert by_code["u1"]["u1"] == "chosen"
    assert by_code["u4"]["u4"] == by_code["u4"]["↗"] == "newest"


def test_true_values_stand_beside_readings(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    lines = run.give("u1").sensors(36, truth=True)
    assert lines[0].endswith("reading, true value")
    assert lines[1].split() == ["u1", "↑", "35.5", "in", "35.5"]
    assert lines[2].split()[:4] == ["u2", "↖", "–", "true"]


def test_a_true_value_in_a_narrow_panel_is_never_cut(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.give("u1", "u2", "u3", "c1", "g1", "d1-3", "o3", "i1", "l1")
    lines = {line.split()[0]: line.split() for line in run.sensors(13, truth=True)}
    assert lines["u1"] == ["u1", "↑", "35.5", "32"]
    assert lines["c1"] == ["c1", "↑", "0.0", "0.0"]
    assert not any("deg" in piece for line in lines.values() for piece in line)


def test_the_arrow_has_the_front_up(course_spec: SimulationSpec) -> None:
    by_code = {sensor.code: sensor for sensor in course_spec.sensors}
    assert [direction_sign(by_code[code], plain=False) for code in ("u1", "u2", "u3", "u4", "g1")] == [
        *"↑↖↓↗",
        "",
    ]
    assert [direction_sign(by_code[code], plain=True) for code in ("u1", "u2", "u3", "u4")] == [
        "F",
        "FL",
        "B",
        "FR",
    ]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "────"), (6.0, "━───"), (9.0, "━╸──"), (99.0, "━━━━"), (math.inf, "━━━━"), (math.nan, "────")],
)
def test_a_gauge_goes_from_0_to_its_end(value: float, text: str) -> None:
    assert text_of(gauge(value, 24.0, 4, plain=False)) == text


def test_the_gauges_of_a_kind_have_one_round_end() -> None:
    assert [scale_end(values, "in") for values in ([], [3.0, math.inf], [25.0], [-200.0])] == [
        24,
        24,
        48,
        384,
    ]
    assert [scale_end(values, "deg") for values in ([], [0.3], [60.0])] == [1, 0.5, 100]


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
    assert [reading_text(value) for value in (1.005, -0.5, math.inf, -math.inf, math.nan)] == [
        f"{1.005:.2f}",
        "-0.50",
        "inf",
        "-inf",
        "nan",
    ]


def test_above_the_console_stands_the_last_reply_or_in_brief_the_last_event(run: Run) -> None:
    snapshot = run.give("zz", "u1").snapshot()
    assert text_of(status_line(snapshot, (), brief=False)).startswith("last reply  u1 -> 35.")
    stopped = run.give("w1-100").snapshot()
    assert (
        text_of(status_line(stopped, (), brief=False))
        == "last reply  w1-100 -> stopped after 3.0 in by a contact  now"
    )
    brief = text_of(status_line(snapshot, snapshot.entries, brief=True))
    assert brief.startswith("00:00.0  zz      NaN  no sensor or drive has")
    assert brief.endswith("then 1 reading")


# -- events ----------------------------------------------------------------------------------


def test_movements_contacts_refusals_and_actions_have_a_line_each(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.give("u2", "w1-100", "d1-x")
    run.give("r1-5", "d1--2", source="keys")
    run.engine.perform(Action(ActionName.TELEPORT, (54.0, 42.0, 0.0)))
    lines = texts(run.log())
    assert lines[:4] == [
        "00:00.0  noise off random errors off  by console",
        "00:00.0          1 reading",
        "00:16.7  w1-100  X contact left after 3.0 in  nearest u2 said 5.3 in",
        "00:16.7  d1-x    NaN  'x' is not a finite decimal number, such as 3, -2.5 or 1e-3",
    ]
    assert lines[4].startswith("00:16.7  r1-5    ")
    assert lines[4].endswith("by keys")
    assert "back" in lines[5]
    assert lines[6].startswith("00:17.0  teleport 54 42 0 ")


def test_a_seed_is_listed_with_all_its_digits(run: Run) -> None:
    run.engine.perform(Action(ActionName.SEED, (SEEDS.high,)))
    run.engine.perform(Action(ActionName.TELEPORT, (54.125, 42.0, 1e6)))
    seed, teleport = texts(run.log())
    assert seed.startswith(f"00:00.0  seed {2**128 - 1} ")
    assert teleport.startswith("00:00.0  teleport 54.125 42 1000000 ")


def test_a_contact_is_held_against_readings_since_the_movement_before(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.give("u1", "d1-100", "r1-90", "d1-100")
    contacts = [line for line in texts(run.log()) if " X contact" in line]
    assert "nearest u1 said 35.5 in" in contacts[0]
    assert contacts[1].endswith("no sensor looked there since the last movement")
    run.give("u1", "d1-5")
    assert "nearest u1 said" in texts(run.log())[-1]
    run.engine.perform(Action(ActionName.TELEPORT, (20.0, 42.0, 0.0)))
    assert "no sensor looked there" in texts(run.give("d1-100").log())[-1]


def test_a_robot_that_keeps_meeting_a_wall_in_one_place_is_told_that_it_is_wedged(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.give(*["d1-100"] * 4)
    assert not any("wedged" in line for line in texts(run.log()))
    run.give("d1-100")
    assert texts(run.log())[-1].endswith("  wedged: back off before turning")
    # Somewhere else it has five tries again.
    run.engine.perform(Action(ActionName.TELEPORT, (20.0, 42.0, 0.0)))
    assert "wedged" not in texts(run.give("d1-100").log())[-1]


def test_readings_in_between_fold_and_are_all_counted(run: Run) -> None:
    run.give("u1", "u2").snapshot()
    run.give(*["u3"] * 5000, "d1-1", "u1")
    entries = run.snapshot().entries
    assert [text_of(entry_line(entry)).split()[1:3] for entry in (entries[0], entries[2])] == [
        ["5002", "readings"],
        ["1", "reading"],
    ]
    kept = texts(kept_lines(entries[0]))
    assert "before these are counted only" in kept[0]
    assert len(kept) < 100
    assert kept[-1].split()[1] == "u3"
    assert run.snapshot().total == 3


def test_what_a_person_types_is_not_folded(run: Run) -> None:
    run.give("u1", source="console")
    assert texts(run.log())[0].startswith("00:00.0  u1      35.")


def test_events_too_many_to_be_kept_are_counted(run: Run) -> None:
    run.give(*["zz"] * (EVENTS + 10))
    assert len(run.snapshot().entries) == EVENTS
    assert run.snapshot().total == EVENTS + 10


def test_the_last_event_in_one_line(run: Run) -> None:
    assert last_event_line(()) == ()
    run.give("u1")
    assert text_of(last_event_line(run.snapshot().entries)) == "00:00.0          1 reading"


@pytest.mark.parametrize(
    ("event", "source", "text"),
    [
        (Notice(NoticeKind.ROBOT, "robot: COM3 is open"), "robot", "00:00.0  robot   COM3 is open"),
        (Notice(NoticeKind.FAULT, "it broke"), "robot", "00:00.0  robot   it broke"),
        (Notice(NoticeKind.PROGRAM, "printed\x1b[2J"), "program", "00:00.0  program printed\\x1b[2J"),
        (
            Belief(1.0, Pose(1, 2, 3), Pose(1, 2, 3), None, (), "[b]\x07é"),
            "belief",
            "00:00.0  belief  1.0, 2.0 in  3.0 deg, off 0.0 in 0 deg  [b]\\x07é",
        ),
        (
            TwinReading(2.0, parse_command("u1"), "u1", 3.0, math.nan),
            "client",
            "00:00.0  u1      robot 3.00, simulated nan",
        ),
    ],
)
def test_other_events_in_the_log(event: Event, source: str, text: str) -> None:
    entry = LogEntry(1, 0.0, event)
    assert event_words(entry).source == source
    assert text_of(entry_line(entry)) == text


def test_only_what_people_asked_for_is_an_error_in_the_console(run: Run) -> None:
    assert refusal_of(run.give("zz").snapshot().entries) is None
    run.give("d1-", source="console")
    assert refusal_of(run.snapshot().entries) == "d1-: the value is missing, as in d1-3"
    run.give("u1", source="keys")
    assert refusal_of(run.snapshot().entries) == ""
    run.engine.perform(Action(ActionName.TIME_SCALE, (0.0,), source="console"))
    assert str(refusal_of(run.snapshot().entries)).startswith("speed: the time scale is between")


@pytest.fixture
def mission() -> Callable[..., MissionState]:
    configuration, plan = plan_run(load(bundled_sets()[MISSION_SET]), seed=7)
    simulator = Simulator(configuration.simulation, 7)
    state = Referee(plan, Reducer(checkpoint_of(simulator, mission=True))).state()

    def changed(**changes: object) -> MissionState:
        return dataclasses.replace(state, **changes)  # type: ignore[arg-type]

    return changed


def test_a_mission_lists_its_goals_and_its_time(mission: Callable[..., MissionState]) -> None:
    drop = mission().plan.drop_zone
    goals = {Goal.REACHED: 19.4, Goal.TAKEN: 33.0, Goal.DELIVERED: None}
    room = Room(36)
    assert texts(mission_lines(mission(goals=goals, time=41.0), room)) == [
        "✓ reached the loading zone   00:19.4",
        "✓ picked the block up        00:33.0",
        f"○ set it down at {drop.x:g}, {drop.y:g}",
        "time     ━━───────────── 41 of 300 s",
    ]
    late = mission_lines(mission(goals=goals, time=280.0), room)
    assert late[-1][-1][1] == "danger"
    lost = mission_lines(mission(goals=goals, result=Result.FAILED), room)
    assert text_of(lost[2]).startswith("✗ set it down")
    assert lost[2][0][1] == "danger"
    assert text_of(mission_lines(mission(goals=goals), Room(36, plain=True))[0]).startswith("+ reached")


@pytest.mark.parametrize("believed", [False, True])
def test_a_failure_and_its_contacts_stay_on_a_narrow_screen(
    run: Run, mission: Callable[..., MissionState], believed: bool
) -> None:
    if believed:
        run.engine.tell(Belief(0.0, Pose(26.5, 46.0, 350.0), Pose(9.5, 42.0, 0.0), 2.0))
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.engine.perform(Action(ActionName.TELEPORT, (15.5, 42.0, -170.0)))
    failed = mission(result=Result.FAILED, reason="1 contact with a wall, 0 allowed", contacts=1)
    snapshot = dataclasses.replace(run.give("d1-100").snapshot(), mission=failed)
    line = text_of(pose_line(snapshot, Room(80, plain=False, pointer=":why :report")))
    assert "1 contact  FAILED :why" in line
    assert len(line) <= 80
    wide = text_of(pose_line(snapshot, Room(160, plain=False, pointer=":why :report")))
    assert "1 contact  failed: 1 contact with a wall, 0 allowed :why :report" in wide
    assert ":why" not in text_of(pose_line(snapshot, Room(80, plain=False))), "a replay has no such order"
    going = dataclasses.replace(snapshot, mission=mission())
    assert "1 contact  " in text_of(pose_line(going, Room(80, plain=False)))
    assert "s left" in text_of(pose_line(going, Room(80, plain=False)))


@pytest.mark.parametrize(
    ("number", "text"), [(1, "1 contact   9.5 in driven"), (2, "2 contacts   9.5 in driven")]
)
def test_a_success_counts_contacts_and_commands(
    run: Run, mission: Callable[..., MissionState], number: int, text: str
) -> None:
    done = mission(result=Result.SUCCESS, contacts=number, distance=9.5, commands=1200 * number - 1199)
    answer = end_answer(dataclasses.replace(run.snapshot(), mission=done), orders=False)
    assert answer is not None
    assert texts(answer.lines)[1:] == [text, "1 command" if number == 1 else "1,201 commands"]


def test_a_success_in_three_rows_has_numbers_and_goals(
    run: Run, mission: Callable[..., MissionState]
) -> None:
    """Row 0 has the outcome and the time."""
    goals = {Goal.REACHED: 19.4, Goal.TAKEN: 33.0, Goal.DELIVERED: 63.8}
    spent = TimeSpent(46.0, 11.0, {"u1": 7.0})
    done = mission(
        result=Result.SUCCESS, goals=goals, contacts=0, distance=213.1, commands=238, spent=spent, time=63.8
    )
    answer = end_answer(dataclasses.replace(run.snapshot(), mission=done), orders=True)
    assert answer is not None
    shown = texts(answer.shown(Room(80, rows=3)))
    assert [line.strip() for line in shown] == [
        "0 contacts   213.1 in driven   238 commands   drive 46 s  sense 7 s  link 11 s",
        "✓ loading zone 00:19   ✓ picked up 00:33   ✓ delivered 01:03",
        ":report page  R again",
    ]
    assert max(map(len, texts(answer.shown(Room(36, rows=9))))) <= 36


def test_the_time_spent_stands_still_once_the_mission_is_over(
    run: Run, mission: Callable[..., MissionState]
) -> None:
    done = mission(result=Result.FAILED, reason="1 contact", spent=TimeSpent(1.0, 2.0, {"u1": 3.0}))
    run.give("d1-5", "u1")
    snapshot = dataclasses.replace(run.snapshot(), mission=done)
    assert texts(run_lines(snapshot, Room(36)))[-1].split() == ["drive", "1", "sense", "3", "link", "2", "s"]


def test_the_end_of_a_mission_outlasts_that_its_program_left(run: Run) -> None:
    text = "mission: failed after 0.3 s, 2.9 in, 1 command, 1 contact: 1 contact with a wall, 0 allowed"
    run.engine.tell(MissionEvent(0.3, Result.FAILED, text, "1 contact with a wall, 0 allowed"))
    run.engine.tell(Notice(NoticeKind.LEFT, "client a left", "a"))
    told = text_of(last_event_line(run.snapshot().entries))
    assert told.startswith("00:00.3  mission failed: 1 contact with a wall, 0 allowed  after 0.3 s, 2.9 in")
    run.give("r1-5")
    assert "turned" in text_of(last_event_line(run.snapshot().entries))
    run.engine.tell(MissionEvent(9.0, Result.SUCCESS, "mission: success after 9.0 s, no contact"))
    assert "mission success after 9.0 s" in text_of(last_event_line(run.snapshot().entries))


def test_where_the_time_went_is_on_the_screen(course_spec: SimulationSpec) -> None:
    slow = tuple(replace(each, read_time=0.06 if each.code == "u1" else 0.01) for each in course_spec.sensors)
    run = Run(replace(course_spec, sensors=slow))
    assert texts(run_lines(run.snapshot(), Room(36)))[:2] == [
        "spent    " + 27 * "─",
        "         drive 0  sense 0  link 0 s",
    ]
    snapshot = run.give("d1-60", *["u1"] * 20, "u2").snapshot()
    bar, words = run_lines(snapshot, Room(36))[:2]
    assert [role for _, role in bar] == ["label", "driving", "sensing", "link"]
    assert len(text_of(bar)) == 36
    assert text_of(words).split() == ["drive", "10", "sense", "1", "link", "0", "s"]


def test_contacts_after_the_end_of_a_mission_are_counted_apart(
    run: Run, mission: Callable[..., MissionState]
) -> None:
    """The answer counts those of the mission: no two numbers on the screen may differ for the same word."""
    failed = mission(result=Result.FAILED, reason="1 contact with a wall, 0 allowed", contacts=1)
    run.give("d1-100")
    snapshot = dataclasses.replace(run.give("d1--3", "d1-100").snapshot(), mission=failed)
    assert snapshot.state.contacts == 2
    for rows in (3, 4, 6):
        shown = "\n".join(map(text_of, robot_lines(snapshot, Room(60, rows))))
        assert re.search("contacts +1, later 1", shown)
    assert "1 contact, later 1" in text_of(pose_line(snapshot, Room(110)))
    answer = end_answer(snapshot, orders=False)
    assert answer is not None
    drove_on = f"then it drove on, until {clock_text(snapshot.state.time)}"
    assert drove_on in texts(list(answer.lines))
    at_end = dataclasses.replace(snapshot, mission=dataclasses.replace(failed, commands=3))
    answer = end_answer(at_end, orders=False)
    assert answer is not None
    assert drove_on not in texts(list(answer.lines))


def role_of(run: Run, code: str, width: int = 36) -> tuple[str, str]:
    """Role of a sensor's value, and the text of its row."""
    view = SensorsView()
    lines = sensor_lines(run.engine.simulator.spec.sensors, run.snapshot(), width, 17, view)
    line = next(line.line for line in lines if line.code == code)
    return next(role for text, role in line if any(map(str.isdigit, text)) and text.strip() != code), text_of(
        line
    )


@pytest.mark.parametrize(
    ("movement", "is_old"), [("d1-0.5", False), ("d1-3", True), ("r1-3", False), ("r1-30", True)]
)
def test_a_reading_from_before_a_movement_is_dim(run: Run, movement: str, is_old: bool) -> None:
    """More than 1 in or 5 degrees: what it says need not be there any more."""
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    assert role_of(run.give("c1", "u1"), "u1")[0] == "newest"
    run.give(movement)
    assert [role_of(run, code)[0] == "dim" for code in ("c1", "u1")] == [is_old, is_old]
    assert role_of(run.give("u1"), "u1")[0] == "newest"


@pytest.mark.parametrize("width", [13, 36, 51])
def test_an_old_reading_says_its_age(run: Run, width: int) -> None:
    """Only time in which something has moved counts, and none after the end."""
    run.give("c1", "u1")
    assert not re.search(r"\ds\b", role_of(run, "u1", width)[1])
    run.give(*("d1-6", "d1--6") * 4)
    row, age = run.snapshot().state.sensors["u1"], run.snapshot().state.time
    seconds = f"{age - row.time:.0f}s"
    assert seconds in role_of(run, "u1", width)[1]
    assert width == 13 or seconds in role_of(run, "c1", width)[1]
    verdict = Verdict(
        outcome=Outcome.ENDED, text="", elapsed=0.0, line=0, program=ProgramEnded(row.time + 0.5, 0)
    )
    assert age_of_reading(row, dataclasses.replace(run.snapshot(), verdict=verdict)) in (None, 0.5)


@pytest.mark.parametrize(("code", "phase"), [(0, RunPhase.ENDED), (3, RunPhase.FAILURE)])
def test_a_program_that_ends_with_an_exit_code_has_failed(run: Run, code: int, phase: RunPhase) -> None:
    verdict = Verdict(
        outcome=Outcome.ENDED, text="Ended.", elapsed=7.0, line=0, program=ProgramEnded(7.0, code)
    )
    run.give("u1")
    snapshot = dataclasses.replace(run.snapshot(), verdict=verdict)
    assert phase_of(snapshot, {}) is phase
    answer = end_answer(snapshot, orders=True)
    assert answer is not None
    assert (answer.lines[0][0][1] == "danger") is (code != 0)
