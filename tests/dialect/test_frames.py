"""Messages in a stream of bytes, whole and in pieces."""

from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.dialect.frames import Deframer, Frame, FrameKind, Framing, Noise

BINARY = Framing(
    kind=FrameKind.BINARY, end=b"$", silence=0.5, head="<BB", names=("type", "size"), body="size", longest=40
)
FRAMINGS = [Framing(), Framing(kind=FrameKind.BRACKET, end=b""), Framing(kind=FrameKind.BYTE), BINARY]


def contents(framing: Framing, *pieces: bytes) -> list[bytes]:
    """The contents of the messages in some bytes."""
    deframer = Deframer(framing)
    return [part.content for piece in pieces for part in deframer.receive(piece) if isinstance(part, Frame)]


def test_a_line_ends_with_its_mark_and_has_no_blanks_around() -> None:
    assert contents(Framing(), b" w 13 \r\n\r\ngetData\nrest") == [b"w 13", b"getData"]
    assert contents(Framing(end=b"\r\n"), b"a\rb\r", b"\nc\r\n") == [b"a\rb", b"c"]


@pytest.mark.parametrize(
    "framing", [Framing(end=b"\r\n"), Framing(kind=FrameKind.BRACKET, open=b"<<", close=b">>")]
)
def test_an_end_of_two_bytes_is_found_in_pieces_of_any_length(framing: Framing) -> None:
    data = b"<<a\r\n>>\r<<b>\r\n\r\r\n>>" * 3
    whole = contents(framing, data)
    for length in range(1, 6):
        assert contents(framing, *(data[at : at + length] for at in range(0, len(data), length))) == whole
    assert len(whole) >= 6


def test_a_line_without_its_end_is_one_after_silence() -> None:
    deframer = Deframer(Framing(silence=1.0))
    assert deframer.receive(b"xx") == []
    assert deframer.unfinished
    assert deframer.silence() == [Frame(b"xx", b"xx")]
    assert deframer.end() == []


def test_bytes_outside_brackets_are_one_burst_of_noise() -> None:
    found = Deframer(FRAMINGS[1]).receive(b"junk[f500] \r\nmore[h]")
    assert [part.data for part in found] == [b"junk", b"[f500]", b" \r\nmore", b"[h]"]
    assert [type(part) for part in found] == [Noise, Frame, Noise, Frame]


def test_a_message_that_is_too_long_is_dropped_up_to_the_next_end() -> None:
    framing = Framing(longest=8)
    deframer = Deframer(framing)
    found = deframer.receive(b"x" * 40) + deframer.receive(b"y\nok\n")
    assert [part.content for part in found if isinstance(part, Frame)] == [b"ok"]
    assert sum(len(part.data) for part in found if isinstance(part, Noise)) == 42


def test_a_binary_frame_has_its_header_and_a_wrong_one_is_dropped_up_to_the_next_end() -> None:
    deframer = Deframer(BINARY, frozenset((1, 2)))
    good = BINARY.frame(2, b"abc")
    assert good == b"\x02\x03abc$"
    found = deframer.receive(b"\x09\x00$" + good + b"\x01\xff" + b"zz$" + good)
    assert [part.content for part in found if isinstance(part, Frame)] == [b"abc", b"abc"]
    assert [part.why for part in found if isinstance(part, Noise)] == [
        "type 9 is not known",
        "longer than 40 bytes",
    ]


def test_half_a_binary_frame_is_dropped_after_silence() -> None:
    deframer = Deframer(BINARY)
    assert deframer.receive(b"\x01\x05ab") == []
    assert [type(part) for part in deframer.silence()] == [Noise]
    assert deframer.receive(BINARY.frame(1, b"")) != []


@pytest.mark.parametrize("framing", FRAMINGS, ids=lambda framing: framing.kind.value)
@settings(max_examples=20)
@given(data=st.binary(max_size=80), cuts=st.lists(st.integers(0, 80), max_size=6))
def test_messages_do_not_depend_on_how_the_bytes_come(framing: Framing, data: bytes, cuts: list[int]) -> None:
    whole = contents(framing, data)
    places = sorted({0, len(data), *(min(cut, len(data)) for cut in cuts)})
    pieces = [data[begin:end] for begin, end in pairwise(places)]
    # Without an end a wrong binary frame takes along all that is there.
    assert framing.kind is FrameKind.BINARY or contents(framing, *pieces) == whole
    assert contents(framing, *(data[at : at + 1] for at in range(len(data)))) == contents(
        framing, *pieces
    ) or (framing.kind is FrameKind.BINARY)


@given(st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=40)), max_size=6), st.integers(1, 9))
def test_binary_frames_come_back_in_any_pieces(messages: list[tuple[int, bytes]], size: int) -> None:
    data = b"".join(BINARY.frame(kind, content) for kind, content in messages)
    deframer = Deframer(BINARY)
    found = [part for at in range(0, len(data), size) for part in deframer.receive(data[at : at + size])]
    assert [(part.head["type"], part.content) for part in found if isinstance(part, Frame)] == messages


def test_a_content_that_does_not_fit_its_header_is_an_error() -> None:
    with pytest.raises(struct.error):
        BINARY.frame(300, b"")
