"""A robot in the simulator, driven from Python.

    from simmer_tui.client import Robot

    with Robot() as robot:
        left, right = robot.read("u2", "u4")
        if robot.read("u1") > 4:
            robot.drive("d1", 3)

This file needs nothing but the standard library of Python 3.8 or later and nothing else of
SimMeR-TUI: it can be copied beside a program (`from client import Robot`).

Every error is a `RobotError`; its message says what to do. A `Robot` belongs to one thread.
"""

from __future__ import annotations

import base64
import contextlib
import importlib
import json
import math
import operator
import os
import selectors
import socket
import struct
import time
from collections.abc import Iterable, Iterator, Sequence
from types import TracebackType
from typing import Any, Literal, NamedTuple, SupportsFloat, SupportsIndex, Union, overload

# Accepts int, float, numpy scalars, Decimal, Fraction. Union, because Python 3.8 and 3.9 have no | of types
# at run time.
Number = Union[SupportsFloat, SupportsIndex]

# The defaults of config/settings.py: this file imports nothing, so that it can be copied.
DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT, DEFAULT_REPLY_PORT = 9000, 9001
DEFAULT_PACKET_PORT, DEFAULT_PACKET_REPLY_PORT = 61200, 61201
DEFAULT_BELIEF_PORT = 9002

# Judged: times that are short beside a round trip of a real robot, and long beside one to the simulator.
_LONGEST_COMMAND = 255  # bytes, and a newline; the simulator takes one byte more
_INTERRUPT_INTERVAL = 0.5  # s; on Windows, Ctrl-C is noticed only between two waits
_REPLY_CONNECT_TIMEOUT = 3.0  # s
_BELIEF_TIMEOUT = 0.2  # s; a program must not wait for what is only drawn
_QUESTION_TIMEOUT = 1.0  # s; older simulators never answer this question, and are asked only once
_MOST_RANGES = 4000  # ranges of a scan; a larger number is no count
# The simulator's config/reply_formats.py: formats of a number and orders of its bytes, in struct's letters.
_NUMBER_LETTERS = {"float64": "d", "float32": "f"}
_BYTE_ORDERS = {"big": ">", "little": "<"}
_MOST_STATES, _MOST_ROWS, _MOST_HEADINGS = 65536, 1000, 360  # of a grid; the simulator takes no more
# The simulator's protocol/mission_query.py; its mission.py has the order of the facts.
_MISSION_QUERY = "?m"
_LEAST_FACTS = 7  # the drop zone, time limit, gripper and start; the cells of the loading zone follow
_ALL_FACTS = frozenset(("drop_zone", "loading_zone", "time_limit", "gripper"))  # the start is not always told
_EMPTY_READ_WAIT = 0.005  # s, between two reads while there is no reply yet
_BUSY_WAIT = 0.02  # s, between two tries while the robot still moves
_LONGEST_TIMEOUT = 1e6  # s; the system's sockets on Windows take 2**31 ms
_TIMEOUTS = (TimeoutError, socket.timeout)  # the same class only since Python 3.10


class RobotError(Exception):
    """Base of all errors of this module."""


class RobotUnreachableError(RobotError):
    """Nothing answers at the robot's host and port."""


class RobotClosedError(RobotError):
    """The connection has ended, or was closed from this side."""


class RobotTimeoutError(RobotError):
    """A reply, or the end of a movement, did not come in time."""


class CommandRefusedError(RobotError):
    """The robot did nothing: it answered NaN, or the code is a sensor's where a drive's is needed, or a
    lidar's where one number is."""


class UnknownCodeError(CommandRefusedError):
    """The robot has no sensor or drive with this code, or it is disabled."""


class NoMissionError(RobotError):
    """The simulator has no mission, or is too old to tell its facts."""


class InvalidInputError(RobotError, ValueError):
    """A command, number, port or environment variable that cannot be right; nothing was sent."""


class Movement(NamedTuple):
    """The reply to a drive: the command as it was sent, and the number that came back.

    The simulator answers Infinity when the movement has ended, and also when a wall has ended it early. No
    dialect has a reply for that, so read a sensor. A real robot may answer with a number of its own.
    """

    command: str
    reply: float

    @property
    def ended(self) -> bool:
        """True if the robot says that the movement is over."""
        return self.reply == math.inf


class Mission(NamedTuple):
    """The facts of a mission that a program may know. Places are the middles of cells, inches.

    `time_limit` is in simulated seconds, `gripper` the code of the gripper, `start` x, y and heading if
    mission.toml gives them. If not, the robot has to find out where it is. Facts that nobody tells are empty,
    the time limit is then infinite.
    """

    drop_zone: tuple[float, float]
    loading_zone: tuple[tuple[float, float], ...] = ()
    time_limit: float = math.inf
    gripper: str = ""
    start: tuple[float, float, float] | None = None


class Robot:
    """A connection to one robot; opened by the constructor, closed by `with` or `close()`.

    Args:
        host: the simulator's host; by default SIMMER_HOST, otherwise 127.0.0.1.
        port: its command port; by default SIMMER_PORT, otherwise 9000.
        reply_port: its reply port; by default SIMMER_REPLY_PORT, otherwise 9001 if the command port is 9000.
            With 0, or a port where nobody listens, replies come back on the command connection.
        timeout: seconds to wait for a reply; may be changed later. With timed motion a reply comes when the
            movement has ended.
        protocol: "binary", or "packets": bracketed text, one connection a message, the dialect of
            simmer-python. Its ports are SIMMER_PACKET_PORT and SIMMER_PACKET_REPLY_PORT, otherwise 61200
            and 61201.
        reply_format, byte_order: how the simulator writes numbers (binary only); its settings have
            the same names and defaults.
        belief_port: port for beliefs, and for questions why a command was refused; by default
            SIMMER_BELIEF_PORT, otherwise 9002.
        token: the access token, if the simulator has one; by default SIMMER_TOKEN, otherwise none.

    Raises:
        RobotUnreachableError: nothing listens there.
        InvalidInputError: an argument or environment variable is not valid.
    """

    def __init__(
        self,
        host: str | None = None,
        port: int | None = None,
        reply_port: int | None = None,
        *,
        timeout: float = 30.0,
        protocol: Literal["binary", "packets"] = "binary",
        reply_format: Literal["float64", "float32"] = "float64",
        byte_order: Literal["big", "little"] = "big",
        belief_port: int | None = None,
        token: str | None = None,
    ) -> None:
        _one_of("protocol", protocol, ("binary", "packets"))
        _one_of("reply_format", reply_format, tuple(_NUMBER_LETTERS))
        _one_of("byte_order", byte_order, tuple(_BYTE_ORDERS))
        if not 0 < _finite("timeout", timeout) <= _LONGEST_TIMEOUT:
            allowed = f"a number of seconds above 0, at most {_LONGEST_TIMEOUT:.0f}"
            raise InvalidInputError(f"timeout is {timeout!r}: it must be {allowed}")
        self.timeout = float(timeout)
        if not isinstance(host, (str, type(None))):
            raise InvalidInputError(f"host is {host!r}: it must be text, such as '127.0.0.1'")
        self.host = host or os.environ.get("SIMMER_HOST", "").strip() or DEFAULT_HOST
        self._ended = ""
        belief_port = _port("belief_port", belief_port, "SIMMER_BELIEF_PORT", DEFAULT_BELIEF_PORT)
        dial = _Dial(self.host, _token(token))
        self._belief = _BeliefLine(dial, belief_port)
        is_packets = protocol == "packets"
        usual = DEFAULT_PACKET_PORT if is_packets else DEFAULT_PORT
        self.port = _port("port", port, "SIMMER_PACKET_PORT" if is_packets else "SIMMER_PORT", usual)
        self._reasons = _Reasons(dial, belief_port, self.port)
        self._link: _BinaryLink | _PacketLink
        if is_packets:
            name = "SIMMER_PACKET_REPLY_PORT"
            reply_port = _port("reply_port", reply_port, name, DEFAULT_PACKET_REPLY_PORT)
            self._link = _PacketLink(dial, self.port, reply_port, self.timeout, self._reasons)
        else:
            # With another command port, port 9001 may belong to another simulator.
            usual = DEFAULT_REPLY_PORT if self.port == DEFAULT_PORT else 0
            reply_port = _port("reply_port", reply_port, "SIMMER_REPLY_PORT", usual, lowest=0)
            # Big-endian doubles by default: what MATLAB's tcpip objects read.
            number = struct.Struct(_BYTE_ORDERS[byte_order] + _NUMBER_LETTERS[reply_format])
            self._link = _BinaryLink(dial, self.port, reply_port, self.timeout, number, self._reasons)

    @overload
    def read(self, code: str) -> float: ...
    @overload
    def read(self, code: str, other: str, /, *more: str) -> tuple[float, ...]: ...

    def read(self, code: str, *more: str) -> float | tuple[float, ...]:
        """A reading of the sensor with this code, in the sensor's unit (inches, degrees).

        Several codes give their readings in order, in one round trip. For a lidar use `scan`.

        Raises:
            UnknownCodeError: there is no such sensor, or it is disabled.
            CommandRefusedError: a code is a lidar's, or the sensor did not answer. The message says why, if
                the simulator tells.
        """
        codes = [_checked_code(each) for each in (code, *more)]
        commands = [self._link.checked(each) for each in codes]
        with self._exchange(" ".join(commands)):
            values = self._link.exchange(commands, self.timeout)
        for each, value in zip(codes, values):
            if math.isnan(value):
                raise _not_read(self._reasons.why(each), each)
        return tuple(values) if more else values[0]

    def scan(self, code: str) -> list[float]:
        """All ranges of the last whole turn of the lidar with this code, inches, ray by ray.

        A range is infinite where a ray met nothing in reach. `send("sc-90")` reads one ray, the one nearest
        to a bearing.

        Raises:
            UnknownCodeError: there is no such sensor, or it is disabled.
            CommandRefusedError: the code is another sensor's or a drive's.
        """
        command = self._link.checked(_checked_code(code))
        with self._exchange(command):
            return self._link.scan(command, self.timeout)

    def drive(self, code: str, value: Number) -> Movement:
        """Move by `value` inches or degrees with the drive `code`. Returns the robot's reply.

        Returns when the movement has ended. A wall may have ended it early, which the reply does not show
        (see `Movement`).

        Raises:
            UnknownCodeError: no enabled drive has the code.
            CommandRefusedError: the value is refused, the robot is still moving, or the code is a sensor's.
                The message says which, if the simulator tells.
        """
        number = _decimal(value)
        with self._exchange(f"{_checked_code(code)}-{number}"):
            return self._link.drive(code, number, self.timeout)

    def send(self, command: str) -> float:
        """Send one command as it stands (`u1`, `d1-3`, `r1--45`) and return the number that comes back.

        Infinity says that a movement has ended, NaN that the command was refused; NaN is returned,
        not raised. In packets, `True` is infinity (1.0 for a command without a value, an ir sensor),
        `False` NaN (0.0 for a command without a value) and `Not Found` NaN.
        """
        command = self._link.checked(command)
        with self._exchange(command):
            return self._link.exchange([command], self.timeout)[0]

    def sleep(self, seconds: Number) -> None:
        """Let `seconds` of the robot's time pass, while it continues to drive.

        The simulator's time is not this program's: during `time.sleep` a driving robot hardly moves.

        Raises:
            CommandRefusedError: the simulator has no command to wait, or the robot is a real one that
                answers it otherwise. Use `time.sleep` there.
        """
        number = _decimal(_finite("the seconds to sleep", seconds))
        command = f"wt-{number}"
        with self._exchange(command):
            longest = self.timeout + min(float(number), _LONGEST_TIMEOUT)
            value = self._link.exchange([self._link.checked(command)], longest)[0]
        if not math.isinf(value):
            why = self._reasons.why(command).reason or "it has no command to wait"
            raise CommandRefusedError(f"the robot refused {command!r}: {why}. Use time.sleep({number}) there")

    def maze(self) -> tuple[tuple[int, ...], ...]:
        """The maze: rows of cells of 12 x 12 in, the first row on top.

        0 is a wall, 1 empty, 2 the robot's start, 3 the block. It is part of `configuration`.

        Raises:
            RobotError: as `configuration`.
        """
        cells: tuple[tuple[int, ...], ...] = self.configuration().simulation.maze.cells
        return cells

    def mission(self) -> Mission:
        """The facts of the mission. The SIMMER_* variables that the simulator gives to a program that it runs
        count first; what they leave open is asked for over this connection. That takes no simulated time.

        Raises:
            NoMissionError: the simulator has no mission. The message has the command that starts one.
        """
        variables = _mission_variables()
        numbers: list[float] = []
        if not _ALL_FACTS.issubset(variables):
            with self._exchange(_MISSION_QUERY), contextlib.suppress(CommandRefusedError):
                numbers = self._link.scan(_MISSION_QUERY, self.timeout, asks_why=False)
        known = _mission_facts(numbers) if len(numbers) >= _LEAST_FACTS else {}
        known.update(variables)
        if "drop_zone" not in known:
            raise NoMissionError(
                f"the simulator on {self.host} port {self.port} has no mission: end it, and start "
                f"'simmer-tui --mission{self._link.options}'"
            )
        return Mission(**known)

    def configuration(self) -> Any:
        """The whole set (`simmer_tui.config.loader.Configuration`): maze, robot, sensors, drives.

        The installed package reads it from files; the robot is not asked. The simulator names set, profiles
        and maze to a program that it runs (SIMMER_CONFIG, SIMMER_DRIVE_PROFILE, SIMMER_SENSOR_PROFILE,
        SIMMER_MAZE). Otherwise it is `config` in the working directory, or the default set.

        Raises:
            RobotError: SimMeR-TUI is not installed where this program runs, or the set has mistakes.
        """
        try:
            # Imported by name, and only here: a copy of this file works without the package.
            read_set = importlib.import_module("simmer_tui.notebook").configuration_from_environment
        except ImportError as error:
            raise RobotError(
                f"maze and robot are read by SimMeR-TUI, which this Python does not have ({error}): "
                "pip install 'simmer-tui @ git+https://github.com/simmer-tui/simmer-tui'"
            ) from error
        try:
            return read_set(os.environ)
        except importlib.import_module("simmer_tui.errors").ConfigurationError as error:
            raise RobotError(f"the configuration set has mistakes: {error}") from error

    def believe(
        self,
        x: Number | None = None,
        y: Number | None = None,
        heading: Number | None = None,
        spread: Number | None = None,
        particles: Iterable[Iterable[float]] | None = None,
        note: str | None = None,
        grid: Any = None,
        bounds: Iterable[Number] | None = None,
        first: Number | None = None,
    ) -> None:
        """Show where the program believes the robot to be, beside where it is, in the simulator's app.

        It never affects the commands and never waits. If nobody listens, or nobody reads, it does nothing.

        Args:
            x, y, heading: global frame, inches and degrees. With a grid they may be left out: then they are
                those of its best cell.
            spread: standard deviation of the position, inches.
            particles: rows of (x, y) or (x, y, heading); a numpy array will do.
            note: a short text shown beside it.
            grid: probabilities, rows x columns or rows x columns x headings; a numpy array, or nested lists.
                Row 1 is on top, as in maze.csv. They need not sum to 1. At most 65,536 states.
            bounds: x0, y0, x1, y1 of the grid, inches; by default the whole maze.
            first: its first heading, degrees, by default 0; the others follow counterclockwise.

        Raises:
            InvalidInputError: a number is not finite, spread is negative, or particles or grid have another
                shape.
        """
        belief: dict[str, object] = {}
        for name, value in (("x", x), ("y", y), ("heading", heading)):
            if value is not None:
                belief[name] = _finite(name, value)
            elif grid is None:
                raise InvalidInputError(f"{name} is missing: only a belief with a grid may leave it out")
        if grid is not None:
            belief["grid"] = _packed_grid(grid, bounds, first)
        elif bounds is not None or first is not None:
            raise InvalidInputError("bounds and first are those of a grid: there is none")
        if spread is not None:
            belief["spread"] = deviation = _finite("spread", spread)
            if deviation < 0:
                raise InvalidInputError(f"spread is {spread!r}: it must be 0 or more")
        if particles is not None:
            belief["particles"] = _rows(particles)
        if note is not None:
            belief["note"] = str(note)
        # Checked above even if nothing is sent, so that a mistake shows without a screen too.
        if not self._ended:
            self._belief.send(belief)

    def close(self) -> None:
        """End the connection; doing it twice is harmless."""
        self._end("this connection is closed: open a new Robot")

    @property
    def closed(self) -> bool:
        """True if the connection has ended, as far as this side knows."""
        return bool(self._ended)

    @property
    def reply_port(self) -> int:
        """The port that replies come from; 0 when they come back on the command connection."""
        return self._link.reply_port

    def __enter__(self) -> Robot:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __del__(self) -> None:
        # A notebook's `robot = Robot()`, run again, drops the old one, and one program at a time drives. The
        # selector is in a cycle with itself, so without this its connections would stay open.
        if hasattr(self, "_link"):
            self.close()

    @contextlib.contextmanager
    def _exchange(self, command: str) -> Iterator[None]:
        """Guard one exchange: an interrupted one ends the connection. Otherwise a late reply would be taken
        for the answer to the next command."""
        if self._ended:
            raise RobotClosedError(self._ended)
        try:
            yield
        except (CommandRefusedError, InvalidInputError):  # no reply is pending
            raise
        except BaseException as error:  # after KeyboardInterrupt, too, a reply is still to come
            why = str(error) or type(error).__name__
            self._end(f"this connection was closed after {command!r} was cut short ({why}): open a new Robot")
            raise

    def _end(self, why: str) -> None:
        if not self._ended:
            self._ended = why
            self._link.close()
            self._belief.close()


class _Dial:
    """Opens all connections with the same options: no delay of small messages, and the token first."""

    def __init__(self, host: str, token: str) -> None:
        self.host = host
        self._token = token

    def connect(self, port: int, timeout: float) -> socket.socket:
        # For a name as text Python loads its codec of international names: 1 ms of the 25 ms of a short
        # program.
        host: Any = self.host.encode() if self.host.isascii() else self.host
        connection = socket.create_connection((host, port), timeout)
        try:
            # Small messages, each answered: Nagle's algorithm would delay them.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self._token:
                connection.sendall(self._token.encode("utf-8") + b"\n")
        except OSError:
            connection.close()
            raise
        return connection

    def expect(self, port: int, timeout: float, options: str = "") -> socket.socket:
        """A connection that the robot cannot be used without; `options` of simmer-tui make it answer there.
        Raises RobotUnreachableError."""
        try:
            return self.connect(port, timeout)
        except OSError as error:
            # A simulator tells its program the ports that it has.
            has_packets = "SIMMER_PACKET_PORT" in os.environ and "SIMMER_PORT" not in os.environ
            if not options and has_packets:
                raise RobotUnreachableError(
                    f"nothing answers on {self.host} port {port}: the simulator takes packets. Open it with "
                    'Robot(protocol="packets"), or start it with --listeners binary'
                ) from error
            raise RobotUnreachableError(
                f"no simulator answers on {self.host} port {port} ({error.strerror or error}): is it "
                f"running? Start it with 'simmer-tui{options}' (--mission for a mission, --no-ui for no "
                "screen), or give this program its host and port"
            ) from error


class _BinaryLink:
    """Commands as lines, replies of eight (or four) bytes, over permanent connections."""

    options = ""
    """Options of simmer-tui that make it answer here."""

    def __init__(
        self,
        dial: _Dial,
        port: int,
        reply_port: int,
        timeout: float,
        number: struct.Struct,
        reasons: _Reasons,
    ) -> None:
        self._number = number
        self._reasons = reasons
        self._selector = selectors.DefaultSelector()
        self._commands = dial.expect(port, timeout)
        self._replies = self._commands
        # The exchange under way: the commands sent, its time limit and end, and the bytes received so far.
        self._shown, self._timeout, self._deadline, self._came = "", timeout, 0.0, b""
        self.reply_port = 0
        if reply_port:
            # Simulators of 2020-11 and later need no second connection, so its absence is no error.
            with contextlib.suppress(OSError):
                self._replies = dial.connect(reply_port, min(timeout, _REPLY_CONNECT_TIMEOUT))
                self.reply_port = reply_port
        for connection in {self._commands, self._replies}:
            self._selector.register(connection, selectors.EVENT_READ)

    def checked(self, command: str) -> str:
        return _checked_command(command, forbidden="")

    def exchange(self, commands: Sequence[str], timeout: float) -> list[float]:
        """The numbers that come back for commands sent in one go, in their order."""
        return self._numbers(self._reply(commands, timeout))

    def scan(self, code: str, timeout: float, *, asks_why: bool = True) -> list[float]:
        ranges = self._numbers(self._reply([code], timeout, scan=True))
        if math.isnan(ranges[0]):
            raise _not_scanned(self._reasons.why(code) if asks_why else _Why(), code)
        return ranges[1:]

    def _numbers(self, reply: bytes) -> list[float]:
        return [float(number) for (number,) in self._number.iter_unpack(reply)]

    def _reply(self, commands: Sequence[str], timeout: float, *, scan: bool = False) -> bytes:
        """The reply bytes for commands sent in one go: a number for each. With `scan`, the count and numbers
        of a scan."""
        self._shown, self._timeout, self._came = " ".join(commands), timeout, b""
        self._deadline = time.monotonic() + timeout
        try:
            self._commands.settimeout(timeout)
            self._commands.sendall("".join(f"{command}\n" for command in commands).encode("ascii"))
            if scan:
                return self._counted()
            size = len(commands) * self._number.size
            # One byte more than expected shows a reply that is too long: another format, or a scan.
            reply = self._receive(size, spare=1)
            if len(reply) > size or self._begins_scan(commands, reply):
                raise self._surplus(commands)
            return reply
        except _TIMEOUTS as error:
            raise RobotTimeoutError(f"{self._shown!r} could not be sent within {timeout:g} s") from error
        except OSError as error:
            raise self._closed() from error

    def _counted(self) -> bytes:
        """The reply to a lidar's code: a count and so many numbers, or one NaN."""
        code, size = self._shown, self._number.size
        reply = self._receive(size, spare=(1 + _MOST_RANGES) * size)
        [count] = self._number.unpack_from(reply)
        if not math.isnan(count):
            # A whole number may be another sensor's reading; then nothing follows, however long we wait.
            if len(reply) == size and (not _is_count(count) or self._reasons.gives_scan(code) is False):
                raise _no_lidar(code, f"{count:g}")
            if _is_count(count):
                size += int(count) * size
                reply = self._receive(size)
        if len(reply) > size:
            raise _too_much(code)
        return reply

    def _begins_scan(self, commands: Sequence[str], reply: bytes) -> bool:
        """True if a lidar with few rays is among the commands. Its scan fits into the bytes expected for all
        commands, whose other numbers are still to come."""
        return any(
            len(command) == 2
            and _is_count(number)
            and place + number < len(commands)
            # Counters and yes-or-no sensors give whole numbers too.
            and self._reasons.gives_scan(command)
            for place, (command, number) in enumerate(zip(commands, self._numbers(reply)))
        )

    def _surplus(self, commands: Sequence[str]) -> RobotError:
        """The error for a reply longer than one number a command. A scan is read to its end, so that the
        connection stays usable."""
        scans = [each for each in commands if len(each) == 2 and self._reasons.gives_scan(each)]
        if not scans:
            return _too_much(self._shown)
        end, size = 0, self._number.size
        for command in commands:
            end += size
            if command in scans:
                [count] = self._number.unpack_from(self._receive(end), end - size)
                end += int(count) * size if _is_count(count) else 0
        self._receive(end)
        return _is_lidar(scans[0])

    def drive(self, code: str, number: str, timeout: float) -> Movement:
        command = f"{code}-{number}"
        [reply] = self.exchange([command], timeout)
        if math.isnan(reply):
            raise self._reasons.why(command).error(code, f"the robot refused {command!r}")
        # A real robot answers a drive with a number of its own: the kind of the code decides.
        if math.isfinite(reply) and self._reasons.is_sensor(code):
            raise _sensor_driven(code, f"{reply:g}")
        return Movement(command, reply)

    def close(self) -> None:
        self._selector.close()
        self._replies.close()
        self._commands.close()

    def _receive(self, size: int, spare: int = 0) -> bytes:
        """The first `size` bytes of a reply, including those already received, and at most `spare` more."""
        while len(self._came) < size:
            remaining = self._deadline - time.monotonic()
            came = len(self._came)
            if remaining <= 0:
                # Whole replies of several commands came one by one: the link, or the robot, is slow.
                # Half of the bytes are replies of the other format.
                each = self._number.size
                hint = f" ({came} of {size} bytes came: does reply_format match?)" if came else ""
                if came and came % each == 0 and 2 * came != size:
                    hint = f" ({came // each} of {size // each} replies came)"
                raise RobotTimeoutError(f"no reply to {self._shown!r} within {self._timeout:g} s{hint}")
            ready = [key.fileobj for key, _ in self._selector.select(min(remaining, _INTERRUPT_INTERVAL))]
            if self._replies in ready:
                piece = self._replies.recv(size + spare - came)
                self._came += piece
            elif self._commands in ready:
                piece = self._commands.recv(1)
                if piece:
                    raise RobotError(
                        f"the reply to {self._shown!r} came on the command connection, not on reply port "
                        f"{self.reply_port}: open the Robot with reply_port=0"
                    )
            else:
                continue
            if not piece:
                raise self._closed()
        return self._came

    def _closed(self) -> RobotClosedError:
        return RobotClosedError(
            f"the simulator closed the connection before it answered {self._shown!r}: "
            "it has ended, another program is driving the robot (one at a time), it is another user's, "
            "or it demands a --token (see its log)"
        )


class _PacketLink:
    """`[u0]` on a connection of its own, `[u0:12.345]` from another."""

    options = " --listeners packets"
    """Options of simmer-tui that make it answer here."""

    def __init__(self, dial: _Dial, port: int, reply_port: int, timeout: float, reasons: _Reasons) -> None:
        self._dial = dial
        self._reasons = reasons
        self._port = port
        self.reply_port = reply_port
        # Replies to an earlier program would be taken for ours: they are read and dropped.
        with dial.expect(reply_port, timeout, " --config simmer-python") as leftovers:
            leftovers.settimeout(min(timeout, 1.0))
            with contextlib.suppress(OSError):
                while leftovers.recv(4096):
                    pass

    def checked(self, command: str) -> str:
        command = _checked_command(command, forbidden="[],")
        if len(command) < 2:
            raise InvalidInputError(f"the command {command!r} is too short: a code has two characters")
        return command

    def exchange(self, commands: Sequence[str], timeout: float) -> list[float]:
        answers = self._ask(commands, time.monotonic() + timeout, timeout)
        return [self._number(command, answer) for command, answer in zip(commands, answers)]

    @staticmethod
    def _number(command: str, answer: str) -> float:
        has_value = len(command) > 2
        words: dict[str, float] = {
            "True": math.inf if has_value else 1.0,
            "False": math.nan if has_value else 0.0,
            "Not Found": math.nan,
            "DRIVE STOP": math.inf,
        }
        try:
            return words[answer] if answer in words else float(answer)
        except ValueError as error:
            if ";" in answer:
                raise _is_lidar(command) from None
            raise RobotError(f"the reply to {command!r} is {answer!r}, which is no number") from error

    def scan(self, code: str, timeout: float, *, asks_why: bool = True) -> list[float]:
        [answer] = self._ask([code], time.monotonic() + timeout, timeout)
        if answer in ("Not Found", "False"):
            why = self._reasons.why(code) if asks_why else _Why()
            # A yes-or-no sensor says False, too.
            if answer == "Not Found" or why.scan or why.kind != "sensor":
                raise _not_scanned(why, code)
        try:
            ranges = [float(word) for word in answer.split(";")]
        except ValueError:
            raise _no_lidar(code, answer) from None
        # One number may be the range of a lidar with one ray, or any other sensor's reading.
        if len(ranges) == 1 and not self._reasons.gives_scan(code):
            raise _no_lidar(code, answer)
        return ranges

    def drive(self, code: str, number: str, timeout: float) -> Movement:
        self._until_accepted(code, number, timeout, ask=True)
        # Accepted as soon as the movement has ended. A gripper does not stand still at 0: it opens.
        is_gripper = number in ("0", "1") and self._reasons.is_gripper(code)
        self._until_accepted(code, number if is_gripper else "0", timeout)
        return Movement(f"{code}:{number}", math.inf)

    def close(self) -> None:
        """Do nothing: no connection is open between two messages."""

    def _until_accepted(self, code: str, number: str, timeout: float, *, ask: bool = False) -> None:
        command = self.checked(f"{code}:{number}")
        deadline = time.monotonic() + timeout
        while (answer := self._ask([command], deadline, timeout)[0]) != "True":
            if answer == "Not Found":
                raise UnknownCodeError(f"the robot knows no drive {code!r} (or it is disabled)")
            if answer != "False":
                raise _sensor_driven(code, answer)
            if ask:  # asked once: as a rule the robot is still moving, and the command is sent many times
                ask = False
                why = self._reasons.why(command)
                if why.reason and not why.early:
                    raise why.error(code, f"the robot refused {command!r}")
            if time.monotonic() + _BUSY_WAIT > deadline:
                raise RobotTimeoutError(
                    f"{command!r} was not accepted within {timeout:g} s: the robot is still moving, "
                    "or does not take the value"
                )
            # No dialect of packets says that a movement has ended: clients ask again, as simmer-python's do.
            time.sleep(_BUSY_WAIT)

    def _ask(self, commands: Sequence[str], deadline: float, timeout: float) -> list[str]:
        """The texts that come back for commands sent in one packet, without their codes."""
        command = ",".join(commands)
        late = f"no reply to {command!r} within {timeout:g} s"
        try:
            with self._connection(self._port, deadline) as sender:
                sender.sendall(f"[{command}]".encode("ascii"))
            while time.monotonic() < deadline:
                answers = self._find(self._read(deadline), commands)
                if answers is not None:
                    return answers
                time.sleep(_EMPTY_READ_WAIT)
        except _TIMEOUTS as error:
            raise RobotTimeoutError(late) from error
        except OSError as error:
            raise RobotClosedError(
                f"the simulator on {self._dial.host} ports {self._port} and {self.reply_port} has ended "
                f"or broke off before it answered {command!r} ({error})"
            ) from error
        raise RobotTimeoutError(late)

    def _read(self, deadline: float) -> str:
        """One whole message, or an empty text if none is waiting."""
        with self._connection(self.reply_port, deadline) as receiver:
            # A reply may come in several segments; its bracket ends it.
            message = _received(receiver, b"]", deadline)
        if message and not message.endswith(b"]"):
            raise ConnectionError(f"half a reply came: {message!r}")
        return message.decode("ascii", "replace")

    @staticmethod
    def _find(message: str, commands: Sequence[str]) -> list[str] | None:
        """The newest item of each command, in their order. Older items are replies that an earlier program
        did not read."""
        items = message.strip("[]").split(",")
        answers: list[str] = []
        for command in reversed(commands):
            while items and items[-1][:3] != f"{command[:2]}:":
                items.pop()
            if not items:
                return None
            answers.insert(0, items.pop()[3:])
        return answers

    def _connection(self, port: int, deadline: float) -> socket.socket:
        return self._dial.connect(port, max(deadline - time.monotonic(), 0.001))


def _received(connection: socket.socket, end: bytes, deadline: float) -> bytes:
    """The bytes up to an end, or until the other side has closed."""
    data = b""
    while not data.endswith(end):
        connection.settimeout(max(deadline - time.monotonic(), 0.001))
        piece = connection.recv(4096)
        if not piece:
            break
        data += piece
    return data


class _Why(NamedTuple):
    """The simulator's answer about a refused command: the reason, and the kind of the code ("sensor",
    "drive", "unknown"). Both are empty without an answer. `scan` is true for the code of a lidar, `gripper`
    for that of the gripper, `early` if the same command may be accepted later."""

    reason: str = ""
    kind: str = ""
    scan: bool = False
    early: bool = False
    gripper: bool = False

    def error(self, code: str, what: str) -> CommandRefusedError:
        """The error to raise; `what` says what the robot did."""
        if self.kind == "unknown":
            return UnknownCodeError(f"{what}: {self.reason or f'no enabled drive has the code {code!r}'}")
        return CommandRefusedError(
            f"{what}: "
            + (
                self.reason
                or f"no enabled drive has the code {code!r} (see drive.csv), the value is beyond 1e6, or the "
                "robot is still moving"
            )
        )


def _sensor_driven(code: str, answer: str) -> CommandRefusedError:
    return CommandRefusedError(
        f"{code!r} is no drive: {code} is a sensor, and it answered {answer}. "
        f"Read it with robot.read({code!r})"
    )


def _too_much(shown: str) -> RobotError:
    return RobotError(
        f"more came back for {shown!r} than it asked for: reply_format and byte_order must be the "
        "simulator's own (its settings.toml), or a code is a lidar's: see robot.scan"
    )


def _is_lidar(code: str) -> CommandRefusedError:
    return CommandRefusedError(
        f"{code!r} is a lidar, which answers with many numbers: robot.scan({code!r}) gives them all, "
        f"robot.send('{code}-90') the one to the left"
    )


def _no_lidar(code: str, answer: str) -> CommandRefusedError:
    return CommandRefusedError(
        f"{code!r} is no lidar: it answered {answer}. Read it with robot.read({code!r})"
    )


def _not_read(why: _Why, code: str) -> CommandRefusedError:
    if why.kind == "sensor" and why.reason:
        return CommandRefusedError(f"the robot refused {code!r}: {why.reason}")
    return _no_such("sensor", code, why)


def _not_scanned(why: _Why, code: str) -> CommandRefusedError:
    if why.scan:
        return CommandRefusedError(f"the robot refused {code!r}: {why.reason or 'it does not say why'}")
    return _no_such("lidar", code, why)


def _no_such(what: str, code: str, why: _Why) -> UnknownCodeError:
    known = f"{code!r} is a drive" if why.kind == "drive" else why.reason or "or it is disabled"
    return UnknownCodeError(f"the robot knows no {what} {code!r} ({known}): see its sensors.csv")


def _is_count(number: float) -> bool:
    return 1 <= number <= _MOST_RANGES and number.is_integer()


class _Reasons:
    """Asks the simulator why it refused a command: a line on the belief port, answered by a line.

    Asked only after a refusal, or after an unexpected reply. A simulator that does not answer is not asked
    again.
    """

    def __init__(self, dial: _Dial, belief_port: int, port: int) -> None:
        self._dial = dial
        self._belief_port = belief_port
        self._port = port
        self._given_up = False
        self._known: dict[str, _Why] = {}  # asked once a code: a real robot answers each drive with a number

    def why(self, command: str) -> _Why:
        """The simulator's answer about a refused command."""
        if self._given_up:
            return _Why()
        answer = self._answer(command)
        ports = answer.get("ports") if isinstance(answer, dict) else None
        # Nobody answers, or it is another simulator than the one that was driven.
        if not isinstance(ports, list) or self._port not in ports:
            self._given_up = True
            return _Why()
        scan, early, gripper = (answer.get(each) is True for each in ("scan", "early", "gripper"))
        return _Why(str(answer.get("why", "")), str(answer.get("kind", "")), scan, early, gripper)

    def is_sensor(self, code: str) -> bool:
        """True if the simulator says that a code is a sensor's."""
        return self._about(code).kind == "sensor"

    def is_gripper(self, code: str) -> bool:
        """True if the simulator says that a code is the gripper's."""
        return self._about(code).gripper

    def gives_scan(self, code: str) -> bool | None:
        """True if the simulator says that a code is a lidar's; None if nobody says."""
        why = self._about(code)
        return why.scan if why.kind else None

    def _about(self, code: str) -> _Why:
        if code not in self._known:
            self._known[code] = self.why(code)
        return self._known[code]

    def _answer(self, command: str) -> Any:
        deadline = time.monotonic() + _QUESTION_TIMEOUT
        try:
            with self._dial.connect(self._belief_port, _QUESTION_TIMEOUT) as connection:
                connection.sendall(json.dumps({"why": command}).encode("ascii") + b"\n")
                return json.loads(_received(connection, b"\n", deadline))
        except (OSError, ValueError):
            return None


class _BeliefLine:
    """Sends beliefs as newline-delimited JSON. The connection is opened at the first belief and given up at
    the first fault."""

    def __init__(self, dial: _Dial, port: int) -> None:
        self._dial = dial
        self._port = port
        self._connection: socket.socket | None = None
        self._given_up = False
        self._unsent = b""

    def send(self, belief: dict[str, object]) -> None:
        if self._given_up:
            return
        try:
            if self._connection is None:
                self._connection = self._dial.connect(self._port, _BELIEF_TIMEOUT)
                # A full buffer must not delay the program: the belief is left out instead.
                self._connection.setblocking(False)
            self._flush(self._connection)
            if not self._unsent:  # otherwise the reader is behind: this belief is left out, lines stay whole
                self._unsent = json.dumps(belief, separators=(",", ":")).encode("ascii") + b"\n"
                self._flush(self._connection)
        except OSError:
            self._unsent = b""
            self.close()

    def close(self) -> None:
        # For good: without a simulator that reads, each belief would cost a connection attempt.
        self._given_up = True
        if self._connection is not None:
            with contextlib.suppress(OSError):
                if self._unsent:
                    self._connection.settimeout(_BELIEF_TIMEOUT)
                    self._connection.sendall(self._unsent)
            self._connection.close()
            self._connection = None

    def _flush(self, connection: socket.socket) -> None:
        while self._unsent:
            try:
                self._unsent = self._unsent[connection.send(self._unsent) :]
            except BlockingIOError:
                return


def _one_of(name: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InvalidInputError(f"{name} is {value!r}: it must be {' or '.join(map(repr, allowed))}")


def _port(name: str, given: int | None, variable: str, default: int, lowest: int = 1) -> int:
    """The port given, otherwise the environment's, otherwise the default."""
    text = os.environ.get(variable, "").strip()
    shown: object = given
    if given is not None:
        port = operator.index(given) if isinstance(given, SupportsIndex) else -1
    elif not text:
        return default
    else:
        name, shown = f"the environment variable {variable}", text
        port = int(text) if text.isascii() and text.isdigit() else -1
    if not lowest <= port <= 65535:
        raise InvalidInputError(f"{name} is {shown!r}: a port is a whole number from {lowest} to 65535")
    return port


def _token(given: str | None) -> str:
    """The token given, otherwise the environment's, otherwise none."""
    token = os.environ.get("SIMMER_TOKEN", "").strip() if given is None else given
    if not isinstance(token, str) or not token.isprintable():
        raise InvalidInputError("the token must be a line of text, as the simulator's --token has it")
    return token


def _mission_facts(numbers: Sequence[float]) -> dict[str, Any]:
    """The answer to the query for a mission, by the fields of `Mission`."""
    drop_x, drop_y, time_limit, gripper, x, y, heading, *cells = numbers
    return {
        "drop_zone": (drop_x, drop_y),
        "loading_zone": tuple(zip(cells[::2], cells[1::2])),
        "time_limit": time_limit,
        "gripper": bytes(divmod(int(gripper), 256)).decode("latin-1"),
        "start": None if math.isnan(x) else (x, y, heading),
    }


def _mission_variables() -> dict[str, Any]:
    """The environment's facts of the mission, by the fields of `Mission`. Raises InvalidInputError."""
    known: dict[str, Any] = {}
    for name, count in (("drop_zone", 2), ("time_limit", 1), ("start", 3), ("loading_zone", 2)):
        variable = f"SIMMER_{name.upper()}"
        text = os.environ.get(variable, "").strip()
        if text:
            rows = tuple(_numbers_of(variable, row, count) for row in text.split(";"))
            known[name] = rows if name == "loading_zone" else rows[0] if count > 1 else rows[0][0]
    if gripper := os.environ.get("SIMMER_GRIPPER", "").strip():
        known["gripper"] = _checked_code(gripper)
    return known


def _numbers_of(variable: str, text: str, count: int) -> tuple[float, ...]:
    """So many numbers with commas between. Raises InvalidInputError."""
    try:
        numbers = tuple(map(float, text.split(",")))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        shape = ("a number, such as 300", "x,y, such as 30,18", "x,y,heading, such as 9.5,42,0")[count - 1]
        raise InvalidInputError(f"the environment variable {variable} is {text!r}: it must be {shape}")
    return numbers


def _finite(name: str, value: Number) -> float:
    """The number as a finite float. Raises InvalidInputError."""
    try:
        # float() takes text and booleans; in a program they are mistakes.
        if isinstance(value, (str, bytes, bytearray, bool)):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InvalidInputError(f"{name} is {value!r}: it must be a finite number")
    return number


def _decimal(value: Number) -> str:
    """A number as decimal text that reads back as exactly the same number."""
    number = _finite("the drive's value", value)
    # Up to 2**53 every whole number is exact as a float; repr gives the shortest text that reads back.
    return str(int(number)) if number.is_integer() and abs(number) < 2**53 else repr(number)


def _checked_code(code: str) -> str:
    if not isinstance(code, str) or len(code) != 2 or not _printable(code):
        raise InvalidInputError(
            f"{code!r} is no command code: a code is exactly two printable ASCII characters"
        )
    return code


def _checked_command(command: str, forbidden: str) -> str:
    if not isinstance(command, str) or not _printable(command) or len(command) > _LONGEST_COMMAND:
        raise InvalidInputError(
            f"{command!r} is no command: it must be printable ASCII, at most {_LONGEST_COMMAND} characters"
        )
    for character in forbidden:
        if character in command:
            raise InvalidInputError(f"{command!r} is no single command: it must not contain {character!r}")
    return command


def _printable(text: str) -> bool:
    return text.isascii() and text.isprintable()


def _rows(particles: Iterable[Iterable[float]]) -> list[list[float]]:
    """Particles as plain lists; numpy arrays have `tolist`."""
    # numpy is not imported for this: particles may be plain lists.
    to_list = getattr(particles, "tolist", None)
    try:
        rows = [[float(number) for number in row] for row in (to_list() if to_list else particles)]
    except (TypeError, ValueError, OverflowError):
        rows = [[]]
    if not all(len(row) in (2, 3) and all(map(math.isfinite, row)) for row in rows):
        raise InvalidInputError(
            "particles must be rows of two or three finite numbers: (x, y) or (x, y, heading)"
        )
    return rows


def _packed_grid(grid: Any, bounds: Iterable[Number] | None, first: Number | None) -> dict[str, object]:
    """A grid in the format of the belief port: single precision in base64, a quarter of the bytes of a
    list."""
    shape = getattr(grid, "shape", None)
    # numpy is not imported for this: a grid may be nested lists.
    sizes, data = _of_lists(grid) if shape is None else _of_array(grid, tuple(shape))
    rows, cols, headings = sizes
    packed: dict[str, object] = {"rows": rows, "cols": cols}
    if headings > 1:
        packed["headings"] = headings
    if first is not None:
        packed["first"] = _finite("first", first)
    if bounds is not None:
        edges = [_finite("each of bounds", each) for each in bounds] if hasattr(bounds, "__iter__") else []
        if len(edges) != 4 or not (edges[0] < edges[2] and edges[1] < edges[3]):
            raise InvalidInputError(f"bounds is {bounds}: it must be x0, y0, x1, y1 with x0 < x1 and y0 < y1")
        packed["bounds"] = edges
    packed["f32"] = base64.b64encode(data).decode("ascii")
    return packed


def _of_array(grid: Any, shape: tuple[int, ...]) -> tuple[tuple[int, int, int], bytes]:
    """Sizes and bytes of a numpy array."""
    sizes = _grid_sizes(shape)
    try:
        most = _largest(float(grid.min()), float(grid.max()))
        return sizes, (grid / most).astype("<f4").tobytes()
    except (TypeError, AttributeError):
        raise InvalidInputError("grid must be an array of numbers, or nested lists of them") from None


def _of_lists(grid: Any) -> tuple[tuple[int, int, int], bytes]:
    """Sizes and bytes of nested lists."""
    try:
        rows = [list(row) for row in grid]
        cells: list[Any] = [cell for row in rows for cell in row]
        is_deep = bool(cells) and hasattr(cells[0], "__len__")
        lists = [list(cell) for cell in cells] if is_deep else []
        flat = [number for cell in lists for number in cell] if is_deep else cells
        numbers = [float(number) for number in flat]
    except (TypeError, ValueError, OverflowError):
        raise InvalidInputError("grid must be rows of numbers, or rows of lists of numbers") from None
    shape: tuple[int, ...] = (len(rows), _alike("row", rows))
    if is_deep:
        shape = (*shape, _alike("cell", lists))
    sizes = _grid_sizes(shape)
    if any(map(math.isnan, numbers)):  # min and max would not notice NaN
        raise InvalidInputError("grid holds a number that is not finite")
    most = _largest(min(numbers), max(numbers))
    return sizes, struct.pack(f"<{len(numbers)}f", *[number / most for number in numbers])


def _alike(what: str, lists: list[list[Any]]) -> int:
    """The length that all of some lists have."""
    for number, one in enumerate(lists, 1):
        if len(one) != len(lists[0]):
            raise InvalidInputError(f"{what} {number} of grid has {len(one)} numbers, not {len(lists[0])}")
    return len(lists[0]) if lists else 0


def _largest(least: float, most: float) -> float:
    """The largest probability. Divided by it, all fit into single precision."""
    if not (math.isfinite(least) and math.isfinite(most)):
        raise InvalidInputError("grid holds a number that is not finite")
    if least < 0 or most <= 0:
        raise InvalidInputError("probabilities must be 0 or more, and one of them more than 0")
    return most


def _grid_sizes(shape: tuple[int, ...]) -> tuple[int, int, int]:
    if len(shape) not in (2, 3):
        raise InvalidInputError("grid must have rows and columns, and may have headings")
    rows, cols, headings = shape if len(shape) == 3 else (*shape, 1)
    limits = (
        ("rows", rows, _MOST_ROWS),
        ("columns", cols, _MOST_ROWS),
        ("headings", headings, _MOST_HEADINGS),
    )
    for name, size, most in limits:
        if not 1 <= size <= most:
            raise InvalidInputError(f"grid has {size} {name}: it may have 1 to {most}")
    if rows * cols * headings > _MOST_STATES:
        raise InvalidInputError(f"grid has {rows * cols * headings} states: it may have {_MOST_STATES}")
    return int(rows), int(cols), int(headings)
