"""C++ as text: comments, texts and directives blanked, so that places stay."""

from __future__ import annotations

import re
from collections.abc import Iterable

CPP_TOKEN = re.compile(
    r"""
    (?P<comment>//[^\n]*|/\*.*?(?:\*/|\Z))
  | (?P<raw>R"(?P<mark>[^()\\\s]{0,16})\(.*?\)(?P=mark)")
  | (?P<text>"(?:\\.|[^"\\\n])*"?|'(?:\\.|[^'\\\n])*'?)
  | (?P<directive>^[ \t]*\#[ \t]*(?:include|error|warning|pragma|line)\b[^\n]*)
  | (?P<number>\.?[0-9](?:[eEpP][+-]|['\w.])*)
  | (?P<word>[A-Za-z_]\w*)
    """,
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)


def code_text(source: str) -> str:
    """The source with comments and texts blanked. Places stay."""

    def blanked(match: re.Match[str]) -> str:
        return match[0] if match["word"] or match["number"] else blank(match[0])

    return CPP_TOKEN.sub(blanked, source)


def global_text(plain: str) -> str:
    """A plain text with directives and the insides of braces blanked. Places stay."""
    plain = re.sub(r"(?m)^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", lambda each: blank(each[0]), plain)
    made: list[str] = []
    depth = 0
    for character in plain:
        if character == "}":
            depth = max(depth - 1, 0)
        made.append(character if depth == 0 or character == "\n" else " ")
        if character == "{":
            depth += 1
    return "".join(made)


def closing_places(flat: str) -> dict[int, int]:
    """The place of the parenthesis that closes each one, by the place of that one."""
    opened: list[int] = []
    found: dict[int, int] = {}
    for match in re.finditer(r"[()]", flat):
        if match[0] == "(":
            opened.append(match.start())
        elif opened:
            found[opened.pop()] = match.start()
    return found


def closing_place(plain: str, place: int, pair: str) -> int:
    """The place of the sign that closes the one at a place, of a pair such as `{}`; the end if none does."""
    depth = 0
    for at in range(place, len(plain)):
        depth += (plain[at] == pair[0]) - (plain[at] == pair[1])
        if depth == 0:
            return at
    return len(plain)


def with_inserted(source: str, added: Iterable[tuple[int, str]]) -> str:
    """The source with texts at places, each before what stands there."""
    made: list[str] = []
    done = 0
    for place, text in sorted(added):
        made += [source[done:place], text]
        done = place
    return "".join((*made, source[done:]))


def line_at(source: str, place: int) -> tuple[str, int]:
    """The file and the line at a place of a joined source."""
    name, line = "", 0
    for text in source[:place].split("\n"):
        marked = re.fullmatch(r'#line (\d+) "(.*)"', text)
        if marked:
            name, line = marked[2], int(marked[1]) - 1
        else:
            line += 1
    return name, max(line, 1)


def without_comments(source: str) -> str:
    """The source with comments blanked. Places stay."""
    return CPP_TOKEN.sub(lambda match: blank(match[0]) if match["comment"] else match[0], source)


def blank(text: str) -> str:
    """A text of blanks, with the same line ends."""
    return re.sub(r"[^\n]", " ", text)
