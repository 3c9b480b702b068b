"""Replies and who gets them: framing, formats and routes over real sockets."""

from __future__ import annotations

import math
import socket
from typing import Any

import pytest


def test_replies_are_those_of_the_simulator_bit_for_bit(serve: Any) -> None:
    served = serve()
    program, twin = serve.program(served).open_commands(), served.twin()
    texts = ["u1", "d1-3", "u1", "o1", "r1--45", "g1", "c1", "i1", "zz", "", "w1-100", "t1", "u2-ignored"]
    for text in texts:
        expected, got = twin.execute(text).reply, program.ask(text)
        assert got == expected or (math.isnan(got) and math.isnan(expected)), text


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize(
    ("reply_format", "byte_order", "layout"),
    [
        ("float64", "big", ">d"),
        ("float64", "little", "<d"),
        ("float32", "big", ">f"),
        ("float32", "little", "<f"),
    ],
)
@pytest.mark.parametrize("on_reply_port", [True, False])
def test_every_format_of_reply(
    serve: Any, reply_format: str, byte_order: str, layout: str, on_reply_port: bool
) -> None:
    served = serve(server__reply_format=reply_format, server__byte_order=byte_order)
    program = serve.program(served, layout).open_commands()
    if on_reply_port:
        program.open_replies()
    assert program.ask("u1") == pytest.approx(served.twin().execute("u1").reply, rel=1e-6)
    assert program.ask("d1-1") == math.inf
    assert math.isnan(program.ask("d1-"))


# -- framing ---------------------------------------------------------------------------------


def test_bare_commands_one_a_write(serve: Any) -> None:
    served = serve()
    program, twin = serve.program(served).open_replies().open_commands(), served.twin()
    for text in ("u1", "d1-2", "u3", "r1-90", "o1", "d1-"):
        program.send(text.encode())
        expected, got = twin.execute(text).reply, program.number()
        assert got == expected or (math.isnan(got) and math.isnan(expected)), text


def test_a_newline_right_after_a_bare_command_belongs_to_it(serve: Any) -> None:
    served = serve()
    program, twin = serve.program(served).open_commands(), served.twin()
    program.send(b"u1")
    assert program.number() == twin.execute("u1").reply
    program.send(b"\n")
    assert program.ask("u1") == twin.execute("u1").reply, "no reply of its own came for the newline"


def test_a_command_over_several_segments(serve: Any) -> None:
    served = serve()
    program, twin = serve.program(served).open_commands(), served.twin()
    assert program.commands is not None
    program.commands.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    assert program.ask("u1") == twin.execute("u1").reply
    for byte in b"d1-3\r\nu1\r\n":
        program.send(bytes([byte]))
    assert program.number() == twin.execute("d1-3").reply
    assert program.number() == twin.execute("u1").reply


@pytest.mark.slow
@pytest.mark.parametrize("ending", [b"\r\n", b"\n"])
def test_a_thousand_commands_in_one_segment(serve: Any, ending: bytes) -> None:
    served = serve()
    program, twin = serve.program(served).open_commands(), served.twin()
    program.send((b"d1-0.01" + ending + b"u1" + ending) * 500)
    for _ in range(500):
        assert program.number() == twin.execute("d1-0.01").reply
        assert program.number() == twin.execute("u1").reply


def test_the_grace_is_a_setting(serve: Any) -> None:
    served = serve(server__grace=10.0)
    program = serve.program(served).open_commands()
    for piece in (b"d1", b"-", b"2"):
        program.send(piece)
    program.send(b"\n")
    assert program.number() == math.inf
    assert program.ask("o3") == pytest.approx(2.0, rel=0.2)


# -- the reply port --------------------------------------------------------------------------


@pytest.mark.parametrize("first", ["replies", "commands"])
def test_replies_go_to_the_reply_port_in_whichever_order_both_were_opened(serve: Any, first: str) -> None:
    served = serve()
    program = serve.program(served)
    if first == "replies":
        program.open_replies().open_commands()
    else:
        program.open_commands().open_replies()
    for _ in range(5):
        assert 20.0 < program.ask("u1") < 50.0
    assert program.commands is not None
    program.commands.setblocking(False)
    with pytest.raises(BlockingIOError):
        program.commands.recv(1)


def test_without_a_reply_connection_replies_come_back_the_same_way(serve: Any) -> None:
    program = serve.program(serve()).open_commands()
    assert 20.0 < program.ask("u1") < 50.0
    assert program.ask("d1-1") == math.inf


def test_a_reply_connection_after_the_first_reply_is_closed(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    program.ask("u1")
    late = serve.program(served).open_replies()
    assert late.replies is not None
    assert late.replies.recv(8) == b""
    served.wait_notice("belongs to no client")
    assert program.ask("d1-1") == math.inf, "the client is not disturbed"


def test_a_reply_connection_that_waits_alone_goes_to_the_next_client(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_replies()
    other = serve.program(served).open_commands()
    other.send(b"u1\n")
    assert 20.0 < program.number() < 50.0


def test_of_two_that_wait_the_newer_is_taken_and_the_older_closed(serve: Any) -> None:
    served = serve()
    stale = serve.program(served).open_replies()
    program = serve.program(served).open_replies().open_commands()
    assert program.ask("d1-1") == math.inf
    assert stale.replies is not None
    assert stale.replies.recv(8) == b""


def test_a_reply_connection_that_has_gone_is_not_waited_for(serve: Any) -> None:
    served = serve()
    for vanish in (False, True):
        gone = serve.program(served).open_replies()
        gone.vanish() if vanish else gone.close()
        program = serve.program(served).open_commands()
        assert program.ask("d1-1") == math.inf
        program.close()
        served.wait(lambda: served.clients_left == 1 + vanish)  # noqa: B023 - waited for here


@pytest.mark.parametrize("ended", ["commands", "replies"])
def test_a_pair_ends_together(serve: Any, ended: str) -> None:
    served = serve()
    program = serve.program(served).open_replies().open_commands()
    program.ask("u1")
    assert program.commands is not None
    assert program.replies is not None
    closed, other = (
        (program.commands, program.replies) if ended == "commands" else (program.replies, program.commands)
    )
    closed.close()
    assert other.recv(8) == b""
    served.wait(lambda: served.clients_left == 1)
    assert serve.program(served).open_commands().ask("d1-1") == math.inf


def test_pairs_follow_one_another(serve: Any) -> None:
    served = serve()
    for count in range(30):
        program = serve.program(served)
        if count % 3:
            program.open_replies()
        program.open_commands()
        assert program.ask("d1-0.1") == math.inf, count
        program.close()


def test_what_a_client_sends_on_the_reply_port_is_ignored(serve: Any) -> None:
    program = serve.program(serve()).open_replies().open_commands()
    assert program.replies is not None
    program.replies.sendall(b"d1-5\n" * 1000)
    assert program.ask("o3") == 0.0


# -- addresses -------------------------------------------------------------------------------


def has_ipv6() -> bool:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


@pytest.mark.skipif(not has_ipv6(), reason="no ::1 on this machine")
def test_localhost_is_served_over_ipv6_too(serve: Any) -> None:
    program = serve.program(serve()).open_replies("::1").open_commands("::1")
    assert program.ask("d1-1") == math.inf


def test_a_pair_may_come_over_both_addresses(serve: Any) -> None:
    host = "::1" if has_ipv6() else "127.0.0.1"
    program = serve.program(serve()).open_replies(host).open_commands()
    assert program.ask("d1-1") == math.inf


def test_a_reply_is_sent_whole(serve: Any) -> None:
    program = serve.program(serve()).open_commands()
    assert program.commands is not None
    for _ in range(200):
        program.send(b"u1\n")
        assert len(program.commands.recv(64)) == 8
