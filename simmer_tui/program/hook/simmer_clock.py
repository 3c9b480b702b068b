"""The program's clock, inside the program: its sleeps, its waits for replies and its reads of a clock.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package. `links/clock_link.py` is the other end and describes the lines.
"""

from __future__ import annotations

import builtins
import errno
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
CLOCK_READ = 5_000
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
_REAL_TIME, _REAL_PAUSE, _REAL_SELECT = time.monotonic, time.sleep, select.select
"""The system's functions, before they are replaced."""
_PORT = "SIMMER_CLOCK_PORT"
"""The variable with the port of the clock."""
_OVER = "Nothing more will happen in this run"
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
    "multiprocessing.managers": dict.fromkeys(
        ("BaseManager.start", "BaseManager.connect", "BaseManager.get_server"),
        "Queue, Pipe, Value and Lock of multiprocessing are followed",
    ),
    "multiprocessing.popen_spawn_win32": {"Popen": "Threads are followed"},
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
    """The connection to the simulator's clock. Only for the thread whose turn it is."""

    def __init__(self) -> None:
        # Only a program has this folder on its path.
        from simmer_processes import Processes  # type: ignore[import-not-found]
        from simmer_turns import Turns  # type: ignore[import-not-found]

        self._real_recv = socket.socket.recv
        self._real_send = socket.socket.sendall
        # Whole nanoseconds: sums of floats would depend on how often the simulator has woken us.
        self._now = 0
        self._debt = 0
        self.received: dict[int, int] = {}
        """Counts of bytes from the robot that were received, by our ports."""
        self._written: dict[int, int] = {}
        """Counts of those that it has sent."""
        self.acted = True
        """True if since the last wait this process has done something that another may wait for."""
        self.is_away = False
        """True during a wait for another process, which goes by the real clock."""
        self.away_since = 0.0
        """When that began, real seconds."""
        self.is_moving = False
        """True while the simulator is asked."""
        self.count = 0
        """The count of questions to the simulator."""
        self.loop_selector: Any = None
        """Makes a selector for a loop of asyncio."""
        self.turns: Any = Turns(self)
        self.processes: Any = Processes(self)
        self._connect(self.processes.token)

    def _connect(self, token: str) -> None:
        host = os.environ.get("SIMMER_HOST", "127.0.0.1")
        self._sock = _connection(host, int(os.environ[_PORT]))
        self._sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sock.settimeout(None)
        self._buffer = b""
        self.sent = 0
        """The count of bytes to the robot."""
        self._told = 0
        """The bytes to the robot that the simulator has answered, as far as it does at once."""
        self.say(f"{_token_line()}H {os.getpid()} {token}\n")
        self._ask("S", self.here)

    def begin_fork(self, token: str) -> None:
        """Begin as a process of its own, after a fork."""
        self._sock.close()
        self.processes.begin()
        self.processes.token = token
        self.turns.reset()
        self.acted, self.is_away, self.is_moving = True, False, False
        try:
            self._connect(token)
        except OSError:
            _gone()
        self.turns.watch()

    @property
    def here(self) -> int:
        """Our time, nanoseconds."""
        return self._now + self._debt

    @property
    def is_shared(self) -> bool:
        """True if there are several threads or processes."""
        return bool(len(self.turns.threads) > 1 or self.processes.living or self.processes.token)

    @property
    def is_own_thread(self) -> bool:
        """True in the thread whose turn it is."""
        return bool(threading.get_ident() == self.turns.running.ident)

    def check_thread(self, what: str) -> None:
        """Refuse a thread that a library has started by itself."""
        if threading.get_ident() != self.turns.running.ident:
            refuse(f"a thread that is not one of Python's {what}", "Threads of threading are followed")

    def look(self) -> int:
        """The time, nanoseconds. Each call adds a little time, so that a loop of calls comes to its end."""
        self.check_thread("looks at the clock")
        if self.is_away:
            return self.here + round((_REAL_TIME() - self.away_since) * 1e9)
        self._debt += CLOCK_READ
        return self._now + self._debt

    def pass_time(self, seconds: float) -> None:
        """Add to our time. The simulator learns of it when we send something or wait."""
        self.check_thread("talks to the robot")
        if self.is_shared:
            self.sleep(max(seconds, 0.0))
        else:
            self._debt += math.ceil(max(seconds, 0.0) * 1e9)

    def answered(self) -> None:
        """Make the simulator answer everything that was sent: the arrived replies then do not depend on real
        time."""
        if self._told != self.sent:
            self.check_thread("talks to the robot")
            self._ask("S", self.here)

    def settle(self) -> None:
        """Bring the simulator's time up to ours, so that bytes are sent at our time."""
        if self._debt:
            self._ask("S", self.here)

    def sleep(self, seconds: float) -> None:
        """Sleep for some seconds."""
        until = self.here + round(seconds * 1e9)
        if not self.is_shared:
            self._ask("S", until)
        else:
            # A loop that gives way must not hold time for ever.
            self.turns.wait(max(until, self.here + CLOCK_READ), listens=False)

    def end_of(self, timeout: float | None) -> float:
        """The end of a wait that begins now, nanoseconds: a whole number, or infinity."""
        return (
            math.inf if timeout is None or timeout == math.inf else self.here + max(round(timeout * 1e9), 0)
        )

    def is_over(self, until: float) -> bool:
        """True if a wait until that time is over."""
        return self._now + self._debt >= until

    def wait(self, until: float, *, again: bool = False, outside: bool = False) -> bool:
        """Wait for a reply, or for another process, until a time, nanoseconds; we may be woken earlier, to
        check for it. False if nothing will ever come.

        We wait `again` if we have only checked. `outside` is true for what comes from outside of the
        simulation.
        """
        if self.is_shared:
            return bool(self.turns.wait(until, listens=True, again=again, outside=outside))
        return self.move(until, listens=True, outside=outside)

    def move(self, until: float, *, listens: bool, outside: bool = False) -> bool:
        """Make the simulator move time until then, or until it wakes us. False if nothing will happen."""
        if self._debt:
            return self._ask("S", self.here)
        return self._ask("W" if listens else "S", until, outside=outside)

    def await_state(self, is_there: Callable[[], bool], timeout: float | None) -> bool:
        """Wait for what another process does. False if it has not happened by the end of the time."""
        until, again = self.end_of(timeout), False
        while not is_there():
            if self.is_over(until):
                return False
            self.check_thread("waits")
            if not self.wait(until, again=again):
                self.refuse_lock()
            again = True
        return True

    def away(self, call: Callable[[], Any]) -> Any:
        """Call a function that waits for a process that may have no clock."""
        self.say("F\n")
        self.is_away, self.away_since = True, _REAL_TIME()
        try:
            return call()
        finally:
            self.is_away = False
            self.say("G\n")
            self._hear()

    def report(self, text: str) -> None:
        """Report to the simulator what this clock cannot follow."""
        line = "X {}\n".format(text.replace("\n", " "))
        if self.is_own_thread:
            self.say(line)
            return
        # Another thread may be in the middle of a line.
        try:
            other = _connection(*self._sock.getpeername()[:2])
            self._real_send(other, (_token_line() + line).encode())
            other.close()
        except OSError:
            pass  # the simulator has ended

    def refuse_lock(self) -> NoReturn:
        """End the program: its threads and processes wait for one another."""
        tell(
            f"{place()}: the program waits for a thread or process of its own, and all of them wait. {_OVER}"
        )
        _end(2)

    named_after = NAMED_AFTER

    def name_computing(self, frame: Any) -> None:
        """Tell the person which line keeps all other threads and processes from their turns."""
        tell(
            f"{place(frame)}: here the program has run for {NAMED_AFTER:g} s of real time without a wait. "
            "Its threads and processes take turns by the program's clock: call time.sleep in the loop, or "
            "use --clock real"
        )

    def name_away(self, frame: Any) -> None:
        """Tell the person which line waits for a process that may have no clock."""
        said_once(OUTSIDE, frame)

    def begin_wait(self, until: float) -> bool:
        """Begin a wait for a reply with one question: the simulator answers what was sent, and brings its
        time up to ours; if no reply has come by then, it lets us wait until a time, nanoseconds. Only for a
        single thread and process. False if nothing will ever come."""
        if not self._debt and self._told == self.sent:
            return True  # nothing has happened that a look would not know
        return self._ask("W", until, begin=self.here)

    def _ask(self, kind: str, until: float, *, outside: bool = False, begin: int | None = None) -> bool:
        self._debt, self._told = 0, self.sent
        again = "" if self.acted else " again"
        self.acted = not self.is_shared
        self.count += 1
        self.is_moving = True
        after = "" if begin is None else f" after {begin}"
        self.say(f"{kind} {until} {self.sent}{again}{' outside' if outside else ''}{after}\n")
        try:
            return self._hear()
        finally:
            self.is_moving = False

    def say(self, text: str) -> None:
        """Send lines to the simulator."""
        try:
            self._real_send(self._sock, text.encode())
        except OSError:
            _gone()

    def _hear(self) -> bool:
        """Wait for the simulator's answer. False if nothing will ever come."""
        now, *written = self.line(None).split()
        if now == b"never":
            return False
        self._now = int(now)
        for each in written:
            port, _, count = each.partition(b"=")
            self._written[int(port)] = int(count)
        return True

    def line(self, timeout: float | None) -> bytes:
        """The next line of the simulator; empty if none comes within `timeout` seconds of real time."""
        while True:
            while b"\n" not in self._buffer:
                if timeout is not None and not _REAL_SELECT([self._sock], [], [], timeout)[0]:
                    return b""
                try:
                    piece = self._real_recv(self._sock, 4096)
                except OSError:
                    piece = b""
                if not piece:
                    _gone()
                self._buffer += piece
            line, _, self._buffer = self._buffer.partition(b"\n")
            if not line.startswith(b"left "):
                return line
            pid = int(line[5:])
            self.processes.see_end(pid)
            self.say(f"Z {pid}\n")

    def missing(self, ports: list[int]) -> float:
        """Real seconds within which the robot's sent bytes will arrive at some ports; 0 if all have."""
        here = any(self._written.get(port, 0) > self.received.get(port, 0) for port in ports)
        return _IN_FLIGHT if here else 0.0

    def give_up_missing(self, port: int, here: int = 0) -> None:
        """Stop waiting for bytes that have not come by now: nobody reads their connection."""
        self.received[port] = self._written.get(port, 0) - here

    def has_all(self, port: int, here: int) -> bool:
        """True if `here` bytes are all that the robot has sent to a port and nobody has received."""
        return self._written.get(port, 0) <= self.received.get(port, 0) + here

    def count_received(self, port: int, count: int) -> None:
        """Count bytes from the robot that were received at a port."""
        self.received[port] = self.received.get(port, 0) + count


def _connection(host: str, port: int) -> socket.socket:
    """A connection to a port of the simulator."""
    # For a name as text Python loads its codec of international names: 4 of the 25 ms of a program's start.
    name: Any = host.encode() if host.isascii() else host
    return socket.create_connection((name, port), 10.0)


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


OUTSIDE = "this waits for something outside of the simulation: no simulated time passes"
"""Words for a wait that only another program can end."""


def said_once(text: str, frame: Any = None) -> None:
    """Tell the person once what the program's clock does with the program's call, or that of a `frame`."""
    if text not in _SAID:
        _SAID.add(text)
        tell(f"{place(frame)}: by the program's clock {text}")


def place(frame: Any = None) -> str:
    """File and line of the innermost call that is in neither our code nor a library, pyserial among them.

    It is that of the calling thread, or of the innermost `frame` of another.
    """
    frame = frame or sys._getframe(1)
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
    tell(f"{place()}: the program waits for a reply that never comes{wrote}. {_OVER}")
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
    for name in ("system", "waitid"):
        _wait_away(clock, os, name)
    # Only a program has this folder on its path.
    import simmer_processes
    import simmer_turns
    from simmer_imports import patch_when_imported  # type: ignore[import-not-found]

    simmer_turns.install(clock.turns)
    simmer_processes.install(clock)
    patches = dict.fromkeys(_PATCHED, _patch)
    for name, patch in simmer_processes.PROCESS_PATCHES.items():
        patches[name] = functools.partial(patch, clock)
    patch_when_imported(patches)
    for name, patch in patches.items():
        if name in sys.modules:
            patch(sys.modules[name])


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


def _port_of(sock: Any) -> int:
    """Our port of a socket, or of a socket's descriptor, that is connected to the simulator."""
    if not isinstance(sock, int):
        return int(sock.getsockname()[1])
    borrowed = socket.socket(fileno=sock)
    try:
        return int(borrowed.getsockname()[1])
    finally:
        borrowed.detach()


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

    def look(readers: Any, writers: Any, others: Any, robot: list[int]) -> Ready:
        """Descriptors that are ready now, after waiting for bytes from the robot that are on their way to the
        ports `robot`."""
        clock.answered()
        on_its_way = clock.missing(robot)
        if not on_its_way and any(not _is_connected(each) for each in writers):
            on_its_way = _IN_FLIGHT
        found: Ready = real_select(readers, writers, others, on_its_way)
        if on_its_way and not any(found):
            for port in robot:
                clock.give_up_missing(port)
        return found

    def await_any(
        readers: Any, writers: Any, others: Any, timeout: float | None, *, polls: bool = True, inner: Any = ()
    ) -> Ready:
        """Descriptors that are ready within a time by the program's clock. Nothing outside the program writes
        to the `inner` ones. A look without a wait costs time if the caller `polls`."""
        until, again = clock.end_of(timeout), False
        robot = [_port_of(each) for each in readers if _is_ours(each, ports)]
        outside = bool(writers) or len(robot) + len(inner) < len(readers)
        if robot and not outside and timeout != 0 and not clock.is_shared and not clock.missing(robot):
            clock.check_thread("waits")
            if not clock.begin_wait(until):
                refuse_waiting()
        while True:
            found = look(readers, writers, others, robot)
            if any(found):
                if again or timeout == 0 or not clock.is_shared:
                    return found
                # A loop that others end by taking what is ready must give way.
                clock.sleep(0.0)
                found = real_select(readers, writers, others, 0)
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
            if not clock.wait(until, again=again, outside=outside):
                if not outside:
                    refuse_waiting()
                return await_outside(readers, writers, others)
            again = True

    def await_outside(readers: Any, writers: Any, others: Any) -> Ready:
        """Descriptors that are ready: only what is outside of the simulation can still write to them."""
        found: Ready = real_select(readers, writers, others, NAMED_AFTER)
        if any(found):
            return found
        said_once(OUTSIDE)
        return real_select(readers, writers, others, None)

    def await_data(sock: Any) -> None:
        """Wait as a socket with this time limit does. Another thread may change the limit meanwhile."""
        timeout = sock.gettimeout()
        if not any(await_any([sock], [], [], timeout)):
            if timeout == 0:
                raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
            raise socket.timeout("timed out")

    real_recv = kind.recv

    def gather(sock: Any) -> None:
        """Wait until everything that the robot has sent is here: a read then gets as many bytes in every
        run."""
        until, port = _REAL_TIME() + _IN_FLIGHT, _port_of(sock)
        while not clock.has_all(port, here := len(real_recv(sock, _GATHERED, socket.MSG_PEEK))):
            if here == _GATHERED:
                return
            if _REAL_TIME() > until:
                clock.give_up_missing(port, here)
                return
            _REAL_PAUSE(0.0001)

    def receiving(name: str) -> Callable[..., Any]:
        real = getattr(kind, name)

        @functools.wraps(real)
        def receive(sock: Any, *arguments: Any, **named: Any) -> Any:
            if not _is_ours(sock, ports):
                return real(sock, *arguments, **named)
            await_data(sock)
            port = _port_of(sock)
            if clock.missing([port]) and any(look([sock], [], [], [port])):
                gather(sock)
            result = real(sock, *arguments, **named)
            piece = result[0] if isinstance(result, tuple) else result
            # A peek, which leaves the bytes in place, is not counted.
            if not any(each & socket.MSG_PEEK for each in arguments[1:] if isinstance(each, int)):
                clock.count_received(port, piece if isinstance(piece, int) else len(piece))
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
        if clock.is_away or not clock.is_own_thread:
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


def _wait_away(clock: ProgramTime, owner: Any, name: str) -> None:
    """Make a function that waits for another process take no simulated time."""
    real = getattr(owner, name, None)
    if real is None:
        return

    @functools.wraps(real)
    def wait(*arguments: Any, **named: Any) -> Any:
        if clock.is_away or not clock.is_own_thread:
            return real(*arguments, **named)
        return clock.away(functools.partial(real, *arguments, **named))

    setattr(owner, name, wait)


def _patch(module: Any) -> None:
    """Change a toolkit that the program has imported."""
    # Only a program has this folder on its path. Imported by programs with a toolkit alone.
    from simmer_toolkits import patch  # type: ignore[import-not-found]

    patch(module)
