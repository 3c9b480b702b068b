"""A wiring compared with the text of its sketches: each mistake in a line, and silence about the unknown."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.errors import Problem
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sketch.boards import MEGA, UNO
from simmer_tui.sketch.sketch_check import facts_of, sketch_problems
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_steps import deep_steps
from simmer_tui.sketch.sketch_values import MOST_LOOKUPS
from simmer_tui.sketch.wiring import WiringParts, read_wiring

WIRING = """\
[boards.rover]
sketch = "rover.ino"
board = "uno"
[boards.eyes]
sketch = "eyes.ino"
board = "uno"
[laptop]
board = "eyes"
[[wires]]
from = "eyes.A0"
to = "rover.A4"
[[motors]]
board = "rover"
driver = "hbridge"
en = 5
in1 = 6
in2 = 7
wheel = "left"
top_speed = 12
[[motors]]
board = "rover"
driver = "hbridge"
en = 9
in1 = 8
in2 = 10
wheel = "right"
top_speed = 12
[[sensors]]
board = "rover"
part = "encoder"
wheel = "left"
a = 2
edges_per_inch = 20
[[sensors]]
code = "u1"
board = "eyes"
part = "hc-sr04"
trig = 12
echo = 11
[[servos]]
board = "rover"
pin = 3
"""
ROVER = """\
#include <SoftwareSerial.h>
#define EN_LEFT 5
const int pins[2][2] = {{6, 7}, {8, 10}};  // in1, in2
enum { EN_RIGHT = 9 };
SoftwareSerial link(A4, A5);
volatile long ticks = 0;
void count() { ticks++; }
void wheel(int side, uint8_t en, int speed) {
  digitalWrite(pins[side][0], speed > 0);
  digitalWrite(pins[side][1], speed < 0);
  analogWrite(en, abs(speed)); /* digitalWrite(3, 1) */
}
class Arm { public: void begin(int pin) { } };
Arm arm;
void setup() {
  link.begin(9600);
  for (int i = 0; i < 2; i++) { pinMode(pins[i][0], OUTPUT); pinMode(pins[i][1], OUTPUT); }
  attachInterrupt(digitalPinToInterrupt(2), count, RISING);
  arm.begin(3);
}
void loop() {
  wheel(0, EN_LEFT, 100);
  wheel(1, (uint8_t)EN_RIGHT, -100);
}
"""
EYES = """\
#include <SoftwareSerial.h>
SoftwareSerial link(A1, A0);
int trigPin = 12, echoPin = 11;
void setup() { Serial.begin(115200); link.begin(9600); pinMode(trigPin, OUTPUT); pinMode(echoPin, INPUT); }
void loop() {
  digitalWrite(trigPin, HIGH); digitalWrite(trigPin, LOW);
  Serial.println(pulseIn(echoPin, HIGH));
}
"""


@pytest.fixture(scope="module")
def parts() -> WiringParts:
    return WiringParts(
        load(bundled_sets()["mission"]).simulation.sensors, WheelsSpec(layout=WheelLayout.DIFF)
    )


def found(folder: Path, parts: WiringParts, wiring: str, rover: str, eyes: str) -> list[str]:
    (folder / "rover.ino").write_text(rover, "utf-8")
    (folder / "eyes.ino").write_text(eyes, "utf-8")
    problems: list[Problem] = []
    read = read_wiring(wiring, parts, problems)
    assert read is not None
    assert problems == []
    facts = facts_of(read, folder, problems)
    return [str(each) for each in (*problems, *sketch_problems(read, facts, parts.wheels))]


def test_a_wiring_that_fits_its_sketches_has_no_problem(tmp_path: Path, parts: WiringParts) -> None:
    assert found(tmp_path, parts, WIRING, ROVER, EYES) == []


def test_analog_read_of_a_channel_reads_its_pin(tmp_path: Path, parts: WiringParts) -> None:
    row = '[[sensors]]\ncode = "i1"\nboard = "eyes"\npart = "analog"\npin = "A2"\npoints = [[0, 0], [1, 9]]\n'
    channel = EYES.replace("void loop() {", "void loop() { analogRead(2);")
    assert found(tmp_path, parts, WIRING + row, ROVER, channel) == []
    assert len(found(tmp_path, parts, WIRING + row, ROVER, EYES)) == 1


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            "{6, 7}",
            "{6, 4}",
            "wiring.toml:17:motors.1.in2: the sketch never writes pin 7 (rover.ino); look at its pin numbers",
        ),
        ("arm.begin(3)", "", "wiring.toml:42:servos.1.pin: the sketch never writes pin 3"),
        (
            "digitalPinToInterrupt(2)",
            "digitalPinToInterrupt(4)",
            "rover.ino:18: attachInterrupt on pin 4, which has no interrupt; the Uno has them on pins 2 or 3",
        ),
        (
            "digitalPinToInterrupt(2)",
            "2",
            "rover.ino:18: attachInterrupt has the interrupt 2, which the Uno lacks; write digital",
        ),
        (
            "digitalPinToInterrupt(2)",
            "1",
            "wiring.toml:32:sensors.1.a: the sketch never reads pin 2 (rover.ino)",
        ),
        (
            "analogWrite(en, abs(speed));",
            "digitalWrite(en, 1);",
            "motors.1: no analogWrite of the sketch is on a pin of this motor: it has full speed or none",
        ),
        (
            "#include <Soft",
            "#include <Servo.h>\nServo s; void x() { s.attach(3); }\n#include <Soft",
            "pin 9 of the Uno has no PWM while Servo is used: they share a timer (analogWrite at "
            "rover.ino:13); take another PWM pin",
        ),
        (
            "pinMode(trigPin, OUTPUT); ",
            "",
            "sensors.2.trig: pin 12 is written (eyes.ino:6) and is no output: add pinMode(12, OUTPUT)",
        ),
        ("EN_RIGHT = 9", "EN_RIGHT = 8", "the sketch never writes pin 9"),
        (
            "link(A4, A5)",
            "link(4, A5)",
            "wires.1.to: no serial port of the sketch receives at pin A4; it has link",
        ),
        ("link.begin(9600);\n", "", "wires.1: link (rover.ino:5) is never begun"),
        (
            "link.begin(9600);\n",
            "link.begin(4800);\n",
            "its two ends differ: link 9600 baud (eyes.ino:4) and link 4800 baud (rover.ino:16)",
        ),
        (
            "pulseIn(echoPin",
            "pulseIn(trigPin",
            "trig 12 and echo 11 are the other way round in the sketch (pulseIn",
        ),
        (
            "int trigPin = 12, echoPin = 11;",
            "int trigPin = 11, echoPin = 12;",
            "trig 12 and echo 11 are the other way round in the sketch (pulseIn at eyes.ino:7)",
        ),
        ("trigPin = 12", "trigPin = 13", "sensors.2.trig: the sketch never writes pin 12 (eyes.ino)"),
        (
            "Serial.begin(115200);",
            "",
            "laptop: the sketch has no serial port with rx 0 and tx 1; it has link",
        ),
        (
            'board = "eyes"\n[[wires',
            'board = "eyes"\nbaud = 9600\n[[wires',
            "wiring.toml:9:laptop.baud: the laptop has 9600 baud, Serial has 115200 (eyes.ino:4)",
        ),
        (
            'board = "eyes"\n[[wires',
            'board = "eyes"\nrx = "A2"\ntx = "A3"\n[[wires',
            "laptop: the sketch has no serial port with rx A2 and tx A3; it has Serial with rx 0 and tx 1, ",
        ),
        ("en = 9\n", "en = 12\n", "the sketch never writes pin 12"),
        (
            "link(A4, A5)",
            "link(A4, 7)",
            "wiring.toml:17:motors.1.in2: pin 7 is tx of link too (rover.ino:5); give each its own pin",
        ),
        (
            "top_speed = 12",
            "top_speed = 20",
            "wiring.toml:19:motors.1.top_speed: 20 in/s is more than top_speed of [wheels] in settings",
        ),
    ],
)
def test_a_mistake_is_told_in_a_line(
    tmp_path: Path, parts: WiringParts, old: str, new: str, problem: str
) -> None:
    texts = [WIRING, ROVER, EYES]
    assert sum(text.count(old) for text in texts) >= 1
    problems = found(tmp_path, parts, *(text.replace(old, new, 1) for text in texts))
    assert problem in "\n".join(problems)
    assert len(problems) <= 4


def test_a_wire_between_pins_that_are_no_ports_is_told_in_one_line(
    tmp_path: Path, parts: WiringParts
) -> None:
    wiring = re.sub(r'from = "eyes.\w+"\nto = "rover.\w+"', 'from = "eyes.4"\nto = "rover.A2"', WIRING)
    (told,) = [each for each in found(tmp_path, parts, wiring, ROVER, EYES) if "wires" in each]
    assert told.endswith(
        "eyes.4 and rover.A2 are no serial ports: wires carry bytes of serial ports alone, and no levels"
    )


def test_a_duty_on_a_pin_without_pwm_is_told(tmp_path: Path, parts: WiringParts) -> None:
    wiring = WIRING.replace("en = 5", "en = 4")
    problems = found(tmp_path, parts, wiring, ROVER.replace("EN_LEFT 5", "EN_LEFT 4"), EYES)
    assert problems == [
        "wiring.toml:15:motors.1.en: pin 4 of the Uno has no PWM: analogWrite (rover.ino:11) is on from 128, "
        "else off; PWM pins: 3, 5, 6, 9, 10, 11"
    ]


def test_each_pin_without_pwm_is_told_once(tmp_path: Path, parts: WiringParts) -> None:
    head, end = WIRING.index("[[motors]]"), WIRING.index("[[sensors]]")
    motor = '[[motors]]\nboard = "rover"\ndriver = "pwm2"\nin1 = 4\nin2 = 7\nwheel = "left"\ntop_speed = 9\n'
    text = ROVER + "void more() { analogWrite(4, 9); analogWrite(7, 9); }\n"
    problems = found(tmp_path, parts, WIRING[:head] + motor + WIRING[end:], text, EYES)
    told = [each for each in problems if "has no PWM" in each]
    assert [each.split(":")[2] for each in told] == ["motors.1.in1", "motors.1.in2"]


def test_a_mega_receives_at_some_pins_only(tmp_path: Path, parts: WiringParts) -> None:
    wiring = WIRING.replace('"eyes.ino"\nboard = "uno"', '"eyes.ino"\nboard = "mega"')
    problems = found(tmp_path, parts, wiring, ROVER, EYES.replace("link(A1, A0)", "link(7, A0)"))
    assert len(problems) == 1
    assert problems[0].startswith(
        "eyes.ino:2: link cannot receive at pin 7 of the Mega: SoftwareSerial can at 10,"
    )


STEPPER = """\
[boards.rover]
sketch = "rover.ino"
board = "uno"
[[motors]]
board = "rover"
driver = "step_dir"
step = 2
dir = 5
enable = 8
steps_per_inch = 100
wheel = "left"
"""
STEPPING = """\
#include <AccelStepper.h>
#include <LiquidCrystal.h>
LiquidCrystal lcd(12, 11, 10, 9, A0, A1);
AccelStepper left(AccelStepper::DRIVER, 2, 5);
void setup() { left.setEnablePin(8); }
void loop() { left.run(); }
"""


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("", "", ""),
        ("DRIVER, 2, 5", "DRIVER, 3, 5", "motors.1.step: the sketch never writes pin 2 (rover.ino)"),
        ("left.setEnablePin(8);", "", "motors.1.enable: the sketch never writes pin 8 (rover.ino)"),
        (
            "DRIVER, 2, 5",
            "DRIVER, 5, 2",
            "wiring.toml:4:motors.1: step 2 and dir 5 are the other way round in the sketch (AccelStepper at "
            "rover.ino:4)",
        ),
        (
            "left.run();",
            "tone(2, 800);",
            "tone at rover.ino:6 makes no steps here on pin 2: write it HIGH",
        ),
        (
            "lcd(12",
            "lcd(8",
            "motors.1.enable: pin 8 is the display's too (rover.ino:3); give each its",
        ),
    ],
)
def test_a_stepper_is_compared_with_its_sketch(
    tmp_path: Path, parts: WiringParts, old: str, new: str, problem: str
) -> None:
    problems = found(tmp_path, parts, STEPPER, STEPPING.replace(old, new) if old else STEPPING, "")
    assert problem in "\n".join(problems)
    assert len(problems) == (1 if problem else 0)


def test_pins_that_cannot_be_known_are_no_problem(tmp_path: Path, parts: WiringParts) -> None:
    unknown = ROVER.replace("pins[side][0]", "first + side").replace("pins[side][1]", "this->second")
    assert found(tmp_path, parts, WIRING, unknown, EYES) == []


def test_values_of_pins_are_followed() -> None:
    text = """
    #define LED (13)
    static const byte a = A0, trio[] = {2, LED, 0x0B};
    void on(int pin) { digitalWrite(pin, HIGH); }
    void both(int x, int y) { on(x); on(y > 0 ? y : 7); }
    void loop() { both(trio[1], a); for (int i = 2; i < n; i++) pinMode(i, OUTPUT); analogWrite(trio[n], 1); }
    """
    facts = SketchFacts({"s.ino": text}, UNO)
    (write,) = facts.named("digitalWrite")
    assert facts.pins(write) == frozenset({13, 14, 7})
    assert facts.pins(next(facts.named("pinMode"))) is None
    assert facts.pins(next(facts.named("analogWrite"))) == frozenset({2, 13, 11})
    mega = SketchFacts({"s.ino": text}, MEGA)
    assert mega.pins(next(mega.named("digitalWrite"))) == frozenset({13, 54, 7})


@pytest.mark.parametrize(
    "text",
    [
        "f(" * 20_000,
        "void f(int a) { f(a); digitalWrite(a, 1); }" * 400,
        "int a = b, b = a; void loop() { digitalWrite(a, 1); }",
        "{" * 20_000 + "}" * 20_000,
        "int a[n = 2] = {1, 2}; void loop() { digitalWrite(a[n = 1], 1); }",
        'x = "' + "\\" * 20_001,
        "#define a() b()\n#define b() a()\nvoid loop() { a(); digitalWrite(b(), 1); }",
        "struct W { int p; void on() { digitalWrite(p, 1); } };\n"
        + "".join(
            f"W w{at} = {{w{at + 1}.p}};\nvoid f{at}(W w) {{ w.on(); f{at}(w{at}); }}\n" for at in range(300)
        ),
        "class W { W *w; int p; public: W(int a) : w(this), p(w->p) {} int q() { return w->q(); } };\n"
        "W w(w.q());\nvoid loop() { digitalWrite(w.p, w.w->p); }",
        "int f(int a) { return f(a) + f(a + 1); }\nvoid loop() { digitalWrite(f(f(f(2))), 1); }",
        "int a = " + "(" * 20_000 + "1" + ")" * 20_000 + "; void loop() { digitalWrite(a, 1); }",
    ],
)
def test_hostile_sketches_end(text: str) -> None:
    facts = SketchFacts({"s.ino": text}, UNO)
    for call in facts.named("digitalWrite"):
        facts.pins(call)
    assert sum(1 for _ in deep_steps(facts)) < MOST_LOOKUPS
    assert facts.ports() == []
