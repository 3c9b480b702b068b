"""Bytes beside a text that its author did not write, in every protocol."""

from __future__ import annotations

import pytest

from simmer_tui.links.protocol.binary import CommandReader
from simmer_tui.links.protocol.line_marks import without_marks
from simmer_tui.links.protocol.packets import RequestReader

BEFORE = [
    b"\xef\xbb\xbf",
    b"\xef\xbb\xbf\xef\xbb\xbf",
    b"\0",
    b"\xff\xfb\x1f\xff\xfb\x20\xff\xfd\x03",
    b"\xff\xfa\x1f\0\x50\0\x18\xff\xf0",
    b"\xff\xf1",
    b"\xff\xfd\x03\xef\xbb\xbf",
]


@pytest.mark.parametrize("mark", BEFORE)
def test_marks_before_a_line_a_command_and_a_packet_are_left_out(mark: bytes) -> None:
    lines = CommandReader()
    assert [each.text for each in lines.receive(mark + b"u1\r\n" + mark + b"d1-3\n" + b"u2\0\n")] == [
        "u1",
        "d1-3",
        "u2",
    ]
    assert b"".join(lines.sent) == mark + b"u1\r\n" + mark + b"d1-3\n" + b"u2\0\n"
    assert [each.text for each in lines.receive(mark + b"u3\n")] == ["u3"]
    bare = CommandReader()
    if mark != b"\0":
        assert bare.receive(mark) == []
        assert bare.silence() == []
    assert bare.receive(mark + b"u1") == []
    assert [each.text for each in bare.silence()] == ["u1"]
    if mark == b"\0":
        return  # alone it is a command that is refused
    packets = RequestReader()
    for message in (mark + b"[u0,r1-45]", b"[" + mark + b"u0,r1-45]"):
        [request] = packets.receive(message)
        assert [each.text for each in request.commands] == ["u0", "r1-45"]
        assert request.data == b"[u0,r1-45]"
    assert packets.receive(mark + b"u0") == []
    [request] = packets.end()
    assert [each.text for each in request.commands] == ["u0"]


@pytest.mark.parametrize(
    "text", [b"\xffu1", b"\xfe\xffu1", b"u1-\xe4", b"\0", b"\0\r", b"\xff\xfeu0", b"\0\xff\x1b"]
)
def test_other_bytes_are_kept(text: bytes) -> None:
    assert without_marks(text) == text
