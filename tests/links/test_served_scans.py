"""A served robot with a lidar, read by the client library and by programs of every dialect."""

from __future__ import annotations

import math
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.client import CommandRefusedError, Robot, UnknownCodeError
from simmer_tui.config.dialects import BELIEFS, COMMANDS, PACKET_REPLIES, PACKETS, REPLIES
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.config.settings_file import Override
from simmer_tui.live.server import Server
from simmer_tui.run.events import CommandResult, Event, Notice
from simmer_tui.sim import Simulator

HOST = "127.0.0.1"
RAYS = 90


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("lidar") / "set"
    init_set(made, bundled_folder())
    path = made / "sensors.csv"
    head, *rows = path.read_text().splitlines()
    rows = [f"{row}," for row in rows] + [
        f"lidar1,sc,1,0,0,4,0,0.01,,,{RAYS}",
        "lidar2,sx,0,0,0,4,0,0.01,,,4",
    ]
    path.write_text("\n".join([f"{head},Rays", *rows]))
    return made


def configured(folder: Path, **settings: object) -> Configuration:
    given: dict[str, object] = {"server.port": 0, "seed": 7, "server.listeners": ("binary", "packets")}
    given |= {name.replace("__", "."): value for name, value in settings.items()}
    return load(folder, {name: Override("--it", value) for name, value in given.items()})


class Served:
    def __init__(self, configuration: Configuration) -> None:
        self.server = Server(configuration)
        self.events: list[Event] = []
        self._changed = threading.Condition()
        self.server.start(self.watch)

    def robot(self, **options: Any) -> Robot:
        ports = self.server.ports
        if options.get("protocol") == "packets":
            first, second = ports[PACKETS.purpose], ports[PACKET_REPLIES.purpose]
        else:
            first, second = ports[COMMANDS.purpose], ports[REPLIES.purpose]
        return Robot(HOST, first, second, belief_port=ports[BELIEFS.purpose], **options)

    def watch(self, event: Event) -> None:
        with self._changed:
            self.events.append(event)
            self._changed.notify_all()

    def notice(self, part: str) -> str:
        """The text of a notice, as soon as it has come."""

        def found() -> list[str]:
            return [each.text for each in self.events if isinstance(each, Notice) and part in each.text]

        with self._changed:
            assert self._changed.wait_for(found, 20)
            return found()[0]

    def told(self) -> list[list[float]]:
        """The ranges of all scans read so far."""
        results = [each for each in tuple(self.events) if isinstance(each, CommandResult)]
        return [each.ranges.tolist() for each in results if each.ranges is not None]


@pytest.fixture
def serve(folder: Path) -> Iterator[Any]:
    made: list[Served] = []

    def start(**settings: object) -> Served:
        made.append(Served(configured(folder, **settings)))
        return made[-1]

    yield start
    for each in made:
        each.server.stop()


def test_a_great_bearing_is_no_misread_reply(serve: Any) -> None:
    served = serve()
    with served.robot() as robot:
        assert robot.send("u1") > 0
        assert robot.send("sc-1e9") > 0
        assert robot.send("sc-1e308") > 0
        assert not [each for each in served.events if isinstance(each, Notice) and "no sense" in each.text]
        # A drive's value is told all the same.
        assert math.isnan(robot.send("d1-1e300"))
    served.notice("makes no sense as a movement")


@pytest.mark.parametrize("reply_format", ["float64", "float32"])
@pytest.mark.parametrize("byte_order", ["big", "little"])
def test_a_lidar_is_read_in_binary(serve: Any, reply_format: Any, byte_order: Any) -> None:
    served = serve(server__reply_format=reply_format, server__byte_order=byte_order)
    twin = Simulator(served.server.configuration.simulation, 7)
    with served.robot(reply_format=reply_format, byte_order=byte_order) as robot:
        for _ in range(3):
            expected = twin.execute("sc").ranges
            assert expected is not None
            assert robot.scan("sc") == pytest.approx(expected.tolist(), rel=1e-6)
        assert robot.drive("d1", 2).ended
        twin.execute("d1-2")
        assert robot.send("sc-90") == pytest.approx(twin.execute("sc-90").reply, rel=1e-6)
        assert len(robot.scan("sc")) == RAYS
        assert robot.read("u1") > 0


def test_one_number_asked_of_a_lidar_and_a_scan_of_others_are_refused_with_the_reason(serve: Any) -> None:
    served = serve()
    for protocol in ("binary", "packets"):
        with served.robot(protocol=protocol) as robot:
            for wrong in (lambda: robot.read("sc"), lambda: robot.read("u1", "sc"), lambda: robot.send("sc")):
                with pytest.raises(CommandRefusedError, match=r"'sc' is a lidar.*robot.scan"):
                    wrong()
            with pytest.raises(CommandRefusedError, match="'u1' is no lidar"):
                robot.scan("u1")
            with pytest.raises(CommandRefusedError, match="'i1' is no lidar"):
                robot.scan("i1")
            with pytest.raises(UnknownCodeError, match=r"no lidar 'sx' .*disabled"):
                robot.scan("sx")
            with pytest.raises(UnknownCodeError, match="no lidar 'd1'"):
                robot.scan("d1")
            assert math.isnan(robot.send("sc-left"))
            assert len(robot.scan("sc")) == RAYS


def test_a_refused_lidar_is_one_nan_and_a_scan_comes_amid_others(serve: Any) -> None:
    served = serve()
    with socket.create_connection((HOST, served.server.ports[COMMANDS.purpose]), 20) as connection:
        connection.sendall(b"u1\nsc\nsc-x\nsx\ni1\n")
        connection.shutdown(socket.SHUT_WR)
        data = b""
        while piece := connection.recv(65536):
            data += piece
    numbers = struct.unpack(f">{len(data) // 8}d", data)
    assert len(numbers) == 1 + (RAYS + 1) + 3
    assert numbers[1] == RAYS
    assert list(numbers[2 : 2 + RAYS]) == served.told()[0]
    assert all(map(math.isnan, numbers[2 + RAYS : 4 + RAYS]))
    assert numbers[-1] in (0.0, 1.0)


def packet(served: Served, request: bytes) -> bytes:
    """The reply to a message on a connection of its own."""
    with socket.create_connection((HOST, served.server.ports[PACKETS.purpose]), 20) as connection:
        connection.sendall(request)
    data = b""
    while not data:  # a read that comes before the reply is there ends without it
        with socket.create_connection((HOST, served.server.ports[PACKET_REPLIES.purpose]), 20) as replies:
            while piece := replies.recv(65536):
                data += piece
    return data


def test_a_lidar_is_read_in_packets(serve: Any) -> None:
    served = serve()
    reply = packet(served, b"[u1,sc,d1:1,sc:0]").decode()
    assert reply.startswith("[u1:")
    items = reply.strip("[]").split(",")
    assert [item[:3] for item in items] == ["u1:", "sc:", "d1:", "sc:"]
    ranges = [float(each) for each in items[1][3:].split(";")]
    assert ranges == pytest.approx(served.told()[0], abs=5e-4)
    assert all(each == "inf" or len(each.partition(".")[2]) == 3 for each in items[1][3:].split(";"))
    assert ";" not in items[3], "one ray is one number"
    with served.robot(protocol="packets") as robot:
        assert robot.scan("sc") == pytest.approx(served.told()[-1], abs=5e-4)


@pytest.mark.parametrize(("form", "layout"), [("text", ""), ("float64", "<d"), ("float32", "<f")])
def test_a_lidar_is_read_without_brackets(serve: Any, form: str, layout: str) -> None:
    served = serve(server__legacy_reply=form)
    data = packet(served, b"u1,sc,i1")
    [ranges] = served.told()
    if form == "text":
        first, scan, last = data.decode().split("|")
        assert [float(each) for each in scan.split(";")] == pytest.approx(ranges, abs=5e-4)
        assert float(first) > 0
        assert last in ("0.0", "1.0")
    else:
        numbers = struct.unpack(f"<{RAYS + 3}{layout[1]}", data)
        assert numbers[1] == RAYS
        assert list(numbers[2:-1]) == pytest.approx(ranges, rel=1e-6)


def test_a_program_that_reads_only_the_count_is_told_what_its_reply_was(serve: Any) -> None:
    served = serve()
    with socket.create_connection((HOST, served.server.ports[COMMANDS.purpose]), 20) as connection:
        connection.sendall(b"sc\n")
        assert struct.unpack(">d", connection.recv(8)) == (RAYS,)
    told = served.notice("left without reading its first reply")
    assert told.endswith(f"It has a count and {RAYS} numbers of 8 bytes, big-endian")
