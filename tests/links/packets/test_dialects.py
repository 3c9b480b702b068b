"""Each dialect byte by byte: what a program sends, and what it reads."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest

# The stock robot at its start: 36 in of free way ahead (the wall begins at 48), 3 in to the sensor.
AHEAD = 48 - 6 - 3


def doubles(*numbers: float) -> bytes:
    return struct.pack(f"<{len(numbers)}d", *numbers)


def singles(*numbers: float) -> bytes:
    return struct.pack(f"<{len(numbers)}f", *numbers)


def noiseless(bench: Any) -> None:
    bench.simulator.noise = False


FRAMED = [
    (b"[u0]", 1, b"[u0:39.0]"),
    (b"[u0,m0,i0]", 3, b"[u0:39.0,m0:0.0,i0:False]"),
    (b"[w0:36]", 1, b"[w0:True]"),
    (b"[w0-36]", 1, b"[w0:True]"),
    (b"[u0,u1,w0:3]", 3, b"[u0:39.0,u1:41.0,w0:True]"),
    (b"[u0][m0]", 2, b"[u0:39.0,m0:0.0]"),
    (b"[w0:3,r0:90]", 2, b"[w0:True,r0:False]"),
    (b"[zz]", 1, b"[zz:Not Found]"),
    (b"[xx]", 1, b"[xx:DRIVE STOP]"),
    (b"[w0:3,xx]", 2, b"[w0:True,xx:DRIVE STOP]"),
]
LEGACY = [
    (b"u0", [AHEAD]),
    (b"u0,m0,i0", [AHEAD, 0.0, 0.0]),
    (b"w0-36", [math.inf]),
    (b"w0-36,r0--90", [math.inf, math.nan]),
    (b"zz", [math.nan]),
    (b"xx", [math.inf]),
    (b"w0-abc,u0", [math.nan, AHEAD]),
]


@pytest.mark.parametrize("split", [False, True], ids=["whole", "byte by byte"])
@pytest.mark.parametrize(("request_bytes", "items", "reply"), FRAMED)
def test_packets_are_answered_as_recorded(
    on_clock: Any, request_bytes: bytes, items: int, reply: bytes, split: bool
) -> None:
    async def scenario(bench: Any) -> Any:
        noiseless(bench)
        if not split:
            return await bench.ask(request_bytes, items)
        sender = await bench.connect(0)
        for byte in request_bytes:
            await bench.clock.sock_sendall(sender, bytes([byte]))
            await bench.clock.pass_by(0.004)
        sender.close()
        await bench.clock.until(lambda: len(bench.outcomes) == items)
        return await bench.read()

    assert on_clock(scenario) == reply


@pytest.mark.quick_cases(14)
@pytest.mark.parametrize("ended_by", ["closing", "silence"])
@pytest.mark.parametrize(("request_bytes", "numbers"), LEGACY)
@pytest.mark.parametrize("form", ["float64", "float32", "text"])
def test_requests_without_brackets_are_answered_in_the_form_that_is_set(
    on_clock: Any, form: str, request_bytes: bytes, numbers: list[float], ended_by: str
) -> None:
    async def scenario(bench: Any) -> bytes:
        noiseless(bench)
        if ended_by == "closing":
            await bench.send(request_bytes, len(numbers))
        else:
            sender = await bench.connect(0)
            await bench.clock.sock_sendall(sender, request_bytes)
            await bench.clock.until(lambda: bench.link.busy and bench.traffic.speaking)
            await bench.clock.pass_by(0.006)
            await bench.clock.until(lambda: len(bench.outcomes) == len(numbers))
        reply: bytes = await bench.read()
        return reply

    expected = {
        "float64": doubles(*numbers),
        "float32": singles(*numbers),
        "text": b"|".join(str(float(number)).encode() for number in numbers),
    }
    assert on_clock(scenario, link={"legacy_reply": form}) == expected[form]


def test_a_session_of_1_2_as_recorded(on_clock: Any) -> None:
    """A program that drives, is told that it is busy, probes with a zero drive and turns."""
    exchange = [
        (0.0, b"[u0]", b"[u0:39.0]"),
        (0.1, b"[w0:6]", b"[w0:True]"),
        (0.2, b"[w0:6]", b"[w0:False]"),
        (0.2, b"[m0]", b"[m0:2.4]"),
        (0.4, b"[w0:0]", b"[w0:False]"),
        (0.3, b"[w0:0]", b"[w0:True]"),
        (0.0, b"[u0,m0]", b"[u0:33.0,m0:6.0]"),
        (0.0, b"[r0:-90]", b"[r0:True]"),
        (0.5, b"[r0:0]", b"[r0:False]"),
        (0.3, b"[r0:0]", b"[r0:True]"),
    ]

    async def scenario(bench: Any) -> list[bytes]:
        noiseless(bench)
        replies = []
        for pause, request, _ in exchange:
            await bench.clock.pass_by(pause)
            replies.append(await bench.ask(request, request.count(b",") + 1))
        assert bench.simulator.pose.heading == pytest.approx(180)
        return replies

    assert on_clock(scenario) == [reply for _, _, reply in exchange]


def test_a_session_of_0_1_as_recorded(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[bytes]:
        noiseless(bench)
        replies = [await bench.ask(request, 1) for request in (b"u0", b"w0-1.5", b"w0-1", b"xx", b"q9")]
        await bench.send(b"u1", 1)
        await bench.send(b"m2", 1)
        return [*replies, await bench.read()]

    replies = on_clock(scenario, link={"legacy_reply": "text"})
    assert replies == [b"39.0", b"inf", b"nan", b"inf", b"nan", b"41.0|0.0"]


def test_what_waits_is_merged_oldest_first(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        noiseless(bench)
        for request in (b"[u0]", b"[w0:1,i0]", b"[m0]"):
            await bench.send(request, request.count(b",") + 1)
        reply: bytes = await bench.read()
        return reply

    assert on_clock(scenario) == b"[u0:39.0,w0:True,i0:False,m0:0.0]"


def test_in_instant_motion_a_drive_is_done_when_it_is_answered(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[bytes]:
        noiseless(bench)
        return [await bench.ask(request, 1) for request in (b"[w0:6]", b"[w0:6]", b"[m0]")]

    replies = on_clock(scenario, engine={"timed": False})
    assert replies == [b"[w0:True]", b"[w0:True]", b"[m0:12.0]"]
