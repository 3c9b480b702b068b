"""A gripper that follows its servo's pulses, whatever the jaws do when they come."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.run.events import MovementEnded
from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.rovers import MOTORS, ROVER, Boards, made_set

GRIPPER = '[[servos]]\nboard = "rover"\npin = 11\ngripper = { open = 30, closed = 100 }\n'
NEEDS_COMPILER = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")


def grips(boards: Boards) -> list[bool]:
    """The ends of the jaws' movements so far, True for closed ones."""
    ended = [each.grip for each in boards.events if isinstance(each, MovementEnded)]
    return [each.closed for each in ended if each is not None]


def run(folder: Path, setup: str, seconds: float = 8.0) -> list[bool]:
    sketch = f"#include <Servo.h>\nServo g;\nvoid setup() {{ {setup} }}\nvoid loop() {{}}\n"
    boards = Boards(made_set(folder, ROVER + MOTORS + GRIPPER, {"rover.ino": sketch}), noise=False)
    try:
        boards.run_to(seconds)
    finally:
        boards.close()
    return grips(boards)


@pytest.mark.slow
@NEEDS_COMPILER
@pytest.mark.parametrize(
    ("setup", "closed"),
    [
        # The library's own pulse of 1,500 us is no command.
        ("g.attach(11);", []),
        ("g.attach(11); g.write(30);", []),
        ("g.attach(11); delay(500); g.write(30);", []),
        ("g.attach(11); delay(500); g.write(90);", [True]),
        ("g.write(100); g.attach(11);", [True]),
        # The last position counts.
        ("g.attach(11); g.write(100); delay(200); g.write(30);", [True, False]),
        ("g.attach(11); g.write(100); delay(200); g.write(30); delay(100); g.write(100);", [True]),
        (
            "g.attach(11); g.write(100); delay(4000); g.write(30); delay(50); g.write(98);",
            [True, False, True],
        ),
        ("g.attach(11); g.write(100); delay(100); g.detach();", [True]),
        ("g.attach(11); g.write(100); delay(9); g.detach(); g.attach(11); g.write(30);", [True, False]),
    ],
)
def test_the_last_position_of_a_gripper_counts(setup: str, closed: list[bool], tmp_path: Path) -> None:
    assert run(tmp_path / "set", setup) == closed


BUSY = """
#include <Servo.h>
Servo g;
void setup() {
  g.attach(11);
  analogWrite(5, 200); analogWrite(9, 200);
  g.write(100); delay(100); g.write(30); delay(100);
  analogWrite(5, 100); analogWrite(9, 100);
}
void loop() {}
"""


@pytest.mark.slow
@NEEDS_COMPILER
def test_wheels_turn_again_once_the_last_movement_of_the_jaws_is_over(tmp_path: Path) -> None:
    boards = Boards(made_set(tmp_path / "set", ROVER + MOTORS + GRIPPER, {"rover.ino": BUSY}), noise=False)
    boards.run_to(8.0)
    boards.close()
    assert grips(boards) == [True, False]
    leg = boards.simulator.leg
    assert leg is not None
    assert leg.commanded.x == pytest.approx(100 / 255 * 12, rel=0.01)
