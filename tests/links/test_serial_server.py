"""A whole server on a robot's port: TCP clients on one side, a pty on the other."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

from simmer_tui.config.dialects import COMMANDS
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings_file import Override
from simmer_tui.live.server import Server
from simmer_tui.run.events import Action, ActionName, Event, Notice, NoticeKind, TwinReading
from tests.links.recording import until

FREE = {
    f"server.{name}": Override(f"--{name}", 0)
    for name in ("port", "reply_port", "packet_port", "packet_reply_port", "belief_port")
}


@dataclass
class Scene:
    """A server, its client and its robot."""

    server: Server
    robot: Any
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    events: list[Event] = field(default_factory=list)

    async def number(self) -> float:
        """The next reply that the client gets."""
        async with asyncio.timeout(20):
            (number,) = struct.unpack(">d", await self.reader.readexactly(8))
        return float(number)

    def answer(self, number: float) -> None:
        self.robot.write(struct.pack(">d", number))


@asynccontextmanager
async def staged(robot: Any, **settings: object) -> AsyncIterator[Scene]:
    robot.plug_in()
    overrides = FREE | {
        "serial.port": Override("--serial", "the robot"),
        "randerror": Override("--no-randerror", False),
        "randbias": Override("--no-randbias", False),
    }
    overrides |= {name.replace("__", "."): Override("", value) for name, value in settings.items()}
    server = Server(load(bundled_folder(), overrides), robot_link=lambda serial: robot.link())
    events: list[Event] = []
    server.start(events.append)
    reader, writer = await asyncio.open_connection("127.0.0.1", server.ports[COMMANDS.purpose])
    try:
        yield Scene(server, robot, reader, writer, events)
    finally:
        writer.close()
        server.stop()
        robot.unplug()


def played(robot: Any, steps: Callable[[Scene], Awaitable[None]], **settings: object) -> None:
    async def run() -> None:
        async with staged(robot, **settings) as scene:
            await steps(scene)

    asyncio.run(run())


def test_every_byte_of_a_client_reaches_the_robot_also_a_line_end_that_comes_late(pty_end: Any) -> None:
    async def steps(scene: Scene) -> None:
        scene.writer.write(b"u1")
        await until(lambda: bytes(pty_end.heard) == b"u1")
        scene.writer.write(b"\nu2\r\n\r\nzz 1\n")
        await until(lambda: bytes(pty_end.heard) == b"u1\n")
        scene.answer(1.5)
        assert await scene.number() == 1.5
        heard = b"u1\n"
        for number, line in enumerate((b"u2\r\n", b"\r\n", b"zz 1\n")):
            heard += line
            await until(lambda heard=heard: bytes(pty_end.heard) == heard)  # type: ignore[misc]
            scene.answer(number)
            assert await scene.number() == number

    played(pty_end, steps)


def test_half_of_an_overlong_command_never_reaches_the_robot(pty_end: Any) -> None:
    async def steps(scene: Scene) -> None:
        scene.writer.write(b"d1-" + b"9" * 500 + b"\nu1\n")
        assert math.isnan(await scene.number())
        await until(lambda: bytes(pty_end.heard) == b"u1\n")
        scene.answer(2)
        assert await scene.number() == 2

    played(pty_end, steps)


def test_person_switches_between_robot_and_simulator_while_the_client_stays(pty_end: Any) -> None:
    async def steps(scene: Scene) -> None:
        server = scene.server
        await until(lambda: server.robot is not None and server.robot.connected)
        scene.writer.write(b"u1\n")
        await until(lambda: bytes(pty_end.heard) == b"u1\n")
        scene.answer(7)
        assert await scene.number() == 7
        scene.writer.write(b"u1\n")
        await until(lambda: bytes(pty_end.heard) == b"u1\nu1\n")
        server.use_simulator()
        assert math.isnan(await scene.number()), "the robot's answer will not come any more"
        scene.writer.write(b"u1\n")
        assert 30 < await scene.number() < 40
        assert server.robot is None
        server.use_robot("the robot")
        scene.writer.write(b"u1\n")
        await until(lambda: bytes(pty_end.heard) == b"u1\n" * 3)
        scene.answer(8)
        assert await scene.number() == 8
        told = [event.text for event in scene.events if isinstance(event, Notice)]
        assert told.count("programs drive the robot on the robot") == 2
        assert "programs drive the simulated robot" in told
        # The client has its answer before the watchers have theirs.
        await until(lambda: sum(isinstance(event, TwinReading) for event in list(scene.events)) == 2)
        assert [event.robot for event in scene.events if isinstance(event, TwinReading)] == [7, 8]

    played(pty_end, steps)


def test_stop_of_a_person_reaches_a_robot_that_drives(pty_end: Any) -> None:
    async def steps(scene: Scene) -> None:
        scene.writer.write(b"d1-20\n")
        await until(lambda: bytes(pty_end.heard) == b"d1-20\n")
        scene.server.call(scene.server.engine.perform, Action(ActionName.STOP))
        await until(lambda: bytes(pty_end.heard) == b"d1-20\nhalt\n")
        scene.answer(math.inf)
        assert await scene.number() == math.inf

    played(pty_end, steps, serial__stop="halt")


@pytest.mark.parametrize("motion", ["instant", "timed"])
def test_simulated_robot_goes_along_however_it_moves(pty_end: Any, motion: str) -> None:
    async def steps(scene: Scene) -> None:
        simulator = scene.server.simulator
        for number in (1, 2):
            scene.writer.write(b"d1-2\n")
            await until(lambda number=number: bytes(pty_end.heard) == b"d1-2\n" * number)  # type: ignore[misc]
            scene.answer(math.inf)
            assert await scene.number() == math.inf
        scene.writer.write(b"o3\n")
        await until(lambda: pty_end.heard.endswith(b"o3\n"))
        scene.answer(4)
        assert await scene.number() == 4
        assert simulator.commands == 3
        assert simulator.pose.x == pytest.approx(9.5 + 4, abs=0.5)

    played(pty_end, steps, motion__motion=motion, motion__time_scale=1000)


def test_lost_robot_is_told_of_and_the_command_under_way_is_answered(pty_end: Any) -> None:
    async def steps(scene: Scene) -> None:
        scene.writer.write(b"u1\n")
        await until(lambda: bytes(pty_end.heard) == b"u1\n")
        pty_end.unplug()
        assert math.isnan(await scene.number())
        await until(
            lambda: any(isinstance(e, Notice) and e.kind is NoticeKind.FAULT for e in list(scene.events))
        )
        pty_end.plug_in()
        scene.writer.write(b"u2\n")
        await until(lambda: pty_end.heard.endswith(b"u2\n"))
        scene.answer(3)
        assert await scene.number() == 3

    played(pty_end, steps)
