"""A lidar's code in a dialect: a list, and behind ray and scan its readings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.dialect.device import DialectDevice
from simmer_tui.dialect.dialect_rules import Parts
from simmer_tui.dialect.expressions import MOST_STEPS, Expression, FieldValue
from simmer_tui.dialect.inverse import InverseRules
from simmer_tui.dialect.messages import dictionary
from simmer_tui.errors import ExpressionError, Problem
from simmer_tui.grade.course import Rules
from simmer_tui.grade.robot_rules import rule_problems

COURSE = load(find_set("lidar"))
LIDAR = replace(COURSE.simulation.sensors[0], rays=4)
RANGES = (10.0, 20.0, 30.0, 40.0)
"""Ahead, to the right, behind, to the left: it turns clockwise."""


class Robot:
    """A robot whose lidar says always the same."""

    now = 0.0

    def __init__(self) -> None:
        self.sent = b""
        self.faults: list[str] = []
        self.codes: list[tuple[str, ...]] = []

    def read(self, codes: Sequence[str], done: Callable[[Mapping[str, FieldValue]], None]) -> None:
        self.codes.append(tuple(codes))
        done({code: RANGES if code == "sc" else 5.0 for code in codes})

    def send(self, data: bytes, *, droppable: bool = False) -> None:
        self.sent += data

    def done(self, message: bytes, meaning: str) -> None:
        pass

    def tell(self, text: str) -> None:
        self.faults.append(text)

    inform = tell


def rules_of(folder: Path, reply: str, problems: list[Problem]) -> object:
    (folder / "dialect.toml").write_text(f'[[command]]\nmatch = "q"\nreply = "{reply}"\n', "utf-8")
    spec = COURSE.simulation
    return load_dialect(folder, Parts((LIDAR, *spec.sensors[1:]), spec.drives), problems)


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        ("{sc[3]:.1f}", b"40.0"),
        ("{len(sc)}", b"4"),
        ("{sc*mm:d|,}", b"254,508,762,1016"),
        ("{100/sc + 1:.1f|;}", b"11.0;6.0;4.3;3.5"),
        ("{sc[0] + u1:.1f}", b"15.0"),
        ("{min(sc[0], sc[1]):.1f}", b"10.0"),
        ("{ray(95):.1f} {ray(-80):.1f}", b"40.0 20.0"),
        ("{scan(0, 90, 4):.0f|,}", b"10,40,30,20"),
        ("{scan(0, 90, 4)*cm:.1f|,}", b"25.4,101.6,76.2,50.8"),
    ],
)
def test_its_code_is_a_list(tmp_path: Path, reply: str, said: bytes) -> None:
    problems: list[Problem] = []
    rules = rules_of(tmp_path, reply, problems)
    assert not problems
    robot = Robot()
    DialectDevice(rules, robot).received(b"q\n")  # type: ignore[arg-type]
    assert (robot.sent, robot.faults) == (said, [])
    assert "sc" in robot.codes[0]
    assert list(dictionary(rules))  # type: ignore[arg-type]
    assert list(InverseRules(rules).dictionary()) is not None  # type: ignore[arg-type]
    # Its readings have its errors: a course whose robots have a lidar takes them.
    team = replace(COURSE, dialect=rules)
    assert not rule_problems(Rules(dialects=True), COURSE, team)


@pytest.mark.parametrize(
    ("message", "said"),
    [("at 3", b"40.0"), ("at 4", b"-1"), ("at 400", b"-1"), ("at -1", b"-1"), ("rest 4", b"-1")],
)
def test_a_place_that_the_list_does_not_have_is_answered_as_missing(
    tmp_path: Path, message: str, said: bytes
) -> None:
    """The program asks for it and waits for an answer."""
    (tmp_path / "dialect.toml").write_text(
        '[reply]\nmissing = "-1"\n[[command]]\nmatch = "at {n}"\nreply = "{sc[n]:.1f}"\n'
        '[[command]]\nmatch = "rest {n}"\nreply = "{scan(0, 90, 2)[n]*cm + sc[n]:.1f}"\n',
        "utf-8",
    )
    problems: list[Problem] = []
    rules = load_dialect(tmp_path, Parts((LIDAR,), COURSE.simulation.drives), problems)
    assert not problems
    robot = Robot()
    DialectDevice(rules, robot).received(message.encode() + b"\n")  # type: ignore[arg-type]
    assert (robot.sent, robot.faults) == (said, [])


@pytest.mark.parametrize(
    ("reply", "problem"),
    [
        ("{sc[4]:.1f}", "the list has 4 values, counted from 0; there is none at 4"),
        ("{(sc*mm)[-1]:d}", "the list has 4 values, counted from 0; there is none at -1"),
        ("{scan(0, 90, 2)[2]:.1f}", "the list has 2 values, counted from 0; there is none at 2"),
        ("{sc:.1f}", "is a list; write {...|,} to join"),
        ("{max(sc):.1f}", "a list is no number"),
        ("{sc*sc:.1f|,}", "a list is no number"),
        ("{u1[0]:.1f}", "u1 is a number, and no list"),
    ],
)
def test_mistakes_with_it_are_told(tmp_path: Path, reply: str, problem: str) -> None:
    problems: list[Problem] = []
    rules_of(tmp_path, reply, problems)
    assert problem in str(problems[0])


def test_long_calculations_with_lists_end() -> None:
    class Names:
        def value(self, name: str) -> FieldValue:
            return (1.0,) * 2000

        def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
            raise AssertionError(function)

    assert Expression("(sc*2)[0] + (sc*3)[0]").value(Names()) == 5
    with pytest.raises(ExpressionError, match=f"more than {MOST_STEPS} steps"):
        Expression("+".join(["(sc*2)[0]"] * 5)).value(Names())


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"rays": 720}, "its rays is above the course's 360"),
        ({"scan_rate": 10.0}, "its scan rate is above the course's 5.5"),
        ({"error": 0.001}, "its error is below the course's 0.01"),
        ({"dropout": 0.0}, "its dropout is below the course's 0.01"),
        ({"max_range": 1000.0}, "its max range is above the course's 472.4"),
        ({"resolution": 0.001}, "its resolution is not the course's 0.01"),
        ({"rays": 72, "scan_rate": 2.0, "clockwise": False, "error": 0.02, "rotation": 90.0}, ""),
    ],
)
def test_a_lidar_is_no_better_than_the_course_s(changes: dict[str, object], problem: str) -> None:
    spec = COURSE.simulation
    lidar = replace(spec.sensors[0], **changes)
    team = replace(COURSE, simulation=replace(spec, sensors=(lidar, *spec.sensors[1:])))
    found = [str(each) for each in rule_problems(Rules(), COURSE, team)]
    assert found == ([f"sensors.csv:lidar1: {problem}"] if problem else [])


@pytest.mark.parametrize("reply", ["{ray(0):.1f}", "{scan(0, 90, 4):.0f|,}"])
def test_without_a_lidar_ray_and_scan_are_mistakes(tmp_path: Path, reply: str) -> None:
    (tmp_path / "dialect.toml").write_text(f'[[command]]\nmatch = "q"\nreply = "{reply}"\n', "utf-8")
    problems: list[Problem] = []
    spec = COURSE.simulation
    load_dialect(tmp_path, Parts(spec.sensors[1:], spec.drives), problems)
    (problem,) = map(str, problems)
    assert problem.startswith(f"dialect.toml:1:command.1: {reply[1:5].rstrip('(')}")
    assert "needs a lidar in sensors.csv" in problem
