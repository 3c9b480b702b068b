"""Typed lines understood: commands, orders, and what is wrong with them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.errors import ConsoleCommandError
from simmer_tui.live.operating.orders import (
    CONSOLE_COMMANDS,
    ConsoleCommand,
    Local,
    completed,
    completions,
    read_console_command,
)
from simmer_tui.run.events import Action, ActionName
from simmer_tui.sim import SimulationSpec
from simmer_tui.sim.command import Command
from simmer_tui.sim.noise import SEEDS
from simmer_tui.sim.specs import GripperSpec, VelocityKind, VelocitySpec


@pytest.mark.parametrize(
    ("line", "order"),
    [
        (":help", Local("help")),
        (":help u2", Local("help", "u2")),
        ("help", Local("help")),
        ("help d1", Local("help", "d1")),
        ("quit", Local("quit")),
        ("Exit", Local("quit")),
        (":exit", Local("quit")),
        (":QUIT", Local("quit")),
        (":reset", Action(ActionName.RESET)),
        (":teleport 1 -2.5 1e2", Action(ActionName.TELEPORT, (1.0, -2.5, 100.0))),
        (":block 1 2", Action(ActionName.BLOCK, (1.0, 2.0))),
        (":seed 7", Action(ActionName.SEED, (7.0,))),
        (":seed 9007199254740993", Action(ActionName.SEED, (9007199254740993,))),
        (f":seed {SEEDS.high}", Action(ActionName.SEED, (2**128 - 1,))),
        (":noise ON", Action(ActionName.NOISE, (1.0,))),
        (":bias off", Action(ActionName.BIAS, (0.0,))),
        (":bias", Local("bias")),
        (":speed 0.5", Action(ActionName.TIME_SCALE, (0.5,))),
        (":stop", Action(ActionName.STOP)),
        (":vv 4 0 -30", Local("vv", "4;0;-30;1")),
        (":vv 4 0 0 2.5", Local("vv", "4;0;0;2.5")),
        (":pause", Action(ActionName.PAUSE)),
        (":resume", Action(ActionName.RESUME)),
        (":step", Local("step")),
        (":shot my picture.svg", Local("shot", "my picture.svg")),
        (":shot MAZE.SVG", Local("shot", "MAZE.SVG")),
        (":save x", Local("save", "x")),
        (":copy", Local("copy")),
        (":plot_robot", Local("plot_robot")),
        (":plot_sense off", Local("plot_sense", "off")),
        (":trail on", Local("trail", "on")),
        (":truth", Local("truth")),
    ],
)
def test_every_order_is_understood(course_spec: SimulationSpec, line: str, order: ConsoleCommand) -> None:
    assert read_console_command(f"  {line} ", course_spec) == order


@pytest.mark.parametrize(
    ("line", "code", "argument"),
    [
        ("d1-3", "d1", "3"),
        ("d1 -3", "d1", "-3"),
        ("r1--45", "r1", "-45"),
        ("d1:1e-3", "d1", "1e-3"),
        ("u1", "u1", None),
        ("u1-0", "u1", "0"),
        ("gr-1", "gr", "1"),
        ("d1", "d1", None),  # the drive itself says that a value is missing
        ("d1-x", "d1", "x"),
        ("zz u1", "zz", "u1"),  # no code of ours: a real robot's, perhaps
        ("quit now", "qu", "t now"),
    ],
)
def test_anything_else_is_a_command_from_the_console(
    course_spec: SimulationSpec, line: str, code: str, argument: str | None
) -> None:
    spec = replace(course_spec, gripper=GripperSpec(code="gr"))
    order = read_console_command(line, spec)
    assert isinstance(order, Command)
    assert (order.code, order.argument, order.source) == (code, argument, "console")


@pytest.mark.parametrize(
    ("line", "mistake"),
    [
        ("u1 u2", "u1 u2: u1 takes nothing after it; one command a line"),
        ("u1u2", "u1u2: u1 takes nothing after it; one command a line"),
        ("o1o2o3", "o1o2o3: o1 takes nothing after it; one command a line"),
        ("o1o2", "o1o2: o1 takes nothing after it; one command a line"),
        ("u1x", "u1x: u1 takes nothing after it; one command a line"),
        ("u1-far", "u1-far: u1 takes nothing after it; one command a line"),
        ("d1-3 r1-90", "d1-3 r1-90: d1-V takes one number; one command a line"),
        ("d1d2", "d1d2: d1-V takes one number; one command a line"),
        ("gr-1 d1-3", "gr-1 d1-3: gr-V takes one number; one command a line"),
        ("u1 \x1b[2J", "u1 \\x1b[2J: u1 takes nothing after it; one command a line"),
    ],
)
def test_a_line_is_one_command_and_is_never_half_done(
    course_spec: SimulationSpec, line: str, mistake: str
) -> None:
    spec = replace(course_spec, gripper=GripperSpec(code="gr"))
    with pytest.raises(ConsoleCommandError) as caught:
        read_console_command(line, spec)
    assert str(caught.value) == mistake


@pytest.mark.parametrize(
    ("line", "mistake"),
    [
        (":", ": is not an order; :help lists them"),
        (":rest", ':rest is not an order; did you mean "reset"?'),
        (":help u1 u2", ":help takes one code; :help [CODE]"),
        (":seed", ":seed takes one number; :seed N"),
        (":seed 1 2", ":seed takes one number; :seed N"),
        (":speed nan", ':speed must be a number, not "nan"; :speed N'),
        (":teleport 6 6 x", ':teleport each must be a number, not "x"; :teleport X Y HEADING'),
        (":teleport 6 6 1e13", ":teleport each must be a number from -1e+12 to 1e+12; :teleport X Y HEADING"),
        (":seed 12.5", f':seed must be {SEEDS.allowed}, not "12.5"; :seed N'),
        (f":seed {2**128}", f':seed must be {SEEDS.allowed}, not "{2**128}"; :seed N'),
        (":robot", ":robot takes a serial port; :robot PORT"),
        (":shot", ":shot takes a file name; :shot FILE.svg"),
        (":shot a.png", ":shot writes SVG: the name must end in .svg; :shot FILE.svg"),
        (":save", ":save takes a file name; :save FILE"),
        (":vv 1 2", ":vv takes three numbers, and seconds T if not 1; :vv VX VY OMEGA [T]"),
        (":vv 1 2 3 0", ':vv T must be a number above 0 and at most 3600, not "0"; :vv VX VY OMEGA [T]'),
        (":vv 1e7 2 3", ':vv each must be a number from -1e+06 to 1e+06, not "1e7"; :vv VX VY OMEGA [T]'),
        (":truth maybe", ":truth takes on or off; :truth [on|off]"),
        (":\x1b[2J", ":\\x1b[2J is not an order; :help lists them"),
    ],
)
def test_what_is_wrong_is_said_with_what_is_allowed(
    course_spec: SimulationSpec, line: str, mistake: str
) -> None:
    with pytest.raises(ConsoleCommandError) as caught:
        read_console_command(line, course_spec)
    assert str(caught.value) == mistake


@given(st.text(max_size=40))
def test_no_line_does_anything_but_give_an_order_or_a_printable_mistake(
    course_spec: SimulationSpec, line: str
) -> None:
    mistake = ""
    try:
        read_console_command(line, course_spec)
    except ConsoleCommandError as error:
        mistake = str(error)
    assert mistake.isprintable()


def test_completions_have_meanings_and_can_be_read_back(course_spec: SimulationSpec) -> None:
    assert completions("i", course_spec)[0] == ("i1", "ir1")
    assert completions("d1-3", course_spec) == [("d1", "drive forward (+X)")]
    assert completions(":plot", course_spec) == [
        (":plot_robot", "[on|off] draw the maze and the robot"),
        (":plot_sense", "[on|off] draw what the sensors see"),
    ]
    assert completions(":bias ", course_spec) == [
        (":bias on", CONSOLE_COMMANDS["bias"].help),
        (":bias off", CONSOLE_COMMANDS["bias"].help),
    ]
    assert completions(":teleport 3 ", course_spec) == [(":teleport", "X Y HEADING put the robot there")]


def test_disabled_codes_are_not_offered_and_the_gripper_is(course_spec: SimulationSpec) -> None:
    sensors = tuple(replace(sensor, enabled=sensor.code != "u1") for sensor in course_spec.sensors)
    spec = replace(course_spec, sensors=sensors, gripper=GripperSpec(code="gr"))
    assert "u1" not in dict(completions("u", spec))
    assert completions("g", spec) == [("g1", "gyro1"), ("gr", "gripper: 1 closes, 0 opens")]


def test_codes_of_continuous_motion_are_offered(course_spec: SimulationSpec) -> None:
    """They are codes, so the hint must not say that there are none such."""
    velocities = (VelocitySpec(kind=VelocityKind.ALL, code="vv"),)
    spec = replace(course_spec, velocities=velocities)
    assert completions("vv-1;0;0;1", spec) == [("vv", "velocity: a velocity that lasts")]
    assert completions("wt", spec) == [("wt", "wait so many seconds")]


def test_only_what_adds_something_completes_a_line(course_spec: SimulationSpec) -> None:
    assert completed("", course_spec) is None
    assert completed(":he", course_spec) == ":help"
    assert completed(":help", course_spec) is None
    assert completed(":noise o", course_spec) == ":noise on"
    assert completed("d1-3", course_spec) is None
    assert completed("c", course_spec) == "c1"
