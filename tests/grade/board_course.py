"""A course whose teams hand in boards: a mission of four movements, and sketches of a few lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
import serial

from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.rovers import DRIVE, MOTORS, ROVER

with_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
JAWS = '[[servos]]\nboard = "rover"\npin = 3\ngripper = { open = 20, closed = 95 }\n'
WIRING = ROVER + MOTORS + JAWS
_PARTS = f"#include <Servo.h>\n{DRIVE}\nServo jaws;\n"
# 12 in/s at full duty: 5 in to the block, and back.
SOLVES = (
    _PARTS + "void setup() {\n  jaws.write(20); jaws.attach(3);\n"
    "  drive(255, 255); delay(416); drive(0, 0);\n"
    "  jaws.write(95); delay(1000);\n  drive(-255, -255); delay(416); drive(0, 0);\n"
    "  jaws.write(20);\n}\nvoid loop() { delay(100); }\n"
)
"""The mission done by a board alone."""
OBEYS = (
    _PARTS + "void setup() { Serial.begin(9600); jaws.write(20); jaws.attach(3); }\nvoid loop() {\n"
    "  if (!Serial.available()) return;\n  char what = Serial.read();\n"
    "  if (what == 'F') drive(255, 255);\n  if (what == 'B') drive(-255, -255);\n"
    "  if (what == 'S') drive(0, 0);\n  if (what == 'C') jaws.write(95);\n"
    "  if (what == 'O') jaws.write(20);\n  Serial.write(what);\n}\n"
)
LAPTOP = """
import serial, time
port = serial.Serial("COM6", 9600, timeout=1)
for what, pause in (b"F", 0.416), (b"S", 0.0), (b"C", 1.0), (b"B", 0.416), (b"S", 0.0), (b"O", 0.1):
    port.write(what)
    assert port.read() == what
    time.sleep(pause)
time.sleep(1000)
"""
"""The mission done by a laptop's program with the board."""

MakeCourse = Callable[..., Path]


def board_course(folder: Path, teams: Mapping[str, Mapping[str, str]], more: str = "") -> Path:
    """A course.toml beside the set of `exact_mission`, with wheels, and the files of each team."""
    with (folder / "set" / "settings.toml").open("a", encoding="utf-8") as file:
        file.write('\n[wheels]\nlayout = "diff"\n')
    with (folder / "set" / "drive.csv").open("a", encoding="utf-8") as file:
        file.write("wheels,ww,1,,,,,,,,\n")
    for name, files in teams.items():
        for path, text in files.items():
            place = folder / "teams" / name / path
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text, "utf-8")
    # pyserial may be elsewhere than Python itself.
    packages = Path(serial.__file__).parent.parent.as_posix()
    course = folder / "course.toml"
    course.write_text(
        f'name = "Boards"\nset = "set"\nteams = "teams"\ncommand = "python main.py"\nboards = true\n'
        f'read_only = ["{packages}"]\n[decide]\nrequire = 0.9\nmargin = 0.5\n{more}',
        "utf-8",
    )
    return course


def boards(sketch: str, wiring: str = WIRING) -> dict[str, str]:
    """The files of a team with one board and no program."""
    return {"wiring.toml": wiring, "rover.ino": sketch}
