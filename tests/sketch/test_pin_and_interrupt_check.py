"""Problems of pins that cannot do it, and of calls in an interrupt's function, by the text of a sketch."""

from __future__ import annotations

import pytest

from simmer_tui.sketch.boards import ESP32, NANO, UNO, BoardKind
from simmer_tui.sketch.interrupt_check import interrupt_functions, interrupt_problems, may_wake_tasks
from simmer_tui.sketch.pin_check import pin_problems
from simmer_tui.sketch.sketch_scan import SketchFacts


def pins(text: str, kind: BoardKind = ESP32) -> list[str]:
    return [str(each) for each in pin_problems(SketchFacts({"rover.ino": text}, kind))]


def calls(text: str, kind: BoardKind = UNO) -> list[str]:
    return [str(each) for each in interrupt_problems(SketchFacts({"rover.ino": text}, kind))]


def test_pins_of_an_esp32_that_cannot_do_it_are_found_at_their_first_call() -> None:
    text = """#include <ESP32Servo.h>
const int eyes[] = {34, 35};
Servo jaws;
NewPing sonar(36, 39);
void out(int pin) { pinMode(pin, OUTPUT); }
void setup() {
  for (int i = 0; i < 2; i++) pinMode(eyes[i], INPUT);
  out(34);
  digitalWrite(34, HIGH);
  pinMode(35, INPUT_PULLUP);
  ledcAttachPin(39, 0);
  jaws.attach(37);
  digitalRead(38);
  digitalRead(9);
  pinMode(25, OUTPUT);
}
void loop() { analogRead(34); }
"""
    alone = "an input alone, as are 34 to 39 of the ESP32: nothing leaves it; take another pin"
    assert pins(text) == [
        f"rover.ino:4: NewPing has pin 36, {alone}",
        f"rover.ino:5: pinMode has pin 34, {alone}",
        "rover.ino:10: pinMode has pin 35, which has no pull-up or pull-down: add a resistor, or take "
        "another pin",
        f"rover.ino:11: ledcAttachPin has pin 39, {alone}",
        f"rover.ino:12: attach has pin 37, {alone}",
        "rover.ino:14: digitalRead has pin 9, one of the flash memory's, 6 to 11: a real ESP32 crashes; take "
        "another pin",
    ]
    assert pins(text, UNO) == []


def test_the_analog_inputs_of_a_nano_drive_nothing() -> None:
    text = "void setup() { pinMode(A6, OUTPUT); pinMode(A5, OUTPUT); }\nvoid loop() { analogRead(A7); }\n"
    assert pins(text, NANO) == [
        "rover.ino:1: pinMode has pin A6, which the Nano has for analogRead alone; take another pin"
    ]


INTERRUPTS = """#include <SoftwareSerial.h>
SoftwareSerial link(10, 11);
void helper() { delay(5); }
void own_delay() {}
void rises() {
  Serial.println(1);
  Serial.print(2);
  helper();
  long width = pulseIn(8, HIGH);
  delayMicroseconds(10);
  own_delay();
  Wire.requestFrom(0x68, 2);
}
void falls() {
  link.write('x');
  xSemaphoreGive(lock);
  xTaskNotifyGive(task);
  xQueueReceiveFromISR(queue, &item, NULL);
  vTaskDelay(1);
}
void setup() {
  attachInterrupt(digitalPinToInterrupt(2), rises, RISING);
  attachInterrupt(1, &falls, FALLING);
  delay(5);
  Serial.print(1);
}
void loop() { helper(); vTaskDelay(1); }
"""


def test_calls_in_an_interrupt_are_found_by_way_of_helpers_too() -> None:
    rises, falls = (f"{name}(), the function of an interrupt" for name in ("rises", "falls"))
    assert calls(INTERRUPTS) == [
        f"rover.ino:6: Serial.println in {rises}: it lasts as long as its bytes once the queue is full; set "
        "a flag, and print in loop()",
        f"rover.ino:9: pulseIn in {rises}: no other interrupt comes while it waits; set a flag, and measure "
        "in loop()",
        f"rover.ino:12: Wire.requestFrom in {rises}: Wire needs interrupts, which are off there; set a flag, "
        "and read in loop()",
        "rover.ino:3: delay in helper(), which the interrupt's function rises() calls: it needs interrupts, "
        "which are off there; set a flag, and wait in loop()",
        f"rover.ino:15: link.write in {falls}: interrupts are off as long as its bytes last; set a flag, and "
        "print in loop()",
        f"rover.ino:16: xSemaphoreGive in {falls}: use xSemaphoreGiveFromISR there",
        f"rover.ino:17: xTaskNotifyGive in {falls}: use vTaskNotifyGiveFromISR there",
        f"rover.ino:19: vTaskDelay in {falls}: it waits, which only a task may; wake a task that does it",
    ]
    assert "a real ESP32 may crash there" in calls(INTERRUPTS, ESP32)[0]


def test_calls_in_a_lambda_are_those_of_its_interrupt() -> None:
    text = """void setup() {
  delay(5);
  attachInterrupt(0, [] { count++; delay(2); }, RISING);
}
"""
    assert calls(text) == [
        "rover.ino:3: delay in the function of the interrupt at rover.ino:3: it needs interrupts, which are "
        "off there; set a flag, and wait in loop()"
    ]


def test_functions_that_call_each_other_end() -> None:
    text = "void one() { " + "two(); " * 300 + "}\nvoid two() { " + "one(); " * 300 + "delay(1); }\n"
    assert len(calls(text + "void setup() { attachInterrupt(0, one, RISING); }\n")) == 1


@pytest.mark.parametrize(
    ("body", "may"),
    [
        ("void rises() { count++; }", False),
        ("void rises() { give(); }\nvoid give() { xSemaphoreGiveFromISR(lock, NULL); }", True),
        ("void rises() { xTaskNotifyGive(task); }", True),
        ("void rises() { vTaskDelay(5); xTaskGetTickCount(); }", False),
        ("void rises() { xTaskCreate(gives, NULL, 100, NULL, 1, NULL); }", True),
        ("auto rises = []() {};", True),
    ],
)
def test_an_interrupt_may_wake_tasks_if_it_gives_something(body: str, may: bool) -> None:
    text = f"{body}\nvoid setup() {{ attachInterrupt(0, rises, RISING); }}\nvoid loop() {{}}\n"
    facts = SketchFacts({"rover.ino": text}, UNO)
    assert may_wake_tasks(facts, *interrupt_functions(facts)) is may
    assert not may_wake_tasks(facts, "serialEvent")
