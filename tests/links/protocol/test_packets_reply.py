"""Replies of the connection-per-message dialects, byte by byte."""

from __future__ import annotations

import math
import re
import struct
from itertools import groupby
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.reply_formats import ReplyFormat
from simmer_tui.config.sets import find_set
from simmer_tui.links.protocol.packets import (
    Mailbox,
    Reply,
    RequestReader,
    RequestStyle,
    encode,
    number_text,
    passed_on,
)
from simmer_tui.sim import Simulator
from simmer_tui.sim.command import Command, parse_value
from simmer_tui.sim.records import CommandResult, Pose, Reading, Status
from simmer_tui.sim.sensors import LineSensor, LineSpec, LoadSensor, Ultrasonic
from simmer_tui.sim.specs import SensorSpec

HERE = Pose(0.0, 0.0, 0.0)
SENSORS = {"u0": (Ultrasonic, 12.3449), "u1": (Ultrasonic, 7.0), "i0": (LineSensor, 1.0)}


def outcome(command: Command, status: Status, reply: float = math.nan) -> CommandResult:
    reading = None
    if status is Status.READING:
        kind = SENSORS[command.code][0] if command.code in SENSORS else Ultrasonic
        reading = Reading(SensorSpec(kind=kind, number=0, code=command.code), reply, reply)
    return CommandResult(1, 0.0, command, status, reply, HERE, HERE, reading=reading)


def answer(command: Command) -> CommandResult:
    """Results of a robot with the sensors above and drives w0 and r0, as the engine judges them."""
    if command.problem:
        return outcome(command, Status.REFUSED)
    if command.code in SENSORS:
        return outcome(command, Status.READING, SENSORS[command.code][1])
    if command.code == "xx":
        return outcome(command, Status.STOPPED, math.inf)
    if command.code not in ("w0", "r0"):
        return outcome(command, Status.UNKNOWN)
    value = parse_value(command.argument)
    if isinstance(value, str) or abs(value) > 1e6:
        return outcome(command, Status.REFUSED)
    return outcome(command, Status.ACCEPTED, math.inf)


def open_session(data: bytes, legacy_reply: str = "float64") -> bytes:
    """All that a client gets which sends `data`, closes, and then reads."""
    reader, mailbox = RequestReader(), Mailbox()
    for request in reader.receive(data) + reader.end():
        mailbox.put(encode(request.dialect, legacy_reply, [(c, answer(c)) for c in request.commands]))
    return mailbox.take()


@pytest.mark.parametrize(
    ("request_bytes", "reply"),
    [
        (b"[u0]", b"[u0:12.345]"),
        (b"[u1]", b"[u1:7.0]"),
        (b"[i0]", b"[i0:True]"),
        (b"[w0:36]", b"[w0:True]"),
        (b"[u0,u1,w0:3]", b"[u0:12.345,u1:7.0,w0:True]"),
        (b"[u0][u1]", b"[u0:12.345,u1:7.0]"),
        (b"[zz]", b"[zz:Not Found]"),
        (b"[xx]", b"[xx:DRIVE STOP]"),
    ],
)
def test_a_packet_is_answered_item_by_item(request_bytes: bytes, reply: bytes) -> None:
    assert open_session(request_bytes) == reply


@pytest.mark.parametrize(
    ("request_bytes", "reply"),
    [
        (b"[\xff\xfe]", b"[??:Not Found]"),
        ("[\u00e9\u00e8]".encode(), b"[??:Not Found]"),
        (b"[u0", b"[u0:Not Found]"),
        (b"u0]", b"[u0:Not Found]"),
        (b"[w0:36", b"[w0:Not Found]"),
        (b"[[x]", b"[x:Not Found]"),
        (b"[\nx]", b"[?x:Not Found]"),
        (b"[]", b""),
        (b"[,]", b"[:Not Found,:Not Found]"),
        (b"[u]", b"[u:Not Found]"),
        (b"[ u0]", b"[ u:Not Found]"),
        (b"[u::]", b"[u?:Not Found]"),
        (b"[w0:nan]", b"[w0:False]"),
        (b"[w0:inf]", b"[w0:False]"),
        (b"[w0:1e308]", b"[w0:False]"),
        (b"[w0:abc]", b"[w0:False]"),
        (b"[w0:]", b"[w0:False]"),
        (b"[w0]", b"[w0:False]"),
        (b"[" + b"u" * 10_000_000, b"[uu:Not Found]"),
        (b"[" + b"u" * 300 + b",u0]", b"[uu:Not Found,u0:12.345]"),
    ],
)
def test_bad_input_gets_its_exact_reply_and_the_next_request_its_own(
    request_bytes: bytes, reply: bytes
) -> None:
    assert open_session(request_bytes) == reply
    both = open_session(request_bytes + b"[u1]")
    assert both == (reply[:-1] + b"," if reply else b"[") + b"u1:7.0]"


def test_a_byte_that_is_not_ascii_without_brackets_is_answered_too() -> None:
    assert open_session(b"u1\xff") == struct.pack("<d", 7.0)
    assert open_session(b"\xff\xfe\xfd", "text") == b"nan"


@pytest.mark.parametrize(
    ("legacy_reply", "pack"),
    [("float64", "<5d"), ("float32", "<5f")],
)
def test_a_request_without_brackets_is_answered_in_little_endian_numbers(
    legacy_reply: str, pack: str
) -> None:
    reply = open_session(b"u1,i0,w0-36,r0--90,xx", legacy_reply)
    assert reply == struct.pack(pack, 7.0, 1.0, math.inf, math.inf, math.inf)


def test_a_request_without_brackets_is_answered_in_text_joined_by_bars() -> None:
    assert open_session(b"u0,i0,w0-36,zz,w0-abc,xx", "text") == b"12.345|1.0|inf|nan|nan|inf"


@pytest.mark.parametrize("legacy_reply", ["float64", "float32", "text"])
@pytest.mark.parametrize("status", [Status.BUSY, Status.REFUSED, Status.UNKNOWN])
def test_what_was_not_done_is_not_a_number_without_brackets(legacy_reply: str, status: Status) -> None:
    command = Command("w0-1", "w0", "1")
    reply = encode(RequestStyle.LEGACY, legacy_reply, [(command, outcome(command, status))]).message()
    expected = {"float64": "<d", "float32": "<f"}
    number = float(reply) if legacy_reply == "text" else struct.unpack(expected[legacy_reply], reply)[0]
    assert math.isnan(number)


def test_a_drive_that_has_ended_is_true_and_a_busy_one_is_false() -> None:
    command = Command("w0:1", "w0", "1")
    answers = [(command, outcome(command, status)) for status in (Status.DONE, Status.BUSY)]
    assert encode(RequestStyle.FRAMED, "text", answers).message() == b"[w0:True,w0:False]"


def test_a_line_sensor_that_sees_nothing_is_false_or_zero() -> None:
    command = Command("i0", "i0")
    answers = [(command, outcome(command, Status.READING, 0.0))]
    assert encode(RequestStyle.FRAMED, "text", answers).message() == b"[i0:False]"
    assert encode(RequestStyle.LEGACY, "text", answers).message() == b"0.0"
    assert encode(RequestStyle.LEGACY, "float64", answers).message() == bytes(8)


def test_infinity_out_of_range_and_beyond_a_single_is_written_as_such() -> None:
    command = Command("u0", "u0")
    far = [(command, outcome(command, Status.READING, math.inf))]
    assert encode(RequestStyle.FRAMED, "text", far).message() == b"[u0:inf]"
    huge = [(command, outcome(command, Status.READING, -1e300))]
    assert encode(RequestStyle.LEGACY, "float32", huge).message() == struct.pack("<f", -math.inf)


@pytest.mark.parametrize("legacy_reply", ["framed", "double", ""])
def test_a_legacy_reply_is_one_of_three(legacy_reply: str) -> None:
    with pytest.raises(ValueError, match=r"float64|valid ReplyFormat"):
        encode(RequestStyle.LEGACY, legacy_reply, [])


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_every_number_carries_a_decimal_point_and_three_decimals_at_most(value: float) -> None:
    text = number_text(value)
    assert re.fullmatch(r"-?\d+\.\d{1,3}", text)
    assert float(text) == pytest.approx(value, abs=0.000501, rel=1e-9)


def test_whole_infinite_and_missing_numbers_in_text() -> None:
    assert [number_text(value) for value in (12, 0.0005001, 1e22, math.inf, math.nan)] == [
        "12.0",
        "0.001",
        "10000000000000000000000.0",
        "inf",
        "nan",
    ]


def test_replies_that_wait_are_merged_oldest_first_and_taken_once() -> None:
    mailbox = Mailbox()
    mailbox.put(Reply(ReplyFormat.FRAMED, (b"u0:1.0",)))
    mailbox.put(Reply(ReplyFormat.FRAMED, (b"u1:2.0", b"w0:True")))
    assert len(mailbox) == 3
    assert mailbox.take() == b"[u0:1.0,u1:2.0,w0:True]"
    assert mailbox.take() == b""


def test_replies_without_brackets_are_joined_by_bars_or_set_end_to_end() -> None:
    mailbox = Mailbox()
    for item in (b"1.0", b"inf"):
        mailbox.put(Reply(ReplyFormat.TEXT, (item,)))
    assert mailbox.take() == b"1.0|inf"
    for number in (1.0, 2.0):
        mailbox.put(Reply(ReplyFormat.FLOAT64, (struct.pack("<d", number),)))
    assert mailbox.take() == struct.pack("<2d", 1.0, 2.0)


def test_replies_of_two_formats_never_share_a_message() -> None:
    mailbox = Mailbox()
    mailbox.put(Reply(ReplyFormat.FRAMED, (b"u0:1.0",)))
    mailbox.put(Reply(ReplyFormat.FLOAT64, (bytes(8),)))
    mailbox.put(Reply(ReplyFormat.FRAMED, (b"u1:2.0",)))
    assert [mailbox.take() for _ in range(4)] == [b"[u0:1.0]", bytes(8), b"[u1:2.0]", b""]


def test_beyond_a_thousand_items_the_oldest_go_and_are_counted() -> None:
    mailbox = Mailbox()
    dropped = [mailbox.put(Reply(ReplyFormat.TEXT, (str(number).encode(),))) for number in range(1002)]
    assert dropped == [0] * 1000 + [1, 1]
    assert mailbox.put(Reply(ReplyFormat.TEXT, (b"a", b"b", b"c"))) == 3
    items = mailbox.take().split(b"|")
    assert len(items) == 1000
    assert items[0] == b"5"
    assert items[-1] == b"c"


def test_an_empty_reply_is_no_message() -> None:
    mailbox = Mailbox()
    assert mailbox.put(encode(RequestStyle.FRAMED, "float64", [])) == 0
    assert mailbox.take() == b""
    assert Reply(ReplyFormat.FRAMED, ()).message() == b""


def test_what_waits_of_some_replies_is_taken_back_and_the_rest_stays() -> None:
    mailbox = Mailbox()
    mine = [Reply(ReplyFormat.FRAMED, (b"u0:1.0", b"u1:2.0")), Reply(ReplyFormat.FRAMED, (b"m0:3.0",))]
    legacy = Reply(ReplyFormat.TEXT, (b"4.0",))
    others = Reply(ReplyFormat.FRAMED, (b"c0:5.0",))
    for reply in (mine[0], others, mine[1], legacy):
        mailbox.put(reply)
    assert mailbox.holds(mine[0])
    assert mailbox.withdraw([*mine, legacy]) == b"[u0:1.0,u1:2.0,m0:3.0]4.0"
    assert not mailbox.holds(mine[0])
    assert mailbox.withdraw(mine) == b""
    assert mailbox.take() == b"[c0:5.0]"


@settings(max_examples=15)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("put"), st.integers(0, 2), st.integers(0, 5), st.sampled_from("ab")),
            st.tuples(st.sampled_from(["take", "drop", "withdraw"]), st.integers(0, 7)),
        ),
        max_size=40,
    )
)
def test_a_mailbox_is_a_queue_of_items_however_it_is_used(steps: list[Any]) -> None:
    formats = (ReplyFormat.FRAMED, ReplyFormat.TEXT, ReplyFormat.FLOAT64)
    mailbox, model, replies = Mailbox(8), list[tuple[Reply, bytes, str]](), list[Reply]()
    for name, number, *more in steps:
        if name == "put":
            count, owner = more
            items = tuple(b"%d.%d" % (len(replies), item) for item in range(count))
            replies.append(Reply(formats[number], items))
            model += [(replies[-1], item, owner) for item in items]
            surplus = max(0, len(model) - 8)
            del model[:surplus]
            assert mailbox.put(replies[-1], owner) == surplus
        elif name == "take":
            formats_waiting = groupby(model, key=lambda entry: entry[0].format)
            same = list(next(formats_waiting, ("", ()))[1])
            del model[: len(same)]
            items = tuple(item for _, item, _ in same)
            assert mailbox.take() == (Reply(same[0][0].format, items).message() if same else b"")
        elif name == "drop":
            left = [entry for entry in model if entry[2] != "ab"[number % 2]]
            assert mailbox.drop("ab"[number % 2]) == len(model) - len(left)
            model = left
        else:
            mine = replies[number:]
            chosen = [entry for entry in model if any(entry[0] is reply for reply in mine)]
            model = [entry for entry in model if not any(entry[0] is reply for reply in mine)]
            got = mailbox.withdraw(mine)
            assert all(item in got for _, item, _ in chosen)
            assert bool(got) == bool(chosen)
        assert len(mailbox) == len(model)
        assert all(mailbox.holds(r) == any(entry[0] is r for entry in model) for r in replies)


def test_what_waits_of_one_owner_is_dropped_and_the_rest_stays() -> None:
    mailbox = Mailbox()
    for owner, items in (("a", (b"u0:1.0", b"u1:2.0")), ("b", (b"m0:3.0",)), ("a", (b"c0:4.0",))):
        mailbox.put(Reply(ReplyFormat.FRAMED, items), owner)
    assert mailbox.drop("c") == 0
    assert mailbox.drop("a") == 3
    assert mailbox.drop("a") == 0
    assert mailbox.take() == b"[m0:3.0]"


def test_replies_that_are_alike_are_told_apart() -> None:
    mailbox = Mailbox()
    first, second = (Reply(ReplyFormat.FRAMED, (b"m0:0.0",)) for _ in range(2))
    mailbox.put(first)
    assert not mailbox.holds(second)
    assert mailbox.withdraw([second]) == b""


def test_a_load_sensor_answers_yes_or_no_in_packets_and_a_number_without_brackets() -> None:
    configuration = load(find_set("mission"))
    robot = Simulator(replace(configuration.simulation, block_center=(13.0, 42.0)), seed=1)
    command = Command("l1", "l1")
    for load_reply, drive in (("False", "p1-1"), ("True", "p1-0"), ("False", "")):
        answers = [(command, robot.execute("l1"))]
        assert encode(RequestStyle.FRAMED, "text", answers).message() == f"[l1:{load_reply}]".encode()
        number = {"True": b"1.0", "False": b"0.0"}[load_reply]
        assert encode(RequestStyle.LEGACY, "text", answers).message() == number
        if drive:
            robot.execute(drive)


@pytest.mark.parametrize(
    ("reply_format", "data"),
    [
        (ReplyFormat.FRAMED, b"[u0:12.3,u1:7]"),
        (ReplyFormat.FRAMED, b"[]"),
        (ReplyFormat.FRAMED, b"OK\r\n"),
        (ReplyFormat.TEXT, b"12.3\r\n"),
        (ReplyFormat.FLOAT32, b"\x00\x00\x80\x3f"),
    ],
)
def test_a_robots_own_reply_is_passed_on_as_it_is(reply_format: ReplyFormat, data: bytes) -> None:
    mailbox = Mailbox()
    mailbox.put(passed_on(reply_format, data))
    assert mailbox.take() == data


def test_a_robots_own_packets_are_merged_as_ours_are() -> None:
    mailbox = Mailbox()
    for data in (b"[u0:12.3,u1:7]", b"[w0:True]"):
        mailbox.put(passed_on(ReplyFormat.FRAMED, data))
    assert mailbox.take() == b"[u0:12.3,u1:7,w0:True]"


@pytest.mark.parametrize(
    ("sensor", "value", "word"),
    [
        (SensorSpec(kind=LoadSensor, number=0, code="l0"), 1.0, b"True"),
        (SensorSpec(kind=LoadSensor, number=0, code="l0"), 0.0, b"False"),
        (LineSpec(kind=LineSensor, number=0, code="l0"), 0.0, b"False"),
        (LineSpec(kind=LineSensor, number=0, code="l0", analog=True), 0.73, b"0.73"),
        (LineSpec(kind=LineSensor, number=0, code="l0", analog=True), 1.0, b"1.0"),
    ],
)
def test_a_yes_or_no_is_a_word_and_a_fraction_a_number(sensor: SensorSpec, value: float, word: bytes) -> None:
    command = Command("l0", "l0")
    read = CommandResult(
        1, 0.0, command, Status.READING, value, HERE, HERE, reading=Reading(sensor, value, value)
    )
    assert encode(RequestStyle.FRAMED, "float64", [(command, read)]).message() == b"[l0:" + word + b"]"
