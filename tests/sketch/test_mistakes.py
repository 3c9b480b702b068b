"""Mistakes that a board tells while it runs: tasks that wait for ever or never run, mutexes of others, waits
of no tick, pins that cannot do it, and calls within an interrupt."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.log_reports import build_report
from simmer_tui.report.moments import MomentKind
from simmer_tui.run.events import Notice
from simmer_tui.sketch.bench_check import bench_lines
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.wiring import wiring_of
from tests.sketch.rovers import MOTORS, ROVER, Boards, made_set
from tests.sketch.running import run_boards

no_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
pytestmark = [pytest.mark.slow, no_compiler]
AVR = "#include <Arduino_FreeRTOS.h>\n#include <queue.h>\n#include <semphr.h>\n#include <timers.h>\n"
ESP = '[boards.rover]\nsketch = "rover.ino"\nboard = "esp32"\n[laptop]\nboard = "rover"\n'
LOOP = "void loop() {}\n"


def notices(folder: Path, sketch: str, seconds: float = 2.5, wiring: str = ROVER + MOTORS) -> list[str]:
    done = run_boards(made_set(folder / "set", wiring, {"rover.ino": sketch}), seconds)
    assert done.failed == ""
    return [each.removeprefix("board rover: ") for each in done.notices]


CIRCLE = """SemaphoreHandle_t bus, log_;
void drives(void*) {
  for (;;) {
    xSemaphoreTake(bus, portMAX_DELAY);
    vTaskDelay(3);
    xSemaphoreTake(log_, portMAX_DELAY);
  }
}
void looks(void*) {
  for (;;) {
    xSemaphoreTake(log_, portMAX_DELAY);
    vTaskDelay(3);
    xSemaphoreTake(bus, portMAX_DELAY);
  }
}
void setup() {
  bus = xSemaphoreCreateMutex();
  log_ = xSemaphoreCreateMutex();
  xTaskCreate(drives, "Drive", 2000, NULL, 1, NULL);
  xTaskCreate(looks, "Eyes", 2000, NULL, 1, NULL);
}
"""


@pytest.mark.parametrize("board", ["uno", "esp32"])
def test_tasks_that_wait_for_each_others_mutex_are_told_at_once(board: str, tmp_path: Path) -> None:
    """Though loop() goes on, which an ESP32 runs as a task."""
    is_uno = board == "uno"
    loop = LOOP if is_uno else "void loop() { delay(100); }\n"
    wiring = ROVER + MOTORS if is_uno else ESP
    (told,) = notices(tmp_path, (AVR if is_uno else "\n\n\n\n") + CIRCLE + loop, wiring=wiring)
    drive = "Drive at rover.ino:10 for a mutex, which Eyes took at rover.ino:15"
    eyes = "Eyes at rover.ino:17 for a mutex, which Drive took at rover.ino:8"
    assert told in (
        f"tasks wait for each other for ever: {one}; {other}; take them in the same order in all tasks"
        for one, other in ((drive, eyes), (eyes, drive))
    )


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (
            "xSemaphoreTake(lock, 5);\nxSemaphoreTake(lock, portMAX_DELAY);",
            "Drive waits for ever at rover.ino:7 for the mutex that it took itself at rover.ino:6; give it "
            "back first, or make it recursive",
        ),
        (
            "vTaskDelay(5);\nxSemaphoreTake(lock, portMAX_DELAY);",
            "Drive at rover.ino:7 for a mutex, which Eyes took at rover.ino:10: it waits for ever, since "
            "that task was deleted with its mutex",
        ),
    ],
)
def test_a_mutex_that_nobody_can_give_back_is_told(body: str, told: str, tmp_path: Path) -> None:
    sketch = f"""SemaphoreHandle_t lock;
void drives(void*) {{
{body}
for (;;) vTaskDelay(1); }}
void looks(void*) {{
  xSemaphoreTake(lock, 1); vTaskDelete(NULL);
}}
void setup() {{
  lock = xSemaphoreCreateMutex();
  xTaskCreate(drives, "Drive", 2000, NULL, 2, NULL);
  xTaskCreate(looks, "Eyes", 2000, NULL, 1, NULL);
}}
"""
    assert notices(tmp_path, AVR.replace("#include <queue.h>\n", "") + sketch + LOOP) == [told]


WAITS = """
QueueHandle_t orders; SemaphoreHandle_t ready; TimerHandle_t timer;
int edges; void counts() { edges++; }
void gives() { xSemaphoreGiveFromISR(ready, NULL); }
void fires(TimerHandle_t) {}
void drives(void*) { int item; for (;;)
    xQueueReceive(orders, &item, portMAX_DELAY); }
void looks(void*) { for (;;)
    xSemaphoreTake(ready, portMAX_DELAY); }
void sends(void*) { int item = 1; for (;;)
    xQueueSend(orders, &item, portMAX_DELAY); }
void listens(void*) { for (;;)
    ulTaskNotifyTake(pdTRUE, portMAX_DELAY); }
void rests(void*) { vTaskSuspend(NULL); }
void parks(void*) { for (;;) vTaskDelay(portMAX_DELAY); }
void setup() {
  ready = xSemaphoreCreateBinary();
  orders = xQueueCreate(1, sizeof(int));
  xTaskCreate(TASK, "Drive", 2000, NULL, 1, NULL);
  xTaskCreate(looks, "Eyes", 2000, NULL, 2, NULL);
  xTaskCreate(listens, "Ears", 2000, NULL, 2, NULL);
  xTaskCreate(rests, "Rest", 2000, NULL, 2, NULL);
  xTaskCreate(parks, "Park", 2000, NULL, 2, NULL);
  MORE
}
"""


def all_wait(task: str = "drives", more: str = "", loop: str = LOOP) -> str:
    return AVR + WAITS.replace("TASK", task).replace("MORE", more) + loop


EYES = "Eyes at rover.ino:13 for a semaphore; Ears at rover.ino:17 for a notification"


def test_all_tasks_that_wait_for_ever_are_told_with_what_they_wait_for(tmp_path: Path) -> None:
    (told,) = notices(tmp_path / "one", all_wait())
    drive = "Drive at rover.ino:11 for an item of a queue"
    assert told.startswith(f"all tasks wait for ever: {drive}; {EYES}; Rest")
    assert told.endswith("for vTaskResume")
    # The one that fills a queue waits too. An interrupt that gives nothing does not help them, and no loop().
    more, loop = "attachInterrupt(0, counts, RISING);", "void loop() { digitalWrite(13, HIGH); delay(30); }\n"
    (told,) = notices(tmp_path / "two", all_wait("sends", more, loop))
    drive = "Drive at rover.ino:15 for room in a queue"
    assert told.startswith(f"all tasks but loop() wait for ever: {drive}; {EYES}")


@pytest.mark.parametrize("loop", [LOOP, "void loop() { vTaskDelay(1000); }\n", "void loop() { delay(9); }\n"])
def test_all_tasks_of_an_esp32_wait_though_loop_goes_on(loop: str, tmp_path: Path) -> None:
    sketch = all_wait(loop=loop).replace(AVR, "\n\n\n\n")
    (told,) = notices(tmp_path, sketch, wiring=ESP)
    but = " but loop()" if "elay" in loop else ""
    drive = "Drive at rover.ino:11 for an item of a queue"
    assert told.startswith(f"all tasks{but} wait for ever: {drive}; {EYES}; Rest")


def test_tasks_of_an_esp32_that_wait_for_setup_are_not_told(tmp_path: Path) -> None:
    sketch = all_wait(more="delay(1500); xSemaphoreGive(ready);").replace(AVR, "\n\n\n\n")
    # What setup() gives is not told; nothing gives what two others wait for.
    (first,) = notices(tmp_path, sketch, 2.0, ESP)
    assert "Eyes" not in first
    assert "task Drive" in first
    assert "task Ears" in first
    told = notices(tmp_path / "then", sketch, 3.0, ESP)
    assert told[0] == first
    assert told[1].startswith("all tasks wait for ever: ")


@pytest.mark.parametrize(
    "sketch",
    [
        all_wait(more="attachInterrupt(0, gives, RISING);"),
        all_wait(more='xTimerStart(xTimerCreate("t", 9, pdTRUE, NULL, fires), 0);'),
        all_wait(loop="void loop() { if (digitalRead(8)) xSemaphoreGive(ready); }\n"),
        all_wait(loop=LOOP + "void serialEvent() { xSemaphoreGive(ready); }\n"),
        AVR + "void parks(void*) { for (;;) vTaskDelay(portMAX_DELAY); }\n"
        'void setup() { xTaskCreate(parks, "Park", 2000, NULL, 2, NULL); }\n' + LOOP,
    ],
)
def test_tasks_that_something_can_wake_are_not_told(sketch: str, tmp_path: Path) -> None:
    """All tasks together; Ears is told, for which there is no notification."""
    for told in notices(tmp_path, sketch):
        assert told.startswith("task Drive waits")
        assert "Park" not in told


def test_a_task_that_never_waits_is_told_with_those_that_never_run(tmp_path: Path) -> None:
    sketch = """
void drives(void*) {
  for (;;) {
    delay(20);
  }
}
void looks(void*) { for (;;) vTaskDelay(10); }
void setup() {
  xTaskCreate(drives, "Drive", 2000, NULL, 2, NULL);
  xTaskCreate(looks, "Eyes", 2000, NULL, 1, NULL);
}
"""
    (told,) = notices(tmp_path / "empty", AVR + sketch + LOOP)
    assert told.startswith(
        "Eyes has not run for 1 s: Drive, of higher priority, has not waited meanwhile at rover.ino:"
    )
    assert told.endswith("; give it a vTaskDelay")
    assert told.split("rover.ino:")[1].split(";")[0] in ("7", "8")
    (told,) = notices(tmp_path / "loop", AVR + sketch + "void loop() { digitalWrite(13, HIGH); }\n")
    assert told.startswith("Eyes, loop() have not run for 1 s: Drive")
    # Two that are more urgent and take turns.
    both = """
TaskHandle_t tasks[2];
void drives(void* me) {
  for (;;) {
    delay(20);
    xTaskNotifyGive(tasks[me ? 0 : 1]);
    ulTaskNotifyTake(pdTRUE, portMAX_DELAY);
  }
}
void looks(void*) { for (;;) vTaskDelay(10); }
void setup() {
  xTaskCreate(drives, "Drive", 2000, NULL, 2, &tasks[0]);
  xTaskCreate(drives, "Hand", 2000, tasks, 2, &tasks[1]);
  xTaskCreate(looks, "Eyes", 2000, NULL, 1, NULL);
}
"""
    (told,) = notices(tmp_path / "two", AVR + both + LOOP)
    assert told.startswith("Eyes has not run for 1 s: tasks of higher priority always have work, now ")


def test_a_task_for_which_no_core_is_free_is_told_once(tmp_path: Path) -> None:
    sketch = """volatile long counts[2];
void drives(void* which) { for (;;) counts[which ? 1 : 0]++; }
void looks(void*) { for (;;) delay(10); }
void setup() {
  xTaskCreate(looks, "Eyes", 2000, NULL, 1, NULL);
  xTaskCreatePinnedToCore(drives, "Drive", 2000, NULL, 2, NULL, 0);
  xTaskCreatePinnedToCore(drives, "Hand", 2000, counts, 2, NULL, 1);
}
"""
    told = notices(tmp_path, sketch + LOOP, 3.0, ESP)
    assert sum("Eyes has not run" in each or "Eyes at" in each for each in told) == 1
    assert sum("loop() at" in each for each in told) == 1


def test_the_task_watchdog_of_an_esp32_is_told(tmp_path: Path) -> None:
    sketch = """void drives(void*) {
  volatile long count = 0;
  for (;;) count++;
}
void looks(void*) { for (;;) delay(10); }
void setup() {
  xTaskCreatePinnedToCore(drives, "Drive", 2000, NULL, 2, NULL, CORE);
  MORE
}
"""
    eyes = 'xTaskCreatePinnedToCore(looks, "Eyes", 2000, NULL, 1, NULL, CORE);'
    both = (sketch.replace("MORE", eyes) + LOOP).replace("CORE", "0")
    (told,) = notices(tmp_path / "both", both, 1.5, ESP)
    assert told == (
        "Eyes has not run for 1 s: Drive, of higher priority, has not waited meanwhile at rover.ino:3; "
        "give it a vTaskDelay; the task watchdog restarts a real ESP32 after 5 s of that on core 0"
    )
    alone = (sketch.replace("MORE", "") + LOOP).replace("CORE", "0")
    (told,) = notices(tmp_path / "alone", alone, 5.5, ESP)
    assert told == (
        "task Drive at rover.ino:3 has not waited for 5 s, and core 0 was never idle: the task watchdog "
        "restarts a real ESP32; give it a vTaskDelay(1)"
    )
    off = alone.replace("void setup() {", "void setup() { disableCore0WDT();")
    assert notices(tmp_path / "off", off, 5.5, ESP) == []
    # Core 1 has none: there loop() runs, which mostly never waits.
    (told,) = notices(tmp_path / "other", both.replace(", 0);", ", 1);"), 1.5, ESP)
    assert told == (
        "loop() at rover.ino:7 has not run for 1 s: Drive, of higher priority, has not waited meanwhile at "
        "rover.ino:3; give it a vTaskDelay"
    )
    assert notices(tmp_path / "loop", "void setup() {}\n" + LOOP, 5.5, ESP) == []


@pytest.mark.parametrize("give", ["xSemaphoreGive(lock)", "xSemaphoreGiveFromISR(lock, NULL)"])
def test_a_mutex_that_another_task_holds_cannot_be_given_back(give: str, tmp_path: Path) -> None:
    sketch = f"""SemaphoreHandle_t lock;
void drives(void*) {{ xSemaphoreTake(lock, portMAX_DELAY); for (;;) vTaskDelay(9); }}
void looks(void*) {{
  vTaskDelay(3);
  {give};
  for (;;) vTaskDelay(9);
}}
void setup() {{
  lock = xSemaphoreCreateMutex();
  xTaskCreate(drives, "Drive", 2000, NULL, 1, NULL);
  xTaskCreate(looks, "Eyes", 2000, NULL, 2, NULL);
}}
"""
    done = run_boards(made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": AVR + sketch + LOOP}), 1.0)
    assert done.failed.startswith("board rover died at rover.ino:9 in task Eyes after 0.0")
    assert done.failed.endswith(
        "it gave back a mutex that task Drive holds; only the task that took it may give it back"
    )


def test_waits_and_periods_of_no_tick_are_told_once_a_line(tmp_path: Path) -> None:
    sketch = """
int pause = 10;
void drives(void*) {
  for (;;) {
    vTaskDelay(pause / portTICK_PERIOD_MS);
    vTaskDelay(0);
    pause += 1;
    if (pause > 30) vTaskDelay(5);
  }
}
void fires(TimerHandle_t) {}
void setup() {
  xTaskCreate(drives, "Drive", 2000, NULL, 1, NULL);
  TimerHandle_t none = xTimerCreate("t", pdMS_TO_TICKS(pause), pdTRUE, NULL, fires);
  TimerHandle_t timer = xTimerCreate("t", 5, pdTRUE, NULL, fires);
  xTimerChangePeriod(timer, pause / portTICK_PERIOD_MS, 0);
}
"""
    tick = "and a tick of the Uno has 16 ms"
    assert notices(tmp_path, AVR + sketch + LOOP) == [
        f"xTimerCreate at rover.ino:18 was refused: pdMS_TO_TICKS(pause) was 0, {tick}",
        f"xTimerChangePeriod at rover.ino:20 was refused: pause/portTICK_PERIOD_MS was 0, {tick}",
        f"vTaskDelay at rover.ino:9 did not wait: pause/portTICK_PERIOD_MS was 0, {tick}",
    ]


def test_a_period_of_no_tick_ends_an_esp32(tmp_path: Path) -> None:
    sketch = """int pause;
void fires(TimerHandle_t) {}
void setup() {
  delay(20);
  xTimerCreate("t", pause, pdTRUE, NULL, fires);
}
"""
    done = run_boards(made_set(tmp_path / "set", ESP, {"rover.ino": sketch + LOOP}), 1.0)
    assert done.failed.startswith("board rover died at rover.ino:5 after 0.02")
    assert done.failed.endswith(": its period has 0 ticks, and FreeRTOS asserts that it has one at least")


def test_pins_of_an_esp32_that_cannot_do_it_are_told_once_a_line(tmp_path: Path) -> None:
    sketch = """void setup() {
  pinMode(34, OUTPUT);
  pinMode(35, INPUT_PULLUP);
  pinMode(7, INPUT);
  ledcAttach(36, 5000, 8);
  analogWrite(39, 100);
  pinMode(34, INPUT);
}
void loop() {
  digitalWrite(34, HIGH);
  delay(10);
}
"""
    other = "nothing leaves it; take another pin"
    assert notices(tmp_path, sketch, 0.5, ESP) == [
        f"pin 34 is an input alone, and the sketch writes it at rover.ino:2: {other}",
        "the sketch wants a pull-up or pull-down of pin 35 at rover.ino:3, which has none: add a "
        "resistor, or take another pin",
        "pin 7 at rover.ino:4 is one of the flash memory's, 6 to 11: a real ESP32 crashes there; take "
        "another pin",
        f"pin 36 is an input alone, and the sketch writes it at rover.ino:5: {other}",
        f"pin 39 is an input alone, and the sketch writes it at rover.ino:6: {other}",
        f"pin 34 is an input alone, and the sketch writes it at rover.ino:10: {other}",
    ]


def test_calls_that_an_interrupt_may_not_make_are_told_once_a_line(tmp_path: Path) -> None:
    sketch = """QueueHandle_t orders;
int item;
void rises() {
  delay(1);
  pulseIn(8, HIGH, 10);
  Serial.println(item);
  xQueueSend(orders, &item, 0);
  xQueueSendFromISR(orders, &item, NULL);
}
void drives(void*) { for (;;) {
  digitalWrite(4, HIGH); digitalWrite(4, LOW); vTaskDelay(10);
} }
void setup() {
  Serial.begin(9600);
  pinMode(4, OUTPUT);
  orders = xQueueCreate(3, sizeof(int));
  attachInterrupt(0, rises, RISING);
  xTaskCreate(drives, "Drive", 2000, NULL, 1, NULL);
}
"""
    sonar = '[[sensors]]\nboard = "rover"\npart = "hc-sr04"\ncode = "u1"\ntrig = 4\necho = 2\n'
    told = notices(tmp_path, AVR + sketch + LOOP, 1.0, ROVER + MOTORS + sonar)
    where = "is in an interrupt's function"
    assert told[0].startswith(f"delay() at rover.ino:8 {where}: it needs interrupts, which are off")
    assert told[1] == f"pulseIn() at rover.ino:9 {where}: no other interrupt comes while it waits"
    assert told[2].startswith("a print at rover.ino:")
    assert told[3].startswith(
        f"xQueueSend at rover.ino:11 {where}: only tasks may call it; there is xQueueSendFromISR"
    )
    assert len(told) == 4


def test_a_mistake_has_its_own_time_whatever_the_slices_are(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": AVR + CIRCLE + LOOP})
    found = []
    for slice_length in (100_000, 5_000_000, 20_000_000):
        boards = Boards(configuration, slice_length=slice_length)
        boards.run_to(1.0)
        boards.close()
        found.append([each for each in boards.events if isinstance(each, Notice)])
    assert len(found[0]) == 1
    assert found[1:] == found[:1] * 2


def test_check_tells_a_mistake_of_its_run_as_a_whole(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": AVR + CIRCLE + LOOP})
    wiring = wiring_of(configuration)
    assert wiring is not None
    *_, last = bench_lines(configuration, wiring, [])
    assert last.startswith("  board rover: tasks wait for each other for ever: ")
    assert last.endswith("; take them in the same order in all tasks")


def test_a_mistake_is_in_the_log_and_among_what_happened(tmp_path: Path) -> None:
    made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": AVR + CIRCLE + LOOP})
    log = tmp_path / "run.log"
    command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--sketch", str(tmp_path / "set")]
    command += [
        "--clock",
        "program",
        "--log",
        str(log),
        "--port",
        "0",
        "--reply-port",
        "0",
        "--belief-port",
        "0",
    ]
    program = f"{sys.executable} -c 'import time; time.sleep(1)'"
    subprocess.run([*command, "--run", program], capture_output=True, timeout=300, check=False)
    (moment,) = (each for each in build_report(log).verdict.moments if "for ever" in each.text)
    assert moment.kind is MomentKind.BOARD
    assert moment.elapsed == pytest.approx(0.048, abs=0.002)
    assert moment.text.endswith("take them in the same order in all tasks")


def test_a_wire_that_carries_nothing_is_told(tmp_path: Path) -> None:
    """A level that is no byte of a serial port goes over no wire."""
    eyes = "void setup() { pinMode(4, OUTPUT); }\nvoid loop() { digitalWrite(4, HIGH); delay(20); }\n"
    rover = "void setup() {}\nvoid loop() { digitalRead(2); delay(20); }\n"
    wiring = (
        f'{ROVER}[boards.eyes]\nsketch = "eyes.ino"\nboard = "uno"\n'
        '[[wires]]\nfrom = "eyes.4"\nto = "rover.2"\n'
    )
    done = run_boards(made_set(tmp_path / "set", wiring, {"rover.ino": rover, "eyes.ino": eyes}), 0.1)
    assert done.notices == [
        "eyes.4 and rover.2 are no serial ports: wires carry bytes of serial ports alone, and no levels"
    ]


# One task drives by orders, one ends, one goes on; %s are what they do.
SOME = """QueueHandle_t orders;
SemaphoreHandle_t bus;
EventGroupHandle_t marks;
TaskHandle_t driver, looker;
void drives(void*) { int order; for (;;) {
  DRIVES
} }
void looks(void*) { for (int i = 0; i < 20; i++) {
  LOOKS
  vTaskDelay(3); }
  ENDS
}
void shows(void*) { for (;;) { vTaskDelay(2); SHOWS } }
void setup() {
  Serial.begin(9600);
  orders = xQueueCreate(4, sizeof(int));
  bus = xSemaphoreCreateBinary();
  marks = xEventGroupCreate();
  MORE
  xTaskCreate(drives, "Drive", 2000, NULL, 2, &driver);
  xTaskCreate(looks, "Eyes", 2000, NULL, 1, &looker);
  xTaskCreate(shows, "Show", 2000, NULL, 1, NULL);
}
"""
GETS = "xQueueReceive(orders, &order, portMAX_DELAY);"
SENDS = "xQueueSend(orders, &i, portMAX_DELAY);"
NOTED = "ulTaskNotifyTake(pdTRUE, portMAX_DELAY);"
LOCKS = "xSemaphoreTake(bus, portMAX_DELAY); vTaskDelay(1); xSemaphoreGive(bus);"


def some_wait(
    drives: str, looks: str = "", more: str = "", shows: str = "", ends: str = "vTaskDelete(NULL);"
) -> str:
    made = {"DRIVES": drives, "LOOKS": looks, "MORE": more, "SHOWS": shows, "ENDS": ends}
    sketch = SOME
    for name, text in made.items():
        sketch = sketch.replace(name, text)
    return AVR + "#include <event_groups.h>\n" + sketch + LOOP


@pytest.mark.parametrize(
    ("sketch", "told"),
    [
        (
            some_wait(GETS, SENDS),
            "task Drive waits for ever at rover.ino:11 for an item of a queue (orders): no task that is left "
            "sends to it; that is at rover.ino:14",
        ),
        (
            some_wait(GETS),
            "task Drive waits for ever at rover.ino:11 for an item of a queue (orders): nothing in the "
            "sketch sends to it",
        ),
        (
            some_wait("vTaskDelay(9);", SENDS, ends="for (;;) vTaskDelay(9);"),
            "task Eyes waits for ever at rover.ino:14 for room in a queue (orders): nothing in the sketch "
            "receives from it",
        ),
        (
            some_wait(LOCKS, LOCKS),
            "task Drive waits for ever at rover.ino:11 for a semaphore (bus): only Drive and Eyes could end "
            "it, at rover.ino:11, rover.ino:14, and they wait too; task Eyes waits for ever at rover.ino:14 "
            "for a semaphore",
        ),
        (
            some_wait(NOTED, "xTaskNotifyGive(looker);"),
            "task Drive waits for ever at rover.ino:11 for a notification: nothing in the sketch notifies "
            "that task",
        ),
        (
            some_wait("xEventGroupWaitBits(marks, 1, pdTRUE, pdTRUE, portMAX_DELAY);"),
            "task Drive waits for ever at rover.ino:11 for bits of an event group (marks): nothing in the "
            "sketch sets its bits",
        ),
    ],
)  # fmt: skip
def test_a_task_that_nothing_can_wake_is_told_while_others_go_on(
    sketch: str, told: str, tmp_path: Path
) -> None:
    found = notices(tmp_path / "avr", sketch, 4.0)
    assert len(found) == 1, found
    assert found[0].startswith(told)
    esp32 = sketch.replace(AVR + "#include <event_groups.h>\n", "\n" * 5)
    assert notices(tmp_path / "esp32", esp32, 4.0, ESP) == found


def test_a_task_behind_the_mutex_of_one_that_waits_is_told_with_it(tmp_path: Path) -> None:
    looks = "xSemaphoreTake(bus, portMAX_DELAY); xQueueReceive(orders, &i, portMAX_DELAY);"
    sketch = some_wait("vTaskDelay(9); xSemaphoreTake(bus, portMAX_DELAY);", looks)
    assert notices(tmp_path, sketch.replace("CreateBinary", "CreateMutex"), 4.0) == [
        "task Eyes waits for ever at rover.ino:14 for an item of a queue (orders): nothing in the sketch "
        "sends to it",
        "task Drive waits for ever at rover.ino:11 for a mutex, which Eyes took at rover.ino:14",
    ]


STOPS = "void stops() { int i = 1; xQueueSend(orders, &i, 0); }\n"


@pytest.mark.parametrize(
    "sketch",
    [
        # A task that waits for bytes of the program, or for a button.
        some_wait(GETS, shows="int i; if (Serial.available()) xQueueSend(orders, &i, 0);"),
        some_wait(GETS, more="attachInterrupt(0, stops, RISING);").replace("void sh", STOPS + "void sh"),
        some_wait(GETS).replace(LOOP, "void loop() { int i; if (analogRead(0)) xQueueSend(orders, &i, 0); }"),
        # A table of functions, a macro, a pointer to the queue, and a parameter.
        some_wait(GETS, shows="if (digitalRead(8)) todo[0]();").replace(
            "void shows", STOPS + "void (*todo[])() = {stops};\nvoid shows"
        ),
        some_wait(LOCKS, more="xSemaphoreTake(bus, 0);", shows="if (digitalRead(8)) FREE(bus);").replace(
            "void drives", "#define FREE(it) xSemaphoreGive(it)\nvoid drives"
        ),
        some_wait(
            GETS, shows="int i; if (digitalRead(8)) xQueueSend(other, &i, 0);", more="other = orders;"
        ).replace("void drives", "QueueHandle_t other;\nvoid drives"),
        some_wait(GETS, shows="if (digitalRead(8)) puts_(orders);").replace(
            "void drives", "void puts_(QueueHandle_t to) { int i; xQueueSend(to, &i, 0); }\nvoid drives"
        ),
        some_wait(NOTED, shows="if (digitalRead(8)) xTaskNotifyGive(driver);"),
        # A function in a macro, and a parameter with the name of another queue.
        some_wait(GETS, shows="if (digitalRead(8)) STOP").replace(
            "void shows", STOPS + "#define STOP stops();\nvoid shows"
        ),
        some_wait("gets(other);", more="other = xQueueCreate(4, 2);", shows="GIVES").replace(
            "void drives",
            "QueueHandle_t other;\n"
            "void gets(QueueHandle_t orders) { int i; xQueueReceive(orders, &i, portMAX_DELAY); }\n"
            "void drives",
        ).replace("GIVES", "int i; if (digitalRead(8)) xQueueSend(other, &i, 0);"),
        # A lock of a class, whose end gives it back.
        some_wait(LOCKS, shows="if (digitalRead(8)) { Lock lock; }").replace(
            "void drives", "struct Lock { Lock() {} ~Lock() { xSemaphoreGive(bus); } };\nvoid drives"
        ),
        # It is given at last.
        some_wait(GETS, shows="static int n = 0; if (n++ == 60) xQueueSend(orders, &n, 0);"),
    ],
)  # fmt: skip
def test_a_task_that_something_may_wake_is_not_told(sketch: str, tmp_path: Path) -> None:
    assert notices(tmp_path, sketch, 4.0) == []
