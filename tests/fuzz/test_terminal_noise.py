"""Noise from a real terminal: the robot is served, and the screen lives or ends with one line."""

from __future__ import annotations

import contextlib
import faulthandler
import fcntl
import os
import random
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
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.tui.test_tmux import environment

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal is POSIX's")

SECONDS = 120.0
AGAIN = 5.0
"""Seconds after which a person presses a key again."""
SIZES = ((80, 24), (120, 36), (200, 60))
ALL = 1_000_000
# Keys by which a person ends a run, pauses it, takes a replay over, or opens the palette with such actions.
LEFT_OUT = bytes(ord(key) for key in "bqtx") + b"\x10\x11"
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
import pathlib, sys, time
sys.path.insert(0, {root!r})
from simmer_tui.client import Robot
robot, count = Robot(), 0
while not pathlib.Path("stop").exists():
    robot.read("u1")
    robot.send("d1-0")
    count += 1
    time.sleep(0.02)  # a program that thinks
    pathlib.Path("count.new").write_text(str(count))
    pathlib.Path("count.new").replace("count")
"""


def noise(chance: random.Random, size: int) -> bytes:
    """Random bytes, and sequences, whole and cut."""
    data = bytearray()
    while len(data) < size:
        if chance.random() < 0.5:
            data += chance.randbytes(chance.randrange(1, 24))
        else:
            sequence = chance.choice(SEQUENCES)
            data += sequence if chance.random() < 0.7 else sequence[: chance.randrange(len(sequence))]
    return bytes(data[:size]).translate(None, LEFT_OUT)


class Terminal:
    """A pseudo-terminal with simmer-tui in it."""

    def __init__(self, folder: Path, words: Sequence[str], size: tuple[int, int], **changes: str) -> None:
        self._ours, self._theirs = os.openpty()
        self.seen = bytearray()
        self.resize(*size)
        os.set_blocking(self._ours, False)

        def own_terminal() -> None:
            os.setsid()
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)

        self.process = subprocess.Popen(
            [sys.executable, "-m", "simmer_tui", *words],
            env=environment(folder, **changes),
            cwd=folder,
            preexec_fn=own_terminal,
            **dict.fromkeys(("stdin", "stdout", "stderr"), self._theirs),
        )

    def resize(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def read(self) -> None:
        """Take what has come, or wait a moment."""
        if select.select([self._ours], [], [], 0.02)[0]:
            with contextlib.suppress(OSError):
                self.seen += os.read(self._ours, 1 << 16)

    def until(self, text: bytes, begin: int = 0) -> None:
        end = time.monotonic() + SECONDS
        while text not in self.seen[begin:]:
            assert time.monotonic() < end, (text, bytes(self.seen[-600:]))
            assert self.process.poll() is None, bytes(self.seen[-600:])
            self.read()

    def type(self, data: bytes) -> None:
        """Type bytes as fast as the terminal takes them, or until the screen has ended."""
        view = memoryview(data)
        while view and self.process.poll() is None:
            with contextlib.suppress(BlockingIOError):
                view = view[os.write(self._ours, view[:256]) :]
            self.read()
        waiting = bytearray(b"\x01\0\0\0")
        while any(waiting) and self.process.poll() is None:
            fcntl.ioctl(self._theirs, termios.FIONREAD, waiting)
            self.read()

    def close(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        end = time.monotonic() + SECONDS
        while self.process.poll() is None and time.monotonic() < end:
            self.read()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self._ours)
        os.close(self._theirs)


@pytest.fixture
def terminals() -> Iterator[list[Terminal]]:
    opened: list[Terminal] = []
    yield opened
    for each in opened:
        each.close()


def count(folder: Path) -> int:
    """Commands that the program has had answered."""
    file = folder / "count"
    return int(file.read_text()) if file.exists() else 0


def alive_or_closed_with_one_line(terminal: Terminal, size: tuple[int, int]) -> None:
    """The screen draws again, and ends by its key; or its fault is one line."""
    if b"the screen has failed" in terminal.seen:
        assert terminal.seen.count(b"the screen has failed") == 1
        assert b"Traceback" not in terminal.seen
        return
    assert terminal.process.poll() is None, bytes(terminal.seen[-600:])
    begin = len(terminal.seen)
    terminal.resize(size[0] - 1, size[1] - 1)
    terminal.until(b"\x1b[", begin)
    end = time.monotonic() + SECONDS
    while terminal.process.poll() is None:
        assert time.monotonic() < end, "ctrl+Q does not end it"
        # The first may still belong to a paste without an end.
        terminal.type(b"\x11")
        again = time.monotonic() + AGAIN
        while terminal.process.poll() is None and time.monotonic() < again:
            terminal.read()
    assert terminal.process.returncode in (0, 143), bytes(terminal.seen[-600:])
    assert b"Traceback" not in terminal.seen


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def ask(client: socket.socket) -> bytes:
    client.sendall(b"u1\n")
    return client.recv(8)


class Asking(threading.Thread):
    """A client of the robot without a program of ours: it asks until it is stopped."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.client = socket.create_connection(("127.0.0.1", port), SECONDS)
        self.over = threading.Event()
        self.count = 0
        self.start()

    def run(self) -> None:
        with self.client:
            while not self.over.wait(0.02) and len(ask(self.client)) == 8:
                self.count += 1


def grows(number: object, more: int = 5) -> None:
    """Wait until a number has grown: the robot is served now."""
    assert callable(number)
    end, first = time.monotonic() + SECONDS, number()
    while number() < first + more:
        assert time.monotonic() < end, f"{first} answers, and no more"
        threading.Event().wait(0.05)


def allow(amount: int) -> None:
    """Switch the limit of every test off: a million bytes take a quarter of an hour (a millisecond a key)."""
    if amount == ALL:
        faulthandler.cancel_dump_traceback_later()


AMOUNTS = (2_000, pytest.param(ALL, marks=pytest.mark.slow))
CASES = [SIZES[0], *(pytest.param(size, marks=pytest.mark.slow) for size in SIZES[1:])]


@pytest.mark.parametrize("amount", AMOUNTS)
@pytest.mark.parametrize("size", CASES)
def test_noise_of_the_terminal_stops_no_program(
    amount: int, size: tuple[int, int], tmp_path: Path, terminals: list[Terminal]
) -> None:
    (tmp_path / "robot.py").write_text(PROGRAM.format(root=str(Path(__file__).parents[2])))
    run = shlex.join([sys.executable, "robot.py"])
    allow(amount)
    terminal = Terminal(tmp_path, ["--port", "0", "--seed", "5", "--pace", "0", "--run", run], size)
    terminals.append(terminal)
    terminal.until(b"\x1b[?1049h")
    grows(lambda: count(tmp_path))
    terminal.type(noise(random.Random(size[0]), amount))
    grows(lambda: count(tmp_path))
    alive_or_closed_with_one_line(terminal, size)


@pytest.mark.slow
@pytest.mark.parametrize("amount", [3_000, ALL])
@pytest.mark.parametrize("size", SIZES)
def test_noise_without_a_program_stops_no_client(
    amount: int, size: tuple[int, int], tmp_path: Path, terminals: list[Terminal]
) -> None:
    port = free_port()
    allow(amount)
    terminal = Terminal(tmp_path, ["--port", str(port), "--seed", "5", "--pace", "0"], size)
    terminals.append(terminal)
    terminal.until(b"\x1b[?1049h")
    asking = Asking(port)
    grows(lambda: asking.count)
    terminal.type(noise(random.Random(size[0] + 1), amount))
    grows(lambda: asking.count)
    asking.over.set()
    asking.join()
    alive_or_closed_with_one_line(terminal, size)


@pytest.mark.slow
@pytest.mark.parametrize("amount", [3_000, ALL])
@pytest.mark.parametrize("size", SIZES)
def test_noise_does_not_end_a_replay(
    amount: int, size: tuple[int, int], tmp_path: Path, terminals: list[Terminal]
) -> None:
    words = [sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0", "--log", "run.jsonl"]
    (tmp_path / "robot.py").write_text(PROGRAM.format(root=str(Path(__file__).parents[2])))
    (tmp_path / "stop").write_text("")
    run = shlex.join([sys.executable, "robot.py"])
    subprocess.run(
        [*words, "--run", run], cwd=tmp_path, check=False, capture_output=True, env=environment(tmp_path)
    )
    allow(amount)
    terminal = Terminal(tmp_path, ["replay", "run.jsonl"], size)
    terminals.append(terminal)
    terminal.until(b"\x1b[?1049h")
    terminal.type(noise(random.Random(size[0] + 2), amount))
    alive_or_closed_with_one_line(terminal, size)
