"""Patterns of a dialect.toml: a message with `{name}` in place of each value.

    {n} number    {n:int} whole number    {n:digit} one digit    {n:word}    {n:text}    {n:list} codes: u0,u1
    {n=300} optional, with its default    {n:f=0|d=1} one of these words, which represents that value

A blank matches one or more. A brace itself is written twice. A pattern matches a whole message.

A pattern is a row of parts. Each takes as much as it can, and gives nothing back; only a {name:text} takes
what the parts after it leave. So each part visits each place of a message once: a message of twice the length
takes twice the steps.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.dialect.expressions import FieldValue
from simmer_tui.sim.command import NUMBER
from simmer_tui.sim.rules import did_you_mean

# Python refuses to convert numbers of thousands of digits.
_LONGEST_NUMBER = 40
"""Characters of a number in a message."""


class _Part(Struct, frozen=True):
    """A part of a pattern. One that may be `longest` characters long is searched at each place of a message.
    Of a longer one, with longest = 0, the ends are found in one pass: at each place in a `run` they are the
    same."""

    taken: re.Pattern[str]
    longest: int = 0
    run: re.Pattern[str] | None = None
    name: str = ""
    optional: bool = False

    def end(self, message: str, at: int, most: int | None = None) -> int:
        """Its end if it begins at an index, -1 if it cannot; with at most so many characters."""
        found = self.taken.match(message, at, len(message) if most is None else at + most)
        return found.end() if found else at if self.optional else -1

    def ends(self, message: str) -> Callable[[int], int]:
        """The function from each index to its end if it begins there, -1 if it cannot."""
        if self.longest:
            return lambda at: self.end(message, at, self.longest)
        ends = [*range(len(message) + 1)] if self.optional else [-1] * (len(message) + 1)
        run = self.run or self.taken
        for whole in self.taken.finditer(message):
            for same in run.finditer(message, *whole.span()):
                ends[slice(*same.span())] = [whole.end()] * len(same[0])
        return ends.__getitem__


_WORD = re.compile(r"\w+")
_BLANK = _Part(re.compile(r"\s+"))
_FIELDS = {
    # One character more, to tell a number that is too long.
    "number": (_Part(NUMBER, _LONGEST_NUMBER + 1), "7.5"),
    "int": (_Part(re.compile("[+-]?[0-9]+"), _LONGEST_NUMBER + 1), "7"),
    "digit": (_Part(re.compile("[0-9]"), 1), "7"),
    "word": (_Part(_WORD), "word"),
    "text": (_Part(re.compile("(?s:.*)")), "text"),
    "list": (_Part(re.compile(r"\w+(?:\s*,\s*\w+)*"), run=_WORD), "u0,u1"),
}
"""Part for a kind of field, and an example."""
NUMERIC = ("number", "int", "digit")
"""Kinds of fields that are numbers."""
NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
"""Name of a field, or of a value of a dialect."""
_FIELD = re.compile(r"(?P<brace>\{\{|\}\})|\{(?P<inside>[^{}]*)\}")
_TWICE = "a brace itself is written twice"


class Pattern:
    """A pattern that has been checked.

    Args:
        source: Its text.

    Raises:
        ValueError: A field is not as described above.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        if not source:
            raise ValueError("is empty; write the message as it is sent")
        self.kinds: dict[str, str] = {}
        """The kind of each field, `choice` for one of a few words."""
        self.choices: dict[str, dict[str, FieldValue]] = {}
        """The words of each choice, with their values."""
        self.defaults: dict[str, str] = {}
        """The defaults of fields, as text."""
        self._parts: list[_Part] = []
        example, end = "", 0
        for field in _FIELD.finditer(source):
            plain = source[end : field.start()]
            self._parts += _literals(plain)
            if field["brace"]:
                text = field["brace"][0]
                self._parts += _literals(text)
            else:
                part, text = self._field(field["inside"])
                self._parts.append(part)
            example += plain + text
            end = field.end()
        rest = source[end:]
        plain = _FIELD.sub("", source)
        if source not in ("{", "}") and (brace := next((each for each in plain if each in "{}"), "")):
            other = "}" if brace == "{" else "{"
            raise ValueError(f"'{source}' has a {brace} without its {other}; {_TWICE}")
        self.example = example + rest
        """A message that matches."""
        if list(self.kinds.values()).count("text") > 1:
            raise ValueError("has two fields of text; where the first one ends would not be clear")
        self._parts += _literals(rest)
        texts = [each.name for each in self._parts if self.kinds.get(each.name) == "text"]
        self._text = texts[0] if texts else ""
        self.names = frozenset(self.kinds)
        """The names of its fields."""

    def _field(self, inside: str) -> tuple[_Part, str]:
        """The part for a field, and an example."""
        name = NAME.match(inside)
        if name is None:
            raise ValueError(
                f"{{{inside}}}: a field begins with a name, such as {{n}} or {{n:int}}; {_TWICE}"
            )
        rest = inside[name.end() :]
        if name[0] in self.kinds:
            raise ValueError(f"has the field {{{name[0]}}} twice")
        if rest.startswith(":") and "|" in rest:
            return self._choice(name[0], rest[1:])
        kind, has_default, default = rest.partition("=")
        kind = kind.removeprefix(":") if kind else "number"
        if kind not in _FIELDS or (rest and rest[0] not in ":="):
            known = ", ".join(_FIELDS)
            raise ValueError(f"{{{inside}}}: '{kind}' is no kind of field; there are {known}"
                             f"{did_you_mean(kind, _FIELDS)}")  # fmt: skip
        self.kinds[name[0]] = kind
        part, example = _FIELDS[kind]
        if not has_default:
            return replace(part, name=name[0]), example
        if part.taken.fullmatch(default) is None:
            raise ValueError(f"{{{inside}}}: the default '{default}' is no {kind}")
        self.defaults[name[0]] = default
        return replace(part, name=name[0], optional=True), default

    def _choice(self, name: str, choices: str) -> tuple[_Part, str]:
        self.kinds[name] = "choice"
        words: dict[str, FieldValue] = {}
        for choice in choices.split("|"):
            word, stands, value = choice.partition("=")
            if not word or word in words:
                raise ValueError(f"{{{name}:{choices}}}: each word is given once, as in {{{name}:f=0|d=1}}")
            words[word] = _plain(value) if stands else word
        self.choices[name] = words
        longest_first = sorted(words, key=len, reverse=True)
        taken = re.compile("|".join(map(re.escape, longest_first)))
        return _Part(taken, len(longest_first[0]), name=name), next(iter(words))

    def filled(self, texts: Mapping[str, str]) -> str:
        """The message with a text for each field; a field without one has its default."""
        texts = {**self.defaults, **texts}

        def text(field: re.Match[str]) -> str:
            return field["brace"][0] if field["brace"] else texts[re.split("[:=]", field["inside"])[0]]

        return _FIELD.sub(text, self.source)

    def matches_in_any_case(self, message: str) -> bool:
        """True if the whole message matches, or would with other capitals."""
        return self._found(message, self._parts_in_any_case) is not None

    @cached_property
    def _parts_in_any_case(self) -> list[_Part]:
        cased = ((part, re.compile(part.taken.pattern, re.IGNORECASE)) for part in self._parts)
        return [replace(part, taken=taken) if part is not _BLANK else part for part, taken in cased]

    def match(self, message: str) -> dict[str, FieldValue] | None:
        """The values of the fields, or None if the whole message does not match."""
        found = self._found(message, self._parts)
        if found is None:
            return None
        values: dict[str, FieldValue] = {}
        for name, kind in self.kinds.items():
            text = found[name] or self.defaults.get(name, "")
            if kind in ("number", "int") and len(text) > _LONGEST_NUMBER:
                return None
            values[name] = self.choices[name][text] if kind == "choice" else _converted(kind, text)
        return values

    def _found(self, message: str, parts: Sequence[_Part]) -> dict[str, str] | None:
        """The text of each field in a message, empty for one that is missing."""
        found: dict[str, str] = {}
        at = 0
        for index, part in enumerate(parts):
            begin = at
            if part.name and part.name == self._text:
                at = _last_start(parts[index + 1 :], message, at)
            else:
                at = part.end(message, at)
            if at < 0:
                return None
            if part.name:
                found[part.name] = message[begin:at]
        return found if at == len(message) else None


def _last_start(parts: Sequence[_Part], message: str, first: int) -> int:
    """The last index, from `first` on, from which parts match the rest of a message; -1 if there is none."""
    ends = [part.ends(message) for part in parts]
    for start in range(len(message), first - 1, -1):
        # A text before a blank does not end with one.
        if parts and parts[0] is _BLANK and start > first and message[start - 1].isspace():
            continue
        at = start
        for end in ends:
            at = end(at)
            if at < 0:
                break
        if at == len(message):
            return start
    return -1


def _literals(text: str) -> list[_Part]:
    """The parts for a text without fields."""
    pieces = re.split(r"([ \t]+)", text)
    return [
        _BLANK if index % 2 else _Part(re.compile(re.escape(piece)), len(piece))
        for index, piece in enumerate(pieces)
        if piece
    ]


def _converted(kind: str, text: str) -> FieldValue:
    if kind in NUMERIC:
        return _plain(text)
    if kind == "list":
        return tuple(part.strip() for part in text.split(","))
    return text


def _plain(text: str) -> FieldValue:
    """The number in a text, an int if it is written as one; else the text."""
    if NUMBER.fullmatch(text) is None or len(text) > _LONGEST_NUMBER:
        return text
    return int(text) if text.lstrip("+-").isdigit() else float(text)
