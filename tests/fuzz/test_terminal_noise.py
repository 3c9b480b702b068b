"""Noise from a real terminal: the robot is served, and the screen ends by an order only.

A person's order ends the screen every 10,000 bytes, and more noise meets its end. Then it starts again, and
the noise goes on. `NOISE` is the number of bytes for each slow test. A million costs a quarter of an hour of
CPU in each of the nine:

    NOISE=1000000 python -m pytest -n 0 -m slow -s tests/fuzz/test_terminal_noise.py

`tests/tui/test_terminal_driver.py` parses a million bytes without an app, in a few seconds.
"""

from __future__ import annotations

import contextlib
import faulthandler
import fcntl
import os
import random
import re
import select
import shlex
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from tests.tui.test_tmux import environment

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal is POSIX's")

AMOUNT = int(os.environ.get("NOISE", "12000"))
"""Bytes of noise for each slow test."""
# A byte costs 1 ms of CPU, the start 0.6 s.
QUICK = 600
SECONDS = 120.0
AGAIN = 5.0
"""Seconds after which a person presses a key again."""
PASSED_ON = 0.3
"""Seconds without waiting input after which all has been read."""
SIZES = ((80, 24), (120, 36), (200, 60))
QUIT = b"\x11"
PASTE_END = b"\x1b[201~"
# More than is typed ahead: the kernel keeps 4096 bytes, the driver 1024.
QUIT_EVERY = 10_000
"""Bytes between two orders that end the screen, ctrl+Q."""
BEHIND = 64
"""Bytes behind that order which meet the end of the screen."""
# Keys by which a person ends a run, pauses it, takes a replay over, or opens the palette with such actions.
LEFT_OUT = bytes(ord(key) for key in "bqtx") + b"\x10" + QUIT
# By ctrl+Q, and the program with it. Behind it the terminal makes signals of ctrl+C and of ctrl+\\.
ENDS = (0, 130, 131, 143, -signal.SIGINT, -signal.SIGQUIT)
"""Exit codes of a screen that a person has ended."""
FAULTS = re.compile(rb"Traceback|the screen has failed|Exception ignored")
TAIL = 4096
"""Bytes of output that are kept."""
SEQUENCES = (
    *(b"\x1b[<0;10;5M", b"\x1b[<35;900;900M", b"\x1b[<64;3;3M", b"\x1b[<0;-4;2m", b"\x1b[M !\xa0"),
    *(b"\x1b[200~d1-", b"\x1b[200~\xfc[/\x1b[201~", b"\x1b[201~", b"\x1b[I", b"\x1b[O"),
    *(b"\x1b[48;24;80;384;640t", b"\x1b[48;0;0;0;0t", b"\x1b[48;9;9;1;1t"),
    *(b"\x1b[48;99999;99999;99999;99999t", b"\x1b[97;5u", b"\x1b[1114112;1u", b"\x1b[97;99999u"),
    *(b"\x1b[0;0;9999999u", b"\x1b[;u", b"\x1b[57399;1:3u", b"\x1b[?2026;2$y", b"\x1b[?62;4c"),
    *(b"\x1b[12;40R", b"\x1bP>|xterm\x1b\\", b"\x1b]11;rgb:0/0/0\x07", b"\x1bOP", b"\x1b[15~"),
    *(b"\x1b[1;5A", b"\x1b\x1b[A", b"\x1b", b"\xc3\xbc", b"\xed\xa0\x80", b"\xf4\x90\x80\x80"),
    *(b":help [/\r", b":help [u0]\r", b"/", b"?", b"\t", b"\x03", b"\r", b"\x00", b"\x7f"),
)
"""What terminals send, and some that they should not."""
PROGRAM = """
import sys, time
sys.path.insert(0, {root!r})
from simmer_tui.client import Robot
robot = Robot()
with open("count", "ab", 0) as count:
    while True:
        robot.read("u1")
        robot.send("d1-0")
        count.write(b".")
        time.sleep(0.05)  # a program that thinks
"""


def noise(chance: random.Random, size: int) -> bytes:
    """Random bytes, and sequences, whole and cut; and now and then the order to end."""
    data = bytearray()
    while len(data) < size:
        if chance.random() < 0.5:
            data += chance.randbytes(chance.randrange(1, 24)).translate(None, LEFT_OUT)
        else:
            sequence = chance.choice(SEQUENCES).translate(None, LEFT_OUT)
            data += sequence if chance.random() < 0.7 else sequence[: chance.randrange(len(sequence))]
    for at in range(QUIT_EVERY, size, QUIT_EVERY):
        data[at : at + 1] = QUIT
    return bytes(data[:size])


class Terminal:
    """A pseudo-terminal with simmer-tui in it."""

    def __init__(self, folder: Path, words: Sequence[str], size: tuple[int, int]) -> None:
        self._ours, self._theirs = os.openpty()
        self._seen = b""
        self._is_restored = False
        self.resize(*size)
        os.set_blocking(self._ours, False)

        def own_terminal() -> None:
            os.setsid()
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)

        self.process = subprocess.Popen(
            [sys.executable, "-m", "simmer_tui", *words],
            env=environment(folder),
            cwd=folder,
            preexec_fn=own_terminal,
            **dict.fromkeys(("stdin", "stdout", "stderr"), self._theirs),
        )
        try:
            self.until(rb"\x1b\[\?1004h")  # after it has made the terminal raw
            assert self.process.poll() is None, self._seen
        except BaseException:
            self.close()
            raise

    @property
    def is_shown(self) -> bool:
        """False once the screen has given the terminal back, or has ended."""
        # Not by what it writes: from then on a ctrl+S stops its output, and a ctrl+Z the process.
        is_raw = not termios.tcgetattr(self._theirs)[3] & termios.ICANON
        return is_raw and self.process.poll() is None

    @property
    def waiting(self) -> int:
        """Bytes of input that the screen has not read."""
        number = bytearray(4)
        fcntl.ioctl(self._theirs, termios.FIONREAD, number)
        return int.from_bytes(number, sys.byteorder)

    def resize(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def read(self) -> bytes:
        """Take what has come, or wait a moment. Returns it with some of what came before."""
        fresh = b""
        if select.select([self._ours], [], [], 0.05)[0]:
            with contextlib.suppress(OSError):
                fresh = os.read(self._ours, 1 << 16)
        seen = self._seen[-64:] + fresh
        self._seen = (self._seen + fresh)[-TAIL:]
        assert not FAULTS.search(seen), self._seen
        self._is_restored = self._is_restored or b"\x1b[?1049l" in seen
        return seen

    def until(self, pattern: bytes) -> None:
        """Read until a pattern comes, or until the process has ended."""
        end = time.monotonic() + SECONDS
        while not re.search(pattern, self.read()) and self.process.poll() is None:
            assert time.monotonic() < end, (pattern, self._seen)

    def type(self, data: bytes) -> int:
        """Type bytes as fast as the screen reads them. Returns their number, less if it has ended."""
        sent, last, since = 0, (0, 0), time.monotonic()
        while self.is_shown:
            if sent < len(data):
                with contextlib.suppress(BlockingIOError):
                    sent += os.write(self._ours, data[sent : sent + 4096])
            self.read()
            if (sent, self.waiting) != last:
                last, since = (sent, self.waiting), time.monotonic()
            # The kernel takes a moment to pass bytes on.
            if last == (len(data), 0) and time.monotonic() > since + PASSED_ON:
                break
            assert time.monotonic() < since + SECONDS, f"no byte is read after {sent}: {self._seen!r}"
        return sent

    def await_end(self) -> None:
        """Wait for the end of a screen that a person has ended, without a fault and with the terminal as
        before."""
        end = time.monotonic() + SECONDS
        while self.process.poll() is None:
            assert time.monotonic() < end, f"it does not end: {self._seen!r}"
            # As the shell's user would.
            termios.tcflush(self._theirs, termios.TCIFLUSH)
            termios.tcflow(self._theirs, termios.TCOON)
            self.process.send_signal(signal.SIGCONT)
            self.read()
        while select.select([self._ours], [], [], 0)[0]:
            self.read()
        assert self.process.returncode in ENDS, (self.process.returncode, self._seen)
        assert self._is_restored, self._seen
        restored = termios.ICANON | termios.ECHO | termios.ISIG
        assert termios.tcgetattr(self._theirs)[3] & restored == restored

    def close(self) -> None:
        """End it in any case."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self._ours)
        os.close(self._theirs)


class Noisy:
    """A screen under noise."""

    words: Sequence[str] = ("--port", "0", "--seed", "5", "--pace", "0")

    def __init__(self, folder: Path, size: tuple[int, int]) -> None:
        self.folder, self.size = folder, size
        self.begin()

    def begin(self) -> None:
        """Start the screen."""
        self.terminal = Terminal(self.folder, self.words, self.size)
        self.is_served()

    def is_served(self) -> None:
        """Assert that the robot answers now."""

    def take(self, data: bytes) -> int:
        """Type all bytes, into one screen after the other. Returns the number of their ends."""
        sent = ends = 0
        while True:
            sent += self.terminal.type(data[sent:])
            if self.terminal.is_shown:
                return ends
            ends += 1
            assert ends <= data[:sent].count(QUIT), f"nobody has ended it; {sent} bytes sent"
            # No screen has read the rest, typed ahead.
            sent = min(sent, data.rindex(QUIT, 0, sent) + 1 + BEHIND)
            self.end()
            self.begin()

    def end(self) -> None:
        """Wait for its end, and clean up."""
        self.terminal.await_end()
        self.terminal.close()

    def quit(self) -> None:
        """See that it draws again after a change of its size, and that ctrl+Q ends it."""
        terminal, (columns, rows) = self.terminal, self.size
        terminal.resize(columns + 1, rows + 1)
        terminal.until(rb"\x1b\[%d;\d+H" % (rows + 1))
        end = time.monotonic() + SECONDS
        while terminal.is_shown:
            assert time.monotonic() < end, "ctrl+Q does not end it"
            # The noise may have begun a paste, or a sequence to which the next byte belongs.
            terminal.type(PASTE_END + QUIT)
            again = time.monotonic() + AGAIN
            while terminal.is_shown and time.monotonic() < again:
                terminal.read()
        self.end()

    def close(self) -> None:
        if self.terminal.process.returncode is None:
            self.terminal.close()


class WithProgram(Noisy):
    """The app beside a program that drives."""

    def begin(self) -> None:
        (self.folder / "robot.py").write_text(PROGRAM.format(root=str(Path(__file__).parents[2])))
        (self.folder / "count").write_bytes(b"")
        self.words = (*Noisy.words, "--run", shlex.join([sys.executable, "robot.py"]))
        super().begin()

    def is_served(self) -> None:
        grows(lambda: (self.folder / "count").stat().st_size)


class WithClient(Noisy):
    """The app with a client that asks."""

    def begin(self) -> None:
        with socket.socket() as sock:
            sock.bind(("127.0.0.1", 0))
            port = int(sock.getsockname()[1])
        self.words = ("--port", str(port), "--reply-port", "0", "--belief-port", "0", *Noisy.words[2:])
        self._asking: Asking | None = None
        self._port = port
        super().begin()

    def is_served(self) -> None:
        if self._asking is None:
            self._asking = Asking(self._port)
        asking = self._asking
        grows(lambda: asking.count)

    def end(self) -> None:
        super().end()
        assert self._asking is not None
        self._asking.join()


class Replayed(Noisy):
    """A replay."""

    words = ("replay", "run.jsonl")


class Asking(threading.Thread):
    """A client of the robot: it asks until the connection ends."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._client = socket.create_connection(("127.0.0.1", port), SECONDS)
        self.count = 0
        self.start()

    def run(self) -> None:
        with self._client, contextlib.suppress(ConnectionError):
            self._client.sendall(b"u1\n")
            while self._client.recv(8):
                self.count += 1
                threading.Event().wait(0.05)
                self._client.sendall(b"u1\n")


def grows(number: Callable[[], int], more: int = 3) -> None:
    """Wait until a number has grown: the robot is served now."""
    end, first = time.monotonic() + SECONDS, number()
    while number() < first + more:
        assert time.monotonic() < end, f"{first} answers, and no more"
        threading.Event().wait(0.05)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[type[Noisy], tuple[int, int]], Noisy]]:
    """Starts a screen, which is closed at the end."""
    with contextlib.ExitStack() as opened:

        def started(kind: type[Noisy], size: tuple[int, int]) -> Noisy:
            noisy = kind(tmp_path, size)
            opened.callback(noisy.close)
            return noisy

        yield started


def endure(noisy: Noisy, seed: int, amount: int) -> None:
    if amount > 100_000:
        faulthandler.cancel_dump_traceback_later()  # the limit of every test; here each byte has one
    ends = noisy.take(noise(random.Random(seed), amount))
    noisy.is_served()
    noisy.quit()
    sys.stdout.write(f"{type(noisy).__name__} {noisy.size}, seed {seed}: {amount} bytes, {ends} ends\n")


Start = Callable[[type[Noisy], tuple[int, int]], Noisy]


def test_noise_of_the_terminal_stops_no_program(start: Start) -> None:
    endure(start(WithProgram, SIZES[0]), 1, QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("kind", [WithProgram, WithClient, Replayed])
def test_much_noise_ends_no_screen_and_stops_no_program(
    kind: type[Noisy], size: tuple[int, int], start: Start, log: bytes, tmp_path: Path
) -> None:
    (tmp_path / "run.jsonl").write_bytes(log)
    endure(start(kind, size), size[0], AMOUNT)
