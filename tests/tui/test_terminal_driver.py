"""The driver between a real terminal and the app: any input, the window's true size, slow output."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import gc
import os
import random
import resource
import select
import signal
import struct
import termios
import threading
from codecs import getincrementaldecoder
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from textual import events
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from simmer_tui.tui import textual_internals
from simmer_tui.tui.textual_internals import steady_driver
from tests.fuzz.test_terminal_noise import noise

SECONDS = 60.0


class Listener:
    """The parts of an app that a driver calls."""

    def __init__(self) -> None:
        self.got: list[Message] = []
        self.came = threading.Condition()
        self.fault: Exception | None = None
        self._message_queue: asyncio.Queue[None] = asyncio.Queue()

    def post_message(self, message: Message) -> bool:
        with self.came:
            self.got.append(message)
            self.came.notify_all()
        return True

    async def _post_message(self, message: Message) -> bool:
        return self.post_message(message)

    def _handle_exception(self, error: Exception) -> None:
        with self.came:
            self.fault = error
            self.came.notify_all()

    def until(self, condition: Callable[[], object]) -> None:
        with self.came:
            assert self.came.wait_for(condition, SECONDS), self.got

    @property
    def typed(self) -> str:
        """Characters of the keys so far."""
        return "".join(each.character or "" for each in self.got if isinstance(each, events.Key))


class Line:
    """A pseudo-terminal with a driver that reads it, in an event loop of its own."""

    def __init__(self, columns: int = 80, rows: int = 24) -> None:
        self.ours, self.theirs = os.openpty()
        fcntl.ioctl(self.ours, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        attributes = termios.tcgetattr(self.theirs)
        attributes[3] &= ~(termios.ICANON | termios.ECHO | termios.ISIG)
        termios.tcsetattr(self.theirs, termios.TCSANOW, attributes)
        self.stream = open(self.theirs, "w", closefd=False)  # noqa: SIM115
        self.app = Listener()
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever)
        self.thread.start()

    def driver(self) -> Any:
        async def made() -> Any:
            app: Any = self.app
            return steady_driver(LinuxDriver)(app)

        return asyncio.run_coroutine_threadsafe(made(), self.loop).result(SECONDS)

    def call(self, *methods: Callable[[], object]) -> None:
        """Call a driver's methods in the loop's thread."""

        async def called() -> None:
            for method in methods:
                method()

        asyncio.run_coroutine_threadsafe(called(), self.loop).result(SECONDS)

    def written(self) -> bytes:
        """Bytes written since the last call."""
        data = b""
        while select.select([self.ours], [], [], 0)[0]:
            data += os.read(self.ours, 65536)
        return data

    @property
    def is_raw(self) -> bool:
        return not termios.tcgetattr(self.theirs)[3] & termios.ISIG

    def close(self) -> None:
        if not self.loop.is_closed():
            self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()
        self.stream.close()
        for end in (self.ours, self.theirs):
            with contextlib.suppress(OSError):
                os.close(end)


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Iterator[Line]:
    made = Line()
    monkeypatch.setattr("sys.__stdin__", made.stream)
    monkeypatch.setattr("sys.__stderr__", made.stream)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    yield made
    made.close()


@pytest.fixture
def reading(line: Line) -> Iterator[Line]:
    driver = line.driver()
    driver._key_thread = threading.Thread(target=driver._run_input_thread)
    driver._key_thread.start()
    yield line
    driver.exit_event.set()
    driver._key_thread.join()


@pytest.mark.parametrize(
    "noise",
    [
        b"\xfc",  # an umlaut of ISO-8859-1
        b"\x1b[M \xa0\xff",  # an old mouse report
        b"\x1b[1114112;1u",  # a key by a number that is no character
        b"\x1b[48;0;0;0;0t\x1b[<0;3;3M",  # a size of nothing, and a click on it
        b"\x1b[48;99999;99999;99999;99999t",
        b"\xed\xa0\x80\xf4\x90\x80\x80\xc3",  # a surrogate, beyond Unicode, and half a character
    ],
)
def test_text_behind_any_input_is_read(noise: bytes, reading: Line) -> None:
    os.write(reading.ours, noise + b"\x1b[Iu1")
    reading.app.until(lambda: reading.app.typed.endswith("u1"))
    assert reading.app.fault is None
    assert not [each for each in reading.app.got if isinstance(each, events.Resize)]


@pytest.mark.parametrize(
    "reply",
    [
        "\x1b]11;rgb:1e1e/1e1e/1e1e\x1b\\",
        "\x1b]10;rgb:b/b/b\x07",
        "\x1bP>|tmux 3.4\x1b\\",
        "\x1bP1+r524742\x1b\\",
        "\x1b_Gi=31;OK\x1b\\",
        "\x1b[?62;4;22c",
        "\x1b[>0;276;0c",
        "\x1b[0n",
    ],
)
def test_replies_to_earlier_programs_are_no_keys(reply: str, line: Line) -> None:
    driver = line.driver()
    driver._begin_parsing()
    for cut in (len(reply), len(reply) - 1, 4):
        driver._feed(f"a{reply[:cut]}")
        driver._feed(f"{reply[cut:]}b")
    driver._feed("\x1b[A\x1b[1;5Ac")
    keys = ["a", "b", "a", "b", "a", "b", "up", "ctrl+up", "c"]
    line.app.until(lambda: len(line.app.got) >= len(keys))
    assert [each.key for each in line.app.got if isinstance(each, events.Key)] == keys


@pytest.mark.slow
def test_a_million_bytes_of_noise_are_parsed_in_bounded_memory(line: Line) -> None:
    chance = random.Random(7)
    data = noise(chance, 500_000)
    driver = line.driver()
    kinds: Counter[type[Message]] = Counter()
    driver.send_message = lambda message: kinds.update([type(message)])
    driver._begin_parsing()
    decode = getincrementaldecoder("utf-8")("replace").decode
    kept = []
    for _ in range(2):
        at = 0
        while at < len(data):
            size = chance.randrange(1, 1024)
            driver._feed(decode(data[at : at + size]))
            at += size
        kept.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    assert line.app.fault is None
    assert {events.Key, events.Paste, events.MouseDown, events.AppBlur} <= set(kinds)
    assert kinds[events.Key] > len(data)
    assert kept[1] < 1.1 * kept[0]


def test_input_that_comes_too_fast_waits_in_the_kernel(reading: Line) -> None:
    """An app that takes a message in each turn of its loop."""
    typed = "u" * 3000
    lengths = []

    def post(message: Message) -> bool:
        reading.app._message_queue.put_nowait(None)
        return Listener.post_message(reading.app, message)

    async def work() -> None:
        for _ in typed:
            await reading.app._message_queue.get()
            lengths.append(reading.app._message_queue.qsize())
            await asyncio.sleep(0)

    reading.app.post_message = post  # type: ignore[method-assign]
    working = asyncio.run_coroutine_threadsafe(work(), reading.loop)
    for at in range(0, len(typed), 500):
        os.write(reading.ours, typed[at : at + 500].encode())
    working.result(SECONDS)
    assert reading.app.typed == typed
    assert max(lengths) < 3 * textual_internals._AHEAD


def test_a_paste_without_an_end_ends_by_itself(reading: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(textual_internals, "_PASTE_ENDS", 0.0)
    os.write(reading.ours, b"\x1b[200~d1-3")
    reading.app.until(lambda: [each for each in reading.app.got if isinstance(each, events.Paste)])
    os.write(reading.ours, b"u1")
    reading.app.until(lambda: reading.app.typed == "u1")


def test_the_size_is_the_windows_whatever_the_environment_says(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "1")
    monkeypatch.setenv("LINES", "1")
    driver = line.driver()
    assert (driver._size, driver._get_terminal_size()) == ((80, 24), (80, 24))
    fcntl.ioctl(line.ours, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 100, 0, 0))
    assert driver._get_terminal_size() == (100, 40)
    # A serial line has no size of its own: there the variables are the only ones to ask.
    fcntl.ioctl(line.ours, termios.TIOCSWINSZ, bytes(8))
    monkeypatch.setenv("COLUMNS", "90")
    assert driver._get_terminal_size() == (90, 1)


def test_a_terminal_that_does_not_take_bytes_at_once_is_waited_for(line: Line) -> None:
    os.set_blocking(line.theirs, False)
    faults: list[Exception] = []
    writer = textual_internals._SteadyWriter(line.stream, faults.append)
    writer.start()
    text = "x" * 200_000
    writer.write(text)
    got = b""
    while len(got) < len(text):
        got += os.read(line.ours, 65536)
    writer.stop()
    assert (got, faults) == (text.encode(), [])


def test_a_terminal_that_fails_ends_the_screen_and_blocks_nobody(line: Line) -> None:
    faults: list[Exception] = []
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as file:  # noqa: PTH123
        writer = textual_internals._SteadyWriter(file, faults.append)
        writer.start()
        for _ in range(100):
            writer.write("x" * 10_000)
        writer.stop()
    assert [type(each) for each in faults] == [BrokenPipeError]


def test_a_fault_of_the_input_ends_the_app_by_its_own_way(line: Line) -> None:
    driver = line.driver()
    driver.fileno = line.theirs
    os.close(line.theirs)
    driver._run_input_thread()
    line.app.until(lambda: line.app.fault)
    assert isinstance(line.app.fault, OSError)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("is_closed", [True, False], ids=["closed", "stopped"])
def test_a_key_that_comes_as_the_app_ends_is_left_out(line: Line, *, is_closed: bool) -> None:
    """Nothing is left that Python would warn of at the end of the process."""
    driver = line.driver()
    line.loop.call_soon_threadsafe(line.loop.stop)
    line.thread.join()
    if is_closed:
        line.loop.close()
    driver._key_thread = threading.Thread(target=driver.send_message, args=(events.Key("u", "u"),))
    driver._key_thread.start()
    driver._key_thread.join(SECONDS)
    assert not driver._key_thread.is_alive()
    del driver
    line.loop.close()
    gc.collect()
    assert line.app.got == []


def test_a_stop_by_the_terminal_suspends_once_and_never_after_the_end(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl+Z sends a signal once the terminal is no longer raw: in a stop, and after ctrl+Q."""
    attributes = termios.tcgetattr(line.theirs)
    attributes[3] |= termios.ISIG
    termios.tcsetattr(line.theirs, termios.TCSANOW, attributes)
    stops: list[int] = []
    monkeypatch.setattr(os, "kill", lambda _, number: stops.append(number))
    driver = line.driver()
    stop, go_on = driver._sigtstp_application, driver._sigcont_application
    line.call(driver.start_application_mode, go_on)
    assert line.is_raw
    line.call(stop, stop, stop)
    assert (line.written().count(b"\x1b[?1049l"), line.is_raw) == (1, False)
    line.call(go_on, go_on)
    assert line.is_raw
    line.call(driver.stop_application_mode, driver.close)
    assert line.written().count(b"\x1b[?1049h") == 1
    line.call(stop, stop, go_on)
    assert (line.written(), line.is_raw) == (b"", False)
    assert stops == [signal.SIGSTOP] * 5


def test_another_driver_stays() -> None:
    from textual.drivers.headless_driver import HeadlessDriver

    assert steady_driver(HeadlessDriver) is HeadlessDriver
