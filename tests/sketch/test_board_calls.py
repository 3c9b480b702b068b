"""Calls that depend on what was there before: interrupts of a level, and a servo that is attached."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.parts import SECOND
from tests.sketch.avr.cores import Done, Stimuli, run_ours

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
]
MILLISECOND = SECOND // 1000


def text_of(done: list[Done]) -> str:
    return "".join(chr(int(each.what[5:])) for each in done if each.what.startswith("byte"))


LEVEL = """
volatile long count = 0;
void low() { count++; }
void setup() { Serial.begin(9600); attachInterrupt(digitalPinToInterrupt(2), low, LOW); }
void loop() {
  if (Serial.available() == 0) return;
  char what = Serial.read();
  if (what == '?') Serial.println(count);
  if (what == 'o') { noInterrupts(); delayMicroseconds(5000); interrupts(); }
}
"""


def test_an_interrupt_of_a_level_comes_at_once_and_again(tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(LEVEL, "utf-8")
    levels = ((0, 0), (10, 1), (30, 0), (31, 1), (53, 0), (54, 1))
    stimuli = Stimuli(
        received=[
            (at * MILLISECOND, ord(letter))
            for at, letter in ((5, "?"), (20, "?"), (40, "?"), (52, "o"), (60, "?"))
        ],
        edges=[(at * MILLISECOND, 2, level) for at, level in levels],
    )
    counts = [int(each) for each in re.findall(r"\d+", text_of(run_ours(sketch, stimuli, 0.08)))]
    # 5 us to enter, 2.5 us to leave, a block and an instruction of the sketch. The sketch has 1 % of it,
    # so some come before the answer has the count.
    period = 8.125
    assert counts[0] == pytest.approx(5000 / period, rel=0.1)
    assert counts[1] == pytest.approx(10_000 / period, rel=0.05)
    assert counts[2] - counts[1] == pytest.approx(1000 / period, rel=0.05)
    # A level that came and went while interrupts were off leaves nothing behind.
    assert counts[3] == counts[2]


SERVO = """
#include <Servo.h>
Servo jaw, late;
void setup() {
  Serial.begin(9600);
  late.writeMicroseconds(1000);
  jaw.attach(9, 1600, 2400);
  late.attach(10);
  Serial.print(jaw.readMicroseconds());
  Serial.print(' ');
  Serial.print(late.readMicroseconds());
  jaw.writeMicroseconds(1500);
  Serial.print(' ');
  Serial.print(jaw.readMicroseconds());
}
void loop() {}
"""


def test_a_servo_begins_at_its_middle_or_where_it_was_written(tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(SERVO, "utf-8")
    done = run_ours(sketch, Stimuli(servos=(9, 10)), 0.05)
    assert text_of(done) == "1500 1000 1600"
    assert [each.what for each in done if each.what.startswith("servo")] == [
        *("servo 9 1500", "servo 10 1000", "servo 9 1600")
    ]


MISTAKES = """
#include <Servo.h>
Servo jaw, none;
void setup() {
  Serial.begin(9600);
  pinMode(OUTPUT, 7);
  pinMode(1, 200);
  none.attach(200);
  none.write(90);
  jaw.attach(9, 500, 3500);
  jaw.write(180);
  Serial.print(jaw.readMicroseconds());
}
void loop() {}
"""


def test_arguments_that_no_board_knows_are_what_the_core_makes_of_them(tmp_path: Path) -> None:
    """In a grading a board that tells anything else is ended as a cheat."""
    sketch = tmp_path / "rover.ino"
    sketch.write_text(MISTAKES, "utf-8")
    done = run_ours(sketch, Stimuli(servos=(9,)), 0.05)
    assert text_of(done) == "3500"
    assert [each.what for each in done if each.what.startswith("servo")] == ["servo 9 1500", "servo 9 3000"]
