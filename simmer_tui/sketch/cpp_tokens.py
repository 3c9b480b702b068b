"""Tokens of a sketch with their lines, and its directives. It is no compiler: macros are not expanded, and
both branches of an #if are read."""

from __future__ import annotations

import re
from enum import Enum, auto

from msgspec import Struct

# Judged: ten thousand lines.
LARGEST_SOURCE = 400_000
"""Largest file of a sketch, characters."""
_TOKEN = re.compile(
    r"""
      (?P<blank>[ \t\r\f\v]+|\\\r?\n)
    | (?P<line>\n)
    | (?P<comment>//(?:\\\r?\n|[^\n])*|/\*.*?(?:\*/|\Z))
    | (?P<text>"(?:\\.|[^"\\\n])*"?)
    | (?P<char>'(?:\\.|[^'\\\n])*'?)
    | (?P<number>\.?[0-9](?:[eEpP][+-]|[\w.'])*)
    | (?P<name>[^\W\d]\w*)
    | (?P<mark>::|->|\+\+|--|&&|\|\||[-+*/%&|^<>=!]=|<<|>>|.)
    """,
    re.VERBOSE | re.DOTALL,
)

_DEFINE_AND_NAME = 2
"""Tokens of a #define up to the macro's name."""


class TokenKind(Enum):
    """Kinds of tokens."""

    NAME = auto()
    NUMBER = auto()
    TEXT = auto()
    MARK = auto()


_KINDS = {
    "name": TokenKind.NAME,
    "number": TokenKind.NUMBER,
    "text": TokenKind.TEXT,
    "char": TokenKind.TEXT,
    "mark": TokenKind.MARK,
}


class Token(Struct, frozen=True):
    """A token of a sketch: its text, and the file and line where it begins."""

    kind: TokenKind
    text: str
    file: str
    line: int

    @property
    def spot(self) -> str:
        """The file and line, `rover.ino:12`."""
        return f"{self.file}:{self.line}"

    @property
    def is_name(self) -> bool:
        """True for an identifier or a keyword."""
        return self.kind is TokenKind.NAME


class SourceDirective(Struct, frozen=True):
    """A preprocessor directive: `define` or `include` with its tokens after it."""

    name: str
    rest: tuple[Token, ...]
    line: int
    has_parameters: bool
    """True if a bracket follows a macro's name without a blank: `#define STOP() ...`."""


def tokens_of(text: str, file: str) -> tuple[list[Token], list[SourceDirective]]:
    """The tokens of a source and its directives.

    Raises ValueError if the source is longer than any sketch.
    """
    if len(text) > LARGEST_SOURCE:
        raise ValueError(f"has more than {LARGEST_SOURCE:,} characters")
    tokens: list[Token] = []
    directives: list[SourceDirective] = []
    current: list[Token] | None = None
    """The tokens of the directive that is read."""
    line, at_start, name_end, has_parameters = 1, True, -1, False

    def close() -> None:
        if current:
            directives.append(
                SourceDirective(current[0].text, tuple(current[1:]), current[0].line, has_parameters)
            )

    for match in _TOKEN.finditer(text):
        group, found = match.lastgroup, match[0]
        if group == "line":
            close()
            current, at_start = None, True
        elif group == "mark" and found == "#" and at_start:
            current, has_parameters = [], False
        elif group in _KINDS:
            token = Token(_KINDS[group], found, file, line)
            (tokens if current is None else current).append(token)
            at_start = False
            if current is not None and len(current) == _DEFINE_AND_NAME:
                name_end = match.end()
            elif found == "(" and match.start() == name_end:
                has_parameters = True
        line += found.count("\n")
    close()
    return tokens, directives
