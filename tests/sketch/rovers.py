"""Rovers whose boards run without a server: wirings, sketches, and the events of a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event
from simmer_tui.sim import Simulator
from simmer_tui.sketch.sketch_robot import SketchRobot, StartBoard, compile_set, with_boards
from simmer_tui.sketch.wiring import wiring_of
from tests.stepped_clock import Clock

MOTORS = """
[[motors]]
board = "rover"
driver = "pwm2"
in1 = 5
in2 = 6
wheel = "left"
top_speed = 12
dead_band = 0
[[motors]]
board = "rover"
driver = "pwm2"
in1 = 9
in2 = 10
wheel = "right"
top_speed = 12
dead_band = 0
"""
ROVER = '[boards.rover]\nsketch = "rover.ino"\nboard = "uno"\n[laptop]\nboard = "rover"\n'
ENCODERS = "".join(
    f'[[sensors]]\nboard = "{{board}}"\npart = "encoder"\nwheel = "{wheel}"\na = {pin}\nedges_per_inch = 40\n'
    for wheel, pin in (("left", 2), ("right", 3))
)
DRIVE = """
void drive(int left, int right) {
  analogWrite(5, left > 0 ? left : 0); analogWrite(6, left < 0 ? -left : 0);
  analogWrite(9, right > 0 ? right : 0); analogWrite(10, right < 0 ? -right : 0);
}
"""


def made_set(folder: Path, wiring: str, sketches: Mapping[str, str]) -> Configuration:
    init_set(folder, bundled_sets()["mission"])
    with (folder / "settings.toml").open("a", encoding="utf-8") as file:
        file.write('\n[wheels]\nlayout = "diff"\n')
    (folder / "wiring.toml").write_text(wiring, "utf-8")
    for name, text in sketches.items():
        (folder / name).write_text(text, "utf-8")
    return load(folder)


class Boards:
    """Boards of a set without a server, and the events of their run."""

    def __init__(
        self,
        configuration: Configuration,
        *,
        noise: bool = True,
        slice_length: int = 20_000_000,
        start_board: StartBoard | None = None,
    ) -> None:
        wiring = wiring_of(configuration)
        assert wiring is not None
        sketches = compile_set(wiring, configuration.directory)
        self.simulator = Simulator(with_boards(configuration).simulation, 1)
        self.simulator.noise = noise
        engine = Engine(self.simulator, timed=True)
        self.events: list[Event] = []
        engine.watch(self.events.append)
        self._clock = Clock(0.0)
        engine.start(self._clock)
        self.robot = SketchRobot(sketches, engine, slice_length, start_board)

    def run_to(self, seconds: float) -> None:
        while self.robot.run_to(seconds) < seconds:
            pass

    def close(self) -> None:
        self.robot.close()
        self._clock.close()


SENSOR = """
#include <SoftwareSerial.h>
SoftwareSerial link(9, 10);
volatile int left, right;
void countLeft() { left++; }
void countRight() { right++; }
void setup() {
  Serial.begin(9600);
  link.begin(9600);
  attachInterrupt(digitalPinToInterrupt(2), countLeft, CHANGE);
  attachInterrupt(digitalPinToInterrupt(3), countRight, CHANGE);
  link.write('F');
}
void loop() {
  if (left + right > 600) { link.write('S'); left = right = 0; delay(300); link.write('F'); }
  static unsigned long last;
  if (millis() - last > 100) { last = millis(); Serial.print(left + right); Serial.println(' '); }
}
"""
ROVER_BY_LINK = (
    DRIVE
    + """
#include <SoftwareSerial.h>
SoftwareSerial link(7, 8);
void setup() { link.begin(9600); }
void loop() {
  if (!link.available()) return;
  char what = link.read();
  if (what == 'F') drive(220, 180);
  if (what == 'S') drive(-200, 0);
}
"""
)
JOINED = (
    '[boards.sensor]\nsketch = "sensor.ino"\nboard = "uno"\n'
    '[boards.rover]\nsketch = "rover.ino"\nboard = "uno"\n'
    '[laptop]\nboard = "sensor"\n[[wires]]\nfrom = "sensor.10"\nto = "rover.7"\n'
    + MOTORS
    + ENCODERS.format(board="sensor")
)
STOPPABLE = (
    DRIVE
    + """
void setup() { Serial.begin(9600); }
void loop() {
  if (Serial.available() == 0) return;
  char what = Serial.read();
  if (what == 'F') drive(255, 255);
  if (what == 'B') drive(-255, -255);
  if (what == 'S') drive(0, 0);
}
"""
)
