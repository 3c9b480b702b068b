"""A board that starts again when its port is opened: what is sent to it waits, and nothing is lost."""

from __future__ import annotations

import asyncio
import os
import struct
import sys
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui import platform_has
from simmer_tui.config.loader import load
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings import SerialSettings
from simmer_tui.links import port_list, serial_link
from simmer_tui.links.backend import Message
from simmer_tui.links.port_list import is_usb, open_port
from simmer_tui.links.serial_bridge import SerialBridge
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event, Notice
from simmer_tui.sim import CommandResult, Simulator, Status, parse_command
from tests.links.recording import until

FORM = ReplyForm(ReplyFormat.FLOAT64, "big")
LONG = "60"
"""A time to start, seconds, that no test waits for."""


class Board:
    """A board on a pty that is deaf until it has started, and answers each line with a number."""

    def __init__(self, end: Any, boot: str, **settings: Any) -> None:
        self.end = end
        end.hear = self._hear
        self.deaf = True
        self.lost = b""
        self.lines: list[bytes] = []
        self.answers = True
        engine = Engine(Simulator(load(bundled_folder()).simulation))
        engine.start(asyncio.get_running_loop())
        self.events: list[Event] = []
        engine.watch(self._note)
        end.plug_in()
        given = SerialSettings(port="board", boot=boot, timeout=30, **settings)
        self.bridge = SerialBridge(engine, end.link(), given)
        self._session = engine.session()
        self.results: list[CommandResult] = []

    def _note(self, event: Event) -> None:
        self.events.append(event)
        if isinstance(event, Notice) and "is open" in event.text:
            self.deaf = True
            # A fifth of the wait, and by the same loop: however busy the machine is, it is over before.
            asyncio.get_running_loop().call_later(0.01, self._start)

    def _start(self) -> None:
        self.deaf = False

    def _hear(self, data: bytes) -> None:
        if self.deaf:
            self.lost += data
            return
        for line in data.splitlines():
            self.lines.append(line)
            if self.answers:
                self.end.write(struct.pack(">d", 7.0))

    def send(self, text: str) -> None:
        def answered(results: Sequence[CommandResult], data: bytes | None) -> None:
            self.results.extend(results)

        self.bridge.submit(
            Message(text.encode() + b"\n", (parse_command(text),), FORM), self._session, answered
        )

    @property
    def told(self) -> list[str]:
        return [event.text for event in self.events if isinstance(event, Notice)]

    async def waits(self, times: int = 1) -> None:
        """Wait until it is told that the board starts, for the nth time."""
        await until(lambda: sum("for the board to start" in text for text in self.told) == times)

    def close(self) -> None:
        self.bridge.close()
        self.end.unplug()


def test_a_deaf_board_loses_no_command_after_each_opening_and_no_movement_is_sent_twice(pty_end: Any) -> None:
    async def run() -> None:
        board = Board(pty_end, "0.05")
        board.send("u1")  # before the port is open
        await board.waits()
        board.send("d1-3")
        assert board.told == [
            "robot: " + board.bridge.port + " is open; waiting 0.05 s for the board to start"
        ]
        await until(lambda: len(board.results) == 2)
        assert [result.reply for result in board.results] == [7.0, 7.0]
        # The plug is pulled while a movement is under way, and put back.
        board.answers = False
        board.send("d1-5")
        await until(lambda: board.lines[-1] == b"d1-5")
        board.end.unplug()
        await until(lambda: len(board.results) == 3)
        assert board.results[2].status is Status.UNANSWERED
        board.answers = True
        board.send("u2")
        board.end.plug_in()
        await board.waits(2)
        await until(lambda: len(board.results) == 4)
        assert board.results[3].reply == 7.0
        assert board.lines == [b"u1", b"d1-3", b"d1-5", b"u2"]
        assert board.lost == b""
        board.close()

    asyncio.run(run())


def test_a_board_that_greets_is_ready_then_and_its_words_are_no_reply(pty_end: Any) -> None:
    async def run() -> None:
        board = Board(pty_end, LONG)
        await board.waits()
        board.send("d1-3")
        board.end.write(b"\x00")  # noise is no greeting
        board.end.write(b"Rea")
        board.end.write(b"dy 1.5\r\n")
        await until(lambda: bool(board.results))
        assert (board.results[0].reply, board.lines, board.lost) == (7.0, [b"d1-3"], b"")
        assert any("the board said" in text and "Ready 1.5" in text for text in board.told)
        assert not any("discarded" in text for text in board.told)
        board.close()

    asyncio.run(run())


def test_a_stop_waits_for_the_board_and_the_commands_before_it_are_dropped(pty_end: Any) -> None:
    async def run() -> None:
        board = Board(pty_end, LONG)
        await board.waits()
        board.send("d1-3")
        board.bridge.stop()
        assert "board on " in board.told[-1]
        assert "is starting; it goes out as soon as that has started" in board.told[-1]
        board.end.write(b"Ready\n")
        await until(lambda: bool(board.lines))
        assert (board.lines, board.results[0].status) == ([b"xx"], Status.UNANSWERED)
        board.close()

    asyncio.run(run())


@pytest.mark.parametrize(
    ("boot", "usb", "waits"), [("auto", True, "waiting 2 s"), ("auto", False, ""), ("0", True, "")]
)
def test_only_a_usb_adapter_has_a_time_to_start_by_itself(
    pty_end: Any, monkeypatch: pytest.MonkeyPatch, boot: str, usb: bool, waits: str
) -> None:
    monkeypatch.setattr(serial_link, "is_usb", lambda name: usb)

    async def run() -> None:
        board = Board(pty_end, boot)
        await until(lambda: bool(board.told))
        assert waits in board.told[0]
        assert ("waiting" in board.told[0]) is bool(waits)
        board.close()

    asyncio.run(run())


def test_usb_ports_are_known_by_all_their_names(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    ports = [
        ("/dev/ttyACM0", 0x2341),
        ("/dev/rfcomm0", None),
        ("/dev/cu.usbmodem1", 0x2341),
        ("COM5", 0x1A86),
    ]
    found = [SimpleNamespace(device=device, vid=vid) for device, vid in ports]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
    monkeypatch.setattr(platform_has, "POSIX", False)
    assert is_usb("com5")
    monkeypatch.setattr(platform_has, "POSIX", True)
    assert [is_usb(device) for device, _ in ports[:3]] == [True, False, True]
    assert is_usb("/dev/tty.usbmodem1")
    assert not is_usb("/dev/pts/3")
    assert not is_usb("socket:///dev/ttyACM0")
    if hasattr(os, "symlink") and sys.platform != "win32":
        (tmp_path / "by-id").symlink_to("/dev/ttyACM0")
        assert is_usb(str(tmp_path / "by-id"))


@pytest.mark.parametrize("moves", [True, False])
def test_dtr_stays_high_when_a_port_is_closed_if_it_is_not_to_be_moved(pty_end: Any, moves: bool) -> None:
    termios = pytest.importorskip("termios")

    async def run() -> None:
        pty_end.plug_in()
        termios.tcsetattr(pty_end.slave, termios.TCSANOW, _hanging_up(termios, pty_end.slave))
        port = open_port(str(pty_end.name), 9600, moves_dtr=moves)
        hangs_up = bool(termios.tcgetattr(port.fileno())[2] & termios.HUPCL)
        port.close()
        pty_end.unplug()
        assert hangs_up is moves

    asyncio.run(run())


def _hanging_up(termios: Any, descriptor: int) -> list[Any]:
    attributes: list[Any] = termios.tcgetattr(descriptor)
    attributes[2] |= termios.HUPCL
    return attributes


@pytest.mark.parametrize("moves", [True, False])
def test_on_windows_the_lines_are_low_before_the_port_is_opened(
    monkeypatch: pytest.MonkeyPatch, moves: bool
) -> None:
    seen: list[tuple[Any, Any]] = []

    class WindowsPort:
        dtr: Any = True
        rts: Any = True
        port = ""

        def __init__(self, *_: Any, **__: Any) -> None:
            """Not opened yet."""

        def open(self) -> None:
            seen.append((self.dtr, self.rts))

    monkeypatch.setattr("serial.Serial", WindowsPort)
    monkeypatch.setattr(port_list.platform_has, "POSIX", False)
    open_port("COM5", 9600, moves_dtr=moves)
    assert seen == [(moves, moves)]
