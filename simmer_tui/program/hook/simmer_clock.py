"""The program's clock, inside the program: its sleeps, its waits for replies and its reads of a clock.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package. `links/clock_link.py` is the other end and describes the lines.
"""

from __future__ import annotations

import builtins
import contextlib
import functools
import math
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, NoReturn

# A loop that waits by reading the clock must end soon: 400,000 reads are two seconds.
_LOOK = 5_000
"""Nanoseconds that a read of a clock takes."""
# The polling rate of a loop on a slow microcontroller.
EMPTY_POLL = 2e-4
"""Seconds that a poll takes if there is no reply."""
# A person reads a question and types an answer.
INPUT = 5.0
"""Seconds that `input()` takes."""
# 1 January 2026, UTC: any fixed date will do.
EPOCH = 1767225600 * 10**9
"""Nanoseconds of `time.time_ns()` at the beginning of the run."""
# The limit of `robot/program_clock.py`. On several processors bytes of one connection may arrive after later
# bytes of another.
_IN_FLIGHT = 0.2
"""Longest real time for bytes to arrive, seconds."""
# The system's buffer of an unread connection is larger, and no program asks for more at once.
_GATHERED = 65536
"""Bytes on a connection that a read waits for at most."""
_REAL_TIME, _REAL_PAUSE = time.monotonic, time.sleep
"""The system's functions, before they are replaced."""
_PORT = "SIMMER_CLOCK_PORT"
"""The variable with the port of the clock."""
_HINT = "The program's clock cannot follow that: use --clock real"
_REFUSED: dict[str, tuple[str, ...]] = {
    "asyncio.base_events": ("BaseEventLoop.run_forever", "BaseEventLoop.run_until_complete"),
    "tkinter": ("Misc.mainloop", "Misc.after", "mainloop"),
    "pygame.time": ("wait", "delay", "set_timer", "Clock"),
    "matplotlib.pyplot": ("pause",),
    "PyQt5.QtCore": ("QTimer",),
    "PyQt6.QtCore": ("QTimer",),
    "PySide2.QtCore": ("QTimer",),
    "PySide6.QtCore": ("QTimer",),
}
"""Functions that wait by a clock of their own, by module. docs/driving.md lists them."""


class ProgramTime:
    """The connection to the simulator's clock. Only for the main thread."""

    def __init__(self) -> None:
        self._real_recv = socket.socket.recv
        self._real_send = socket.socket.sendall
        host = os.environ.get("SIMMER_HOST", "127.0.0.1")
        self._sock = socket.create_connection((host, int(os.environ[_PORT])), 10.0)
        self._sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sock.settimeout(None)
        self._buffer = b""
        # Whole nanoseconds: sums of floats would depend on how often the simulator has woken us.
        self._now = 0
        self._debt = 0
        self._pid = os.getpid()
        self._thread = threading.get_ident()
        self.sent = self.received = 0
        """Counts of bytes to the robot, and from it."""
        self._told = 0
        """The bytes to the robot that the simulator has answered, as far as it does at once."""
        self._written = 0
        self._say(_token_line() + "H\n")
        self.sleep(0.0)

    def check_thread(self, what: str) -> None:
        """Refuse a second thread."""
        if threading.get_ident() != self._thread:
            refuse(f"a second thread {what}")
        if os.getpid() != self._pid:  # after a fork: two processes would share one connection
            self.__init__()  # type: ignore[misc]

    def look(self) -> int:
        """The time, nanoseconds. Each call adds a little time, so that a loop of calls comes to its end."""
        self.check_thread("looks at the clock")
        self._debt += _LOOK
        return self._now + self._debt

    def pass_time(self, seconds: float) -> None:
        """Add to our time. The simulator learns of it when we send something or wait."""
        self.check_thread("talks to the robot")
        self._debt += math.ceil(max(seconds, 0.0) * 1e9)

    def answered(self) -> None:
        """Have the simulator answer everything that was sent: the arrived replies then do not depend on real
        time."""
        if self._told != self.sent:
            self.check_thread("talks to the robot")
            self.sleep(0.0)

    def settle(self) -> None:
        """Have the simulator's time catch up with ours, so that bytes are sent at our time."""
        if self._debt:
            self.sleep(0.0)

    def sleep(self, seconds: float) -> None:
        """Sleep for some seconds."""
        self._ask("S", str(self._now + self._debt + round(seconds * 1e9)))

    def end_of(self, timeout: float | None) -> float:
        """The end of a wait that begins now, nanoseconds: a whole number, or infinity."""
        return math.inf if timeout is None else self._now + self._debt + max(round(timeout * 1e9), 0)

    def is_over(self, until: float) -> bool:
        """True if a wait until that time is over."""
        return self._now + self._debt >= until

    def wait(self, until: float) -> None:
        """Wait for a reply until a time, nanoseconds; the simulator may wake us earlier, to check for one."""
        if self._debt:
            self.sleep(0.0)
        else:
            self._ask("W", str(until))

    def away(self, call: Callable[[], Any]) -> Any:
        """Call a function that waits for another process."""
        self._say("F\n")
        try:
            return call()
        finally:
            self._say("G\n")
            self._hear()

    def tell(self, text: str, *, follows: bool) -> None:
        """Have the simulator report why the program ends; False if it does what this clock cannot follow."""
        line = "{} {}\n".format("E" if follows else "X", text.replace("\n", " "))
        if threading.get_ident() == self._thread:
            self._say(line)
            return
        # The main thread may be in the middle of a line.
        with contextlib.suppress(OSError):
            other = socket.create_connection(self._sock.getpeername()[:2], 10.0)
            self._real_send(other, (_token_line() + line).encode())
            other.close()

    def _ask(self, kind: str, until: str) -> None:
        self._debt, self._told = 0, self.sent
        self._say(f"{kind} {until} {self.sent}\n")
        self._hear()

    def _say(self, text: str) -> None:
        try:
            self._real_send(self._sock, text.encode())
        except OSError:
            _gone()

    def _hear(self) -> None:
        while b"\n" not in self._buffer:
            try:
                piece = self._real_recv(self._sock, 4096)
            except OSError:
                piece = b""
            if not piece:
                _gone()
            self._buffer += piece
        line, _, self._buffer = self._buffer.partition(b"\n")
        if line == b"never":
            last = getattr(sys.modules.get("simmer_serial"), "last_written", str)()
            wrote = f"; it wrote {last!r} last" if last else ""
            refuse(
                f"the program waits for a reply that never comes{wrote}",
                "Nothing more will happen in this run",
            )
        now, _, written = line.partition(b" ")
        self._now, self._written = int(now), int(written)

    @property
    def timeout(self) -> float:
        """Real seconds within which the robot's sent bytes will arrive; 0 if all have."""
        return _IN_FLIGHT if self._written > self.received else 0.0

    def give_up_missing(self, here: int = 0) -> None:
        """Stop waiting for bytes that have not come by now: nobody reads their connection."""
        self.received = self._written - here

    def has_all(self, here: int) -> bool:
        """True if `here` bytes are all that the robot has sent and nobody has received."""
        return self._written <= self.received + here


def _token_line() -> str:
    """The first line of each connection to the simulator, if it has a token."""
    token = os.environ.get("SIMMER_TOKEN", "")
    return token + "\n" if token else ""


def _gone() -> NoReturn:
    """End this program: the simulator has ended."""
    sys.stderr.write("the simulator has ended\n")
    _end(1)


def _end(code: int) -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def place() -> str:
    """File and line of the innermost call that is in neither our code nor a library, pyserial among them."""
    frame: Any = sys._getframe(1)
    libraries = (os.path.dirname(os.__file__), os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120
    first: str | None = None
    while frame is not None:
        file = frame.f_code.co_filename
        where = f"{os.path.basename(file)}:{frame.f_lineno}"  # noqa: PTH119
        is_installed = any(os.sep + each + os.sep in file for each in ("site-packages", "dist-packages"))
        is_pyserial = str(frame.f_globals.get("__name__")).startswith("serial.")
        if not (is_installed or is_pyserial or file.startswith((*libraries, "<"))):
            return where
        first = first or where
        frame = frame.f_back
    return first or "?"


def refuse(what: str, hint: str = _HINT) -> NoReturn:
    """End the program: it does what this clock cannot follow."""
    text = f"{place()}: {what}. {hint}"
    sys.stderr.write(text + "\n")
    if PROGRAM_CLOCK:
        PROGRAM_CLOCK[0].tell(text, follows=hint != _HINT)
    _end(2)


PROGRAM_CLOCK: list[ProgramTime] = []
"""The clock of this process, once it is installed."""


def install() -> None:
    """Replace this process's clock by the simulator's."""
    try:
        clock = ProgramTime()
    except (OSError, ValueError) as error:
        sys.stderr.write(f"the program's clock cannot be reached: {error}\n")
        return
    PROGRAM_CLOCK.append(clock)
    _replace_clocks(clock)
    _replace_sockets(clock)
    _replace_waits(clock)
    # Only a program has this folder on its path.
    from simmer_imports import patch_when_imported  # type: ignore[import-not-found]

    patch_when_imported(dict.fromkeys(_REFUSED, _patch))
    for name in _REFUSED:
        if name in sys.modules:
            _patch(sys.modules[name])


def _replace_clocks(clock: ProgramTime) -> None:
    real_sleep = time.sleep

    def sleep(seconds: float) -> None:
        """Sleep by the program's clock."""
        if (not isinstance(seconds, (int, float)) and not hasattr(seconds, "__index__")) or seconds < 0:
            real_sleep(seconds)  # the original has the right error message
            return
        clock.check_thread("sleeps")
        clock.sleep(float(seconds))

    # Partial objects: pyserial keeps time.monotonic as an attribute of a class, where a function would become
    # a method.
    time.sleep = functools.partial(sleep)
    time.monotonic = time.perf_counter = functools.partial(lambda: clock.look() / 1e9)
    time.monotonic_ns = time.perf_counter_ns = functools.partial(clock.look)
    time.time = functools.partial(lambda: (EPOCH + clock.look()) / 1e9)
    time.time_ns = functools.partial(lambda: EPOCH + clock.look())
    real_input = builtins.input

    def ask(prompt: object = "", /) -> str:
        clock.sleep(INPUT)
        return real_input(prompt)

    builtins.input = ask


def _is_ours(sock: Any, ports: tuple[int, ...]) -> bool:
    """True if a socket, or a socket's descriptor, is connected to the simulator."""
    try:
        if not isinstance(sock, int):
            return sock.getpeername()[1] in ports
        borrowed = socket.socket(fileno=sock)
        try:
            return borrowed.getpeername()[1] in ports
        finally:
            borrowed.detach()
    except (OSError, IndexError, TypeError, AttributeError):
        return False


def _replace_sockets(clock: ProgramTime) -> None:
    # Those of all dialects (`DialectPort.variable`), as far as they are served.
    names = {name for name in os.environ if name.startswith("SIMMER_") and name.endswith("PORT")}
    ports = tuple(int(os.environ[name]) for name in names - {_PORT} if os.environ[name].isdigit())
    kind: Any = socket.socket
    real_select = select.select

    def look(readers: Any, writers: Any, others: Any) -> tuple[list[Any], list[Any], list[Any]]:
        """Descriptors that are ready now, after waiting for bytes from the robot that are on their way."""
        clock.answered()
        found: tuple[list[Any], list[Any], list[Any]] = real_select(readers, writers, others, clock.timeout)
        if clock.timeout and not any(found):
            clock.give_up_missing()
        return found

    def await_any(
        readers: Any, writers: Any, others: Any, timeout: float | None
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """Descriptors that are ready within a time by the program's clock."""
        until = clock.end_of(timeout)
        while True:
            found = look(readers, writers, others)
            if any(found):
                return found
            clock.check_thread("talks to the robot")
            if timeout == 0:
                clock.sleep(EMPTY_POLL)
                return real_select(readers, writers, others, 0)
            if clock.is_over(until):
                return found
            clock.wait(until)

    def await_data(sock: Any) -> None:
        """Wait as a blocking socket does."""
        timeout = sock.gettimeout()
        if not any(await_any([sock], [], [], timeout)) and timeout != 0:
            raise socket.timeout("timed out")

    real_recv = kind.recv

    def gather(sock: Any) -> None:
        """Wait until everything that the robot has sent is here: a read then gets as many bytes in every
        run."""
        until = _REAL_TIME() + _IN_FLIGHT
        while not clock.has_all(here := len(real_recv(sock, _GATHERED, socket.MSG_PEEK))):
            if here == _GATHERED:
                return
            if _REAL_TIME() > until:
                clock.give_up_missing(here)
                return
            _REAL_PAUSE(0.0001)

    def receiving(name: str) -> Callable[..., Any]:
        real = getattr(kind, name)

        @functools.wraps(real)
        def receive(sock: Any, *arguments: Any, **named: Any) -> Any:
            if not _is_ours(sock, ports):
                return real(sock, *arguments, **named)
            await_data(sock)
            if clock.timeout and any(look([sock], [], [])):
                gather(sock)
            result = real(sock, *arguments, **named)
            piece = result[0] if isinstance(result, tuple) else result
            # A peek, which leaves the bytes in place, is not counted.
            if not any(each & socket.MSG_PEEK for each in arguments[1:] if isinstance(each, int)):
                clock.received += piece if isinstance(piece, int) else len(piece)
            return result

        return receive

    def sending(name: str) -> Callable[..., Any]:
        real = getattr(kind, name)

        @functools.wraps(real)
        def send(sock: Any, *arguments: Any, **named: Any) -> Any:
            if _is_ours(sock, ports):
                clock.check_thread("talks to the robot")
                clock.settle()
                result = real(sock, *arguments, **named)
                clock.sent += len(arguments[0]) if result is None else result
                return result
            return real(sock, *arguments, **named)

        return send

    for name in ("recv", "recv_into", "recvfrom", "recvfrom_into"):
        setattr(kind, name, receiving(name))
    for name in ("send", "sendall"):
        setattr(kind, name, sending(name))

    def chosen(
        readers: Any, writers: Any, others: Any, timeout: float | None = None
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """Do as select.select, by the program's clock if one of the sockets is connected to the simulator."""
        readers = list(readers)
        if any(_is_ours(each, ports) for each in readers):
            return await_any(readers, writers, others, timeout)
        return real_select(readers, writers, others, timeout)

    select.select = chosen
    import selectors

    # Only this kind of selector uses select.select.
    module: Any = selectors
    module.SelectSelector._select = staticmethod(chosen)
    module.DefaultSelector = module.SelectSelector


def _replace_waits(clock: ProgramTime) -> None:
    """Waits for other processes take no time by themselves; waits for other threads are no sleep."""

    def foreign(owner: Any, name: str) -> None:
        real = getattr(owner, name, None)
        if real is None:
            return

        @functools.wraps(real)
        def wait(*arguments: Any, **named: Any) -> Any:
            if threading.get_ident() != clock._thread or waiting:
                return real(*arguments, **named)
            waiting.append(True)
            try:
                return clock.away(functools.partial(real, *arguments, **named))
            finally:
                waiting.clear()

        setattr(owner, name, wait)

    waiting: list[bool] = []
    for name in ("wait", "communicate"):
        foreign(subprocess.Popen, name)
    for name in ("waitpid", "wait", "system", "waitid"):
        foreign(os, name)
    real_wait = threading.Condition.wait

    @functools.wraps(real_wait)
    def wait(condition: Any, timeout: float | None = None) -> bool:
        # Nobody else can notify it, so it is a sleep.
        if timeout is not None and threading.active_count() == 1:
            clock.sleep(max(float(timeout), 0.0))
            return False
        return real_wait(condition, timeout)

    condition_type: Any = threading.Condition
    condition_type.wait = wait


def _patch(module: Any) -> None:
    """Replace the functions of a module that wait by a clock of their own: they are refused."""
    for dotted in _REFUSED[module.__name__]:
        owner: Any = module
        *path, name = dotted.split(".")
        for part in path:
            owner = getattr(owner, part, None)
        if getattr(owner, name, None) is not None:
            setattr(owner, name, _refusing("{} of {}".format(dotted, module.__name__.partition(".")[0])))


def _refusing(what: str) -> Callable[..., NoReturn]:
    def refused(*arguments: object, **named: object) -> NoReturn:
        refuse(f"{what} waits by a clock of its own")

    return refused
