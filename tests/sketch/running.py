"""Boards run for some simulated seconds, without a server: their bytes, events, and the robot's pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event, Notice
from simmer_tui.sim import Simulator
from simmer_tui.sketch.lockstep import BOARD_SLICE
from simmer_tui.sketch.sketch_robot import SketchRobot, compile_set, with_boards
from simmer_tui.sketch.wiring import wiring_of
from tests.stepped_clock import Clock

FORMS = Path(__file__).parent / "forms"
Sent = Sequence[tuple[float, bytes]]
"""Bytes of the laptop with the simulated times at which they arrive, seconds."""
_SECOND = 1_000_000_000
# Sketches begin their ports at once, but for a delay in setup().
_BEGUN = 0.25
"""Simulated seconds after which the rate of the laptop's port is known."""


@dataclass
class BoardRun:
    """The end of a run: bytes that arrived at the laptop, with times in nanoseconds; events; the pose."""

    sent: list[tuple[int, int]]
    events: list[Event]
    pose: tuple[float, float, float]
    failed: str

    @property
    def text(self) -> str:
        """The text that the boards sent."""
        return bytes(value for _, value in self.sent).decode("latin-1")

    @property
    def notices(self) -> list[str]:
        return [event.text for event in self.events if isinstance(event, Notice)]


def set_of(form: Path, folder: Path) -> Configuration:
    """A set with two wheels, a form's wiring, and rows of sensors that the form has. Its sketches stay where
    they are."""
    init_set(folder, bundled_sets()["mission"])
    with (folder / "settings.toml").open("a", encoding="utf-8") as file:
        file.write('\n[wheels]\nlayout = "diff"\n')
    if (form / "more_sensors.csv").is_file():
        with (folder / "sensors.csv").open("a", encoding="utf-8") as file:
            file.write((form / "more_sensors.csv").read_text("utf-8"))
    text = (form / "wiring.toml").read_text("utf-8").replace('sketch = "', f'sketch = "{form.as_posix()}/')
    (folder / "wiring.toml").write_text(text, "utf-8")
    return load(folder)


def run_boards(
    configuration: Configuration,
    seconds: float,
    sent: Sent = (),
    seed: int = 1,
    slice_length: int = BOARD_SLICE,
) -> BoardRun:
    """Run a set's boards."""
    wiring = wiring_of(configuration)
    assert wiring is not None
    sketches = compile_set(wiring, configuration.directory)
    configuration = with_boards(configuration)
    simulator = Simulator(configuration.simulation, seed)
    engine = Engine(simulator, timed=True)
    events: list[Event] = []
    engine.watch(events.append)
    clock = Clock(0.0)
    engine.start(clock)
    boards = SketchRobot(sketches, engine, slice_length)
    try:
        until = _BEGUN if sent else 0.0
        while until and boards.run_to(until) < until:
            pass
        baud = boards.laptop_baud
        for at, data in sent:
            for place, value in enumerate(data, 1):
                boards.receive(round(at * _SECOND) + place * 10 * _SECOND // baud, value, baud)
        while until < seconds:
            until = min(boards.run_to(seconds), seconds)
        arrived = list(boards.lockstep.sent)
        pose = simulator.pose
    finally:
        boards.close()
        clock.close()
    return BoardRun(arrived, events, (pose.x, pose.y, pose.heading), boards.failed)
