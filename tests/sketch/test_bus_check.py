"""Parts on a bus compared with the text of a sketch, and read off it: for `check` and `init --sketch`."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.errors import Problem
from simmer_tui.sketch.bench_check import bench_lines
from simmer_tui.sketch.sketch_check import facts_of, sketch_problems
from simmer_tui.sketch.wiring import WiringParts, read_wiring, wiring_lines, wiring_of
from simmer_tui.sketch.wiring_draft import draft
from tests.sketch.running import FORMS, set_of

WIRING = """\
[boards.rover]
sketch = "rover.ino"
board = "uno"
[[sensors]]
code = "g1"
board = "rover"
part = "mpu6050"
int = 2
[[sensors]]
code = "t1"
board = "rover"
part = "vl53l0x"
xshut = 7
address = 0x30
[[sensors]]
code = "u1"
board = "rover"
part = "vl53l0x"
xshut = 8
"""
SKETCH = """\
#include <Wire.h>
#include <MPU6050.h>
#include <Adafruit_VL53L0X.h>
MPU6050 mpu;
Adafruit_VL53L0X left = Adafruit_VL53L0X(), right;
void ready() {}
void setup() {
  Wire.begin();
  mpu.initialize();
  attachInterrupt(0, ready, RISING);
  pinMode(7, OUTPUT);
  pinMode(8, OUTPUT);
  digitalWrite(7, HIGH);
  left.begin(0x30);
  digitalWrite(8, HIGH);
  right.begin();
}
void loop() {}
"""


def found(folder: Path, sketch: str, wiring: str = WIRING) -> list[str]:
    (folder / "rover.ino").write_text(sketch, "utf-8")
    parts = WiringParts(load(bundled_sets()["mission"]).simulation.sensors)
    problems: list[Problem] = []
    read = read_wiring(wiring, parts, problems)
    assert read is not None
    assert problems == []
    return [str(each) for each in sketch_problems(read, facts_of(read, folder, problems), None)]


def test_a_bus_that_fits_its_sketch_has_no_problem(tmp_path: Path) -> None:
    assert found(tmp_path, SKETCH) == []


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            "left.begin(0x30)",
            "left.begin(0x31)",
            "sensors.2.address: the sketch never speaks to 0x30 (rover.ino);",
        ),
        (
            "MPU6050 mpu;",
            "MPU6050 mpu(0x69);",
            "the sketch never speaks to 0x68 (rover.ino); it speaks to 0x29",
        ),
        (
            "  pinMode(7, OUTPUT);\n",
            "  analogRead(4);\n  pinMode(7, OUTPUT);\n",
            "rover.ino:11: pin A4 is SDA of Wire",
        ),
        (
            "  pinMode(7, OUTPUT);\n",
            "  digitalWrite(A5, 1);\n  pinMode(7, OUTPUT);\n",
            "pin A5 is SCL of Wire, and",
        ),
        (
            "MPU6050 mpu;",
            "MPU6050 mpu;\nSoftwareSerial bt(A4, 3);",
            "pin A4 is SDA of Wire, and bt uses it too",
        ),
        (
            "attachInterrupt(0, ready, RISING);",
            "",
            "wiring.toml:8:sensors.1.int: the sketch never reads pin 2",
        ),
        ("digitalWrite(8, HIGH);", "pinMode(8, INPUT);", ""),
    ],
)
def test_a_mistake_on_a_bus_is_told_with_its_place(tmp_path: Path, old: str, new: str, problem: str) -> None:
    assert SKETCH.count(old) == 1
    problems = found(tmp_path, SKETCH.replace(old, new))
    assert len(problems) == bool(problem), problems
    assert problem in "".join(problems)


def test_a_sketch_that_never_begins_the_bus_is_told(tmp_path: Path) -> None:
    alone = WIRING[: WIRING.index('[[sensors]]\ncode = "t1"')].replace("int = 2\n", "")
    text = "#include <MPU6050.h>\nMPU6050 mpu;\nvoid setup() { mpu.initialize(); }\nvoid loop() {}\n"
    (problem,) = found(tmp_path, text, alone)
    assert problem.startswith("wiring.toml:4:sensors.1: the sketch never begins Wire (rover.ino)")
    assert problem.endswith("add Wire.begin() to setup()")
    # A library of the team's own may do it.
    assert found(tmp_path, text.replace("<MPU6050.h>", '"MyGyro.h"'), alone) == []


def test_a_gyro_is_spoken_to_where_it_begins(tmp_path: Path) -> None:
    alone = WIRING[: WIRING.index('[[sensors]]\ncode = "t1"')].replace("int = 2\n", "address = 0x69\n")
    text = "#include <Adafruit_MPU6050.h>\nAdafruit_MPU6050 mpu;\nvoid setup() { mpu.begin(); }\n"
    (problem,) = found(tmp_path, text, alone)
    assert "the sketch never speaks to 0x69 (rover.ino); it speaks to 0x68" in problem
    assert found(tmp_path, text.replace("begin()", "begin(0x69)"), alone) == []


def test_each_part_is_read_once_at_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")  # without a compiler nothing is run
    for name, said in (
        ("dmp_interrupt", r"sensors\[1\] g1: 0 deg at the start, turning at 0\.00 deg/s"),
        ("tof_single", r"sensors\[1\] t1: \d+\.\d+ in at the start, a range of \d+ mm"),
    ):
        configuration = set_of(FORMS / name, tmp_path / name)
        wiring = wiring_of(configuration)
        assert wiring is not None
        lines = list(bench_lines(configuration, wiring, []))
        assert re.fullmatch(said, lines[0]), lines


def test_a_check_names_the_wires_of_the_bus(tmp_path: Path) -> None:
    wiring = wiring_of(set_of(FORMS / "dmp_interrupt", tmp_path / "set"))
    assert wiring is not None
    assert "  sensors[1] g1: sda main.A4, scl main.A5, int main.2" in list(wiring_lines(wiring))


DRAFTED = {
    "names of constants": (
        "#include <VL53L0X.h>\n#define SHUT_LEFT 4\nVL53L0X left, right;\nvoid setup() {"
        " pinMode(SHUT_LEFT, OUTPUT); pinMode(5, OUTPUT); digitalWrite(SHUT_LEFT, 1); left.init();"
        " left.setAddress(0x2A); digitalWrite(5, HIGH); right.init(); }",
        [("vl53l0x", 4, 0x2A), ("vl53l0x", 5, None)],
    ),
    "arrays": (
        "#include <VL53L0X.h>\nconst int shut[3] = {9, 8, 7};\nbyte addresses[] = {0x31, 0x32, 0x33};\n"
        "VL53L0X eyes[3];\nvoid setup() { for (int i = 0; i < 3; i++) { digitalWrite(shut[i], HIGH);"
        " eyes[i].init(); eyes[i].setAddress(addresses[i]); } }",
        [("vl53l0x", 9, 0x31), ("vl53l0x", 8, 0x32), ("vl53l0x", 7, 0x33)],
    ),
    "objects": (
        "#include <VL53L0X.h>\nstruct Eye { byte off; byte address; } eyes[] = {{9, 0x31}, {8, 0x32}};\n"
        "VL53L0X tof[2];\nvoid setup() { for (auto &each : eyes) digitalWrite(each.off, LOW);"
        " for (int i = 0; i < 2; i++) { digitalWrite(eyes[i].off, HIGH);"
        " tof[i].init(); tof[i].setAddress(eyes[i].address); } }",
        [("vl53l0x", 9, 0x31), ("vl53l0x", 8, 0x32)],
    ),
    "all at once, by their names": (
        "#include <Adafruit_VL53L0X.h>\n#define SHT_LOX1 7\n#define SHT_LOX2 6\n"
        "Adafruit_VL53L0X lox1 = Adafruit_VL53L0X();\nAdafruit_VL53L0X lox2 = Adafruit_VL53L0X();\n"
        "void setID() { digitalWrite(SHT_LOX1, HIGH); digitalWrite(SHT_LOX2, LOW); lox1.begin(0x30);"
        " digitalWrite(SHT_LOX2, HIGH); lox2.begin(0x31); }",
        [("vl53l0x", 7, 0x30), ("vl53l0x", 6, 0x31)],
    ),
    "all on, and off again but for one": (
        "#define ON_A 11\nconst int onB = 12;\nAdafruit_VL53L0X a, b;\nvoid setup() {"
        " digitalWrite(ON_A, LOW); digitalWrite(onB, LOW); delay(9); digitalWrite(ON_A, HIGH);"
        " digitalWrite(onB, HIGH); delay(9); digitalWrite(onB, LOW); a.begin(0x30);"
        " digitalWrite(onB, HIGH); b.begin(0x31); }",
        [("vl53l0x", 11, 0x30), ("vl53l0x", 12, 0x31)],
    ),
    "a pin that another one has": (
        "VL53L0X a, b;\nvoid setup() { digitalWrite(7, HIGH); a.init(); a.setAddress(0x01);"
        " digitalWrite(7, HIGH); b.init(); }",
        [("vl53l0x", 7, 0x01), ("vl53l0x", None, None)],
    ),
    "one alone": ("Adafruit_VL53L0X lox;\nvoid setup() { lox.begin(); }", [("vl53l0x", None, None)]),
    "a gyro at its second address": (
        "MPU6050 mpu(0x69);\nvoid dmpReady() {}\nvoid setup() { attachInterrupt(1, dmpReady, RISING); }",
        [("mpu6050", 3, 0x69)],
    ),
    "gyros that get their address when they begin": (
        "Adafruit_MPU6050 mpu, other;\nvoid setup() { mpu.begin(); other.begin(0x69); }",
        [("mpu6050", None, None), ("mpu6050", None, 0x69)],
    ),
    "a ranger begun after an encoder's input": (
        "VL53L0X lox;\nvoid tick() {}\nvoid setup() { pinMode(3, INPUT_PULLUP);"
        " attachInterrupt(digitalPinToInterrupt(3), tick, CHANGE); lox.init(); }",
        [("encoder", None, None), ("vl53l0x", None, None)],
    ),
    "a gyro whose argument is the bus": ("MPU6050 mpu(Wire);\nvoid setup() {}", [("mpu6050", None, None)]),
    "two gyros": (
        "MPU6050 mpu;\nMPU6050 second(MPU6050_ADDRESS_AD0_HIGH);\nvoid setup() {}",
        [("mpu6050", None, None), ("mpu6050", None, 0x69)],
    ),
    "a gyro by registers, and a scanner": (
        "const int MPU = 0x68;\nvoid loop() { Wire.beginTransmission(MPU); Wire.requestFrom(MPU, 6);"
        " for (byte a = 1; a < 127; a++) { Wire.beginTransmission(a); } }",
        [("mpu6050", None, None)],
    ),
    "a gyro by registers": (
        "const int MPU = 0x68;\nvoid loop() { Wire.beginTransmission(MPU); Wire.requestFrom(MPU, 6); }",
        [("mpu6050", None, None)],
    ),
}


@pytest.mark.parametrize("form", DRAFTED)
def test_parts_on_a_bus_are_read_off_their_objects(tmp_path: Path, form: str) -> None:
    text, expected = DRAFTED[form]
    (tmp_path / "s.ino").write_text(text, "utf-8")
    made = draft([tmp_path / "s.ino"], tmp_path, [], [], ["t1"], ["g1"])
    assert [
        (row["part"], row.get("xshut", row.get("int")), row.get("address"))
        for row in tomllib.loads(made)["sensors"]
    ] == expected


def test_a_sensor_beside_a_motor_has_its_code(tmp_path: Path) -> None:
    text = (
        "void setup() { pinMode(4, OUTPUT); }\nvoid loop() { analogRead(A3); digitalWrite(4, HIGH);"
        " analogWrite(5, 90); }\n"
    )
    (tmp_path / "s.ino").write_text(text, "utf-8")
    for lines, code in ((["i1", "i2"], "i1"), ([], "i1")):
        made = tomllib.loads(draft([tmp_path / "s.ino"], tmp_path, [], lines, [], []))
        assert [row["pwm"] for row in made["motors"]] == [5]
        assert [row["code"] for row in made["sensors"]] == [code]


def test_a_draft_of_eight_rangers_is_their_wiring(tmp_path: Path) -> None:
    form = FORMS / "tof_eight"
    made = draft([form / "tof_eight.ino"], tmp_path, [], [], ["t1"], [])
    rows = tomllib.loads(made)["sensors"]
    wired = tomllib.loads((form / "wiring.toml").read_text("utf-8"))["sensors"]
    assert [row["xshut"] for row in rows] == [row["xshut"] for row in wired]
    assert [row["code"] for row in rows] == [row["code"] for row in wired]
    assert "add its row to sensors.csv, such as tof2,t2," in made
