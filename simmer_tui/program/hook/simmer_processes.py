"""Processes of a program that take turns by the program's clock, like its threads (`simmer_turns.py`).

A process that is started waits until its parent waits. Pipes, locks and ends of processes are waits as sleeps
are. Programs that are not Python have no clock: a wait for them takes no simulated time.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package.
"""

from __future__ import annotations

import io
import os
import select
import sys
import time

TYPE_CHECKING = False  # the module typing would cost every start some milliseconds
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

# Functions that Windows lacks are looked up where `os.fork` has been found.
_POSIX: Any = os
"""The module `os`, as POSIX has it."""
_TOKEN = "SIMMER_CLOCK_TOKEN"
"""The variable with the token that a process gets from its parent."""
_PIPES = "SIMMER_CLOCK_PIPES"
"""The variable with the numbers of a process's standard streams that are pipes to its parent."""
_HOOKS = ("SIMMER_CLOCK_PORT", "SIMMER_DIALECT_PORT")
"""The variables without which a process has no hook."""
# A Python on an overloaded machine takes seconds.
_STARTING = 20.0
"""Longest real time for the start of a process, seconds."""
# The system writes as many bytes at once if it says that a pipe has room (PIPE_BUF, POSIX has 512 at least).
_AT_ONCE = 4096
"""Bytes of a write to a pipe."""
_PIPE_TYPES = (0o010000, 0o140000)
"""S_IFIFO and S_IFSOCK: kinds of files whose reads wait."""
# The largest that a user of Linux may ask for, unless configured.
_PIPE_SIZE = 1 << 20
"""Bytes that the parent can write before a process runs."""
_SET_PIPE_SIZE = 1031
"""F_SETPIPE_SZ of fcntl (Linux)."""


class Processes:
    """The processes that this one has started, as far as they have this clock."""

    def __init__(self, clock: Any) -> None:
        self._clock = clock
        self._count = 0
        self.token = os.environ.get(_TOKEN, "")
        """The token from its parent; empty for the first process."""
        self.pipes = os.environ.pop(_PIPES, "")
        self.living: set[int] = set()
        """Their process IDs, until their ends have been seen."""
        self.begin()

    def begin(self) -> None:
        """Begin without processes. Those that are started in any way know this one as their parent."""
        self.living = set()
        os.environ[_TOKEN] = f"{os.getpid()}.0"

    def new_token(self) -> str:
        """A token for a process that is about to be started."""
        self._count += 1
        return f"{os.getpid()}.{self._count}"

    def started(self, token: str, pid: int) -> bool:
        """Wait until a process has joined the clock. False if it has none."""
        clock, until, asked = self._clock, _REAL_TIME() + _STARTING, False
        clock.say(f"B {token}\n")
        while True:
            line = clock.line(0.02)
            if line == b"joined":
                self.living.add(pid)
                clock.turns.watch()
                return True
            if line == b"none":
                return False
            if not asked and (_has_ended(pid) or _REAL_TIME() > until):
                asked = True
                clock.say(f"N {token}\n")

    def see_end(self, pid: int) -> None:
        """Wait until the system shows the end of a process that has left the clock."""
        until = _REAL_TIME() + 1.0
        while not _has_ended(pid) and _REAL_TIME() < until:
            _REAL_PAUSE(0.0002)


_REAL_TIME, _REAL_PAUSE = time.monotonic, time.sleep
_REAL_READ, _REAL_WRITE = os.read, os.write
_REAL_WAITPID, _REAL_WAITID = getattr(os, "waitpid", None), getattr(os, "waitid", None)
"""The system's functions, before they are replaced."""


def _has_ended(pid: int) -> bool:
    """True if a process of ours has ended, whose end nobody has taken yet, or is no process of ours."""
    if _REAL_WAITID is None:  # Windows, and macOS before Python 3.13
        _REAL_PAUSE(0.002)
        return False
    try:
        return _REAL_WAITID(_POSIX.P_PID, pid, _POSIX.WEXITED | _POSIX.WNOHANG | _POSIX.WNOWAIT) is not None
    except ChildProcessError:
        return True


class PipeEnd(io.RawIOBase):
    """A pipe to another process of the program, whose reads and writes are waits."""

    def __init__(self, raw: Any) -> None:
        self._raw = raw
        self.name, self.mode = raw.name, raw.mode

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def readable(self) -> bool:
        return bool(self._raw.readable())

    def writable(self) -> bool:
        return bool(self._raw.writable())

    def isatty(self) -> bool:
        return False

    def readinto(self, buffer: Any) -> int:
        data = os.read(self.fileno(), len(buffer))
        buffer[: len(data)] = data
        return len(data)

    def write(self, data: Any) -> int:
        return os.write(self.fileno(), data)

    def close(self) -> None:
        if not self.closed:
            super().close()
            self._raw.close()


def as_pipe(stream: Any) -> Any:
    """The same stream, of a `PipeEnd`."""
    if stream is None:
        return None
    text = stream if isinstance(stream, io.TextIOWrapper) else None
    if text is not None:
        kind: Any = {
            "encoding": text.encoding,
            "errors": text.errors,
            "line_buffering": text.line_buffering,
            "write_through": getattr(text, "write_through", False),
        }
        stream = text.detach()
    buffered = not isinstance(stream, io.RawIOBase)
    raw = PipeEnd(stream.detach() if buffered else stream)
    made: Any = raw
    if buffered:
        made = io.BufferedReader(raw) if raw.readable() else io.BufferedWriter(raw)
    return made if text is None else io.TextIOWrapper(made, **kind)


def install(clock: Any) -> None:
    """Let the processes that this one starts take turns with it."""
    processes = clock.processes
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if str(number) in processes.pipes and getattr(sys, name) is not None:
            stream = as_pipe(getattr(sys, name))
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)
    if processes.token:
        clock.turns.watch()
    if hasattr(os, "fork"):
        _replace_forks(clock, processes)
        _replace_pipes(clock)
        os.waitpid = _waitpid(clock, processes)
        _POSIX.wait = lambda: os.waitpid(-1, 0)


def _replace_forks(clock: Any, processes: Processes) -> None:
    def forking(real: Callable[[], Any]) -> Callable[[], Any]:
        def fork() -> Any:
            token = processes.new_token()
            made = real()
            pid = made[0] if isinstance(made, tuple) else made
            if pid == 0:
                clock.begin_fork(token)
            else:
                processes.started(token, pid)
            return made

        return fork

    for name in ("fork", "forkpty"):
        if hasattr(os, name):
            setattr(os, name, forking(getattr(os, name)))


def _replace_pipes(clock: Any) -> None:
    """Reads and writes of pipes: the other end may be another thread's or process's."""

    def waits(descriptor: int) -> bool:
        if not clock.is_shared or clock.is_away or not clock.is_own_thread:
            return False
        try:
            return os.fstat(descriptor).st_mode & 0o170000 in _PIPE_TYPES and _POSIX.get_blocking(descriptor)
        except OSError:
            return False

    def read(descriptor: int, size: int) -> bytes:
        if waits(descriptor):
            select.select([descriptor], [], [])
        return _REAL_READ(descriptor, size)

    def write(descriptor: int, data: Any) -> int:
        if not waits(descriptor):
            return _REAL_WRITE(descriptor, data)
        left = memoryview(data).cast("B")
        size = len(left)
        while left:
            select.select([], [descriptor], [])
            left = left[_REAL_WRITE(descriptor, left[:_AT_ONCE]) :]
        return size

    os.read, os.write = read, write


def _waitpid(clock: Any, processes: Processes) -> Callable[[int, int], tuple[int, int]]:
    real: Any = _REAL_WAITPID

    def waitpid(pid: int, options: int) -> tuple[int, int]:
        known = pid in processes.living or (pid <= 0 and processes.living)
        if clock.is_away or not clock.is_own_thread or not known or options & _POSIX.WNOHANG:
            if options & _POSIX.WNOHANG or clock.is_away or not clock.is_own_thread:
                ended = real(pid, options)
            else:
                ended = clock.away(lambda: real(pid, options))
        else:
            ended, again = (0, 0), False
            while not ended[0]:
                ended = real(pid, options | _POSIX.WNOHANG)
                if not ended[0] and not clock.wait(float("inf"), again=again):
                    ended = clock.away(lambda: real(pid, options))
                again = True
        processes.living.discard(ended[0])
        return ended  # type: ignore[no-any-return]

    return waitpid


# -- subprocess --------------------------------------------------------------------------------------


def starts_python(words: Any, executable: Any, shell: bool) -> bool:
    """True if a command probably starts a Python, directly or by a shell."""
    if isinstance(words, (str, bytes)) or hasattr(words, "__fspath__"):
        words = [words]
    words = [os.fsdecode(each) for each in words]
    if shell:
        return any("python" in each or sys.executable in each for each in words)
    first = os.fsdecode(executable or words[0])
    if os.path.basename(first).startswith("python") or first == sys.executable:  # noqa: PTH119
        return not any(set(each[1:]) & set("EIS") for each in _flags(words[1:]))
    try:
        with open(first, "rb") as file:  # noqa: PTH123
            start = file.read(100)
    except OSError:
        return False
    return start.startswith(b"#!") and b"python" in start.splitlines()[0]


def _flags(words: list[str]) -> list[str]:
    """The options of Python itself that have no value."""
    found = []
    for each in words:
        if not each.startswith("-") or each.startswith("--") or each[1:2] in ("c", "m", "W", "X"):
            break
        found.append(each)
    return found


def patch_subprocess(clock: Any, module: Any) -> None:
    """Let the processes of the module subprocess take turns with ours."""
    processes, popen = clock.processes, module.Popen
    real_start, real_wait, real_communicate = popen._execute_child, popen.wait, popen.communicate

    def start(process: Any, words: Any, executable: Any, *rest: Any, **named: Any) -> Any:
        # preexec_fn, close_fds, pass_fds, cwd, env, startupinfo, creationflags, shell
        given, token = list(rest), processes.new_token()
        environment = dict(os.environ if given[4] is None else given[4])
        given[4] = environment
        has_hook = _HOOKS[0] in environment
        if has_hook:
            streams = (process.stdin, process.stdout, process.stderr)
            environment[_TOKEN] = token
            environment[_PIPES] = "".join(str(n) for n, each in enumerate(streams) if each is not None)
        result = real_start(process, words, executable, *given, **named)
        if (
            has_hook
            and starts_python(words, executable, bool(given[7]))
            and processes.started(token, process.pid)
        ):
            process.stdin = as_pipe(process.stdin)
            process.stdout, process.stderr = as_pipe(process.stdout), as_pipe(process.stderr)
        return result

    def is_foreign(process: Any) -> bool:
        return not (os.name == "posix" and process.pid in processes.living)

    def wait(process: Any, timeout: float | None = None) -> Any:
        if timeout == float("inf"):
            timeout = None  # of communicate
        if (
            process.returncode is not None
            or clock.is_away
            or not clock.is_own_thread
            or not is_foreign(process)
        ):
            return real_wait(process, timeout)
        return clock.away(lambda: real_wait(process, timeout))

    def communicate(process: Any, input: Any = None, timeout: float | None = None) -> Any:  # noqa: A002
        if clock.is_away or not clock.is_own_thread:
            return real_communicate(process, input, timeout)
        if is_foreign(process):
            return clock.away(lambda: real_communicate(process, input, timeout))
        # With a limit it waits by a selector, which is followed.
        return real_communicate(process, input, float("inf") if timeout is None else timeout)

    popen._execute_child, popen.wait, popen.communicate = start, wait, communicate


# -- multiprocessing ---------------------------------------------------------------------------------


def _patch_util(clock: Any, module: Any) -> None:
    """Processes by spawn, and the helpers of multiprocessing, which have no clock."""
    real = getattr(module, "spawnv_passfds", None)
    if real is None:
        return
    processes = clock.processes

    def spawn(path: Any, words: Any, descriptors: Any) -> Any:
        changed: dict[str, str | None] = {}
        is_helper = any(b"resource_tracker" in os.fsencode(each) for each in words)
        token = processes.new_token()
        if is_helper:
            changed.update(dict.fromkeys(_HOOKS))
        else:
            changed[_TOKEN] = token
            _enlarge(descriptors)
        kept = {name: os.environ.get(name) for name in changed}
        _set(changed)
        try:
            pid = real(path, words, descriptors)
        finally:
            _set(kept)
        if not is_helper:
            processes.started(token, pid)
        return pid

    module.spawnv_passfds = spawn


def _set(variables: dict[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def _enlarge(descriptors: Any) -> None:
    """Make pipes take all that is written to them before anybody reads."""
    import fcntl

    change: Any = vars(fcntl)["fcntl"]
    for each in descriptors:
        try:
            change(each, _SET_PIPE_SIZE, _PIPE_SIZE)
        except (OSError, ValueError):  # noqa: PERF203
            continue  # no pipe, or not Linux


def _patch_context(clock: Any, module: Any) -> None:
    """A server that forks processes would have no turns. They are spawned instead, just as fresh."""
    if hasattr(module, "ForkServerProcess"):
        module.ForkServerProcess._Popen = staticmethod(module.SpawnProcess._Popen)


def _patch_synchronize(clock: Any, module: Any) -> None:
    """Locks between processes."""
    kind = module.SemLock
    real_make = kind._make_methods

    def make(lock: Any) -> None:
        real_make(lock)
        native = lock._semlock.acquire

        def acquire(block: bool = True, timeout: float | None = None) -> bool:
            if native(False):
                return True
            return block and clock.await_state(lambda: native(False), timeout)

        lock.acquire = acquire

    kind._make_methods = make
    kind.__enter__ = lambda lock: lock.acquire()


def _patch_queue(clock: Any, module: Any) -> None:
    """Queues whose waits are those of locks: the one in C waits by itself."""
    module.SimpleQueue, module.time = module._PySimpleQueue, time.monotonic


PROCESS_PATCHES = {
    "queue": _patch_queue,
    "subprocess": patch_subprocess,
    "multiprocessing.util": _patch_util,
    "multiprocessing.context": _patch_context,
    "multiprocessing.synchronize": _patch_synchronize,
}
"""Changes of modules after their import, by their names."""
