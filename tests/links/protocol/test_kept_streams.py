"""Bytes as they may come, in pieces and with pauses: what the readers of every protocol make of them is what
was kept. And their limits, on both sides."""

from __future__ import annotations

import copy
import math
import random
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simmer_tui.config.reply_formats import ReplyEnd, ReplyForm, ReplyFormat
from simmer_tui.config.settings import ServerSettings
from simmer_tui.links.protocol import binary, packets
from simmer_tui.links.protocol.binary import CommandReader
from simmer_tui.links.protocol.packets import Mailbox, Reply, Request, RequestReader, ranges_text
from simmer_tui.links.protocol.replies import ReplyFramer, pack_reply, read_numbers
from simmer_tui.sim import Command, parse_command
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_streams.json")


def text(data: bytes | None) -> str | None:
    """Bytes as a text of at most 40 characters, and their count."""
    if data is None:
        return None
    return data.decode("latin-1") if len(data) <= 40 else f"{data[:30]!r} and so on, {len(data)}"


def told(commands: list[Command] | tuple[Command, ...]) -> list[str]:
    return [
        f"{text(each.text.encode('latin-1'))}|{each.source}|{each.problem}{each.stops}" for each in commands
    ]


LINES = [
    b"u1",
    b"d1-2",
    b"\n",
    b"\r\n",
    b"\r",
    b"\r\n",
    b"\n",
    b"u",
    b" u2 ",
    b"u1\nu2\n",
    b"u1\n",
    b"x" * 256,
]
LINES += [b"x" * 257, b"x" * 255, b"x" * 256 + b"\r\n", b"x" * 256 + b"\n", b"x" * 257 + b"\r", b"\xff"]


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize("seed", range(8))
def test_commands_are_those_that_were_kept(seed: int) -> None:
    chance = random.Random(seed)
    reader, found = CommandReader(0.25 if seed % 2 else binary.GRACE), []
    for _ in range(60):
        step: list[Any] = []
        if chance.random() < 0.75:
            data = chance.choice(LINES)
            step += [text(data), text(reader.late_end(data)), told(reader.receive(data))]
        else:
            step += [told(reader.silence() if chance.random() < 0.9 else reader.end())]
        found.append([*step, list(map(text, reader.sent)), reader.idle_timeout, text(reader.unended)])
    assert_kept(found, KEPT, f"commands {seed}")


PACKETS = [b"[", b"]", b"u0", b",", b"xx", b"w0:3", b"[u0,xx]", b"[]", b" ", b"\r\n", b"\xff", b"x" * 256]
PACKETS += [b"x" * 257, b"u0," * 500, b"y" * 40_000, b"[w0-3]", b"]["]


def shown(requests: list[Request]) -> list[Any]:
    return [
        [each.dialect.value, told(each.commands)[:3], len(each.commands), text(each.data)]
        for each in requests
    ]


@pytest.mark.parametrize("seed", range(6))
def test_requests_are_those_that_were_kept(seed: int) -> None:
    chance = random.Random(seed)
    reader, found = RequestReader(0.25 if seed % 2 else packets.GRACE), []
    for _ in range(60):
        step: list[Any] = []
        if chance.random() < 0.8:
            data = chance.choice(PACKETS)
            step += [text(data), shown(reader.receive(data))]
        else:
            step += [shown(reader.silence() if chance.random() < 0.8 else reader.end())]
        found.append([*step, reader.idle_timeout, reader.unfinished])
    assert_kept(found, KEPT, f"requests {seed}")


REPLIES = [
    b"12.5\r\n",
    b"nan\n",
    b"hello\r\n",
    b"1|2\n",
    b"[u0:1]",
    b"[u0",
    b"]",
    b"drive stop\n",
    b"True|inf\n",
]
REPLIES += [struct.pack(">d", 12.5), struct.pack("<2d", 2.0, 7.5), struct.pack("<f", 3.0), b"\x00\x01"]
REPLIES += [struct.pack("<3f", 2.0, 1.5, 2.5), struct.pack("<d", math.nan), b"I am a robot. ", b"z" * 70, b""]


@pytest.mark.parametrize("seed", range(12))
def test_replies_are_those_that_were_kept(seed: int) -> None:
    chance = random.Random(seed)
    framer, found = ReplyFramer(), []
    for _ in range(60):
        step: list[Any] = []
        kind = chance.random()
        if kind < 0.3:
            end, count = chance.choice(list(ReplyEnd)), chance.choice((1, 1, 2))
            scans = chance.choice(((), (True,) * count, (False, True)[-count:], (False,) * count))
            keep, order = chance.random() < 0.4, chance.choice(("big", "little"))
            framer.expect(end, count, keep=keep, scans=scans, byte_order=order)
            step = [end.value, count, keep, scans, order]
        elif kind < 0.8:
            data = chance.choice(REPLIES)
            step = [text(data), text(framer.receive(data))]
        elif kind < 0.92:
            step = ["silence", text(framer.silence())]
        elif kind < 0.94:
            framer.doubt()
        elif kind < 0.96:
            framer.abandon()
        elif kind < 0.98:
            framer.following = chance.choice((0, 1, 2))
            step = [framer.following]
        else:
            count, sample = framer.take_discarded()
            step = [count, text(sample)]
        found.append([*step, framer.idle_timeout, framer.discarded])
    assert_kept(found, KEPT, f"replies {seed}")


TEXTS = [
    b"1,2;3|4",
    b" 7 ",
    b"sc:1;2;inf",
    b"[u0:1.5,sc:1.0;2.0,i0:False]",
    b"[sc:nan;nan]",
    b"nan;2",
    b"OVF|-INF",
]
TEXTS += [
    b"1|2;3;nan|True",
    b"Drive Stop,x",
    b"[a:b:3.5, c: 4 ]",
    b"1e3 2e-3 .5 5. +7 -8",
    b"true FALSE",
    b"0x10",
]


def test_numbers_of_replies_are_those_that_were_kept() -> None:
    found = []
    asked = ((True,), (False, True), (True, True, False), (False, False, True, True))
    for data in TEXTS:
        for sensing in asked:
            odd = tuple(number % 2 == 1 for number in range(len(sensing)))
            form = ReplyForm(ReplyFormat.TEXT)
            found += [read_numbers(data, form, sensing, scans) for scans in ((), odd, (True,) * len(sensing))]
    numbers = struct.pack("<7d", 5.0, 2.0, 1.5, 2.5, math.nan, 3.0, 1.0)
    for cut in (56, 55, 48, 24, 8, 7, 0):
        for scans in ((False,) * 4, (False, True, True, True), (True, False, False, False)):
            form = ReplyForm(ReplyFormat.FLOAT64)
            found.append(read_numbers(numbers[:cut], form, (True,) * 4, scans))
    assert_kept(found, KEPT, "numbers")


# -- limits ------------------------------------------------------------------------------------------------


def trusting(end: ReplyEnd, **options: Any) -> ReplyFramer:
    """A framer that has had a reply, and expects another."""
    framer = ReplyFramer()
    framer.expect(ReplyEnd.QUIET)
    framer.receive(b"x")
    assert framer.silence() == b"x"
    framer.expect(end, **options)
    return framer


@pytest.mark.parametrize(
    ("data", "is_reply"),
    [
        (bytes.fromhex("4e6e6b27"), True),  # 999999936 as a float32, all printable
        (bytes.fromhex("4e6e6b28"), False),  # 1e9
        (bytes.fromhex("276b6e4e"), True),  # the other order of bytes
        (bytes.fromhex("31202020"), True),  # 2.3e-9
        (bytes.fromhex("307e7e7e"), False),  # 9.3e-10
        (bytes.fromhex("3f202020"), True),  # 0.6
        (bytes.fromhex("bf202020"), True),  # -0.6, not printable
        (bytes.fromhex("7e7e7e7f"), True),  # 7f is no character
        (bytes.fromhex("0d0a0920"), False),
        (bytes.fromhex("0d0a0b20"), True),
    ],
)
def test_text_in_place_of_a_number_is_no_reply(data: bytes, is_reply: bool) -> None:
    assert trusting(ReplyEnd.FLOAT32).receive(data) == (data if is_reply else None)


def test_text_in_place_of_two_numbers_is_no_reply_unless_both_are_likely() -> None:
    likely, text_only = bytes.fromhex("4e6e6b27"), bytes.fromhex("4e6e6b28")
    for data, found in (
        (likely + likely, likely + likely),
        (likely + text_only, None),
        (text_only + likely, None),
    ):
        assert trusting(ReplyEnd.FLOAT32, count=2).receive(data) == found


def test_a_scan_has_4000_rays_at_most() -> None:
    for count, whole in ((4000, True), (4001, False)):
        data = struct.pack(f"<{count + 1}f", count, *[1.5] * count)
        framer = trusting(ReplyEnd.FLOAT32, scans=[True])
        assert (framer.receive(data) == data) == whole
        (answer,) = read_numbers(data, ReplyForm(ReplyFormat.FLOAT32), [True], [True])
        assert (np.size(answer) == count) == whole


@pytest.mark.parametrize("following", [0, 1, 2])
def test_behind_a_scan_only_the_replies_that_are_due_may_come(following: int) -> None:
    data = struct.pack("<3f", 2.0, 1.5, 2.5)
    for behind in range(12):
        framer = ReplyFramer()
        framer.following = following
        framer.expect(ReplyEnd.FLOAT32, scans=[True])
        assert framer.receive(b"\xff\xfe" + data + bytes(behind)) is None
        is_due = behind in (0, 4, 8)[: following + 1]
        assert framer.silence() == (data if is_due else None)
        assert framer.discarded == (2 if is_due else 0)


@pytest.mark.parametrize(("end", "data"), [(ReplyEnd.NEWLINE, b"1\n2\n"), (ReplyEnd.BRACKET, b"[1][2]")])
def test_of_two_replies_the_first_counts_and_in_doubt_the_last(end: ReplyEnd, data: bytes) -> None:
    assert trusting(end).receive(data) == data[: len(data) // 2]
    framer = ReplyFramer()
    framer.expect(end)
    assert framer.receive(data) is None
    assert framer.silence() == data[len(data) // 2 :]


def test_65536_bytes_are_kept_of_a_reply_without_an_end() -> None:
    framer = trusting(ReplyEnd.BRACKET)
    assert framer.receive(b"[" + b"x" * 65535) is None
    assert framer.discarded == 0
    assert framer.receive(b"yz") is None
    assert framer.take_discarded() == (2, b"[x")
    assert framer.receive(b"]") is None


def test_60_of_the_discarded_bytes_are_shown() -> None:
    framer = ReplyFramer()
    framer.receive(b"a" * 59)
    framer.receive(b"bcd")
    framer.receive(b"e")
    assert framer.take_discarded() == (63, b"a" * 59 + b"b")
    assert framer.take_discarded() == (0, b"")


def test_pauses_that_end_something_are_those_that_were_measured() -> None:
    reader, requests, framer = CommandReader(), RequestReader(), ReplyFramer()
    reader.receive(b"u1")
    requests.receive(b"u1")
    framer.expect(ReplyEnd.QUIET)
    framer.receive(b"1")
    assert (reader.idle_timeout, requests.idle_timeout, framer.idle_timeout) == (0.005, 0.005, 0.05)
    reader.receive(b"x" * 300)
    assert reader.idle_timeout == 0.25


def test_a_request_has_65536_bytes_and_1000_commands_at_most() -> None:
    for size, problem in (
        (65536, "a command has at most 256 bytes"),
        (65537, "a request has at most 65536 bytes"),
    ):
        (request,) = RequestReader().receive(b"[" + b"x" * size + b"]")
        assert request.commands[0].problem == problem
    for count, commands in ((1000, 1000), (1001, 1)):
        (request,) = RequestReader().receive(b"[" + b",".join([b"u0"] * count) + b"]")
        assert len(request.commands) == commands


def test_at_rest_a_whole_line_is_one_command_whatever_came_before() -> None:
    chance, times = random.Random(5), 0
    reader = CommandReader()
    for _ in range(300):
        if chance.random() < 0.75:
            reader.receive(chance.choice(LINES))
        else:
            reader.silence() if chance.random() < 0.9 else reader.end()
        if reader.at_rest:
            times += 1
            assert (reader.idle_timeout, reader.unended, reader.late_end(b"\n")) == (None, b"", b"")
            again = copy.deepcopy(reader)
            assert told(again.receive(b"u1\n")) == told([parse_command("u1")])
            assert (again.sent, again.at_rest) == ([b"u1\n"], True)
    assert times > 20


def test_replies_that_wait_can_be_asked_for_by_their_time() -> None:
    box = Mailbox()
    for time in (1.0, 2.0, 3.0):
        assert box.put(Reply(ReplyFormat.FRAMED, (b"%d" % time, b"x")), "a", time) == 0
    assert (box.has("a"), box.has("b")) == (True, False)
    assert [box.drop("a", before) for before in (1.0, 1.1)] == [0, 2]
    assert (box.drop("b"), len(box)) == (0, 4)
    assert (box.oldest, box.expire(2.0), box.expire(2.1), box.oldest) == (2.0, 0, 2, 3.0)
    assert box.take() == b"[3,x]"
    assert (box.take(), len(box), box.has("a"), box.oldest) == (b"", 0, False, math.inf)


def test_a_full_mailbox_drops_parts_of_replies() -> None:
    box = Mailbox(3)
    replies = [
        Reply(ReplyFormat.TEXT, items) for items in ((b"a", b"b"), (b"c", b"d"), (b"e", b"f", b"g", b"h"))
    ]
    assert [box.put(reply) for reply in replies[:2]] == [0, 1]
    assert [box.holds(reply) for reply in replies] == [True, True, False]
    assert (len(box), box.put(replies[2])) == (3, 4)
    assert [box.holds(reply) for reply in replies] == [False, False, True]
    assert (len(box), box.take()) == (3, b"f|g|h")


def test_commands_are_typed_in_the_form_of_their_protocol() -> None:
    settings = ServerSettings(reply_format="float32", byte_order="little")
    assert binary.typed(b"u1", settings) == (b"u1\n", ReplyForm(ReplyFormat.FLOAT32, "little"))
    assert packets.typed(b"u1", settings) == (b"[u1]", ReplyForm(ReplyFormat.FRAMED))


def test_ranges_beyond_a_float32_are_infinite() -> None:
    found = pack_reply(struct.Struct("<f"), 1.5, np.array([1.5, 1e300, -1e300, math.inf]))
    assert found == struct.pack("<5f", 4, 1.5, math.inf, -math.inf, math.inf)
    assert ranges_text(np.array([1.23456, 2.0, math.inf])) == "1.235;2.000;inf"
