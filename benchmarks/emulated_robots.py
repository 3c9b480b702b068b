"""Robots with hidden parameters, and their run logs as the serial bridge writes them, without waiting.

The bridge, its framing and the run log are the real ones; only the wire is a function call and the clock that
of the emulated robot. The robot's parameters are known here, so that the results of `simmer-tui calibrate`
can be compared with them.
"""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))
from robot_emulator import Oddities, Robot

from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.config.sets import bundled_folder
from simmer_tui.links.backend import BackendSwitch, Message
from simmer_tui.links.serial_bridge import SerialBridge
from simmer_tui.links.serial_link import LinkListener
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.specs import Axes, DriveKind, SensorSpec, SimulationSpec

STARTS = ((9.5, 42.0, 0.0), (6.0, 6.0, 90.0), (30.0, 18.0, 180.0), (66.0, 30.0, 0.0), (90.0, 18.0, 90.0))
_FORM = ReplyForm(ReplyFormat.FLOAT64, "big")


def draw_robot(random: np.random.Generator, spec: SimulationSpec) -> SimulationSpec:
    """A robot like that of the set, but with all parameters different. Biases have the spread with which the
    simulator draws them by `strength`."""
    drives = []
    for drive in spec.drives:
        if drive.kind.turns:
            bias = Axes(*(random.normal(0.0, 0.003, 2)), random.normal(0.0, 0.03))
            error = Axes(*(random.uniform(0.001, 0.004, 2)), random.uniform(0.01, 0.03))
        else:
            bias = Axes(*random.normal(0.0, 0.05, 2), random.normal(0.0, 0.4))
            along, across = random.uniform(0.02, 0.06), random.uniform(0.01, 0.03)
            turn = random.uniform(0.01, 0.04)
            sideways = drive.kind in (DriveKind.UP, DriveKind.DOWN)
            error = Axes(across, along, turn) if sideways else Axes(along, across, turn)
        drives.append(replace(drive, bias=bias, error=error))
    sensors = tuple(_drawn_sensor(random, each) for each in spec.sensors)
    return replace(spec, drives=tuple(drives), sensors=sensors, randbias=False)


def _drawn_sensor(random: np.random.Generator, sensor: SensorSpec) -> SensorSpec:
    match sensor.kind.name:
        case "ultra" | "tof":
            return replace(
                sensor,
                gain=1.0 + random.normal(0.0, 0.03),
                bias=random.normal(0.0, 0.3),
                error=random.uniform(0.01, 0.03),
                absolute_error=random.uniform(0.05, 0.2),
                rotation=sensor.rotation + random.normal(0.0, 3.0),
                read_time=random.uniform(0.01, 0.06),
                dropout=random.uniform(0.0, 0.04),
                outlier=random.uniform(0.0, 0.02),
            )
        case "odom":
            return replace(
                sensor, gain=1.0 + random.normal(0.0, 0.03), error=random.uniform(0.01, 0.03), read_time=0.002
            )
        case "gyro":
            return replace(
                sensor,
                gain=1.0 + random.normal(0.0, 0.02),
                error=random.uniform(0.005, 0.02),
                drift=random.normal(0.0, 0.05),
                read_time=0.002,
            )
        case "comp":
            return replace(
                sensor, bias=random.normal(0.0, 8.0), error=0.0, absolute_error=random.uniform(1.0, 5.0)
            )
        case _:
            return sensor


def placed(spec: SimulationSpec, random: np.random.Generator) -> tuple[SimulationSpec, SimulationSpec]:
    """The spec with one of some starts, and the same with the pose in which a person placed the robot: within
    an inch and 5 degrees."""
    x, y, heading = STARTS[random.integers(len(STARTS))]
    configured = replace(spec, bot_center=(x, y), bot_rot=heading)
    dx, dy = np.clip(random.normal(0.0, 0.5, 2), -1.0, 1.0)
    turned = float(np.clip(random.normal(0.0, 2.5), -5.0, 5.0))
    return configured, replace(spec, bot_center=(x + dx, y + dy), bot_rot=heading + turned)


class FunctionLink:
    """A `RobotLink` to a robot in this process. `clock` is its time, seconds, which passes only while it
    works."""

    name = "emulated"
    restarts_board = False

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._listener: LinkListener | None = None

    def clock(self) -> float:
        return 1.8e9 + self.robot.simulator.time

    def start(self, listener: LinkListener) -> None:
        self._listener = listener
        listener.opened()

    def write(self, data: bytes) -> None:
        asyncio.get_running_loop().call_soon(self._answer, data)

    def _answer(self, data: bytes) -> None:
        assert self._listener is not None, "it was started"
        for reply in self.robot.receive(data):
            self._listener.received(reply)

    def write_instead(self, data: bytes) -> list[bytes]:
        self.write(data)
        return []

    def close(self) -> None:
        self._listener = None


@dataclass(frozen=True)
class Session:
    """A client of the bridge, which sends one command after the other."""

    robot: Robot
    bridge: SerialBridge

    async def ask(self, text: str) -> float:
        """Send a command; the real robot's answer to it."""
        answered: asyncio.Future[float] = asyncio.get_running_loop().create_future()
        message = Message(f"{text}\n".encode(), (parse_command(text),), _FORM)
        engine = self.bridge.engine
        BackendSwitch(engine, self.bridge).submit(
            message, engine.session(), lambda outcomes, _: answered.set_result(outcomes[0].reply)
        )
        return await answered


Program = Callable[[Session], Coroutine[None, None, None]]


def record(
    path: Path,
    configuration: Configuration,
    hidden: SimulationSpec,
    seed: int,
    program: Program,
    *,
    oddities: Oddities | None = None,
    latency: float = 0.0,
    wire_of: Callable[[Robot], FunctionLink] = FunctionLink,
    robot_of: type[Robot] = Robot,
) -> Robot:
    """Let `program` (a coroutine function of a session) drive a robot through the serial bridge, and log it
    to `path`. `wire_of` makes the wire to it, and `robot_of` the robot. Returns the robot in its final
    state."""
    link = LinkDelay(latency, 0.0, seed)
    robot = robot_of("float64", "big", seed, None, hidden, oddities, link)
    wire = wire_of(robot)
    serial = replace(configuration.settings.serial, port=FunctionLink.name)
    settings = replace(configuration.settings, sim=False, serial=serial)
    configuration = replace(configuration, settings=settings)

    async def run() -> None:
        twin = Simulator(configuration.simulation, seed)
        engine = Engine(twin)
        engine.start(asyncio.get_running_loop())
        bridge = SerialBridge(engine, wire, settings.serial, gap=0.0)
        with RunLog(path, configuration, twin, clock=wire.clock) as log:
            engine.watch(log)
            await program(Session(robot, bridge))
        bridge.close()

    asyncio.run(run())
    return robot


def set_with(spec: SimulationSpec, folder: Path | None = None) -> Configuration:
    """The default set, with another start of the robot."""
    configuration = load(folder or bundled_folder())
    x, y = spec.bot_center
    settings = replace(configuration.settings, bot_center=(x, y), bot_rot=spec.bot_rot)
    simulation = replace(configuration.simulation, bot_center=(x, y), bot_rot=spec.bot_rot)
    return replace(configuration, settings=settings, simulation=simulation)


def wandering(
    movements: int, seed: int, codes: Sequence[str], drives: Sequence[str] = ("w1", "s1", "a1", "d1", "r1")
) -> Program:
    """A program that drives to and fro, with each drive equally often, polling all `codes` after each
    movement. It avoids walls by its sensors as well as a student's program: the robot still touches some."""

    async def program(session: Session) -> None:
        random = np.random.default_rng(seed)
        left = [code for code in drives for _ in range(math.ceil(movements / len(drives)))]
        readings: dict[str, float] = {}

        async def poll() -> None:
            for code in codes:
                readings[code] = await session.ask(code)

        await poll()
        while left:
            choice = _next_move(left, readings, random)
            left.remove(choice[0])
            await session.ask(f"{choice[0]}-{choice[1]:g}")
            await poll()

    return program


def _next_move(
    left: Sequence[str], readings: dict[str, float], random: np.random.Generator
) -> tuple[str, float]:
    """A drive with room for it, of the remaining ones, and its amount."""

    def room(*codes: str, off: float) -> float:
        seen = [readings[code] for code in codes if math.isfinite(readings.get(code, math.nan))]
        return max(min(seen, default=6.0) - off, 0.0)

    # Sensors at 45 degrees measure 1.41 times the distance of a side wall.
    ahead, behind = room("u1", "u5", off=1.5), room("u3", off=1.5)
    leftward, rightward = room("u2", off=2.2) / 1.42, room("u4", off=2.2) / 1.42
    space = {"d1": ahead, "a1": behind, "w1": leftward, "s1": rightward}
    order = random.permutation(np.array(sorted(left)))
    for code in map(str, order):
        if code == "r1":
            return code, round(float(random.choice((-1, 1)) * random.uniform(15.0, 120.0)), 1)
        if space[code] >= 1.0:
            return code, round(float(random.uniform(0.8, min(space[code], 9.0))), 2)
    if "r1" in left:
        return "r1", round(float(random.uniform(-180.0, 180.0)), 1)
    return str(order[0]), round(float(random.uniform(0.5, 1.0)), 2)
