"""An ESP32: its costs, numbers, pins, PWM, cores and Bluetooth, and what its wiring refuses."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sketch.boards import ESP32, UNO
from simmer_tui.sketch.build import build_sketch
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.known_headers import CPP_STANDARD
from simmer_tui.sketch.sketch_check import sketch_problems
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.wiring import Wiring, WiringParts, read_wiring
from simmer_tui.sketch.wiring_draft import draft
from tests.sketch.rovers import Boards, made_set
from tests.sketch.running import FORMS, run_boards, set_of

no_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
BOARD = '[boards.rover]\nsketch = "rover.ino"\nboard = "esp32"\n[laptop]\nboard = "rover"\n'
LOOP = "void loop() {}\n"


def lines(folder: Path, sketch: str, seconds: float = 1.0) -> list[str]:
    done = run_boards(made_set(folder / "set", BOARD, {"rover.ino": sketch}), seconds)
    assert done.failed == ""
    return done.text.splitlines()


@pytest.mark.slow
@no_compiler
def test_numbers_are_wide_and_calls_cost_a_tenth(tmp_path: Path) -> None:
    sketch = """
#include <limits.h>
unsigned char small = 255;
unsigned short half = 65535;
void setup() {
  Serial.begin(115200);
  int wide = 30000 + 10000;
  long area = 70000;
  Serial.println(wide);
  Serial.println(sizeof(int) * 1000 + sizeof(long) * 100 + sizeof(double) * 10 + sizeof(short));
  Serial.println(INT_MAX == LONG_MAX && small == 255 && half == 65535);
  Serial.println(1.0 / 3, 10);
  Serial.printf("%d %ld %5.2f %s\\n", wide, area, 2.5, "text");
  Serial.flush();
  unsigned long begun = micros();
  for (int i = 0; i < 100; i++) digitalWrite(4, i & 1);
  Serial.println((micros() - begun) / 10);
  int64_t at = esp_timer_get_time();
  delayMicroseconds(1500);
  Serial.println((int)((esp_timer_get_time() - at) / 100));
}
"""
    told = lines(tmp_path, sketch + LOOP)
    assert told[:5] == ["40000", "4482", "1", "0.3333333333", "40000 70000  2.50 text"]
    assert 4 <= int(told[5]) <= 6
    assert told[6] == "15"


@pytest.mark.slow
@no_compiler
@pytest.mark.parametrize(
    "writes",
    [
        "ledcSetup(3, 5000, 12); ledcAttachPin(25, 3); ledcWrite(3, 1024);",
        "ledcAttach(25, 5000, 12); ledcWrite(25, 1024);",
        "analogWriteResolution(12); analogWrite(25, 1024);",
    ],
)
def test_a_duty_has_its_bits_by_every_call(writes: str, tmp_path: Path) -> None:
    sketch = f"void setup() {{ {writes} pinMode(2, OUTPUT); digitalWrite(2, HIGH); }}\n"
    boards = Boards(made_set(tmp_path / "set", BOARD, {"rover.ino": sketch + LOOP}))
    try:
        boards.run_to(0.1)
        (board,) = boards.robot.boards.values()
        assert board.level(25) == pytest.approx(1024 / 4095, abs=2e-5)
        assert boards.robot.views()[0].led
        assert boards.robot.views()[0].led_pin == "2"
    finally:
        boards.close()


@pytest.mark.slow
@no_compiler
def test_both_cores_go_on_as_fast_as_one_alone(tmp_path: Path) -> None:
    sketch = """
volatile unsigned long counts[2];
volatile bool works;
void other(void*) { for (;;) if (works) counts[0]++; else vTaskDelay(1); }
unsigned long counted() {
  counts[1] = 0;
  unsigned long begun = millis();
  while (millis() - begun < 50) counts[1]++;
  return counts[1];
}
void setup() {
  Serial.begin(115200);
  xTaskCreatePinnedToCore(other, "other", 2000, NULL, 5, NULL, CORE);
  delay(5);
  unsigned long alone = counted();
  works = true;
  unsigned long together = counted();
  works = false;
  Serial.println(together * 100 / alone);
  Serial.println(counts[0] > alone);
}
"""
    parallel = lines(tmp_path / "two", sketch.replace("CORE", "0") + LOOP)
    assert 95 <= int(parallel[0]) <= 101
    assert parallel[1] == "1"
    # A task of the same core that is more urgent takes all of its time.
    assert lines(tmp_path / "one", sketch.replace("CORE", "1") + LOOP) == []


@pytest.mark.slow
@no_compiler
def test_a_delay_lets_other_tasks_run(tmp_path: Path) -> None:
    sketch = """
int passes;
void other(void*) { for (;;) { passes++; delay(10); } }
void setup() {
  Serial.begin(115200);
  xTaskCreate(other, "other", 2000, NULL, 1, NULL);
  delay(105);
  Serial.println(passes);
  vTaskDelay(pdMS_TO_TICKS(100));
  Serial.println(xTaskGetTickCount() / 10);
}
"""
    assert lines(tmp_path, sketch + LOOP) == ["11", "20"]


@pytest.mark.slow
@no_compiler
def test_the_busy_share_is_that_of_both_cores_without_their_waits(tmp_path: Path) -> None:
    sketch = "void setup() {}\nvoid loop() { delay(10); delayMicroseconds(10000); }\n"
    boards = Boards(made_set(tmp_path / "set", BOARD, {"rover.ino": sketch}))
    try:
        boards.run_to(2.0)
        boards.robot.views()
        boards.run_to(4.0)
        assert boards.robot.views()[0].busy == pytest.approx(0.5, abs=0.05)
    finally:
        boards.close()


@pytest.mark.slow
@no_compiler
def test_a_task_of_the_other_core_ends_when_it_is_deleted(tmp_path: Path) -> None:
    sketch = """
volatile unsigned long count;
TaskHandle_t handle;
void other(void*) { for (;;) count++; }
void setup() {
  Serial.begin(115200);
  xTaskCreatePinnedToCore(other, "other", 2000, NULL, 1, &handle, 0);
  delayMicroseconds(500);
  vTaskSuspend(handle);
  unsigned long before = count;
  delayMicroseconds(500);
  Serial.println(before > 0 && count == before);
  vTaskResume(handle);
  delayMicroseconds(500);
  Serial.println(count > before);
  vTaskDelete(handle);
  before = count;
  delay(5);
  Serial.println(count == before);
}
"""
    assert lines(tmp_path, sketch + LOOP) == ["1", "1", "1"]


@pytest.mark.slow
@no_compiler
def test_an_attenuation_and_a_resolution_scale_what_analog_read_gives(tmp_path: Path) -> None:
    form = tmp_path / "form"
    form.mkdir()
    text = (FORMS / "esp32_bluetooth" / "wiring.toml").read_text("utf-8")
    (form / "wiring.toml").write_text(
        text.replace("[[0, 3300], [1, 400]]", "[[0, 1001], [1, 1000]]"), "utf-8"
    )
    (form / "esp32_bluetooth.ino").write_text(
        """
#include <BluetoothSerial.h>
BluetoothSerial laptop;
void tell() { laptop.println(analogRead(34)); }
void setup() {
  laptop.begin("rover");
  tell();
  analogReadResolution(10); tell();
  analogReadResolution(13); tell();
  analogReadResolution(12);
  analogSetAttenuation(ADC_6db); tell();
  analogSetPinAttenuation(34, ADC_0db); tell();
  analogSetAttenuation(ADC_11db); tell();
}
"""
        + LOOP,
        "utf-8",
    )
    done = run_boards(set_of(form, tmp_path / "set"), 0.2)
    whole, small, large, six, least, again = map(int, done.text.split())
    assert {whole, again} <= {1000, 1001}
    assert (small, large) == (250, pytest.approx(2001, abs=1))
    assert (six, least) == (pytest.approx(1501, abs=1), pytest.approx(3001, abs=2))


@pytest.mark.slow
@no_compiler
def test_an_esp32_has_the_headers_of_cpp(tmp_path: Path) -> None:
    names = sorted(CPP_STANDARD)
    sketch = (
        "".join(f"#include <{name}>\n" for name in names)
        + """
std::vector<int> readings = {30, 10, 20};
std::map<std::string, int> pins = {{"left", 4}};
std::array<float, 2> shares = {0.25f, 0.5f};
std::function<int(int)> twice = [](int n) { return 2 * n; };
unsigned long late = 7;
float speed = -2.5;
void setup() {
  Serial.begin(115200);
  std::sort(readings.begin(), readings.end());
  Serial.println(readings[0] + pins["left"]);
  Serial.println(std::max(readings[1], 5) + max(late, 3) + min(2.5, 1) + twice(4));
  Serial.println(abs(speed) + std::abs(-1) + std::sqrt(shares[0]));
  Serial.println((int)round(2.6) + constrain(9, 1, 4));
  Serial.println(std::to_string(42).c_str());
}
"""
    )
    assert lines(tmp_path, sketch + LOOP) == ["14", "36.00", "4.00", "7", "42"]


@pytest.mark.slow
@no_compiler
def test_a_board_that_dies_in_a_header_of_cpp_has_the_line_of_its_sketch(tmp_path: Path) -> None:
    sketch = """#include <algorithm>
int *volatile readings;
void setup() { delay(10); }
void loop() { if (millis() > 50) std::reverse(readings, readings + 3); }
"""
    done = run_boards(made_set(tmp_path / "set", BOARD, {"rover.ino": sketch}), 1.0)
    assert done.failed.startswith("board rover died at rover.ino:4 ")


@pytest.mark.slow
@no_compiler
def test_what_sketches_of_an_esp32_have_without_an_include(tmp_path: Path) -> None:
    sketch = """
#include "soc/soc.h"
#include "soc/rtc_cntl_reg.h"
HardwareSerial laptop(0);
HardwareSerial other(2);
int fired;
void ARDUINO_ISR_ATTR edge() {}
void fires(TimerHandle_t) { fired++; }
void setup() {
  WRITE_PERI_REG(RTC_CNTL_BROWN_OUT_REG, 0);
  laptop.begin(115200, SERIAL_8N1, 3, 1);
  other.begin(9600, SERIAL_8N1, 18, 19);
  attachInterrupt(4, edge, RISING);
  analogSetAttenuation(ADC_11db);
  analogSetPinAttenuation(34, ADC_0db);
  analogReadResolution(12);
  xTimerStart(xTimerCreate("t", pdMS_TO_TICKS(10), pdTRUE, NULL, fires), 0);
  delay(55);
  esp_err_t error = ESP_OK;
  laptop.println(fired);
  laptop.println(error == ESP_OK && ESP.getFreeHeap() > 100000);
  laptop.flush();
  ESP.restart();
}
"""
    done = run_boards(made_set(tmp_path / "set", BOARD, {"rover.ino": sketch + LOOP}), 1.0)
    assert done.text.splitlines() == ["5", "1"]
    assert done.failed.startswith(
        "board rover died at rover.ino:23 after 0.0555 s: its sketch called ESP.restart()"
    )


REFUSED = {
    "#include <WiFi.h>": "WiFi.h: WiFi is not simulated; use Bluetooth or the USB port",
    "#include <Servo.h>": "Servo.h is no library of the ESP32; there are .*ESP32Servo.h",
    "void f() { dacWrite(25, 9); }": "dacWrite is not simulated; the calls of an ESP32 are in",
    "void f() { touchRead(4); }": "touchRead is not simulated",
}


@pytest.mark.slow
@no_compiler
@pytest.mark.parametrize("line", REFUSED)
def test_what_an_esp32_lacks_here_is_refused_by_name(line: str, tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(f"{line}\nvoid setup() {{}}\n{LOOP}", "utf-8")
    with pytest.raises(ConfigurationError, match=rf"rover\.ino:1: {REFUSED[line]}"):
        build_sketch(sketch, ESP32)
    sketch.write_text(f"#include <BluetoothSerial.h>\nvoid setup() {{}}\n{LOOP}", "utf-8")
    with pytest.raises(ConfigurationError, match=r"BluetoothSerial\.h is no library of the Uno"):
        build_sketch(sketch, UNO)


PARTS = WiringParts((), WheelsSpec(layout=WheelLayout.DIFF))


def wiring(text: str) -> tuple[Wiring, list[str]]:
    problems: list[Problem] = []
    found = read_wiring(text, PARTS, problems)
    assert found is not None
    return found, [str(each) for each in problems]


def test_the_wiring_of_an_esp32() -> None:
    found, problems = wiring(BOARD)
    assert problems == []
    assert found.laptop is not None
    assert (found.laptop.rx, found.laptop.tx) == (3, 1)
    found, problems = wiring(f"{BOARD}bluetooth = true\n")
    assert problems == []
    _, problems = wiring(f"{BOARD}bluetooth = true\nbaud = 9600\n")
    assert problems == ["wiring.toml:7:laptop.baud: goes with a serial port; bluetooth has none"]
    _, problems = wiring(f"{BOARD.replace('esp32', 'uno')}bluetooth = true\n")
    assert problems == [
        "wiring.toml:6:laptop.bluetooth: the Uno has no Bluetooth of its own; give the pins of its module, "
        "rx and tx"
    ]
    motor = (
        '[[motors]]\nboard = "rover"\ndriver = "pwm2"\nin1 = 34\nin2 = 25\nwheel = "left"\ntop_speed = 12\n'
    )
    _, problems = wiring(BOARD + motor)
    assert problems == [
        "wiring.toml:9:motors.1.in1: pin 34 of the ESP32 is an input alone, as are 34, 35, 36, 37, 38, 39"
    ]
    _, problems = wiring(BOARD + motor.replace("34", "7"))
    assert problems == [
        "wiring.toml:9:motors.1.in1: the ESP32 has no pin 7; it has 0 to 39 without 6, 7, 8, 9, 10, 11, 20, "
        "24, 28, 29, 30, 31"
    ]


def test_a_draft_of_an_esp32_has_its_channels_and_its_bluetooth(tmp_path: Path) -> None:
    made = draft([FORMS / "esp32_bluetooth" / "esp32_bluetooth.ino"], tmp_path, ["u1"], [])
    assert 'board = "esp32"\n' in made
    assert '[laptop]\nboard = "esp32_bluetooth"  # ?\nbluetooth = true  # ?\n# or Serial of' in made
    assert "in1 = 27\nin2 = 26\nen = 14\n" in made
    assert "in1 = 25\nin2 = 33\nen = 32\n" in made
    assert "trig = 5\necho = 18\n" in made
    assert "pin = 13\ngripper = { open = 20, closed = 95 }" in made
    assert "pin = 34  # ? or a knob" in made
    made = draft([FORMS / "esp32_encoders" / "esp32_encoders.ino"], tmp_path, [], [])
    assert "in1 = 26\nin2 = 27\nen = 25\n" in made
    assert "a = 34\nb = 35\n" in made


def test_check_compares_the_ports_and_duties_of_an_esp32() -> None:
    text = """
void setup() {
  Serial2.begin(9600, SERIAL_8N1, 18, 19);
  ledcAttach(25, 5000, 8);
  pinMode(26, OUTPUT);
}
void loop() { ledcWrite(25, Serial2.read()); digitalWrite(26, HIGH); }
"""
    facts = {"rover": SketchFacts({"rover.ino": text}, ESP32)}
    row = '[[motors]]\nboard = "rover"\ndriver = "pwm2"\nin1 = 25\nin2 = 26\nwheel = "left"\ntop_speed = 12\n'
    found, _ = wiring(f"{BOARD}rx = 18\ntx = 19\n{row}")
    assert [str(each) for each in sketch_problems(found, facts, PARTS.wheels)] == []
    text = text.replace("Serial2.begin", "port.begin").replace(
        "void setup", "HardwareSerial port(2);\nvoid setup"
    )
    own = {"rover": SketchFacts({"rover.ino": text}, ESP32)}
    assert [str(each) for each in sketch_problems(found, own, PARTS.wheels)] == []
    found, _ = wiring(f"{BOARD}rx = 16\ntx = 17\n{row.replace('25', '27')}")
    assert [str(each) for each in sketch_problems(found, facts, PARTS.wheels)] == [
        "wiring.toml:11:motors.1.in1: the sketch never writes pin 27 (rover.ino); look at its pin numbers",
        "wiring.toml:8:motors.1: no analogWrite of the sketch is on a pin of this motor: it has full speed "
        "or none (rover.ino)",
        "wiring.toml:4:laptop: the sketch has no serial port with rx 16 and tx 17; it has Serial2 with rx 18 "
        "and tx 19 (rover.ino)",
    ]


CHANNELS = {
    "a loop over an array": (
        "const int p[4] = {25, 26, 32, 33};\nvoid setup() { for (int i = 0; i < 4; i++) {"
        " ledcSetup(i, 5000, 8); ledcAttachPin(p[i], i); } }\n"
        "void forward(int s) { ledcWrite(0, s); ledcWrite(1, 0); ledcWrite(2, s); ledcWrite(3, 0); }",
        [{"in1": 25, "in2": 26}, {"in1": 32, "in2": 33}],
    ),
    "a helper": (
        "#define PWMA 27\n#define CH_B 1\nvoid init(int pin, int ch) { ledcSetup(ch, 5000, 8);"
        " ledcAttachPin(pin, ch); }\nvoid setup() { init(PWMA, 0); init(14, CH_B); }\n"
        "void one(int in1, int in2, int ch, int v) { digitalWrite(in1, v > 0); digitalWrite(in2, v < 0);"
        " ledcWrite(ch, v); }\nvoid loop() { one(25, 26, 0, 200); one(32, 33, CH_B, 200); }",
        [{"in1": 25, "in2": 26, "en": 27}, {"in1": 32, "in2": 33, "en": 14}],
    ),
    "a class": (
        "class Motor { public: Motor(int a, int b, int c, int d) : _a(a), _b(b), _ca(c), _cb(d) {}\n"
        "void begin() { ledcAttachPin(_a, _ca); ledcAttachPin(_b, _cb); }\n"
        "void drive(int v) { ledcWrite(_ca, v); ledcWrite(_cb, 0); } int _a, _b, _ca, _cb; };\n"
        "Motor left(25, 26, 0, 1);\nMotor right(27, 14, 2, 3);\n"
        "void setup() { left.begin(); right.begin(); }\nvoid loop() { left.drive(9); right.drive(9); }",
        [{"in1": 25, "in2": 26}, {"in1": 27, "in2": 14}],
    ),
    "a helper in a loop over two arrays": (
        "int p[] = {27, 14}, c[] = {4, 5};\nvoid init(int pin, int ch) { ledcAttachPin(pin, ch); }\n"
        "void setup() { for (int i = 0; i < 2; i++) init(p[i], c[i]); }\n"
        "void loop() { digitalWrite(18, 1); ledcWrite(4, 9); digitalWrite(19, 1); ledcWrite(5, 9); }",
        [{"dir": 18, "pwm": 27}, {"dir": 19, "pwm": 14}],
    ),
    "channels that are computed": (
        "int p[] = {25, 26};\nvoid setup() { for (int i = 0; i < 2; i++) ledcAttachPin(p[i], i * 2 + 1); }\n"
        "void loop() { ledcWrite(1, 9); ledcWrite(3, 0); }",
        [{"in1": 25, "in2": 26}],
    ),
    "channels and pins that are computed beside the call": (
        "#define FIRST 25\nconst int COUNT = 2;\nvoid setup() { for (int i = 0; i < COUNT; ++i) {\n"
        " int channel = i + COUNT; int pin = FIRST + i; ledcSetup(channel, 5000, 8);"
        " ledcAttachPin(pin, channel); } }\nvoid loop() { ledcWrite(2, 9); ledcWrite(3, 0); }",
        [{"in1": 25, "in2": 26}],
    ),
    "a loop over the elements of an array": (
        "int p[] = {25, 26}, next_ = 0;\nvoid setup() { for (int i = 0; i < sizeof(p) / sizeof(p[0]); i++)"
        " ledcAttachPin(p[i], i); }\nvoid loop() { ledcWrite(0, 9); ledcWrite(1, 0); }",
        [{"in1": 25, "in2": 26}],
    ),
    "channels that are unknown": (
        "int p[] = {25, 26};\nvoid setup() { for (int i = 0; i < 2; i++) ledcAttachPin(p[i], other(i)); }\n"
        "void loop() { ledcWrite(1, 9); ledcWrite(3, 0); }",
        [],
    ),
}


@pytest.mark.parametrize("case", CHANNELS)
def test_a_channel_is_never_drafted_as_a_pin(case: str, tmp_path: Path) -> None:
    text, motors = CHANNELS[case]
    sketch = tmp_path / "rover.ino"
    sketch.write_text(text, "utf-8")
    made = draft([sketch], tmp_path, [], [])
    names = ("in1", "in2", "en", "dir", "pwm")
    found = [
        {name: row[name] for name in names if name in row} for row in tomllib.loads(made).get("motors", [])
    ]
    assert found == motors
    if not motors:
        assert "# ? rover has analogWrite on pins that were not found" in made


@pytest.mark.parametrize("case", CHANNELS)
def test_check_tells_a_motor_pin_that_an_esp32_never_writes(case: str) -> None:
    text, _ = CHANNELS[case]
    row = '[[motors]]\nboard = "rover"\ndriver = "pwm2"\nin1 = 4\nin2 = 5\nwheel = "left"\ntop_speed = 12\n'
    made, _ = wiring(f"{BOARD}{row}")
    assert made is not None
    found = [
        str(each) for each in sketch_problems(made, {"rover": SketchFacts({"rover.ino": text}, ESP32)}, None)
    ]
    assert sum("the sketch never writes pin" in each for each in found) == 2
