"""Values of a sketch's expressions: sums and products, loops, and the ports that names stand for."""

from __future__ import annotations

import random
import re

import pytest

from simmer_tui.sketch.boards import ESP32, MEGA
from simmer_tui.sketch.interrupt_check import interrupt_problems
from simmer_tui.sketch.pin_check import pin_problems
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_steps import pulses, steps
from simmer_tui.sketch.task_check import task_problems
from tests.sketch.running import FORMS


def first_pins(text: str) -> frozenset[int] | None:
    facts = SketchFacts({"s.ino": text}, MEGA)
    return facts.pins(next(facts.named("digitalWrite")))


@pytest.mark.parametrize(
    ("expression", "number"),
    [
        ("2 + 3 * 4", 14),
        ("(2 + 3) * 4", 20),
        ("20 - 5 - 3", 12),
        ("60 / 4 / 3", 5),
        ("FIRST + 1", 23),
        ("17 % 5", 2),
        ("1 << 3 | 1", 9),
        ("(int)(6 ^ 3) & 7", 5),
        ("pins[1 + 1]", 32),
        ("pins[FIRST / 11] - 2", 30),
        ("FIRST > 3 ? 4 + 1 : 4 + 1", 5),
        # Unknown, and no numbers of a pin.
        ("FIRST + other", None),
        ("3 - 4", None),
        ("1 / 0", None),
        ("1 << 40", None),
        ("FIRST > 3", None),
        ("a && 3 + 4", None),
        ("-FIRST", None),
        ("0.5 * 4", None),
    ],
)
def test_whole_numbers_are_computed_as_in_cpp(expression: str, number: int | None) -> None:
    text = (
        f"#define FIRST 22\nint pins[] = {{30, 31, 32}};\nvoid loop() {{ digitalWrite({expression}, HIGH); }}"
    )
    assert first_pins(text) == (None if number is None else frozenset({number}))


@pytest.mark.parametrize(
    ("loop", "pins"),
    [
        ("for (int i = 2; i < 5; i++) digitalWrite(i, HIGH);", {2, 3, 4}),
        ("for (byte i = 0; i <= 2; ++i) { digitalWrite(22 + 2 * i, HIGH); }", {22, 24, 26}),
        ("for (int pin : pins) digitalWrite(pin, HIGH);", {30, 31, 32}),
        (
            "for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) digitalWrite(4 + 2 * i + j, 1);",
            {4, 5, 6, 7},
        ),
        ("for (int i = 0; i < 2; i++) { digitalWrite(pins[i], HIGH); }", {30, 31}),
        ("for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) { digitalWrite(4 + i, 1); }", {4, 5}),
        ("{ for (int i = 0; i < 2; i++) if (x) { digitalWrite(4 + i, 1); } }", {4, 5}),
        ("for (int i = 0; i < 2; i++) f(i); { digitalWrite(4 + i, 1); }", None),
        ("while (x) { for (int i = 0; i < 2; i++) } digitalWrite(4 + i, 1);", None),
        ("for (int i = 0; i < sizeof(pins) / sizeof(pins[0]); i++) digitalWrite(i + 2, HIGH);", {2, 3, 4}),
        # The loop is over, counts otherwise, or ends where nobody knows.
        ("for (int i = 2; i < 5; i++) { } digitalWrite(i, HIGH);", None),
        ("for (int i = 2; i < 9; i += 3) digitalWrite(i, HIGH);", None),
        ("for (int i = 2; i < count; i++) digitalWrite(i, HIGH);", None),
        ("for (int i = 0; i < 30000; i++) digitalWrite(i, HIGH);", None),
        ("for (int pin : unknown) digitalWrite(pin, HIGH);", None),
    ],
)
def test_the_numbers_of_a_loop_are_those_of_its_head(loop: str, pins: set[int] | None) -> None:
    text = f"int pins[] = {{30, 31, 32}}, unknown[] = {{1, other}};\nvoid loop() {{ {loop} }}"
    assert first_pins(text) == (None if pins is None else frozenset(pins))


@pytest.mark.parametrize(
    ("text", "port"),
    [
        ("HardwareSerial port(2); void setup() { port.begin(9600); }", ("port", 16, 17, (9600,))),
        (
            "HardwareSerial port(1 + 1); void setup() { port.begin(9600, SERIAL_8N1, 18, 19); }",
            ("port", 18, 19, (9600,)),
        ),
        ("HardwareSerial port(2);", ("port", 16, 17, ())),
        ("#define BT Serial2\nvoid setup() { BT.begin(38400); }", ("Serial2", 16, 17, (38400,))),
        ("HardwareSerial &bt = Serial2; void setup() { bt.begin(9600); }", ("Serial2", 16, 17, (9600,))),
        ("HardwareSerial *bt = &Serial2; void setup() { bt->begin(9600); }", ("Serial2", 16, 17, (9600,))),
        ("void setup() { Serial2.begin(9600, SERIAL_8N1, -1, 19); }", ("Serial2", 16, 19, (9600,))),
        ("void setup() { Serial2.begin(9600, SERIAL_8N1, other, 19); }", ("Serial2", None, 19, (9600,))),
        ("HardwareSerial port(other); void setup() { port.begin(9600); }", ("port", None, None, (9600,))),
    ],
)
def test_a_port_is_known_by_its_number_and_by_other_names(
    text: str, port: tuple[str, int | None, int | None, tuple[int, ...]]
) -> None:
    facts = SketchFacts({"s.ino": text}, ESP32)
    (found,) = facts.ports()
    name, rx, tx, bauds = port
    assert (found.name, found.bauds) == (name, bauds)
    assert found.rx == (None if rx is None else frozenset({rx}))
    assert found.tx == (None if tx is None else frozenset({tx}))
    if bauds:
        assert facts.is_port(next(facts.named("begin")).object)


PIECES = (
    *("for(", "for (int i = 0; i < 3; i++)", "for (int p : a)", "{", "}", "(", ")", "[", "]", ";", ",", "="),
    *("sizeof(a)/sizeof(a[0])", "+", "<<", "?", ":", "attachInterrupt(0, f, RISING);", "[] {", "->", "i++"),
    *(
        "ledcAttachPin(a[i], i * 2);",
        "int a[] = {1, 2, 3};",
        "HardwareSerial port(2);",
        "#define X (Y + 1)\n",
    ),
)


def test_a_sketch_with_pieces_too_many_or_too_few_is_read_to_its_end() -> None:
    texts = [path.read_text("utf-8") for path in sorted(FORMS.rglob("*.ino"))]
    random_numbers = random.Random(7)
    for _ in range(120):
        tokens = re.findall(r"\s+|\w+|.", random_numbers.choice(texts))
        for _ in range(random_numbers.randint(1, 30)):
            place = random_numbers.randrange(len(tokens))
            if random_numbers.random() < 0.5:
                tokens.insert(place, random_numbers.choice(PIECES))
            else:
                del tokens[place]
        facts = SketchFacts({"s.ino": "".join(tokens)}, random_numbers.choice((MEGA, ESP32)))
        found = [*steps(facts), *pulses(facts), *facts.ports(), *facts.interrupts()]
        found += [*interrupt_problems(facts), *pin_problems(facts), *task_problems(facts)]
        assert len(found) < 10_000
