"""The messages in a stream of bytes, framed as a dialect.toml says. Sans-IO."""

import struct
from collections.abc import Iterator, Mapping
from enum import StrEnum
from itertools import groupby
from typing import Self

from msgspec import Struct, field

TYPE = "type"
"""The field of a binary header that is the type of message."""
_WITHOUT_END = "a message without its end"


class FrameKind(StrEnum):
    """Beginning and end of a message."""

    marks: tuple[str, ...]
    """Fields of `Framing` with the marks that a message must have, the last of which ends it."""
    arrives: str
    """The form in which a message arrives, for a rule that never matches; empty if any content arrives."""

    def __new__(cls, value: str, marks: tuple[str, ...] = (), arrives: str = "") -> Self:
        """A member with its row of the table below."""
        kind = str.__new__(cls, value)
        kind._value_, kind.marks, kind.arrives = value, marks, arrives
        return kind

    LINE = (
        *("line", ("end",)),
        "line ends and blanks around a message are dropped, and it ends at the first [frame] end",
    )
    BRACKET = "bracket", ("open", "close"), "match is the text between [frame] open and close"
    BYTE = "byte", (), "a message is one character here, of ASCII"
    BINARY = "binary"


class Framing(Struct, frozen=True):
    """[frame] of a dialect.toml.

    `end` ends a line, or must follow the content of a binary frame. `silence` is the time in seconds after
    which bytes without an end are a message, or are dropped; 0 is never. `longest` is in bytes. `head` is the
    struct format of a binary header with the fields `names`. `body` is the content's length, or the name of
    the field that has it.
    """

    kind: FrameKind = FrameKind.LINE
    end: bytes = b"\n"
    silence: float = 0.0
    longest: int = 256
    open: bytes = b"["
    close: bytes = b"]"
    head: str = ""
    names: tuple[str, ...] = ()
    body: str | int = 0

    def message(self, kind: int | None, content: bytes) -> bytes:
        """A message to the robot that carries `content`; `kind` is the type of a binary frame."""
        if self.kind is FrameKind.BINARY:
            return self.frame(kind, content)
        if self.kind is FrameKind.BRACKET:
            return self.open + content + self.close
        return content if self.kind is FrameKind.BYTE else content + self.end

    def pieces(self, data: bytes) -> Iterator[bytes]:
        """Bytes of messages in pieces that end where a message may end."""
        if self.kind is FrameKind.BYTE:
            yield from (data[at : at + 1] for at in range(len(data)))
            return
        end: bytes = getattr(self, self.kind.marks[-1]) if self.kind.marks else self.end
        rest = data
        while end and end in rest:
            piece, mark, rest = rest.partition(end)
            yield piece + mark
        if rest:
            yield rest

    def frame(self, kind: int | None, content: bytes) -> bytes:
        """A binary frame of a type that carries `content`, its length filled in."""
        fields = dict.fromkeys(self.names, 0)
        if kind is not None:
            fields[TYPE] = kind
        if isinstance(self.body, str):
            fields[self.body] = len(content)
        return struct.pack(self.head, *fields.values()) + content + self.end


class Frame(Struct, frozen=True):
    """A message: its bytes as received, its content, and the fields of a binary header."""

    data: bytes
    content: bytes
    head: Mapping[str, int] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The content as text. Bytes that are not UTF-8 match only {name:text}."""
        return self.content.decode("utf-8", "surrogateescape")


class Noise(Struct, frozen=True):
    """Bytes that belong to no message, and the reason."""

    data: bytes
    why: str


class Deframer:
    """Splits a stream of bytes into messages.

    Args:
        framing: How they are framed.
        types: The known values of a binary frame's `type`; if empty, all are known.
    """

    def __init__(self, framing: Framing, types: frozenset[int] = frozenset()) -> None:
        self._framing = framing
        self._types = types
        self._held = bytearray()
        self._searched = 0
        """Count of the first bytes that wait and in which no end begins."""
        self._skipping = False
        """True while the rest of a message that is too long is dropped."""

    @property
    def unfinished(self) -> bool:
        """True if a part of a message waits for the rest."""
        return bool(self._held)

    def receive(self, data: bytes) -> list[Frame | Noise]:
        """The messages that these bytes complete."""
        self._held += data
        by_kind = {
            FrameKind.LINE: self._lines,
            FrameKind.BRACKET: self._brackets,
            FrameKind.BYTE: self._bytes,
            FrameKind.BINARY: self._frames,
        }
        return list(_joined(by_kind[self._framing.kind]()))

    def silence(self) -> list[Frame | Noise]:
        """Called after `silence` seconds without bytes: a line is complete, anything else is dropped."""
        data = self._rest()
        if self._framing.kind is FrameKind.LINE:
            content = data.strip()
            return [Frame(data, content)] if content else []
        return [Noise(data, _WITHOUT_END)] if data else []

    def end(self) -> list[Noise]:
        """Called at the end of the stream: the rest is incomplete, and returned as noise."""
        data = self._rest()
        return [Noise(data, _WITHOUT_END)] if data.strip() else []

    def _rest(self) -> bytes:
        self._skipping = False
        return self._take(len(self._held))

    def _find(self, end: bytes, start: int = 0) -> int:
        """The index of the first end from `start` on, -1 if there is none. Bytes that wait are searched once,
        however many pieces a long message comes in."""
        at = self._held.find(end, max(start, self._searched))
        if at < 0:
            self._searched = max(0, len(self._held) - len(end) + 1)
        return at

    def _take(self, count: int) -> bytes:
        self._searched = 0
        taken = bytes(self._held[:count])
        del self._held[:count]
        return taken

    def _bytes(self) -> Iterator[Frame | Noise]:
        for value in self._take(len(self._held)):
            one = bytes((value,))
            yield Frame(one, one)

    def _lines(self) -> Iterator[Frame | Noise]:
        end, longest = self._framing.end, self._framing.longest
        while (at := self._find(end)) >= 0:
            data = self._take(at + len(end))
            content = data[:at].strip()
            if self._skipping or len(content) > longest:
                self._skipping = False
                yield Noise(data, _too_long(longest))
            elif content:
                yield Frame(data, content)
        # The longest content, and the bytes of an end that is incomplete.
        if len(self._held) > longest + len(end) or (self._skipping and self._held):
            self._skipping = True
            yield Noise(self._take(len(self._held) - len(end) + 1), _too_long(longest))

    def _brackets(self) -> Iterator[Frame | Noise]:
        begin, end, longest = self._framing.open, self._framing.close, self._framing.longest
        while self._held:
            at = self._held.find(begin)
            outside = len(self._held) if at < 0 else at
            if at < 0 and len(begin) > 1:
                outside = max(0, len(self._held) - len(begin) + 1)
            if outside:
                noise = self._take(outside)
                if noise.strip():
                    yield Noise(noise, f"outside {begin.decode('latin-1')}{end.decode('latin-1')}")
            if at < 0:
                return
            close = self._find(end, len(begin))
            if close < 0:
                if len(self._held) > longest:
                    yield Noise(self._take(len(self._held)), _too_long(longest))
                return
            data = self._take(close + len(end))
            if close - len(begin) > longest:
                yield Noise(data, _too_long(longest))
            else:
                yield Frame(data, data[len(begin) : close])

    def _frames(self) -> Iterator[Frame | Noise]:
        framing = self._framing
        size = struct.calcsize(framing.head)
        while len(self._held) >= size:
            head = dict(zip(framing.names, struct.unpack(framing.head, self._held[:size]), strict=True))
            length = framing.body if isinstance(framing.body, int) else int(head[framing.body])
            wrong = self._wrong(head, length)
            whole = size + length + len(framing.end)
            if not wrong and len(self._held) < whole:
                # A wrong end is detected at its first byte.
                return
            if not wrong and bytes(self._held[size + length : whole]) != framing.end:
                wrong = f"no {framing.end!r} behind the content"
            if wrong:
                yield Noise(self._to_next_end(), wrong)
                continue
            data = self._take(whole)
            yield Frame(data, data[size : size + length], head)

    def _wrong(self, head: Mapping[str, int], length: int) -> str:
        kind = head.get(TYPE)
        if self._types and kind is not None and kind not in self._types:
            return f"type {kind} is not known"
        if not 0 <= length <= self._framing.longest:
            return _too_long(self._framing.longest)
        return ""

    def _to_next_end(self) -> bytes:
        """The bytes up to the next end; all bytes, if there is none."""
        end = self._framing.end
        at = self._held.find(end) if end else -1
        return self._take(len(self._held) if at < 0 else at + len(end))


def _too_long(longest: int) -> str:
    return f"longer than {longest} bytes"


def _joined(parts: Iterator[Frame | Noise]) -> Iterator[Frame | Noise]:
    """The same, with consecutive noise of the same reason joined to one burst."""
    for why, same in groupby(parts, lambda part: part.why if isinstance(part, Noise) else None):
        if why is None:
            yield from same
        else:
            yield Noise(b"".join(part.data for part in same), why)
