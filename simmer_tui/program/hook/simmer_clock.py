"""The program's clock, inside the program: its sleeps, its waits for replies and its reads of a clock.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package. `links/clock_link.py` is the other end and describes the lines.
"""

from __future__ import annotations

import builtins
import functools
import math
import os
import select
import socket
import sys
import threading
import time

TYPE_CHECKING = False  # the module typing would cost every start some milliseconds
if TYPE_CHECKING:
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
_REAL = "Or use --clock real"
_IN_A_LOOP = "Call it yourself in a loop with time.sleep, which is followed"
REFUSED: dict[str, dict[str, str]] = {
    "tkinter": dict.fromkeys(
        ("Misc.mainloop", "Misc.after", "Misc.wait_window", "Misc.wait_variable", "mainloop"),
        "Call update() of the window in a loop with time.sleep, which are followed",
    ),
    "pygame.time": {"set_timer": "pygame.time.Clock().tick(50) in a loop is followed"},
    "matplotlib.backend_bases": {
        "TimerBase.start": "For FuncAnimation draw in a loop with plt.pause(0.1), which is followed"
    },
    "asyncio.base_events": dict.fromkeys(
        ("BaseEventLoop.subprocess_exec", "BaseEventLoop.subprocess_shell"),
        "The module subprocess is followed",
    ),
    "uvloop": dict.fromkeys(("new_event_loop", "run", "Loop"), "The loop of asyncio itself is followed"),
    **dict.fromkeys(
        ("PyQt5.QtCore", "PyQt6.QtCore", "PySide2.QtCore", "PySide6.QtCore"),
        dict.fromkeys(("QTimer", "QThread"), _IN_A_LOOP),
    ),
}
"""Functions that wait by a clock of their own, by module, and what can be done instead."""
_PATCHED = (
    *REFUSED,
    "matplotlib.pyplot",
    "pygame.event",
    "asyncio.selector_events",
    "asyncio.windows_events",
)
"""Modules that `simmer_toolkits.py` changes."""


# A person wonders why nothing happens, and a plan of a path is made by then.
NAMED_AFTER = 1.5
"""Real seconds after which a wait or a computation that nothing ends is named."""

if TYPE_CHECKING:
    Ready = tuple[list[Any], list[Any], list[Any]]


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
        self.loop_selector: Any = None
        """Makes a selector for a loop of asyncio."""
        self.is_away = False
        """True during a wait for another process, which goes by the real clock."""
        self._away_since = 0.0
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

    @property
    def is_own_thread(self) -> bool:
        """True in the thread that this clock follows."""
        return threading.get_ident() == self._thread

    def look(self) -> int:
        """The time, nanoseconds. Each call adds a little time, so that a loop of calls comes to its end."""
        self.check_thread("looks at the clock")
        if self.is_away:
            return self._now + self._debt + round((_REAL_TIME() - self._away_since) * 1e9)
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

    def wait(self, until: float) -> bool:
        """Wait for a reply until a time, nanoseconds; the simulator may wake us earlier, to check for one.
        False if nothing will ever come."""
        if self._debt:
            self.sleep(0.0)
            return True
        return self._ask("W", str(until))

    def away(self, call: Callable[[], Any]) -> Any:
        """Call a function that waits for another process."""
        self._say("F\n")
        self.is_away, self._away_since = True, _REAL_TIME()
        try:
            return call()
        finally:
            self.is_away = False
            self._say("G\n")
            self._hear()

    def report(self, text: str) -> None:
        """Report to the simulator what this clock cannot follow."""
        line = "X {}\n".format(text.replace("\n", " "))
        if threading.get_ident() == self._thread:
            self._say(line)
            return
        # The main thread may be in the middle of a line.
        try:
            other = socket.create_connection(self._sock.getpeername()[:2], 10.0)
            self._real_send(other, (_token_line() + line).encode())
            other.close()
        except OSError:
            pass  # the simulator has ended

    def _ask(self, kind: str, until: str) -> bool:
        self._debt, self._told = 0, self.sent
        self._say(f"{kind} {until} {self.sent}\n")
        return self._hear()

    def _say(self, text: str) -> None:
        try:
            self._real_send(self._sock, text.encode())
        except OSError:
            _gone()

    def _hear(self) -> bool:
        """Wait for the simulator's answer. False if nothing will ever come."""
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
            return False
        now, _, written = line.partition(b" ")
        self._now, self._written = int(now), int(written)
        return True

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
        _write(stream, "")
    os._exit(code)


def tell(text: str) -> None:
    """Write a line where the program's errors go."""
    _write(sys.stderr, text + "\n")


def _write(stream: Any, text: str) -> None:
    """Write to a stream, if there is one and it is open."""
    try:
        stream.write(text)
        stream.flush()
    except (OSError, ValueError, AttributeError):
        return


_SAID: set[str] = set()


def said_once(text: str) -> None:
    """Tell the person once what the program's clock does with the program's call."""
    if text not in _SAID:
        _SAID.add(text)
        tell(f"{place()}: by the program's clock {text}")


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


def refuse(what: str, advice: str = "") -> NoReturn:
    """End the program: it does what this clock cannot follow."""
    advice = f"{advice}. {_REAL}" if advice else "Use --clock real"
    text = f"{place()}: {what}, which the program's clock cannot follow. {advice}"
    tell(text)
    if PROGRAM_CLOCK:
        PROGRAM_CLOCK[0].report(text)
    _end(2)


def refuse_waiting() -> NoReturn:
    """End the program: it waits, and nothing will ever happen."""
    last = getattr(sys.modules.get("simmer_serial"), "last_written", str)()
    wrote = f"; it wrote {last!r} last" if last else ""
    end = "Nothing more will happen in this run"
    tell(f"{place()}: the program waits for a reply that never comes{wrote}. {end}")
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

    patch_when_imported({**dict.fromkeys(_PATCHED, _patch), "subprocess": _patch_subprocess})
    if "subprocess" in sys.modules:
        _patch_subprocess(sys.modules["subprocess"])
    for name in _PATCHED:
        if name in sys.modules:
            _patch(sys.modules[name])


def _replace_clocks(clock: ProgramTime) -> None:
    real_sleep = time.sleep

    def sleep(seconds: float) -> None:
        """Sleep by the program's clock."""
        if (not isinstance(seconds, (int, float)) and not hasattr(seconds, "__index__")) or seconds < 0:
            real_sleep(seconds)  # the original has the right error message
            return
        if clock.is_away:
            real_sleep(seconds)
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


def _is_connected(sock: Any) -> bool:
    """False for a socket, or a socket's descriptor, whose connection is still being made."""
    try:
        borrowed = socket.socket(fileno=sock if isinstance(sock, int) else sock.fileno())
    except (OSError, AttributeError, ValueError):
        return True  # no socket
    try:
        borrowed.getpeername()
    except OSError:
        return False
    finally:
        borrowed.detach()
    return True


def _replace_sockets(clock: ProgramTime) -> None:
    # Those of all dialects (`DialectPort.variable`), as far as they are served.
    names = {name for name in os.environ if name.startswith("SIMMER_") and name.endswith("PORT")}
    ports = tuple(int(os.environ[name]) for name in names - {_PORT} if os.environ[name].isdigit())
    kind: Any = socket.socket
    real_select = select.select

    def look(readers: Any, writers: Any, others: Any, *, robot: bool) -> Ready:
        """Descriptors that are ready now, after waiting for bytes from the robot that are on their way."""
        clock.answered()
        on_its_way = clock.timeout if robot else 0.0
        if not on_its_way and any(not _is_connected(each) for each in writers):
            on_its_way = _IN_FLIGHT
        found: Ready = real_select(readers, writers, others, on_its_way)
        if robot and clock.timeout and not any(found):
            clock.give_up_missing()
        return found

    def await_any(
        readers: Any, writers: Any, others: Any, timeout: float | None, *, polls: bool = True, inner: Any = ()
    ) -> Ready:
        """Descriptors that are ready within a time by the program's clock. Nothing outside the program writes
        to the `inner` ones. A look without a wait costs time if the caller `polls`."""
        until = clock.end_of(timeout)
        robot = any(_is_ours(each, ports) for each in readers)
        while True:
            found = look(readers, writers, others, robot=robot)
            if any(found):
                return found
            clock.check_thread("waits")
            if timeout == 0:
                if not (polls and robot):
                    return found
                clock.sleep(EMPTY_POLL)
                return real_select(readers, writers, others, 0)
            if clock.is_over(until):
                return found
            if not clock.wait(until):
                if not writers and all(each in inner or _is_ours(each, ports) for each in readers):
                    refuse_waiting()
                return await_outside(readers, writers, others)

    def await_outside(readers: Any, writers: Any, others: Any) -> Ready:
        """Descriptors that are ready: only what is outside of the simulation can still write to them."""
        found: Ready = real_select(readers, writers, others, NAMED_AFTER)
        if any(found):
            return found
        said_once("this waits for something outside of the simulation: no simulated time passes")
        return real_select(readers, writers, others, None)

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
            if clock.timeout and any(look([sock], [], [], robot=True)):
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

    def chosen(readers: Any, writers: Any, others: Any, timeout: float | None = None, **how: Any) -> Ready:
        """Do as select.select, by the program's clock."""
        if clock.is_away:
            return real_select(readers, writers, others, timeout)
        return await_any(list(readers), list(writers), others, timeout, **how)

    select.select = functools.wraps(real_select)(chosen)
    import selectors

    # Only this kind of selector uses select.select.
    module: Any = selectors
    simple = module.SelectSelector
    simple._select = staticmethod(chosen)
    for name in ("DefaultSelector", "PollSelector", "EpollSelector", "KqueueSelector", "DevpollSelector"):
        if hasattr(module, name):
            setattr(module, name, simple)
    for name in ("poll", "epoll", "kqueue", "devpoll"):
        if hasattr(select, name):
            setattr(select, name, functools.partial(_refuse_select, name))

    class LoopSelector(simple):  # type: ignore[misc, valid-type]
        """Waits for a loop of asyncio."""

        inner: Any = ()

        def _select(self, r: Any, w: Any, x: Any, timeout: float | None = None) -> Ready:
            return chosen(r, w, x, timeout, polls=False, inner=self.inner)

    clock.loop_selector = LoopSelector


def _refuse_select(name: str, *arguments: Any, **named: Any) -> NoReturn:
    refuse(f"select.{name} waits by a clock of its own", "select.select and selectors are followed")


def _replace_waits(clock: ProgramTime) -> None:
    """Waits for other processes take no time by themselves; waits for other threads are no sleep."""
    for name in ("waitpid", "wait", "system", "waitid"):
        _wait_away(clock, os, name)
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


def _wait_away(clock: ProgramTime, owner: Any, name: str) -> None:
    """Have a function that waits for another process take no simulated time."""
    real = getattr(owner, name, None)
    if real is None:
        return

    @functools.wraps(real)
    def wait(*arguments: Any, **named: Any) -> Any:
        if clock.is_away or not clock.is_own_thread:
            return real(*arguments, **named)
        return clock.away(functools.partial(real, *arguments, **named))

    setattr(owner, name, wait)


def _patch_subprocess(module: Any) -> None:
    for name in ("wait", "communicate"):
        _wait_away(PROGRAM_CLOCK[0], module.Popen, name)


def _patch(module: Any) -> None:
    """Change a toolkit that the program has imported."""
    # Only a program has this folder on its path. Imported by programs with a toolkit alone.
    from simmer_toolkits import patch  # type: ignore[import-not-found]

    patch(module)
