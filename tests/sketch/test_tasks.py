"""Tasks of FreeRTOS on an AVR board: times, priorities, waits, and where a board is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from simmer_tui.sketch.boards import ESP32, UNO
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.task_check import task_problems
from tests.sketch.rovers import DRIVE, MOTORS, ROVER, Boards, made_set
from tests.sketch.running import FORMS, BoardRun, run_boards, set_of
from tests.sketch.test_forms import SENT

no_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
HEAD = "#include <Arduino_FreeRTOS.h>\n#include <queue.h>\n#include <semphr.h>\n#include <timers.h>\n"
LOOP = "void loop() {}\n"


def run(folder: Path, sketch: str, seconds: float = 1.0) -> BoardRun:
    configuration = made_set(folder / "set", ROVER + MOTORS, {"rover.ino": sketch})
    return run_boards(configuration, seconds)


def lines(folder: Path, sketch: str, seconds: float = 1.0) -> list[str]:
    done = run(folder, HEAD + sketch + LOOP, seconds)
    assert done.failed == ""
    return done.text.splitlines()


@pytest.mark.slow
@no_compiler
def test_waits_end_at_ticks(tmp_path: Path) -> None:
    """Of 16 ms: the first wait is short by what has gone of its tick."""
    sketch = """
void waits(void*) {
  unsigned long begun = millis();
  for (int i = 0; i < 4; i++) { vTaskDelay(100 / portTICK_PERIOD_MS); Serial.println(millis() - begun); }
  TickType_t last = xTaskGetTickCount();
  delay(30);
  vTaskDelayUntil(&last, 4);
  Serial.println(xTaskGetTickCount() - last);
  vTaskDelete(NULL);
}
void setup() {
  Serial.begin(115200);
  xTaskCreate(waits, "waits", 100, NULL, 1, NULL);
  Serial.println(pdMS_TO_TICKS(500));
  Serial.println(portTICK_PERIOD_MS);
  Serial.println(sizeof(TickType_t) + sizeof(BaseType_t));
  vTaskStartScheduler();
  Serial.println("never");
}
"""
    told = lines(tmp_path, sketch)
    assert told[:3] == ["31", "16", "3"]
    assert all(int(each) - 96 * n in (-1, 0) for n, each in enumerate(told[3:7], 1))
    assert told[7:] == ["0"]


@pytest.mark.slow
@no_compiler
def test_equals_take_turns_at_ticks_and_the_most_urgent_goes_first(tmp_path: Path) -> None:
    sketch = """
volatile unsigned long counts[3];
void works(void* which) { for (;;) counts[(int)(long)which]++; }
void tells(void*) {
  for (int i = 0; i < 3; i++) {
    vTaskDelay(20);
    Serial.print(counts[0]); Serial.print(' '); Serial.print(counts[1]); Serial.print(' ');
    Serial.println(counts[2]);
  }
  vTaskSuspend(NULL);
}
void setup() {
  Serial.begin(115200);
  xTaskCreate(works, "one", 100, (void*)0, 1, NULL);
  xTaskCreate(works, "two", 100, (void*)1, 1, NULL);
  xTaskCreate(works, "low", 100, (void*)2, 0, NULL);
  xTaskCreate(tells, "tells", 100, NULL, 3, NULL);
}
"""
    for told in lines(tmp_path, sketch):
        one, two, low = map(int, told.split())
        assert low == 0
        assert one == pytest.approx(two, rel=0.11)
        assert one > 50_000


@pytest.mark.slow
@no_compiler
def test_an_interrupt_that_asks_for_no_switch_wakes_its_task_with_the_next_tick(tmp_path: Path) -> None:
    sketch = """
SemaphoreHandle_t rises;
volatile unsigned long at;
bool asks;
void risen() {
  at = micros();
  BaseType_t woken = pdFALSE;
  xSemaphoreGiveFromISR(rises, &woken);
  if (asks && woken) portYIELD_FROM_ISR();
}
void waits(void*) {
  for (;;) { xSemaphoreTake(rises, portMAX_DELAY); Serial.println(micros() - at); }
}
void pulses(void*) {
  for (int i = 0; i < 2; i++) {
    vTaskDelay(2);
    delay(3);
    asks = i;
    digitalWrite(4, HIGH);
    digitalWrite(4, LOW);  // 0.45 ms later the echo rises
    delay(60);
  }
  vTaskDelete(NULL);
}
void setup() {
  Serial.begin(115200);
  pinMode(4, OUTPUT);
  rises = xSemaphoreCreateBinary();
  xTaskCreate(waits, "waits", 100, NULL, 2, NULL);
  xTaskCreate(pulses, "pulses", 100, NULL, 1, NULL);
  attachInterrupt(digitalPinToInterrupt(2), risen, RISING);
}
"""
    wiring = (
        ROVER + MOTORS + ('[[sensors]]\nboard = "rover"\npart = "hc-sr04"\ncode = "u1"\ntrig = 4\necho = 2\n')
    )
    configuration = made_set(tmp_path / "set", wiring, {"rover.ino": HEAD + sketch + LOOP})
    first, second = map(int, run_boards(configuration, 1.0).text.split())
    assert 2_000 < first < 16_000
    assert second < 100


@pytest.mark.slow
@no_compiler
def test_a_mutex_lends_its_holder_the_priority_of_those_that_wait(tmp_path: Path) -> None:
    sketch = """
SemaphoreHandle_t mutex, recursive;
void low(void*) {
  xSemaphoreTake(mutex, portMAX_DELAY);
  for (int i = 0; i < 5; i++) delay(10);
  Serial.println(uxTaskPriorityGet(NULL));
  xSemaphoreGive(mutex);
  Serial.println(uxTaskPriorityGet(NULL));
  vTaskDelete(NULL);
}
void middle(void*) { vTaskDelay(2); Serial.println("middle"); vTaskDelete(NULL); }
void high(void*) {
  vTaskDelay(1);
  Serial.println(xSemaphoreTake(mutex, 1));
  Serial.println(xSemaphoreTake(mutex, 100));
  xSemaphoreTakeRecursive(recursive, 0);
  xSemaphoreTakeRecursive(recursive, 0);
  xSemaphoreGiveRecursive(recursive);
  Serial.println(uxSemaphoreGetCount(recursive));
  xSemaphoreGiveRecursive(recursive);
  Serial.println(uxSemaphoreGetCount(recursive));
  vTaskDelete(NULL);
}
void setup() {
  Serial.begin(115200);
  mutex = xSemaphoreCreateMutex();
  recursive = xSemaphoreCreateRecursiveMutex();
  xTaskCreate(low, "low", 100, NULL, 1, NULL);
  xTaskCreate(middle, "middle", 100, NULL, 2, NULL);
  xTaskCreate(high, "high", 100, NULL, 3, NULL);
}
"""
    assert lines(tmp_path, sketch) == ["0", "3", "1", "0", "1", "middle", "1"]


@pytest.mark.slow
@no_compiler
def test_queues_wait_at_both_ends(tmp_path: Path) -> None:
    sketch = """
QueueHandle_t queue;
TaskHandle_t taker;
void gives(void*) {
  for (int i = 1; i <= 3; i++) Serial.println(xQueueSend(queue, &i, i == 3 ? 5 : 0));
  int seven = 7;
  xQueueSendToFront(queue, &seven, portMAX_DELAY);
  Serial.println(uxQueueMessagesWaiting(queue));
  vTaskResume(taker);
  vTaskDelete(NULL);
}
void takes(void*) {
  int item;
  vTaskDelay(10);
  xQueueReceive(queue, &item, 0); Serial.println(item);
  vTaskSuspend(NULL);
  while (xQueueReceive(queue, &item, 3) == pdPASS) Serial.println(item);
  Serial.println("empty");
  vTaskDelete(NULL);
}
void setup() {
  Serial.begin(115200);
  queue = xQueueCreate(2, sizeof(int));
  xTaskCreate(gives, "gives", 100, NULL, 1, NULL);
  xTaskCreate(takes, "takes", 100, NULL, 2, &taker);
}
"""
    assert lines(tmp_path, sketch) == ["1", "1", "0", "1", "2", "7", "2", "empty"]


@pytest.mark.slow
@no_compiler
def test_groups_of_events_and_notifications_wake_all_that_wait(tmp_path: Path) -> None:
    sketch = """
#include <event_groups.h>
EventGroupHandle_t group;
TaskHandle_t first;
void meets(void* bit) {
  vTaskDelay((int)(long)bit * 3);
  xEventGroupSync(group, (int)(long)bit, 7, portMAX_DELAY);
  Serial.println(xTaskGetTickCount());
  if ((int)(long)bit == 1) {
    uint32_t value;
    Serial.println(xTaskNotifyWait(0, 0xFF, &value, 2));
    xTaskNotifyWait(0, 0xFF, &value, portMAX_DELAY);
    Serial.println(value);
  } else {
    vTaskDelay(5);
    if ((int)(long)bit == 2) xTaskNotify(first, 0x104, eSetBits);
  }
  vTaskDelete(NULL);
}
void setup() {
  Serial.begin(115200);
  group = xEventGroupCreate();
  xTaskCreate(meets, "a", 100, (void*)1, 1, &first);
  xTaskCreate(meets, "b", 100, (void*)2, 2, NULL);
  xTaskCreate(meets, "c", 100, (void*)4, 3, NULL);
}
"""
    assert lines(tmp_path, sketch) == ["12", "12", "12", "0", "260"]


@pytest.mark.slow
@no_compiler
@pytest.mark.parametrize(
    ("name", "baud"),
    [
        *(("rtos_queue", 9600), ("rtos_semaphores", 9600), ("rtos_timers", 9600)),
        *(("esp32_bluetooth", 115200), ("esp32_encoders", 115200)),
    ],
)
def test_slices_of_any_length_give_the_same_run_with_tasks(name: str, baud: int, tmp_path: Path) -> None:
    configuration = set_of(FORMS / name, tmp_path / "set")
    runs = []
    for slice_length in (100_000, 1_000_000, 5_000_000, 20_000_000):
        boards = Boards(configuration, slice_length=slice_length)
        boards.run_to(0.25)
        for at, data in SENT.get(name, ()):
            boards.robot.receive(round(at * 1e9), data[0], baud)
        boards.run_to(2.5)
        boards.close()
        runs.append((repr(boards.events), boards.robot.lockstep.sent, boards.simulator.pose))
    assert runs[1:] == runs[:1] * 3


@pytest.mark.slow
@no_compiler
def test_a_board_that_waits_in_all_tasks_is_not_busy(tmp_path: Path) -> None:
    sketch = HEAD + (
        "void waits(void*) { for (;;) vTaskDelay(10); }\n"
        'void setup() { Serial.begin(9600); xTaskCreate(waits, "waits", 100, NULL, 1, NULL); }\n'
    )
    boards = Boards(made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": sketch + LOOP}))
    try:
        boards.run_to(3.0)
        boards.robot.views()
        boards.run_to(4.5)
        assert boards.robot.views()[0].busy < 0.05
    finally:
        boards.close()


@pytest.mark.slow
@no_compiler
def test_what_others_do_in_a_delay_is_work(tmp_path: Path) -> None:
    """Half of the time one task works, while a less urgent one is in its delay."""
    sketch = (
        HEAD
        + """
void works(void*) {
  for (;;) { delayMicroseconds(16000); delayMicroseconds(16000); vTaskDelay(2); }
}
void waits(void*) { for (;;) delay(1000); }
void setup() {
  Serial.begin(9600);
  xTaskCreate(works, "works", 100, NULL, 2, NULL);
  xTaskCreate(waits, "waits", 100, NULL, 1, NULL);
}
"""
    )
    boards = Boards(made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": sketch + LOOP}))
    try:
        boards.run_to(2.0)
        boards.robot.views()
        boards.run_to(6.0)
        assert 0.4 < boards.robot.views()[0].busy < 0.8
    finally:
        boards.close()


@pytest.mark.slow
@no_compiler
@pytest.mark.parametrize(
    ("body", "told"),
    [
        ("int* none = (int*)8; *none = 1;", "it used memory that is not its own"),
        ("return;", r"the function of a task returned; end it with vTaskDelete\(NULL\)"),
        ("deep(1);", "or its stack is full"),
        ("int item; xQueueReceive(queue, &item, 5);", "it used a queue, .* that is not there"),
        ("xSemaphoreTake(lock, portMAX_DELAY);", "a .*semaphore, .* that is not there"),
        ("xTimerStart(timer, 0);", "a .*timer .* that is not there"),
    ],
)
def test_a_board_that_dies_names_its_task(body: str, told: str, tmp_path: Path) -> None:
    sketch = (
        "int deep(int n) { volatile char room[9000]; room[0] = n; return room[0] + deep(n + 1); }\n"
        "QueueHandle_t queue; SemaphoreHandle_t lock; TimerHandle_t timer;\n"
        f"void fails(void*) {{ vTaskDelay(3);\n{body} }}\n"
        'void setup() { Serial.begin(9600); xTaskCreate(fails, "Eyes", 100, NULL, 1, NULL); }\n'
    )
    done = run(tmp_path, HEAD + sketch + LOOP)
    assert done.failed.startswith(f"board rover died at rover.ino:{'8 in' if 'there' in told else ''}")
    assert re.search(r" in task Eyes after 0\.0\d{1,3} s: ", done.failed)
    assert re.search(told, done.failed)


CRASH = (
    DRIVE
    + """
void drives(void*) {
  for (;;) {
    if (Serial.available() && Serial.read() == 'S') drive(0, 0);
    else drive(255, 255);
    vTaskDelay(12);
  }
}
void blinks(void*) { for (;;) { digitalWrite(13, !digitalRead(13)); vTaskDelay(3); } }
void setup() {
  Serial.begin(9600);
  pinMode(13, OUTPUT);
  xTaskCreate(drives, "Drive", 128, NULL, 1, NULL);
  xTaskCreate(blinks, "Blink", 128, NULL, 2, NULL);
}
"""
)


@pytest.mark.slow
@no_compiler
def test_facts_name_the_task_that_waits(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": HEAD + CRASH + LOOP})
    done = run_boards(configuration, 8.0, [(1.0, b"S")])
    told = " | ".join(done.notices)
    assert "the byte 'S' waited " in told
    assert "board rover was in vTaskDelay() at rover.ino:15 in task Drive" in told


@pytest.mark.slow
@no_compiler
@pytest.mark.parametrize("board", ["uno", "esp32"])
def test_a_pulse_that_a_more_urgent_task_interrupts(board: str, tmp_path: Path) -> None:
    """An AVR counts its own loops, so the pulse is too short; an ESP32 sees its end too late."""
    sketch = """
volatile bool works;
void work() { for (int i = 0; i < 4; i++) delayMicroseconds(1000); }
void other(void*) { for (;;) { if (works) work(); vTaskDelay(1); } }
unsigned long longest, shortest;
void measure() {
  longest = 0; shortest = 1000000;
  for (int i = 0; i < 40; i++) {
    digitalWrite(4, HIGH); delayMicroseconds(10); digitalWrite(4, LOW);
    unsigned long width = pulseIn(2, HIGH);
    if (width > longest) longest = width;
    if (width < shortest) shortest = width;
    delayMicroseconds(3300 + i * 370);
  }
}
void looks(void*) {
  measure();
  unsigned long alone = longest;
  Serial.println(longest - shortest < 300);
  works = true;
  measure();
  Serial.println(longest > alone + 500);
  Serial.println(shortest + 500 < alone);
  vTaskDelete(NULL);
}
void setup() {
  Serial.begin(115200);
  pinMode(4, OUTPUT);
  MAKE(looks, "looks", 2000, NULL, 1, NULL CORE);
  MAKE(other, "other", 2000, NULL, 2, NULL CORE);
}
"""
    is_uno = board == "uno"
    sketch = sketch.replace("MAKE", "xTaskCreate" if is_uno else "xTaskCreatePinnedToCore")
    sketch = (HEAD if is_uno else "") + sketch.replace(" CORE", "" if is_uno else ", 0")
    wiring = ROVER.replace('board = "uno"', f'board = "{board}"')
    wiring += '[[sensors]]\nboard = "rover"\npart = "hc-sr04"\ncode = "u1"\ntrig = 4\necho = 2\n'
    configuration = made_set(tmp_path / "set", wiring, {"rover.ino": sketch + LOOP})
    boards = Boards(configuration, noise=False)
    try:
        boards.run_to(4.0)
        told = bytes(value for _, value in boards.robot.lockstep.sent).decode()
    finally:
        boards.close()
    alone, too_long, too_short = told.split()
    assert alone == "1"
    if is_uno:
        assert (too_long, too_short) == ("0", "1")
    else:
        assert too_long == "1"


def test_check_finds_waits_of_no_tick_and_waits_of_the_idle_task() -> None:
    text = (
        "#include <Arduino_FreeRTOS.h>\n"
        "const int shortest = 10;\n"
        "void eyes(void*) { vTaskDelay(shortest / portTICK_PERIOD_MS); vTaskDelay(pdMS_TO_TICKS(20)); }\n"
        "void setup() { vTaskDelay(pdMS_TO_TICKS(5)); vTaskDelay(0); }\n"
        "void loop() { vTaskDelay(9); }\n"
    )
    short = "ms does not wait: a tick of the Uno has 16 ms, and this is less than one"
    early = "vTaskDelay in setup(): the scheduler starts after it; use delay() here, or wait in a task"
    idle = "vTaskDelay in loop(): the idle task calls it, which may not wait; put this into a task of its own"
    assert [str(each) for each in task_problems(SketchFacts({"rover.ino": text}, UNO))] == [
        f"rover.ino:3: vTaskDelay of 10 {short}",
        f"rover.ino:4: vTaskDelay of 5 {short}",
        f"rover.ino:4: {early}",
        f"rover.ino:4: {early}",
        f"rover.ino:5: {idle}",
    ]
    assert not list(task_problems(SketchFacts({"rover.ino": text.partition("\n")[2]}, UNO)))


def test_check_finds_timers_and_limits_of_no_tick() -> None:
    text = (
        "#include <Arduino_FreeRTOS.h>\n"
        "const int period = 5;\n"
        'void setup() { timer = xTimerCreate("t", pdMS_TO_TICKS(period), pdTRUE, NULL, fires); }\n'
        "void eyes(void*) { xQueueReceive(queue, &item, 10 / portTICK_PERIOD_MS);\n"
        "  xQueueReceive(queue, &item, 0); xSemaphoreTake(lock, pdMS_TO_TICKS(100)); }\n"
        "void loop() {}\n"
    )
    short = "a tick of the Uno has 16 ms, and this is less than one"
    assert [str(each) for each in task_problems(SketchFacts({"rover.ino": text}, UNO))] == [
        f"rover.ino:3: xTimerCreate of 5 ms makes no timer: {short}",
        f"rover.ino:4: xQueueReceive of 10 ms does not wait: {short}",
    ]


def test_check_counts_the_ticks_that_the_macro_gives_and_knows_that_loop_is_a_task_of_an_esp32() -> None:
    text = (
        "#include <FreeRTOS.h>\n"
        "void eyes(void*) { vTaskDelay(pdMS_TO_TICKS(16)); vTaskDelay(pdMS_TO_TICKS(17)); }\n"
        "void hands(void*) { vTaskDelay(16 / portTICK_PERIOD_MS); }\n"
        "void setup() {}\n"
        "void loop() { vTaskDelay(9); vTaskDelay(pdMS_TO_TICKS(5)); }\n"
    )
    told = [str(each) for each in task_problems(SketchFacts({"rover.ino": text}, UNO))]
    assert told[0] == (
        "rover.ino:2: vTaskDelay of 16 ms does not wait: pdMS_TO_TICKS counts 62 ticks a second, so this is "
        "less than one; 17 ms are one"
    )
    assert all(each.startswith("rover.ino:5: ") for each in told[1:])
    assert len(told) == 4
    assert not list(task_problems(SketchFacts({"rover.ino": text}, ESP32)))
