"""A draft of a wiring.toml: pins as the sketch has them, and a mark where only the team knows."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from simmer_tui import platform_has
from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.nominal import nominal_of
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.wheel_draft import layout_with
from simmer_tui.sketch.wiring import WiringParts, missing_sketches, read_wiring
from simmer_tui.sketch.wiring_draft import draft
from tests.sketch.running import FORMS
from tests.sketch.test_sketch_check import EYES, ROVER


def drafted(folder: Path, *texts: str) -> dict[str, Any]:
    """The tables of a draft; its values are marked, and wiring.toml's reader takes it."""
    paths = []
    for number, text in enumerate(texts, 1):
        paths.append(folder / f"Sketch{number}.ino")
        paths[-1].write_text(text, "utf-8")
    made = draft(paths, folder, ["u1", "u2"], ["i1", "i2"])
    problems: list[Problem] = []
    lines = [line for line in made.splitlines() if line.startswith("wheel = ")]
    layout = layout_with(line.split('"')[1] for line in lines)
    read_wiring(made, WiringParts((), WheelsSpec(layout=layout or WheelLayout.DIFF)), problems)
    assert [str(each) for each in problems if "no row of sensors.csv has" not in each.what] == []
    marks = ("# ? which wheel of [wheels] in settings.toml", "# ? which", "# by the names in the sketch")
    assert all(line.endswith(marks) for line in lines)
    return tomllib.loads(made)


def pins(row: dict[str, Any]) -> tuple[Any, ...]:
    names = ("driver", "in1", "in2", "en", "dir", "pwm", "brake", "trig", "echo", "a", "b", "pin")
    return tuple(row[name] for name in names if name in row)


_WHEEL_CLASS = (
    "class Wheel { int p, m, s; public: Wheel(int pp, int mm, int ss) { p = pp; m = mm; s = ss; }"
    " void run(int v) { digitalWrite(p, v > 0); digitalWrite(m, v < 0); analogWrite(s, v); } };\n"
)
MOTORS = {
    "levels, then duties": (
        "void f() { digitalWrite(2, 1); digitalWrite(4, 0); digitalWrite(7, 1); digitalWrite(8, 0);"
        " analogWrite(5, 90); analogWrite(6, 90); }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "duty, then levels": (
        "void f() { analogWrite(5, 90); digitalWrite(2, 1); digitalWrite(4, 0); analogWrite(6, 9);"
        " digitalWrite(7, 1); digitalWrite(8, 0); }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "one function for both wheels": (
        "int p[2][3] = {{2, 4, 5}, {7, 8, 6}};\n"
        "void one(int i, int v) { digitalWrite(p[i][0], v > 0); digitalWrite(p[i][1], v < 0);"
        " analogWrite(p[i][2], v); }\nvoid loop() { one(0, 9); one(1, -9); }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "one function in a loop": (
        "int p[2][3] = {{2, 4, 5}, {7, 8, 6}};\n"
        "void one(int i, int v) { digitalWrite(p[i][0], v > 0); digitalWrite(p[i][1], v < 0);"
        " analogWrite(p[i][2], v); }\nvoid loop() { for (int i = 0; i < 2; i++) one(i, 9); }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "one enable of both, in another function": (
        "void setup() { analogWrite(5, 200); }\nvoid forward() { digitalWrite(2, 1); digitalWrite(3, 0);"
        " digitalWrite(4, 1); digitalWrite(7, 0); }\nvoid loop() { forward(); }",
        [("hbridge", 2, 3, 5), ("hbridge", 4, 7, 5)],
    ),
    "a standby for both, then the levels of one": (
        "#define STBY 10\nvoid move(int motor, int speed, int way) { digitalWrite(STBY, HIGH);"
        " if (motor == 1) { digitalWrite(2, way); digitalWrite(4, !way); analogWrite(5, speed); }"
        " else { digitalWrite(7, way); digitalWrite(8, !way); analogWrite(6, speed); } }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "a standby, all levels, all duties": (
        "const int STBY = 3;\nvoid f() { digitalWrite(STBY, HIGH); digitalWrite(2, 1); digitalWrite(4, 0);"
        " digitalWrite(7, 1); digitalWrite(8, 0); analogWrite(5, 90); analogWrite(6, 90); }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "enables of steppers": (
        "#include <Stepper.h>\nStepper a(200, 2, 4, 7, 8), b(200, 12, 13, A0, A1);\nint enA = 5, enB = 6;\n"
        "void setup() { digitalWrite(3, HIGH); analogWrite(enA, 150); analogWrite(enB, 150); }",
        [("stepper4", 2, 4), ("stepper4", 12, 13)],
    ),
    "a shield with brakes": (
        "#define DIR_A 12\n#define BRAKE_A 9\n#define PWM_A 3\nvoid f() { digitalWrite(DIR_A, HIGH);"
        " digitalWrite(BRAKE_A, LOW); analogWrite(PWM_A, 200); digitalWrite(13, 1); digitalWrite(8, 0);"
        " analogWrite(11, 200); }",
        [("shield", 12, 3, 9), ("shield", 13, 11, 8)],
    ),
    "direction and duty": (
        "void f() { digitalWrite(4, 1); analogWrite(5, 9); digitalWrite(7, 1); analogWrite(6, 9); }",
        [("shield", 4, 5), ("shield", 7, 6)],
    ),
    "directions and duties in two orders, by their names": (
        "int turnA = 8, dirB = 7, dir_A = 4, pwmB = 6, speed_a = 5;\nvoid f(int v) { digitalWrite(dir_A, 1);"
        " digitalWrite(dirB, 1); analogWrite(pwmB, v); analogWrite(speed_a, v); }",
        [("shield", 7, 6), ("shield", 4, 5)],
    ),
    "two duties a motor": (
        "void f() { analogWrite(5, 9); analogWrite(6, 0); analogWrite(9, 9); analogWrite(10, 0); }",
        [("pwm2", 5, 6), ("pwm2", 9, 10)],
    ),
    "directions and duties apart": (
        "void ahead() { digitalWrite(2, 1); digitalWrite(4, 0); digitalWrite(7, 1); digitalWrite(8, 0); }\n"
        "void halt() { digitalWrite(2, 0); digitalWrite(4, 0); digitalWrite(7, 0); digitalWrite(8, 0); }\n"
        "void balance() { analogWrite(5, right); analogWrite(6, left); }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "a lamp between": (
        "const int led = 13; void f() { digitalWrite(led, 1); digitalWrite(2, 1); digitalWrite(4, 0);"
        " analogWrite(5, 90); }",
        [("hbridge", 2, 4, 5)],
    ),
    "Motor Shield R3": (
        "void f(int right, int left) { digitalWrite(13, LOW); digitalWrite(12, LOW); digitalWrite(8, LOW);"
        " digitalWrite(9, LOW); analogWrite(3, right); analogWrite(11, left); }",
        [("shield", 12, 3, 9), ("shield", 13, 11, 8)],
    ),
    "an L298N on the pins of a shield": (
        "int IN1 = 12, IN2 = 13, IN3 = 8, IN4 = 9;\nvoid f() { digitalWrite(IN1, 1); digitalWrite(IN2, 0);"
        " analogWrite(3, 9); digitalWrite(IN3, 1); digitalWrite(IN4, 0); analogWrite(11, 9); }",
        [("hbridge", 12, 13, 3), ("hbridge", 8, 9, 11)],
    ),
    "a bridge with its enable before two PWM inputs": (
        "void f() { digitalWrite(2, 1); digitalWrite(4, 0); analogWrite(5, 90); analogWrite(9, 90);"
        " analogWrite(10, 0); }",
        [("hbridge", 2, 4, 5), ("pwm2", 9, 10)],
    ),
    "two duties a motor, by their names": (
        "#define AIN1 3\n#define AIN2 5\n#define BIN1 9\n#define BIN2 6\n"
        "void f() { analogWrite(AIN1, 9); analogWrite(BIN1, 9); }"
        " void g() { analogWrite(AIN2, 9); analogWrite(BIN2, 9); }",
        [("pwm2", 3, 5), ("pwm2", 9, 6)],
    ),
    "first inputs, then second ones": (
        "#define IN1 2\n#define IN2 4\n#define IN3 7\n#define IN4 8\n#define ENA 5\n#define ENB 6\n"
        "void f(int s) { digitalWrite(IN1, HIGH); digitalWrite(IN3, HIGH); digitalWrite(IN2, LOW);"
        " digitalWrite(IN4, LOW); analogWrite(ENA, s); analogWrite(ENB, s); }",
        [("hbridge", 2, 4, 5), ("hbridge", 7, 8, 6)],
    ),
    "two inputs a motor, one of them with a PWM at a time": (
        "#define M1A 5\n#define M1B 6\n#define M2A 9\n#define M2B 10\n"
        "void forward(int s) { digitalWrite(M1B, LOW); analogWrite(M1A, s);"
        " digitalWrite(M2B, LOW); analogWrite(M2A, s); }\n"
        "void back(int s) { digitalWrite(M1A, LOW); analogWrite(M1B, s);"
        " digitalWrite(M2A, LOW); analogWrite(M2B, s); }",
        [("pwm2", 5, 6), ("pwm2", 9, 10)],
    ),
    "two inputs a motor, one of them without a PWM": (
        "#define A_IA 5\n#define A_IB 4\n#define B_IA 6\n#define B_IB 7\n"
        "void forward(int s) { analogWrite(A_IA, s); digitalWrite(A_IB, LOW);"
        " analogWrite(B_IA, s); digitalWrite(B_IB, LOW); }\n"
        "void back(int s) { analogWrite(A_IA, 255 - s); digitalWrite(A_IB, HIGH);"
        " analogWrite(B_IA, 255 - s); digitalWrite(B_IB, HIGH); }",
        [("pwm2", 5, 4), ("pwm2", 6, 7)],
    ),
    "levels alone": (
        "void f() { digitalWrite(8, 1); digitalWrite(9, 0); digitalWrite(10, 1); digitalWrite(11, 0); }",
        [("hbridge", 8, 9), ("hbridge", 10, 11)],
    ),
    "levels alone, by their names": (
        "const int rightBack = 3, rightForward = 2, leftForward = 4, leftBack = 5, stby = 7;\n"
        "void loop() { digitalWrite(stby, 1); if (x) { digitalWrite(leftForward, 1);"
        " digitalWrite(rightForward, 1); } else { digitalWrite(leftBack, 1); digitalWrite(rightBack, 1); } }",
        [("hbridge", 4, 5), ("hbridge", 2, 3)],
    ),
    "a class that keeps its pins": (
        "class Wheel { int p, m, s; public: Wheel(int pp, int mm, int ss) { p = pp; m = mm; this->s = ss; }"
        " void run(int v) { digitalWrite(p, v > 0); digitalWrite(m, v < 0); analogWrite(s, v); } };\n"
        "Wheel left(7, 8, 5), right(2, 4, 6);\nvoid loop() { left.run(9); right.run(9); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "objects without a name": (
        "Wheel::Wheel(int p, int m, int s) { this->p = p; this->m = m; this->s = s; }\n"
        "void Wheel::run(int v) { analogWrite(s, v); digitalWrite(p, v > 0); digitalWrite(m, v < 0); }\n"
        "Car car;\nvoid setup() { car.begin(Wheel(7, 8, 5), Wheel(2, 4, 6)); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "structs in an array": (
        "struct Motor { byte en; int a, b; };\nMotor motors[] = {{5, 7, 8}, {6, 2, 4}};\n"
        "void run(int i, int v) { digitalWrite(motors[i].a, v > 0); digitalWrite(motors[i].b, v < 0);"
        " analogWrite(motors[i].en, v); }\nvoid loop() { run(0, 9); run(1, 9); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "macros": (
        "#define IN1 8\n#define forward() { digitalWrite(IN1, 1); digitalWrite(9, 0); \\\n"
        " digitalWrite(10, 1); digitalWrite(11, 0); }\n#define halt digitalWrite(IN1, LOW)\n"
        "#define unused(p) digitalWrite(p, 1)\nvoid loop() { forward(); halt; }",
        [("hbridge", 8, 9), ("hbridge", 10, 11)],
    ),
    "macros with parameters, one in another": (
        "#define MOTOR(f, r, v) do { analogWrite(f, v); analogWrite(r, 0); } while (0)\n"
        "#define DRIVE(l, r) MOTOR(5, 6, l); MOTOR(9, 10, r)\nvoid loop() { DRIVE(90, 90); }",
        [("pwm2", 5, 6), ("pwm2", 9, 10)],
    ),
    "structs by reference": (
        "struct Motor { byte en; uint8_t a, b; int speed = 0; };\nMotor one = {5, 7, 8};\n"
        "const Motor two = {.en = 6, .a = 2, .b = 4};\n"
        "void run(const Motor &m, int v) { digitalWrite(m.a, v > 0); digitalWrite(m.b, v < 0);"
        " analogWrite(m.en, v); }\nvoid loop() { run(one, 9); run(two, 9); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "structs by pointer, with a typedef": (
        "typedef struct { int a; int b; int en; } motor_t;\nmotor_t one{7, 8, 5}, two{2, 4, 6};\n"
        "void run(motor_t *m, int v) { digitalWrite(m->a, v > 0); digitalWrite(m->b, v < 0);"
        " analogWrite(m->en, v); }\nvoid loop() { run(&one, 9); run(&two, 9); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "objects behind pointers": (
        f"{_WHEEL_CLASS}Wheel *one = new Wheel(7, 8, 5);\nWheel *two;\n"
        "void setup() { two = new Wheel(2, 4, 6); }\nvoid loop() { one->run(9); two->run(9); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "objects that are members of another": (
        f"{_WHEEL_CLASS}class Car {{ Wheel one, two; public: Car(int a) : one(7, a, 5), two(2, 4, 6) {{}}"
        " void go() { one.run(9); this->two.run(9); } };\nCar car(8);\nvoid loop() { car.go(); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "an array of objects": (
        f"{_WHEEL_CLASS}Wheel wheels[] = {{Wheel(7, 8, 5), {{2, 4, 6}}}};\n"
        "void loop() { for (int i = 0; i < 2; i++) wheels[i].run(9); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "methods of the same name in two classes": (
        f"{_WHEEL_CLASS}class Lamp {{ int p; public: Lamp(int pin) : p(pin) {{}}"
        " void run(int v) { half(v); } void half(int v) { digitalWrite(p, v); } };\n"
        "Lamp lamp(13);\nWheel one(7, 8, 5), two(2, 4, 6);\nvoid run() { one.run(9); two.run(9); }\n"
        "void loop() { lamp.run(1); run(); }",
        [("hbridge", 7, 8, 5), ("hbridge", 2, 4, 6)],
    ),
    "pins that functions and macros return": (
        "#define DIR(m) (4 + 3 * (m))\n#define LEFT 0\nint pwm(int m) { return m == LEFT ? 5 : 6; }\n"
        "void run(int m, int v) { digitalWrite(DIR(m), v > 0); analogWrite(pwm(m), v); }\n"
        "void loop() { run(LEFT, 9); run(1, 9); }",
        [("shield", 4, 5), ("shield", 7, 6)],
    ),
    "a method with a pin of the base class": (
        "class Part { protected: int pin; public: Part(int p) : pin(p) {} };\n"
        "class Wheel : public Part { int way; public: Wheel(int en, int dir) : Part(en), way(dir) {}\n"
        " void run(int v) { digitalWrite(way, v > 0); analogWrite(pin, v); } };\n"
        "Wheel one(5, 4), two(6, 7);\nvoid loop() { one.run(9); two.run(9); }",
        [("shield", 4, 5), ("shield", 7, 6)],
    ),
    "numbers of pins in the blocks of one function": (
        "void setup() { pinMode(11, OUTPUT); pinMode(10, OUTPUT); pinMode(9, OUTPUT); pinMode(8, OUTPUT); }\n"
        "void loop() { if (t == 'F') { digitalWrite(11, 1); digitalWrite(9, 1); }"
        " else if (t == 'W') { digitalWrite(7, 1); } else { digitalWrite(11, 0); digitalWrite(9, 0);"
        " digitalWrite(10, 0); digitalWrite(8, 0); } }",
        [("hbridge", 11, 10), ("hbridge", 9, 8)],
    ),
    "lamps and relays": (
        "int led1 = 8, led2 = 9, pump = 4, valve = 5;\n"
        "void f() { digitalWrite(led1, 1); digitalWrite(led2, 0);"
        " digitalWrite(pump, 1); digitalWrite(valve, 0); }",
        [],
    ),
}


@pytest.mark.parametrize("form", MOTORS)
def test_motors_are_read_off_the_order_of_writes(tmp_path: Path, form: str) -> None:
    text, expected = MOTORS[form]
    assert [pins(row) for row in drafted(tmp_path, text).get("motors", [])] == expected


_ONE_MOTOR = "digitalWrite({0}, HIGH); digitalWrite({1}, LOW); analogWrite({2}, 90);"
_PLAIN = _ONE_MOTOR.format(2, 4, 5) + _ONE_MOTOR.format(7, 8, 6)
NAMED_SIDES = {
    "constants": (
        "#define R1 2\n#define R2 4\n#define RIGHT_EN 5\n#define L1 7\n#define L2 8\n#define LEFT_EN 6\n"
        f"void f() {{ {_ONE_MOTOR.format('R1', 'R2', 'RIGHT_EN')}"
        f" {_ONE_MOTOR.format('L1', 'L2', 'LEFT_EN')} }}",
        ["right", "left"],
    ),
    "a letter of its own": (
        f"int enR = 5, EN_L = 6;\nvoid f() {{ {_ONE_MOTOR.format(2, 4, 'enR')}"
        f" {_ONE_MOTOR.format(7, 8, 'EN_L')} }}",
        ["right", "left"],
    ),
    "objects": (
        "class Wheel { int p, m, s; public: Wheel(int pp, int mm, int ss) { p = pp; m = mm; s = ss; }"
        " void run(int v) { digitalWrite(p, v > 0); digitalWrite(m, v < 0); analogWrite(s, v); } };\n"
        "Wheel rechts(7, 8, 5), links(2, 4, 6);\nvoid loop() { rechts.run(9); links.run(9); }",
        ["right", "left"],
    ),
    "functions of one motor": (
        f"void motorRight() {{ {_ONE_MOTOR.format(2, 4, 5)} }} void motorLeft()"
        f" {{ {_ONE_MOTOR.format(7, 8, 6)} }}",
        ["right", "left"],
    ),
    "one of them alone": (
        f"void setup() {{ pinMode(rightEn, OUTPUT); {_PLAIN} }} int rightEn = 5;",
        ["right", "left?"],
    ),
    "both inputs of one motor": (
        "#define R_EN 2\n#define L_EN 4\n"
        f"void f() {{ {_ONE_MOTOR.format('R_EN', 'L_EN', 5)} {_ONE_MOTOR.format(7, 8, 6)} }}",
        ["left?", "right?"],
    ),
    "brightness is no side": (f"int brightness = 5;\nvoid f() {{ {_PLAIN} }}", ["left?", "right?"]),
    "a turn": (
        f"void forward() {{ {_PLAIN} }} void turnLeft() {{ {_ONE_MOTOR.format(2, 4, 5)}"
        f" {_ONE_MOTOR.format(8, 7, 6)} }}",
        ["right?", "left?"],
    ),
    "servos": (
        "#include <Servo.h>\nServo rightS, leftS;\nvoid setup() { rightS.attach(9); leftS.attach(10); }",
        ["right", "left"],
    ),
    "steppers": (
        "#include <AccelStepper.h>\nAccelStepper right(1, 2, 5);\nAccelStepper left(1, 3, 6);",
        ["right", "left"],
    ),
}


@pytest.mark.parametrize("form", NAMED_SIDES)
def test_wheels_are_those_that_names_tell(tmp_path: Path, form: str) -> None:
    """`?` stands for a guess."""
    text, expected = NAMED_SIDES[form]
    drafted(tmp_path, text)
    made = draft([tmp_path / "Sketch1.ino"], tmp_path, [], [])
    lines = [line for line in made.splitlines() if line.startswith("wheel = ")]
    assert [f"{line.split(chr(34))[1]}{'?' if '# ?' in line else ''}" for line in lines] == expected


def test_encoders_have_the_wheels_that_names_tell(tmp_path: Path) -> None:
    text = (
        "#define ENC_R 2\n#define ENC_L 3\nvoid one() { n++; } void two() { m++; }\nvoid setup() {"
        " pinMode(ENC_R, INPUT); pinMode(ENC_L, INPUT);"
        " attachInterrupt(digitalPinToInterrupt(ENC_R), one, RISING);"
        " attachInterrupt(digitalPinToInterrupt(ENC_L), two, RISING); }"
    )
    assert [row["wheel"] for row in drafted(tmp_path, text)["sensors"]] == ["right", "left"]


def test_the_order_of_inputs_is_the_one_that_drives_ahead(tmp_path: Path) -> None:
    text = (
        "void goForward() { digitalWrite(2, LOW); digitalWrite(4, HIGH); analogWrite(5, 90);"
        " digitalWrite(7, HIGH); digitalWrite(8, LOW); analogWrite(6, 90); }"
    )
    assert [pins(row) for row in drafted(tmp_path, text)["motors"]] == [
        ("hbridge", 4, 2, 5),
        ("hbridge", 7, 8, 6),
    ]
    shield = (
        "void forward() { digitalWrite(4, LOW); analogWrite(5, 9);"
        " digitalWrite(7, HIGH); analogWrite(6, 9); }"
    )
    assert [row.get("reversed", False) for row in drafted(tmp_path, shield)["motors"]] == [True, False]


def test_a_port_that_is_set_to_a_new_one_is_begun(tmp_path: Path) -> None:
    head = "SoftwareSerial bt = SoftwareSerial(7, 8);\nvoid setup() { bt.begin(9600); Serial.begin(9600); }\n"
    assert drafted(tmp_path, head)["laptop"] == {"board": "sketch1", "rx": 7, "tx": 8}
    (port,) = (each for each in SketchFacts({"s.ino": head}, UNO).ports() if each.name == "bt")
    assert (port.bauds, port.begin_spot) == ((9600,), "s.ino:2")


SENSORS = {
    "NewPing": ("NewPing eyes[2] = {NewPing(8, 9, 200), NewPing(10, 11)};", [(8, 9), (10, 11)]),
    "pulseIn": (
        "int trig[] = {8, 10}, echo[] = {9, 11};\nlong cm(int t, int e) { digitalWrite(t, 1);"
        " digitalWrite(t, 0); return pulseIn(e, HIGH); }\n"
        "void loop() { cm(trig[0], echo[0]); cm(trig[1], echo[1]); }",
        [(8, 9), (10, 11)],
    ),
    "an echo by interrupt": (
        "#define TRIG 7\n#define ECHO 3\nvoid edge() { if (digitalRead(ECHO)) t = micros(); }\n"
        "void setup() { attachInterrupt(digitalPinToInterrupt(ECHO), edge, CHANGE); }\n"
        "void loop() { digitalWrite(TRIG, HIGH); digitalWrite(TRIG, LOW); }",
        [(7, 3)],
    ),
    "encoders": (
        "void left() { if (digitalRead(4)) n++; else n--; } void right() { m++; }\n"
        "void setup() { attachInterrupt(0, left, RISING); attachInterrupt(1, right, CHANGE); }",
        [(2, 4), (3,)],
    ),
    "encoders whose pins are members": (
        "class Encoder { public: Encoder(int p) { pin = p; } int pin; long n; };\nEncoder one(2);\n"
        "struct Pair { byte a, b; } two = {3, 5};\nvoid up() { one.n++; } void tick() { digitalRead(two.b); }"
        "\nvoid setup() { attachInterrupt(digitalPinToInterrupt(one.pin), up, RISING);"
        " attachInterrupt(digitalPinToInterrupt(two.a), tick, RISING); }",
        [(2,), (3, 5)],
    ),
    "encoders that are polled": (
        "#define ENC_L 8\n#define ENC_R_A 10\n#define ENC_R_B 11\n"
        "void loop() { digitalRead(ENC_L); digitalRead(ENC_R_A); digitalRead(ENC_R_B); digitalRead(4); }",
        [(8,), (10, 11), (4,)],
    ),
    "encoders of structs that enumerators pick": (
        "struct Side { byte en, enc; };\nSide s[] = {{5, 2}, {6, 3}};\nenum { L, R };\n"
        "void l() { n++; } void r() { m++; }\nvoid setup() {"
        " attachInterrupt(digitalPinToInterrupt(s[L].enc), l, RISING);"
        " attachInterrupt(digitalPinToInterrupt(s[R].enc), r, RISING); }",
        [(2,), (3,)],
    ),
    "encoders in a loop": (
        "const byte enc[] = {3, 2};\nvoid up() { n++; } void tick() { m++; }\n"
        "void (*isr[])() = {up, tick};\nvoid setup() { for (int i = 0; i < 2; i++)"
        " attachInterrupt(digitalPinToInterrupt(enc[i]), isr[i], RISING); }",
        [(3,), (2,)],
    ),
    "line sensors in the order of their array": (
        "const int eyes[] = {A2, A0, A1};\n"
        "void loop() { for (int i = 0; i < 3; i++) { digitalRead(eyes[i]); } digitalRead(4); }",
        [("A2",), ("A0",), ("A1",), (4,)],
    ),
    "line sensors in the order of calls": (
        "bool dark(int pin) { return analogRead(pin) > 500; }\nvoid loop() { dark(A3); dark(A1); }",
        [("A3",), ("A1",)],
    ),
    "the second channel in a lambda": (
        "void setup() { attachInterrupt(digitalPinToInterrupt(2), []() { digitalRead(4) ? n++ : n--; }, LOW);"
        " attachInterrupt(digitalPinToInterrupt(3), [] { m++; }, RISING); }",
        [(2, 4), (3,)],
    ),
    "line sensors that are objects": (
        "struct Eye { int pin; bool dark() const { return digitalRead(pin); } };\n"
        "Eye eyes[] = {{A2}, {A0}};\nvoid loop() { eyes[0].dark(); eyes[1].dark(); }",
        [("A2",), ("A0",)],
    ),
    "line sensors by macros, in their own order": (
        "#define EYE_L analogRead(A2)\n#define EYE_R analogRead(A0)\nvoid loop() { if (EYE_R || EYE_L) {} }",
        [("A2",), ("A0",)],
    ),
    "line sensors by the numbers of channels": (
        "void loop() { analogRead(2); for (int i = 0; i < 2; i++) analogRead(i); }",
        [("A2",), ("A0",), ("A1",)],
    ),
    "line sensors": ("void loop() { digitalRead(A1); analogRead(A0); }", [("A1",), ("A0",)]),
}


@pytest.mark.parametrize("form", SENSORS)
def test_sensors_are_read_off_calls(tmp_path: Path, form: str) -> None:
    text, expected = SENSORS[form]
    assert [pins(row) for row in drafted(tmp_path, text)["sensors"]] == expected


def test_line_sensors_beside_motors_have_the_codes_of_the_set(tmp_path: Path) -> None:
    text = (
        "void f() { analogWrite(5, 9); analogWrite(6, 0); digitalRead(2); digitalRead(3); digitalRead(4); }"
    )
    assert [row["code"] for row in drafted(tmp_path, text)["sensors"]] == ["i1", "i2", "i3"]


def test_boards_their_lines_and_a_gripper_are_read(tmp_path: Path) -> None:
    servo = "#include <Servo.h>\nServo grip;\nvoid setup() { grip.attach(3); Serial.begin(9600); }\n"
    found = drafted(tmp_path, EYES, ROVER)
    assert {name: each["board"] for name, each in found["boards"].items()} == {
        "sketch1": "uno",
        "sketch2": "uno",
    }
    assert found["laptop"] == {"board": "sketch1", "rx": 0, "tx": 1}
    assert {"from": "sketch1.A0", "to": "sketch2.A4"} in found["wires"]
    assert drafted(tmp_path, servo)["servos"][0]["pin"] == 3
    assert drafted(tmp_path, "void setup() { Serial1.begin(9600); }")["boards"]["sketch1"]["board"] == "mega"


def test_a_sensor_whose_row_is_not_there_has_one_to_add(tmp_path: Path) -> None:
    eyes = "".join(f"NewPing eye{pin}(7, {pin});\n" for pin in (2, 3, 4, 5))
    (tmp_path / "s.ino").write_text(eyes, "utf-8")
    made = draft([tmp_path / "s.ino"], tmp_path, ["u1", "u3"], [])
    assert [row["code"] for row in tomllib.loads(made)["sensors"]] == ["u1", "u3", "u2", "u4"]
    assert "add its row to sensors.csv, such as ultra4,u4,1,3,0,6,0,0.02,5,\n" in made


def test_the_board_and_the_line_are_those_that_the_sketch_uses(tmp_path: Path) -> None:
    for mega in (
        "NewPing far(24, 25, 200);",
        "void setup() { attachInterrupt(digitalPinToInterrupt(18), f, 3); }",
    ):
        assert drafted(tmp_path, mega)["boards"]["sketch1"]["board"] == "mega"
    duties = "void f() { digitalWrite(4, 1); analogWrite(2, 9); digitalWrite(5, 1); analogWrite(7, 9); }"
    assert drafted(tmp_path, duties)["boards"]["sketch1"]["board"] == "mega"
    unused = "SoftwareSerial eyes(10, 11);\nvoid setup() { Serial.begin(9600); }"
    assert drafted(tmp_path, unused)["laptop"] == {"board": "sketch1", "rx": 0, "tx": 1}


def test_a_set_for_encoders_alone_has_wheels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")  # without a compiler nothing is run
    text = "void tick() { n++; }\nvoid setup() { attachInterrupt(0, tick, RISING); }\nvoid loop() {}\n"
    (tmp_path / "rover.ino").write_text(text, "utf-8")
    assert main(["init", str(tmp_path / "set"), "--sketch", str(tmp_path / "rover.ino")]) == 0
    assert main(["check", str(tmp_path / "set")]) == 0


@pytest.mark.parametrize(
    ("text", "angles"),
    [
        ("void shut() { jaw.write(95); }\nvoid free() { jaw.write(20); }", (95, 20)),
        ("void close() { jaw.write(95); }\nvoid free() { jaw.write(20); }", (20, 95)),
        ("void f() { jaw.write(CLOSED); delay(9); jaw.write(WIDE); }", (130, 180)),
        ("void set(int a) { jaw.write(a); }\nvoid f() { set(95); }\nvoid grab() { set(60); }", (95, 60)),
        ("void f() { jaw.write(10); jaw.write(90); jaw.write(170); }", (10, 170)),
        ("void f() { for (int i = 0; i < 90; i++) jaw.write(i); }", (0, 90)),
        ("void f() { jaw.write(1500); jaw.write(30); }", (120, 30)),
        ("void letGo() { jaw.write(120); }\nvoid release() { jaw.write(120); }", (120, 30)),
        ("void f() { jaw.write(analogRead(0)); }", (0, 90)),
    ],
)
def test_a_gripper_has_the_angles_that_the_sketch_writes(
    tmp_path: Path, text: str, angles: tuple[int, int]
) -> None:
    head = "#include <Servo.h>\n#define WIDE 130\nconst int CLOSED = 180;\nServo jaw;\n"
    made = drafted(tmp_path, f"{head}void setup() {{ jaw.attach(3); }}\n{text}\nvoid loop() {{}}\n")
    assert made["servos"][0]["gripper"] == {"open": angles[0], "closed": angles[1]}


@pytest.mark.parametrize(
    ("text", "mark", "told"),
    [
        (
            "void shut() { jaw.write(95); }",
            "# ? a guess: the sketch writes 95 alone",
            ["servos[1]: open = 5, closed = 95 is a guess of the draft: the sketch writes 95 alone"],
        ),
        (
            "void f() { jaw.write(analogRead(0)); }",
            "# ? a guess: no angle was found in the sketch",
            ["servos[1]: open = 0, closed = 90 is a guess of the draft: no angle was found in the sketch"],
        ),
        ("void shut() { jaw.write(95); }\nvoid free() { jaw.write(20); }", "# ? which is open", []),
    ],
)
def test_angles_that_the_draft_has_invented_are_guesses_until_their_mark_is_gone(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    text: str,
    mark: str,
    told: list[str],
) -> None:
    monkeypatch.setenv("PATH", "")  # without a compiler nothing is run
    text = f"#include <Servo.h>\nServo jaw;\nvoid setup() {{ jaw.attach(3); }}\n{text}\nvoid loop() {{}}\n"
    (tmp_path / "jaw.ino").write_text(text, "utf-8")
    assert main(["init", str(tmp_path / "set"), "--sketch", str(tmp_path / "jaw.ino")]) == 0
    wiring = tmp_path / "set" / "wiring.toml"
    assert mark in wiring.read_text("utf-8")
    for marked, expected in ((mark, told), ("", [])):
        wiring.write_text(wiring.read_text("utf-8").replace(mark, marked), "utf-8")
        capsys.readouterr()
        main(["check", str(tmp_path / "set")])
        said = [line.strip() for line in capsys.readouterr().out.splitlines() if "guess" in line]
        assert [line.partition(";")[0] for line in said] == expected


@pytest.mark.parametrize(
    ("names", "gripper"),
    [
        (("arm", "grip"), 5),
        (("greifer", "arm"), 3),
        (("neck", "lift"), 5),
        (("scanner",), None),
        (("one", "two"), 3),
    ],
)
def test_the_gripper_is_the_servo_that_is_named_so(
    tmp_path: Path, names: tuple[str, ...], gripper: int | None
) -> None:
    head = f"#include <Servo.h>\nServo {', '.join(names)};\nvoid setup() {{"
    calls = "".join(
        f" {name}.attach({pin}); {name}.write(20);" for name, pin in zip(names, (3, 5), strict=False)
    )
    made = drafted(tmp_path, f"{head}{calls} }}\nvoid loop() {{}}\n")["servos"]
    assert [row["pin"] for row in made] == [3, 5][: len(names)]
    assert [row["pin"] for row in made if "gripper" in row] == ([] if gripper is None else [gripper])


def test_the_gripper_among_servos_in_an_array_is_told_by_its_functions(tmp_path: Path) -> None:
    text = (
        "#include <Servo.h>\nServo all[2];\nconst int pin[] = {9, 10};\n"
        "void setup() { for (int i = 0; i < 2; i++) all[i].attach(pin[i]); }\n"
        "void armUp() { all[0].write(90); }\nvoid openGripper() { all[1].write(30); }\n"
        "void closeGripper() { all[1].write(100); }\nvoid loop() {}\n"
    )
    made = drafted(tmp_path, text)["servos"]
    assert [row.get("gripper") for row in made] == [None, {"open": 30, "closed": 100}]


_MEASURE = "int ping() { digitalWrite(7, HIGH); return pulseIn(8, HIGH); }\n"


@pytest.mark.parametrize(
    ("text", "is_gripper"),
    [
        ("void lookLeft() { s.write(170); }\nvoid loop() {}", False),
        ("int at(int a) { s.write(a); delay(300); return ping(); }\nvoid loop() { at(20); }", False),
        ("void loop() { for (int a = 15; a < 165; a++) { s.write(a); delay(30); ping(); } }", False),
        ("void loop() { s.write(10); delay(9); ping(); s.write(170); delay(9); ping(); }", False),
        ("void loop() { if (ping() < 100) s.write(20); else s.write(90); ping(); }", True),
    ],
)
def test_a_servo_that_turns_a_sonar_is_no_gripper(tmp_path: Path, text: str, is_gripper: bool) -> None:
    head = "#include <Servo.h>\nServo s;\nvoid setup() { s.attach(3); }\n"
    (row,) = drafted(tmp_path, f"{head}{_MEASURE}{text}")["servos"]
    assert ("gripper" in row) is is_gripper


STEPPERS = {
    "objects": (
        "#include <AccelStepper.h>\n#define EN 8\nAccelStepper left(AccelStepper::DRIVER, 2, 5);\n"
        "AccelStepper right = AccelStepper(1, 3, 6);\nvoid setup() { left.setEnablePin(EN); "
        "left.setPinsInverted(false, false, true); pinMode(EN, OUTPUT); digitalWrite(EN, LOW); }",
        [("step_dir", 2, 5, 8), ("step_dir", 3, 6, 8)],
    ),
    "a kind that is a constant": (
        "const uint8_t kind = AccelStepper::DRIVER;\n#define COILS AccelStepper::FULL4WIRE\n"
        "AccelStepper a(kind, 2, 5), b = AccelStepper(COILS, 8, 9, 10, 11);",
        [("step_dir", 2, 5), ("stepper4", 8, 9, 10, 11)],
    ),
    "two wires": (
        "AccelStepper a(AccelStepper::FULL2WIRE, 2, 5), b(2, 3, 6);",
        [("step_dir", 2, 5), ("step_dir", 3, 6)],
    ),
    "an array of objects": (
        "const int kind = 1;\nAccelStepper both[] = {AccelStepper(kind, 4, 7), AccelStepper(kind, 12, 13)};",
        [("step_dir", 4, 7), ("step_dir", 12, 13)],
    ),
    "objects by pins in arrays": (
        "int s[] = {7, 4}, d[] = {8, 2};\nAccelStepper *m[2];\n"
        "void setup() { for (int i = 0; i < 2; i++) m[i] = new AccelStepper(1, s[i], d[i]); }",
        [("step_dir", 7, 8), ("step_dir", 4, 2)],
    ),
    "pulses": (
        "#define STEP_R 9\n#define DIR_R 4\n#define STEP_L 3\n#define DIR_L 10\n#define ENABLE 8\n"
        "void setup() { digitalWrite(ENABLE, LOW); digitalWrite(DIR_L, HIGH); digitalWrite(DIR_R, LOW); }\n"
        "void loop() { digitalWrite(STEP_R, HIGH); digitalWrite(STEP_L, HIGH); delayMicroseconds(500);\n"
        "digitalWrite(STEP_R, LOW); digitalWrite(STEP_L, LOW); delayMicroseconds(500); }",
        [("step_dir", 9, 4, 8), ("step_dir", 3, 10, 8)],
    ),
    "pulses of a class": (
        "class Step { byte pin, dir; public: Step(byte p, byte d) : pin(p), dir(d) {}\n"
        "void one(bool ahead) { digitalWrite(dir, ahead); digitalWrite(pin, HIGH); delayMicroseconds(9);"
        " digitalWrite(pin, LOW); } };\nStep a(2, 5), b(3, 6);\nvoid loop() { a.one(true); b.one(true); }",
        [("step_dir", 2, 5), ("step_dir", 3, 6)],
    ),
    "pulses of a parameter": (
        "void one(int pin, int dirPin, bool ahead) { digitalWrite(dirPin, ahead); digitalWrite(pin, HIGH);\n"
        "delayMicroseconds(9); digitalWrite(pin, LOW); }\nvoid loop() { one(6, 3, true); one(5, 2, true); }",
        [("step_dir", 6, 3), ("step_dir", 5, 2)],
    ),
    "coils": (
        "#include <Stepper.h>\nStepper a(200, 2, 3, 4, 5), b(2048, 8, 10, 9, 11);",
        [("stepper4", 2, 3, 4, 5), ("uln2003", 8, 9, 10, 11)],
    ),
    "coils of objects": (
        "AccelStepper c(AccelStepper::HALF4WIRE, A0, A2, A1, A3), d(4, 5, 6, 7, 8);",
        [("uln2003", 14, 15, 16, 17), ("stepper4", 5, 6, 7, 8)],
    ),
}


@pytest.mark.parametrize("name", STEPPERS)
def test_steppers_are_read_off(tmp_path: Path, name: str) -> None:
    text, expected = STEPPERS[name]
    motors = drafted(tmp_path, f"{text}\nvoid more() {{ digitalWrite(LED_BUILTIN, HIGH); }}")["motors"]
    names = ("driver", "step", "dir", "in1", "in2", "in3", "in4", "enable")
    found = [tuple(row[key] for key in names if key in row) for row in motors]
    assert [tuple(14 + int(each[1:]) if str(each)[0] == "A" else each for each in row) for row in found] == [
        *expected
    ]
    assert [row["steps_per_inch"] for row in motors] == [100] * len(expected)
    expected_wheels = ["right", "left"] if "STEP_R" in text else ["left", "right"]
    assert [row["wheel"] for row in motors][:2] == expected_wheels
    assert not any("enable_on" in row for row in motors)


def test_an_enable_that_is_not_inverted_is_drafted_as_the_sketch_has_it(tmp_path: Path) -> None:
    text = "AccelStepper a(1, 2, 3);\nvoid setup() { a.setEnablePin(4); }"
    assert drafted(tmp_path, text)["motors"][0]["enable_on"] == "high"


def test_objects_that_are_passed_to_a_function_have_their_enable_and_a_mega_its_pins(tmp_path: Path) -> None:
    made = drafted(tmp_path, (FORMS / "accel_stepper" / "accel_stepper.ino").read_text("utf-8"))
    rows = made["motors"]
    assert [(row["step"], row["dir"], row["enable"]) for row in rows] == [(22, 24, 26), (28, 30, 32)]
    assert [row.get("reversed", False) for row in rows] == [False, True]
    assert not any("enable_on" in row for row in rows)
    assert made["boards"]["sketch1"]["board"] == "mega"


def test_a_direction_that_is_low_ahead_is_drafted_as_reversed(tmp_path: Path) -> None:
    made = drafted(tmp_path, (FORMS / "step_pulses" / "step_pulses.ino").read_text("utf-8"))
    assert [(row["step"], row["dir"], row["enable"]) for row in made["motors"]] == [(2, 5, 8), (3, 6, 8)]
    assert [row.get("reversed", False) for row in made["motors"]] == [False, True]


def test_a_sketch_without_duties_has_no_note_about_them(tmp_path: Path) -> None:
    (tmp_path / "s.ino").write_text("void loop() { digitalWrite(5, HIGH); }\n", "utf-8")
    assert "analogWrite" not in draft([tmp_path / "s.ino"], tmp_path, [], [])


def test_the_pins_of_a_display_are_no_motors(tmp_path: Path) -> None:
    text = (
        "#include <LiquidCrystal.h>\nLiquidCrystal lcd(12, 11, 5, 4, 3, 2);\n"
        "void f() { digitalWrite(5, 1); digitalWrite(4, 0); digitalWrite(3, 1); digitalWrite(2, 0); }"
    )
    assert "motors" not in drafted(tmp_path, text)


def test_a_library_that_is_not_there_yet_is_noted(tmp_path: Path) -> None:
    (tmp_path / "s.ino").write_text("#include <WiFi.h>\n#include <Servo.h>\n", "utf-8")
    made = draft([tmp_path / "s.ino"], tmp_path, [], [])
    assert "# s.ino:1 has WiFi.h, which is not there yet" in made
    assert "Servo.h" not in made
    text = '#include <AFMotor.h>\n#include <Own.h>\n#include "far/QTRSensors.h"\n#include <stdint.h>\n'
    (tmp_path / "s.ino").write_text(text, "utf-8")
    (tmp_path / "libraries" / "Own").mkdir(parents=True)
    (tmp_path / "libraries" / "Own" / "Own.h").write_text("", "utf-8")
    made = draft([tmp_path / "s.ino"], tmp_path, [], [])
    told = [line.split()[3] for line in made.splitlines() if "which is not there yet" in line]
    assert told == ["AFMotor.h,", "far/QTRSensors.h,"]
    (tmp_path / "s.ino").write_text("#include <a\x1bb.h>\n", "utf-8")
    assert "\x1b" not in draft([tmp_path / "s.ino"], tmp_path, [], [])


def test_init_writes_a_draft_beside_a_set_and_with_a_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")  # without a compiler nothing is run
    (tmp_path / "rover.ino").write_text(ROVER, "utf-8")
    (tmp_path / "eyes.ino").write_text(EYES, "utf-8")
    assert main(["init", "--sketch", "rover.ino", "eyes.ino", "new"]) == 0
    assert main(["check", "new"]) == 0
    assert "motors[2] right: in1 rover.8, in2 rover.10, en rover.9" in capsys.readouterr().out
    init_set(tmp_path / "config", bundled_sets()["mission"])
    before = (tmp_path / "config" / "settings.toml").read_bytes()
    assert main(["init", "--sketch", "eyes.ino"]) == 0
    assert 'sketch = "../eyes.ino"' in (tmp_path / "config" / "wiring.toml").read_text("utf-8")
    assert (tmp_path / "config" / "settings.toml").read_bytes() == before
    assert main(["init", "--sketch", "eyes.ino"]) == 2
    assert "has wiring.toml already; nothing is overwritten" in capsys.readouterr().err
    assert main(["init", "--sketch", "nose.ino"]) == 2
    assert "nose.ino: there is no such sketch" in capsys.readouterr().err


def test_a_drafted_set_is_its_own_nominal_one(tmp_path: Path) -> None:
    """A sensor that the team turns by the page is not blamed."""
    (tmp_path / "rover.ino").write_text(ROVER, "utf-8")
    made = tmp_path / "set"
    assert main(["init", str(made), "--mission", "--sketch", str(tmp_path / "rover.ino")]) == 0
    sensors = made / "sensors.csv"
    row = next(line for line in sensors.read_text("utf-8").splitlines() if line.startswith("ultra2,"))
    cells = row.split(",")
    cells[6] = "17"
    sensors.write_text(sensors.read_text("utf-8").replace(row, ",".join(cells)), "utf-8")
    configuration = load(made)
    nominal = nominal_of(configuration)
    assert nominal is not None
    assert (nominal.name, nominal.spec) == (str(made), configuration.simulation)
    assert nominal.time_limit == 300.0
    other = nominal_of(configuration, "mission")
    assert other is not None
    assert other.name == "mission"


def test_check_tells_the_nominal_set_of_a_set_that_got_its_wiring_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "")  # without a compiler nothing is run
    (tmp_path / "eyes.ino").write_text(EYES, "utf-8")
    made = tmp_path / "set"
    assert main(["init", str(made)]) == 0
    assert main(["init", str(made), "--sketch", str(tmp_path / "eyes.ino")]) == 0
    settings = made / "settings.toml"
    text = settings.read_text("utf-8")
    (named,) = (line for line in text.splitlines() if line.startswith("nominal = "))
    for line, count in ((named, 1), ('nominal = ""', 0)):
        settings.write_text(text.replace(named, line), "utf-8")
        capsys.readouterr()
        main(["check", str(made)])
        said = capsys.readouterr().out
        assert said.count("reports compare this robot with that set") == count
    nominal = nominal_of(load(made))
    assert nominal is not None
    assert nominal.name == str(made)


def test_init_drafts_where_the_set_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")  # without a compiler nothing is run
    (tmp_path / "rover.ino").write_text(ROVER, "utf-8")
    assert main(["init", "course", "--term", "--sketch", "rover.ino"]) == 0
    assert '"# ?" in config' in capsys.readouterr().out
    assert main(["check", "course"]) == 0, "the sketch is found from there"
    (tmp_path / "course" / "config" / "wiring.toml").unlink()
    assert main(["init", "course", "--sketch", "rover.ino"]) == 0
    assert (tmp_path / "course" / "config" / "wiring.toml").is_file()
    assert not (tmp_path / "course" / "wiring.toml").exists()
    init_set(tmp_path / "part", bundled_sets()["mission"])
    for name in ("sensors.csv", "settings.toml"):
        (tmp_path / "part" / name).unlink()
    assert main(["init", "new", "--from", "part", "--sketch", "rover.ino"]) == 0
    assert (tmp_path / "new" / "wiring.toml").is_file()


def test_the_folder_of_a_sketch_is_no_second_sketch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rover").mkdir()
    monkeypatch.chdir(tmp_path / "rover")
    Path("rover.ino").write_text(ROVER, "utf-8")
    assert main(["--no-ui", "--sketch", "rover.ino"]) == 2
    assert "simmer-tui init my-robot --sketch rover.ino" in capsys.readouterr().err
    assert main(["init", "my-robot", "--sketch", "rover.ino"]) == 0
    capsys.readouterr()
    assert main(["--no-ui", "--sketch", "rover.ino"]) == 2
    assert "that names it: simmer-tui --sketch my-robot" in capsys.readouterr().err
    shutil.rmtree("my-robot")
    assert main(["init", "--sketch", "rover.ino", "."]) == 0
    assert list(tomllib.loads(Path("wiring.toml").read_text("utf-8"))["boards"]) == ["rover"]
    assert not Path("config").exists()
    capsys.readouterr()
    assert main(["--no-ui", "--sketch", "rover.ino"]) == 2
    assert "takes the folder of the set that names it: simmer-tui --sketch ." in capsys.readouterr().err


def test_a_sketch_with_quotes_in_its_name_is_drafted_as_toml(tmp_path: Path) -> None:
    path = tmp_path / 'my "r" \\ rover.ino'
    path.write_text(ROVER, "utf-8")
    made = tomllib.loads(draft([path], tmp_path, [], []))
    assert [each["sketch"] for each in made["boards"].values()] == [path.name]


@pytest.mark.skipif(not platform_has.POSIX, reason="names that end with a space, and links without rights")
@pytest.mark.parametrize("folder", ["my robot", " robot", "robot ", "linked/robot", "linked/../robot"])
@pytest.mark.parametrize("directory", ["set", "linked/set"])
def test_check_takes_the_path_of_a_draft(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, directory: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "some/where").mkdir(parents=True)
    (tmp_path / "linked").symlink_to("some/where", target_is_directory=True)
    for given in (Path(folder), tmp_path / folder):
        given.mkdir(parents=True, exist_ok=True)
        (given / f"{given.name}.ino").write_text(ROVER, "utf-8")
        Path(directory).mkdir(exist_ok=True)
        assert drafts_that_are_refused(given, Path(directory)) == []
        assert drafts_that_are_refused(given / f"{given.name}.ino", tmp_path / directory) == []


@pytest.mark.skipif(not platform_has.POSIX, reason="names that end with a space")
def test_a_sketch_in_the_set_is_drafted_by_its_name(tmp_path: Path) -> None:
    for name in (" robot", "robot "):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.ino").write_text(ROVER, "utf-8")
        assert drafts_that_are_refused(tmp_path / name, tmp_path) == []


def drafts_that_are_refused(sketch: Path, directory: Path) -> list[str]:
    """Problems of the reader with the path in a draft."""
    problems: list[Problem] = []
    made = draft([sketch], directory, ["u1", "u2"], ["i1", "i2"])
    wiring = read_wiring(made, WiringParts((), WheelsSpec(layout=WheelLayout.DIFF)), problems)
    problems = [each for each in problems if "no row of sensors.csv has" not in each.what]
    return [str(each) for each in (*problems, *missing_sketches(wiring, directory))]


@pytest.mark.parametrize(
    "name", ["ro\x7fbot", "ro\x1bbot", "\u202erobot", "\udcff", "/".join(["d" * 60] * 6)]
)
def test_a_path_that_wiring_toml_does_not_take_is_refused(tmp_path: Path, name: str) -> None:
    try:
        (tmp_path / name).mkdir(parents=True)
    except (OSError, UnicodeError):  # a system whose names are UTF-8
        pytest.skip("this system has no such names")
    (tmp_path / name / "robot.ino").write_text(ROVER, "utf-8")
    with pytest.raises(ConfigurationError, match=r"rename or move the sketch"):
        draft([tmp_path / name / "robot.ino"], tmp_path / "set", [], [])


WHEEL_SERVOS = """
#include <Servo.h>
Servo leftServo, rightServo, claw;
void setup() { leftServo.attach(9); rightServo.attach(10); claw.attach(3); }
void forward() { leftServo.writeMicroseconds(1700); rightServo.write(45); }
void stop() { leftServo.writeMicroseconds(1500); rightServo.write(90); }
void openClaw() { claw.write(20); }
void closeClaw() { claw.write(95); }
void loop() {}
"""


def test_servos_that_are_named_as_wheels_are_drafted_as_motors(tmp_path: Path) -> None:
    """The other way round where the function that drives ahead writes less than the stop."""
    tables = drafted(tmp_path, WHEEL_SERVOS)
    assert [(*pins(row), row.get("reversed")) for row in tables["motors"]] == [
        ("servo360", 9, None),
        ("servo360", 10, True),
    ]
    assert [row["pin"] for row in tables["servos"]] == [3]
    # With motors beside them they are the arms of something.
    levels = "void f() { digitalWrite(2, 1); digitalWrite(4, 0); analogWrite(5, 90); }"
    tables = drafted(tmp_path, WHEEL_SERVOS + levels)
    assert [pins(row) for row in tables["motors"]] == [("hbridge", 2, 4, 5)]
    assert [row["pin"] for row in tables["servos"]] == [3, 9, 10]


def test_a_note_tells_the_enables_of_steppers(tmp_path: Path) -> None:
    (tmp_path / "rover.ino").write_text(
        "#include <Stepper.h>\nStepper a(200, 4, 5, 6, 7);\n"
        "void setup() { analogWrite(10, 150); }\nvoid loop() {}\n",
        "utf-8",
    )
    note = "# ? rover writes 10 as well, in no row: a motor (add [[motors]] by hand), or an enable"
    assert note in draft([tmp_path / "rover.ino"], tmp_path, [], [])


def test_motors_whose_pins_are_not_found_are_to_be_added_by_hand(tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(
        "struct Pins { int en, in; };\nvoid run(Pins &m, int s) { analogWrite(m.en, s); }\n"
        "void setup() {}\nvoid loop() {}\n",
        "utf-8",
    )
    assert "# ? rover has analogWrite on pins that were not found: add [[motors]] by hand" in draft(
        [sketch], tmp_path, ["u1"], []
    )


_PING = "digitalWrite(T, LOW); digitalWrite(T, HIGH); digitalWrite(T, LOW); pulseIn(E, HIGH);"
_PING_AT = _PING.replace("(T", "(trigs[i]").replace("(E", "(echoes[i]")
_LOOP = "for (int i = 0; i < 3; i++)"
ARRAYS_OF_SONARS = {
    "a loop": f"void loop() {{ {_LOOP} {{ {_PING_AT} }} }}",
    "a helper with the number": f"long read(int i) {{ {_PING_AT} }}\nvoid loop() {{ {_LOOP} read(i); }}",
    "numbers": f"long read(int i) {{ {_PING_AT} }}\nvoid loop() {{ read(0); read(1); read(2); }}",
    "a helper with pins": f"long read(int T, int E) {{ {_PING} }}\n"
    f"void loop() {{ {_LOOP} read(trigs[i], echoes[i]); }}",
}


@pytest.mark.parametrize("case", ARRAYS_OF_SONARS)
def test_sonars_whose_pins_are_in_arrays(case: str, tmp_path: Path) -> None:
    text = f"const int trigs[] = {{5, 4, 7}};\nconst int echoes[] = {{8, 9, 10}};\n{ARRAYS_OF_SONARS[case]}"
    sketch = tmp_path / "rover.ino"
    sketch.write_text(text, "utf-8")
    made = draft([sketch], tmp_path, [], [])
    assert [pins(row) for row in tomllib.loads(made)["sensors"]] == [(5, 8), (4, 9), (7, 10)]
    assert "pulseIn" not in made


def test_sonars_that_are_not_found_are_told(tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(
        "const int p[] = {5, 8, 4, 9};\nvoid loop() { for (int i = 0; i < 2; i++) {"
        " digitalWrite(13, HIGH); digitalWrite(p[i * two()], HIGH); pulseIn(p[i * two() + 1], HIGH); } }",
        "utf-8",
    )
    made = draft([sketch], tmp_path, [], [])
    assert "sensors" not in tomllib.loads(made)
    assert "# ? rover has pulseIn on pins that were not found: add the sonar's [[sensors]] by hand" in made
