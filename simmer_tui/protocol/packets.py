"""The connection-per-message dialects: requests out of bytes, replies into bytes.

No sockets and no clock. One `RequestReader` serves one connection on the request port, one
`Mailbox` holds the replies that wait for the reply port.

| dialect | request | reply |
|---|---|---|
| framed | `[u0,w0:36]`; `][` also joins | `[u0:12.345,w0:True]` |
| legacy | `u0,w0-36`, ended by closing or falling silent | doubles, singles or text, as the user says |

A code is the first two characters of a command, the third is ignored, the rest is the value; the
code `xx` stops all motion. What cannot be a command is answered all the same, so that every request
but the empty one has one reply.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

from simmer_tui.sim.command import Command

GRACE = 0.005
"""Seconds of silence that end a request without brackets."""
MAX_COMMAND = 256
"""Longest command, bytes."""
MAX_REQUEST = 64 * 1024
"""Longest request, bytes."""
MAX_COMMANDS = 1000
"""Most commands in a request: as many as a mailbox holds replies."""
STOP = "xx"
"""The code that stops all motion."""

_BRACKET = re.compile(rb"[\[\]]")
_BLANK = b" \t\r\n"


class RequestStyle(StrEnum):
    """Style of a request."""

    FRAMED = "framed"
    LEGACY = "legacy"


@dataclass(frozen=True, slots=True)
class Request:
    """The commands that came as one message. None (`[]`) asks for no reply, but for a log line.

    `data` is the message as sent; no bytes if it is not fit to be passed on to a robot.
    """

    dialect: RequestStyle
    commands: tuple[Command, ...] = ()
    data: bytes = b""


_EMPTY = Request(RequestStyle.FRAMED)


class RequestReader:
    """Cuts what one connection sends into requests; holds at most `MAX_REQUEST` bytes.

    Feed it with `receive`, tell it of the end of the stream with `end`, and call `silence` when
    nothing has come for `idle_timeout` seconds. A packet whose brackets do not pair up is refused as a
    whole: of half a packet nobody knows what it was to say.
    """

    def __init__(self, grace: float = GRACE) -> None:
        self._grace = grace
        self._pending = bytearray()
        self._open = False
        self._discarding = False

    @property
    def idle_timeout(self) -> float | None:
        """Seconds of silence after which to call `silence`, or None while there is nothing to
        end: a packet with an open bracket may pause as long as it likes."""
        if self._open:
            return None
        return self._grace if self._discarding or self._pending.strip(_BLANK) else None

    @property
    def unfinished(self) -> bool:
        """True if bytes of a request have come whose end has not."""
        return self._open or self._discarding or bool(self._pending.strip(_BLANK))

    def receive(self, data: bytes) -> list[Request]:
        """The requests that `data` completes, in order. Never raises, whatever the bytes."""
        requests: list[Request] = []
        start = 0
        for bracket in _BRACKET.finditer(data):
            self._collect(data[start : bracket.start()], requests)
            if bracket.group() == b"[":
                self._open_packet(requests)
            else:
                self._close_packet(requests)
            start = bracket.end()
        self._collect(data[start:], requests)
        return requests

    def silence(self) -> list[Request]:
        """The request without brackets that a silence of `idle_timeout` seconds ends, if there is one."""
        return [] if self._open else self._end_legacy()

    def end(self) -> list[Request]:
        """The request whose end had not come when the sender closed."""
        if not self._open:
            return self._end_legacy()
        requests: list[Request] = []
        self._refuse_unclosed(requests)
        if not requests and not self._discarding:
            requests.append(_EMPTY)
        self._reset()
        return requests

    def _reset(self) -> None:
        self._pending.clear()
        self._open = self._discarding = False

    def _collect(self, data: bytes, requests: list[Request]) -> None:
        if self._discarding:
            return
        room = MAX_REQUEST - len(self._pending)
        self._pending += data[:room]
        if len(data) > room:
            dialect = RequestStyle.FRAMED if self._open else RequestStyle.LEGACY
            requests.append(_refusal(dialect, self._pending, f"a request has at most {MAX_REQUEST} bytes"))
            self._pending.clear()
            self._discarding = True

    def _open_packet(self, requests: list[Request]) -> None:
        if self._open:
            self._refuse_unclosed(requests)
        else:
            requests += self._end_legacy()
        self._reset()
        self._open = True

    def _close_packet(self, requests: list[Request]) -> None:
        if not self._discarding:
            if self._open:
                requests.append(_request(RequestStyle.FRAMED, bytes(self._pending)))
            elif stray := self._pending.strip(_BLANK):
                requests.append(_refusal(RequestStyle.FRAMED, stray, "a packet starts with ["))
            else:
                requests.append(_EMPTY)
        self._reset()

    def _refuse_unclosed(self, requests: list[Request]) -> None:
        if self._pending:
            requests.append(_refusal(RequestStyle.FRAMED, self._pending, "a packet ends with ]"))

    def _end_legacy(self) -> list[Request]:
        text = bytes(self._pending.strip(_BLANK))
        self._reset()
        return [_request(RequestStyle.LEGACY, text)] if text else []


def _request(dialect: RequestStyle, text: bytes) -> Request:
    if not text:
        return Request(dialect)
    pieces = text.split(b",")
    if len(pieces) > MAX_COMMANDS:
        return _refusal(dialect, text, f"a request has at most {MAX_COMMANDS} commands")
    data = b"[" + text + b"]" if dialect is RequestStyle.FRAMED else text
    return Request(dialect, tuple(_command(piece) for piece in pieces), data)


def _refusal(dialect: RequestStyle, text: bytes | bytearray, problem: str) -> Request:
    return Request(dialect, (_command(bytes(text[:MAX_COMMAND]), problem),))


def _command(piece: bytes, problem: str = "") -> Command:
    """A command with code and value. Spaces are kept: here, unlike on a line, the place counts."""
    if len(piece) > MAX_COMMAND:
        problem = problem or f"a command has at most {MAX_COMMAND} bytes"
    text = piece[:MAX_COMMAND].decode("latin-1")  # one character a byte, so that any byte passes
    if len(text) < 2:
        problem = problem or ("a code has two characters" if text else "an empty command")
    argument = text[3:] if len(text) > 2 else None
    return Command(text, text[:2], argument, problem=problem, stops=text[:2] == STOP and not problem)
