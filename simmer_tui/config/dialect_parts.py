"""The parts of a dialect.toml's rules: expressions, texts and replies, each mistake with its place."""

import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ParamSpec, TypeVar

from simmer_tui.config.dialect_toml import LONGEST_TIME, REPLY_KEYS
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.dialect import expressions, kinds
from simmer_tui.dialect.dialect_rules import AnyReply, Parts
from simmer_tui.dialect.expressions import Expression
from simmer_tui.dialect.frames import TYPE, FrameKind, Framing
from simmer_tui.dialect.kinds import ANY_TYPE, NUMBER_TYPE, StaticType, ValueKind
from simmer_tui.dialect.templates import BinaryReply, Field, TextReply, check_pack, parsed_reply
from simmer_tui.sim.command import counted
from simmer_tui.sim.rules import did_you_mean, is_number, is_whole

# 50 times the cells of the greatest maze.
_MOST_FRAMES = 1000
"""Frames of one binary reply."""
READING = frozenset(("time", "contact"))
"""Names that every expression may use."""
Names = Mapping[str, StaticType]
"""The values of a message, with the static knowledge of each."""
P = ParamSpec("P")
_T = TypeVar("_T")


def without_gaps(parts: Iterable[_T | None]) -> tuple[_T, ...]:
    """The parts without None, which represents one that could not be read."""
    return tuple(each for each in parts if each is not None)


class RuleParts:
    """Reads the parts of rules. A part that cannot be read is a problem, and left out."""

    def __init__(self, file: TomlFile, parts: Parts) -> None:
        self._file = file
        self._parts = parts
        self._state: dict[str, expressions.FieldValue] = {}
        self._framing = Framing()
        self._reply_end = ""

    def _replies(self, given: Mapping[str, Any], key: str, prefix: str, names: Names) -> tuple[AnyReply, ...]:
        if key not in given:
            return ()
        listed = given[key] if isinstance(given[key], list) else [given[key]]
        place = prefix + key
        return without_gaps([self._made(place, self._reply, each, place, names) for each in listed])

    def _reply(self, given: object, place: str, names: Names) -> AnyReply | None:
        if isinstance(given, dict):
            return self._binary_reply(given, place, names)
        if not isinstance(given, str):
            raise ValueError("must be a text, a table for a binary frame, or a list of them")
        text = self._text(given, place, names)
        if self._framing.kind is FrameKind.BINARY and not self._reply_end:
            advice = 'write { type = 1, text = "..." }, or give plain texts an end by [reply] end'
            self._file.add_problem(place, f"a text is no binary frame; {advice}")
        return text

    def _binary_reply(self, given: Mapping[str, Any], place: str, names: Names) -> BinaryReply | None:
        if self._framing.kind is not FrameKind.BINARY:
            raise ValueError('a binary frame needs [frame] kind = "binary"')
        self._file.check_names(given, REPLY_KEYS, f"{place}.")
        kind, times = given.get("type"), given.get("times", 1)
        if TYPE in self._framing.names and not is_whole(kind):
            raise ValueError("needs the type of the frame, a whole number")
        if not is_whole(times) or not 1 <= times <= _MOST_FRAMES:
            raise ValueError(f"times must be a whole number from 1 to {_MOST_FRAMES}")
        if ("text" in given) is ("pack" in given):
            raise ValueError("needs either text, or pack with values")
        known = {**names, "k": NUMBER_TYPE}
        if "text" in given:
            text = self._text(str(given["text"]), place, known)
            reply = BinaryReply(kind, text=text, times=times) if text is not None else None
        else:
            pack, values = str(given["pack"]), self._packed(given, place, known)
            reply = BinaryReply(kind, pack=pack, values=values, times=times) if values is not None else None
        if reply is not None:
            self._check_length(reply, place)
        return reply

    def _packed(self, given: Mapping[str, Any], place: str, names: Names) -> tuple[Expression, ...] | None:
        """The values of a binary frame; None, and a problem, if one cannot be read."""
        values = given.get("values")
        if not isinstance(values, list):
            raise ValueError("values must be a list of expressions")
        made = without_gaps([self._expression(str(each), place, names) for each in values])
        for each in made:
            if kinds.kind(each, self._known(names)) is ValueKind.LIST:
                self._file.add_problem(place, f"'{each.source}' is a list; name its values one by one")
        check_pack(str(given["pack"]), len(values))
        return made if len(made) == len(values) else None

    def _check_length(self, reply: BinaryReply, place: str) -> None:
        """Report a frame whose length or type does not fit into its header."""
        framing = self._framing
        if not framing.head:
            return
        # Of a text, the part that is always the same.
        plain = [part for part in reply.text.parts if isinstance(part, str)] if reply.text else []
        size = struct.calcsize(reply.pack) if reply.pack else len("".join(plain).encode())
        if isinstance(framing.body, int) and size != framing.body and reply.pack:
            self._file.add_problem(place, f"has {counted(size, 'byte')}; the frame has {framing.body}")
            return
        try:
            framing.frame(reply.type, bytes(size))
        except struct.error:
            what = f"type {reply.type} or {size} bytes of content do not fit the header '{framing.head}'"
            self._file.add_problem(place, what)

    def _text(self, text: str, place: str, names: Names) -> TextReply | None:
        template, mistakes = parsed_reply(text)
        for each in mistakes:
            self._file.add_problem(place, each)
        for part in template.parts:
            if isinstance(part, Field):
                self._check_names(part.expression, place, names)
                for mistake in kinds.field_mistakes(part, self._known(names)):
                    self._file.add_problem(place, mistake)
        return None if mistakes else template

    def _time(self, given: object, place: str, names: Names) -> Expression | None:
        if not is_number(given):
            return self._expression(given, place, names, reads=False)
        if 0 <= given <= LONGEST_TIME:
            return Expression(repr(given))
        self._file.add_problem(place, f"must be from 0 to {LONGEST_TIME:g} s, not {given:g}")
        return None

    def _expression(
        self, given: object, place: str, names: Names, *, reads: bool = True
    ) -> Expression | None:
        """An expression. One that is a condition or a time must not read sensors."""
        if given is None:
            return None
        if not isinstance(given, str):
            self._file.add_problem(place, "must be an expression in quotes")
            return None
        made = self._made(place, Expression, given)
        if made is None:
            return None
        self._check_names(made, place, names)
        for mistake in kinds.mistakes(made, self._known(names)):
            self._file.add_problem(place, mistake)
        if not reads and (made.sensing or made.names & self._parts.readable):
            self._file.add_problem(place, "must not read a sensor; use values of the message and of [state]")
        return made

    def _check_names(self, expression: Expression, place: str, names: Names) -> None:
        known = {*names, *self._state, *self._parts.readable, *READING}
        for name in sorted(expression.names - known):
            hint = did_you_mean(name, (*known, *expressions.CONSTANTS))
            what = f"'{name}' is neither a value of the message, nor of [state], nor a sensor of the set"
            self._file.add_problem(place, what + (hint or f"; there are {', '.join(sorted(known))}"))

    def _known(self, names: Names) -> Names:
        """Kinds of all names. A value of the state may have any kind."""
        numbers = dict.fromkeys((*self._parts.readable, *READING), NUMBER_TYPE)
        lists = {
            code: StaticType(ValueKind.LIST, length=each.rays) for code, each in self._parts.lidars.items()
        }
        return {**numbers, **lists, **dict.fromkeys(self._state, ANY_TYPE), **names}

    def _made(self, place: str, make: Callable[P, _T], *args: P.args, **named: P.kwargs) -> _T | None:
        """Result of `make`; None, and a problem at the place, if it raises ValueError."""
        try:
            return make(*args, **named)
        except ValueError as error:
            self._file.add_problem(place, str(error))
            return None
