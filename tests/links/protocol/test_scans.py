"""Replies of many numbers, in every dialect, to a program and from a real robot."""

from __future__ import annotations

import itertools
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.config.reply_formats import NUMBER_STRUCTS, ReplyEnd, ReplyForm, ReplyFormat
from simmer_tui.links.protocol.binary import NumberEncoder
from simmer_tui.links.protocol.packets import RequestStyle, encode
from simmer_tui.links.protocol.replies import MOST_RANGES, ReplyFramer, pack_reply, read_numbers
from simmer_tui.sim.command import Command, parse_command
from simmer_tui.sim.records import CommandResult, LidarScan, Pose, Reading, Status
from simmer_tui.sim.sensors import Ultrasonic, UltrasonicSpec

HERE = Pose(12.0, 30.0, 90.0)
RANGES = [12.345, 11.22, math.inf]
FORMS = [
    ("float64", "big", ">d"),
    ("float64", "little", "<d"),
    ("float32", "big", ">f"),
    ("float32", "little", "<f"),
]
GREETING = b"\xf8\x00Hello, I am a robot.\r\nversion 1.2\r\n"
ranges_of_a_scan = st.lists(
    st.one_of(st.floats(min_value=0.0, max_value=500.0, width=32), st.just(math.inf)), min_size=1, max_size=40
)


def scan_of(ranges: list[float]) -> LidarScan:
    count = len(ranges)
    return LidarScan(
        4, np.array(ranges), -np.arange(count) * 360.0 / count, np.array(ranges), np.tile(HERE, (count, 1))
    )


def result(command: str, ranges: list[float] | None = None, reply: float = math.nan) -> CommandResult:
    """The result of a command: a scan, a reading of one number, or a refusal."""
    asked = parse_command(command)
    spec = UltrasonicSpec(kind=Ultrasonic, number=1, code=asked.code)
    if ranges is not None:
        reading = Reading(spec, ranges[0], ranges[0], scan=scan_of(ranges))
        return CommandResult(1, 7.5, asked, Status.READING, ranges[0], HERE, HERE, reading=reading)
    if math.isnan(reply):
        return CommandResult(1, 7.5, asked, Status.UNKNOWN, reply, HERE, HERE, "no such code")
    return CommandResult(
        1, 7.5, asked, Status.READING, reply, HERE, HERE, reading=Reading(spec, reply, reply)
    )


def answers(*results: CommandResult) -> list[tuple[Command, CommandResult]]:
    return [(each.command, each) for each in results]


# -- to a program ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("reply_format", "byte_order", "letter"), FORMS)
def test_a_scan_in_binary_is_a_count_and_so_many_numbers(
    reply_format: str, byte_order: str, letter: str
) -> None:
    encoder = NumberEncoder(reply_format, byte_order)
    order, size = letter
    assert encoder.reply(result("sc", RANGES)) == struct.pack(f"{order}4{size}", 3.0, *RANGES)
    assert encoder.reply(result("sc-90", reply=11.22)) == struct.pack(letter, 11.22)
    refused = encoder.reply(result("sc"))
    assert len(refused) == encoder.size
    assert math.isnan(struct.unpack(letter, refused)[0]), "one NaN, in the place of the count"


@pytest.mark.parametrize(("reply_format", "size"), [("float64", 2888), ("float32", 1444)])
def test_a_scan_of_360_rays_has_the_bytes_of_361_numbers(reply_format: str, size: int) -> None:
    assert len(NumberEncoder(reply_format).reply(result("sc", [1e300] * 360))) == size


@pytest.mark.parametrize(("reply_format", "byte_order", "letter"), FORMS)
def test_replies_of_one_number_are_those_of_before(reply_format: str, byte_order: str, letter: str) -> None:
    encoder = NumberEncoder(reply_format, byte_order)
    for number in (12.345, math.inf, -1e300, 0.0, -0.0):
        assert encoder.reply(result("u1", reply=number)) == pack_reply(
            NUMBER_STRUCTS[reply_format, byte_order], number
        )


def test_a_scan_in_packets_is_joined_by_semicolons_inside_its_item() -> None:
    reply = encode(
        RequestStyle.FRAMED, "float64", answers(result("u0", reply=7.0), result("sc", RANGES), result("q9"))
    )
    assert reply.message() == b"[u0:7.0,sc:12.345;11.220;inf,q9:Not Found]"


def test_a_scan_without_brackets_is_text_or_a_count_and_numbers() -> None:
    asked = answers(result("sc", RANGES), result("u0", reply=7.0))
    assert encode(RequestStyle.LEGACY, "text", asked).message() == b"12.345;11.220;inf|7.0"
    assert encode(RequestStyle.LEGACY, "float64", asked).message() == struct.pack("<5d", 3, *RANGES, 7)
    assert encode(RequestStyle.LEGACY, "float32", asked).message() == struct.pack("<5f", 3, *RANGES, 7)


def test_360_rays_in_packets_take_about_two_kilobytes_and_72_fit_one_read() -> None:
    def size(rays: int) -> int:
        asked = answers(result("sc", [12.345] * rays))
        return len(encode(RequestStyle.FRAMED, "float64", asked).message())

    assert 2300 < size(360) < 2600
    assert size(140) <= 1024
    assert size(72) < 520


# -- from a real robot ------------------------------------------------------------------------------


def fed(framer: ReplyFramer, data: bytes, cuts: list[int]) -> bytes | None:
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    for start, stop in itertools.pairwise(places):
        reply = framer.receive(data[start:stop])
        if reply is not None:
            return reply
    return framer.silence()


def read(data: bytes, form: ReplyForm, scans: list[bool]) -> list[list[float] | float]:
    numbers = read_numbers(data, form, [True] * len(scans), scans)
    return [each if isinstance(each, float) else each.tolist() for each in numbers]


@settings(max_examples=10)
@pytest.mark.parametrize(("reply_format", "byte_order", "letter"), FORMS)
@pytest.mark.parametrize("greeting", [b"", GREETING], ids=["at once", "after a greeting"])
@given(ranges=ranges_of_a_scan, cuts=st.lists(st.integers(0, 500), max_size=4))
def test_a_robots_scan_is_found_by_its_count(
    reply_format: str, byte_order: str, letter: str, greeting: bytes, ranges: list[float], cuts: list[int]
) -> None:
    order, size = letter
    data = struct.pack(f"{order}{len(ranges) + 1}{size}", len(ranges), *ranges)
    framer = ReplyFramer()
    framer.expect(ReplyEnd(reply_format), scans=[True], byte_order=byte_order)
    assert fed(framer, greeting + data, cuts) == data
    assert framer.take_discarded() == (len(greeting), greeting)
    form = ReplyForm(ReplyFormat(reply_format), byte_order)
    assert read(data, form, [True]) == [ranges]
    # In step again: the next one is taken as soon as it is there, and no sooner.
    framer.expect(ReplyEnd(reply_format), scans=[True], byte_order=byte_order)
    assert framer.receive(data[:-1]) is None
    assert framer.receive(data[-1:]) == data


def test_a_scan_among_other_commands_is_found_whole() -> None:
    data = struct.pack("<6d", 7.0, 3, *RANGES, 1.0)
    framer = ReplyFramer()
    framer.expect(ReplyEnd.FLOAT64, 3, scans=[False, True, False])
    assert fed(framer, data, [8, 20]) == data
    assert read(data, ReplyForm(ReplyFormat.FLOAT64), [False, True, False]) == [7.0, RANGES, 1.0]
    assert read(
        b"[u0:7.0,sc:12.345;11.220;inf,i0:True]", ReplyForm(ReplyFormat.FRAMED), [False, True, False]
    ) == [
        7.0,
        RANGES,
        1.0,
    ]
    assert read(b"7.0|12.345;11.22;inf|1\n", ReplyForm(ReplyFormat.TEXT), [False, True, False]) == [
        7.0,
        RANGES,
        1.0,
    ]


def test_a_robot_refuses_a_scan_with_one_nan() -> None:
    data = struct.pack(">d", math.nan)
    framer = ReplyFramer()
    framer.expect(ReplyEnd.FLOAT64, scans=[True], byte_order="big")
    assert fed(framer, data, []) == data
    for reply, form in (
        (data, ReplyForm(ReplyFormat.FLOAT64, "big")),
        (b"[sc:Not Found]", ReplyForm(ReplyFormat.FRAMED)),
        (b"nan\n", ReplyForm(ReplyFormat.TEXT)),
        (b"", ReplyForm(ReplyFormat.TEXT)),
    ):
        [answer] = read_numbers(reply, form, [True], [True])
        assert isinstance(answer, float)
        assert math.isnan(answer)


@pytest.mark.parametrize("count", [0.0, 2.5, -1.0, math.inf, -math.inf, MOST_RANGES + 1.0])
def test_a_robot_that_sends_no_count_has_not_answered(count: float) -> None:
    data = struct.pack(">2d", count, 12.0)
    framer = ReplyFramer()
    framer.expect(ReplyEnd.FLOAT64, scans=[True], byte_order="big")
    assert fed(framer, data, []) is None
    [answer] = read_numbers(data, ReplyForm(ReplyFormat.FLOAT64, "big"), [True], [True])
    assert isinstance(answer, float)
    assert math.isnan(answer)


@pytest.mark.parametrize("text", [b"12.345 11.22 inf\r\n", b"12.345,11.22,inf\n", b"12.345;11.22;inf\r\n"])
def test_a_scan_alone_on_a_line_may_be_joined_in_any_way(text: bytes) -> None:
    assert read(text, ReplyForm(ReplyFormat.TEXT), [True]) == [RANGES]
