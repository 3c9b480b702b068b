"""Round trips a second through the bridge to a robot, compared with those of the bare serial port.

    python benchmarks/bench_serial.py [--quick] [--json FILE]

A process of its own is the robot: it answers eight bytes to every line on a pty. On Linux it has a core of
its own, as a robot has its own processor: on the core of the program it would wait for it. The bare port is
pyserial, written and read in one thread. All are measured in turn, several times; medians of the
rates, and of the rates relative to the bare port's in the same turn, are shown. Linux and macOS
only: Windows has no ptys.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import pty
import socket
import statistics
import sys
import time
import tty
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent))
import serial

from simmer_tui.config.loader import load
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings import SerialSettings
from simmer_tui.config.settings_file import Override
from simmer_tui.links.backend import BackendSwitch, Message
from simmer_tui.links.serial_bridge import SerialBridge
from simmer_tui.links.serial_link import SerialLink
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.sim import CommandResult, Simulator, parse_command

COMMAND, REPLY = b"u1\n", b"@\x02\x00\x00\x00\x00\x00\x00"
GOAL = 0.7


def take_cores(*, robot: bool) -> None:
    """Keep this process off the cores of the other side: the robot has the last one."""
    if sys.platform == "linux" and len(cores := sorted(os.sched_getaffinity(0))) > 1:
        os.sched_setaffinity(0, cores[-1:] if robot else cores[:-1])


def be_robot(told: Connection) -> None:
    """Answer every line on a pty until the process is ended."""
    take_cores(robot=True)
    master, slave = pty.openpty()
    tty.setraw(slave)
    told.send(os.ttyname(slave))
    while True:
        lines = os.read(master, 4096).count(b"\n")
        if lines:
            os.write(master, REPLY * lines)


def bare(port: str, trips: int) -> float:
    """Round trips a second of pyserial alone."""
    with serial.Serial(port, timeout=5) as opened:
        begin = time.perf_counter()
        for _ in range(trips):
            opened.write(COMMAND)
            if len(opened.read(len(REPLY))) != len(REPLY):
                raise TimeoutError("no reply on the bare port")
        return trips / (time.perf_counter() - begin)


def bridged(port: str, trips: int) -> float:
    """Round trips a second through the bridge, with watchers and simulated twin."""
    return asyncio.run(_bridged(port, trips))


async def _bridged(port: str, trips: int) -> float:
    loop = asyncio.get_running_loop()
    engine = Engine(Simulator(load(bundled_folder()).simulation))
    engine.start(loop)
    bridge = SerialBridge(engine, SerialLink(port), SerialSettings(port=port))
    message = Message(COMMAND, (parse_command("u1"),), ReplyForm(ReplyFormat.FLOAT64, "big"))
    switch, session = BackendSwitch(engine, bridge), engine.session()

    async def go(count: int) -> None:
        done = loop.create_future()
        left = count

        def answered(outcomes: Sequence[CommandResult], data: bytes | None) -> None:
            nonlocal left
            left -= 1
            if data != REPLY:
                done.set_exception(ConnectionError("not the robot's reply"))
            elif left:
                switch.submit(message, session, answered)
            else:
                done.set_result(None)

        switch.submit(message, session, answered)
        await done

    await go(1)
    begin = time.perf_counter()
    await go(trips)
    rate = trips / (time.perf_counter() - begin)
    bridge.close()
    return rate


def over_tcp(port: str, trips: int) -> float:
    """Round trips a second of a program: TCP, bridge, serial port and back."""
    overrides = {"serial.port": Override("--serial", port)}
    overrides |= {
        name: Override("", 0) for name in ("server.port", "server.reply_port", "server.belief_port")
    }
    server = Server(load(bundled_folder(), overrides))
    server.start()
    try:
        number = server.ports["commands"]
        with socket.create_connection(("127.0.0.1", number)) as program:
            program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            program.sendall(COMMAND)
            program.recv(64)
            begin = time.perf_counter()
            for _ in range(trips):
                program.sendall(COMMAND)
                if program.recv(64) != REPLY:
                    raise ConnectionError("not the robot's reply")
            return trips / (time.perf_counter() - begin)
    finally:
        server.stop()


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the rates; returns 1 if the bridge does not reach its goal."""
    parser = argparse.ArgumentParser(description="Measure the bridge to a robot on a serial port.")
    parser.add_argument("--quick", action="store_true", help="fewer and shorter measurements")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args(arguments)
    trips, rounds = (500, 3) if options.quick else (2000, 9)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    robot = context.Process(target=be_robot, args=(there,), daemon=True)
    robot.start()
    port = here.recv()
    take_cores(robot=False)
    kinds = {"bare port": bare, "through the bridge": bridged, "TCP and bridge": over_tcp}
    rates: dict[str, list[float]] = {name: [] for name in kinds}
    for _ in range(rounds):
        for name, measure in kinds.items():
            rates[name].append(measure(port, trips))
    robot.terminate()
    robot.join()
    fractions = {}
    for name, each in rates.items():
        fractions[name] = statistics.median(
            rate / alone for rate, alone in zip(each, rates["bare port"], strict=True)
        )
        rate = statistics.median(each)
        print(f"{name:18} {rate:8.0f} round trips/s  {fractions[name]:.2f} of the bare port")
    if options.json is not None:
        options.json.write_text(json.dumps(fractions, indent=1) + "\n")
    reached = fractions["through the bridge"] >= GOAL
    print(f"goal {GOAL} of the bare port: {'reached' if reached else 'missed'}")
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
