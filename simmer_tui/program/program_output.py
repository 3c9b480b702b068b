"""The output of a program: passed on as it comes, its last lines kept with their times.

The program does not notice: if our output is a terminal, so is its own, and its bytes come out unchanged.
Nothing here waits for the robot, nor the robot for this.
"""

from __future__ import annotations

import contextlib
import os
import select
import selectors
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator

from msgspec import Struct, field

from simmer_tui import platform_has
from simmer_tui.errors import ProgramError, is_disk_full, reason_of
from simmer_tui.program.crash_parts import without_escapes
from simmer_tui.program.stack_dump import StackDump
from simmer_tui.run.events import NOT_STARTED, OutputLine, ProgramEnded

if platform_has.POSIX:
    import fcntl
    import termios

LAST_LINES = 20
"""Lines of each stream that are kept in the log: enough for a traceback of ten calls."""
# Frameworks put about a hundred lines between a program's own code and the end of its traceback.
_SEARCHED = 1000
"""Last lines of each stream in which the error of a crash is looked for."""
# Wider than any terminal (judged); a thousand of them are a megabyte.
_LONGEST_LINE = 1000
"""Bytes kept of a line."""
_LONGEST_PART = 65536
"""Bytes of a line without an end after which it is passed on as a line."""
_AT_ONCE = 65536
"""Bytes read at once: a pipe of Linux holds as many."""


# An interpreter writes both within microseconds; a person does not notice that a prompt comes later.
_LINE_END = 0.01
"""Seconds to wait for the rest of a line before a part of it is passed on."""
_NOTHING = bytes(4)
"""The count of bytes of a pipe that is empty, as the system gives it."""
_STDOUT, _STDERR = 1, 2
"""Descriptors of the standard streams (POSIX)."""
# A reader of our output may stop for a moment: at load 17 on two processors once for 0.2 s in 400 runs. A
# pager stops for long, and is not waited for.
_SETTLING = 2.0
"""Seconds (real) to wait at most until output so far has been read."""


class OutputTail:
    """The last lines of one stream. Add bytes as they come; any thread may read."""

    def __init__(self, now: Callable[[], float]) -> None:
        """`now` returns the simulated time, in any thread."""
        self._now = now
        self._lines: deque[tuple[float, bytes]] = deque(maxlen=_SEARCHED)
        self._open = b""
        """The line that has no end yet, as far as it is kept."""
        self._lock = threading.Lock()

    def add(self, data: bytes) -> None:
        """Add bytes; lines may begin and end anywhere in them."""
        first, *rest = data.rsplit(b"\n", _SEARCHED)
        with self._lock:
            # Lines before the last ones of a flood are skipped.
            if len(rest) < _SEARCHED:
                first = self._open + first[:_LONGEST_LINE]
            self._open = first[:_LONGEST_LINE]
            if not rest:
                return
            moment = self._now()
            *whole, last = (first, *rest)
            self._lines.extend((moment, line[:_LONGEST_LINE]) for line in whole)
            self._open = last[:_LONGEST_LINE]

    def lines(self) -> list[OutputLine]:
        """The last lines, without the sequences that colour them. Bytes that are no UTF-8 are written as
        `\\xff`."""
        with self._lock:
            found = [*self._lines, *([(self._now(), self._open)] if self._open else ())]
        return [
            OutputLine(moment, without_escapes(line.removesuffix(b"\r").decode(errors="backslashreplace")))
            for moment, line in found
        ]


class ProgramOutput:
    """Both streams of a program."""

    def __init__(
        self, now: Callable[[], float] = lambda: 0.0, on_lost: Callable[[str], None] = lambda why: None
    ) -> None:
        """`now` returns the simulated time, in any thread. `on_lost` gets a sentence when a stream cannot be
        passed on any more, in a thread of its own."""
        self._now = now
        self.stderr = OutputTail(now)
        self.stdout = OutputTail(now)
        self.on_lost = on_lost
        self.stacks = StackDump()
        """Stacks of the program when it was ended."""
        self._reader: OutputReader | None = None

    def begin(self, streams: list[_Stream], *, windows: bool = not platform_has.POSIX) -> OutputReader:
        """Begin to read the streams of its program."""
        self._reader = OutputReader(streams, windows=windows)
        return self._reader

    def settle(self) -> bool:
        """Wait until all output so far is kept; False if that takes too long.

        A program may have printed, and may wait for the clock, before its start has returned to us and its
        output is read. It is called for a program that runs, in any thread.
        """
        until = time.monotonic() + _SETTLING
        while self._reader is None or self._reader.is_behind:
            if time.monotonic() > until:
                return False
            time.sleep(0.00005)
        return True

    def end(self, code: int, *, stopped: bool = False) -> ProgramEnded:
        """The event of the program's end, now.

        Args:
            code: Exit code; 128 and the signal's number for a program that a signal ended.
            stopped: True if the simulator ended the program.
        """
        # Imported only when a program has ended: its patterns take a hundredth of the start.
        from simmer_tui.program.crash import crash_of, signal_name
        from simmer_tui.program.crash_parts import Crash

        stderr, stdout = self.stderr.lines(), self.stdout.lines()
        found = (
            None if stopped else crash_of(code, *([each.text for each in one] for one in (stderr, stdout)))
        )
        crash = found or Crash("")
        return ProgramEnded(
            self._now(),
            code,
            signal=signal_name(code),
            stopped=stopped,
            error=crash.error,
            place=self.stacks.place() if stopped else crash.place,
            stderr=tuple(stderr[-LAST_LINES:]),
            stdout=tuple(stdout[-LAST_LINES:]),
        )

    def not_started(self, error: ProgramError) -> ProgramEnded:
        """The event of a program that could not be started."""
        from simmer_tui.program.crash import NOT_FOUND

        return ProgramEnded(self._now(), NOT_FOUND, error=f"{NOT_STARTED}{error}")


class _Stream(Struct):
    """One stream: read from a descriptor, kept, and given to a callback or passed on to another
    descriptor."""

    source: int
    tail: OutputTail
    target: int | None
    on_line: Callable[[str], None] | None
    on_lost: Callable[[str], None] = lambda why: None
    """Gets a sentence when the target is full: from then on its bytes are only kept."""
    rest: bytes = field(default=b"")
    lock: threading.Lock = field(default_factory=threading.Lock)
    """Held while bytes are neither in the pipe nor kept."""

    def pump(self) -> bool:
        """Read the bytes that have come, and wait if there are none; False at the end."""
        data = self._read()
        ends = not data
        if self.on_line is None:
            data, ends = self._with_end_of_line(data)
        if self.on_line is not None:
            for line in self._lines(data):
                self.on_line(without_escapes(line.decode(errors="replace")).rstrip())
        elif self.target is not None and data:
            # Nobody reads any more: the program gets the same error as without us.
            return self._pass_on(data, self.target) and not ends
        return not ends

    def _with_end_of_line(self, data: bytes) -> tuple[bytes, bool]:
        """Data with the end of its last line, if that comes at once, and True if the stream has ended.

        Python without buffering writes a line and its end apart. Between them our own lines would come.
        """
        # Windows can wait for sockets only.
        if not platform_has.POSIX:
            return data, not data
        until = time.monotonic() + _LINE_END
        while data and not data.endswith(b"\n") and len(data) < _AT_ONCE:
            if not select.select([self.source], [], [], max(until - time.monotonic(), 0.0))[0]:
                break
            more = self._read()
            if not more:
                return data, True
            data += more
        return data, not data

    def _read(self) -> bytes:
        """Bytes that have come, kept, and waited for if there are none; empty at the end."""
        with self.lock:
            try:
                data = os.read(self.source, _AT_ONCE)
            except OSError:  # a terminal whose last writer has gone
                data = b""
            if data:
                self.tail.add(data)
        return data

    def close(self) -> None:
        """Close the descriptor."""
        with self.lock:
            os.close(self.source)
            self.source = -1

    @property
    def is_behind(self) -> bool:
        """True if bytes wait that are not kept yet; of a terminal some may still be on their way."""
        if sys.platform == "win32" or not platform_has.POSIX:
            return False
        with self.lock:
            if self.source < 0:
                return False
            # Asked for whenever time moves, thousands of times a second.
            try:
                return fcntl.ioctl(self.source, termios.FIONREAD, _NOTHING) != _NOTHING
            except OSError:
                return False

    def _lines(self, data: bytes) -> Iterator[bytes]:
        """Whole lines, and long ones in pieces; at the end the last one."""
        *whole, self.rest = (self.rest + data).split(b"\n")
        for line in whole:
            yield from (
                line[begin : begin + _LONGEST_PART] for begin in range(0, len(line) or 1, _LONGEST_PART)
            )
        if len(self.rest) >= _LONGEST_PART or (self.rest and not data):
            yield self.rest
            self.rest = b""

    def _pass_on(self, data: bytes, target: int) -> bool:
        _copy_window(target, self.source)
        view = memoryview(data)
        while view:
            try:
                view = view[os.write(target, view) :]
            except BlockingIOError:  # our output does not block, because another process has set it so
                time.sleep(_SOON)
            except OSError as error:
                if not is_disk_full(error):
                    return False
                # A program cannot get this error through a pipe: it would see a broken one.
                self.target = None
                self.on_lost(f"the program's output cannot be passed on: {reason_of(error)}")
                return True
        return True


# Judged: a terminal shows no more updates than this.
_SOON = 0.01
"""Seconds until a full descriptor is tried again."""


class OutputRoute:
    """The connection from a program's output to us: make it, give its ends to the program, then `start`."""

    def __init__(
        self,
        output: ProgramOutput,
        on_line: Callable[[str], None] | None,
        *,
        windows: bool = not platform_has.POSIX,
        at_once: bool = False,
    ) -> None:
        """With `on_line` lines go only to this callback; without it they go to our own output. Raises
        OSError.

        `at_once` is true if the program writes to a pipe without buffering, as to a terminal.
        """
        self._windows = windows
        self._at_once = at_once
        self.stdout: int | None = None
        self.stderr: int | None = None
        """Ends for the program; None where it shares ours."""
        self._streams: list[_Stream] = []
        self._output = output
        if on_line is not None:
            self.stdout, self.stderr = (
                self._opened(tail, None, on_line) for tail in (output.stdout, output.stderr)
            )
        else:
            self.stdout = self._passed(output.stdout, _STDOUT)
            self.stderr = self._passed(output.stderr, _STDERR)

    def _opened(self, tail: OutputTail, target: int | None, on_line: Callable[[str], None] | None) -> int:
        """Open a stream. Returns the program's end."""
        has_terminal = target is not None and not self._windows and os.isatty(target)
        ours, theirs = _terminal(target) if target is not None and has_terminal else os.pipe()
        self._streams.append(_Stream(ours, tail, target, on_line, self._output.on_lost))
        return theirs

    def _passed(self, tail: OutputTail, target: int) -> int | None:
        """The program's end of a stream that goes to our `target`."""
        try:
            os.fstat(target)
            # Windows has no such terminal. A pipe delays lines, but not those of standard error: C does not
            # buffer it, and Python writes it line by line.
            held_back = self._windows and target == _STDOUT and not self._at_once and os.isatty(target)
            return None if held_back else self._opened(tail, target, None)
        except OSError:  # our output is closed
            return None

    def start(self) -> OutputReader:
        """Begin to read: the program has its ends."""
        self._close_ends()
        return self._output.begin(self._streams, windows=self._windows)

    def abandon(self) -> None:
        """Close everything: the program has not been started."""
        self._close_ends()
        for stream in self._streams:
            os.close(stream.source)

    def _close_ends(self) -> None:
        for end in (self.stdout, self.stderr):
            if end is not None:
                os.close(end)


def reading(output: ProgramOutput, stdout: int, stderr: int, on_line: Callable[[str], None]) -> OutputReader:
    """A reader of both descriptors of a program until their ends: it keeps the last lines, passes all on, and
    closes them."""
    streams = [_Stream(stdout, output.stdout, None, on_line), _Stream(stderr, output.stderr, None, on_line)]
    return output.begin(streams)


class OutputReader:
    """Reads streams to their ends, from now on, in threads."""

    def __init__(self, streams: list[_Stream], *, windows: bool = not platform_has.POSIX) -> None:
        self._streams = streams
        # Windows cannot wait for several pipes; elsewhere one thread keeps the order of both.
        groups = [[each] for each in streams] if windows else [streams]
        self._threads = [
            threading.Thread(target=_read_all, args=(each,), name="output", daemon=True) for each in groups
        ]
        for thread in self._threads:
            thread.start()

    def join(self, seconds: float) -> None:
        """Wait for the ends, for `seconds` at most."""
        until = time.monotonic() + seconds
        for thread in self._threads:
            thread.join(max(until - time.monotonic(), 0.0))

    @property
    def is_behind(self) -> bool:
        """True if bytes wait that are not kept yet."""
        return any(stream.is_behind for stream in self._streams)


def _read_all(streams: list[_Stream]) -> None:
    """Read streams to their ends."""
    if not platform_has.POSIX:
        for stream in streams:
            while stream.pump():
                pass
            stream.close()
        return
    with selectors.DefaultSelector() as selector:
        for stream in streams:
            selector.register(stream.source, selectors.EVENT_READ, stream)
        while selector.get_map():
            # Standard output first: a program prints, and then fails.
            for key, _ in sorted(selector.select(), key=lambda ready: streams.index(ready[0].data)):
                stream = key.data
                if not stream.pump():
                    selector.unregister(stream.source)
                    stream.close()


def _terminal(target: int) -> tuple[int, int]:
    """Both ends of a terminal like the one at `target`, which leaves bytes unchanged: ours, and the
    program's. Raises OSError."""
    if sys.platform == "win32":
        raise NotImplementedError  # there is no such thing on Windows
    ours, theirs = os.openpty()
    attributes = termios.tcgetattr(theirs)
    attributes[1] &= ~termios.OPOST  # the real terminal turns line feeds into new lines
    termios.tcsetattr(theirs, termios.TCSANOW, attributes)
    _copy_window(target, ours)
    return ours, theirs


def _copy_window(target: int, ours: int) -> None:
    """Give a program's terminal the size of the terminal of its output."""
    if sys.platform == "win32" or not platform_has.POSIX or not (os.isatty(target) and os.isatty(ours)):
        return
    with contextlib.suppress(OSError):
        fcntl.ioctl(ours, termios.TIOCSWINSZ, fcntl.ioctl(target, termios.TIOCGWINSZ, bytes(8)))
