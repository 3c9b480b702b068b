"""The layout and the wheels of a draft: by names, by turns, and a line for a motor that has no row."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.errors import Problem
from simmer_tui.sketch.wiring import WiringParts, read_wiring
from simmer_tui.sketch.wiring_draft import draft

CORNERS = ("FL", "FR", "RL", "RR")


def duties(*names: str) -> str:
    """A sketch with a motor of three pins for each name, whose speed is unknown."""
    pins = "".join(
        f"#define {name}_{key} {22 + 3 * at + place}\n"
        for at, name in enumerate(names)
        for place, key in enumerate(("IN1", "IN2", "EN"))
    )
    one = "digitalWrite(a, v > 0); digitalWrite(b, v < 0); analogWrite(en, v);"
    calls = "".join(f"one({name}_IN1, {name}_IN2, {name}_EN, v); " for name in names)
    return f"{pins}void one(int a, int b, int en, int v) {{ {one} }}\nvoid drive(int v) {{ {calls}}}\n"


def levels(function: str, names: tuple[str, ...], *ways: int) -> str:
    """A function that turns motors with two pins each forward (1) or backward (0)."""
    writes = (
        f"digitalWrite({name}1, {way}); digitalWrite({name}2, {1 - way});"
        for name, way in zip(names, ways, strict=True)
    )
    return f"void {function}() {{ {' '.join(writes)} }}\n"


def constants(names: tuple[str, ...]) -> str:
    """The pins of `levels`."""
    return "".join(f"int {name}1 = {2 * at}, {name}2 = {2 * at + 1};\n" for at, name in enumerate(names, 1))


PLAIN = ("A", "B", "C", "D")
# A sketch, its layout, the wheels of its rows (`?` stands for a guess), and the motors without a row.
LAYOUTS = {
    "two motors a side": (duties(*CORNERS), "diff", ["left", "right"], 2),
    "mecanum by a word": (
        f"{duties(*CORNERS)}void strafeLeft() {{}}\nvoid loop() {{ strafeLeft(); }}",
        "mecanum",
        ["front_left", "front_right", "rear_left", "rear_right"],
        0,
    ),
    "mecanum without places": (
        f"{duties('M1', 'M2', 'M3', 'M4')}bool mecanum = true;",
        "mecanum",
        ["front_left?", "front_right?", "rear_left?", "rear_right?"],
        0,
    ),
    "mecanum by channels of structs in a loop": (
        "struct Pins { uint8_t a, b, one, two; };\nconst Pins M[] = {{13, 12, 0, 1}, {14, 27, 2, 3},"
        " {26, 25, 4, 5}, {33, 32, 6, 7}};\nvoid motor(int i, int v) { ledcWrite(M[i].one, v > 0 ? v : 0);"
        " ledcWrite(M[i].two, v < 0 ? -v : 0); }\nvoid mecanum(int x) { motor(0, x); motor(1, x);"
        " motor(2, x); motor(3, x); }\nvoid setup() { for (auto &m : M) { ledcAttachPin(m.a, m.one);"
        " ledcAttachPin(m.b, m.two); } }",
        "mecanum",
        ["front_left?", "front_right?", "rear_left?", "rear_right?"],
        0,
    ),
    "mecanum by levels": (
        constants(CORNERS) + levels("forward", CORNERS, 1, 1, 1, 1) + levels("slide", CORNERS, 0, 1, 1, 0),
        "mecanum",
        ["front_left", "front_right", "rear_left", "rear_right"],
        0,
    ),
    "two motors a side by a turn": (
        constants(PLAIN) + levels("forward", PLAIN, 1, 1, 1, 1) + levels("turnLeft", PLAIN, 1, 0, 1, 0),
        "diff",
        ["right?", "left?"],
        2,
    ),
    "four motors without names": (duties("M1", "M2", "M3", "M4"), "diff", ["left?", "right?"], 2),
    "omni wheels at four sides": (
        duties("frontMotor", "leftMotor", "backMotor", "rightMotor"),
        "omni-4",
        ["front", "left", "rear", "right"],
        0,
    ),
    "four motors by functions of a side": (
        f"{duties('M1', 'M2', 'M3', 'M4')}void setSide(int v) {{}}\n"
        "void leftSide(int v) { one(22, 23, 24, v); one(25, 26, 27, v); }\n"
        "void rightSide(int v) { one(28, 29, 30, v); one(31, 32, 33, v); }\n",
        "diff",
        ["left", "right"],
        2,
    ),
    "omni wheels by the names of their numbers": (
        "const int P[4][3] = {{22, 23, 2}, {24, 25, 3}, {26, 27, 4}, {28, 29, 5}};\n"
        "enum Side { FRONT_W = 0, RIGHT_W, BACK_W, LEFT_W };\nvoid one(int i, int v) {"
        " digitalWrite(P[i][0], v > 0); digitalWrite(P[i][1], v < 0); analogWrite(P[i][2], v); }\n"
        "void loop() { one(FRONT_W, 9); one(RIGHT_W, 9); one(BACK_W, 9); one(LEFT_W, 9); }",
        "omni-4",
        ["front", "right", "rear", "left"],
        0,
    ),
    "three wheels by their places": (
        duties("backMotor", "leftMotor", "rightMotor"),
        "omni-3",
        ["0?", "120?", "240?"],
        0,
    ),
    "servos in a class": (
        "#include <Servo.h>\nclass Wheel { Servo s; int pin; public: Wheel(int p) : pin(p) {}\n"
        "void begin() { s.attach(pin); } };\nWheel rightWheel(9), leftWheel(10);\nServo claw;\n"
        "void setup() { rightWheel.begin(); leftWheel.begin(); claw.attach(3); }",
        "diff",
        ["right", "left"],
        0,
    ),
    "three wheels": (duties("M1", "M2", "M3"), "omni-3", ["0?", "120?", "240?"], 0),
    "a lift": (duties("LEFT", "RIGHT", "LIFT"), "diff", ["left", "right"], 1),
    "a third motor": (duties("LEFT", "RIGHT", "M3"), "diff", ["left", "right"], 1),
    "directions are no places": (
        "const int leftForward = 4, leftBack = 5, rightForward = 2, rightBack = 3;\n"
        "void ahead() { digitalWrite(leftForward, 1); digitalWrite(leftBack, 0);"
        " digitalWrite(rightForward, 1); digitalWrite(rightBack, 0); }",
        "diff",
        ["left", "right"],
        0,
    ),
    "steppers": (
        "AccelStepper a(1, 2, 3), b(1, 4, 5), c(1, 6, 7);",
        "omni-3",
        ["0?", "120?", "240?"],
        0,
    ),
}


@pytest.mark.parametrize("form", LAYOUTS)
def test_a_layout_is_the_one_of_the_motors(tmp_path: Path, form: str) -> None:
    text, layout, wheels, without_row = LAYOUTS[form]
    (tmp_path / "rover.ino").write_text(text, "utf-8")
    made = tmp_path / "set"
    assert main(["init", str(made), "--sketch", str(tmp_path / "rover.ino")]) == 0
    wiring = (made / "wiring.toml").read_text("utf-8")
    found = re.findall(r'^wheel = "(.+?)"  # (\?|by)', wiring, re.MULTILINE)
    assert [f"{name}{mark.removeprefix('by')}" for name, mark in found] == wheels
    no_row = re.compile("^#.*(no wheel by its names|are one row)", re.MULTILINE)
    assert len(no_row.findall(wiring)) == without_row
    spec, problems = load(made).simulation, list[Problem]()
    assert spec.wheels is not None
    assert spec.wheels.layout == layout
    assert read_wiring(wiring, WiringParts(spec.sensors, spec.wheels), problems) is not None
    assert problems == []


def test_a_wheel_of_another_layout_is_told_with_it() -> None:
    motor = '[boards.a]\nsketch = "a.ino"\nboard = "uno"\n[[motors]]\nboard = "a"\ndriver = "pwm2"\n'
    text = f'{motor}in1 = 5\nin2 = 6\nwheel = "rear_left"\ntop_speed = 12\n'
    problems: list[Problem] = []
    read_wiring(text, WiringParts(), problems)
    (problem,) = problems
    assert "the set has no wheels; set [wheels] layout in settings.toml, such as mecanum" in problem.what


def notes(folder: Path, text: str) -> list[str]:
    """The lines of a draft that stand for no row."""
    (folder / "rover.ino").write_text(text, "utf-8")
    made = draft([folder / "rover.ino"], folder, [], ["i1"]).splitlines()[3:]
    return [line for line in made if line.startswith("#") and "docs/sketch.md" not in line]


def test_pins_that_are_driven_and_in_no_row_are_told_with_their_names(tmp_path: Path) -> None:
    motor = "void f() { digitalWrite(2, 1); digitalWrite(4, 0); analogWrite(5, 9); }\n"
    more = "int pump = 8, led = 9;\nvoid g() { digitalWrite(pump, 1); digitalWrite(led, 1); }\n"
    more += "#define STBY 3\nint btn = 12;\n"
    more += "void i() { digitalWrite(STBY, 1); }\nvoid j() { digitalWrite(btn, 1); digitalRead(btn); }\n"
    line, button = notes(tmp_path, f"{motor}{more}void h() {{ analogWrite(6, 9); }}\n")
    assert "12 (btn)" in button
    assert line == (
        "# ? rover writes 8 (pump), 6 as well, in no row: "
        "a motor (add [[motors]] by hand), or an enable, a standby, a lamp (then no row)"
    )


def test_pins_of_a_class_that_is_not_there_are_told(tmp_path: Path) -> None:
    text = "#include <L298N.h>\n#include <NewPing.h>\nL298N m(5, 7, 8);\nNewPing eye(2, 3);\nPID p(1, 2);\n"
    *_, line = notes(tmp_path, text)
    assert line.startswith(
        "# ? rover.ino:3 has L298N m(5, 7, 8): a class that is not there. If they are motors,"
    )
    assert line.endswith('and the layout of [wheels] in settings.toml, if it is "none"')


def test_a_class_of_a_library_beside_the_sketch_is_read(tmp_path: Path) -> None:
    (tmp_path / "libraries" / "Wheel").mkdir(parents=True)
    (tmp_path / "libraries" / "Wheel" / "Wheel.h").write_text(
        "class Wheel { int a, b, s; public: Wheel(int p, int m, int e) : a(p), b(m), s(e) {}"
        " void run(int v) { digitalWrite(a, v > 0); digitalWrite(b, v < 0); analogWrite(s, v); } };",
        "utf-8",
    )
    sketch = "#include <Wheel.h>\nWheel left(7, 8, 5);\nvoid loop() { left.run(9); }\n"
    assert notes(tmp_path, sketch) == []
    assert 'in1 = 7\nin2 = 8\nen = 5\nwheel = "left"' in draft([tmp_path / "rover.ino"], tmp_path, [], [])


def test_knobs_buttons_and_batteries_have_no_row(tmp_path: Path) -> None:
    text = (
        "#define POT A0\nint startButton = 4;\nvoid loop() { analogRead(POT); digitalRead(startButton);"
        " float vBat = analogRead(A1); analogRead(A2); }"
    )
    assert notes(tmp_path, text) == [
        "# rover reads A0 (POT): a knob, a button or a battery by its name, so no row",
        "# rover reads 4 (startButton): a knob, a button or a battery by its name, so no row",
    ]
    made = draft([tmp_path / "rover.ino"], tmp_path, [], ["i1"])
    assert made.count("# ? or a knob: then no row") == 2
