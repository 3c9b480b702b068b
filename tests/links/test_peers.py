"""One peer holds up no other, and not the end: floods, half ends, crowds and resets on every port."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from simmer_tui.config.dialects import REPLIES
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings import ServerSettings
from simmer_tui.links.link import port_requests
from simmer_tui.links.peer import MOST_WAITING, Peer, ReadBudget
from simmer_tui.links.ports import Acceptor, PortRequest, take_port
from simmer_tui.live.server import Server
from simmer_tui.run.events import Belief, Event, Notice
from simmer_tui.sim import CommandResult, Pose

SECONDS = 120.0
FLOODS = {
    "beliefs": [
        b'{"x":1,"y":2,"heading":3}\n' * 2000,
        b"\n" * 60_000,
        b"[" * 60_000,
        b'{"x":1,"y":2,"heading":3,"particles":[' + b"[1,2]," * 20_000 + b"[1,2]]}\n",
    ],
    "replies": [b"x" * 60_000],
    "packets": [b"[u0]" * 2000, b"[]" * 4000, b"\xff[[,]" * 2000, b"[xx]" * 2000],
    "packet replies": [b"x" * 60_000],
}


class Served:
    """A server of both dialects, and what it told."""

    def __init__(self, **settings: object) -> None:
        given: dict[str, object] = {"server.port": 0, "server.listeners": "binary,packets", "seed": 3}
        given |= {name.replace("__", "."): value for name, value in settings.items()}
        self.server = Server(load(bundled_folder(), {name: Override("--it", v) for name, v in given.items()}))
        self.events: list[Event] = []
        self._changed = threading.Condition()
        self.server.start(self._watch)

    def _watch(self, event: Event) -> None:
        with self._changed:
            self.events.append(event)
            self._changed.notify_all()

    @property
    def told(self) -> list[str]:
        return [event.text for event in tuple(self.events) if isinstance(event, Notice)]

    def wait(self, condition: Callable[[], object]) -> None:
        with self._changed:
            assert self._changed.wait_for(condition, SECONDS), self.told[-20:]

    def connect(self, purpose: str = "commands") -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.server.ports[purpose]), SECONDS)

    def ask(self, client: socket.socket, text: str) -> float:
        client.sendall(text.encode() + b"\n")
        return float(struct.unpack(">d", client.recv(8))[0])


@pytest.fixture
def served() -> Iterator[Callable[..., Served]]:
    with contextlib.ExitStack() as stack:

        def start(**settings: object) -> Served:
            made = Served(**settings)
            stack.callback(made.server.stop)
            return made

        yield start


@contextlib.contextmanager
def flood(running: Served, purpose: str, data: bytes) -> Iterator[threading.Event]:
    """Someone who sends without end, again and again as it is closed; set when the first has gone."""
    over, begun = threading.Event(), threading.Event()

    def send() -> None:
        while not over.is_set():
            with contextlib.suppress(OSError), running.connect(purpose) as sock:
                sock.settimeout(0.05)
                while not over.is_set():
                    with contextlib.suppress(TimeoutError):
                        sock.sendall(data)
                    begun.set()

    thread = threading.Thread(target=send)
    thread.start()
    try:
        assert begun.wait(SECONDS)
        yield begun
    finally:
        over.set()
        thread.join()


@pytest.mark.parametrize(
    ("purpose", "data"),
    [
        pytest.param(
            purpose, data, id=f"{purpose} {data[:6]!r}", marks=[pytest.mark.slow] if data != each[0] else []
        )
        for purpose, each in FLOODS.items()
        for data in each
    ],
)
def test_a_flood_on_one_port_holds_up_no_other_and_not_the_end(
    served: Callable[..., Served], purpose: str, data: bytes
) -> None:
    running = served()
    with contextlib.ExitStack() as stack:
        client = stack.enter_context(running.connect())
        assert math.isfinite(running.ask(client, "u1")), "its replies have their way"
        stack.enter_context(flood(running, purpose, data))
        for _ in range(4):
            assert math.isfinite(running.ask(client, "u1"))
            assert running.ask(client, "d1-0.01") == math.inf or purpose == "packets"
        with running.connect() as second:
            assert second.recv(1) == b""
        running.server.stop()
        assert not running.server.running


@pytest.mark.slow
def test_many_floods_share_one_turn_and_all_get_theirs(served: Callable[..., Served]) -> None:
    running = served()
    line = b'{"x":1,"y":2,"heading":%d}\n'
    with contextlib.ExitStack() as stack:
        for number in range(4):
            stack.enter_context(flood(running, "beliefs", line % number * 2000))

        def heard() -> set[float]:
            return {event.pose.heading for event in tuple(running.events) if isinstance(event, Belief)}

        running.wait(lambda: len(heard()) == 4)


def test_what_was_believed_before_a_movement_is_held_against_the_pose_before_it(
    served: Callable[..., Served],
) -> None:
    running = served()
    particles = ",".join(f"[{n}.25,{n}.5,90.125]" for n in range(5000))
    belief = f'{{"x":1,"y":2,"heading":3,"particles":[{particles}]}}\n'.encode()
    assert len(belief) > 64 * 1024
    with running.connect() as client, running.connect("beliefs") as believer:
        start = running.server.simulator.pose
        for _ in range(5):
            believer.sendall(b'{"x":1,"y":2,"heading":3,"note":"small"}\n' * 3)
            believer.sendall(belief)
            assert running.ask(client, "d1-1") == math.inf
    moved = [event for event in running.events if isinstance(event, CommandResult)]
    beliefs = [event for event in running.events if isinstance(event, Belief)]
    truths = [start, *(outcome.pose for outcome in moved[:-1])]
    assert [belief.true for belief in beliefs] == [pose for pose in truths for _ in range(4)]
    assert isinstance(truths[0], Pose)


def small_buffer(running: Served) -> socket.socket:
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    made.settimeout(SECONDS)
    made.connect(("127.0.0.1", running.server.ports["commands"]))
    return made


@pytest.mark.slow
def test_one_that_closes_its_side_and_reads_nothing_does_not_keep_the_robot(
    served: Callable[..., Served],
) -> None:
    running = served()
    with small_buffer(running) as rude:
        rude.sendall(b"u1\n" * 15_000)
        rude.shutdown(socket.SHUT_WR)
        running.wait(lambda: any("disconnected after" in text or "dropped" in text for text in running.told))
        with running.connect() as client:
            assert running.ask(client, "d1-1") == math.inf


@pytest.mark.slow
def test_a_newcomer_waits_only_so_long_for_one_that_is_about_to_leave(served: Callable[..., Served]) -> None:
    running = served(step_time=60)
    with running.connect() as first, running.connect() as second:
        first.sendall(b"d1-1\n")
        first.shutdown(socket.SHUT_WR)
        assert second.recv(1) == b""
        running.wait(lambda: any("one program at a time" in text for text in running.told))


def test_newcomers_are_bounded(served: Callable[..., Served], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simmer_tui.links.binary_link.RETRY_DELAY", 60.0)
    running = served()
    with running.connect() as first, contextlib.ExitStack() as stack:
        assert math.isfinite(running.ask(first, "u1"))
        crowd = [stack.enter_context(running.connect()) for _ in range(3 * MOST_WAITING)]
        assert [each.recv(1) for each in crowd[: 2 * MOST_WAITING]] == [b""] * 2 * MOST_WAITING
        assert running.ask(first, "d1-1") == math.inf
        first.close()
        assert math.isfinite(running.ask(crowd[2 * MOST_WAITING], "u1")), "the first of those that wait"


def test_connections_that_wait_for_replies_are_bounded(served: Callable[..., Served]) -> None:
    running = served()
    with contextlib.ExitStack() as stack:
        crowd = [stack.enter_context(running.connect("replies")) for _ in range(3 * MOST_WAITING)]
        assert [each.recv(1) for each in crowd[: 2 * MOST_WAITING]] == [b""] * 2 * MOST_WAITING
        with running.connect() as client:
            client.sendall(b"d1-1\n")
            assert len(crowd[-1].recv(8)) == 8, "the newest is the client's own"


def test_belief_connections_are_bounded(served: Callable[..., Served]) -> None:
    running = served()
    with contextlib.ExitStack() as stack:
        crowd = [stack.enter_context(running.connect("beliefs")) for _ in range(3 * MOST_WAITING)]
        assert [each.recv(1) for each in crowd[: 2 * MOST_WAITING]] == [b""] * 2 * MOST_WAITING
        crowd[-1].sendall(b'{"x":1,"y":2,"heading":3}\n')
        running.wait(lambda: any(isinstance(event, Belief) for event in running.events))


def test_a_second_client_that_resets_leaves_no_fault(served: Callable[..., Served]) -> None:
    running = served()
    with running.connect() as first:
        assert math.isfinite(running.ask(first, "u1"))
        for number in range(30):
            second = running.connect()
            second.sendall(b"u1\n" * (number % 3))
            second.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            second.close()
        running.wait(lambda: any("turned away" in text for text in running.told))  # told once a second
        assert running.ask(first, "d1-1") == math.inf
    assert not any("Exception" in text or "Error" in text for text in running.told)


# -- peers without a server ------------------------------------------------------------------


def test_accepted_connections_send_at_once() -> None:
    async def run() -> int:
        came: asyncio.Future[socket.socket] = asyncio.get_running_loop().create_future()
        listener = take_port("127.0.0.1", PortRequest(0, "it", "--it"))
        acceptor = Acceptor(listener, lambda sock, peer: came.set_result(sock))
        with socket.create_connection(("127.0.0.1", listener.port)), await came as sock:
            acceptor.close()
            return sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)

    assert asyncio.run(run()) != 0


def test_a_flood_of_the_reply_port_holds_up_the_first_reply_for_at_most_128_connections() -> None:
    """They are all accepted before it: thousands took a third of a second, and every descriptor there was."""
    every = [request for _, requests in port_requests(ServerSettings(port=0)) for request in requests]
    [request] = [each for each in every if each.purpose == REPLIES.purpose]

    async def run() -> int:
        accepted = 0

        def welcome(sock: socket.socket, peer: str) -> None:
            nonlocal accepted
            accepted += 1
            sock.close()

        listener = take_port("127.0.0.1", request)
        acceptor = Acceptor(listener, welcome)
        with contextlib.ExitStack() as flood:
            for _ in range(400):
                sock = flood.enter_context(socket.socket())
                sock.setblocking(False)
                sock.connect_ex(("127.0.0.1", listener.port))
            acceptor.accept_waiting()
        acceptor.close()
        return accepted

    assert 100 < asyncio.run(run()) <= 129


class Noted(Peer):
    """A peer that remembers, and counts whose turn it was."""

    def __init__(self, sock: socket.socket, budget: ReadBudget, order: list[Peer]) -> None:
        super().__init__(sock, "it", budget)
        self.order = order
        self.got = bytearray()
        self.errors: list[Any] = []

    def data_received(self, data: bytes) -> None:
        self.order.append(self)
        self.got += data

    def connection_lost(self, error: OSError | None) -> None:
        self.errors.append(error)


def test_peers_take_turns_and_lose_no_byte() -> None:
    async def run() -> None:
        turn, order = ReadBudget(1), []
        pairs = [socket.socketpair() for _ in range(3)]
        data = os.urandom(2_000)
        for pair in pairs:
            for each in pair:
                each.setblocking(False)
        peers = [Noted(near, turn, order) for near, _ in pairs]
        loop = asyncio.get_running_loop()
        await asyncio.gather(*(loop.sock_sendall(far, data) for _, far in pairs))
        async with asyncio.timeout(SECONDS):
            while any(len(peer.got) < len(data) for peer in peers):
                await asyncio.sleep(0)
        assert all(bytes(peer.got) == data for peer in peers)
        counts = [order[: len(order) // 2].count(peer) for peer in peers]
        assert max(counts) <= 2 * min(counts), "none is always the last"
        for peer, (_, far) in zip(peers, pairs, strict=True):
            peer.close()
            far.close()
        await asyncio.sleep(0)
        assert [peer.errors for peer in peers] == [[None]] * 3

    asyncio.run(run())


def test_what_is_written_goes_out_whole_before_the_end_and_not_for_ever() -> None:
    async def run() -> None:
        loop = asyncio.get_running_loop()
        data = os.urandom(3_000_000)
        reading, silent = socket.socketpair(), socket.socketpair()
        peers = []
        for near, far in (reading, silent):
            near.setblocking(False)
            far.setblocking(False)
            peer = Noted(near, ReadBudget(4096), [])
            assert not peer.write(data), "more than anybody may leave unread"
            peer.close()
            assert peer.write(b"late"), "nothing goes out any more"
            peers.append(peer)
        got = bytearray()
        while more := await loop.sock_recv(reading[1], 65536):
            got += more
        assert bytes(got) == data
        async with asyncio.timeout(SECONDS):
            while not all(peer.lost for peer in peers):
                await asyncio.sleep(0.001)
        for _, far in (reading, silent):
            far.close()

    asyncio.run(run())


@pytest.mark.parametrize(
    ("purpose", "sent", "count"),
    [("commands", b"u1\nd1-1\nu2\n", 3), ("packets", b"[u1,d1-1][u2]", 3), ("packets", b"[u1]" * 1200, 1200)],
)
def test_what_a_program_sends_and_ends_is_taken_in(
    served: Callable[..., Served], purpose: str, sent: bytes, count: int
) -> None:
    """Also where the robot's thread has not even seen it when its program has gone."""
    running = served()
    busy = threading.Event()
    running.server.call(busy.wait)
    for _ in range(2):
        with running.connect(purpose) as program:
            program.sendall(sent)
    threading.Timer(0.01, busy.set).start()
    running.server.drain()
    assert running.server.simulator.commands == 2 * count


def test_a_program_that_stays_is_not_waited_for_long(served: Callable[..., Served]) -> None:
    running = served()
    with running.connect() as stays:
        running.server.drain()
        assert running.ask(stays, "u1") > 0
