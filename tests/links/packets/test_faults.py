"""Everything that clients do wrong, through a whole server: the next request is answered, and a
line says what happened."""

from __future__ import annotations

import contextlib
import re
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from simmer_tui.config.dialects import PACKET_REPLIES, PACKETS
from simmer_tui.errors import PortError
from simmer_tui.links.protocol.packets import MAX_REQUEST
from simmer_tui.run.events import Notice
from simmer_tui.sim import CommandResult, Status

Serve = Callable[..., Any]


def lines(served: Any) -> list[str]:
    """Notices of faults, beside those of coming and going, and refusals."""
    found = []
    for event in tuple(served.events):
        if isinstance(event, Notice) and "sends packets" not in event.text:
            found.append(event.text)
        elif isinstance(event, CommandResult) and event.status in (Status.REFUSED, Status.UNKNOWN):
            found.append(event.reason)
    return found


@pytest.mark.quick_cases(9)
@pytest.mark.parametrize(
    ("sent", "reply", "line"),
    [
        (b"[w0:1e308]", b"[w0:False]", "beyond the limit"),
        (b"[w0:]", b"[w0:False]", "the value is missing"),
        (b"no brackets", struct.pack("<d", float("nan")), "no sensor or drive has the code"),
        (b"[\xff\xfeu0]", b"[??:Not Found]", "no sensor or drive has the code"),
        ("[ü0]".encode(), b"[??:Not Found]", "no sensor or drive has the code"),
        (b"[u0", b"[u0:Not Found]", "a packet ends with ]"),
        (b"u0]", b"[u0:Not Found]", "a packet starts with ["),
        (b"[[x]", b"[x:Not Found]", "two characters"),
        (b"[\nx]", b"[?x:Not Found]", "no sensor or drive has the code"),
        (b"[,]", b"[:Not Found,:Not Found]", "an empty command"),
        (b"[u]", b"[u:Not Found]", "two characters"),
        (b"[ u0]", b"[ u:Not Found]", "no sensor or drive has the code"),
        (b"[w0:nan]", b"[w0:False]", "not a finite decimal number"),
        (b"[w0:inf]", b"[w0:False]", "not a finite decimal number"),
        (b"[w0:abc]", b"[w0:False]", "not a finite decimal number"),
        (b"[w0]", b"[w0:False]", "the value is missing"),
        (b"\xff\xfe\x00", struct.pack("<d", float("nan")), "no sensor or drive has the code"),
    ],
)
def test_a_bad_request_has_its_reply_and_a_line_and_the_next_is_answered(
    served: Serve, sent: bytes, reply: bytes, line: str
) -> None:
    running = served()
    assert running.ask(sent) == reply
    assert any(line in text for text in lines(running)), lines(running)
    assert running.ask(b"[m0]") == b"[m0:0.0]"
    assert not running.server.simulator.moving


def test_an_empty_packet_has_no_reply_but_a_line(served: Serve) -> None:
    running = served()
    running.send(b"[]")
    running.wait(lambda: any("gets no reply" in text for text in lines(running)))
    assert running.read() == b""
    assert running.ask(b"[m0]") == b"[m0:0.0]"


def test_ten_megabytes_without_an_end_are_refused_and_hold_nobody_up(served: Serve) -> None:
    running = served()
    with running.connect() as flood:
        flood.sendall(b"[" + b"x" * 1_000_000)
        for _ in range(9):
            flood.sendall(b"x" * 1_000_000)
            assert b"m0:0.0" in running.ask(b"[m0]")
    assert any(f"at most {MAX_REQUEST} bytes" in text for text in lines(running))
    assert running.ask(b"[m1]") == b"[m1:0.0]"


def test_a_packet_in_pieces_with_pauses_is_one_packet_and_others_are_served_meanwhile(served: Serve) -> None:
    running = served()
    with running.connect() as slow:
        for piece in (b"[m", b"0,", b"m1", b",m2"):
            slow.sendall(piece)
            assert running.ask(b"[m3]") == b"[m3:0.0]"
        slow.sendall(b"]")
        running.wait(lambda: running.answered == 7)
    assert running.ask(b"[g0]").startswith(b"[m0:0.0,m1:0.0,m2:0.0")


def test_several_packets_in_one_send_are_all_answered(served: Serve) -> None:
    running = served()
    running.send(b"[m0][m1]\r\n[m2,m3]")
    running.wait(lambda: running.answered == 4)
    assert running.read() == b"[m0:0.0,m1:0.0,m2:0.0,m3:0.0]"


def test_two_hundred_requests_that_nobody_reads_wait_for_who_reads_at_last(served: Serve) -> None:
    running = served()
    for _ in range(200):
        running.send(b"[m0]")
    running.wait(lambda: running.answered == 200)
    assert running.read_all() == b"[" + b",".join([b"m0:0.0"] * 200) + b"]"


def test_silent_connections_on_the_request_port_hold_nobody_up(served: Serve) -> None:
    running = served()
    with contextlib.ExitStack() as stack:
        for _ in range(20):
            stack.enter_context(running.connect())
        assert [running.ask(b"[m0]") for _ in range(20)] == [b"[m0:0.0]"] * 20
        running.wait(lambda: any("sent nothing yet" in text for text in running.notices))


def test_silent_connections_on_the_reply_port_end_and_hold_nobody_up(served: Serve) -> None:
    running = served()
    with contextlib.ExitStack() as stack:
        silent = [stack.enter_context(running.connect(PACKET_REPLIES.purpose)) for _ in range(20)]
        assert [each.recv(1) for each in silent] == [b""] * 20
        assert [running.ask(b"[m0]") for _ in range(20)] == [b"[m0:0.0]"] * 20


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("purpose", [PACKETS.purpose, PACKET_REPLIES.purpose])
@pytest.mark.parametrize("sent", [b"", b"[m1", b"[m1]"])
def test_resets_on_either_port_are_harmless(served: Serve, purpose: str, sent: bytes) -> None:
    running = served()
    for _ in range(10):
        rude = running.connect(purpose)
        rude.sendall(sent)
        rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        rude.close()
    reply = running.ask(b"[m0]")
    while b"m0:0.0" not in reply:  # what the rude one had asked for may be answered first
        assert b"m1" in reply
        reply = running.next_reply()
    if purpose == PACKETS.purpose:
        running.wait(lambda: any("broke off" in text for text in running.notices))
    assert not any("Error" in text for text in running.notices)


def exchange(running: Any, count: int, replies: list[bytes]) -> None:
    """A program at full speed: sends, and reads what there is."""
    for _ in range(count):
        running.send(b"[m0,u0]")
        if reply := running.read():
            replies.append(reply)


def test_two_clients_at_full_speed_get_one_reply_a_request(served: Serve) -> None:
    running = served()
    count = 60
    replies: list[bytes] = []
    clients = [threading.Thread(target=exchange, args=(running, count, replies)) for _ in range(2)]
    for client in clients:
        client.start()
    for client in clients:
        client.join()
    running.wait(lambda: running.answered == 2 * 2 * count)
    while reply := running.read():
        replies.append(reply)
    item = rb"m0:0\.0,u0:\d+\.\d+"
    assert all(re.fullmatch(rb"\[%b(,%b)*\]" % (item, item), reply) for reply in replies)
    assert sum(reply.count(b"m0") for reply in replies) == 2 * count


def test_a_program_that_reads_in_a_second_thread_while_it_writes_gets_every_reply(served: Serve) -> None:
    running = served()
    total, got = 200, 0
    deadline = time.monotonic() + 60

    def write() -> None:
        for _ in range(total):
            running.send(b"[m0]")

    writer = threading.Thread(target=write)
    writer.start()
    while got < total and time.monotonic() < deadline:
        got += running.read_all().count(b"m0")
    writer.join()
    assert got == total


def test_a_hundred_connections_at_once_are_all_answered(
    served: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simmer_tui.links.packet_link.DIRECT_DELAY", 60.0)
    running = served()
    with contextlib.ExitStack() as stack:
        senders = [stack.enter_context(running.connect()) for _ in range(100)]
        for sender in senders:
            sender.sendall(b"[m0]")
        running.wait(lambda: running.answered == 100)
    got = b""
    while more := running.read():
        got += more
    assert got.count(b"m0:0.0") == 100
    assert not any("closed" in text for text in running.notices)


@pytest.mark.slow
def test_a_hundred_reads_at_once_all_end(served: Serve) -> None:
    running = served()
    with contextlib.ExitStack() as stack:
        readers = [stack.enter_context(running.connect(PACKET_REPLIES.purpose)) for _ in range(100)]
        assert [reader.recv(1024) for reader in readers] == [b""] * 100
    assert running.ask(b"[m0]") == b"[m0:0.0]"


def test_it_starts_again_right_after_use(served: Serve) -> None:
    first = served()
    assert first.ask(b"[m0]") == b"[m0:0.0]"
    hanging = first.connect(), first.connect(PACKET_REPLIES.purpose)
    first.server.stop()
    ports = first.server.ports
    again = served(
        server__packet_port=ports[PACKETS.purpose], server__packet_reply_port=ports[PACKET_REPLIES.purpose]
    )
    assert again.server.ports[PACKETS.purpose] == ports[PACKETS.purpose]
    assert again.ask(b"[m0]") == b"[m0:0.0]"
    for each in hanging:
        each.close()


@pytest.mark.parametrize("name", ["packet_port", "packet_reply_port"])
def test_a_port_in_use_names_itself(served: Serve, name: str) -> None:
    option = "--" + name.replace("_", "-")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        with pytest.raises(PortError, match=rf"port {number} \(packet.*\) is in use .* {option} N"):
            served(**{f"server__{name}": number})


def test_every_byte_may_come(served: Serve) -> None:
    running = served()
    for start in range(0, 256, 16):
        running.send(bytes(range(start, start + 16)))
    running.wait(lambda: running.answered == 19)  # one with a comma, one with a pair of brackets
    while running.read():
        pass
    assert running.ask(b"[m0]") == b"[m0:0.0]"
