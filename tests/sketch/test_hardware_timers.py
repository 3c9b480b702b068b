"""Hardware timers of an ESP32: their alarms as interrupts at exact times, by the calls of both cores."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.sim.records import CommandResult
from simmer_tui.sketch.boards import ESP32
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.interrupt_check import interrupt_functions, interrupt_problems
from simmer_tui.sketch.sketch_scan import SketchFacts
from tests.sketch.rovers import Boards, made_set
from tests.sketch.running import run_boards

no_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
BOARD = '[boards.rover]\nsketch = "rover.ino"\nboard = "esp32"\n[laptop]\nboard = "rover"\n'
LOOP = "void loop() { delay(10); }\n"
TOLD = """hw_timer_t *timer;
volatile int count;
volatile uint32_t times[20];
void IRAM_ATTR fires() { if (count < 20) times[count] = micros(); count++; }
void tell() {
  for (int i = 0; i < count && i < 20; i++) { Serial.print(times[i] - times[0]); Serial.print(' '); }
  Serial.println(count);
}
"""
BEGUN = "timer = timerBegin(1000000); timerAttachInterrupt(timer, fires); timerAlarm(timer, 1000, true, 0);"


def lines(folder: Path, sketch: str, seconds: float = 0.5) -> list[str]:
    done = run_boards(made_set(folder / "set", BOARD, {"rover.ino": sketch}), seconds)
    assert (done.failed, done.notices) == ("", [])
    return done.text.splitlines()


@pytest.mark.slow
@no_compiler
@pytest.mark.parametrize(
    ("begins", "told"),
    [
        # Core 2: a divider of 80 MHz, and an alarm that is written and enabled.
        (
            "timer = timerBegin(0, 80, true); timerAttachInterrupt(timer, &fires, true);"
            " timerAlarmWrite(timer, 1000, true); timerAlarmEnable(timer);",
            "0 1000 2000 3000 4000 5",
        ),
        # Core 3: a frequency, and one call.
        (
            BEGUN,
            "0 1000 2000 3000 4000 5",
        ),
        # 80 MHz by 26, 325 ns: it begins again at 1,000.
        (
            "timer = timerBegin(3000000); timerAttachInterrupt(timer, fires);"
            " timerAlarm(timer, 4000, true, 1000);",
            "0 975 1950 2925 3900 5",
        ),
        (
            "timer = timerBegin(2, 80, true); timerAttachInterrupt(timer, fires, true);"
            " timerAlarmWrite(timer, 1000, false); timerAlarmEnable(timer);",
            "0 1",
        ),
        # The count is over already.
        (
            "timer = timerBegin(1000000); timerAttachInterrupt(timer, fires); timerWrite(timer, 5000);"
            " timerAlarm(timer, 1000, false, 0);",
            "0 1",
        ),
        # Nothing is attached, nothing is enabled, or it stands.
        ("timer = timerBegin(1000000); timerAlarm(timer, 1000, true, 0);", "0"),
        (
            "timer = timerBegin(0, 80, true); timerAttachInterrupt(timer, fires, true);"
            " timerAlarmWrite(timer, 1000, true);",
            "0",
        ),
        (
            BEGUN + " timerStop(timer);",
            "0",
        ),
        (
            BEGUN + " delayMicroseconds(2500); timerAlarmDisable(timer);",
            "0 1000 2",
        ),
        (
            BEGUN + " delayMicroseconds(2500); timerDetachInterrupt(timer);",
            "0 1000 2",
        ),
        (
            BEGUN + " delayMicroseconds(2500); timerEnd(timer);",
            "0 1000 2",
        ),
    ],
)
def test_alarms_come_at_their_times(begins: str, told: str, tmp_path: Path) -> None:
    sketch = f"{TOLD}void setup() {{ Serial.begin(115200); {begins} delayMicroseconds(5400);\n"
    sketch += "noInterrupts(); tell(); }\n"
    (found,) = lines(tmp_path, sketch + LOOP)
    assert found == told


@pytest.mark.slow
@no_compiler
def test_a_timer_counts_stands_and_goes_on(tmp_path: Path) -> None:
    sketch = """void setup() {
  Serial.begin(115200);
  hw_timer_t *timer = timerBegin(1000000);
  delayMicroseconds(500);
  timerStop(timer);
  delayMicroseconds(500);
  Serial.println((int)timerRead(timer) / 10);
  Serial.println(timerStarted(timer));
  timerStart(timer);
  delayMicroseconds(500);
  Serial.println((int)timerReadMicros(timer) / 10);
  timerRestart(timer);
  delay(20);
  Serial.println((int)timerReadMilis(timer));
  Serial.println(timerReadSeconds(timer), 2);
  Serial.println(timerGetFrequency(timer));
  timerWrite(timer, 7000);
  Serial.println((int)timerRead(timer) / 10);
  timerAlarmWrite(timer, 9000, false);
  Serial.println((int)timerAlarmReadMicros(timer));
  Serial.println(timerBegin(50000000) == NULL && timerBegin(4, 80, true) == NULL && timerBegin(1000) == NULL);
}
"""
    assert lines(tmp_path, sketch + LOOP) == [
        *("50", "0", "100"),
        *("19", "0.02", "1000000", "700", "9000", "1"),
    ]


@pytest.mark.slow
@no_compiler
def test_an_alarm_wakes_the_task_of_a_control_loop(tmp_path: Path) -> None:
    sketch = """
SemaphoreHandle_t tick;
volatile uint32_t at;
void IRAM_ATTR fires(void *which) {
  at = micros();
  BaseType_t woken = pdFALSE;
  xSemaphoreGiveFromISR(*(SemaphoreHandle_t *)which, &woken);
  if (woken) portYIELD_FROM_ISR();
}
void controls(void *) {
  for (int n = 0; n < 100; n++) {
    xSemaphoreTake(tick, portMAX_DELAY);
    uint32_t late = micros() - at;
    if (n % 25 == 0) Serial.println(late < 20);
  }
  Serial.println(millis());
  vTaskDelete(NULL);
}
void setup() {
  Serial.begin(115200);
  tick = xSemaphoreCreateBinary();
  xTaskCreatePinnedToCore(controls, "Control", 4000, NULL, 3, NULL, 1);
  hw_timer_t *timer = timerBegin(1000000);
  timerAttachInterruptArg(timer, fires, &tick);
  timerAlarm(timer, 2000, true, 0);
}
void loop() { }
"""
    *late, end = lines(tmp_path, sketch)
    assert late == ["1"] * 4
    assert 200 <= int(end) <= 202


@pytest.mark.slow
@no_compiler
def test_alarms_merge_while_interrupts_are_off_and_a_notice_has_the_line(tmp_path: Path) -> None:
    sketch = (
        TOLD
        + """void setup() {
  Serial.begin(115200);
  timer = timerBegin(1000000);
  timerAttachInterrupt(timer, fires);
  timerAlarm(timer, 1000, true, 0);
  noInterrupts();
  delayMicroseconds(4500);
  interrupts();
  delayMicroseconds(1000);
  timerAlarmDisable(timer);
  tell();
}
"""
    )
    done = run_boards(made_set(tmp_path / "set", BOARD, {"rover.ino": sketch + LOOP}), 0.5)
    # One for the four that came meanwhile, and the fifth at its time.
    assert done.text.split()[-1] == "2"
    (told,) = done.notices
    assert told.startswith("board rover: an alarm of a hardware timer was lost at rover.ino:")
    assert told.endswith(": interrupts were off since the one before")


@pytest.mark.slow
@no_compiler
def test_slices_of_any_length_give_the_same_alarms(tmp_path: Path) -> None:
    sketch = """
volatile bool high;
void fires() { high = !high; digitalWrite(4, high); if (high) Serial.write('.'); }
void setup() {
  Serial.begin(115200);
  pinMode(4, OUTPUT);
  hw_timer_t *timer = timerBegin(0, 7, true);
  timerAttachInterrupt(timer, fires, true);
  timerAlarmWrite(timer, 9001, true);
  timerAlarmEnable(timer);
}
volatile long busy;
void loop() { busy++; }
"""
    configuration = made_set(tmp_path / "set", BOARD, {"rover.ino": sketch})
    runs = []
    for slice_length in (100_000, 5_000_000, 20_000_000):
        boards = Boards(configuration, slice_length=slice_length)
        boards.run_to(0.2)
        boards.close()
        runs.append((repr(boards.events), boards.robot.lockstep.sent))
    assert len(runs[0][1]) > 100
    assert runs[1:] == runs[:1] * 2


@pytest.mark.slow
@no_compiler
def test_a_timer_steps_the_wheels(tmp_path: Path) -> None:
    """1,000 steps a second of a hundredth of an inch each, for 0.6 s, whatever loop() does."""
    motors = "".join(
        f'[[motors]]\nboard = "rover"\ndriver = "step_dir"\nstep = {step}\ndir = {step + 1}\n'
        f'steps_per_inch = 100\nwheel = "{wheel}"\n'
        for step, wheel in ((25, "left"), (32, "right"))
    )
    sketch = """
volatile int steps;
hw_timer_t *timer;
void IRAM_ATTR fires() {
  bool high = steps % 2 == 0;
  digitalWrite(25, high);
  digitalWrite(32, high);
  if (++steps == 1200) timerAlarmDisable(timer);
}
void setup() {
  const int pins[] = {25, 26, 32, 33};
  for (int pin : pins) pinMode(pin, OUTPUT);
  digitalWrite(26, HIGH);
  digitalWrite(33, HIGH);
  timer = timerBegin(1000000);
  timerAttachInterrupt(timer, fires);
  timerAlarm(timer, 500, true, 0);
}
volatile long busy;
void loop() { busy++; if (busy % 1000 == 0) delay(7); }
"""
    boards = Boards(made_set(tmp_path / "set", BOARD + motors, {"rover.ino": sketch}), noise=False)
    boards.simulator.set_bias({kind: type(bias)() for kind, bias in boards.simulator.bias.items()})
    x = boards.simulator.pose.x
    try:
        boards.run_to(2.0)
        assert boards.simulator.pose.x - x == pytest.approx(6.0, abs=0.02)
        moves = [each for each in boards.events if isinstance(each, CommandResult)]
        assert moves[-1].time == pytest.approx(0.6, abs=0.005)
    finally:
        boards.close()


def test_check_looks_at_the_functions_of_timers() -> None:
    text = """void fires() { Serial.println(1); }
void edge(void *which) { delay(1); }
void setup() {
  hw_timer_t *timer = timerBegin(0, 80, true);
  timerAttachInterrupt(timer, &fires, true);
  attachInterruptArg(4, edge, NULL, RISING);
}
"""
    facts = SketchFacts({"rover.ino": text}, ESP32)
    assert list(interrupt_functions(facts)) == ["fires", "edge"]
    assert [each.mode for each in facts.interrupts()] == ["RISING"]
    assert [str(each).partition(" in ")[0] for each in interrupt_problems(facts)] == [
        "rover.ino:1: Serial.println",
        "rover.ino:2: delay",
    ]
