"""Requests of the connection-per-message dialects, byte by byte."""

from __future__ import annotations

import itertools
import tracemalloc

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from simmer_tui.links.protocol.packets import (
    GRACE,
    LONGEST_COMMAND,
    MAX_COMMANDS,
    MAX_REQUEST,
    Request,
    RequestReader,
    RequestStyle,
)
from simmer_tui.sim.command import parse_value


def read(data: bytes) -> list[Request]:
    """The requests of a connection that sends `data` and closes."""
    reader = RequestReader()
    return reader.receive(data) + reader.end()


def codes_and_values(request: Request) -> list[tuple[str, str | None]]:
    return [(command.code, command.argument) for command in request.commands]


def test_a_packet_is_complete_at_its_closing_bracket() -> None:
    (request,) = RequestReader().receive(b"[u0]")
    assert request.dialect is RequestStyle.FRAMED
    assert codes_and_values(request) == [("u0", None)]


@pytest.mark.parametrize(
    ("packet", "expected"),
    [
        (b"[w0:36]", [("w0", "36")]),
        (b"[w0-36]", [("w0", "36")]),
        (b"[r0:-90]", [("r0", "-90")]),
        (b"[u0,u1,w0:3]", [("u0", None), ("u1", None), ("w0", "3")]),
        (b"[u0xyz]", [("u0", "yz")]),
        (b"[w0:]", [("w0", "")]),
        (b"[xx]", [("xx", None)]),
        (b"[ u0]", [(" u", "")]),
        (b"[\nx]", [("\nx", None)]),
        (b"[u0\xff\xfe]", [("u0", "\xfe")]),
        (b"[\xc3\xa9]", [("\xc3\xa9", None)]),
    ],
)
def test_code_is_two_characters_the_third_is_ignored_the_rest_is_the_value(
    packet: bytes, expected: list[tuple[str, str | None]]
) -> None:
    (request,) = read(packet)
    assert codes_and_values(request) == expected
    assert not any(command.problem for command in request.commands)


@pytest.mark.parametrize("text", ["", "nan", "inf", "abc", "1_0", "0x10"])
def test_a_blank_or_wordy_value_is_no_number(text: str) -> None:
    (request,) = read(b"[w0:" + text.encode() + b"]")
    assert isinstance(parse_value(request.commands[0].argument), str)


def test_a_request_without_brackets_ends_when_the_sender_closes() -> None:
    reader = RequestReader()
    assert reader.receive(b"u0,w0-36,r0--90") == []
    (request,) = reader.end()
    assert request.dialect is RequestStyle.LEGACY
    assert codes_and_values(request) == [("u0", None), ("w0", "36"), ("r0", "-90")]
    assert reader.end() == []


def test_a_request_without_brackets_ends_after_a_short_silence() -> None:
    reader = RequestReader()
    reader.receive(b"u0")
    assert reader.idle_timeout == GRACE
    assert [codes_and_values(request) for request in reader.silence()] == [[("u0", None)]]
    assert reader.idle_timeout is None
    assert reader.silence() == []


def test_a_line_typed_by_hand_is_a_request_without_its_line_end() -> None:
    (request,) = read(b"w0-3\r\n")
    assert codes_and_values(request) == [("w0", "3")]


def test_a_line_end_after_a_packet_is_not_a_request() -> None:
    reader = RequestReader()
    assert len(reader.receive(b"[u0]\r\n")) == 1
    assert reader.idle_timeout is None
    assert not reader.unfinished
    assert reader.end() == []


def test_silence_does_not_end_a_packet_that_is_still_open() -> None:
    reader = RequestReader()
    reader.receive(b"[u0,")
    assert reader.idle_timeout is None
    assert reader.unfinished
    assert reader.silence() == []
    (request,) = reader.receive(b"u1]")
    assert codes_and_values(request) == [("u0", None), ("u1", None)]
    assert not reader.unfinished


def test_packets_sent_back_to_back_are_requests_in_order() -> None:
    requests = RequestReader().receive(b"[u0][u1,i0]\n[w0:1]")
    assert [codes_and_values(request) for request in requests] == [
        [("u0", None)],
        [("u1", None), ("i0", None)],
        [("w0", "1")],
    ]


def test_a_packet_ends_the_text_without_brackets_before_it() -> None:
    requests = read(b"u0[u1]")
    assert [request.dialect for request in requests] == [RequestStyle.LEGACY, RequestStyle.FRAMED]
    assert [codes_and_values(request) for request in requests] == [[("u0", None)], [("u1", None)]]


@pytest.mark.parametrize("data", [b"[]", b"]", b"["])
def test_brackets_around_nothing_are_a_request_without_commands(data: bytes) -> None:
    assert read(data) == [Request(RequestStyle.FRAMED)]


@pytest.mark.parametrize("data", [b"", b"\r\n", b"  "])
def test_nothing_but_blanks_is_no_request(data: bytes) -> None:
    assert read(data) == []


@pytest.mark.parametrize(
    ("data", "code", "word"),
    [
        (b"[u0", "u0", "ends with ]"),
        (b"[w0:36", "w0", "ends with ]"),
        (b"u0]", "u0", "starts with ["),
        (b"[u]", "u", "two characters"),
        (b"u", "u", "two characters"),
        (b"[[x]", "x", "two characters"),
        (b"[" + b"u" * (LONGEST_COMMAND + 1) + b"]", "uu", "at most 256 bytes"),
        (b"[" + b"u0," * MAX_COMMANDS + b"u0]", "u0", "at most 1000 commands"),
        (b"u0" * MAX_REQUEST, "u0", "at most 65536 bytes"),
    ],
)
def test_a_malformed_request_is_one_command_with_its_problem(data: bytes, code: str, word: str) -> None:
    (request,) = read(data)
    (command,) = request.commands
    assert command.code == code
    assert word in command.problem
    assert len(command.text) <= LONGEST_COMMAND


def test_two_commas_leave_an_empty_command_in_its_place() -> None:
    (request,) = read(b"[u0,,u1]")
    assert [command.problem for command in request.commands] == ["", "an empty command", ""]


def test_a_packet_left_open_is_refused_when_the_next_one_opens() -> None:
    first, second = read(b"[w0:36[u0]")
    assert first.commands[0].problem == "a packet ends with ]"
    assert codes_and_values(second) == [("u0", None)]
    assert not second.commands[0].problem


@pytest.mark.parametrize("opening", [b"[", b""])
def test_ten_megabytes_without_an_end_are_answered_once_and_the_next_packet_is_served(opening: bytes) -> None:
    reader, piece = RequestReader(), b"u" * MAX_REQUEST
    tracemalloc.start()
    try:
        requests = reader.receive(opening)
        for _ in range(160):
            requests += reader.receive(piece)
        held = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert held < 2 * MAX_REQUEST
    assert [request.commands[0].problem for request in requests] == ["a request has at most 65536 bytes"]
    assert reader.unfinished
    (request,) = reader.receive(b"u[u0]")
    assert codes_and_values(request) == [("u0", None)]
    assert not request.commands[0].problem


def test_the_tail_of_an_overlong_request_ends_with_its_bracket_or_with_silence() -> None:
    framed = RequestReader()
    framed.receive(b"[" + b"u" * (MAX_REQUEST + 1))
    assert framed.idle_timeout is None
    assert framed.receive(b"tail]") == []
    assert len(framed.receive(b"[u0]")) == 1
    legacy = RequestReader()
    legacy.receive(b"u" * (MAX_REQUEST + 1))
    assert legacy.idle_timeout == GRACE
    assert legacy.silence() == []
    legacy.receive(b"u0")
    assert [codes_and_values(request) for request in legacy.silence()] == [[("u0", None)]]


PIECES = st.lists(
    st.sampled_from([b"[", b"]", b",", b"u0", b"w0:3", b"r0--90", b"\n", b" ", b"\xff", b"\x00"])
    | st.binary(max_size=6),
    max_size=30,
)


@settings(max_examples=15)
@given(pieces=PIECES, cuts=st.lists(st.integers(0, 200), max_size=12))
@example(pieces=[b"[", b"u0" * MAX_REQUEST, b"][u0]"], cuts=[1, 2, MAX_REQUEST])
def test_how_bytes_are_cut_into_sends_changes_nothing(pieces: list[bytes], cuts: list[int]) -> None:
    data = b"".join(pieces)
    whole = read(data)
    reader = RequestReader()
    requests: list[Request] = []
    places = sorted({0, *(min(cut, len(data)) for cut in cuts), len(data)})
    for start, stop in itertools.pairwise(places):
        requests += reader.receive(data[start:stop])
    assert requests + reader.end() == whole


@given(data=st.binary(max_size=80))
def test_any_bytes_leave_the_next_packet_served(data: bytes) -> None:
    reader = RequestReader()
    reader.receive(data)
    reader.silence()
    *_, last = reader.receive(b"[u0]")
    assert codes_and_values(last) == [("u0", None)]
    assert last.dialect is RequestStyle.FRAMED


@pytest.mark.parametrize("data", [b"[xx]", b"[xx:3]", b"[u0,xx]", b"xx", b"u0,xx"])
def test_xx_is_the_command_that_stops(data: bytes) -> None:
    (request,) = read(data)
    assert [command.stops for command in request.commands][-1]
    assert sum(command.stops for command in request.commands) == 1


@pytest.mark.parametrize(
    "data", [b"[x]", b"[x", b"[xx", b"[ xx]", b"[Xx]", b"[xx" + b"x" * LONGEST_COMMAND + b"]"]
)
def test_nothing_else_stops(data: bytes) -> None:
    assert not any(command.stops for request in read(data) for command in request.commands)


@pytest.mark.parametrize("data", [b"[u0,w0:36]", b"[u0,,\xff]", b"u0,w0-36", b"[" + b"x" * 300 + b",u0]"])
def test_a_request_keeps_its_bytes_for_a_robot_to_be_passed_on_to(data: bytes) -> None:
    (request,) = read(data)
    assert request.data == data


@pytest.mark.parametrize(
    "data", [b"[u0", b"u0]", b"[]", b"[" + b"x" * MAX_REQUEST + b"x]", b"," * MAX_COMMANDS]
)
def test_what_is_no_whole_request_has_no_bytes_to_be_passed_on(data: bytes) -> None:
    assert [request.data for request in read(data)] == [b""]
