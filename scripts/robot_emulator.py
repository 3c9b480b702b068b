"""Emulate a robot's microcontroller on a serial port: for tests, and for people without a robot.

Makes a serial port of its own and prints its name (Linux, macOS):

    python samples/robot_emulator.py
    simmer-tui --serial /dev/pts/3

With `--port COM7` it uses an existing port, with `--tcp 5000` it serves `--serial socket://localhost:5000`.
The robot in it is a small simulation of its own. It is the default set's, which answers at once, or with
`--config SET` that of a set, with the durations of its drives, sensors and link. Give it a set with hidden
values, and `simmer-tui calibrate` can estimate them. `--slip`, `--stale`, `--weaken` and `--shortfall` are
faults that no set can describe. With `--boot 2` it starts again whenever its port is opened, as an Uno does.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import random
import select
import socket
import struct
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

sys.path.append(str(Path(__file__).resolve().parent.parent))  # a clone's root; an installed one is first
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.errors import SimmerError
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.sim import CommandResult, SimulationSpec, Simulator, Status, parse_command
from simmer_tui.sim.command import Command, parse_value
from simmer_tui.sim.sensors import CountingSensor, sensor_of
from simmer_tui.sim.specs import CELL_SIZE, DriveSpec

GRACE = 0.005  # s of silence after which bytes without an end are a command
LOOK = 0.01  # s between two looks whether a program has opened the port; a board takes far longer to start
WHEEL_RADIUS = 3.0  # in, from the robot's centre to its wheels, as in the default set
LONGEST = 256  # bytes of a command; a real microcontroller has even less memory
GREETING = b"\xf8\x00SimMeR robot, firmware 1.0\r\nready\r\n"
FLOATS = {("float64", "big"): ">d", ("float64", "little"): "<d"}
FLOATS.update({("float32", "big"): ">f", ("float32", "little"): "<f"})


@dataclass(frozen=True)
class Oddities:
    """Traits of a real robot that no set describes. On every other cell of the maze, as on a chessboard,
    wheels lose the fraction `slip` of each translation begun there, although encoders count it. A range
    reading is, with probability `stale`, the previous one. Each movement is weaker than the previous one by
    the fraction `weaken`, as by a battery running down. It ends `shortfall` inches short, for a turn measured
    at the wheels."""

    slip: float = 0.0
    stale: float = 0.0
    weaken: float = 0.0
    shortfall: float = 0.0


class Robot:
    """Robot without a port: bytes of commands in, bytes of replies out."""

    def __init__(
        self,
        reply: str = "float64",
        byte_order: str = "big",
        seed: int = 0,
        constant: float | None = None,
        simulation: SimulationSpec | None = None,
        oddities: Oddities | None = None,
        link: LinkDelay | None = None,
    ) -> None:
        """`reply` is float64, float32 or text; commands in brackets are always answered in brackets. With
        `constant` every sensor reads this value."""
        self._number = struct.Struct(FLOATS[reply, byte_order]) if reply != "text" else None
        self._constant = constant
        self.simulator = Simulator(simulation or load_default().simulation, seed)
        self._oddities = oddities or Oddities()
        self._random = random.Random(seed)
        self._link = link
        self._drives = {drive.code: drive for drive in self.simulator.spec.drives}
        working = (sensor_of(spec) for spec in self.simulator.spec.sensors)
        self._wheels = {each.spec.code: each for each in working if isinstance(each, CountingSensor)}
        self._slipped = dict.fromkeys(self._wheels, 0.0)
        self._before: dict[str, float] = {}
        self._movements = 0
        self._buffer = b""
        self._since = 0.0

    def clock(self) -> float:
        """Simulated time, seconds."""
        return self.simulator.time

    def take_time(self) -> float:
        """Duration, seconds, of all work since the last call, on the link and on the robot."""
        taken, self._since = self.simulator.time - self._since, self.simulator.time
        return taken

    @property
    def waiting(self) -> bool:
        """True if received bytes would become a command by silence."""
        return bool(self._buffer) and not self._buffer.startswith(b"[")

    def receive(self, data: bytes) -> list[bytes]:
        """The replies to the commands that these bytes complete."""
        self._buffer += data
        replies: list[bytes] = []
        while True:
            self._buffer = self._buffer.lstrip(b"\r\n")
            in_brackets = self._buffer.startswith(b"[")
            command, end, rest = self._buffer.partition(b"]" if in_brackets else b"\n")
            if not end:
                if len(self._buffer) > LONGEST:
                    self._buffer = b""
                return replies
            self._buffer = rest
            replies.append(self._framed(command[1:]) if in_brackets else self._plain(command))

    def silence(self) -> list[bytes]:
        """Called after silence: the received bytes are a command."""
        command, self._buffer = self._buffer, b""
        return [self._plain(command)] if command.strip() else []

    def _plain(self, command: bytes) -> bytes:
        number = self._do(command).reply
        if self._number is None:
            return f"{number:.3f}\r\n".encode()
        with contextlib.suppress(OverflowError):
            return self._number.pack(number)
        return self._number.pack(math.copysign(math.inf, number))

    def _framed(self, packet: bytes) -> bytes:
        items = []
        for command in packet.split(b","):
            result = self._do(command)
            words = {Status.DONE: "True", Status.REFUSED: "False", Status.UNKNOWN: "Not Found"}
            word = words.get(result.status, f"{result.reply:.3f}")
            code = command[:2].decode("ascii", "replace")
            items.append(f"{code}:{'DRIVE STOP' if code == 'xx' else word}")
        return f"[{','.join(items)}]".encode()

    def _do(self, command: bytes) -> CommandResult:
        self._pass_on()
        result = self._slipping(command.decode("latin-1"))
        self._pass_on()
        if command.strip() == b"xx":
            return structs.replace(result, reply=math.inf)
        if result.status is not Status.READING:
            return result
        if self._constant is not None:
            return structs.replace(result, reply=self._constant)
        code = result.command.code
        if code in self._slipped:
            return structs.replace(result, reply=result.reply + self._slipped[code])
        stale = self._before.get(code)
        self._before[code] = result.reply
        reading = result.reading
        ranging = reading is not None and reading.sensor.kind.is_range
        if stale is not None and ranging and self._random.random() < self._oddities.stale:
            return structs.replace(result, reply=stale)
        return result

    def _pass_on(self) -> None:
        """Add the time of a message on the link."""
        if self._link is not None:
            self.simulator.advance(self.simulator.time + self._link.draw())

    def _slipping(self, text: str) -> CommandResult:
        """Do a command; for a translation on slippery ground, only a part of it."""
        command, simulator = parse_command(text), self.simulator
        drive = self._drives.get(command.code)
        if command.problem or drive is None:
            return simulator.execute(command)
        command = self._weakened(command, drive)
        lost = self._oddities.slip
        if not lost or drive.kind.turns:
            return simulator.execute(command)
        pose = simulator.pose
        if (int(pose.x // CELL_SIZE) + int(pose.y // CELL_SIZE)) % 2:
            return simulator.execute(command)
        result = simulator.execute(replace(command, argument=repr((1.0 - lost) * float(command.argument))))
        trajectory = result.trajectory
        if trajectory is not None:
            more = lost / (1.0 - lost)
            for code, wheel in self._wheels.items():
                if wheel.slips:
                    counted = wheel.counted_on(0.0, more * trajectory.totals.x, more * trajectory.totals.y)
                    self._slipped[code] += wheel.spec.gain * counted
        return result

    def _weakened(self, command: Command, drive: DriveSpec) -> Command:
        """The command with the effects of a weak battery, and of wheels that start late."""
        odd, asked = self._oddities, parse_value(command.argument)
        if not (odd.weaken or odd.shortfall) or not isinstance(asked, float):
            return command
        short = math.degrees(odd.shortfall / WHEEL_RADIUS) if drive.kind.turns else odd.shortfall
        left = max(abs(asked) * (1.0 - odd.weaken * self._movements) - short, 0.0)
        self._movements += 1
        return replace(command, argument=repr(math.copysign(left, asked)))


class Wire(Protocol):
    """Port for reading and writing bytes. `read` returns none after `timeout` seconds without any."""

    def read(self, timeout: float | None) -> bytes: ...

    def write(self, data: bytes) -> None: ...


class PtyWire:
    """A new serial port, a pty. Unix only."""

    def __init__(self) -> None:
        import pty
        import tty

        # The other end is kept open too, so that the port outlives the programs that open it.
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)

    def read(self, timeout: float | None) -> bytes:
        ready, _, _ = select.select([self._master], [], [], timeout)
        return os.read(self._master, 4096) if ready else b""

    def write(self, data: bytes) -> None:
        while data:
            data = data[os.write(self._master, data) :]


class RestartingPtyWire(PtyWire):
    """A pty whose board starts again whenever it is opened, as by the line DTR. It is deaf for `boot`
    seconds, and then sends its greeting."""

    def __init__(self, boot: float, greeting: bytes) -> None:
        super().__init__()
        os.close(self._slave)  # while it is open, another opening cannot be seen
        self._boot, self._greeting = boot, greeting
        self._is_open = False

    def read(self, timeout: float | None) -> bytes:
        until = math.inf if timeout is None else time.monotonic() + timeout
        while time.monotonic() < until:
            if not self._look():
                time.sleep(LOOK)
            elif select.select([self._master], [], [], LOOK)[0]:
                with contextlib.suppress(OSError):  # it has been closed
                    return os.read(self._master, 4096)
        return b""

    def _look(self) -> bool:
        """True if a program has the port open. A board that has just been opened starts first."""
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        before, self._is_open = self._is_open, not any(how & select.POLLHUP for _, how in poll.poll(0))
        if self._is_open and not before:
            self._start()
        return self._is_open

    def _start(self) -> None:
        ready = time.monotonic() + self._boot
        while (left := ready - time.monotonic()) > 0:
            if select.select([self._master], [], [], left)[0]:
                try:
                    os.read(self._master, 4096)  # lost
                except OSError:  # it has been closed
                    time.sleep(min(left, LOOK))
        self.write(self._greeting)


class SerialWire:
    """An existing serial port, or a URL that pyserial opens."""

    def __init__(self, name: str, baud: int) -> None:
        import serial

        self._port: Any = serial.serial_for_url(name, baudrate=baud)

    def read(self, timeout: float | None) -> bytes:
        self._port.timeout = timeout
        return bytes(self._port.read(max(1, self._port.in_waiting)))

    def write(self, data: bytes) -> None:
        self._port.write(data)


class TcpWire:
    """One connection after the other to a TCP port."""

    def __init__(self, port: int) -> None:
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self._connection: socket.socket | None = None

    def read(self, timeout: float | None) -> bytes:
        if self._connection is None:
            self._connection, _ = self._listener.accept()
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection.settimeout(timeout)
        try:
            data = self._connection.recv(4096)
        except TimeoutError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._connection.close()
            self._connection = None
        return data

    def write(self, data: bytes) -> None:
        if self._connection is not None:
            with contextlib.suppress(OSError):  # it has disconnected; the next read detects that
                self._connection.sendall(data)


def replies(robot: Robot, wire: Wire) -> Iterator[bytes]:
    """Read commands for ever; their replies, one by one."""
    while True:
        data = wire.read(GRACE if robot.waiting else None)
        yield from robot.receive(data) if data else robot.silence()


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description="Be a robot's microcontroller on a serial port.")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--port", help="a serial port or pyserial URL (default: one is made, and its name printed)"
    )
    where.add_argument("--tcp", type=int, metavar="PORT", help="a TCP port instead, 0 for any free one")
    parser.add_argument("--baud", type=int, default=9600, help="bits a second on --port (default: 9600)")
    parser.add_argument(
        "--reply",
        choices=("float64", "float32", "text"),
        default="float64",
        help="form of a reply (default: float64); [packets] are always answered in brackets",
    )
    parser.add_argument("--byte-order", choices=("big", "little"), default="big", help="(default: big)")
    parser.add_argument(
        "--latency", type=_not_negative, default=0.0, metavar="S", help="seconds before a reply (default: 0)"
    )
    parser.add_argument(
        "--loss", type=_fraction, default=0.0, metavar="P", help="fraction of bytes lost, 0 to 1"
    )
    parser.add_argument("--boot-noise", action="store_true", help="send a greeting before the first reply")
    parser.add_argument(
        "--boot",
        type=_not_negative,
        metavar="S",
        help="start again whenever the port that is made is opened: deaf for S seconds, then, with "
        "--boot-noise, greet",
    )
    parser.add_argument("--constant", type=float, metavar="X", help="what every sensor reads")
    parser.add_argument("--seed", type=int, default=0, help="of the robot's errors and of lost bytes")
    parser.add_argument(
        "--config",
        metavar="SET",
        help="a configuration set that says what the robot is really like, and how long things take "
        "(default: the default set, answering at once)",
    )
    parser.add_argument(
        "--time-scale", type=_positive, default=1.0, metavar="N", help="N times as fast, with --config"
    )
    parser.add_argument(
        "--slip",
        type=_fraction,
        default=0.0,
        metavar="P",
        help="fraction of a translation lost on every other cell of the maze, 0 to 0.9",
    )
    parser.add_argument(
        "--stale",
        type=_fraction,
        default=0.0,
        metavar="P",
        help="how often a range reading is the one before",
    )
    parser.add_argument(
        "--weaken",
        type=_fraction,
        default=0.0,
        metavar="P",
        help="fraction of its strength that each movement costs the drives",
    )
    parser.add_argument(
        "--shortfall",
        type=_not_negative,
        default=0.0,
        metavar="IN",
        help="inches of the wheels' way that each movement ends short",
    )
    return parser.parse_args(arguments)


def _not_negative(text: str) -> float:
    number = float(text)
    if not 0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} must be 0 or more")
    return number


def _positive(text: str) -> float:
    number = float(text)
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} must be above 0")
    return number


def _fraction(text: str) -> float:
    number = float(text)
    if not 0 <= number <= 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be from 0 to 1")
    return number


def opened(options: argparse.Namespace) -> tuple[Wire, str]:
    """The wire of the options, and its name at the other end."""
    if options.boot is not None and (options.tcp is not None or options.port is not None):
        raise ValueError("--boot is for the port that is made: leave out --tcp and --port")
    if options.tcp is not None:
        tcp = TcpWire(options.tcp)
        return tcp, f"socket://127.0.0.1:{tcp.port}"
    if options.port is not None:
        return SerialWire(options.port, options.baud), options.port
    if sys.platform == "win32":
        raise OSError("Windows has no ports that can be made; use --port or --tcp")
    greeting = GREETING if options.boot_noise else b""
    pty = PtyWire() if options.boot is None else RestartingPtyWire(options.boot, greeting)
    return pty, pty.name


def robot_of(options: argparse.Namespace) -> Robot:
    """The robot that the options describe. Raises SimmerError for a set with mistakes."""
    oddities = Oddities(min(options.slip, 0.9), options.stale, options.weaken, options.shortfall)
    simulation = link = None
    if options.config is not None:
        configuration = load(find_set(options.config))
        simulation, delay = configuration.simulation, configuration.settings.link
        link = LinkDelay(delay.latency, delay.jitter, options.seed)
    return Robot(
        options.reply, options.byte_order, options.seed, options.constant, simulation, oddities, link
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Answer until Ctrl-C; returns the exit code."""
    options = parse(arguments)
    try:
        robot = robot_of(options)
        wire, name = opened(options)
    except (OSError, ValueError, SimmerError) as error:
        print(f"robot_emulator: {error}", file=sys.stderr)
        return 1
    print(name, flush=True)
    lost = random.Random(options.seed)
    greeting = GREETING if options.boot_noise and options.boot is None else b""
    with contextlib.suppress(KeyboardInterrupt):
        for reply in replies(robot, wire):
            takes = options.latency
            if options.config is not None:
                takes += robot.take_time() / options.time_scale
            if takes:
                time.sleep(takes)
            kept = bytes(byte for byte in reply if lost.random() >= options.loss)
            if greeting or kept:
                wire.write(greeting + kept)
            greeting = b""
    return 0


if __name__ == "__main__":
    sys.exit(main())
