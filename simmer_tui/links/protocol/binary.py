"""The binary dialects: bare or newline-ended commands in, one floating-point number out.

The reply to a lidar's code is a count and so many numbers. A refusal is one NaN, as with every command.
"""

from simmer_tui.config.reply_formats import NUMBER_STRUCTS, ReplyForm, ReplyFormat
from simmer_tui.config.settings import ServerSettings
from simmer_tui.links.protocol.line_marks import has_marks_alone, without_marks
from simmer_tui.links.protocol.replies import pack_reply
from simmer_tui.sim.command import Command, parse_command
from simmer_tui.sim.records import CommandResult

# Judged: ten times as long as a code and a number with all its digits.
LONGEST_COMMAND = 256
"""Longest command, bytes. A longer one is answered once and skipped up to the next newline."""
GRACE = ServerSettings().grace
"""Seconds of silence after which bytes without a newline are a command."""
# Judged: longer than any pause in the middle of one long message.
SKIP_GRACE = 0.25
"""Seconds of silence that end an overlong command of a client that sends no newlines."""


class NumberEncoder:
    """Replies as numbers of one format (`float64`, `float32`) and byte order (`big`, `little`)."""

    def __init__(self, reply_format: str = "float64", byte_order: str = "big") -> None:
        self.form = ReplyForm(ReplyFormat(reply_format), byte_order)
        self._layout = NUMBER_STRUCTS[reply_format, byte_order]
        self.size = self._layout.size

    def reply(self, result: CommandResult) -> bytes:
        """The reply to a command: one number, or the count of a scan's ranges and the ranges."""
        reading = result.reading
        if reading is not None and reading.scan is not None:
            return pack_reply(self._layout, result.reply, result.ranges)
        try:
            return self._layout.pack(result.reply)
        except OverflowError:
            return pack_reply(self._layout, result.reply)


def typed(text: bytes, settings: ServerSettings) -> tuple[bytes, ReplyForm]:
    """A command as a program would send it, and the form of its reply."""
    return text + b"\n", ReplyForm(ReplyFormat(settings.reply_format), settings.byte_order)


class CommandReader:
    """Cuts the bytes of one connection into commands. It has no socket and no clock.

    A connection that has sent a newline is line-framed. Before that, bytes followed by silence are one
    command: call `silence` when nothing has come for `idle_timeout` seconds, unless that is None. `end`
    returns the last command when the sender closes. It holds at most `LONGEST_COMMAND` bytes and a newline.
    """

    def __init__(self, grace: float = GRACE) -> None:
        self._grace = grace
        self._buffer = b""
        self._lines = False
        self._skipping = False
        self._overlong: Command | None = None
        """A command being skipped that is not answered yet: without newlines its end is unknown,
        and a sender that waits for the answer may continue only after it."""
        self._just_taken = False
        self.at_rest = False
        """True after whole lines: the next bytes begin a line, and no silence ends anything."""
        self.sent: list[bytes] = []
        """Bytes of the commands returned last, with their line ends; empty for one that was cut short."""

    @property
    def idle_timeout(self) -> float | None:
        """Seconds of silence after which to call `silence`, or None."""
        if self._lines:
            return None
        if self._skipping:
            return SKIP_GRACE
        return self._grace if self._buffer else None

    @property
    def unended(self) -> bytes:
        """The bytes of an unfinished line, of a client that ends its lines."""
        return self._buffer if self._lines else b""

    def late_end(self, data: bytes) -> bytes:
        """The line end at the start of `data`, not received yet, that completes the previous command."""
        if not self._just_taken:
            return b""
        # The longer one first, or the return would be left over.
        for end in (b"\r\n", b"\n"):
            if data.startswith(end):
                return end
        return data if data == b"\r" else b""

    def receive(self, data: bytes) -> list[Command]:
        """Take bytes as they come. Returns the commands that they complete."""
        self.sent = []
        self.at_rest = False
        if self._just_taken:  # a newline right after a bare command belongs to it
            after_return = data.removeprefix(b"\r")
            if after_return.startswith(b"\n"):
                data = after_return[1:]
                self._lines = True
            elif data == b"\r":
                return []
            self._just_taken = False
        commands: list[Command] = []
        *lines, rest = (self._buffer + data).split(b"\n")
        for line in lines:
            if self._skipping:
                commands += self._skipped()
            elif len(line) > LONGEST_COMMAND + line.endswith(b"\r"):
                commands.append(self._refused(line))
                self.sent.append(b"")
            else:
                self.sent.append(line + b"\n")
                commands.append(self._command(line))
            self._lines = True
        self._buffer = self._kept(rest, commands)
        self.at_rest = self._lines and not (self._buffer or self._skipping)
        return commands

    def _kept(self, rest: bytes, commands: list[Command]) -> bytes:
        """The bytes kept of an unfinished command: none of an overlong one, which is refused."""
        if self._skipping:
            return b""
        if len(rest) <= LONGEST_COMMAND + rest.endswith(b"\r"):
            return rest
        self._skipping = True
        self._overlong = self._refused(rest)
        # With line ends the next command is found anyway: the refusal need not wait for the end.
        if self._lines:
            commands += self._answered()
        return b""

    def silence(self) -> list[Command]:
        """The command that ends because nothing has come for `idle_timeout` seconds."""
        if self.idle_timeout is None:
            return []
        if has_marks_alone(self._buffer):  # the command follows
            return []
        self._just_taken, self.at_rest = True, False
        return self.end()

    def end(self) -> list[Command]:
        """The last command: the sender has closed."""
        self.sent = []
        if self._skipping:
            return self._skipped()
        rest, self._buffer = self._buffer, b""
        if not rest or has_marks_alone(rest):
            return []
        self.sent.append(rest)
        return [self._command(rest)]

    def _skipped(self) -> list[Command]:
        """The end of an overlong command."""
        self._skipping = False
        return self._answered()

    def _answered(self) -> list[Command]:
        """The overlong command, if it has not been returned yet."""
        overlong, self._overlong = self._overlong, None
        if overlong is None:
            return []
        self.sent.append(b"")
        return [overlong]

    def _command(self, line: bytes) -> Command:
        return parse_command(without_marks(line).removesuffix(b"\r").decode("latin-1"))

    def _refused(self, line: bytes) -> Command:
        problem = f"a command has at most {LONGEST_COMMAND} bytes; the rest up to the next newline is skipped"
        return Command(line[:LONGEST_COMMAND].decode("latin-1"), problem=problem)
