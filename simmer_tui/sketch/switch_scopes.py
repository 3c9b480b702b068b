"""Cases of a `switch` that declare variables, as Arduino's compiler for AVR takes them.

It lets a jump to a later case pass the value that a plain variable begins with. Newer compilers refuse that.
So such a case gets braces of its own, if no later one uses the variable.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from simmer_tui.sketch.cpp_text import closing_place, code_text, with_inserted

_SWITCH = re.compile(r"\bswitch\b\s*\(")
_LABEL = re.compile(r"\b(?:case\b|default\s*(?=:))")
# Classes with a constructor, such as String, are refused on the board too.
_PLAIN = (
    r"(?:(?:static|const|volatile|unsigned|signed|register)\s+)*"
    r"(?:u?int(?:8|16|32|64)_t|int|long|short|char|byte|word|bool|boolean|float|double|auto|size_t|unsigned)\b"
    r"(?:\s+(?:int|long|char|const))*"
)
_DECLARATION = re.compile(
    rf"(?:^|[;{{}}:])\s*{_PLAIN}[\s*&]*(?P<name>[A-Za-z_]\w*)\s*(?:\[[^\]]*\]\s*)*[=({{,]"
)


def with_case_scopes(source: str) -> str:
    """The source with braces around each case of a `switch` that declares plain variables with values."""
    if "switch" not in source:
        return source
    plain = code_text(source)
    added: list[tuple[int, str]] = []
    for match in _SWITCH.finditer(plain):
        opened = plain.find("{", closing_place(plain, match.end() - 1, "()"))
        if opened < 0:
            continue
        for begin, end in _scopes(plain, opened + 1, closing_place(plain, opened, "{}")):
            added += [(begin, " {"), (end, "} ")]
    return with_inserted(source, added)


def _scopes(plain: str, begin: int, end: int) -> Iterator[tuple[int, int]]:
    """The beginnings and ends of the cases that need braces, in a body between two places."""
    flat = _outer(plain, begin, end)
    labels = list(_label_ends(flat))
    for number, (_, first) in enumerate(labels[:-1]):
        last = labels[number + 1][0]
        names = {each["name"] for each in _DECLARATION.finditer(flat[first - 1 : last])}
        if names and names.isdisjoint(re.findall(r"\w+", plain[begin + last : end])):
            yield begin + first, begin + last


def _outer(plain: str, begin: int, end: int) -> str:
    """A body with the insides of braces in it blanked."""
    made = []
    depth = 0
    for sign in plain[begin:end]:
        depth -= sign == "}"
        made.append(sign if depth == 0 or sign == "\n" else " ")
        depth += sign == "{"
    return "".join(made)


def _label_ends(flat: str) -> Iterator[tuple[int, int]]:
    """The beginning of each label and the place after its colon."""
    for match in _LABEL.finditer(flat):
        colon = re.compile(r"(?<!:):(?!:)").search(flat, match.end())
        if colon is not None:
            yield match.start(), colon.end()
