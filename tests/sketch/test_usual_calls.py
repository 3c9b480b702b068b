"""Calls and forms of C++ that many sketches have, and that Arduino's build takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.errors import ConfigurationError
from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.build import build_sketch
from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.rovers import ROVER, made_set
from tests.sketch.running import run_boards

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
]
USUAL = """
#include <SPI.h>
typedef unsigned long ulong;
typedef unsigned int uint;
enum State { index, time };
byte board[4][8];
const char first[] PROGMEM = "one";
const char *const table[] PROGMEM = { first };
struct Task { void (*call)(); } task = { blink };
int linux = 3;
int freeRam() {
  extern int __heap_start, *__brkval;
  int v;
  return (int)&v - (__brkval == 0 ? (int)&__heap_start : (int)__brkval);
}
int sum(int n, ...) {
  va_list a;
  va_start(a, n);
  int s = 0;
  for (int i = 0; i < n; i++) s += va_arg(a, int);
  s += (int)va_arg(a, double);
  va_end(a);
  return s;
}
void setup() {
  Serial.begin(115200);
  ulong large = 70000; uint small = 7; board[1][2] = 9;
  Serial.println(large + small + board[1][2] + linux + time);
  Serial.println((const char *)pgm_read_ptr(&table[0]));
  Serial.println(freeRam());
  Serial.println(sum(2, 40, 2, 8.5));
  each(show);
  Serial.println(mx(3, 4));
  int three[3] = {1, 2, 3}; total(three);
  task.call(); say();
  char text[8]; strlcpy(text, "abcdefghij", sizeof text); Serial.println(strupr(text));
}
void loop() {
  if (!Serial.available()) return;
  switch (Serial.read()) {
    case 'v': int v = Serial.parseInt(); Serial.println(v); break;
    case 's': Serial.println("stop"); break;
  }
}
void each(void (*cb)(int)) { cb(5); }
void show(int a) { Serial.println(a); }
template <typename T> T mx(T a, T b) { return a > b ? a : b; }
void total(int (&a)[3]) { Serial.println(a[0] + a[1] + a[2]); }
void __attribute__((noinline)) blink() { Serial.println("blink"); }
void say(char c = ')') { Serial.println(c); }
"""


def test_what_arduino_s_build_takes_compiles_and_runs(tmp_path: Path) -> None:
    run = run_boards(made_set(tmp_path / "set", ROVER, {"rover.ino": USUAL}), 2.0, [(0.5, b"v42 s")])
    assert run.failed == ""
    assert run.text.split() == [
        *("70020", "one", "1500", "50", "5", "4", "6", "blink", ")", "ABCDEFG", "42", "stop"),
    ]


def test_a_text_that_is_compared_with_a_letter_is_told(tmp_path: Path) -> None:
    """Arduino's compiler lets it pass: the branch is never taken."""
    compiler = find_compiler()
    assert compiler is not None
    if not compiler.is_gcc:
        pytest.skip("clang refuses it")
    sketch = tmp_path / "rover.ino"
    sketch.write_text(
        'char *name = "abc";\nvoid setup() {}\nvoid loop() {\n  char c = Serial.read();\n'
        '  if (c == "F") digitalWrite(13, HIGH);\n}\n',
        "utf-8",
    )
    (told,) = build_sketch(sketch, UNO).warnings
    assert told.startswith("rover.ino:5: a text or an address is taken for a number: ")


def test_a_c_file_has_the_names_of_c(tmp_path: Path) -> None:
    """As on a real board: the sketch declares its functions in `extern "C"`."""
    guard = "#ifdef __cplusplus\n{}\n#endif\n"
    sketches = {
        "half.h": guard.format('extern "C" {') + "int half(int a);\n" + guard.format("}"),
        "half.c": '#include "half.h"\n#include <math.h>\n#include <stdlib.h>\n'
        "int half(int a) { return abs(a) / 2; }\n",
        "plain.h": "int plain(int a);\n",
        "plain.c": '#include "plain.h"\nint plain(int a) { return a + 1; }\n',
        "rover.ino": '#include "half.h"\nextern "C" {\n#include "plain.h"\n}\n'
        "void setup() { Serial.begin(9600); Serial.println(half(-84) + plain(1)); }\nvoid loop() {}\n",
    }
    folder = tmp_path / "set" / "rover"
    configuration = made_set(tmp_path / "set", ROVER.replace("rover.ino", "rover/rover.ino"), {})
    folder.mkdir()
    for name, text in sketches.items():
        (folder / name).write_text(text, "utf-8")
    assert run_boards(configuration, 0.3).text == "44\r\n"
    wrong = sketches["rover.ino"].replace('extern "C" {', "").replace("\n}\n", "\n", 1)
    (folder / "rover.ino").write_text(wrong, "utf-8")
    with pytest.raises(ConfigurationError, match=r'plain\(\) is in a \.c file: declare it in extern "C"'):
        build_sketch(folder, UNO)


PINGED = """
#include <NewPing.h>
NewPing sonar(8, 8, 400);
volatile unsigned int cm;
void echoCheck() { if (sonar.check_timer()) cm = sonar.ping_result / US_ROUNDTRIP_CM; }
void setup() {
  Serial.begin(115200);
  unsigned int now = sonar.ping_cm();
  sonar.ping_timer(echoCheck);
  unsigned long begun = millis();
  while (!cm && millis() - begun < 100) { }
  Serial.println(abs((int)now - (int)cm));
  Serial.println(cm > 3);
  sonar.ping_timer(echoCheck, 3); cm = 0; delay(100);
  Serial.println(cm);
}
void loop() {}
"""
SONAR = '[[sensors]]\nboard = "rover"\npart = "hc-sr04"\ncode = "u1"\ntrig = 8\necho = 8\n'


def test_an_echo_by_newping_s_timer_is_that_of_a_ping(tmp_path: Path) -> None:
    run = run_boards(made_set(tmp_path / "set", ROVER + SONAR, {"rover.ino": PINGED}), 1.0)
    near, far, beyond = run.text.split()
    assert int(near) <= 2
    assert (far, beyond) == ("1", "0")


WIDE = """
#include <BluetoothSerial.h>
#include <FunctionalInterrupt.h>
#include "esp_log.h"
BluetoothSerial bt;
struct Wheel {
  int pin; int count = 0;
  Wheel(int pin) : pin(pin) {}
  void begin() { attachInterrupt(pin, [this]() { count++; }, CHANGE); }
} wheel(4);
volatile int plain;
void tick() { plain++; }
void told(esp_spp_cb_event_t event, esp_spp_cb_param_t *values) {
  if (event == ESP_SPP_SRV_OPEN_EVT) Serial.println("client");
}
void setup() {
  Serial.begin(115200);
  Serial.setDebugOutput(true);
  Serial2.setPins(25, 26);
  ESP_LOGI("main", "value %d", 3); log_e("no");
  bt.register_callback(told);
  bt.begin("rover");
  ledcSetup(0, 2000, 8); ledcAttachPin(13, 0);
  Serial.println(ledcWriteTone(0, 440), 0);
  Serial.println(ledcWriteNote(0, NOTE_A, 4), 0);
  wheel.begin();
  attachInterrupt(5, tick, RISING);
  std::function<int(int)> add = [&](int a) { return a + wheel.pin; };
  Serial.println(add(2));
  delay(1000);
  Serial.println(wheel.count > 3);
}
void loop() {}
"""
SPINNING = (
    '[[motors]]\nboard = "rover"\ndriver = "hbridge"\nin1 = 18\nin2 = 19\nwheel = "left"\ntop_speed = 12\n'
    '[[sensors]]\nboard = "rover"\npart = "encoder"\nwheel = "left"\na = 4\nedges_per_inch = 40\n'
)


def test_an_esp32_has_what_its_core_brings(tmp_path: Path) -> None:
    sketch = WIDE.replace(
        "  wheel.begin();", "  pinMode(18, OUTPUT); digitalWrite(18, HIGH);\n  wheel.begin();"
    )
    wiring = ROVER.replace("uno", "esp32") + SPINNING
    run = run_boards(made_set(tmp_path / "set", wiring, {"rover.ino": sketch}), 1.5)
    assert run.failed == ""
    assert run.text.split() == ["client", "440", "440", "6", "1"]
