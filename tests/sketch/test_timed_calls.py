"""Calls at their time: the timer of NewPing, sleep, the timers and the watchdog of an ESP32's system; and a
servo's angle that is written before it is attached."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.errors import ConfigurationError
from simmer_tui.run.events import MovementEnded
from simmer_tui.sketch.boards import ESP32, UNO, BoardKind
from simmer_tui.sketch.build import build_sketch
from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.rovers import MOTORS, ROVER, made_set
from tests.sketch.running import BoardRun, run_boards

no_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
pytestmark = [pytest.mark.slow, no_compiler]
ESP = '[boards.rover]\nsketch = "rover.ino"\nboard = "esp32"\n[laptop]\nboard = "rover"\n'
SONAR = '[[sensors]]\nboard = "rover"\npart = "hc-sr04"\ncode = "u1"\ntrig = 4\necho = 2\n'


def run(folder: Path, sketch: str, wiring: str = ROVER + MOTORS, seconds: float = 1.0) -> BoardRun:
    done = run_boards(made_set(folder / "set", wiring, {"rover.ino": sketch}), seconds)
    assert done.failed == ""
    return done


def numbers(folder: Path, sketch: str, wiring: str = ROVER + MOTORS, seconds: float = 1.0) -> list[int]:
    done = run(folder, sketch, wiring, seconds)
    assert done.notices == []
    return [int(each) for each in done.text.split()]


def test_newping_calls_a_function_again_and_again(tmp_path: Path) -> None:
    """Its period is a millisecond longer, as the library counts; a call costs an interrupt each."""
    sketch = """
#include <NewPing.h>
volatile int count; volatile unsigned long first, last;
void ticks() { if (!count++) first = micros(); last = micros(); }
unsigned long worked() {
  unsigned long n = 0, begun = millis();
  while (millis() - begun < 100) n++;
  return n;
}
void setup() {
  Serial.begin(115200);
  Serial.println(worked());
  NewPing::timer_ms(9, ticks);
  Serial.println(worked());
  NewPing::timer_stop();
  Serial.println(count);
  Serial.println((last - first) / (count - 1));
  NewPing::timer_us(40, ticks);
  Serial.println(worked());
  NewPing::timer_stop();
  count = 0; delay(50);
  Serial.println(count);
}
void loop() {}
"""
    free, at_times, count, period, often, stopped = numbers(tmp_path, sketch)
    assert 9 <= count <= 10
    assert period in (9_996, 10_000, 10_004)
    # 7.5 us of each millisecond, and some more in every tenth; then at least a quarter of the time.
    assert 0.98 * free < at_times < 0.995 * free
    assert often < 0.75 * free
    assert stopped == 0


def test_a_ping_by_timer_is_that_of_a_ping_and_costs_time(tmp_path: Path) -> None:
    sketch = """
#include <NewPing.h>
NewPing sonar(4, 2, 300);
volatile unsigned int echo; volatile int checks;
void looks() { checks++; if (sonar.check_timer()) echo = sonar.ping_result; }
void setup() {
  Serial.begin(115200);
  unsigned int direct = sonar.ping();
  delay(50);
  sonar.ping_timer(looks);
  delay(50);
  Serial.println(abs((int)direct - (int)echo));
  Serial.println((long)checks * 24 - echo);
}
void loop() {}
"""
    apart, late = numbers(tmp_path, sketch, ROVER + SONAR)
    assert apart <= 300  # the sensor has another error by then
    assert abs(late) <= 80


def test_a_servo_goes_to_the_angle_that_is_written_before_it_is_attached(tmp_path: Path) -> None:
    """Of a gripper: one whose jaws are closed by it closes, and the middle alone does nothing."""
    servo = '[[servos]]\nboard = "rover"\npin = 3\ngripper = { open = 10, closed = 90 }\n'
    sketch = """
#include <Servo.h>
Servo jaws;
void setup() {
  Serial.begin(115200);
  WRITES
  jaws.attach(3);
  Serial.println(jaws.readMicroseconds());
}
void loop() {}
"""
    closed = run(tmp_path / "a", sketch.replace("WRITES", "jaws.write(90);"), ROVER + servo)
    assert closed.text.split() == ["1472"]
    assert any(isinstance(each, MovementEnded) and each.grip for each in closed.events)
    idle = run(tmp_path / "b", sketch.replace("WRITES", ""), ROVER + servo)
    assert idle.text.split() == ["1500"]
    assert not any(isinstance(each, MovementEnded) and each.grip for each in idle.events)


SLEEPS = """
#include <avr/sleep.h>
#include <avr/power.h>
volatile int edges; volatile unsigned long at;
void wakes() { edges++; at = micros(); }
void ping() { digitalWrite(4, HIGH); delayMicroseconds(10); digitalWrite(4, LOW); }
void setup() {
  Serial.begin(115200);
  pinMode(4, OUTPUT);
  attachInterrupt(0, wakes, CHANGE);
  BODY
}
void loop() {}
"""


def test_an_idle_sleep_ends_with_each_interrupt_and_each_millisecond(tmp_path: Path) -> None:
    body = """
  delay(20);
  set_sleep_mode(SLEEP_MODE_IDLE);
  unsigned long begun = micros();
  for (int i = 0; i < 100; i++) sleep_mode();
  Serial.println(micros() - begun);
  ping(); edges = 0;
  int naps = 0;
  while (edges == 0) { sleep_mode(); naps++; }
  Serial.println(micros() - at < 50);
  Serial.println(naps);
  sleep_cpu();  // it is not enabled
  Serial.println(millis() > 120);
"""
    done = run(tmp_path, SLEEPS.replace("BODY", body), ROVER + SONAR, 1.5)
    hundred, at_once, naps, _ = map(int, done.text.split())
    assert 101_000 < hundred < 103_500
    assert (at_once, naps) == (1, 1)


def test_a_deep_sleep_lasts_until_a_pin_and_stops_the_clock(tmp_path: Path) -> None:
    """Also one that an interrupt has ended between sei() and sleep_cpu()."""
    body = """
  set_sleep_mode(SLEEP_MODE_PWR_DOWN);
  delay(5);
  ping(); edges = 0;
  unsigned long begun = micros();
  cli(); sleep_enable(); sei(); sleep_cpu(); sleep_disable();
  Serial.println(edges);
  Serial.println(micros() - begun < 100);
  delay(40); ping(); edges = 0;
  cli(); while (digitalRead(2) == LOW) {} sleep_enable(); sei(); sleep_cpu(); sleep_disable();
  Serial.println(edges);
"""
    done = run(tmp_path, SLEEPS.replace("BODY", body), ROVER + SONAR, 1.5)
    assert done.text.split() == ["1", "1", "1"]


def test_a_byte_that_comes_in_a_deep_sleep_is_lost(tmp_path: Path) -> None:
    sketch = """
#include <avr/sleep.h>
void setup() { Serial.begin(9600); }
void loop() { MODE sleep_mode(); if (Serial.available()) Serial.write(Serial.read()); }
"""
    for mode, text in (("", "a"), ("set_sleep_mode(SLEEP_MODE_PWR_DOWN);", "")):
        configuration = made_set(
            tmp_path / f"set{text}", ROVER + MOTORS, {"rover.ino": sketch.replace("MODE", mode)}
        )
        done = run_boards(configuration, 1.0, [(0.5, b"a")])
        assert done.text == text
        assert len([each for each in done.notices if "lost" in each]) == (not text)


def test_tickers_and_timers_of_an_esp32_call_at_their_times(tmp_path: Path) -> None:
    sketch = """
#include <Ticker.h>
#include <esp_timer.h>
Ticker again, once, with;
volatile int count, ones, sum; volatile int64_t first, last, alone;
void ticks() { if (!count++) first = esp_timer_get_time(); last = esp_timer_get_time(); }
void adds(int value) { sum += value; if (sum >= 21) with.detach(); }
void fires(void* value) { alone = esp_timer_get_time(); ones += *(int*)value; }
int three = 3;
esp_timer_handle_t timer, steady;
void setup() {
  Serial.begin(115200);
  again.attach_ms(5, ticks);
  once.once(0.02, [] { ones++; });
  with.attach(0.002, adds, 7);
  esp_timer_create_args_t values = {};
  values.callback = fires; values.arg = &three; values.name = "one";
  ESP_ERROR_CHECK(esp_timer_create(&values, &timer));
  int64_t begun = esp_timer_get_time();
  esp_timer_start_once(timer, 12345);
  Serial.println(esp_timer_start_once(timer, 1) == ESP_ERR_INVALID_STATE);
  delay(52);
  again.detach();
  Serial.println(count); Serial.println((long)(last - first)); Serial.println(ones); Serial.println(sum);
  Serial.println((long)(alone - begun));
  Serial.println(once.active() + esp_timer_is_active(timer));
  esp_timer_start_periodic(timer, 1000);
  delay(10);
  esp_timer_stop(timer);
  Serial.println(ones);
  delay(20);
  Serial.println(count * 100 + ones);
}
void loop() { delay(1); }
"""
    told = numbers(tmp_path, sketch, ESP)
    assert told[:3] == [1, 10, 45_000]
    assert told[3:5] == [4, 21]
    assert 12_345 <= told[5] <= 12_380
    assert told[6:] == [0, 4 + 3 * 10, 1000 + 4 + 3 * 10] or told[6:] == [0, 4 + 3 * 9, 1000 + 4 + 3 * 9]


def test_the_watchdog_of_tasks_tells_one_that_does_not_call_it(tmp_path: Path) -> None:
    sketch = """
#include <esp_task_wdt.h>
void drives(void*) { esp_task_wdt_add(NULL); for (int i = 0;; i++) {
  if (i < 50) esp_task_wdt_reset();
  delay(20);
} }
void looks(void*) { esp_task_wdt_add(NULL); for (;;) { esp_task_wdt_reset(); delay(500); } }
void setup() {
  INIT
  xTaskCreate(drives, "Drive", 2000, NULL, 1, NULL);
  xTaskCreate(looks, "Eyes", 2000, NULL, 1, NULL);
}
void loop() { delay(1); }
"""
    said = "board rover: task Drive at rover.ino:5 has not called esp_task_wdt_reset for 2 s: "
    for name, init, does in (
        ("two", "esp_task_wdt_init(2, true);", "the task watchdog restarts a real ESP32"),
        (
            "three",
            "esp_task_wdt_config_t all = {2000, 0, false}; esp_task_wdt_init(&all);",
            "the task watchdog prints a warning on a real ESP32",
        ),
    ):
        done = run(tmp_path / name, sketch.replace("INIT", init), ESP, 4.0)
        assert done.notices == [said + does]


@pytest.mark.parametrize(
    ("line", "kind", "told"),
    [
        ("#include <Ticker.h>", UNO, r"Ticker\.h is no library of the Uno; there are .*NewPing\.h"),
        ("#include <esp_timer.h>", UNO, r"esp_timer\.h is no library of the Uno"),
        ("#include <avr/sleep.h>", ESP32, r"avr/sleep\.h is no library of the ESP32; there are .*Ticker\.h"),
        (
            "#include <WiFi.h>",
            ESP32,
            r"WiFi\.h: WiFi is not simulated; use Bluetooth or the USB port; there are .*Ticker\.h",
        ),
        ("void f() { touchRead(4); }", ESP32, "touchRead is not simulated"),
        ("void f() { touchAttachInterrupt(4, f, 9); }", ESP32, "touchAttachInterrupt is not simulated"),
        ("void f() { esp_deep_sleep_start(); }", ESP32, "esp_deep_sleep_start is not simulated"),
    ],
)
def test_what_a_board_lacks_is_refused_by_name(line: str, kind: BoardKind, told: str, tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(f"{line}\nvoid setup() {{}}\nvoid loop() {{}}\n", "utf-8")
    with pytest.raises(ConfigurationError, match=rf"rover\.ino:1: {told}"):
        build_sketch(sketch, kind)
