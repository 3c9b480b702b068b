"""What the panels say, as strings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.sets import MISSION_SET, bundled_sets
from simmer_tui.config.settings import ServerSettings
from simmer_tui.engine import Engine
from simmer_tui.events import (
    Action,
    ActionName,
    Belief,
    Event,
    MissionEvent,
    Notice,
    NoticeKind,
    Result,
    TwinReading,
)
from simmer_tui.mission import MissionState, Referee, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, SimulationSpec, Simulator, parse_command
from simmer_tui.snapshot import EVENTS, LogEntry, Recorder, Snapshot
from simmer_tui.tui.event_text import (
    clock,
    complaint_of,
    entry_line,
    kept_lines,
    last_event_line,
    words_of,
)
from simmer_tui.tui.line_panel import StyledLine, text_of
from simmer_tui.tui.readouts import (
    Room,
    first_steps,
    header_line,
    link_lines,
    mission_lines,
    pose_line,
    robot_lines,
    run_lines,
    status_line,
)
from simmer_tui.tui.sensor_readouts import (
    SensorsView,
    gauge,
    number_text,
    range_role,
    rows_wanted,
    scale_end,
    sensor_lines,
    sparkline,
    way,
)
from simmer_tui.tui.terminal import GlyphMode


class Run:
    """A simulator whose recorder is asked for snapshots."""

    def __init__(self, spec: SimulationSpec) -> None:
        self.engine = Engine(Simulator(spec, 5))
        fold = Reducer(checkpoint_of(self.engine.simulator))
        self.recorder = Recorder(self.engine, fold)
        self.engine.watch(fold.apply)
        self.engine.watch(self.recorder.watch)
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
        "pose     9.5, 42.0 in  0.0 deg E",
        "belief   none told",
        "state    standing   driven 0.0 in",
        "contacts 0",
        "block    lies at 25.0, 41.0 in",
    ]


def test_the_robot_panel_after_a_contact(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    lines = robot_lines(run.give("w1-100").snapshot(), Room(36, plain=False))
    assert texts(lines)[1:5] == [
        "pose     9.5, 45.0 in  0.0 deg →",
        "belief   none told",
        "state    at a wall   driven 3.0 in",
        "contacts 1, last 00:00.5",
    ]
    assert roles(lines[3])["at a wall"] == "danger"
    assert roles(lines[4])["1, last 00:00.5"] == "danger"


@pytest.mark.parametrize("heading", [350.0, -10.0, 710.0])
def test_people_read_headings_from_minus_180_to_180(run: Run, heading: float) -> None:
    run.engine.perform(Action(ActionName.TELEPORT, (20.0, 42.0, heading)))
    assert "-10.0 deg" in texts(robot_lines(run.snapshot(), Room(36, plain=True)))[1]
    assert "-10.0 deg" in text_of(pose_line(run.snapshot(), Room(80, plain=True)))
    run.engine.perform(Action(ActionName.TELEPORT, (20.0, 42.0, -180.0)))
    assert " 180.0 deg" in text_of(pose_line(run.snapshot(), Room(80, plain=True)))


def test_how_far_a_belief_is_off_is_always_said(run: Run) -> None:
    run.engine.tell(Belief(0.0, Pose(6.5, 46.0, 350.0), Pose(9.5, 42.0, 0.0), 2.0))
    assert (
        texts(robot_lines(run.snapshot(), Room(36, plain=True)))[2] == "belief   off 5.0 in 10 deg, spread 2"
    )
    line = text_of(pose_line(run.snapshot(), Room(80, plain=True)))
    assert line.startswith(" pose 9.5, 42.0 in  0.0 deg E  belief off 5.0 in 10 deg")
    assert line.endswith("0 contacts ")
    assert len(line) == 80


@pytest.mark.parametrize("width", [40, 60, 80, 110])
def test_the_pose_line_fits_any_width(run: Run, width: int) -> None:
    run.engine.tell(Belief(0.0, Pose(6.5, 46.0, 350.0), Pose(9.5, 42.0, 0.0), 2.0))
    assert len(text_of(pose_line(run.snapshot(), Room(width, plain=True)))) <= width


def test_the_header_says_who_drives_and_when_it_is(run: Run) -> None:
    narrow = text_of(header_line(run.snapshot(), Room(80, plain=True, name="maze", pace="pace 4x")))
    assert narrow == " SimMeR  maze                                   o no client   pace 4x   00:00.0 "
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "127.0.0.1:5"))
    run.engine.perform(Action(ActionName.PAUSE))
    wide = text_of(header_line(run.snapshot(), Room(120, plain=False, name="maze", pace="pace 4x")))
    assert "● client 127.0.0.1:5  0 commands/s   pace 4x   PAUSED   seed 5   00:00.0 " in wide
    for width in range(20, 130):
        assert (
            len(text_of(header_line(run.snapshot(), Room(width, plain=True, name="maze", pace="pace 4x"))))
            <= width
        )


def test_the_clock_counts_minutes() -> None:
    assert [clock(each) for each in (0.0, 59.96, 95.25, -3.0, 6000.0)] == [
        "00:00.0",
        "01:00.0",
        "01:35.2",
        "-00:03.0",
        "100:00.0",
    ]


# -- sensors ---------------------------------------------------------------------------------


def test_sensors_never_read_fold_into_one_line(run: Run) -> None:
    assert run.sensors(50) == ["never read u1-5 i1-4 o1-4 c1 g1 t1"]
    assert run.sensors(13) == ["unread u1-5", "i1-4 o1-4 c1", "g1 t1"]
    assert run.give("u2").sensors(36)[-2:] == ["never read u1 u3-5 i1-4 o1-4 c1 g1", "t1"]


def test_in_brief_sensors_have_way_value_and_gauge(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    codes = [sensor.code for sensor in run.engine.simulator.spec.sensors]
    assert run.give(*codes).sensors(13) == [
        "ultra in 0-48",
        "u1 ↑ 35.5 ━━─",
        "u2 ↖  5.3 ╸──",
        "u3 ↓  6.5 ╸──",
        "u4 ↗ 16.8 ━──",
        "u5 ↑ 11.0 ╸──",
        "tof   in 0-48",
        "t1 ↑ 44.0 ━━━",
        "line  0 0 1 1",
        "odom  in 0-24",
        "o1 ←  0.0 ───",
        "o2 ←  0.0 ───",
        "o3 ↑  0.0 ───",
        "o4 ↑  0.0 ───",
        "c1 ↑  0.0 deg",
        "g1    0.0 deg",
    ]
    assert len(run.sensors(13)) == rows_wanted(run.engine.simulator.spec.sensors)


def test_in_full_there_are_units_history_and_its_range(run: Run) -> None:
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.give("u1", "d1-10", "u1", "u4")
    full = run.sensors(36)
    assert full[0] == "ultrasonic ─────────── gauge 0-48 in"
    assert full[1] == "u1 ↑  25.5 in ━━━━────      ▇▁ 26-36"
    plain = run.sensors(36, glyphs=GlyphMode.ASCII)
    assert plain[1] == "u1F   25.5 in ====....      #. 26-36"
    assert all(line.isascii() for line in plain)


def test_too_few_rows_leave_out_what_kinds_are_called(run: Run) -> None:
    codes = [sensor.code for sensor in run.engine.simulator.spec.sensors]
    run.give(*codes)
    assert not any("0-48" in line for line in run.sensors(13, 14))
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
    assert lines[2].split()[:3] == ["u2", "↖", "–"]


def test_the_arrow_has_the_front_up(course_spec: SimulationSpec) -> None:
    by_code = {sensor.code: sensor for sensor in course_spec.sensors}
    assert [way(by_code[code], plain=False) for code in ("u1", "u2", "u3", "u4", "g1")] == [*"↑↖↓↗", ""]
    assert [way(by_code[code], plain=True) for code in ("u1", "u2", "u3", "u4")] == ["F", "FL", "B", "FR"]


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
    assert [number_text(value) for value in (1.005, -0.5, math.inf, -math.inf, math.nan)] == [
        f"{1.005:.2f}",
        "-0.50",
        "inf",
        "-inf",
        "nan",
    ]


def test_the_run_panel_names_client_rate_and_ports(run: Run) -> None:
    ports = {"commands": 9000, "replies": 9001, "beliefs": 9002}
    assert texts(link_lines(run.snapshot(), ports)) == [
        "client   waiting",
        "ports 9000 commands, 9001 replies",
        "      9002 beliefs",
    ]
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "127.0.0.1:5"))
    lines = texts(run_lines(run.snapshot(), Room(36, ports=ports, plain=True)))
    assert lines[0].startswith("run ---")
    assert lines[1] == "client   127.0.0.1:5"
    run.engine.tell(Notice(NoticeKind.LEFT, "client a left", "127.0.0.1:5"))
    assert "waiting" in texts(link_lines(run.snapshot(), ports))[0]


def test_before_the_first_client_it_is_said_what_to_run() -> None:
    def run(settings: ServerSettings | None = None, **ports: int) -> str:
        named = {name.replace("_", " "): port for name, port in ports.items()}
        return text_of(first_steps(named, settings or ServerSettings(), "d1-3", "w a s d").lines[0])

    begins = 'run python -c "from simmer_tui import Robot; Robot('
    assert run(commands=9000, replies=9001, beliefs=9002) == begins + ").send('d1-3')\""
    assert run(commands=5000, replies=5001) == begins + "port=5000).send('d1-3')\""
    assert run(commands=9000, replies=5001) == begins + "reply_port=5001).send('d1-3')\""
    assert run(ServerSettings(reply_format="float32"), commands=9000, replies=9001) == (
        begins + "reply_format='float32').send('d1-3')\""
    )
    assert run(packets=61200, packet_replies=61201) == begins + "protocol='packets').send('d1-3')\""
    assert run(packets=5, packet_replies=6) == (
        begins + "protocol='packets', port=5, reply_port=6).send('d1-3')\""
    )
    assert "w a s d" in text_of(first_steps({}, ServerSettings(), "d1-3", "w a s d").lines[1])


def test_above_the_console_stands_the_last_reply_or_in_brief_the_last_event(run: Run) -> None:
    snapshot = run.give("zz", "u1").snapshot()
    assert text_of(status_line(snapshot, (), brief=False)).startswith("last reply  u1 -> 35.")
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
        "00:00.0  noise 0 noise off  by console",
        "00:00.0          1 reading",
        "00:16.7  w1-100  X contact left after 3.0 in  nearest u2 said 5.3 in",
        "00:16.7  d1-x    NaN  'x' is not a finite decimal number, such as 3, -2.5 or 1e-3",
    ]
    assert lines[4].startswith("00:16.7  r1-5    ")
    assert lines[4].endswith("by keys")
    assert "back" in lines[5]
    assert lines[6].startswith("00:17.0  teleport 54 42 0 ")


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
    assert run.snapshot().told == 3


def test_what_a_person_types_is_not_folded(run: Run) -> None:
    run.give("u1", source="console")
    assert texts(run.log())[0].startswith("00:00.0  u1      35.")


def test_events_too_many_to_be_kept_are_counted(run: Run) -> None:
    run.give(*["zz"] * (EVENTS + 10))
    assert len(run.snapshot().entries) == EVENTS
    assert run.snapshot().told == EVENTS + 10


def test_the_last_event_in_one_line(run: Run) -> None:
    assert last_event_line(()) == ()
    run.give("u1")
    assert text_of(last_event_line(run.snapshot().entries)) == "00:00.0          1 reading"


@pytest.mark.parametrize(
    ("event", "source", "text"),
    [
        (Notice(NoticeKind.FAULT, "it broke"), "robot", "00:00.0  robot   it broke"),
        (Notice(NoticeKind.PROGRAM, "printed\x1b[2J"), "program", "00:00.0  program printed\\x1b[2J"),
        (
            Belief(1.0, Pose(1, 2, 3), Pose(1, 2, 3), None, (), "[b]\x07é"),
            "belief",
            "00:00.0  belief  1.0, 2.0 in  3.0 deg, off 0.0 in 0 deg  [b]\\x07\\xe9",
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
    assert words_of(entry).source == source
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
    state = Referee(plan, Reducer(checkpoint_of(simulator, mission=True))).state()

    def changed(**changes: object) -> MissionState:
        return dataclasses.replace(state, **changes)  # type: ignore[arg-type]

    return changed


def test_a_mission_shows_the_time_left_and_the_next_goal(mission: Callable[..., MissionState]) -> None:
    state = mission()
    assert texts(mission_lines(state)) == [
        f"mission  {state.plan.time_limit:.0f} s left ──────",
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


@pytest.mark.parametrize("believed", [False, True])
def test_a_failure_and_its_contacts_stay_on_a_narrow_screen(
    run: Run, mission: Callable[..., MissionState], believed: bool
) -> None:
    if believed:
        run.engine.tell(Belief(0.0, Pose(26.5, 46.0, 350.0), Pose(9.5, 42.0, 0.0), 2.0))
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.engine.perform(Action(ActionName.TELEPORT, (15.5, 42.0, -170.0)))
    failed = mission(result=Result.FAILED, reason="1 contact with a wall, 0 allowed")
    snapshot = dataclasses.replace(run.give("d1-100").snapshot(), mission=failed)
    line = text_of(pose_line(snapshot, Room(80, plain=False, pointer=":why :report")))
    assert "1 contact  FAILED :why" in line
    assert len(line) <= 80
    wide = text_of(pose_line(snapshot, Room(160, plain=False, pointer=":why :report")))
    assert "1 contact  failed: 1 contact with a wall, 0 allowed :why :report" in wide
    assert ":why" not in text_of(pose_line(snapshot, Room(80, plain=False))), "a replay has no such order"
    panel = texts(
        run_lines(snapshot, Room(36, ports={"commands": 9000}, plain=False, pointer=":why :report"))
    )
    assert "reasons  :why :report" in panel
    assert len(panel) <= 6
    going = dataclasses.replace(snapshot, mission=mission())
    assert "1 contact  " in text_of(pose_line(going, Room(80, plain=False)))
    assert "s left" in text_of(pose_line(going, Room(80, plain=False)))


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
    assert not [
        line for line in texts(run_lines(run.snapshot(), Room(60, ports={}, plain=True))) if "drive" in line
    ]
    snapshot = run.give("d1-2", "u1", "u2", "u1").snapshot()
    (told,) = [line for line in texts(run_lines(snapshot, Room(60, ports={}, plain=True))) if "drive" in line]
    assert told.split() == ["time", "drive", "0.3", "s,", "read", "0.1", "(u1", "0.1),", "link", "0.0"]
    assert "read 0.1 (u1 0.1)" in text_of(pose_line(snapshot, Room(160, plain=True)))
    assert "drive 0 read 0 u1 link 0 s" in text_of(pose_line(snapshot, Room(105, plain=True)))
    assert "read" not in text_of(pose_line(snapshot, Room(80, plain=True)))
