"""Motions by the pins of motors: a function that promises another one than it sets is told with its line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.errors import Problem
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.motion_check import motor_lines, sketch_motions, wrong_motions
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.wiring import Wiring, WiringParts, read_wiring
from tests.sketch.running import FORMS, set_of

WIRING = """\
[boards.main]
sketch = "s.ino"
board = "uno"
[[motors]]
board = "main"
driver = "hbridge"
en = 5
in1 = 7
in2 = 8
wheel = "left"
top_speed = 12
[[motors]]
board = "main"
driver = "hbridge"
en = 6
in1 = 9
in2 = 10
wheel = "right"
top_speed = 12
"""
SKETCH = """\
int speed = 150;
void left(int a, int b) { digitalWrite(7, a); digitalWrite(8, b); analogWrite(5, speed); }
void right(int a, int b) { digitalWrite(9, a); digitalWrite(10, b); analogWrite(6, speed); }
void goForward() { left(HIGH, LOW); right(HIGH, LOW); }
void turnLeft() { left(LOW, HIGH); right(HIGH, LOW); }
void stopNow() { left(0, 0); right(0, 0); }
void either(bool on) { if (on) { left(1, 0); right(1, 0); } else { left(0, 1); right(0, 1); } }
void loop() { goForward(); turnLeft(); stopNow(); }
"""
WHEELS = WheelsSpec(layout=WheelLayout.DIFF)


def read(text: str = WIRING) -> Wiring:
    problems: list[Problem] = []
    wiring = read_wiring(text, WiringParts((), WHEELS), problems)
    assert wiring is not None
    assert problems == []
    return wiring


def test_functions_are_described_by_the_pins_that_they_set() -> None:
    facts = SketchFacts({"s.ino": SKETCH}, UNO)
    found = {
        each.function: (each.spot, each.motion) for each in sketch_motions(read(), WHEELS, facts, "main")
    }
    assert found == {"goForward": ("s.ino:2", "drives ahead"), "turnLeft": ("s.ino:2", "turns left")}
    assert list(wrong_motions(read(), WHEELS, {"main": facts})) == []


def test_a_wrong_polarity_is_told_with_its_motor() -> None:
    facts = SketchFacts({"s.ino": SKETCH}, UNO)
    swapped = read(WIRING.replace("in1 = 9\nin2 = 10", "in1 = 10\nin2 = 9"))
    found = [str(each) for each in wrong_motions(swapped, WHEELS, {"main": facts})]
    assert found[0].startswith("s.ino:2: goForward() turns the robot right: motors[2] turns backward; change")
    assert "turnLeft() drives the robot back: motors[1] and motors[2] turn backward" in found[1]
    reverse = read(WIRING.replace('wheel = "left"\n', 'wheel = "left"\nreversed = true\n'))
    assert len(list(wrong_motions(reverse, WHEELS, {"main": facts}))) == 2


def test_wheels_that_are_exchanged_are_told_so() -> None:
    """Other pins of a motor would turn three functions the wrong way, in place of two."""
    names = {"left": "right", "right": "left"}
    text = re.sub("left|right", lambda found: names[found[0]], WIRING)
    (found,) = wrong_motions(read(text), WHEELS, {"main": SketchFacts({"s.ino": SKETCH}, UNO)})
    assert str(found).startswith(
        "s.ino:2: turnLeft() turns the robot right: motors[1] turns backward; exchange the"
    )
    assert "exchange the two wheel values in wiring.toml" in found.what


SERVOS = """\
Servo one, other;
void setup() { one.attach(9); other.attach(10); }
void goForward() { one.write(180); other.writeMicroseconds(1300); }
void turnLeft() { one.write(0); other.writeMicroseconds(1300); }
void stopNow() { one.write(90); other.write(90); }
void any(int speed) { one.write(speed); other.write(180 - speed); }
void loop() { any(20); any(160); }
"""
SERVO_WIRING = '[boards.main]\nsketch = "s.ino"\nboard = "uno"\n' + "".join(
    f'[[motors]]\nboard = "main"\ndriver = "servo360"\npin = {pin}\nwheel = "{wheel}"\n{keys}\n'
    for pin, wheel, keys in (
        (9, "left", "top_speed = 6"),
        (10, "right", "top_speed = 6\nreversed = true\nfull_pulse = 200"),
    )
)


def test_servos_as_wheels_are_told_by_their_pulses() -> None:
    facts = SketchFacts({"s.ino": SERVOS}, UNO)
    found = {each.function: each.motion for each in sketch_motions(read(SERVO_WIRING), WHEELS, facts, "main")}
    assert found == {"goForward": "drives ahead", "turnLeft": "turns left"}
    turned = read(SERVO_WIRING.replace("reversed = true\n", ""))
    (first, *_) = wrong_motions(turned, WHEELS, {"main": facts})
    assert str(first).startswith(
        "s.ino:3: goForward() turns the robot right: motors[2] turns backward; change"
    )
    assert list(motor_lines(read(SERVO_WIRING), WHEELS)) == [
        "motors[1] left: forward turns the robot right (pin 2000 us; 11.5 deg in 0.2 s)",
        "motors[2] right: forward turns the robot right (pin 1700 us; 11.5 deg in 0.2 s)",
    ]


def test_each_motor_is_turned_alone() -> None:
    lines = list(motor_lines(read(), WHEELS))
    assert lines[0].startswith("motors[1] left: forward turns the robot right (en HIGH, in1 HIGH, in2 LOW; 2")
    assert "motors[2] right: forward turns the robot left" in lines[1]
    reverse = read(WIRING.replace('wheel = "left"\n', 'wheel = "left"\nreversed = true\n'))
    assert "motors[1] left: forward turns the robot left" in next(motor_lines(reverse, WHEELS))


@pytest.mark.slow
def test_check_runs_the_boards_and_reads_each_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if find_compiler() is None:
        pytest.skip("there is no C++ compiler")
    monkeypatch.chdir(tmp_path)
    for name, said in (
        ("pulse_in", "sensors[3] i1: 0 at the start, analogRead gives 850"),
        (
            "millis_states",
            'The boards ran for 1 s without a program: sent 15 bytes to the laptop, first "ready"',
        ),
        ("two_boards", "sent nothing to the laptop; the robot stands where it was"),
    ):
        set_of(FORMS / name, tmp_path / name)
        assert main(["check", name]) == 0
        assert said in capsys.readouterr().out
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "bad.ino").write_text(
        "int big = 70000;\nvoid setup() {}\nvoid loop() { if (millis() > 200) { abort(); } }\n"
    )
    set_of(FORMS / "wait_and_halt", tmp_path / "set")
    (tmp_path / "set" / "wiring.toml").write_text('[boards.main]\nsketch = "../bad"\nboard = "uno"\n')
    assert main(["check", "set"]) == 1
    out = capsys.readouterr().out
    assert "bad.ino:1: this number does not fit: 70000 becomes 4464" in out
    assert "No part of wiring.toml is u1, u2, " in out
    assert "board main died at bad.ino:3 after 0.2" in out


STEPPERS = """\
[boards.main]
sketch = "s.ino"
board = "uno"
[[motors]]
board = "main"
driver = "step_dir"
step = 2
dir = 5
steps_per_inch = 100
wheel = "left"
[[motors]]
board = "main"
driver = "step_dir"
step = 3
dir = 6
steps_per_inch = 100
wheel = "right"
"""
BY_HAND = """\
void steps(int n) {
  for (int i = 0; i < n; i++) {
    digitalWrite(2, 1); digitalWrite(3, 1); delayMicroseconds(500);
    digitalWrite(2, 0); digitalWrite(3, 0); delayMicroseconds(500);
  }
}
void goForward() { digitalWrite(5, HIGH); digitalWrite(6, HIGH); steps(100); }
void turnLeft() { digitalWrite(5, LOW); digitalWrite(6, HIGH); steps(100); }
void loop() { goForward(); turnLeft(); }
"""
BY_OBJECTS = """\
AccelStepper l(AccelStepper::DRIVER, 2, 5), r(1, 3, 6);
void goForward(int n) { l.move(n); r.move(n); }
void turnLeft(float v) { l.setSpeed(-v); r.setSpeed(v); }
void swing() { l.move(10); l.move(-10); r.move(5); }
void loop() { goForward(100); }
"""


@pytest.mark.parametrize("text", [BY_HAND, BY_OBJECTS])
def test_functions_of_steppers_move_as_they_are_named_unless_one_is_wired_the_other_way(text: str) -> None:
    facts = SketchFacts({"s.ino": text}, UNO)
    motions = {each.function: each.motion for each in sketch_motions(read(STEPPERS), WHEELS, facts, "main")}
    assert motions == {"goForward": "drives ahead", "turnLeft": "turns left"}
    assert list(wrong_motions(read(STEPPERS), WHEELS, {"main": facts})) == []
    swapped = read(STEPPERS.replace('wheel = "right"', 'wheel = "right"\nreversed = true'))
    told = [str(each) for each in wrong_motions(swapped, WHEELS, {"main": facts})]
    assert "goForward() turns the robot right: motors[2] turns backward" in told[0]
    assert len(told) == 2


def test_an_object_with_an_inverted_direction_turns_the_other_way() -> None:
    text = f"{BY_OBJECTS}void setup() {{ r.setPinsInverted(true); }}\n"
    facts = SketchFacts({"s.ino": text}, UNO)
    swapped = read(STEPPERS.replace('wheel = "right"', 'wheel = "right"\nreversed = true'))
    assert list(wrong_motions(swapped, WHEELS, {"main": facts})) == []
    assert len(list(wrong_motions(read(STEPPERS), WHEELS, {"main": facts}))) == 2


def test_a_stepper_is_turned_by_a_hundred_steps() -> None:
    lines = list(motor_lines(read(STEPPERS), WHEELS))
    # An inch of one rim by a track of 6 in: 1/6 rad.
    assert lines[0] == "motors[1] left: forward turns the robot right (dir HIGH; 9.5 deg in 100 steps)"
    assert lines[1].startswith("motors[2] right: forward turns the robot left")
