"""dialect.toml, the optional file of a set that describes a team's own language: its tables and their keys.

Annotations are evaluated here: they hold the descriptions of the keys.
"""

from typing import Annotated

from msgspec import Struct

from simmer_tui.dialect.dialect_rules import Busy, CourseProtocol
from simmer_tui.dialect.frames import FrameKind
from simmer_tui.sim.rules import ChoiceRule, FlagRule, IntegerRule, NumberRule, RawTextRule
from simmer_tui.sim.values import Value, described

FILE = "dialect.toml"
# An hour: what is longer in a protocol is a mistake in the unit.
LONGEST_TIME = 3600.0
"""Longest time in a rule, seconds."""
# The header of a message: a line end, or a few bytes that cannot come by chance.
_MARK = RawTextRule(8)
_SECONDS = NumberRule(0, LONGEST_TIME)
_BUSY = tuple(each.value for each in Busy)


class FrameTable(Struct, frozen=True, kw_only=True):
    """[frame]: what a message to the robot is."""

    kind: Annotated[
        str,
        Value(
            ChoiceRule((*(each.value for each in FrameKind), *(each.value for each in CourseProtocol))),
            "how a message begins and ends, or a protocol of the course, which needs no rules",
        ),
    ] = FrameKind.LINE.value
    end: Annotated[str, Value(_MARK, "line: what ends a message; binary: what must follow the content")] = (
        "\n"
    )
    silence: Annotated[
        float,
        Value(
            _SECONDS, "time after which bytes without an end are a message (line) or dropped; 0: never", "s"
        ),
    ] = 0.0
    longest: Annotated[int, Value(IntegerRule(1, 65536), "bytes that a message may have")] = 256
    open: Annotated[str, Value(_MARK, "bracket: what begins a message")] = "["
    close: Annotated[str, Value(_MARK, "bracket: what ends a message")] = "]"


class ReplyTable(Struct, frozen=True, kw_only=True):
    """[reply]: what all replies have in common."""

    end: Annotated[str, Value(_MARK, "added to every text reply")] = ""
    missing: Annotated[str, Value(RawTextRule(40), "what a reading without a finite value becomes")] = "inf"


class RobotTable(Struct, frozen=True, kw_only=True):
    """[robot]: how the robot's own program takes messages."""

    busy: Annotated[
        str, Value(ChoiceRule(_BUSY[1:]), "what becomes of a movement that comes during another")
    ] = Busy.WAIT.value
    reads: Annotated[
        str, Value(ChoiceRule(_BUSY[:2]), "when a message without a movement is answered meanwhile")
    ] = Busy.NOW.value
    buffer: Annotated[int, Value(IntegerRule(1, 65536), "bytes that wait at most; later ones are lost")] = 64
    boot: Annotated[float, Value(_SECONDS, "time after opening in which bytes are lost", "s")] = 0.0
    greeting: Annotated[str, Value(RawTextRule(256), "text sent after that")] = ""
    halts_after: Annotated[
        float, Value(_SECONDS, "time without any byte after which an untimed run stops; 0: never", "s")
    ] = 0.0
    runs_on: Annotated[bool, Value(FlagRule(), "an untimed run goes on when the program has left")] = False


FRAME, REPLY, ROBOT = described(FrameTable()), described(ReplyTable()), described(RobotTable())
"""The keys of the three tables."""
HEAD_KEYS = ("head", "names", "body")
"""Keys of [frame] for binary frames: struct format, its fields, and which of them is the content's length."""
COMMAND_KEYS = {
    "match": "the message: text with {name} where a value stands, or a list of such texts",
    "type": "binary: value of the header's field type",
    "unpack": "binary: struct format and names of the content, <hh: x y",
    "if": "a condition on values and state; else the next command is tried",
    "do": "a step or a list of steps: w0-{n}, run w0, run w0 for {s} s, pause 0.2, stop, name = expression",
    "takes": "time until it begins and answers, seconds: a number or an expression",
    "reply": "sent when the first step begins: text, a binary frame, or a list of them",
    "done": "sent when the last step has ended",
    "stopped": "sent instead when something else has ended it",
    "busy": "what becomes of it during a movement: now, wait, replace or drop",
}
"""Keys of a [[command]]."""
STREAM_KEYS = {
    "every": "period, seconds",
    "send": "what is sent, as a reply",
    "if": "a condition on the state",
}
"""Keys of a [[stream]]."""
UNKNOWN_KEYS = {"reply": "reply to a message that no command matches, {text} being it"}
"""Keys of [unknown]."""
REPLY_KEYS = {
    "type": "value of the header's field type",
    "text": "content as text",
    "pack": "struct format of the content",
    "values": "list of expressions for it",
    "times": "how many such frames, {k} counting from 0",
}
"""Keys of a binary reply."""
TABLES = ("frame", "reply", "robot", "state", "command", "stream", "unknown")
"""The tables of the file."""
