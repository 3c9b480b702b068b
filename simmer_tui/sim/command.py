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
BOARD_SOURCE = "boards"
"""Source of commands that boards make; a place in a sketch may follow: `boards, main at a.ino:4`."""
_LONG_NUMBER = re.compile(r"\d+\.\d{3,}(?:[eE][+-]?\d+)?")
PEOPLE = frozenset(("console", "keys"))
"""Sources of commands by people at the screen; all others are programs. Only programs send theirs over the
link."""


# Without garbage collection (gc=False): commands hold no cycles, and many thousands may wait.
class Command(Struct, frozen=True, gc=False):
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
        """The text as people write it: letters and signs of all scripts as they are, at most a line. Speeds
        that a board's duties make have two decimals here."""
        if self.source.partition(",")[0] == BOARD_SOURCE:
            return cut(_LONG_NUMBER.sub(lambda number: f"{float(number[0]):.2f}", self.text))
        return cut(self.text if self.source in PEOPLE else utf8_text(self.text))


# Judged: the longest names people give; a line of a wide terminal.
WORD, _LINE = 40, 120
"""Characters kept of a text from outside, of any length before: a word in a sentence, and a line."""


def cut(text: str, most: int = _LINE) -> str:
    """A text of at most `most` characters; a longer one ends in three dots."""
    return text if len(text) <= most else text[: most - 3] + "..."


def utf8_text(text: str) -> str:
    """A text with one character a byte, as links decode it, read as UTF-8. Without UTF-8 in it, letters of
    Latin-1 alone are a text, as MATLAB sends it; other bytes become surrogates, which are shown as bytes."""
    if text.isascii():
        return text
    try:
        data = text.encode("latin-1")
        return data.decode("utf-8", "strict" if text.isprintable() else "surrogateescape")
    except UnicodeError:  # not of bytes, or of Latin-1
        return text


def typed_path(path: object) -> str:
    """A path as it can be typed in a shell, unless it has control characters."""
    return platform_has.shell_line([str(path)])


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
        return _no_number(argument, example[:2])
    return float(argument)


# UTF-8 gives each of these bytes only to the rest of a character: here of a separator such as an en dash.
_REST_OF_SEPARATOR = "".join(map(chr, range(0x80, 0xC0)))


def _no_number(argument: str, code: str) -> str:
    """The reason why a value is no number, and the command that may have been meant."""
    rest = argument.lstrip(_REST_OF_SEPARATOR)
    value = utf8_text(rest)
    meant = meant_number(value)
    hint = f"; did you mean {code}-{meant}?" if meant else ""
    if rest != argument and meant:
        return f"the sign after {code} is a dash or letter of several bytes, not a hyphen{hint}"
    return f"'{cut(value, WORD)}' is not a finite decimal number{hint or ', such as 3, -2.5 or 1e-3'}"


_DASHES = dict.fromkeys(map(ord, "\u2010\u2011\u2012\u2013\u2014\u2015\u2212\ufe58"), "-")
_QUOTES = {
    **dict.fromkeys(map(ord, "\u2018\u2019\u201a\u2032"), "'"),
    **dict.fromkeys(map(ord, "\u201c\u201d\u201e\u2033"), '"'),
}
# A unit that the value has anyway, and what programs have around a value. Three digits after a comma may be
# thousands.
_MEANT = re.compile(
    r"""[\s"'(=:]*([+-]?)\s*(\d+|\d*[.,]\d+|\d+[.,])\s*(?:in|inch|inches|deg|degrees?|°)?[\s;,.)\]"']*""",
    re.ASCII,
)


def keyboard_text(text: str) -> str:
    """The text in the characters of a keyboard: dashes, minus signs, curly quotes and full-width letters of
    documents replaced."""
    if text.isascii():
        return text
    import unicodedata

    return unicodedata.normalize("NFKC", text.translate(_DASHES | _QUOTES)).translate(_DASHES)


def meant_number(text: str) -> str:
    """The number that a value with a unit, a decimal comma or signs of a document means; empty if that is
    not evident."""
    found = _MEANT.fullmatch(keyboard_text(text))
    if found is None or re.search(r",\d{3}$", found[2]):
        return ""
    return found[1].replace("+", "") + found[2].replace(",", ".").rstrip(".")
