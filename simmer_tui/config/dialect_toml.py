"""dialect.toml, the optional file of a set that describes a team's own language: its tables and their keys.

A key that is not given has the default of the field that it fills.
"""

from enum import StrEnum
from typing import Any

from simmer_tui.dialect.dialect_rules import Busy, CourseProtocol
from simmer_tui.dialect.frames import FrameKind
from simmer_tui.sim.rules import FlagRule, IntegerRule, NumberRule, RawTextRule, Rule, WordRule
from simmer_tui.sim.values import Value

# An hour: a longer time in a protocol is a mistake in the unit.
LONGEST_TIME = 3600.0
"""Longest time in a rule, seconds."""
# A mark of a message: a line end, or a few bytes that cannot occur by chance.
_MARK = RawTextRule(8)
_SECONDS = NumberRule(0, LONGEST_TIME)


def _key(name: str, rule: Rule[Any], help_text: str, unit: str = "") -> Value:
    return Value(rule, help_text, unit, name)


def _one_of(*members: StrEnum) -> WordRule:
    return WordRule(tuple(each.value for each in members), members)


FRAME = (
    _key(
        *("kind", _one_of(*FrameKind, *CourseProtocol)),
        "beginning and end of a message, or a protocol of the course, which needs no rules",
    ),
    _key("end", _MARK, "line: end of a message; binary: text that must follow the content"),
    _key(
        *("silence", _SECONDS),
        "time after which bytes without an end are a message (line) or dropped; 0: never",
        "s",
    ),
    _key("longest", IntegerRule(1, 65536), "most bytes of a message"),
    _key("open", _MARK, "bracket: beginning of a message"),
    _key("close", _MARK, "bracket: end of a message"),
)
"""The keys of [frame], by field of `Framing`: the form of messages to the robot."""
REPLY = (
    _key("end", _MARK, "added to every text reply"),
    _key("missing", RawTextRule(40), "reply for a reading without a finite value"),
)
"""The keys of [reply]: common properties of all replies."""
ROBOT = (
    _key(
        *("busy", _one_of(Busy.WAIT, Busy.REPLACE, Busy.DROP)),
        "effect of a movement that comes during another",
    ),
    _key(
        "reads",
        _one_of(Busy.NOW, Busy.WAIT),
        "reply to a message without a movement meanwhile: at once, or after the movement",
    ),
    _key("buffer", IntegerRule(1, 65536), "most bytes that wait; later ones are lost"),
    _key("boot", _SECONDS, "time after opening in which bytes are lost", "s"),
    _key("greeting", RawTextRule(256), "text sent after that"),
    _key("halts_after", _SECONDS, "silence that ends an untimed run, or velocity; 0: never", "s"),
    _key("runs_on", FlagRule(), "an untimed run continues when the program has left"),
)
"""The keys of [robot], by field of `RobotRules`: properties of the robot's own program."""
HEAD_KEYS = ("head", "names", "body")
"""Keys of [frame] for binary frames: struct format, its fields, and the field with the content's length."""
COMMAND_KEYS = {
    "match": "the message: text with {name} in place of a value, or a list of such texts",
    "type": "binary: value of the header's field type",
    "unpack": "binary: struct format and names of the content, <hh: x y",
    "if": "a condition on values and state; else the next command is tried",
    "do": "a step or a list of steps: w0-{n}, run w0, run w0 for {s} s, pause 0.2, stop, name = expression",
    "takes": "time until it begins and answers, seconds: a number or an expression",
    "reply": "sent when the first step begins: text, a binary frame, or a list of them",
    "done": "sent when the last step has ended",
    "stopped": "sent instead when something else has ended it",
    "busy": "its effect during a movement: now, wait, replace or drop",
}
"""Keys of a [[command]]."""
STREAM_KEYS = {
    "every": "period, seconds",
    "send": "the message, in the form of a reply",
    "if": "a condition on the state",
}
"""Keys of a [[stream]]."""
UNKNOWN_KEYS = {"reply": "reply to a message that no command matches; {text} is the message"}
"""Keys of [unknown]."""
REPLY_KEYS = {
    "type": "value of the header's field type",
    "text": "content as text",
    "pack": "struct format of the content",
    "values": "list of expressions for it",
    "times": "number of such frames; {k} counts them from 0",
}
"""Keys of a binary reply."""
TABLE_NAMES = ("frame", "reply", "robot", "state", "command", "stream", "unknown")
"""The tables of the file."""
