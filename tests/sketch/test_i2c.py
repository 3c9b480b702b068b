"""The bus of a board and its parts: what transmissions cost and return, registers, addresses, the FIFO."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.sim import Simulator
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.parts import NOTHING_IN_RANGE, bus_option, range_millimetres
from simmer_tui.sketch.sketch_robot import with_boards
from simmer_tui.sketch.wiring import WiredGyro, WiredRanger
from tests.sketch.rovers import MOTORS, ROVER, Boards, made_set
from tests.sketch.running import FORMS, run_boards, set_of

compiled = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
GYRO = '[[sensors]]\ncode = "g1"\nboard = "rover"\npart = "mpu6050"\n'
RANGER = '[[sensors]]\ncode = "{code}"\nboard = "rover"\npart = "vl53l0x"\n'
CALLS = """
#include <Wire.h>
void took(const char *what, unsigned long begin) {
  unsigned long now = micros();
  Serial.print(what); Serial.print(' '); Serial.println(now - begin);
}
byte put(int address, int count) {
  Wire.beginTransmission(address);
  for (int i = 0; i < count; i++) Wire.write(0x19);
  return Wire.endTransmission();
}
"""


def lines_of(folder: Path, wiring: str, sketch: str, seconds: float = 1.0) -> list[str]:
    run = run_boards(made_set(folder / "set", ROVER + wiring, {"rover.ino": sketch}), seconds)
    assert run.failed == ""
    return run.text.split("\r\n")[:-1]


def test_a_distance_is_given_in_millimetres() -> None:
    assert range_millimetres(10.0) == 254
    assert range_millimetres(0.0) == 0
    assert range_millimetres(1e9) == NOTHING_IN_RANGE
    assert range_millimetres(float("inf")) == range_millimetres(float("nan")) == NOTHING_IN_RANGE


def test_a_board_gets_its_parts_by_their_rows() -> None:
    row = {"label": "sensors[1]", "places": {"": "wiring.toml:1"}, "code": "g1", "board": "rover"}
    gyro = WiredGyro(**row, address=0x69, interrupt=2)  # type: ignore[arg-type]
    ranger = WiredRanger(**row, address=0x30, interrupt=None, xshut=7)  # type: ignore[arg-type]
    assert bus_option(3, gyro) == ["--mpu6050", "3,105,2"]
    assert bus_option(0, ranger) == ["--vl53l0x", "0,7,-1"]


@pytest.mark.slow
@compiled
def test_transmissions_take_the_time_of_their_bytes(tmp_path: Path) -> None:
    sketch = (
        CALLS
        + """
void setup() {
  Serial.begin(115200);
  Serial.println(put(0x68, 1));
  Wire.begin();
  Serial.println(put(0x68, 1)); Serial.println(put(0x69, 1)); Serial.println(put(0x29, 0));
  unsigned long t = micros(); put(0x50, 5); took("nobody", t);
  t = micros(); put(0x68, 3); took("three", t);
  t = micros(); Wire.requestFrom(0x68, 14); took("fourteen", t);
  Wire.setClock(400000);
  t = micros(); Wire.requestFrom(0x68, 14); took("fast", t);
  TWBR = 72;
  t = micros(); Wire.requestFrom(0x68, 14); took("slow", t);
  Serial.println(Wire.requestFrom(0x68, 40)); Serial.println(Wire.available());
  Serial.println(Wire.requestFrom(0x50, 4)); Serial.println(Wire.read()); Serial.println(Wire.peek());
  Wire.beginTransmission(0x68);
  int taken = 0;
  for (int i = 0; i < 40; i++) taken += Wire.write(0);
  Serial.println(taken);
  Wire.setWireTimeout(3000, true); Wire.end();
  Serial.println(put(0x68, 1));
}
void loop() {}
"""
    )
    found = lines_of(tmp_path, GYRO, sketch)
    assert found[:4] == ["4", "0", "2", "2"]
    assert found[9:] == ["32", "32", "0", "-1", "-1", "32", "4"]
    took = {name: int(value) for name, value in (each.split() for each in found[4:9])}
    # Besides, the calls and the blocks of the sketch, and steps of 4 us of its clock.
    for name, bus in (("nobody", 95), ("three", 380), ("fourteen", 1425), ("fast", 337.5), ("slow", 1425)):
        assert bus <= took[name] <= bus + 24, name


@pytest.mark.slow
@compiled
def test_interrupts_go_on_while_the_bus_is_used_and_wire_in_one_never_ends(tmp_path: Path) -> None:
    sketch = (
        CALLS
        + """
volatile int count = 0;
void edge() { count++; }
void bad() { Serial.println("in"); put(0x68, 1); Serial.println("never"); }
void setup() {
  Serial.begin(115200);
  Wire.begin();
  attachInterrupt(digitalPinToInterrupt(2), edge, RISING);
  put(0x6B, 0);
  Wire.beginTransmission(0x68); Wire.write(0x6B); Wire.write(0); Wire.endTransmission();
  Wire.beginTransmission(0x68); Wire.write(0x1A); Wire.write(1); Wire.endTransmission();
  Wire.beginTransmission(0x68); Wire.write(0x38); Wire.write(1); Wire.endTransmission();
  count = 0;
  unsigned long t = micros();
  for (int i = 0; i < 10; i++) Wire.requestFrom(0x68, 20);
  took("reads", t);
  Serial.println(count);
  Wire.beginTransmission(0x68); Wire.write(0x38); Wire.write(0); Wire.endTransmission();
  noInterrupts(); bad();
}
void loop() {}
"""
    )
    wiring = ROVER + GYRO + "int = 2\n"
    run = run_boards(made_set(tmp_path / "set", wiring, {"rover.ino": sketch}), 0.5)
    reads, count, *rest = run.text.split("\r\n")
    # 1 kHz with the filter on. The function's time is within that of the bus.
    assert 19_950 <= int(reads.split()[1]) <= 20_100
    assert int(count) in (19, 20, 21)
    assert rest == ["in", ""]
    assert run.notices == [
        "board rover waits without end at rover.ino:10: Wire needs interrupts, which are off there, as in an "
        "interrupt's function"
    ]


READ_AND_WRITE = (
    CALLS
    + """
void setup() { Serial.begin(115200); Wire.begin(); Wire.setClock(400000); }
void loop() {
  if (Serial.available() < 3) return;
  int what = Serial.read(), reg = Serial.read(), value = Serial.read();
  Wire.beginTransmission(0x68);
  Wire.write(reg);
  if (what == 'w') Wire.write(value);
  Wire.endTransmission(what == 'w');
  if (what == 'w') return;
  Wire.requestFrom(0x68, value);
  while (Wire.available()) { Serial.print(Wire.read()); Serial.print(' '); }
  Serial.println();
}
"""
)


@pytest.mark.slow
@compiled
@pytest.mark.parametrize("seed", range(3))
def test_registers_hold_what_is_written_and_bursts_go_on(tmp_path: Path, seed: int) -> None:
    chance = random.Random(seed)
    free = (*range(0x13, 0x1D), 0x23, 0x37, 0x38)
    model = [0] * 128
    model[0x6B], model[0x75] = 0x40, 0x68
    sent, expected, time = [], [], 0.3
    for number in range(80):
        if number == 40:
            # Asleep there are no data; awake, 1 g and 25 degrees.
            sent.append((time, b"w\x6b\x00"))
            model[0x6B] = 0
        elif chance.random() < 0.5:
            reg, value = chance.choice((*free, 0x75, 0x41)), chance.randrange(256)
            value &= ~0x18 if reg == 0x38 else 0xFF
            sent.append((time, bytes((ord("w"), reg, value))))
            if reg in free:
                model[reg] = value
        else:
            reg, count = (
                chance.choice((0x13, 0x18, 0x1B, 0x37, 0x3B, 0x41, 0x6B, 0x75)),
                chance.randrange(1, 7),
            )
            if number > 40:
                one = 16384 >> (model[0x1C] >> 3 & 3)
                if reg < 0x49 and reg + count > 0x3B:
                    model[0x3F:0x43] = [one >> 8, one & 255, *(-3920).to_bytes(2, "big", signed=True)]
            # INT_STATUS has a clock of its own.
            if reg <= 0x3A < reg + count:
                count = 0x3A - reg
            sent.append((time, bytes((ord("r"), reg, count))))
            expected.append(model[reg : reg + count])
        time += 0.01
    run = run_boards(
        made_set(tmp_path / "set", ROVER + GYRO, {"rover.ino": READ_AND_WRITE}), time + 0.1, sent
    )
    found = [[int(each) for each in line.split()] for line in run.text.split("\r\n")[:-1]]
    assert found == expected


RATES = """
#include <Wire.h>
int readWord(byte reg) {
  Wire.beginTransmission(0x69); Wire.write(reg); Wire.endTransmission(false);
  Wire.requestFrom(0x69, 2);
  return Wire.read() << 8 | Wire.read();
}
void put(byte reg, byte value) {
  Wire.beginTransmission(0x69); Wire.write(reg); Wire.write(value); Wire.endTransmission();
}
void setup() {
  Serial.begin(115200); Wire.begin(); Wire.setClock(400000);
  put(0x6B, 0);
  Serial.println(readWord(0x47));
  analogWrite(9, 51); analogWrite(6, 51);
  delay(200);
  for (int range = 0; range < 4; range++) { put(0x1B, range << 3); Serial.println(readWord(0x47)); }
  put(0x1B, 0); put(0x17, 0x01); put(0x18, 0x48);
  Serial.println(readWord(0x47));
  put(0x17, 0); put(0x18, 0);
  analogWrite(9, 255); analogWrite(6, 255);
  delay(200);
  Serial.println(readWord(0x47));
}
void loop() {}
"""


@pytest.mark.slow
@compiled
def test_the_rate_is_that_of_the_robot_in_each_range(tmp_path: Path) -> None:
    configuration = made_set(
        tmp_path / "set", ROVER + MOTORS + GYRO + "address = 0x69\n", {"rover.ino": RATES}
    )
    boards = Boards(configuration, noise=False)
    for kind in boards.simulator.bias:
        boards.simulator.set_bias({kind: type(boards.simulator.bias[kind])()})
    boards.run_to(1.0)
    sent = bytes(value for _, value in boards.robot.lockstep.sent).decode()
    boards.close()
    rest, *rates, shifted, fastest = map(int, sent.split())
    leg = boards.simulator.leg
    assert leg is not None
    # A fifth of full duty to the left, then all of it: more than 250 deg/s.
    slow = leg.commanded.r / 5
    assert slow > 40.0
    assert rest == 0
    assert rates == [pytest.approx(slow * 131 / (1 << each), abs=0.6) for each in range(4)]
    # 328 counts of the offset are 10 deg/s.
    assert shifted == pytest.approx((slow + 10) * 131, abs=1)
    assert fastest == min(round(leg.commanded.r * 131), 32767)


TWO_RANGERS = """
#include <Wire.h>
#include <VL53L0X.h>
#include <Adafruit_VL53L0X.h>
VL53L0X left;
Adafruit_VL53L0X right;
void scan() {
  for (int address = 0x20; address < 0x40; address++) {
    Wire.beginTransmission(address);
    if (Wire.endTransmission() == 0) { Serial.print(address, HEX); Serial.print(' '); }
  }
  Serial.println();
}
void setup() {
  Serial.begin(115200);
  Wire.begin();
  scan();
  pinMode(7, OUTPUT); pinMode(8, OUTPUT);
  scan();
  digitalWrite(7, HIGH); delayMicroseconds(100); scan();
  delay(1); Serial.println(right.begin(0x30));
  digitalWrite(8, HIGH); delay(2); scan();
  left.setTimeout(500);
  Serial.println(left.init());
  left.setAddress(0x31);
  scan();
  left.setMeasurementTimingBudget(60000);
  unsigned long t = millis();
  Serial.print(left.readRangeSingleMillimeters()); Serial.print(' '); Serial.println(millis() - t);
  t = millis();
  Serial.print(right.readRange()); Serial.print(' '); Serial.print(right.readRangeStatus());
  Serial.print(' '); Serial.println(millis() - t);
  left.writeReg16Bit(0x71, 0);
  t = millis(); left.readRangeSingleMillimeters(); Serial.println(millis() - t);
  left.setMeasurementTimingBudget(60000);
  left.startContinuous(100);
  right.startRangeContinuous();
  for (int i = 0; i < 3; i++) {
    t = millis();
    left.readRangeContinuousMillimeters();
    Serial.print(millis() - t); Serial.print(' ');
  }
  Serial.println(right.isRangeComplete());
  right.readRangeResult();
  Serial.println(right.isRangeComplete());
  left.stopContinuous();
  left.setTimeout(50);
  delay(200); left.readRangeContinuousMillimeters();
  t = millis();
  Serial.print(left.readRangeContinuousMillimeters()); Serial.print(left.timeoutOccurred());
  Serial.println(left.timeoutOccurred());
  digitalWrite(7, LOW); digitalWrite(7, HIGH); delay(2);
  scan();
  Serial.println(right.begin(0x29));
  digitalWrite(7, LOW);
  Serial.println(right.begin());
}
void loop() {}
"""


@pytest.mark.slow
@compiled
def test_rangers_begin_at_one_address_and_are_off_by_xshut(tmp_path: Path) -> None:
    wiring = RANGER.format(code="t1") + "xshut = 8\n" + RANGER.format(code="u1") + "xshut = 7\n"
    found = lines_of(tmp_path, wiring, TWO_RANGERS, 2.5)
    assert found[:6] == ["29 ", "", "", "1", "29 30 ", "1"]
    assert found[6] == "30 31 "
    single, took = map(int, found[7].split())
    assert 0 < single <= NOTHING_IN_RANGE
    assert 61 <= took <= 64
    reading, status, took = map(int, found[8].split())
    assert (status == 4) == (reading == NOTHING_IN_RANGE)
    assert 35 <= took <= 39
    # No measurement is shorter than 20 ms, whatever is written.
    assert 21 <= int(found[9]) <= 25
    first, second, third, is_complete = map(int, found[10].split())
    # The first one takes the budget, the next ones come each 100 ms.
    assert 58 <= first <= 62
    assert 98 <= second <= 101
    assert 98 <= third <= 101
    assert is_complete == 1
    assert found[11:] == ["0", "6553510", "29 31 ", "1", "0"]


JUST_RELEASED = """
#include <VL53L0X.h>
#include <Adafruit_VL53L0X.h>
VL53L0X left;
Adafruit_VL53L0X right;
void setup() {
  Serial.begin(115200);
  Wire.begin();
  pinMode(7, OUTPUT); pinMode(8, OUTPUT);
  digitalWrite(8, HIGH); Serial.println(left.init());
  digitalWrite(8, LOW);
  digitalWrite(7, HIGH); Serial.println(right.begin(0x30));
  digitalWrite(7, LOW); Serial.println(right.begin(0x30));
}
void loop() {}
"""


@pytest.mark.slow
@compiled
def test_adafruit_asks_who_is_there_when_a_released_ranger_has_begun(tmp_path: Path) -> None:
    """Pololu's library asks at first, and gets no answer yet."""
    wiring = RANGER.format(code="t1") + "xshut = 8\n" + RANGER.format(code="u1") + "xshut = 7\n"
    assert lines_of(tmp_path, wiring, JUST_RELEASED, 1.0) == ["0", "1", "0"]


NOT_WAITING = """
#include <Wire.h>
#include <VL53L0X.h>
VL53L0X eye;
bool ready() { return (eye.readReg(VL53L0X::RESULT_INTERRUPT_STATUS) & 0x07) != 0; }
void setup() {
  Serial.begin(115200);
  Wire.begin();
  eye.init();
  Serial.println(eye.readReg(VL53L0X::IDENTIFICATION_MODEL_ID), HEX);
  eye.startContinuous();
  for (int i = 0; i < 2; i++) {
    Serial.print(ready()); Serial.print(' ');
    delay(36);
    Serial.print(ready()); Serial.print(' ');
    Serial.print(eye.readReg16Bit(VL53L0X::RESULT_RANGE_STATUS + 10)); Serial.print(' ');
    eye.writeReg(VL53L0X::SYSTEM_INTERRUPT_CLEAR, 0x01);
    Serial.println(ready());
  }
  eye.writeReg(VL53L0X::SYSRANGE_START, 0x01);
  delay(80);
  Serial.println(ready());
}
void loop() {}
"""


@pytest.mark.slow
@compiled
def test_a_ranger_is_read_by_the_names_of_its_registers(tmp_path: Path) -> None:
    found = lines_of(tmp_path, RANGER.format(code="t1"), NOT_WAITING, 1.0)
    assert found[0] == "EE"
    for line in found[1:3]:
        before, after, reading, cleared = map(int, line.split())
        assert (before, after, cleared) == (0, 1, 0)
        assert 0 < reading <= NOTHING_IN_RANGE
    assert found[3] == "0"


OWN_GYRO = """
#include "MPU6050_6Axis_MotionApps20.h"
MPU6050 mpu(0x69);
uint8_t buffer[64];
Quaternion q; VectorFloat gravity; VectorInt16 gyro, accel, linear; float ypr[3];
void show() {
  if (!mpu.dmpGetCurrentFIFOPacket(buffer)) { Serial.println("none"); return; }
  mpu.dmpGetQuaternion(&q, buffer);
  mpu.dmpGetGravity(&gravity, &q);
  mpu.dmpGetYawPitchRoll(ypr, &q, &gravity);
  mpu.dmpGetGyro(&gyro, buffer); mpu.dmpGetAccel(&accel, buffer);
  mpu.dmpGetLinearAccel(&linear, &accel, &gravity);
  Serial.print(ypr[0] * 180 / M_PI); Serial.print(' '); Serial.print(gyro.z / 16.4);
  Serial.print(' '); Serial.print(accel.z); Serial.print(' '); Serial.println(linear.z);
}
void setup() {
  Serial.begin(115200);
  Wire.begin();
  Wire.setClock(400000);
  MPU6050 other;
  mpu.initialize();
  Serial.print(mpu.testConnection()); Serial.print(other.testConnection());
  Serial.print(other.dmpInitialize());
  unsigned long t = millis();
  Serial.println(mpu.dmpInitialize());
  Serial.println(millis() - t);
  show();
  mpu.setDMPEnabled(true);
  Serial.println(mpu.getFIFOCount());
  delay(25);
  Serial.println(mpu.getFIFOCount());
  show();
  CALIBRATE
  delay(1000);
  show();
  mpu.setDMPEnabled(false);
  mpu.resetFIFO();
  show();
}
void loop() {}
"""


@pytest.mark.slow
@compiled
@pytest.mark.parametrize("calibrates", [False, True])
def test_packets_have_the_angle_of_the_row(tmp_path: Path, calibrates: bool) -> None:
    sketch = OWN_GYRO.replace(
        "CALIBRATE", "mpu.CalibrateGyro(1);" if calibrates else "mpu.setZGyroOffset(-85);"
    )
    configuration = made_set(tmp_path / "set", ROVER + GYRO + "address = 0x69\n", {"rover.ino": sketch})
    drifting = drifting_gyro(configuration, 2.0)
    run = run_boards(drifting, 3.0)
    first, took, none, *rest = run.text.split("\r\n")[:-1]
    assert first == "1010"
    assert 150 <= int(took) <= 200
    assert none == rest[-1] == "none"
    assert rest[:2] == ["0", "84"]
    yaw, rate, accel, linear = rest[2].split()
    assert float(rate) == pytest.approx(2.0, abs=0.04)
    assert (accel, linear) == ("8192", "0")
    # Drift to the left lowers the yaw. Calibrated after 0.1 s, it goes on no more.
    last = float(rest[3].split()[0])
    assert float(yaw) == pytest.approx(-0.04, abs=0.02)
    assert last == pytest.approx(-0.35 if calibrates else -2.1, abs=0.12)


LIGHT = """
#include <Wire.h>
#include <MPU6050_light.h>
MPU6050 mpu(Wire);
void setup() {
  Serial.begin(115200);
  Wire.begin();
  mpu.setAddress(0x69); Serial.print(mpu.begin());
  mpu.setAddress(0x68); Serial.print(mpu.begin());
  unsigned long t = millis();
  mpu.calcOffsets();
  Serial.println(millis() - t);
  Serial.print(mpu.getGyroZoffset()); Serial.print(' '); Serial.print(mpu.getTemp());
  Serial.print(' '); Serial.println(mpu.getAccZ() - mpu.getAccZoffset());
  mpu.update();
  analogWrite(6, 51); analogWrite(9, 51);
  t = millis();
  while (millis() - t < 500) mpu.update();
  analogWrite(6, 0); analogWrite(9, 0);
  mpu.update();
  Serial.print(mpu.getAngleX()); Serial.print(' '); Serial.println(mpu.getAngleZ());
}
void loop() {}
"""


@pytest.mark.slow
@compiled
def test_angles_are_summed_up_by_the_light_library(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + MOTORS + GYRO, {"rover.ino": LIGHT})
    boards = Boards(drifting_gyro(configuration, 2.0), noise=False)
    boards.run_to(3.0)
    pose = boards.simulator.pose
    first, second, third = bytes(value for _, value in boards.robot.lockstep.sent).decode().splitlines()
    boards.close()
    assert first.startswith("20")
    assert 1280 <= int(first[2:]) <= 1340
    assert second == "2.00 25.00 1.00"
    tilt, yaw = map(float, third.split())
    assert tilt == 0.0
    # Steps of a millisecond miss the first and the last turn of the loop.
    assert yaw == pytest.approx(pose.heading, rel=0.02)
    assert yaw > 20.0


BY_EVENTS = """
#include <Adafruit_MPU6050.h>
#include <Adafruit_Sensor.h>
#include <Wire.h>
Adafruit_MPU6050 mpu;
void setup() {
  Serial.begin(115200);
  Serial.print(mpu.begin(0x69));
  unsigned long t = millis();
  Serial.print(mpu.begin()); Serial.print(' '); Serial.println(millis() - t);
  mpu.setAccelerometerRange(MPU6050_RANGE_8_G);
  mpu.setGyroRange(MPU6050_RANGE_1000_DEG);
  mpu.setFilterBandwidth(MPU6050_BAND_21_HZ);
  Serial.print(mpu.getAccelerometerRange()); Serial.print(mpu.getGyroRange());
  Serial.println(mpu.getFilterBandwidth());
  delay(500);
  sensors_event_t a, g, temp;
  mpu.getEvent(&a, &g, &temp);
  Serial.print(a.acceleration.z); Serial.print(' '); Serial.print(g.gyro.z * 57.29578);
  Serial.print(' '); Serial.println(temp.temperature);
  mpu.getGyroSensor()->getEvent(&g);
  Serial.println(g.gyro.z * SENSORS_RADS_TO_DPS);
}
void loop() {}
"""
BY_TOCKN = """
#include <MPU6050_tockn.h>
#include <Wire.h>
MPU6050 mpu6050(Wire);
void setup() {
  Serial.begin(115200);
  Wire.begin();
  mpu6050.begin();
  unsigned long t = millis();
  mpu6050.calcGyroOffsets(true);
  Serial.println(millis() - t);
  mpu6050.update();
  Serial.print(mpu6050.getGyroZoffset()); Serial.print(' '); Serial.print(mpu6050.getRawGyroZ());
  Serial.print(' '); Serial.print(mpu6050.getAccZ()); Serial.print(' '); Serial.println(mpu6050.getGyroZ());
  analogWrite(6, 51); analogWrite(9, 51);
  t = millis();
  while (millis() - t < 500) mpu6050.update();
  Serial.print(mpu6050.getAngleZ()); Serial.print(' '); Serial.println(mpu6050.getGyroAngleZ());
}
void loop() {}
"""


def quiet(folder: Path, sketch: str, seconds: float) -> tuple[list[str], float]:
    """The lines that a rover with a gyro of 2 deg/s drift sends without errors, and its heading."""
    boards = Boards(
        drifting_gyro(made_set(folder / "set", ROVER + MOTORS + GYRO, {"rover.ino": sketch}), 2.0),
        noise=False,
    )
    for kind in boards.simulator.bias:
        boards.simulator.set_bias({kind: type(boards.simulator.bias[kind])()})
    boards.run_to(seconds)
    lines = bytes(value for _, value in boards.robot.lockstep.sent).decode().splitlines()
    boards.close()
    return lines, boards.simulator.pose.heading


@pytest.mark.slow
@compiled
def test_events_of_adafruit_s_library_are_in_units_of_the_si(tmp_path: Path) -> None:
    (first, settings, both, alone), _ = quiet(tmp_path, BY_EVENTS, 2.0)
    assert re.fullmatch(r"01 3\d\d", first)
    assert settings == "224"
    assert both == "9.81 2.02 25.00"
    assert alone == "2.02"


@pytest.mark.slow
@compiled
def test_angles_are_summed_up_by_tockn_s_library(tmp_path: Path) -> None:
    lines, heading = quiet(tmp_path, BY_TOCKN, 10.5)
    took, values, angles = lines[-3:]
    # Waits of 1 and 3 s, and 3,000 readings of 1.6 ms.
    assert 8_800 <= int(took) <= 8_900
    assert values == "2.00 131 1.00 0.00"
    yaw, turned = map(float, angles.split())
    assert yaw == turned
    assert 20 < yaw < heading % 360


SHORT_PACKETS = """
#include "MPU6050_6Axis_MotionApps612.h"
MPU6050 mpu;
uint8_t packet[64];
Quaternion q; VectorFloat gravity; VectorInt16 gyro, accel, linear; float ypr[3];
void setup() {
  Serial.begin(115200);
  Wire.begin();
  Wire.setClock(400000);
  mpu.initialize();
  Serial.print(mpu.dmpInitialize()); Serial.print(' '); Serial.println(mpu.dmpGetFIFOPacketSize());
  mpu.setDMPEnabled(true);
  delay(25);
  Serial.println(mpu.getFIFOCount());
  analogWrite(6, 51); analogWrite(9, 51);
  delay(300);
  Serial.println(mpu.dmpGetCurrentFIFOPacket(packet));
  mpu.dmpGetQuaternion(&q, packet);
  mpu.dmpGetGravity(&gravity, &q);
  mpu.dmpGetYawPitchRoll(ypr, &q, &gravity);
  mpu.dmpGetGyro(&gyro, packet); mpu.dmpGetAccel(&accel, packet);
  mpu.dmpGetLinearAccel(&linear, &accel, &gravity);
  Serial.print(ypr[0] * 180 / M_PI); Serial.print(' '); Serial.print(gyro.x); Serial.print(gyro.y);
  Serial.print(' '); Serial.print(gyro.z / 16.4);
  Serial.print(' '); Serial.print(accel.z); Serial.print(' '); Serial.println(linear.z);
}
void loop() {}
"""


@pytest.mark.slow
@compiled
def test_packets_of_the_later_motion_processor_have_28_bytes(tmp_path: Path) -> None:
    (begun, count, one, values), _ = quiet(tmp_path, SHORT_PACKETS, 1.0)
    assert (begun, count, one) == ("0 28", "56", "1")
    yaw, sides, rate, accel, linear = values.split()
    assert float(yaw) == pytest.approx(-0.3 * float(rate), rel=0.05)
    assert float(rate) > 40
    assert (sides, accel, linear) == ("00", "16384", "0")


FILTERED = """
#include <MPU6050.h>
MPU6050 mpu;
void setup() {
  Serial.begin(115200);
  Wire.begin(); Wire.setClock(400000);
  mpu.initialize();
  mpu.setFullScaleGyroRange(MPU6050_GYRO_FS_2000);
  mpu.setDLPFMode(MODE);
  long last = mpu.getRotationZ();
  analogWrite(6, 102); analogWrite(9, 102);
  unsigned long begin = micros(), sum = 0;
  for (int i = 0; i < 200; i++) {
    while (micros() - begin < 1000UL * (i + 1)) {}
    int z = mpu.getRotationZ();
    sum += z;
    Serial.println(z);
  }
}
void loop() {}
"""


@pytest.mark.slow
@compiled
@pytest.mark.parametrize(("mode", "delay"), [(0, 0.98), (3, 4.8), (6, 18.6)])
def test_a_rate_lags_behind_a_step_as_its_filter_says(tmp_path: Path, mode: int, delay: float) -> None:
    lines, _ = quiet(tmp_path, FILTERED.replace("MODE", str(mode)), 1.0)
    rates = [int(each) for each in lines]
    assert rates == sorted(rates)
    last = rates[-1]
    assert rates[-20] == pytest.approx(last, abs=1)
    # Milliseconds by which the readings lag, from the area above them; half a sample and a transfer besides.
    first = 2.0 * 16.4
    lag = sum((last - each) / (last - first) for each in rates)
    assert lag == pytest.approx(delay, abs=0.8)


def drifting_gyro(configuration: Configuration, drift: float) -> Configuration:
    spec = configuration.simulation
    sensors = tuple(replace(each, drift=drift) if each.code == "g1" else each for each in spec.sensors)
    return replace(configuration, simulation=replace(spec, sensors=sensors))


@pytest.mark.slow
@compiled
@pytest.mark.parametrize("form", ["gyro_registers", "dmp_interrupt"])
def test_slices_of_any_length_give_the_same_run(form: str, tmp_path: Path) -> None:
    configuration = set_of(FORMS / form, tmp_path / "set")
    spec = configuration.simulation
    walking = tuple(replace(each, random_walk=0.3) if each.code == "g1" else each for each in spec.sensors)
    configuration = replace(configuration, simulation=replace(spec, sensors=walking))
    runs = []
    for slice_length in (100_000, 1_000_000, 20_000_000):
        boards = Boards(configuration, slice_length=slice_length)
        boards.run_to(2.5)
        runs.append((boards.simulator.pose, boards.robot.lockstep.sent, repr(boards.events)))
        boards.close()
    assert runs[0] == runs[1] == runs[2]


def test_the_error_of_a_rate_adds_up_to_the_random_walk(tmp_path: Path) -> None:
    configuration = drifting_gyro(made_set(tmp_path / "set", ROVER, {"rover.ino": ""}), 0.5)
    spec = with_boards(configuration).simulation
    walking = tuple(replace(each, random_walk=0.3) if each.code == "g1" else each for each in spec.sensors)
    simulator = Simulator(replace(spec, sensors=walking), 1)
    errors = [simulator.rate_error("g1", 0.02) for _ in range(4000)]
    # Of 4,000 draws the spread is known to 1.1 %.
    spread = (sum(each * each for each in errors) / len(errors)) ** 0.5
    assert spread * 0.02 * 50**0.5 == pytest.approx(0.3, rel=0.05)
    assert simulator.count_rate("g1") == 0.5
    simulator.noise = False
    assert simulator.rate_error("g1", 0.02) == 0.0


@pytest.mark.slow
@compiled
def test_a_full_fifo_is_told_with_the_line_that_waits(tmp_path: Path) -> None:
    run = run_boards(set_of(FORMS / "dmp_interrupt", tmp_path / "set"), 3.0)
    assert len(run.notices) == 1
    assert re.fullmatch(
        r"board main: the FIFO of sensors\[1\] g1 overflowed at dmp_interrupt\.ino:75: it holds 1,024 bytes "
        r"of packets, one each 10 ms, and nothing read them",
        run.notices[0],
    )
