"""Serial ports: opened, stalled, explained, listed, and set in settings.toml and by options."""

from __future__ import annotations

import asyncio
import errno
import os
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui.cli.ports_command import run_ports
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError
from simmer_tui.links import port_list, serial_channel, serial_link
from simmer_tui.links.port_list import describe_ports, explain, open_port
from simmer_tui.links.serial_channel import ThreadChannel, channel_for
from simmer_tui.links.serial_link import BackOff, SerialLink
from tests.links.recording import RecordingListener, until

unix_only = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no ptys")


def test_url_without_a_file_behind_it_works() -> None:
    async def run() -> None:
        link, ear = SerialLink("loop://"), RecordingListener()
        link.start(ear)
        await until(lambda: ear.told == ["opened"])
        link.write(b"echo")
        await until(lambda: bytes(ear.bytes) == b"echo")
        link.close()

    asyncio.run(run())


def test_missing_port_is_told_of_once_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    tries: list[str] = []

    def count(name: str, baud: int, **options: bool) -> Any:
        tries.append(name)
        return open_port(name, baud, **options)

    monkeypatch.setattr(serial_link, "open_port", count)

    async def run() -> None:
        link, ear = SerialLink(str(tmp_path / "none"), back_off=BackOff(0.001, 0.002)), RecordingListener()
        link.start(ear)
        await until(lambda: len(tries) >= 5)
        link.close()
        opened.extend(ear.told)

    asyncio.run(run())
    assert len(opened) == 1
    assert "there is no port" in opened[0]


@unix_only
def test_stop_goes_ahead_of_what_a_stalled_port_has_not_taken(
    pty_end: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    writing: list[bytes] = []

    def watched(name: str, baud: int, **options: bool) -> Any:
        port = open_port(name, baud, **options)
        write = port.write

        def note(data: bytes) -> Any:
            writing.append(data)
            return write(data)

        port.write = note
        return port

    monkeypatch.setattr(serial_link, "open_port", watched)

    async def run() -> None:
        pty_end.plug_in()
        loop = asyncio.get_running_loop()
        loop.remove_reader(pty_end.master)  # the robot does not read
        link, ear = pty_end.link(), RecordingListener()
        link.start(ear)
        await until(lambda: ear.told == ["opened"])
        begun = b"b" * 100_000
        link.write(begun)
        if pty_end.by_threads:  # the event loop writes at once
            await until(lambda: writing == [begun])
        link.write(b"waiting")
        link.write(b"too")
        assert link.write_instead(b"stop") == [b"waiting", b"too"]
        loop.add_reader(pty_end.master, pty_end.read)
        await until(lambda: pty_end.heard.endswith(b"stop"))
        assert bytes(pty_end.heard) == begun + b"stop"
        link.close()
        pty_end.unplug()

    asyncio.run(run())


@unix_only
def test_port_that_takes_nothing_for_long_counts_as_lost(
    pty_end: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_list, "WRITE_TIMEOUT", 0.02)

    async def run() -> None:
        pty_end.plug_in()
        asyncio.get_running_loop().remove_reader(pty_end.master)
        link, ear = pty_end.link(), RecordingListener()
        link.start(ear)
        await until(lambda: ear.told == ["opened"])
        link.write(b"b" * 100_000)
        await until(lambda: len(ear.told) > 1)
        assert "takes no more bytes" in ear.told[1]
        link.close()
        pty_end.unplug()

    asyncio.run(run())


class Flooding:
    """A port that has 900 bytes whenever it is read, five times, and says when it has given them all."""

    in_waiting = 900
    timeout = 0.0

    def __init__(self) -> None:
        self.left = 5
        self.spent = threading.Event()

    def read(self, size: int) -> bytes:
        if self.left == 0:  # asked again: the last piece has been dealt with
            self.spent.set()
            return b""
        self.left -= 1
        return b"x" * size

    def close(self) -> None:
        pass


def test_flood_between_two_turns_of_the_loop_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_channel, "INBOX", 1000)
    monkeypatch.setattr(serial_channel, "READ_TIMEOUT", 0.001)

    async def run() -> None:
        port, ear = Flooding(), RecordingListener()
        channel = channel_for(port, asyncio.get_running_loop(), ear.received, lambda _: None)
        assert isinstance(channel, ThreadChannel), "it has no file descriptor"
        assert port.spent.wait(60)  # and the loop does not turn meanwhile
        await until(lambda: len(ear.bytes) >= 1000)
        channel.close()
        assert len(ear.bytes) == 1000

    asyncio.run(run())


@unix_only
@pytest.mark.parametrize("prefix", ["", "spy://"])
def test_the_loop_watches_a_descriptor_only_where_no_other_layer_reads(prefix: str) -> None:
    master, slave = os.openpty()
    port = open_port(f"{prefix}{os.ttyname(slave)}", 9600)
    assert (serial_channel.descriptor_of(port) is None) == bool(prefix)
    port_list.close_port(port)
    for each in (master, slave):
        os.close(each)


@unix_only
def test_port_in_use_is_explained(pty_end: Any) -> None:
    async def run() -> None:
        pty_end.plug_in()
        first, second, ear = pty_end.link(), pty_end.link(), RecordingListener()
        first.start(ear)
        await until(lambda: ear.told == ["opened"])
        other = RecordingListener()
        second.start(other)
        await until(lambda: bool(other.told))
        assert "is in use: close the other program" in other.told[0]
        first.close()
        await until(lambda: other.told[-1] == "opened")
        second.close()
        pty_end.unplug()

    asyncio.run(run())


@unix_only
def test_missing_permission_names_the_group_to_join(tmp_path: Path) -> None:
    import grp

    device = tmp_path / "ttyUSB0"
    device.touch()
    group = grp.getgrgid(device.stat().st_gid).gr_name
    text = explain(PermissionError(errno.EACCES, "Permission denied"), str(device))
    assert text.startswith(f"no permission to open {device}")
    assert f"usermod -aG {group}" in text


def test_missing_port_lists_the_ports_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    there = (port_list.SerialPort("COM3", "", ""), port_list.SerialPort("COM4", "", ""))
    monkeypatch.setattr(port_list, "list_ports", lambda: there)
    text = explain(FileNotFoundError(errno.ENOENT, "no"), "COM\x1b9")
    assert text == "there is no port COM\x1b9; there are COM3, COM4"


@pytest.mark.parametrize("name", ["nothing://here", "socket://127.0.0.1:1"])
def test_url_that_cannot_be_opened_is_explained_in_one_printable_line(name: str) -> None:
    with pytest.raises((OSError, ValueError)) as caught:
        open_port(name, 9600)
    text = explain(caught.value, name)
    assert text.startswith(f"{name} cannot be opened")
    assert text.isprintable()


class FoundPort(SimpleNamespace):
    """A port as pyserial describes it."""

    def __lt__(self, other: FoundPort) -> bool:
        return bool(self.device < other.device)


def found(device: str, description: str = "n/a", hwid: str = "n/a", vid: int | None = None) -> FoundPort:
    return FoundPort(device=device, description=description, hwid=hwid, vid=vid, manufacturer=None)


FOUND = [
    found("/dev/ttyS0"),
    found("COM5", "Standard Serial over Bluetooth link (COM5)", "BTHENUM\\{00001101}"),
    found("/dev/rfcomm0"),
    found("/dev/ttyACM0", "Arduino Uno", "USB VID:PID=2341:0043", 0x2341),
    found("/dev/ttyUSB0", "USB2.0-Serial \x1b[31m", "USB VID:PID=1A86:7523", 0x1A86),
]


def test_bluetooth_and_arduino_ports_are_marked_as_they_are_named() -> None:
    ports = {port.device: port for port in describe_ports(FOUND)}
    assert {name: port.mark for name, port in ports.items()} == {
        "/dev/ttyS0": "",
        "COM5": "Bluetooth",
        "/dev/rfcomm0": "Bluetooth",
        "/dev/ttyACM0": "Arduino",
        "/dev/ttyUSB0": "probably Arduino (CH340)",
    }
    assert ports["/dev/ttyS0"].description == ""
    assert ports["/dev/ttyUSB0"].description == "USB2.0-Serial \x1b[31m"


def test_ports_command_lists_them(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(port_list, "list_ports", lambda: describe_ports(FOUND[2:4]))
    assert run_ports([]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "/dev/rfcomm0  [Bluetooth]",
        "/dev/ttyACM0  [Arduino]  Arduino Uno",
    ]
    monkeypatch.setattr(port_list, "list_ports", lambda: ())
    assert run_ports([]) == 1
    assert "no serial port found" in capsys.readouterr().err


def settings(**overrides: tuple[str, object]) -> Any:
    given = {name.replace("__", "."): Override(*override) for name, override in overrides.items()}
    return load(bundled_folder(), given).settings


def test_serial_option_takes_the_real_robot() -> None:
    made = settings(serial__port=("--serial", "COM5"), serial__baud=("--baud", "115200"))
    assert (made.sim, made.serial.port, made.serial.baud) == (False, "COM5", 115200)
    assert settings(serial__port=("--serial", "")).sim is True


@pytest.mark.parametrize(
    ("overrides", "where"),
    [
        ({"sim": ("--no-sim", False)}, "--no-sim"),
        ({"sim": ("--sim", True), "serial__port": ("--serial", "COM5")}, "--serial"),
        ({"serial__timeout": ("--serial-timeout", "0")}, "--serial-timeout"),
        ({"serial__stop": ("--serial-stop", " ")}, "--serial-stop"),
        ({"serial__robot_reply": ("--robot-reply", "ascii")}, "--robot-reply"),
    ],
)
def test_serial_settings_that_cannot_be_are_refused(
    overrides: dict[str, tuple[str, object]], where: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        settings(**overrides)
    assert [problem.where for problem in caught.value.problems] == [where]


@unix_only
def test_closed_links_leave_no_file_open(pty_end: Any) -> None:
    async def run() -> None:
        pty_end.plug_in()
        before = len(os.listdir("/dev/fd"))  # noqa: PTH208 - a listing of descriptors, not of files
        for _ in range(5):
            link, ear = pty_end.link(), RecordingListener()
            link.start(ear)
            await until(lambda ear=ear: bool(ear.told))  # type: ignore[misc]
            link.close()
        assert len(os.listdir("/dev/fd")) == before  # noqa: PTH208 - as above
        pty_end.unplug()

    asyncio.run(run())
