"""The course's own protocols on a serial port: bytes in, commands of the driven robot, replies out.

`[frame] kind` of a dialect.toml names them. The messages mean the same as over TCP (`links/protocol/`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.dialect.dialect_rules import CourseProtocol
from simmer_tui.dialect.frames import FrameKind, Framing
from simmer_tui.links.backend import CommandBudget, Message
from simmer_tui.links.link import LinkContext
from simmer_tui.links.protocol.binary import CommandReader, NumberEncoder
from simmer_tui.links.protocol.packets import Request, RequestReader, encode
from simmer_tui.robot.sessions import Answered, Session
from simmer_tui.run.events import WireMessage
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult

FRAMINGS = {
    CourseProtocol.PACKETS: Framing(kind=FrameKind.BRACKET),
    CourseProtocol.BINARY9000: Framing(),
}
"""Bytes at which a message may end, by protocol; the wire's delay is computed a message at a time."""


class CourseDevice:
    """A robot that speaks one of the course's protocols.

    Args:
        protocol: The protocol.
        context: The robot, and the form of replies.
        write: Sends bytes to the program.
    """

    def __init__(
        self, protocol: CourseProtocol, context: LinkContext, write: Callable[[bytes], None]
    ) -> None:
        settings = context.settings
        self._protocol = protocol
        self._context = context
        self._engine = context.engine
        self._write = write
        self._encoder = NumberEncoder(settings.reply_format, settings.byte_order)
        self._session: Session | None = None
        self._silences = 0
        """Count of bursts of bytes: a silence ends only the newest."""

    def opened(self) -> None:
        """A program has opened the port."""
        grace = self._context.settings.grace
        self._requests, self._commands = RequestReader(grace), CommandReader(grace=grace)
        at_end = self._context.answers_at_end(in_packets=self._protocol is CourseProtocol.PACKETS)
        self._budget = CommandBudget("on the serial port", self._engine.tell)
        self._session = self._engine.session(answer_at_end=at_end)

    def closed(self) -> None:
        """The program has closed the port."""
        if self._session is not None:
            self._session.close()
            self._session = None

    def received(self, data: bytes) -> None:
        """Bytes have come in."""
        if self._session is None:
            return
        if self._protocol is CourseProtocol.PACKETS:
            self._take_requests(self._requests.receive(data))
            idle_timeout = self._requests.idle_timeout
        else:
            late_end = self._commands.late_end(data)
            if late_end:
                self._context.backend.append_late(late_end, self._session)
            self._take_commands(self._commands.receive(data))
            idle_timeout = self._commands.idle_timeout
        self._silences += 1
        if idle_timeout is not None:
            silence = partial(self._fell_silent, self._silences)
            self._engine.call_at(self._engine.now() + idle_timeout, silence)

    def _fell_silent(self, burst: int) -> None:
        if burst != self._silences or self._session is None:
            return
        self._take_requests(self._requests.silence())
        self._take_commands(self._commands.silence())

    def _take_requests(self, requests: Sequence[Request]) -> None:
        for request in requests:
            if request.commands:
                form = ReplyForm(ReplyFormat.FRAMED)
                message = Message(request.data, request.commands, form)
                self._submit(message, partial(self._answer_request, request))

    def _take_commands(self, commands: Sequence[Command]) -> None:
        for command, sent in zip(commands, self._commands.sent, strict=False):
            self._submit(Message(sent, (command,), self._encoder.form), self._answer_command)

    def _submit(self, message: Message, answered: Answered) -> None:
        session = self._session
        assert session is not None, "bytes are taken while a program has the port open"
        shown = message.data.decode("latin-1")
        meaning = ", ".join(command.shown for command in message.commands)
        self._engine.tell(WireMessage(self._engine.now(), shown, meaning=meaning))
        self._context.backend.submit(message, session, answered, self._budget)

    def _answer_request(self, request: Request, results: Sequence[CommandResult], data: bytes | None) -> None:
        if data is None:
            answers = zip(request.commands, results, strict=True)
            data = encode(request.dialect, self._context.settings.legacy_reply, answers).message()
        self._write(data)

    def _answer_command(self, results: Sequence[CommandResult], data: bytes | None) -> None:
        self._write(self._encoder.reply(results[0]) if data is None else data)
