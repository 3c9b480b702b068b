"""Beginning and end of a robot's reply, whatever noise is around it and however it is cut up."""

from __future__ import annotations

import itertools
import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.config.reply_formats import (
    BYTE_ORDERS,
    NUMBER_LETTERS,
    NUMBER_SIZES,
    NUMBER_STRUCTS,
    ReplyEnd,
    ReplyForm,
    ReplyFormat,
)
from simmer_tui.links.protocol.binary import CommandReader
from simmer_tui.links.protocol.replies import LIMIT, ReplyFramer, pack_reply, read_numbers

GREETING = b"\xf8\x00Hello, I am a robot.\r\nversion 1.2\r\n"
readings = st.floats(min_value=-1e6, max_value=1e6, allow_nan=False)


def trusting(end: ReplyEnd, count: int = 1) -> ReplyFramer:
    """A framer past its first reply, so that it takes the next as soon as it is there."""
    framer = ReplyFramer()
    framer.expect(ReplyEnd.QUIET)
    framer.receive(b"first")
    assert framer.silence() == b"first"
    framer.expect(end, count)
    return framer


def fed(framer: ReplyFramer, data: bytes, cuts: list[int]) -> bytes | None:
    """Replies that the framer finds in data that comes in pieces, and then stops."""
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    for start, stop in itertools.pairwise(places):
        reply = framer.receive(data[start:stop])
        if reply is not None:
            return reply
    return framer.silence()


@pytest.mark.parametrize("name", NUMBER_LETTERS)
def test_each_format_of_a_number_is_a_reply_s_and_ends_by_its_size(name: str) -> None:
    for order in BYTE_ORDERS:
        form = ReplyForm(ReplyFormat(name), order)
        reply = pack_reply(NUMBER_STRUCTS[name, order], 12.5)
        assert len(reply) == NUMBER_SIZES[form.end]
        assert read_numbers(reply, form, [True]) == (12.5,)


CASES = [
    (ReplyEnd.FLOAT64, 1, struct.pack(">d", 12.5)),
    (ReplyEnd.FLOAT64, 3, struct.pack("<3d", 12.5, math.inf, math.nan)),
    (ReplyEnd.FLOAT32, 2, struct.pack("<2f", 12.5, -1)),
    (ReplyEnd.NEWLINE, 1, b"12.5\r\n"),
    (ReplyEnd.NEWLINE, 1, b"-inf\n"),
    (ReplyEnd.NEWLINE, 1, b"nan\n"),
    (ReplyEnd.NEWLINE, 2, b"12.500|inf\n"),
    (ReplyEnd.NEWLINE, 1, b"True\n"),
    (ReplyEnd.BRACKET, 2, b"[u0:12.345,w0:True]"),
    (ReplyEnd.QUIET, 1, b"anything at all"),
]
IDS = [f"{end}-{number}" for number, (end, _, _) in enumerate(CASES)]


@settings(max_examples=12)
@pytest.mark.parametrize(("end", "count", "reply"), CASES, ids=IDS)
@given(cuts=st.lists(st.integers(0, 100), max_size=5))
def test_reply_is_found_whole_however_it_is_cut_up(
    end: ReplyEnd, count: int, reply: bytes, cuts: list[int]
) -> None:
    assert fed(trusting(end, count), reply, cuts) == reply
    in_doubt = ReplyFramer()
    in_doubt.expect(end, count)
    assert fed(in_doubt, reply, cuts) == reply


@settings(max_examples=12)
@pytest.mark.parametrize(("end", "count", "reply"), CASES[:-1], ids=IDS[:-1])
@given(cuts=st.lists(st.integers(0, 100), max_size=5))
def test_greeting_in_front_of_the_first_reply_is_discarded(
    end: ReplyEnd, count: int, reply: bytes, cuts: list[int]
) -> None:
    framer = ReplyFramer()
    framer.expect(end, count)
    assert fed(framer, GREETING + reply, cuts) == reply
    assert framer.take_discarded() == (len(GREETING), GREETING)
    assert framer.take_discarded() == (0, b"")


@pytest.mark.parametrize(("end", "count", "reply"), CASES[:-1], ids=IDS[:-1])
def test_greeting_alone_is_no_reply(end: ReplyEnd, count: int, reply: bytes) -> None:
    greeting = b"I am a robot, and I have just been switched on\r\n"
    for framer in (ReplyFramer(), trusting(end, count)):
        framer.expect(end, count)
        assert framer.receive(greeting) is None
        assert framer.silence() is None
        assert framer.receive(reply) is None or end in (ReplyEnd.NEWLINE, ReplyEnd.BRACKET)


@pytest.mark.parametrize(("end", "count", "reply"), CASES[:-1], ids=IDS[:-1])
def test_half_a_reply_is_forgotten_when_the_next_is_expected(end: ReplyEnd, count: int, reply: bytes) -> None:
    framer = trusting(end, count)
    assert framer.receive(reply[: len(reply) - 1]) is None
    framer.expect(end, count)
    assert framer.receive(reply) == reply


def test_text_that_is_no_number_is_skipped_line_by_line() -> None:
    framer = trusting(ReplyEnd.NEWLINE)
    assert framer.receive(b"distance = 5\r\n\r\n1 2 x\r\n12.3.4\r\n") is None
    assert framer.receive(b"7\r\nrest") == b"7\r\n"


def test_frame_is_taken_from_its_last_opening() -> None:
    framer = trusting(ReplyEnd.BRACKET)
    assert framer.receive(b"12]\r\n[u0:1[u0:2.000") is None
    assert framer.receive(b"]") == b"[u0:2.000]"


def test_nothing_is_kept_while_nothing_is_expected() -> None:
    framer = trusting(ReplyEnd.FLOAT64)
    framer.abandon()
    for _ in range(1000):
        assert framer.receive(b"x" * 1000) is None
    count, sample = framer.take_discarded()
    assert count == 1_000_000
    assert len(sample) <= 60
    framer.expect(ReplyEnd.FLOAT64)
    assert framer.receive(struct.pack(">d", 1)) == struct.pack(">d", 1)


@pytest.mark.parametrize("end", list(ReplyEnd))
def test_flood_in_place_of_a_reply_is_bounded(end: ReplyEnd) -> None:
    framer = ReplyFramer()
    framer.expect(end)
    for _ in range(100):
        framer.receive(b"\x01noise without end " * 50)
    assert framer.discarded >= 100 * 50 * 19 - LIMIT


def test_after_doubt_the_last_reply_of_a_burst_counts() -> None:
    framer = trusting(ReplyEnd.FLOAT64)
    framer.doubt()
    late, right = struct.pack(">d", 1), struct.pack(">d", 2)
    assert framer.receive(late) is None
    assert framer.receive(right) is None
    assert framer.idle_timeout is not None
    assert framer.silence() == right
    framer.expect(ReplyEnd.FLOAT64)
    assert framer.receive(late) == late, "trust is back"


def test_two_replies_that_are_due_in_one_burst_both_count() -> None:
    for framer in (trusting(ReplyEnd.NEWLINE), ReplyFramer()):
        framer.expect(ReplyEnd.NEWLINE)
        framer.following = 1
        found = framer.receive(b"hello\n1\n2\n") or framer.silence()
        assert found == b"1\n"
        framer.following = 0
        framer.expect(ReplyEnd.NEWLINE, keep=True)
        assert framer.receive(b"") == b"2\n"


@given(readings, st.sampled_from(["float64", "float32"]), st.sampled_from(["big", "little"]))
def test_any_reading_in_binary_passes(number: float, reply_format: str, byte_order: str) -> None:
    form = ReplyForm(ReplyFormat(reply_format), byte_order)
    letter = ("<" if byte_order == "little" else ">") + ("d" if reply_format == "float64" else "f")
    reply = struct.pack(letter, number)
    framer = trusting(form.end)
    taken = framer.receive(reply)
    if 1e-8 < abs(number) < 1e8 or number == 0:
        assert taken == reply
    assert read_numbers(reply, form, [True]) == struct.unpack(letter, reply)


@given(st.binary(max_size=300), st.sampled_from(list(ReplyEnd)))
def test_any_bytes_are_either_discarded_or_replied(data: bytes, end: ReplyEnd) -> None:
    framer = ReplyFramer()
    framer.expect(end)
    reply = framer.receive(data) or framer.silence() or b""
    framer.abandon()
    assert framer.discarded + len(reply) == len(data)


@pytest.mark.parametrize(
    ("reply", "sensing", "numbers"),
    [
        (b"12.5\r\n", [True], [12.5]),
        (b"12.500|inf", [True, False], [12.5, math.inf]),
        (b"1e-05", [True], [1e-5]),
        (b"[u0:12.345,w0:True,r0:False]", [True, False, False], [12.345, math.inf, math.nan]),
        (b"[i0:True,i1:False]", [True, True], [1, 0]),
        (b"[q9:Not Found,xx:DRIVE STOP]", [True, True], [math.nan, math.inf]),
        (b"1_0", [True], [math.nan]),
        (b"3", [True, True], [3, math.nan]),
        (b"1,2,3", [True], [1]),
        (b"", [True], [math.nan]),
        (b"\xff\xfe", [True], [math.nan]),
    ],
)
def test_numbers_of_text_replies(reply: bytes, sensing: list[bool], numbers: list[float]) -> None:
    found = read_numbers(reply, ReplyForm(ReplyFormat.TEXT), sensing)
    assert found == pytest.approx(tuple(numbers), nan_ok=True)


@given(st.binary(max_size=60), st.sampled_from(list(ReplyFormat)), st.integers(1, 4))
def test_any_reply_gives_a_number_for_each_command(
    reply: bytes, reply_format: ReplyFormat, count: int
) -> None:
    numbers = read_numbers(reply, ReplyForm(reply_format), [True] * count)
    assert len(numbers) == count
    assert all(isinstance(number, float) for number in numbers)


@given(
    st.lists(
        st.tuples(st.binary(max_size=20) | st.sampled_from([b"\n", b"\r\n", b"u1\r", b"u1\n"]), st.booleans())
    )
)
def test_bytes_of_commands_as_sent_are_all_the_bytes_there_were(pieces: list[tuple[bytes, bool]]) -> None:
    reader = CommandReader()
    passed_on = b""
    for data, pauses in pieces:
        passed_on += reader.late_end(data)
        commands = reader.receive(data)
        assert len(commands) == len(reader.sent)
        passed_on += b"".join(reader.sent)
        if pauses:
            commands = reader.silence()
            assert len(commands) <= len(reader.sent)
            passed_on += b"".join(reader.sent) if commands else b""
    if reader.end():
        passed_on += b"".join(reader.sent)
    assert passed_on == b"".join(data for data, _ in pieces)
