"""Digital line sensors that a sketch polls: readings between two that are told, and answers that hold."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.run.events import Action, ActionName
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.robot_world import RobotWorld
from tests.sketch.rovers import DRIVE, MOTORS, ROVER, Boards, made_set

pytestmark = [
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
    pytest.mark.slow,
]
LINES = "".join(
    f'[[sensors]]\nboard = "rover"\npart = "line"\ncode = "{code}"\npin = {pin}\n'
    for code, pin in (("i1", 7), ("i2", 8))
)
COUNTS = """
unsigned int high, low;
void setup() { Serial.begin(9600); pinMode(7, INPUT); delay(100); }
void loop() {
  if (digitalRead(7)) high++; else low++;
  if (high + low < 2000) return;
  Serial.print(high); Serial.print(' '); Serial.println(low);
  for (;;) delay(1000);
}
"""
FOLLOWS = (
    DRIVE
    + """
unsigned long polls;
void setup() { Serial.begin(9600); pinMode(7, INPUT); pinMode(8, INPUT); }
void loop() {
  bool one = digitalRead(7), other = digitalRead(8);
  if (one && !other) drive(200, 120); else if (other && !one) drive(120, 200); else drive(180, 180);
  if (++polls % 5000 == 0) Serial.println(polls);
}
"""
)


@pytest.mark.parametrize("noise", [False, True])
def test_a_sensor_that_is_partly_over_a_tile_reads_the_same_as_is_told(noise: bool, tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + MOTORS + LINES, {"rover.ino": COUNTS})
    boards = Boards(configuration, noise=noise)
    simulator = boards.simulator
    try:
        # The robot stands where most of the disc is black, and the sensor says so.
        for step in range(2000):
            boards.robot.engine.perform(Action(ActionName.TELEPORT, (6.0 + step / 200, 42.0, 0.0)))
            if 0.86 < simulator.true_value("i1") < 0.96:
                break
        else:
            pytest.fail("the sensor is nowhere partly over a tile")
        boards.run_to(1.0)
        text = "".join(chr(value) for _, value in boards.robot.lockstep.sent)
    finally:
        boards.close()
    high, low = map(int, text.split())
    # An error lasts 20 ms, and two of three readings of this place are right.
    assert high + low == 2000
    assert low == 0 if not noise else high > low


def polled(folder: Path, slice_length: int = 20_000_000) -> tuple[list[str], int]:
    """The events of a rover that follows an edge, and the exchanges of its board."""
    configuration = made_set(folder, ROVER + MOTORS + LINES, {"rover.ino": FOLLOWS})
    boards = Boards(configuration, slice_length=slice_length)
    try:
        boards.run_to(0.6)
        boards.robot.engine.perform(Action(ActionName.TELEPORT, (30.0, 42.0, 20.0)))
        boards.run_to(0.9)
        exchanges = boards.robot.boards["rover"].process.exchanges
        assert boards.robot.failed == ""
    finally:
        boards.close()
    return [repr(each) for each in boards.events], exchanges


def test_answers_that_hold_change_nothing_but_the_number_of_exchanges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events, exchanges = polled(tmp_path / "one")
    for slice_length in (300_000, 3_000_000):
        assert polled(tmp_path / str(slice_length), slice_length)[0] == events
    monkeypatch.setattr(RobotWorld, "level", RobotWorld.read)
    each_asked, more = polled(tmp_path / "all")
    assert each_asked == events
    assert exchanges < more / 5
