"""Mistakes of a new program with its connections are told once; one without mistakes is told nothing."""

from __future__ import annotations

import asyncio
import math
import socket
import struct
import sys
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config.dialects import COMMANDS, PACKET_REPLIES, PACKETS, REPLIES
from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.links import binary_link, connection_doctor
from simmer_tui.links.ports import Listener
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim import Simulator

ONLY_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux says what was read")


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Advice that comes after seconds of waiting comes at once."""
    monkeypatch.setattr(binary_link, "LONE_LIMIT", 0.02)
    monkeypatch.setattr(connection_doctor, "CHECK_TIMES", (0.02, 0.1))


def faults(served: Any) -> list[str]:
    return [
        event.text
        for event in tuple(served.events)
        if isinstance(event, Notice) and event.kind is NoticeKind.FAULT and event.advice
    ]


# -- one of the pair of ports --------------------------------------------------------------------------


@pytest.mark.usefixtures("at_once")
def test_a_program_on_the_reply_port_alone_is_told_the_command_port(serve: Any) -> None:
    served = serve()
    ports = served.server.ports
    serve.program(served).open_replies()
    served.wait_notice(
        f"is connected only to the reply port {ports[REPLIES.purpose]}: "
        f"connect to the command port {ports[COMMANDS.purpose]} too"
    )


@pytest.mark.parametrize("both", [False, True])
def test_commands_on_the_reply_port_are_told(serve: Any, both: bool) -> None:
    served = serve()
    program = serve.program(served).open_replies()
    if both:
        program.open_commands()
        served.wait_notice("connected")
    program.replies.sendall(b"u1\n")
    served.wait_notice(f"send commands to port {served.server.ports[COMMANDS.purpose]}")


def test_what_a_driving_program_sends_to_the_reply_port_is_not_told(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_replies().open_commands()
    assert program.ask("u1") > 0
    program.replies.sendall(b"thanks")
    assert program.ask("u1") > 0
    assert faults(served) == []


def test_a_reply_port_that_is_opened_too_late_is_told(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    assert program.ask("u1") > 0
    program.open_replies()
    served.wait_notice("connect to both before the first command")


def test_a_second_programs_reply_port_is_no_mistake_of_the_first(serve: Any) -> None:
    served = serve()
    first = serve.program(served).open_commands()
    assert first.ask("u1") > 0
    serve.program(served).open_commands().open_replies()
    served.wait_notice("it belongs to no client")
    assert faults(served) == []


@ONLY_LINUX
@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("separate", [False, True])
def test_a_program_that_waits_elsewhere_for_its_reply_is_told(serve: Any, separate: bool) -> None:
    served = serve()
    program = serve.program(served)
    if separate:
        program.open_replies()
    program.open_commands()
    program.send(b"u1\n")  # and reads it nowhere
    commands, replies = (served.server.ports[port.purpose] for port in (COMMANDS, REPLIES))
    where = f"it came on port {replies}" if separate else f"it came back on port {commands}"
    served.wait_notice(f"waits and has not read its reply: {where}")


@pytest.mark.parametrize("separate", [False, True])
def test_a_program_that_leaves_with_its_first_reply_unread_is_told(serve: Any, separate: bool) -> None:
    served = serve()
    program = serve.program(served)
    if separate:
        program.open_replies()
    program.open_commands()
    program.send(b"u1\n")
    source = program.replies or program.commands
    assert source.recv(1, socket.MSG_PEEK)  # it is there
    if program.replies is not None:
        program.replies.close()
    program.commands.close()
    served.wait_notice("left without reading its first reply")


def test_a_program_of_one_command_is_told_nothing(serve: Any) -> None:
    served = serve()
    for _ in range(3):
        program = serve.program(served).open_commands()
        assert program.ask("u1") > 0
        left = served.clients_left
        program.close()
        served.wait(lambda left=left: served.clients_left > left)
    assert faults(served) == []


# -- the form of replies ---------------------------------------------------------------------------------


@ONLY_LINUX
@pytest.mark.usefixtures("at_once")
def test_replies_of_another_width_are_told_while_the_program_waits(serve: Any) -> None:
    served = serve()
    program = serve.program(served, ">f").open_commands()
    program.ask("u1")  # half of it
    served.wait_notice("has read a part of its reply: replies here are 8 bytes, big-endian; --reply-format")


@pytest.mark.usefixtures("at_once")
def test_a_program_that_waits_for_more_than_its_first_reply_is_told_an_unusual_form(serve: Any) -> None:
    served = serve(server__reply_format="float32")
    program = serve.program(served, ">f").open_commands()
    program.ask("u1")
    program.commands.settimeout(0.05)
    with pytest.raises(TimeoutError):
        program.commands.recv(4)  # the other half of eight bytes
    program.close()
    served.wait_notice("waited after its first reply and left: replies here are 4 bytes, big-endian")


@pytest.mark.parametrize("form", [{"reply_format": "float32"}, {"byte_order": "little"}])
def test_a_program_of_one_reading_in_an_unusual_form_is_told_nothing(
    serve: Any, form: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_doctor, "CHECK_TIMES", (60.0,))  # a busy machine may take long to close
    served = serve(**{f"server__{name}": value for name, value in form.items()})
    for _ in range(3):
        program = serve.program(served, ">f" if "reply_format" in form else "<d").open_commands()
        assert program.ask("u1") > 0
        left = served.clients_left
        program.close()
        served.wait(lambda left=left: served.clients_left > left)
    assert faults(served) == []


@pytest.mark.parametrize("value", ["4.2e-310", "nan", "-inf", "3e200"])
def test_a_nonsense_value_after_the_first_reply_is_told(serve: Any, value: str) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    program.ask("u1")
    program.ask(f"d1-{value}")
    served.wait_notice("replies here are 8 bytes, big-endian; --reply-format and --byte-order change that")
    program.ask(f"d1-{value}")
    program.ask("u1")
    assert sum("replies here" in text for text in faults(served)) == 1


def test_a_reply_in_the_wrong_byte_order_leads_to_such_a_value(serve: Any) -> None:
    served = serve()
    program = serve.program(served, "<d").open_commands()
    wrong = program.ask("d1-1")
    program.ask(f"d1-{wrong!r}")
    served.wait_notice("replies here are 8 bytes, big-endian")


# -- what is sent ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sent", "told"),
    [
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", "which is no web server"),
        (b"[u0,u1]\n", "takes lines; '[u0,u1]' is a packet: start with --listeners packets"),
        (b"[u0]", "takes lines; '[u0]' is a packet"),
        (b'{"x": 1, "y": 2, "heading": 0}\n', "beliefs go to port"),
        (b"u0\n", "the program asks for u0, but codes of this set begin at 1: u1"),
        (b"u1u2", "'u1u2' came without a line end between its commands"),
        (b"d1-3d1-2", "'d1-3d1-2' came without a line end between its commands"),
        (b"u1vv-0;0;0", "'u1vv-0;0;0' came without a line end between its commands"),
    ],
)
def test_what_a_program_sends_shows_its_mistake_once(serve: Any, sent: bytes, told: str) -> None:
    served = serve()
    for _ in range(2):
        program = serve.program(served).open_commands()
        program.send(sent)
        program.number()
        left = served.clients_left
        program.close()
        served.wait(lambda left=left: served.clients_left > left)
    served.wait_notice(told)
    assert sum(told in text for text in faults(served)) == 1


@pytest.mark.parametrize(("asked", "told"), [("u0", False), ("g0", True)])
def test_a_code_0_that_is_disabled_is_no_mistake_in_counting(asked: str, told: bool) -> None:
    spec = load(find_set("simmer-python")).simulation
    sensors = [replace(each, enabled=False) if each.code == "u0" else each for each in spec.sensors]
    sensors = [each if each.code != "g0" else replace(each, code="g1") for each in sensors]
    engine, notices = Engine(Simulator(replace(spec, sensors=tuple(sensors)), 1)), []
    engine.watch(notices.append)

    async def ask() -> None:
        doctor = connection_doctor.ConnectionDoctor(engine, {"commands": Listener(9000, ())})
        doctor.refused(engine.simulator.execute(asked), 9000)

    asyncio.run(ask())
    assert any("begin at 1" in each.text for each in notices) is told


def test_packets_on_the_line_port_are_told_their_own_port(serve: Any) -> None:
    served = serve(server__listeners=("binary", "packets"))
    program = serve.program(served).open_commands()
    assert math.isnan(program.ask("[u0]"))
    served.wait_notice(f"is a packet: send it to port {served.server.ports[PACKETS.purpose]}")


def test_a_line_without_an_end_is_told(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    assert program.ask("u1") > 0
    program.send(b"u2")
    served.wait_notice("sent 'u2' without a line end and waits")
    program.send(b"\n")
    assert program.number() > 0


def test_lines_in_pieces_and_bare_commands_are_no_mistake(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    for bare in (b"u1", b"d1-1e-2", b"r1--4"):
        program.send(bare)
        program.number()
    assert program.ask("u1") > 0
    program.send(b"u")
    program.send(b"2\n")
    assert program.number() > 0
    assert faults(served) == []


# -- the packet port -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sent", "told"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "which is no web server"),
        (b"u1\n", "takes packets such as [u0]; 'u1' is a line: send lines to port"),
        (b"[u0]", "the program asks for u0, but codes of this set begin at 1: u1"),
    ],
)
def test_what_is_wrong_on_the_packet_port_is_told(serve: Any, sent: bytes, told: str) -> None:
    served = serve(server__listeners=("binary", "packets"))
    with socket.create_connection(("127.0.0.1", served.server.ports[PACKETS.purpose]), 20) as sender:
        sender.sendall(sent)
    served.wait_notice(told)
    if b"u1" in sent:
        assert str(served.server.ports[COMMANDS.purpose]) in "".join(faults(served))


def test_the_older_packets_without_brackets_are_no_mistake(serve: Any) -> None:
    served = serve(server__listeners=("packets",))
    ports = served.server.ports
    with socket.create_connection(("127.0.0.1", ports[PACKETS.purpose]), 20) as sender:
        sender.sendall(b"u1,u2")
    with socket.create_connection(("127.0.0.1", ports[PACKET_REPLIES.purpose]), 20) as reader:
        assert len(reader.recv(16)) in (0, struct.calcsize(">dd"))
    assert faults(served) == []
