"""Descriptions of values, kept: columns, kinds, defaults and rules; and what small functions of them give."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from msgspec import NODEFAULT, Struct
from msgspec.structs import fields, replace

from simmer_tui.errors import printable
from simmer_tui.sim import columns, fingerprint, rules
from simmer_tui.sim.angles import eighth_of_turn
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.command import WORD, Command, counted, cut, first_of
from simmer_tui.sim.noise import RandomBias, random_bias
from simmer_tui.sim.path import Path as Way
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import (
    CommandResult,
    Grip,
    LidarScan,
    RangeScan,
    Reading,
    Status,
    VelocityChange,
)
from simmer_tui.sim.sensors import LidarSpec, Sensor, sensor_kinds
from simmer_tui.sim.specs import (
    Axes,
    DriveKind,
    DriveSpec,
    GripperSpec,
    MazeSpec,
    RobotSpec,
    SensorSpec,
    SimulationSpec,
    VelocityKind,
    VelocitySpec,
    WheelsSpec,
)
from simmer_tui.sim.trajectory import Trajectory
from simmer_tui.sim.values import CourseRule, Value, described, with_values
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_descriptions.json")


def test_columns_are_those_that_were_kept() -> None:
    every = {name: each for name, each in vars(columns).items() if isinstance(each, CsvColumn)}
    lists = {
        name: [column.name for column in each]
        for name, each in vars(columns).items()
        if isinstance(each, tuple) and all(isinstance(column, CsvColumn) for column in each)
    }
    assert_kept({"columns": every, "axes": columns.DRIVE_AXES, "lists": lists}, KEPT, "columns")
    rounded = [(each.name, repr(each.rule)) for each in (*every.values(), *columns.DRIVE_AXES)]
    assert_kept(rounded, KEPT, "rules of columns")


def test_kinds_are_those_that_were_kept() -> None:
    said: tuple[str, ...] = (
        "name",
        "meaning",
        "unit",
        "is_range",
        "is_yes_or_no",
        "is_scan",
        "counts",
        "is_heading",
    )
    said += (
        "detects_block",
        "detects_floor",
        "dialect_functions",
        "devices",
        "is_opaque",
        "any_columns",
        "spec_type",
    )
    said += ("missed", "pings", "least_error")
    found = {}
    for kind in sensor_kinds().values():
        assert issubclass(kind, Sensor)
        found[kind.name] = {each: getattr(kind, each) for each in said}
        found[kind.name]["columns"] = [
            (column.name, column.default, column.needed) for column in kind.columns
        ]
        priors = (*kind.parameters, *kind.noise_scales)
        found[kind.name]["priors"] = priors
        found[kind.name]["has"] = [kind.has(field) for field in ("x", "z", "wrap", "ticks_per_inch", "noon")]
        row = kind.spec_type(kind=kind, number=2, code="c2", analog=kind.name == "ir")
        found[kind.name]["row"] = [
            row.id,
            row.unit,
            row.is_yes_or_no,
            replace(row, analog=False).is_yes_or_no,
        ]
    assert_kept(found, KEPT, "kinds")


def test_defaults_are_those_that_were_kept() -> None:
    structs: tuple[type[Struct], ...] = (
        *(SensorSpec, LidarSpec, Axes, DriveSpec, GripperSpec, VelocitySpec, WheelsSpec, SimulationSpec),
        *(MazeSpec, RobotSpec, Command, Reading, Grip, VelocityChange, CommandResult, CsvColumn, Value),
    )
    found = {
        each.__name__: {field.name: field.default for field in fields(each) if field.default is not NODEFAULT}
        for each in structs
    }
    assert_kept(found, KEPT, "defaults")


def test_drives_and_velocities_are_those_that_were_kept() -> None:
    drives = [
        (kind.value, kind.direction, kind.meaning, kind.turns, kind.unit, kind.verb) for kind in DriveKind
    ]
    velocities = [(kind.value, kind.values) for kind in VelocityKind]
    robots = (RobotSpec.circle(7), RobotSpec.rectangle(6, 4), RobotSpec.polygon(((3, 4), (-6, 1), (0, -2))))
    maze = MazeSpec(((1, 1, 0), (1, 1, 1)))
    found = {
        "drives": drives,
        "velocities": velocities,
        "statuses": [status.value for status in Status],
        "robots": [(robot, robot.reach) for robot in robots],
        "maze": [maze.rows, maze.columns, maze.width, maze.height],
        "eighths": [
            eighth_of_turn(each) for each in (-720, -181, -45, -23, 0, 22, 23, 90, 200, 337, 338, 405)
        ],
    }
    assert_kept(found, KEPT, "kinds of motion")


# -- rules ---------------------------------------------------------------------------------------------

RULES: dict[str, rules.Rule[Any]] = {
    "several": rules.SeveralRule(("binary", "packets", "text")),
    "names": rules.NamesRule(),
    "text": rules.TextRule(),
    "perhaps blank": rules.TextRule(blank=True),
    "raw": rules.RawTextRule(),
    "short": rules.RawTextRule(3),
    "pair": rules.PairRule(),
    "word or number": rules.WordOrRule(("off", "all"), (0.0, math.inf), other=rules.NumberRule(2, 5)),
    "port": rules.PortOrOffRule(),
}
GIVEN: tuple[Any, ...] = (
    *(
        "",
        " ",
        "a",
        " a b ",
        "binary",
        "Binary, text",
        "text,text,binary",
        "packts",
        "a\nb",
        "é",
        "off",
        " OFF ",
    ),
    *(
        "ALL",
        "2",
        "1",
        "5.0",
        "65535",
        "65536",
        "0",
        "-1",
        "1,2",
        "1,",
        "1,2,3",
        "x" * 255,
        "x" * 256,
        "x" * 257,
    ),
    *(
        ["text", "text"],
        ["binary", 3],
        [],
        (),
        ("a", "", "a", "b"),
        ["a\n"],
        [1, 2],
        [1, True],
        [1, math.inf],
    ),
    *(
        ["x" * 256],
        True,
        False,
        0,
        1,
        2,
        5,
        5.5,
        None,
        {"a": 1},
        {},
        ["a", {}],
        ["a", ["b"]],
        65535,
        65536,
        0.0,
    ),
)


@pytest.mark.parametrize("name", RULES)
def test_a_rule_takes_and_refuses_what_it_did(name: str) -> None:
    rule = RULES[name]
    found: list[Any] = [rule.allowed, rule.metavar, rule.schema]
    for given in GIVEN:
        for take in (rule.check, rule.from_text) if isinstance(given, str) else (rule.check,):
            try:
                taken = take(given)
                found.append([type(taken).__name__, taken, rule.plain(taken), rule.shown(taken)])
            except ValueError as error:
                found.append(str(error))
    assert_kept(found, KEPT, f"rule {name}")


def test_the_first_texts_are_named_and_the_others_counted() -> None:
    assert [first_of(texts, 2) for texts in ("", "a", "ab", "abc", "abcd")] == [
        *("", "a", "a, b", "a, b and 1 more", "a, b and 2 more")
    ]


def test_one_thing_is_counted_in_the_singular() -> None:
    assert [counted(number, "run") for number in (0, 1, 2)] == ["0 runs", "1 run", "2 runs"]


def test_a_message_shortens_what_it_shows() -> None:
    """A text from 41 characters on, a list from 5, a whole number from 31 digits."""
    assert rules.describe("x" * 40) == f'"{"x" * 40}"'
    assert rules.describe("x" * 41) == f'"{"x" * 37}..."'
    assert rules.describe([1, 2, 3, True]) == "[1, 2, 3, true]"
    assert rules.describe((1, 2, 3, 4, 5)) == "a list of 5 values"
    assert rules.describe([(1,)]) == "a list of 1 value"
    assert rules.describe(10**30 - 1) == "9" * 30
    assert rules.describe(-(10**30)) == rules.describe(10**30) == "a far larger whole number"
    assert rules.describe({}) == "a table"
    assert rules.describe(1.5) == "1.5"
    assert cut("x" * 120) == "x" * 120
    assert cut("x" * 121) == "x" * 117 + "..."
    assert cut("x" * 41, WORD) == "x" * 37 + "..."
    assert printable("é°\x1b\u202e") == "é°\\x1b\\u202e"
    # A command that is to be typed names the file as it is; a byte that is no UTF-8 has no character.
    assert printable("/home/zoë/Übung 1/log.jsonl") == "/home/zoë/Übung 1/log.jsonl"
    assert printable("a\x1b[2J\u202e\udcff") == "a\\x1b[2J\\u202e\\xff"
    most = "9" * 39  # the digits of the longest seed
    for text, number in ((most, int(most)), ("+" + most, int(most)), ("-5", -5)):
        assert rules.IntegerRule(-5, 10**40).from_text(text) == number
    with pytest.raises(ValueError, match="must be a whole number"):
        rules.IntegerRule(-5, 10**40).from_text(most + "9")


def test_a_word_is_suggested_whatever_its_case_and_length() -> None:
    known = ("Strength", "num_segments", "x" * 200)
    assert rules.did_you_mean("STRENGHT", known) == '; did you mean "Strength"?'
    assert rules.did_you_mean("numsegments", known) == '; did you mean "num_segments"?'
    assert rules.did_you_mean("zzz", known) == ""
    assert rules.did_you_mean("x" * 5000, known) == f'; did you mean "{"x" * 200}"?'
    assert [rules.listed(words) for words in ("a", "ab", "abc")] == ["a", "a or b", "a, b or c"]
    with pytest.raises(ValueError, match=r'must be "drive" or "stop", not "stp"; did you mean "stop"\?$'):
        rules.ChoiceRule(("drive", "stop")).check("stp")


# -- small functions -----------------------------------------------------------------------------------


def test_a_value_takes_its_name_and_default_from_its_field() -> None:
    notes = {
        "speed": Annotated[float, Value(rules.NumberRule(0), "how fast", "in/s")],
        "size": float,
        "start_lag": Annotated[float, Value(rules.NumberRule(0), noun="lag", course=CourseRule.FREE)],
    }
    made = type("Made", (), {"__annotations__": notes, "speed": 6.0, "size": 1.0, "start_lag": 0.5})
    speed, lag = described(made())
    assert (speed.name, speed.field, speed.default, speed.unit, speed.help) == (
        *("speed", "speed", 6.0, "in/s", "how fast"),
    )
    assert (lag.name, lag.field, lag.default, lag.course) == ("start_lag", "start_lag", 0.5, CourseRule.FREE)
    assert [each.shown for each in (speed, lag, replace(lag, noun=""))] == ["speed", "lag", "start lag"]
    assert speed.with_unit("too fast") == "too fast (unit: in/s)"
    assert lag.with_unit("too late") == "too late"


def test_values_are_set_by_field_and_inside_a_field() -> None:
    drive = DriveSpec(kind=DriveKind.UP, code="w1", error=Axes(1.0, 2.0, 3.0))
    changed = with_values(drive, {"error.x": 5.0, "gain": 2.0, "error.r": 7.0, "bias.y": 9.0})
    assert changed == replace(drive, error=Axes(5.0, 2.0, 7.0), gain=2.0, bias=Axes(0.0, 9.0, 0.0))


def test_a_random_bias_is_a_mapping_of_the_same_numbers() -> None:
    bias = RandomBias(5, (0.1, 2.0))
    drawn = random_bias(5, (0.1, 2.0))
    assert dict(bias) == drawn
    assert (len(bias), list(bias), repr(bias)) == (len(DriveKind), list(DriveKind), repr(drawn))


def results() -> Iterator[CommandResult]:
    """Results of commands of each sort."""
    pose, command = Pose(1.006, -2.004, 359.96), Command("u1\x1b" + "x" * 60, "u1", "3")
    plain = CommandResult(7, 12.346, command, Status.READING, 3.25, Pose(0, 0, 0), pose, waits=0.7)
    sensor = SensorSpec(kind=sensor_kinds()["ultra"], number=1, code="u1")
    reading = Reading(sensor, 3.25, 3.0, RangeScan((0, 0), (0.0,), (3.0,)), 0.4)
    empty = np.zeros(1)
    scan = LidarScan(0, np.array((5.0, 6.0)), empty, empty, empty)
    path = Way.of_segments(Pose(0, 0, 0), 1, 0, 0, 2)
    movement = Trajectory(path, DriveKind.RIGHT, Axes(2.0), 1.0, 0.9)
    yield plain
    yield replace(plain, reading=reading)
    yield replace(plain, reading=replace(reading, scan=scan))
    yield replace(plain, trajectory=movement)
    yield replace(plain, reply=math.nan, status=Status.BUSY)


def test_a_result_says_its_duration_ranges_and_itself_on_a_line() -> None:
    found = [(each.duration, each.ranges is not None, each.contact, repr(each)) for each in results()]
    assert_kept(found, KEPT, "results")


def test_a_fingerprint_is_of_the_functions_that_a_simulation_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its bytes differ from machine to machine in their last bits only."""
    hashed: list[np.ndarray] = []

    class Recorder:
        def update(self, data: bytes) -> None:
            hashed.append(np.frombuffer(data, "<f8"))

        def hexdigest(self) -> str:
            return "0123456789abcdef0123456789abcdef"

    monkeypatch.setattr(hashlib, "sha256", Recorder)
    assert fingerprint.math_fingerprint.__wrapped__() == "0123456789abcdef"
    # Of 16,000 numbers, tangents among them, a sum is that of the largest alone.
    found = [(len(each), each[:: len(each) // 20], np.tanh(each).sum()) for each in hashed]
    assert_kept(found, KEPT, "fingerprint")
