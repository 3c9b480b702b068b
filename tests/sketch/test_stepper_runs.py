"""Boards with steppers, displays and controllers: poses by hand from the steps, and equal slices."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.links.backend import Message
from simmer_tui.run.events import Action, ActionName, CommandResult, Notice, ProgramEnded
from simmer_tui.sim.command import parse_command
from simmer_tui.sketch.checked_board import CheckedBoard
from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.avr.cores import Stimuli, run_ours
from tests.sketch.rovers import ENCODERS, JOINED, ROVER, SENSOR, Boards, made_set
from tests.sketch.running import FORMS, set_of

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
]
SECOND = 1_000_000_000
_TRACK = 6.0
"""Inches between the wheels of a set."""
STEPPERS = "".join(
    f'[[motors]]\nboard = "rover"\ndriver = "step_dir"\nstep = {step}\ndir = {step + 3}\nenable = 8\n'
    f'steps_per_inch = 100\nwheel = "{wheel}"\n'
    for step, wheel in ((2, "left"), (3, "right"))
)
PULSED = """
void setup() { for (int pin = 2; pin < 9; pin++) pinMode(pin, OUTPUT); Serial.begin(9600); }
void steps(int count, int us, bool left, bool right) {
  for (int i = 0; i < count; i++) {
    if (left) digitalWrite(2, HIGH);
    if (right) digitalWrite(3, HIGH);
    delayMicroseconds(us);
    digitalWrite(2, LOW); digitalWrite(3, LOW);
  }
}
void turn(bool left, bool right) { digitalWrite(5, left); digitalWrite(6, right); }
"""
TURNS = f"""{PULSED}
void loop() {{
  turn(HIGH, HIGH); steps(733, 1100, true, true); delay(100);
  turn(LOW, HIGH); steps(471, 2000, true, true); delay(100);
  turn(HIGH, HIGH); steps(211, 25000, false, true); steps(57, 900, true, true);
  while (true) delay(1000);
}}
"""


def exact(configuration: Configuration, seconds: float, slice_length: int = 20_000_000) -> Boards:
    """The boards of a set without errors, run for some seconds."""
    boards = Boards(configuration, noise=False, slice_length=slice_length)
    boards.simulator.set_bias({kind: type(bias)() for kind, bias in boards.simulator.bias.items()})
    boards.run_to(seconds)
    return boards


def arcs(x: float, y: float, heading: float, *parts: tuple[float, float]) -> tuple[float, float, float]:
    """The pose after arcs, each by the inches of the left and the right rim."""
    for left, right in parts:
        turn, ahead = (right - left) / _TRACK, (left + right) / 2.0
        chord = ahead if not turn else ahead * math.sin(turn / 2.0) / (turn / 2.0)
        angle = math.radians(heading) + turn / 2.0
        x, y = x + chord * math.cos(angle), y + chord * math.sin(angle)
        heading += math.degrees(turn)
    return x, y, heading


def test_the_robot_stands_where_its_steps_say_whatever_slices_are(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + STEPPERS, {"rover.ino": TURNS})
    runs = []
    for slice_length in (100_000, 1_000_000, 20_000_000):
        boards = exact(configuration, 9.0, slice_length)
        boards.close()
        runs.append((repr(boards.events), boards.simulator.pose))
    assert runs[1:] == runs[:1] * 2
    start, pose = configuration.simulation.start_pose, runs[0][1]
    by_hand = arcs(
        *(start.x, start.y, start.heading),
        *((7.33, 7.33), (-4.71, 4.71), (0.0, 2.11), (0.57, 0.57)),
    )
    # Pins of both wheels change 4 us apart.
    assert (pose.x, pose.y) == pytest.approx(by_hand[:2], abs=2e-4)
    assert pose.heading == pytest.approx(by_hand[2], abs=1e-5)
    # Far fewer changes of speed than the 2,155 steps at a fast rate.
    changes = [
        each for each in boards.events if isinstance(each, CommandResult) and each.command.code == "ww"
    ]
    assert len(changes) < 2 * 211 + 100
    assert "rover.ino:" in changes[0].command.source


BUS = """
#include <Wire.h>
#include <MPU6050_light.h>
#include <LiquidCrystal_I2C.h>
MPU6050 mpu(Wire);
LiquidCrystal_I2C lcd(0x27, 16, 2);
void setup() {
  for (int pin = 2; pin < 9; pin++) pinMode(pin, OUTPUT);
  Serial.begin(115200); lcd.init(); Wire.setClock(400000); mpu.begin(); mpu.calcOffsets();
  digitalWrite(5, LOW); digitalWrite(6, HIGH);
  for (int step = 0; step < 60; step++) {
    digitalWrite(2, HIGH); digitalWrite(3, HIGH); delayMicroseconds(700);
    digitalWrite(2, LOW); digitalWrite(3, LOW); delayMicroseconds(700);
    mpu.update();
    if (step % 20 == 0) lcd.print(step);
  }
  for (int i = 0; i < 100; i++) { mpu.update(); delay(1); }
  Serial.println(mpu.getAngleZ());
}
void loop() {}
"""


def test_a_gyro_beside_steppers_measures_each_step_whatever_slices_are(tmp_path: Path) -> None:
    gyro = '[[sensors]]\ncode = "g1"\nboard = "rover"\npart = "mpu6050"\n'
    configuration = made_set(tmp_path / "set", ROVER + STEPPERS + gyro, {"rover.ino": BUS})
    runs = []
    for slice_length in (100_000, 1_000_000, 20_000_000):
        boards = exact(configuration, 4.0, slice_length)
        boards.close()
        sent = bytes(value for _, value in boards.robot.lockstep.sent)
        runs.append((sent, boards.simulator.pose))
    assert runs[1:] == runs[:1] * 2
    sent, pose = runs[0]
    # 60 steps of each wheel, in opposite directions.
    assert pose.heading == pytest.approx(math.degrees(1.2 / _TRACK), abs=1e-4)
    # It is read right after a step, when the rim is fast.
    assert float(sent.decode()) > pose.heading


def test_encoders_turn_with_steps_of_the_same_board(tmp_path: Path) -> None:
    text = f"""{PULSED}
volatile int edges;
void edge() {{ edges++; }}
void loop() {{
  attachInterrupt(digitalPinToInterrupt(2), edge, CHANGE);
  digitalWrite(10, HIGH); digitalWrite(11, HIGH);
  for (int i = 0; i < 500; i++) {{ digitalWrite(9, HIGH); digitalWrite(12, HIGH); delayMicroseconds(1000);
    digitalWrite(9, LOW); digitalWrite(12, LOW); }}
  delay(100);
  Serial.println(edges);
  while (true) delay(1000);
}}
"""
    text = text.replace("pin = 2; pin < 9", "pin = 9; pin < 13")
    steppers = STEPPERS.replace("enable = 8\n", "")
    for old, new in (("step = 2", "step = 9"), ("dir = 5", "dir = 10"), ("step = 3", "step = 12")):
        steppers = steppers.replace(old, new)
    wiring = ROVER + steppers.replace("dir = 6", "dir = 11") + ENCODERS.format(board="rover")
    configuration = made_set(tmp_path / "set", wiring, {"rover.ino": text})
    runs = []
    for slice_length in (300_000, 20_000_000):
        boards = exact(configuration, 2.0, slice_length)
        boards.close()
        sent = bytes(value for _, value in boards.robot.lockstep.sent)
        runs.append((repr(boards.events), boards.simulator.pose, sent))
    assert runs[0] == runs[1]
    # 5 in with 40 edges each.
    assert runs[0][2] in (b"200\r\n", b"199\r\n", b"201\r\n")


RAMPS = """
#include <AccelStepper.h>
AccelStepper left(AccelStepper::DRIVER, 2, 5), right(AccelStepper::DRIVER, 3, 6);
void setup() {
  pinMode(8, OUTPUT); digitalWrite(8, LOW);
  left.setMaxSpeed(900); right.setMaxSpeed(700);
  left.setAcceleration(3000); right.setAcceleration(1500);
  left.move(600); right.move(-350);
}
void loop() { left.run(); right.run(); }
"""


def test_encoders_of_another_board_turn_with_steps_at_few_exchanges(tmp_path: Path) -> None:
    wiring = JOINED.partition("[[wires]]")[0] + STEPPERS + ENCODERS.format(board="sensor")
    configuration = made_set(tmp_path / "set", wiring, {"sensor.ino": SENSOR, "rover.ino": RAMPS})
    runs = []
    for slice_length in (300_000, 3_000_000, 20_000_000):
        boards = exact(configuration, 2.0, slice_length)
        boards.close()
        sent = bytes(value for _, value in boards.robot.lockstep.sent)
        runs.append((repr(boards.events), boards.simulator.pose, sent))
    assert runs[1:] == runs[:1] * 2
    # 6 and 3.5 in with 40 edges each.
    assert abs(int(runs[0][2].split()[-1]) - 380) <= 2
    # The steps of both are 950: most of them change no speed.
    assert boards.robot.boards["sensor"].process.exchanges < 500


def test_an_enable_that_is_off_and_a_stop_of_a_person_move_nothing(tmp_path: Path) -> None:
    text = f"""{PULSED}
void loop() {{
  turn(HIGH, HIGH); digitalWrite(8, HIGH); steps(100, 1000, true, true);
  digitalWrite(8, LOW); steps(100, 10000, true, true);
  while (true) delay(1000);
}}
"""
    configuration = made_set(tmp_path / "set", ROVER + STEPPERS, {"rover.ino": text})
    boards = exact(configuration, 0.1)
    start = configuration.simulation.start_pose
    assert boards.simulator.pose == start
    told = [each.text for each in boards.events if isinstance(each, Notice)]
    assert told[0] == (
        "board rover: a step of motors[1] moved nothing at rover.ino:5: its enable, pin 8, is HIGH; the "
        "driver is on at LOW"
    )
    boards.run_to(0.5)
    command = replace(parse_command("xx", "console"), stops=True)
    stop = Message(b"xx", (command,), ReplyForm(ReplyFormat.TEXT))
    before = boards.simulator.pose.x
    boards.robot.submit(stop, boards.robot.engine.session(), lambda given, data: None)
    boards.run_to(2.0)
    boards.close()
    # The steps after the stop move it again; those that the rim was behind are gone.
    assert before < boards.simulator.pose.x < start.x + 1.0
    assert boards.simulator.pose.x > start.x + 0.97


def test_steppers_begin_again_with_a_run_and_with_their_board(tmp_path: Path) -> None:
    text = f"""{PULSED}
void loop() {{
  steps(50, 2000, true, true);
  turn(HIGH, HIGH); digitalWrite(8, LOW); steps(50, 2000, true, true); digitalWrite(8, HIGH);
  while (true) delay(1000);
}}
"""
    text = text.replace("pin++) pinMode(pin, OUTPUT)", "pin++) if (pin != 8) pinMode(pin, OUTPUT)")
    text = text.replace("digitalWrite(8, HIGH)", "pinMode(8, OUTPUT); digitalWrite(8, HIGH)")
    configuration = made_set(tmp_path / "set", ROVER + STEPPERS, {"rover.ino": text})
    boards = exact(configuration, 1.0)
    start, first = configuration.simulation.start_pose, boards.simulator.pose
    # Back by 0.5 in, and there again.
    assert first.x == pytest.approx(start.x, abs=1e-4)
    boards.robot.reset_by_usb()
    boards.run_to(1.1)
    boards.close()
    assert boards.simulator.pose.x < first.x - 0.2, "a board that begins again has its pins low"
    boards = Boards(configuration)
    boards.run_to(0.3)
    first = boards.simulator.pose
    assert not boards.robot.engine.perform(Action(ActionName.RESET)).refused
    boards.run_to(0.3)
    boards.close()
    assert boards.simulator.pose == first != start


def test_accel_stepper_drives_to_its_targets(tmp_path: Path) -> None:
    configuration = set_of(FORMS / "accel_stepper", tmp_path / "set")
    boards = exact(configuration, 0.3)
    for at, text in ((0.5, b"D300\n"), (2.5, b"T-100\n")):
        for place, value in enumerate(text, 1):
            boards.robot.receive(round(at * SECOND) + place * 1_041_666, value, 9600)
    boards.run_to(5.0)
    boards.close()
    start, pose = configuration.simulation.start_pose, boards.simulator.pose
    by_hand = arcs(start.x, start.y, start.heading, (3.0, 3.0), (1.0, -1.0))
    assert (pose.x, pose.y) == pytest.approx(by_hand[:2], abs=1e-3)
    assert pose.heading == pytest.approx(by_hand[2], abs=1e-5)


@pytest.mark.parametrize("name", ["accel_stepper", "step_pulses", "stepper_coils", "lcd_pid_line"])
def test_what_boards_with_them_tell_is_taken_in_a_grading(name: str, tmp_path: Path) -> None:
    boards = Boards(set_of(FORMS / name, tmp_path / "set"), start_board=CheckedBoard)
    boards.run_to(1.0)
    boards.close()
    assert boards.robot.failed == ""


TWO_WIRES = """
#include <AccelStepper.h>
AccelStepper left(AccelStepper::FULL2WIRE, 2, 5), right(AccelStepper::FULL2WIRE, 3, 6);
void go(long steps) {
  left.move(steps); right.move(steps);
  left.setSpeed(steps > 0 ? 800 : -800); right.setSpeed(steps > 0 ? 800 : -800);
  while (left.distanceToGo() || right.distanceToGo()) {
    left.runSpeedToPosition(); right.runSpeedToPosition();
  }
}
void setup() {
  pinMode(8, OUTPUT);
  left.setMaxSpeed(1000); right.setMaxSpeed(1000);
  go(400); delay(50); go(-160);
}
void loop() {}
"""


def test_two_wires_make_one_step_of_a_driver_in_four(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + STEPPERS, {"rover.ino": TWO_WIRES})
    boards = exact(configuration, 1.5)
    boards.close()
    start, pose = configuration.simulation.start_pose, boards.simulator.pose
    # 100 rises ahead, of which the first one comes before its direction, and 40 back.
    assert (pose.x, pose.y) == pytest.approx((start.x + 0.58, start.y), abs=1e-3)


OTHER_DISPLAYS = """
#include <Wire.h>
#include <LCD.h>
#include <LiquidCrystal_I2C.h>
LiquidCrystal_I2C a(0x27, 2, 1, 0, 4, 5, 6, 7, 3, POSITIVE), b(0x3F, 2, 1, 0, 4, 5, 6, 7);
LiquidCrystal_I2C c(0x26, 3, NEGATIVE), d(0x25, 20, 4, LCD_5x8DOTS);
void setup() {
  a.begin(16, 2);
  a.setBacklight(HIGH);
  a.print("one");
  b.setBacklightPin(3, POSITIVE);
  b.begin(20, 4, LCD_5x8DOTS);
  b.off(); b.on();
  b.setCursor(0, 3);
  b.print("two");
  c.begin(8, 1);
  c.print("three");
  d.begin();
  d.print("four");
}
void loop() {}
"""


def test_displays_of_other_libraries_of_the_name_show_what_is_printed(tmp_path: Path) -> None:
    boards = Boards(made_set(tmp_path / "set", ROVER, {"rover.ino": OTHER_DISPLAYS}))
    boards.run_to(5.0)
    (view,) = boards.robot.views()
    boards.close()
    assert view.displays == (
        ("one" + 13 * " ", 16 * " "),
        (*(3 * [20 * " "]), "two" + 17 * " "),
        ("three   ",),
        ("four" + 16 * " ", *(3 * [20 * " "])),
    )


DISPLAYS = """
#include <LiquidCrystal.h>
#include <LiquidCrystal_I2C.h>
LiquidCrystal small(12, 11, 5, 4, 3, 2);
LiquidCrystal_I2C large(0x27, 20, 4);
byte heart[8] = {0, 10, 31, 31, 14, 4, 0, 0};
void setup() {
  Serial.begin(9600);
  small.begin(16, 2);
  small.createChar(3, heart);
  small.print("into the glyphs");
  small.home();
  small.print("v=");
  small.print(2.5);
  small.write(byte(3));
  small.setCursor(14, 1);
  small.print("cut off");
  large.init();
  large.backlight();
  large.setCursor(19, 0);
  large.print("ab");
  large.setCursor(2, 3);
  large.print(F("last row"));
  unsigned long begun = micros();
  small.print('x');
  unsigned long one = micros() - begun;
  begun = micros();
  large.print('y');
  unsigned long other = micros() - begun;
  Serial.print(one); Serial.print(' '); Serial.println(other);
}
void loop() {}
"""


def test_displays_show_what_the_sketch_prints(tmp_path: Path) -> None:
    boards = Boards(made_set(tmp_path / "set", ROVER, {"rover.ino": DISPLAYS}))
    boards.run_to(2.0)
    (view,) = boards.robot.views()
    boards.robot.engine.tell(ProgramEnded(0, 2.0))
    boards.close()
    small, large = view.displays
    assert small == ("v=2.50#         ", " " * 14 + "cu")
    # The 21st place of the first line is the first of the third row.
    assert large == (f"{' ' * 19}a", " " * 20, f"b{' ' * 19}", f"  last rowy{' ' * 9}")
    # Two halves of 26 us on pins with a wait of 102 each; six transfers of 190 us with waits of 51.
    assert view.line.split() == ["268", "1244"]
    told = [each.text for each in boards.events if isinstance(each, Notice)]
    assert told == [
        *("board rover: its display shows v=2.50# / cu", "board rover: its display shows a / b / last rowy")
    ]


COUNTING_DISPLAY = """
#include <LiquidCrystal.h>
LiquidCrystal lcd(12, 11, 5, 4, 3, 2);
void setup() { Serial.begin(9600); pinMode(13, OUTPUT); lcd.begin(16, 2); }
void loop() {
  lcd.setCursor(0, 0);
  lcd.print(millis());
  digitalWrite(13, millis() / 300 % 2);
  if (millis() % 7 == 0) Serial.println(millis());
}
"""


def test_what_a_board_shows_is_told_the_same_for_any_slices(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER, {"rover.ino": COUNTING_DISPLAY})

    def told(slice_length: int) -> list[str]:
        boards = Boards(configuration, slice_length=slice_length)
        boards.run_to(1.25)
        boards.robot.engine.tell(ProgramEnded(1.25, 0))
        boards.close()
        return [repr(each) for each in boards.events if not isinstance(each, ProgramEnded)]

    first = told(100_000)
    assert first == told(1_000_000) == told(5_000_000) == told(20_000_000)
    changes = [each for each in first if each.startswith("DisplayChanged")]
    assert re.match(
        r"DisplayChanged\(time=0.0, board='rover', led=False, .*displays=\(\), busy=None\)", changes[0]
    )
    # Its first look, then every 0.1 s up to 1.2 s, and the end.
    assert len(changes) == 14
    texts = [
        int(found[1]) for found in (re.search(r"displays=\(\('(\d+) ", each) for each in changes) if found
    ]
    assert all(abs(text - 100 * number) <= 10 for number, text in enumerate(texts[:-1], 1))
    assert 1230 < texts[-1] <= 1250
    assert [("led=True" in each) for each in changes[1:8]] == [False, False, False, True, True, True, False]


PID_SKETCH = """
#include <PID_v1.h>
double in = 4, out = 10, want = 10;
PID pid(&in, &out, &want, 2, 5, 1, DIRECT);
PID back(&in, &out, &want, 2, 0, 0, P_ON_M, REVERSE);
void show() { Serial.print(pid.Compute()); Serial.print(' '); Serial.println(out, 3); }
void setup() {
  Serial.begin(115200);
  show();
  pid.SetMode(AUTOMATIC);
  pid.SetSampleTime(50);
  show();
  show();
  in = 5;
  delay(60);
  show();
  pid.SetOutputLimits(0, 20);
  delay(60);
  show();
  Serial.print(pid.GetKp()); Serial.print(' '); Serial.print(pid.GetKi()); Serial.print(' ');
  Serial.print(pid.GetKd()); Serial.print(' ');
  Serial.print(pid.GetMode()); Serial.println(pid.GetDirection());
  in = 6; out = 30; back.SetMode(AUTOMATIC); in = 7;
  Serial.print(back.Compute()); Serial.print(' '); Serial.println(out);
}
void loop() {}
"""


def test_a_controller_computes_as_its_documentation_says(tmp_path: Path) -> None:
    """Kp 2, Ki 5 and Kd 1 at 50 ms: a sample adds 0.25 of the error, and a change counts 20-fold."""
    sketch = tmp_path / "rover.ino"
    sketch.write_text(PID_SKETCH, "utf-8")
    done = run_ours(sketch, Stimuli(), 0.4)
    text = "".join(chr(int(each.what[5:])) for each in done if each.what.startswith("byte"))
    assert text.split("\r\n")[:-1] == [
        "0 10.000",  # manual: nothing is computed
        "1 23.500",  # 2 * 6 + (10 + 0.25 * 6) - 0
        "0 23.500",  # within the sample time
        "1 2.750",  # 2 * 5 + (11.5 + 0.25 * 5) - 20 * 1
        "1 20.000",  # 2 * 5 + (12.75 + 0.25 * 5) = 24, limited
        "2.00 5.00 1.00 10",
        "1 32.00",  # on the measurement, in reverse: 30 + 2 * (7 - 6)
    ]


TOGETHER = """
#include <MultiStepper.h>
AccelStepper a(AccelStepper::DRIVER, 2, 5), b(AccelStepper::DRIVER, 3, 6);
MultiStepper both;
void setup() {
  Serial.begin(9600);
  a.setMaxSpeed(800); b.setMaxSpeed(800);
  both.addStepper(a); both.addStepper(b);
  long targets[2] = {400, 200};
  both.moveTo(targets);
  both.runSpeedToPosition();
  Serial.print(a.currentPosition()); Serial.print(' '); Serial.print(b.currentPosition());
  Serial.print(' '); Serial.println(millis() / 20);
  a.setAcceleration(400); a.setMaxSpeed(500);
  a.runToNewPosition(0);
  Serial.println(a.currentPosition());
  a.setSpeed(-100);
  unsigned long until = millis() + 505;
  while (millis() < until) a.runSpeed();
  Serial.println(a.currentPosition());
  a.setCurrentPosition(7);
  Serial.print(a.distanceToGo()); Serial.print(a.isRunning()); Serial.println(a.speed());
  a.moveTo(300);
  while (a.currentPosition() < 150) a.run();
  a.stop();
  a.runToPosition();
  Serial.println(a.currentPosition() < 300);
}
void loop() {}
"""


def test_accel_stepper_and_multi_stepper_step_as_documented(tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(TOGETHER, "utf-8")
    done = run_ours(sketch, Stimuli(), 6.0)
    text = "".join(chr(int(each.what[5:])) for each in done if each.what.startswith("byte"))
    lines = text.split("\r\n")
    # 400 steps at 800 a second, and the two others in the same time.
    assert lines[0].startswith("400 200 2")
    assert lines[1:-1] == ["0", "-50", "000.00", "1"]
