"""Bad input and broken clients: the next client is served, whatever the last one did."""

from __future__ import annotations

import math
import os
import socket
import subprocess
import sys
import textwrap
from collections.abc import Callable
from typing import Any

import pytest

from simmer_tui.errors import printable
from simmer_tui.links.backend import MOST_COMMANDS
from simmer_tui.run.events import MovementEnded

BAD_LINES = [
    b"",
    b"u",
    b"zz",
    b"d1-",
    b"d1-nan",
    b"\xff\xfe\xfd",
    b"x" * 5000,
    b"d1-\xd9\xa3",
    b"\r",
    b"u9",
    b"d1",
    b"d1-abc",
    b"d1-inf",
    b"d1--inf",
    b"d1-1e400",
    b"d1-2,5",
    b"d1-0x10",
    b"d1-1_000",
    b"\x00",
    b"\x00\x00\x00",
    b"d1-\x00",
    b"\x1b[2J[/x]",
    b"x" * 256,
    b"x" * 257,
]


def assert_next_is_served(serve: Any, served: Any) -> None:
    """A new client is let in, and the robot does what it says."""
    left = served.clients_left
    program = serve.program(served).open_commands()
    before = program.ask("o3")
    assert program.ask("d1-0.01") == math.inf
    assert program.ask("o3") > before
    program.close()
    served.wait(lambda: served.clients_left > left)


@pytest.mark.quick_cases(8)
@pytest.mark.parametrize("line", BAD_LINES, ids=lambda line: repr(line[:12]))
def test_a_bad_line_is_answered_nan_moves_nothing_and_is_told(serve: Any, line: bytes) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    program.send(line + b"\n")
    assert math.isnan(program.number())
    assert program.ask("o3") == 0.0, "exactly one reply came, and nothing moved"
    refused = next(event for event in served.events if getattr(event, "reason", ""))
    assert printable(refused.command.shown).isprintable()
    assert repr(refused).isprintable()
    program.close()
    assert_next_is_served(serve, served)


@pytest.mark.quick_cases(8)
@pytest.mark.parametrize("line", [line for line in BAD_LINES if line], ids=lambda line: repr(line[:12]))
def test_a_bad_bare_command_is_answered_nan(serve: Any, line: bytes) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    program.send(line)
    assert math.isnan(program.number())
    program.send(b"o3")
    assert program.number() == 0.0
    program.close()
    assert_next_is_served(serve, served)


@pytest.mark.parametrize("framed", [True, False], ids=["lines", "bare"])
def test_ten_megabytes_without_a_newline_are_answered_once(serve: Any, framed: bool) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    if framed:
        assert program.ask("o3") == 0.0
    program.send(b"a" * 10_000_000)
    assert math.isnan(program.number())
    program.send(b"\no3\n")
    assert program.number() == 0.0
    program.close()
    assert_next_is_served(serve, served)


def test_a_client_that_vanishes_in_mid_command(serve: Any) -> None:
    served = serve()
    for way in (b"d1-", b"u1\nd1-", b"x" * 300):
        for replies in (True, False):
            program = serve.program(served).open_commands()
            if replies:
                program.open_replies()
            program.send(way)
            program.vanish()
            assert_next_is_served(serve, served)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells that a socket is closed")
@pytest.mark.parametrize("motion", ["instant", "timed"])
def test_a_client_that_ends_in_a_wait_leaves_no_robot_that_drives_on(serve: Any, motion: str) -> None:
    served = serve(**{"motion.motion": motion})
    program = serve.program(served).open_commands()
    program.ask("vv-2;0;5")
    program.send(b"wt-3600\nwt-3600\n")
    program.close()
    served.wait_notice("disconnected")
    assert not served.server.engine.simulator.velocity.moves
    assert_next_is_served(serve, served)


def test_a_client_that_vanishes_in_mid_reply(serve: Any) -> None:
    served = serve()
    for replies in (True, False):
        program = serve.program(served)
        if replies:
            program.open_replies()
        program.open_commands()
        program.send(b"u1\n" * 5000)
        program.number()
        program.vanish()
        assert_next_is_served(serve, served)


@pytest.mark.slow
def test_commands_beyond_a_thousand_are_answered_busy_in_their_turn(serve: Any) -> None:
    served = serve(step_time=0.0005)
    program = serve.program(served).open_commands()
    program.send(b"c1\n" + b"d1-0\n" * 1499 + b"c1\n" * 500)
    replies = [program.number() for _ in range(2000)]
    done = [number for number in replies if not math.isnan(number)]
    assert math.isfinite(replies[0])
    assert MOST_COMMANDS <= len(done) < 1500
    assert set(replies[1:MOST_COMMANDS]) == {math.inf}, "all that has a place in the queue is done"
    served.wait_notice("commands wait already; further ones are answered busy")
    assert math.isfinite(program.ask("c1")), "the connection goes on"
    program.close()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("on_reply_port", [True, False])
def test_a_client_that_never_reads_is_dropped_with_a_line(serve: Any, on_reply_port: bool) -> None:
    served = serve()
    program = serve.program(served)
    address = ("127.0.0.1", served.server.ports["replies" if on_reply_port else "commands"])
    unread = socket.socket()
    unread.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    unread.connect(address)
    if on_reply_port:
        program.replies = unread
        program.open_commands()
    else:
        program.commands = unread
    with pytest.raises(ConnectionError):
        program.send(b"c1\n" * 3_000_000)
    served.wait_notice("does not read its replies")
    program.close()
    assert_next_is_served(serve, served)


def test_one_that_connects_to_the_reply_port_only(serve: Any) -> None:
    served = serve()
    waiting = serve.program(served).open_replies()
    waiting.close()
    assert_next_is_served(serve, served)
    for _ in range(50):
        serve.program(served).open_replies()
    program = serve.program(served).open_replies().open_commands()
    assert program.ask("d1-1") == math.inf
    program.close()
    assert_next_is_served(serve, served)


# -- more than one ---------------------------------------------------------------------------


def test_a_second_client_gets_a_clean_end_and_disturbs_nobody(serve: Any) -> None:
    served = serve()
    first, twin = serve.program(served).open_commands(), served.twin()
    assert first.ask("u1") == twin.execute("u1").reply
    second = serve.program(served).open_commands()
    second.send(b"d1-5\nu1\n" * 100)
    for _ in range(20):
        assert first.ask("u1") == twin.execute("u1").reply
    assert second.rest() == b"", "an end, and not a reset, though it had sent much"
    served.wait_notice("one program at a time")
    assert first.ask("d1-1") == twin.execute("d1-1").reply
    assert first.ask("o3") == twin.execute("o3").reply
    second.close()
    first.close()
    served.wait(lambda: served.clients_left == 1)
    assert_next_is_served(serve, served)


def test_one_that_comes_as_the_other_leaves_is_let_in(serve: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simmer_tui.links.binary_link.RETRY_DELAY", 10.0)  # this machine may be slow
    served = serve()
    first = serve.program(served).open_commands()
    first.ask("u1")
    for _ in range(50):
        second = serve.program(served).open_commands()
        first.close()
        assert second.ask("d1-0.01") == math.inf
        first = second
    assert not any("turned away" in text for text in served.notices)


def test_who_turns_away_lets_the_next_in(serve: Any) -> None:
    served = serve()
    first = serve.program(served).open_commands()
    first.ask("u1")
    crowd = [serve.program(served).open_commands() for _ in range(20)]
    assert [each.rest() for each in crowd] == [b""] * 20
    first.close()
    served.wait(lambda: served.clients_left == 1)
    assert_next_is_served(serve, served)


@pytest.mark.slow
def test_a_thousand_clients_one_after_the_other(serve: Any) -> None:
    served = serve()
    for count in range(1000):
        program = serve.program(served).open_commands()
        if count % 2:
            assert program.ask("d1-0.001") == math.inf, count
        program.close()
    # One that has sent nothing is no client.
    served.wait(lambda: served.clients_left == 500)
    assert not any("turned away" in text for text in served.notices)
    assert_next_is_served(serve, served)


# -- half an end -----------------------------------------------------------------------------


@pytest.mark.parametrize("request_bytes", [b"u1\n", b"u1", b"u1\r\n"])
def test_a_client_that_has_closed_its_side_gets_its_reply(serve: Any, request_bytes: bytes) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    assert program.commands is not None
    program.send(request_bytes)
    program.commands.shutdown(socket.SHUT_WR)
    assert 20.0 < program.number() < 50.0
    assert program.rest() == b""
    assert_next_is_served(serve, served)


def test_one_that_waits_for_its_last_reply_keeps_the_robot_till_then(serve: Any) -> None:
    served = serve(step_time=0.2)
    first = serve.program(served).open_commands()
    assert first.commands is not None
    first.send(b"d1-1\no3\n")
    first.commands.shutdown(socket.SHUT_WR)
    second = serve.program(served).open_commands()
    second.send(b"o3\n")
    assert first.number() == math.inf
    there = first.number()
    assert second.number() == there, "it waited its turn, and then was served"
    assert not any("turned away" in text for text in served.notices)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(("knows_closed", "replies"), [(True, 0), (False, 0), (True, 1), (False, 1)])
def test_the_reply_to_one_that_has_closed_goes_to_nobody_else(
    serve: Any, monkeypatch: pytest.MonkeyPatch, knows_closed: bool, replies: int
) -> None:
    if not knows_closed:  # as on Windows and macOS
        monkeypatch.setattr("simmer_tui.links.processes.ProcessLookup.has_closed", lambda *_: False)
    served = serve(step_time=0.2)
    first = serve.program(served).open_commands().open_replies()
    for _ in range(replies):
        first.ask("o3")
    first.send(b"d1-1\n")
    if not knows_closed:
        served.wait(lambda: any(isinstance(event, MovementEnded) for event in served.events))
    first.close()
    second = serve.program(served).open_commands().open_replies()
    assert 0.0 < second.ask("o3") < 2.0, "not the Infinity of the other's movement"
    assert second.ask("d1-0.01") == math.inf


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells that a socket is closed")
def test_one_waits_for_the_movement_of_a_client_that_has_closed(
    serve: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simmer_tui.links.binary_link._LONGEST_WAIT", 0.0)
    served = serve(step_time=0.2)
    first = serve.program(served).open_commands()
    first.send(b"d1-1\n")
    first.close()
    second = serve.program(served).open_commands()
    assert 0.0 < second.ask("o3") < 2.0
    assert not any("turned away" in text for text in served.notices)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells that a socket is closed")
def test_one_that_has_given_up_waiting_drives_no_more(serve: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simmer_tui.links.binary_link._LONGEST_WAIT", 0.0)
    served = serve(step_time=0.2)
    for program in (serve.program(served), serve.program(served)):
        program.open_commands().send(b"d1-1\n")
        program.close()
    served.wait_notice("turned away")
    third = serve.program(served).open_commands()
    assert 0.0 < third.ask("o3") < 1.5


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells that a socket is closed")
def test_the_reply_port_may_be_opened_first_while_one_that_has_closed_still_moves(serve: Any) -> None:
    served = serve(step_time=0.2)
    first = serve.program(served).open_commands()
    first.ask("o3")
    first.send(b"d1-1\n")
    first.close()
    second = serve.program(served).open_replies().open_commands()
    assert 0.0 < second.ask("o3") < 2.0


def test_a_client_that_leaves_with_commands_waiting_holds_nobody_up(serve: Any) -> None:
    served = serve(step_time=0.02)
    for vanish in (True, False):
        for replies in (True, False):
            program = serve.program(served)
            if replies:
                program.open_replies()
            program.open_commands()
            program.send(b"d1-0.001\n" * 500)
            program.number()
            program.vanish() if vanish else program.close()
            commands = len(served.events)
            next_one = serve.program(served).open_commands()
            assert next_one.ask("d1-0.001") == math.inf
            assert len(served.events) - commands < 100, "what it had sent was forgotten"
            next_one.close()


def test_step_time_holds_up_only_the_reply(serve: Any) -> None:
    served = serve(step_time=0.2)
    program = serve.program(served).open_commands()
    program.send(b"u1\n")
    late = serve.program(served).open_commands()
    assert late.rest() == b"", "turned away while the reply was still to come"
    served.wait_notice("turned away")
    assert 20.0 < program.number() < 50.0


def test_a_flood_of_newcomers_is_told_of_once_a_second(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    program.ask("u1")
    for _ in range(100):
        serve.program(served).open_commands().vanish()
    late = serve.program(served).open_commands()
    assert late.rest() == b"", "all before it have been turned away"
    told = sum("turned away" in text for text in served.notices)
    assert 1 <= told < 20, told
    assert program.ask("u1") > 0


def test_nothing_the_clients_did_was_a_fault_of_ours(serve: Any) -> None:
    served = serve()
    deeds: list[Callable[[Any], object]] = [
        lambda program: program.send(b"u1\n" * 100),
        lambda program: program.send(b"\xff" * 1000),
        # Once it is known: one that breaks off before is turned away, since nobody can say whose it was.
        lambda program: (program.ask("u1"), program.vanish()),
        lambda program: program.send(b"d1-"),
    ]
    for deed in deeds:
        left = served.clients_left
        program = serve.program(served).open_commands()
        deed(program)
        program.close()
        served.wait(lambda left=left: served.clients_left > left)
    assert all("connected" in text or "disconnected after" in text for text in served.notices), served.notices


# -- start and stop --------------------------------------------------------------------------


def test_a_restart_gets_the_same_ports_at_once(serve: Any) -> None:
    served = serve()
    ports = served.server.ports
    for _ in range(5):
        program = serve.program(served).open_replies().open_commands()
        assert program.ask("d1-1") == math.inf
        served.server.stop()  # the server closes first: its side lingers in TIME_WAIT
        assert program.rest() == b""
        served = serve(server__port=ports["commands"], server__reply_port=ports["replies"])
        assert served.server.ports["commands"] == ports["commands"]


def test_a_stopped_station_takes_no_more_clients_and_may_be_stopped_again(serve: Any) -> None:
    served = serve()
    served.server.stop()
    served.server.stop()
    with pytest.raises(ConnectionError):
        serve.program(served).open_commands()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the limit is a Unix one")
def test_out_of_file_descriptors_it_waits_and_goes_on() -> None:
    program = textwrap.dedent("""
        import math, resource, socket, struct, sys, threading
        from simmer_tui.config.loader import load
        from simmer_tui.config.sets import bundled_folder
        from simmer_tui.config.settings_file import Override
        from simmer_tui.links import ports
        from simmer_tui.live.server import Server

        ports.ACCEPT_PAUSE = 0.01
        server = Server(load(bundled_folder(), {"server.port": Override("--port", 0)}))
        server.start(lambda event: None)
        address = ("127.0.0.1", server.ports["commands"])
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
        held = []
        try:
            while True:
                held.append(socket.create_connection(address))
        except OSError:
            pass
        for each in held:
            each.close()
        while True:
            with socket.create_connection(address, 20) as client:
                client.sendall(b"d1-1\\n")
                reply = client.recv(8)
            if reply:
                break
        assert struct.unpack(">d", reply) == (math.inf,)
        server.stop()
    """)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=300, env=os.environ
    )
    assert (done.returncode, done.stderr) == (0, "")
