"""The motion of the simulated robot under a dialect: how a velocity ends, and what its device knows of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import find_set, init_set, load
from simmer_tui.dialect.device import DialectDevice
from simmer_tui.links.dialect_link import SimulatedHost, note_motion
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event, Notice, VelocityEnd, VelocityEnded
from simmer_tui.sim import Simulator
from simmer_tui.sim.command import parse_command
from tests.manual_loop import ManualLoop

RULES = """
[robot]
halts_after = 2
[[command]]
match = "v {x}"
do = "vv-{x};0;0"
[[command]]
match = "v {x} then wait"
do = ["vv-{x};0;0", "wt-0.5"]
[[command]]
match = "run then wait"
do = ["run d1", "wt-0.5"]
[[command]]
match = "run then move"
do = ["run d1", "d1-30"]
done = "moved"
[[command]]
match = "w"
do = "run d1"
[[command]]
match = "t {s}"
do = "run d1 for {s} s"
done = "ok"
stopped = "cut"
"""
SILENT = "dialect: nothing has come for 2 s: the robot stops (halts_after)"


class Scene:
    """A device that drives the simulated robot, and all that has happened. The test's clock moves both."""

    def __init__(self, folder: Path, rules: str, velocity_timeout: float) -> None:
        init_set(folder, find_set("default"))
        (folder / "dialect.toml").write_text(rules, "utf-8")
        configuration = load(folder)
        assert configuration.dialect is not None
        self.loop = ManualLoop(0.0)
        spec = replace(configuration.simulation, velocity_timeout=velocity_timeout)
        self.engine = Engine(Simulator(spec, 3), timed=True)
        self.engine.start(self.loop)  # type: ignore[arg-type]
        self.said: list[bytes] = []
        self.told: list[str] = []
        self.ends: list[VelocityEnd] = []
        self.host = SimulatedHost(self.engine, configuration.dialect, lambda data, _: self.said.append(data))
        self.device = DialectDevice(configuration.dialect, self.host)
        self.engine.watch(self._note)
        self.device.opened()

    def _note(self, event: Event) -> None:
        note_motion(event, self.device)
        if isinstance(event, Notice):
            self.told.append(event.text)
        elif isinstance(event, VelocityEnded):
            self.ends.append(event.reason)

    def write(self, *lines: str) -> None:
        """Send messages to the device, half a second apart."""
        for line in lines:
            self.device.received(f"{line}\n".encode())
            self.loop.run_until(self.loop.now + 0.5)

    def type(self, text: str) -> None:
        """Type a command in the console."""
        self.engine.session().submit(parse_command(text, "console"), lambda result: None)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.loop.run_until(self.loop.now + seconds)

    @property
    def moves(self) -> bool:
        return self.engine.simulator.moving or self.engine.simulator.velocity.moves


@pytest.fixture
def scene(tmp_path: Path) -> Callable[..., Scene]:
    """Makes scenes."""
    return lambda rules=RULES, velocity_timeout=0.0: Scene(tmp_path / "set", rules, velocity_timeout)


@pytest.mark.parametrize(
    "lines", [("v 1 then wait",), ("run then wait",), ("v 1", "v 1e9"), ("w", "v 1e9"), ("v 1", "w")]
)
def test_silence_ends_a_velocity_that_later_commands_have_left_alone(
    scene: Callable[..., Scene], lines: tuple[str, ...]
) -> None:
    made = scene()
    made.write(*lines)
    assert made.moves
    made.wait(2.0)
    assert not made.moves
    assert made.told[-1] == SILENT


def test_silence_ends_no_movement_that_has_ended_a_run(scene: Callable[..., Scene]) -> None:
    made = scene()
    made.write("run then move")
    made.wait(9.0)
    assert made.told == []
    assert made.said == [b"moved"]


def test_nothing_is_told_of_silence_after_the_velocity(scene: Callable[..., Scene]) -> None:
    made = scene()
    made.write("v 1")
    made.device.closed()
    made.host.close(runs_on=False)
    made.wait(3.0)
    assert (made.ends, made.told) == ([VelocityEnd.LEFT], [])


@pytest.mark.parametrize("line", ["v 1", "w"])
def test_nothing_is_told_of_silence_after_a_velocity_timed_out(
    scene: Callable[..., Scene], line: str
) -> None:
    made = scene(velocity_timeout=1.0)
    made.write(line)
    made.wait(3.0)
    assert (made.ends, made.told) == ([VelocityEnd.TIMEOUT], [])


@pytest.mark.parametrize("typed", ["vv-0;0;10;1", "vv-0;0;0", "d1-1"])
def test_a_person_who_drives_ends_a_timed_run(scene: Callable[..., Scene], typed: str) -> None:
    made = scene()
    made.write("t 4")
    made.type(typed)
    assert made.said == [b"cut"]
    made.wait(5.0)
    assert made.said == [b"cut"]


def test_a_run_after_another_is_no_end_of_it(scene: Callable[..., Scene]) -> None:
    made = scene()
    made.write("t 1", "t 1")
    made.wait(3.0)
    assert made.said == [b"ok", b"ok"]
