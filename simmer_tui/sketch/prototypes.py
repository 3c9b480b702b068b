"""Prototypes of a sketch's functions, by the rules of Arduino's own build: a sketch calls functions that come
later in its files."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Sequence

from msgspec import Struct

from simmer_tui.sketch.cpp_text import blank, closing_place, code_text, global_text

_ATTRIBUTE = re.compile(r"__attribute__\s*\(\((?:[^()]|\([^()]*\))*\)\)|\[\[[^\]]*\]\]")
_TYPE = re.compile(r"[A-Za-z_][\w:<>, *&]*[ *&]")
_NAME = re.compile(r"[A-Za-z_]\w*$")
_CONDITION = re.compile(
    r"^[ \t]*#[ \t]*(?P<kind>ifdef|ifndef|if|elif|else|endif)\b(?:[^\n]*\\\n)*[^\n]*", re.MULTILINE
)
# Arguments of many defaults are shorter.
_LONGEST_HEADER = 2000
"""Characters of a function's type, name and arguments."""
_NO_FUNCTIONS = frozenset(("if", "while", "for", "switch", "catch"))
_NO_TYPES = frozenset(
    ("else", "return", "new", "namespace", "template", "do", "operator", "using", "typedef", "delete")
)
_NO_STATEMENTS = re.compile(r"\s*(?:typedef|using|namespace|template|extern)\b")
_OF_CLASS = re.compile(r"\s*(?:class|struct|union|enum)\b[^{]*")
"""Beginnings of declarations that use no function's address."""


class Prototypes(Struct, frozen=True):
    """Prototypes, and where they go.

    Attributes:
        listed: the prototypes of all global functions.
        places: the places at which all of them go.
        defaults: beginnings and ends of default arguments, which the prototypes have instead.
        early: prototypes of functions whose address a variable has before that, with their places.
    """

    listed: list[str]
    places: list[int]
    defaults: list[tuple[int, int]]
    early: list[tuple[int, str]]


class _Header(Struct, frozen=True):
    """The head of a function: its type, its name, and the beginning and end of its arguments in the text."""

    kind: str
    name: str
    begin: int
    end: int


def prototypes(source: str) -> Prototypes:
    """Prototypes of a source's global functions.

    They go before the first function. A function in an `#if` has its prototype in the same `#if`; as the
    compiler may skip it, the prototypes go before later functions too, up to the first without a condition.
    """
    plain = code_text(source)
    flat = _ATTRIBUTE.sub(lambda each: blank(each[0]), global_text(plain))
    conditions = conditions_of(plain)
    found: list[str] = []
    plainly: dict[str, str] = {}
    """Prototypes without defaults, by the function's name."""
    defaults: list[tuple[int, int]] = []
    declared: set[str] = set()
    places: dict[tuple[str, ...], int] = {}
    end = 0
    for delimiter in re.finditer(r"[;{}]", flat):
        begin, end = end, delimiter.end()
        text = flat[begin : end - 1]
        if delimiter[0] == "}" or len(text.strip()) > _LONGEST_HEADER:
            continue
        header = _header(text)
        if header is None:
            continue
        begun = begin + len(text) - len(text.lstrip())
        opened, closed = begin + header.begin, begin + header.end
        arguments = _joined(flat[opened:closed])
        prefix = _prefix(text, source[begin:opened])
        if delimiter[0] == ";":
            declared.add(f"{header.kind} {header.name}({_without_defaults(arguments)})")
            continue
        inside = conditions[bisect_right(conditions, begun, key=lambda each: each[0]) - 1][1]
        if () not in places:
            places.setdefault(inside, begun)
        if f"{header.kind} {header.name}({_without_defaults(arguments)})" in declared:
            continue
        given = list(_defaults(flat, opened, closed))
        if given:
            names = [each for first, last in given for each in re.findall(r"[A-Za-z_]\w*", flat[first:last])]
            if prefix or any(_is_defined_after(places.get((), begun), each, plain) for each in names):
                continue
            # A default stands once: in the prototype, with the texts that it may have.
            arguments = source[opened:closed].strip()
            defaults += given

        def within(made: str, inside: Sequence[str] = inside) -> str:
            return "\n".join((*inside, f"{made};", *("#endif" for line in inside if _opens(line))))

        kind = header.kind.removeprefix("extern ") if prefix.startswith("extern") else header.kind
        found.append(within(f"{prefix}{kind} {header.name}({arguments})"))
        if not prefix:
            bare = _without_defaults(_joined(flat[opened:closed]))
            plainly.setdefault(header.name, within(f"{header.kind} {header.name}({bare})"))
    first = min(places.values(), default=0)
    return Prototypes(found, list(places.values()), defaults, list(_early(plain, flat, first, plainly)))


def _header(text: str) -> _Header | None:
    """The head of a function at the end of a text; None if there is none."""
    stripped = text.rstrip()
    if not stripped.endswith(")"):
        return None
    depth = 0
    opened = -1
    for place in range(len(stripped) - 1, -1, -1):
        depth += (stripped[place] == ")") - (stripped[place] == "(")
        if depth == 0:
            opened = place
            break
    name = _NAME.search(stripped[: max(opened, 0)].rstrip())
    if name is None or name[0] in _NO_FUNCTIONS:
        return None
    # After a macro with arguments, or a template's parameters.
    before = _without_parameters(stripped[: name.start()])
    kind = _joined(before[before.rfind(")") + 1 :]) + " "
    words = re.findall(r"\w+", kind)
    is_type = _TYPE.fullmatch(kind.lstrip()) and not before.rstrip().endswith(":")
    if not words or not is_type or _NO_TYPES.intersection(words):
        return None
    # A type in a class may come later.
    if "::" in kind.replace("std::", ""):
        return None
    return _Header(kind.strip(), name[0], opened + 1, len(stripped) - 1)


def _without_parameters(text: str) -> str:
    """The text after `template <...>`, if it begins so."""
    match = re.match(r"\s*template\s*(?=<)", text)
    if match is None:
        return text
    return text[closing_place(text, match.end(), "<>") + 1 :]


def _prefix(text: str, source: str) -> str:
    """Text before the type of a function in its prototype: `template <...>`, or the linkage of C."""
    match = re.match(r"\s*template\s*<", text)
    if match is not None:
        rest = _without_parameters(text)
        return f"{_joined(text[: len(text) - len(rest)])} "
    return 'extern "C" ' if re.match(r'\s*extern\s*"C"', source) else ""


def _joined(text: str) -> str:
    """The text in one line."""
    return re.sub(r"\s+", " ", text.strip())


def _defaults(flat: str, begin: int, end: int) -> Iterator[tuple[int, int]]:
    """The beginnings and ends of default arguments between two places, from their `=` on."""
    depth, equals = 0, -1
    for place in range(begin, end + 1):
        sign = "," if place == end else flat[place]
        if sign == "," and depth == 0:
            if equals >= 0:
                yield equals, place
            equals = -1
        elif sign == "=" and depth == 0 and equals < 0:
            equals = place
        depth += (sign in "([") - (sign in ")]")


def _without_defaults(arguments: str) -> str:
    for begin, end in reversed(list(_defaults(arguments, 0, len(arguments)))):
        arguments = arguments[:begin].rstrip() + arguments[end:]
    return arguments


def _is_defined_after(place: int, name: str, plain: str) -> bool:
    """True if a source defines a name only after a place: a macro, a constant or a function."""
    found = re.search(rf"#\s*define\s+{name}\b|\b(?!return\b)\w+[\s*&]+{name}\s*(?:=|\()", plain)
    return found is not None and found.start() > place


def _early(plain: str, flat: str, first: int, made: dict[str, str]) -> Iterator[tuple[int, str]]:
    """The prototypes of functions that a variable uses before the first function, with their places."""
    waiting = dict(made)
    begin = 0
    while begin < first and waiting:
        end = flat.find(";", begin, first)
        if end < 0:
            return
        text = plain[begin:end]
        directives = re.compile(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", re.MULTILINE)
        text = directives.sub(lambda each: blank(each[0]), text)
        place = begin + len(text) - len(text.lstrip())
        begin = end + 1
        if _NO_STATEMENTS.match(text):
            continue
        head = _OF_CLASS.match(text)
        if head is not None:
            # Bodies of classes have what they had on the board; a variable may follow.
            text = text[_body_end(text, head.end()) :]
        for name in sorted(waiting.keys() & set(re.findall(r"\w+", text))):
            yield place, waiting.pop(name)


def _body_end(text: str, place: int) -> int:
    """The place after the braces that begin at a place."""
    return min(closing_place(text, place, "{}") + 1, len(text))


def conditions_of(plain: str) -> list[tuple[int, tuple[str, ...]]]:
    """The directives in whose branch a source is, from each place on: `#if A`, `#else`."""
    changes: list[tuple[int, tuple[str, ...]]] = [(0, ())]
    branches: list[list[str]] = []
    for match in _CONDITION.finditer(plain):
        line = match[0].strip()
        if match["kind"] == "endif":
            branches[-1:] = []
        elif match["kind"].startswith("if"):
            branches.append([line])
        elif branches:
            branches[-1].append(line)
        changes.append((match.end(), tuple(line for branch in branches for line in branch)))
    return changes


def _opens(directive: str) -> bool:
    return directive.lstrip("# \t").startswith("if")
