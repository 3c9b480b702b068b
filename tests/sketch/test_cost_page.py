"""Costs on the page of calls are those of the runtime's clock."""

from __future__ import annotations

import re

import pytest

from simmer_tui.sketch.known_headers import RUNTIME, libraries
from tests.test_docs import DOCS

PAGE = "".join(
    (DOCS / f"sketch-{name}.md").read_text("utf-8") for name in ("calls", "parts", "esp32-freertos")
)
CLOCK = (RUNTIME / "board" / "clock.h").read_text("utf-8")


def cost(name: str) -> float:
    """A cost of the runtime, microseconds."""
    found = re.search(rf"\b{name} = (\d+)", CLOCK)
    assert found is not None, name
    return int(found[1]) / 1000


@pytest.mark.parametrize(
    ("phrase", "names"),
    [
        ("by {} us in each basic block", ("BLOCK",)),
        ("| `digitalWrite`, `digitalRead`, `pinMode` | {} us |", ("DIGITAL",)),
        ("| `digitalWrite`, `digitalRead`, `pinMode` | {} us |", ("PIN_MODE",)),
        ("| `analogWrite` | {} us |", ("ANALOG_WRITE",)),
        ("| `analogRead` | {} us |", ("ANALOG_READ",)),
        ("| `millis` | {} us |", ("MILLIS",)),
        ("| `micros`, in steps of 4 us | {} us |", ("MICROS",)),
        ("| `tone`, `noTone`: silent | {} us |", ("TONE",)),
        ("| a pass of `loop()` | {} us |", ("LOOP",)),
        ("and to leave it | {} us, {} us |", ("INTERRUPT_ENTRY", "INTERRUPT_EXIT")),
        ("| `Serial.available`, `read`, `peek` | {} us |", ("SERIAL_LOOK",)),
        ("and each byte of `print` | {} us |", ("SERIAL_WRITE",)),
        (
            "`print` of a number besides, and each of its digits | {} us, {} us |",
            ("PRINT_NUMBER", "PRINT_DIGIT"),
        ),
        ("and each of its decimals | {} us, {} us |", ("PRINT_FLOAT", "PRINT_DECIMAL")),
        ("`Serial` receives: its interrupt | {} us |", ("SERIAL_RECEIVE",)),
        ("`attached` | {} us a `write` |", ("SERVO_WRITE",)),
        ("`EEPROM[i]` | {} us to read", ("EEPROM_READ",)),
        ("| {} us more than one of `attachInterrupt` |", ("PIN_CHANGE",)),
        ("| {} us to read a value, {} us to write one |", ("FLASH_READ", "FLASH_WRITE")),
        ("| {} us and `micros` a look; {} us to plan a step", ("STEPPER_LOOK", "STEPPER_PLAN")),
        ("| {} us for a sample of `Compute` |", ("PID_COMPUTE",)),
        ("| {} us a transfer: 1.2 ms a character", ("DISPLAY_TRANSFER",)),
        ("| a tick | {} us |", ("TICK",)),
        ("| a switch to another task | {} us |", ("TASK_SWITCH",)),
        ("| a call of a task, queue, semaphore, timer or group | {} us |", ("TASK_CALL",)),
        ("semaphore, timer or group | {} us |\n| `xTask", ("TASK_CREATE",)),
        ("| `xTaskGetTickCount`, `uxQueueMessagesWaiting` | {} us |", ("MILLIS",)),
        ("A byte on the bus takes {} us at 100 kHz, and {} us at 400 kHz", ("I2C_BYTE", "I2C_FAST_BYTE")),
    ],
)
def test_a_cost_is_the_runtimes(phrase: str, names: tuple[str, ...]) -> None:
    assert phrase.format(*(f"{cost(name):g}" for name in names)) in PAGE


def test_a_call_of_a_hardware_timer_costs_a_tenth_of_a_pins_mode() -> None:
    assert f"A call costs {cost('PIN_MODE') / 10:g} us" in PAGE


def test_the_libraries_of_the_pages_are_those_that_are_there() -> None:
    there = {name.removesuffix(".h") for name in libraries()}
    rows = set(re.findall(r"^\| (\w+) \|", PAGE.partition("## Libraries")[2], re.M)) - {"library"}
    assert rows == there
