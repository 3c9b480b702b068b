"""The binary dialects without sockets: bytes in, commands out, one number back."""

from __future__ import annotations

import math
import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.errors import printable
from simmer_tui.links.protocol.binary import GRACE, LONGEST_COMMAND, SKIP_GRACE, CommandReader, NumberEncoder
from simmer_tui.sim import Command, CommandResult, Pose, Status, parse_command

calm = settings(max_examples=15, deadline=None, derandomize=True)
line = st.one_of(
    st.sampled_from([b"", b"u1", b"d1-2", b"r1--45", b"u", b"\r", b" u1 ", b"\x00\xff", b"d1-1e400"]),
    st.binary(max_size=12).map(lambda raw: raw.replace(b"\n", b"")),
    st.sampled_from([255, 256, 257, 258, 700]).map(lambda size: b"x" * size),
    st.sampled_from([255, 256, 257]).map(lambda size: b"x" * size + b"\r"),
)
streams = st.lists(line, min_size=1, max_size=12).map(lambda lines: b"".join(each + b"\n" for each in lines))


def texts(commands: list[Command]) -> list[str]:
    return [command.text for command in commands]


def replied(number: float) -> CommandResult:
    """The result of a command with this reply."""
    here = Pose(0.0, 0.0, 0.0)
    return CommandResult(1, 0.0, parse_command("u1"), Status.READING, number, here, here)


def fed(reader: CommandReader, data: bytes, cuts: list[int]) -> list[Command]:
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [command for begin, end in pairwise(places) for command in reader.receive(data[begin:end])]


# -- lines -----------------------------------------------------------------------------------


def test_lines_are_commands() -> None:
    commands = CommandReader().receive(b"u1\nd1-2.4\r\nr1--45\n")
    assert [(c.code, c.argument) for c in commands] == [("u1", None), ("d1", "2.4"), ("r1", "-45")]


@pytest.mark.parametrize("separator", "-:= ,_/x")
def test_the_third_character_may_be_any_separator(separator: str) -> None:
    (command,) = CommandReader().receive(f"d1{separator}2\n".encode())
    assert (command.code, command.argument) == ("d1", "2")


def test_the_end_of_a_line_is_not_part_of_the_command() -> None:
    assert texts(CommandReader().receive(b"u1\r\nu2\n\r\nu3\r\n")) == ["u1", "u2", "", "u3"]


@calm
@given(data=streams, cuts=st.lists(st.integers(0, 4000), max_size=8))
def test_any_chunking_of_lines_gives_the_same_commands(data: bytes, cuts: list[int]) -> None:
    whole = CommandReader().receive(data)
    assert fed(CommandReader(), data, cuts) == whole
    assert fed(CommandReader(), data, list(range(len(data)))) == whole
    assert len(whole) == data.count(b"\n"), "one answer a line"


@calm
@given(data=streams, tail=st.sampled_from([b"d1-", b"u", b"x" * 256]))
def test_the_beginning_of_a_next_line_waits_for_its_end(data: bytes, tail: bytes) -> None:
    reader = CommandReader()
    assert reader.receive(data + tail) == CommandReader().receive(data)
    assert reader.idle_timeout is None, "a line may pause as long as it likes"
    assert texts(reader.receive(b"5\n")) == [f"{tail.decode()}5"[:LONGEST_COMMAND]]


@calm
@given(data=st.binary(max_size=3000), cuts=st.lists(st.integers(0, 3000), max_size=8))
def test_no_bytes_raise_or_pile_up(data: bytes, cuts: list[int]) -> None:
    reader = CommandReader()
    for command in fed(reader, data, cuts):
        assert len(command.text) <= LONGEST_COMMAND
        assert command.shown.isprintable()
        assert command.shown.isascii()
    for command in reader.silence() + reader.end():
        assert len(command.text) <= LONGEST_COMMAND
    assert reader.end() == []


@pytest.mark.parametrize(
    ("sent", "problem"),
    [
        (b"\n", "an empty command"),
        (b"\r\n", "an empty command"),
        (b" \t\n", "an empty command"),
        (b"u\n", "a code has two characters"),
        (b"\x00\n", "a code has two characters"),
    ],
)
def test_what_cannot_be_a_command_says_why(sent: bytes, problem: str) -> None:
    (command,) = CommandReader().receive(sent)
    assert command.problem == problem


def test_nul_and_other_bytes_are_shown_escaped() -> None:
    (command,) = CommandReader().receive(b"\x00\xff\x1b[31m\n")
    assert printable(command.shown) == r"\x00\xff\x1b[31m"


def test_a_command_begun_in_the_bytes_that_end_another_waits_for_its_own_end() -> None:
    reader = CommandReader()
    assert texts(reader.receive(b"u1\n")) == ["u1"]
    assert texts(reader.receive(b"u2\nd")) == ["u2"]
    assert texts(reader.receive(b"1-3\n")) == ["d1-3"]


# -- bare commands ---------------------------------------------------------------------------


def test_bytes_alone_are_a_command_after_the_grace() -> None:
    reader = CommandReader()
    assert reader.idle_timeout is None
    assert reader.receive(b"d1-2") == []
    assert reader.idle_timeout == GRACE
    assert texts(reader.silence()) == ["d1-2"]
    assert reader.idle_timeout is None
    assert reader.silence() == []


def test_the_grace_is_as_given() -> None:
    reader = CommandReader(grace=0.1)
    reader.receive(b"u1")
    assert reader.idle_timeout == 0.1


def test_segments_within_the_grace_are_one_command() -> None:
    reader = CommandReader()
    assert reader.receive(b"d1") + reader.receive(b"-1") + reader.receive(b"2") == []
    assert texts(reader.silence()) == ["d1-12"]


@pytest.mark.parametrize("newline", [[b"\n"], [b"\r\n"], [b"\r", b"\n"], [b"\nu1\n"]])
def test_a_newline_right_after_a_bare_command_belongs_to_it(newline: list[bytes]) -> None:
    reader = CommandReader()
    reader.receive(b"d1-2")
    reader.silence()
    rest = [command for piece in newline for command in reader.receive(piece)]
    assert texts(rest) == (["u1"] if b"u1" in newline[0] else [])
    reader.receive(b"u2")
    assert reader.idle_timeout is None, "the connection is line-framed from now on"
    assert texts(reader.receive(b"\n")) == ["u2"]


def test_a_second_newline_is_an_empty_line() -> None:
    reader = CommandReader()
    reader.receive(b"u1")
    reader.silence()
    assert reader.receive(b"\n") == []
    assert [command.problem for command in reader.receive(b"\n")] == ["an empty command"]


def test_bare_commands_follow_one_another() -> None:
    reader = CommandReader()
    seen = []
    for text in ("u1", "d1-2", "u2", "u"):
        assert reader.receive(text.encode()) == []
        seen += texts(reader.silence())
    assert seen == ["u1", "d1-2", "u2", "u"]


def test_after_a_newline_silence_ends_nothing() -> None:
    reader = CommandReader()
    reader.receive(b"u1\nd1-")
    assert reader.idle_timeout is None
    assert reader.silence() == []
    assert texts(reader.receive(b"2\n")) == ["d1-2"]


def test_the_end_of_the_stream_ends_a_command() -> None:
    reader = CommandReader()
    assert texts(reader.receive(b"u1\nu2")) == ["u1"]
    assert texts(reader.end()) == ["u2"]
    assert reader.end() == []
    bare = CommandReader()
    bare.receive(b"u3")
    assert texts(bare.end()) == ["u3"]


# -- overlong commands -----------------------------------------------------------------------


def test_a_command_may_have_256_bytes() -> None:
    exact = b"u1" + b"x" * (LONGEST_COMMAND - 2)
    assert LONGEST_COMMAND == 256
    for ending in (b"\n", b"\r\n"):
        assert [c.problem for c in CommandReader().receive(exact + ending)] == [""]
        assert "at most 256 bytes" in CommandReader().receive(exact + b"y" + ending)[0].problem


def test_on_lines_ten_megabytes_are_answered_once_and_skipped_to_the_newline() -> None:
    reader = CommandReader()
    reader.receive(b"u1\n")
    chunk = b"a" * 65536
    answers = [command for _ in range(160) for command in reader.receive(chunk)]
    assert len(answers) == 1, "at once, not when the newline comes"
    assert len(answers[0].text) == LONGEST_COMMAND
    assert "at most 256 bytes" in answers[0].problem
    assert reader.idle_timeout is None
    assert texts(reader.receive(b"tail\nu1\n")) == ["u1"]


def test_without_lines_ten_megabytes_are_answered_once_when_they_end() -> None:
    for ending in ("newline", "silence", "close"):
        reader = CommandReader()
        chunk = b"a" * 65536
        assert [command for _ in range(160) for command in reader.receive(chunk)] == []
        assert reader.idle_timeout == SKIP_GRACE
        if ending == "newline":
            (answer,) = reader.receive(b"tail\n")
        else:
            (answer,) = reader.silence() if ending == "silence" else reader.end()
        assert "at most 256 bytes" in answer.problem
        assert reader.end() == []
        if ending == "silence":
            reader.receive(b"u1")
            assert texts(reader.silence()) == ["u1"], "the next bare command is served"
        elif ending == "newline":
            assert texts(reader.receive(b"u1\n")) == ["u1"]


def test_a_newline_after_a_skipped_bare_command_belongs_to_it() -> None:
    reader = CommandReader()
    reader.receive(b"a" * 300)
    assert len(reader.silence()) == 1
    assert texts(reader.receive(b"\nu1\n")) == ["u1"]


# -- numbers ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reply_format", "byte_order", "layout"),
    [
        ("float64", "big", ">d"),
        ("float64", "little", "<d"),
        ("float32", "big", ">f"),
        ("float32", "little", "<f"),
    ],
)
@given(number=st.floats(width=32))
@calm
def test_a_reply_is_one_number_in_the_format_asked_for(
    reply_format: str, byte_order: str, layout: str, number: float
) -> None:
    encoder = NumberEncoder(reply_format, byte_order)
    reply = encoder.reply(replied(number))
    assert len(reply) == encoder.size == struct.calcsize(layout)
    (back,) = struct.unpack(layout, reply)
    assert back == number or (math.isnan(back) and math.isnan(number))


def test_the_default_is_a_big_endian_double() -> None:
    assert NumberEncoder().reply(replied(1.5)) == bytes.fromhex("3ff8000000000000")


def test_infinity_and_nan_are_those_of_the_standard() -> None:
    assert NumberEncoder().reply(replied(math.inf)) == bytes.fromhex("7ff0000000000000")
    assert NumberEncoder("float32").reply(replied(math.inf)) == bytes.fromhex("7f800000")
    assert math.isnan(struct.unpack(">f", NumberEncoder("float32").reply(replied(math.nan)))[0])


@given(number=st.floats(allow_nan=False))
@calm
def test_what_a_single_cannot_hold_becomes_infinite(number: float) -> None:
    (back,) = struct.unpack(">f", NumberEncoder("float32").reply(replied(number)))
    if abs(number) > 3.5e38:
        assert back == math.copysign(math.inf, number)
    else:
        assert back == pytest.approx(number, rel=1e-6, abs=1e-44)
