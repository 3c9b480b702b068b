"""Prints of boards on ports that do not go to the laptop: in the events, on the screen, and in a log."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.run.events import WireMessage
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sketch.board_view import BoardView, PortView, logged_views
from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.rovers import Boards, made_set

pytestmark = [
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
    pytest.mark.slow,
]
# The laptop is at a module on pins 10 and 11; pin 1 is USB, and pin 5 a wire to the other board.
WIRING = """[boards.rover]
sketch = "rover.ino"
board = "uno"
[boards.eyes]
sketch = "eyes.ino"
board = "uno"
[laptop]
board = "rover"
rx = 10
tx = 11
[[wires]]
from = "eyes.A0"
to = "rover.A4"
"""
ROVER = """
#include <SoftwareSerial.h>
SoftwareSerial blue(10, 11);
int n;
void setup() { Serial.begin(115200); blue.begin(9600); }
void loop() {
  Serial.print("debug "); Serial.println(n);
  if (n % 5 == 0) { blue.print("n="); blue.println(n); }
  if (n % 5 == 1) Serial.println();
  n++;
  delay(40); for (volatile int i = 0; i < 10000; i++) {}
}
"""
EYES = """
#include <SoftwareSerial.h>
SoftwareSerial link(A4, A0);
void setup() { link.begin(9600); }
void loop() { link.println("d=7"); delay(300); }
"""


def run(folder: Path, slice_length: int = 20_000_000) -> Boards:
    sketches = {"rover.ino": ROVER, "eyes.ino": EYES}
    boards = Boards(made_set(folder, WIRING, sketches), slice_length=slice_length)
    try:
        boards.run_to(2.5)
    finally:
        boards.close()
    return boards


def test_prints_of_all_ports_are_told_at_their_times_whatever_the_slices_are(tmp_path: Path) -> None:
    first = run(tmp_path / "a")
    told = [each for each in first.events if isinstance(each, WireMessage)]
    assert {(each.board, each.port) for each in told} == {
        *(("rover", ""), ("rover", "USB"), ("eyes", "pin A0"))
    }
    assert all(each.reply for each in told)
    usb = [each.data for each in told if each.port == "USB" and each.data.strip()]
    assert usb[:3] == ["debug 0\r\n", "debug 1\r\n", "debug 2\r\n"]
    assert next(each.data for each in told if each.board == "rover" and not each.port) == "n=0\r\n"
    for slice_length in (100_000, 5_000_000):
        assert [*map(repr, run(tmp_path / str(slice_length), slice_length).events)] == [
            *map(repr, first.events)
        ]


def test_the_panel_has_the_last_line_of_each_port_and_that_of_a_replay_too(tmp_path: Path) -> None:
    boards = run(tmp_path / "set")
    shown = {each.name: each for each in boards.robot.views()}
    expected_lines(shown)
    reducer = Reducer(checkpoint_of(boards.simulator))
    for event in boards.events:
        reducer.apply(event)
    state = reducer.at()
    replayed = {each.name: each for each in logged_views(state, 2.5)}
    expected_lines(replayed)
    for name, view in replayed.items():
        assert (view.line, view.ports) == (shown[name].line, shown[name].ports)
        assert view.busy == shown[name].busy


def expected_lines(views: dict[str, BoardView]) -> None:
    rover, eyes = views["rover"], views["eyes"]
    (usb,) = rover.ports
    assert usb.name == "USB"
    assert usb.line.startswith("debug ")
    assert rover.line.startswith("n=")
    assert (eyes.line, eyes.ports) == ("", (PortView("pin A0", "d=7"),))
    assert rover.busy is not None
    assert eyes.busy is not None
    assert 0.1 < rover.busy < 0.6
    assert eyes.busy < 0.1
