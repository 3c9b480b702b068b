"""The text of a command, `CC` or `CC-V`, parsed."""

import re
from collections.abc import Sequence

from msgspec import Struct

from simmer_tui import platform_has

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
"""A decimal number as people and MATLAB's num2str write it; Python's float accepts far more."""

# 16 miles, far beyond any maze; at 1e6 in a coordinate still has nine decimals. At 1e6 in/s a robot crosses a
# maze in a ten-thousandth of a second.
LARGEST_VALUE = 1e6
"""Greatest movement (times Gain) that one command may ask for, inches or degrees, and greatest speed, in/s or
deg/s."""
# No bundled or imported set has it: codes of robots begin with a letter. A set that has it keeps it.
MISSION_QUERY = "?m"
"""Code of the query for the facts of the mission."""
PEOPLE = frozenset(("console", "keys"))
"""Sources of commands by people at the screen; all others are programs. Only programs send theirs over the
link."""


class Command(Struct, frozen=True):
    """One command: its text as sent, the two-character `code`, and the text after the separator.

    `source` is its sender (`client`, `console`, ...). `problem` is set when the text cannot be a command at
    all. A command with `stops` ends all motion, whatever its code, because dialects have their own word for
    it. Text from outside may contain any character; show `shown`, not `text`.
    """

    text: str
    code: str = ""
    argument: str | None = None
    source: str = "client"
    problem: str = ""
    stops: bool = False

    @property
    def shown(self) -> str:
        """The text with control and non-ASCII characters escaped, safe on any terminal."""
        return escape(self.text)


# Judged: the longest names people give; a line of a wide terminal; several of them, so that the end of a path
# is still seen.
_WORD, _LINE, _PASSAGE = 40, 120, 400
"""Characters shown of a text from outside: of a word in a sentence, of a line, and of a path or sentences."""


def escape(text: str, limit: int = _LINE) -> str:
    """Text from outside made safe to show: control and non-ASCII characters escaped, cut at
    `limit` characters."""
    # Nearly every text is plain; this is asked for each command.
    if text.isascii() and text.isprintable():
        shown = text
    else:
        shown = "".join(c if c.isascii() and c.isprintable() else _escaped(c) for c in text)
    return _cut(shown, limit)


def _cut(shown: str, limit: int) -> str:
    return shown if len(shown) <= limit else shown[: limit - 3] + "..."


def _escaped(character: str) -> str:
    """A character as its escape sequence. A byte that was no UTF-8, a surrogate in Python's texts, is shown
    as that byte."""
    if "\udc80" <= character <= "\udcff":
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode()


def escape_word(text: str) -> str:
    """A code, value or name made safe to show in a sentence."""
    return escape(text, _WORD)


def escape_passage(text: str) -> str:
    """A text of several lines, or sentences, made safe to show."""
    return escape(text, _PASSAGE)


def shown_passage(text: str) -> str:
    """Sentences with a command or a path to type, made safe to show: letters of all scripts stay."""
    return _cut(printable(text), _PASSAGE)


def shown_path(path: object) -> str:
    """A path made safe to show. Letters of all scripts stay: people type commands with the path."""
    return shown_passage(str(path))


def printable(text: str) -> str:
    """The whole text with control characters escaped, because they could control a terminal or break a page.
    Other scripts stay."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else _escaped(c) for c in text)


def typed_path(path: object) -> str:
    """A path as it can be typed in a shell, unless it has control characters."""
    return platform_has.shell_line([printable(str(path))])


def plural(number: int, noun: str) -> str:
    """The noun behind a number: `contact` for 1, else `contacts`."""
    return noun if number == 1 else f"{noun}s"


def counted(number: int, noun: str) -> str:
    """`1 contact`, `3 contacts`."""
    return f"{number} {plural(number, noun)}"


def first_of(texts: Sequence[str], most: int) -> str:
    """The first `most` texts, and the number of the others: `a, b and 3 more`."""
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return ", ".join(texts[:most]) + more


def code_problem(text: str) -> str:
    """The reason why a text has no code at its beginning; empty if it has one."""
    if not text:
        return "an empty command"
    return "" if len(text) > 1 else "a code has two characters"


def parse_command(text: str, source: str = "client") -> Command:
    """Parse a command. Never fails: text that cannot be a command is returned with `problem` set.

    The first two characters are the code, the third is a separator of any kind, the rest the
    value. Spaces around the whole are not part of it.
    """
    # Only what line ends and typing leave: other white space is part of a malformed command.
    stripped = text.strip(" \t\r\n")
    if problem := code_problem(stripped):
        return Command(text, source=source, problem=problem)
    return Command(text, stripped[:2], stripped[3:] if len(stripped) > 2 else None, source)


def parse_value(argument: str | None, example: str = "d1-3") -> float | str:
    """The number after the separator, or the reason there is none, as text, with an example of a command
    that has one.

    An overflowing literal (`1e400`) gives infinity, which the caller refuses as out of range.
    """
    if argument is None or not argument.strip():
        return f"the value is missing, as in {example}"
    # `float` alone accepts nan, inf and 1_000, which no program of the course sends on purpose.
    if NUMBER.fullmatch(argument.strip()) is None:
        return f"'{escape_word(argument)}' is not a finite decimal number, such as 3, -2.5 or 1e-3"
    return float(argument)
