"""Access: the owner of a connection, and the token, on every port alike."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.client import Robot, RobotClosedError
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.links.access import AccessCheck
from simmer_tui.links.owners import OwnerLookup, RemoteSocket
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event, Notice
from simmer_tui.sim import Simulator

SECONDS = 120.0
PORTS = ("commands", "replies", "packets", "packet replies", "beliefs")
NOBODY = 65534
two_users = pytest.mark.skipif(
    sys.platform != "linux" or os.geteuid() != 0,
    reason="only on Linux does the system tell whose a connection is, and only root can be two users",
)


class Served:
    """A server of both dialects, and what it told."""

    def __init__(self, **settings: object) -> None:
        given: dict[str, object] = {"server.port": 0, "server.listeners": "binary,packets"}
        given |= {name.replace("__", "."): value for name, value in settings.items()}
        self.server = Server(load(bundled_folder(), {name: Override("--it", v) for name, v in given.items()}))
        self.told: list[str] = []
        self._changed = threading.Condition()
        self.server.start(self._watch)

    def _watch(self, event: Event) -> None:
        if isinstance(event, Notice):
            with self._changed:
                self.told.append(f"{event.kind}: {event.text}")
                self._changed.notify_all()

    def wait(self, part: str) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: any(part in line for line in self.told), SECONDS), self.told

    def connect(self, purpose: str) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.server.ports[purpose]), SECONDS)

    def robot(self, **options: Any) -> Robot:
        ports = self.server.ports
        if options.get("protocol") == "packets":
            return Robot("127.0.0.1", ports["packets"], ports["packet replies"], timeout=SECONDS, **options)
        return Robot("127.0.0.1", ports["commands"], ports["replies"], timeout=SECONDS, **options)


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Served]]:
    monkeypatch.delenv("SIMMER_TOKEN", raising=False)
    made: list[Served] = []

    def start(**settings: object) -> Served:
        made.append(Served(**settings))
        return made[-1]

    yield start
    for each in made:
        each.server.stop()


# -- other users -----------------------------------------------------------------------------

AS_NOBODY = """
import encodings.idna, os, socket, sys
os.setuid(int(sys.argv[1]))
sock = socket.socket()
sock.settimeout(60)
sock.connect(("127.0.0.1", int(sys.argv[2])))
data = sys.argv[3].encode()
try:
    sock.sendall(data)
    print("got", sock.recv(64))
except ConnectionError as error:
    print("reset", error)
"""


def as_nobody(port: int, data: str) -> str:
    """The reply to a program of another user."""
    command = [sys.executable, "-c", AS_NOBODY, str(NOBODY), str(port), data]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout.strip()


@pytest.mark.quick_cases(2)
@two_users
@pytest.mark.parametrize("purpose", PORTS)
def test_a_program_of_another_user_is_turned_away_with_a_line(
    served: Callable[..., Served], purpose: str
) -> None:
    running = served()
    assert as_nobody(running.server.ports[purpose], "[u1]") == "got b''"
    running.wait(
        f"turned away: a program of user nobody turned away from port {running.server.ports[purpose]}"
    )
    with running.robot() as robot:
        assert robot.send("d1-1") == math.inf, "we are let in ourselves"


QUICK = """
import os, socket, sys
os.setuid(int(sys.argv[1]))
for _ in range(int(sys.argv[3])):
    with socket.socket() as sock:
        try:
            sock.connect(("127.0.0.1", int(sys.argv[2])))
            sock.sendall(b"[w0:3]")
        except ConnectionError:
            pass
"""


def quick(user: int, port: int, count: int = 20) -> None:
    """So many times: connect, send a drive and close at once, as simmer-python's programs do."""
    subprocess.run([sys.executable, "-c", QUICK, str(user), str(port), str(count)], check=True, timeout=300)


@two_users
def test_a_program_of_another_user_that_sends_and_leaves_at_once_drives_nothing(
    served: Callable[..., Served],
) -> None:
    running = served()
    quick(NOBODY, running.server.ports["packets"])
    running.wait("turned away: a program of user nobody turned away")
    with running.robot() as robot:
        assert robot.send("u1") > 0
    assert running.server.simulator.commands == 1


@two_users
def test_a_busy_server_tells_those_who_have_left_apart(served: Callable[..., Served]) -> None:
    """The system would forget whose they were once their ends are acknowledged, 40 ms after."""
    running = served()
    port = running.server.ports["packets"]
    busy, done = threading.Event(), threading.Event()
    running.server.call(busy.set)
    running.server.call(done.wait, SECONDS)
    assert busy.wait(SECONDS)
    quick(NOBODY, port, 1000)
    quick(os.geteuid(), port)
    done.set()
    running.wait("turned away: a program of user nobody turned away")
    # Those of the other user came first: the own ones are accepted after all of them.
    deadline = time.monotonic() + SECONDS
    while running.server.simulator.commands < 20 and time.monotonic() < deadline:
        running.server.drain()
    assert running.server.simulator.commands == 20
    assert not any("cannot be told" in line for line in running.told)


class Door:
    """A listening socket with the access check of a server, and what it admitted."""

    def __init__(self, token: str = "") -> None:
        self.owners = OwnerLookup()
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.owners.hold_ends(self.listening)
        engine = Engine(Simulator(load(bundled_folder()).simulation, 1))
        self.access = AccessCheck(engine.tell, self.owners, token=token)

    def close(self) -> None:
        self.listening.close()
        self.owners.close()

    def connect(self) -> socket.socket:
        return socket.create_connection(self.listening.getsockname())

    def admits(self, there: str = "127.0.0.1") -> bool:
        """True if the next connection is admitted."""
        accepted, address = self.listening.accept()
        with accepted:
            return self.access.admits(accepted, (there, address[1]))


def at_the_door(scenario: Callable[[Door], list[bool]], token: str = "") -> list[bool]:
    async def run() -> list[bool]:
        with contextlib.closing(Door(token)) as door:
            return scenario(door)

    return asyncio.run(run())


only_linux = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody is asked")


@only_linux
@pytest.mark.parametrize("token", ["", "word"])
def test_whose_connection_cannot_be_told_is_turned_away_once_another_user_was_seen(
    token: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kernels before 6.17 do not tell whose a socket was that its program has closed."""
    ask, us = OwnerLookup.ask, os.geteuid()
    users = iter((us, us + 1, us, us + 1, us, us, us, us + 1, us))

    def asked(self: OwnerLookup, sock: socket.socket, there: tuple[str, int]) -> RemoteSocket | None:
        told = ask(self, sock, there)
        return told and told._replace(uid=next(users) if told.inode else 0)

    monkeypatch.setattr(OwnerLookup, "ask", asked)

    def scenario(door: Door) -> list[bool]:
        admitted = []
        for closes in (False, True, False, True, True, False, True):
            with door.connect() as program:
                if closes:
                    program.close()
                admitted.append(door.admits())
        door.connect().close()
        return [*admitted, door.admits("192.0.2.1")]

    unknown = bool(token)  # it is asked for the token next
    assert at_the_door(scenario, token) == [True, True, False, unknown, unknown, True, unknown, True]


@only_linux
def test_a_connection_that_broke_off_before_it_was_known_drives_nothing() -> None:
    def scenario(door: Door) -> list[bool]:
        admitted = []
        for linger in (struct.pack("ii", 0, 0), struct.pack("ii", 1, 0)):
            with door.connect() as program:
                program.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
                program.sendall(b"[w0:3]")
            admitted.append(door.admits())
        return admitted

    assert at_the_door(scenario) == [True, False]
    assert at_the_door(scenario, "word") == [True, True], "it is asked for the token next"


@only_linux
def test_whoever_has_the_port_of_one_that_broke_off_is_not_taken_for_it() -> None:
    def scenario(door: Door) -> list[bool]:
        with socket.create_connection(door.listening.getsockname(), None, ("127.0.0.1", 0)) as stranger:
            port = stranger.getsockname()
            stranger.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        with socket.socket() as owner:
            owner.bind(port)
            owner.connect(door.listening.getsockname())
            return [door.admits(), door.admits()]

    assert at_the_door(scenario) == [False, True]


@only_linux
@pytest.mark.parametrize("pieces", [0, 1, 5, 40])
def test_whose_a_closed_connection_was_is_told_however_late_and_it_ends_behind_what_it_sent(
    pieces: int,
) -> None:
    with contextlib.closing(OwnerLookup()) as owners, socket.create_server(("127.0.0.1", 0)) as listening:
        owners.hold_ends(listening)
        if not owners.is_complete:
            pytest.skip("a kernel before 6.17")
        with socket.create_connection(listening.getsockname()) as program:
            program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for _ in range(pieces):
                program.sendall(b"[u0]")
        accepted, there = listening.accept()
        with accepted:
            # What has come is acknowledged now, and its end with it, if that were let through.
            got = accepted.recv(4) if pieces else b""
            accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
            assert owners.owner(accepted, there) == os.geteuid()
            while piece := accepted.recv(4096):
                got += piece
    assert got == b"[u0]" * pieces


def test_where_users_have_no_numbers_nobody_is_turned_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows."""
    monkeypatch.delattr(os, "geteuid", raising=False)
    monkeypatch.setattr(OwnerLookup, "ask", lambda *connection: None)
    monkeypatch.setattr(OwnerLookup, "is_complete", False)

    def scenario(door: Door) -> list[bool]:
        with door.connect():
            return [door.admits()]

    assert at_the_door(scenario) == [True]


@two_users
def test_any_user_is_let_in_where_that_is_wanted(served: Callable[..., Served]) -> None:
    running = served(server__any_user=True)
    assert as_nobody(running.server.ports["commands"], "d1-1\n") != "got b''"
    assert not any("turned away" in line for line in running.told)


# -- the token -------------------------------------------------------------------------------

TOKEN = "spät 7"


@pytest.mark.parametrize("protocol", ["binary", "packets"])
def test_with_the_token_robots_drive_and_believe(served: Callable[..., Served], protocol: str) -> None:
    running = served(server__token=TOKEN)
    beliefs = running.server.ports["beliefs"]
    with running.robot(protocol=protocol, token=TOKEN, belief_port=beliefs) as robot:
        for _ in range(5):
            robot.believe(1, 2, 3)
            robot.drive("d1", 0.1)
            assert robot.read("u1") > 0
    assert not any("turned away" in line for line in running.told)


def test_server_and_programs_take_the_token_from_the_environment(
    served: Callable[..., Served], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMMER_TOKEN", TOKEN)
    running = served()
    assert running.server.environment["SIMMER_TOKEN"] == TOKEN
    with running.robot() as robot:
        assert robot.read("u1") > 0
    with running.connect("commands") as rude:
        rude.sendall(b"u1\n")
        assert rude.recv(8) == b""


@pytest.mark.quick_cases(5)
@pytest.mark.parametrize("purpose", PORTS)
@pytest.mark.parametrize("first", [b"wrong\n[u1]", b"\n", b"x" * 5000, TOKEN.encode() + b"x\n"])
def test_without_the_token_there_is_a_clean_end_and_a_line(
    served: Callable[..., Served], purpose: str, first: bytes
) -> None:
    running = served(server__token=TOKEN)
    with running.connect(purpose) as rude:
        rude.sendall(first)
        assert rude.recv(64) == b""
    running.wait("its first line is not the --token")
    with running.robot(token=TOKEN) as robot:
        assert robot.read("u1") > 0


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("purpose", PORTS)
def test_one_that_says_nothing_or_leaves_holds_nobody_up(served: Callable[..., Served], purpose: str) -> None:
    running = served(server__token=TOKEN)
    silent = [running.connect(purpose) for _ in range(40)]
    gone = running.connect(purpose)
    gone.close()
    with running.robot(token=TOKEN) as robot:
        assert robot.read("u1") > 0
    assert [each.recv(1) for each in silent] == [b""] * 40
    for each in silent:
        each.close()


def test_a_token_in_pieces_is_one_and_what_follows_it_is_a_command(served: Callable[..., Served]) -> None:
    running = served(server__token=TOKEN)
    with running.connect("commands") as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for piece in (TOKEN.encode()[:3], TOKEN.encode()[3:], b"\r", b"\nd1-1\nd1-1\n"):
            sock.sendall(piece)
        assert len(sock.recv(8)) == len(sock.recv(8)) == 8


def test_a_robot_with_a_wrong_token_is_told_what_may_be_wrong(served: Callable[..., Served]) -> None:
    running = served(server__token=TOKEN)
    with pytest.raises(RobotClosedError, match="--token"), running.robot(token="no") as robot:
        robot.read("u1")


def test_an_open_host_is_warned_of_unless_there_is_a_token(served: Callable[..., Served]) -> None:
    open_to_all = served(server__host="0.0.0.0")
    assert "--token" in open_to_all.server.warnings[0]
    assert served(server__host="0.0.0.0", server__token=TOKEN).server.warnings == []


def test_the_token_is_in_no_log(served: Callable[..., Served], tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    for file in bundled_folder().iterdir():
        if file.is_file():
            (folder / file.name).write_text(file.read_text().replace('token = ""', 'token = "hush"'))
    configuration = load(folder, {"server.port": Override("--port", 0)})
    assert configuration.settings.server.token == "hush"
    server = Server(configuration)
    log = server.start_log(str(tmp_path / "run.jsonl"))
    server.stop()
    text = log.read_text()
    assert "hush" not in text
    assert json.loads(text.splitlines()[0])["settings"]["server"]["token"] == ""
