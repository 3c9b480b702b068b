"""Classes and structs of a sketch: their bodies, the names of their members, and the functions in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from simmer_tui.sketch.cpp_tokens import Token

_AGGREGATES = ("class", "struct", "union")
_NOT_IN_A_HEAD = ("{", ";", "(", "=")


class SketchClass(Struct, frozen=True):
    """A class or struct: its name, the indices of its braces, and its members in their order."""

    name: str
    begin: int
    end: int
    members: tuple[str, ...]


class FunctionText(Struct, frozen=True):
    """A function with a body: the index of its brace, its class (empty without), its name, its parameters,
    and the values that a constructor gives to members."""

    brace: int
    scope: str
    name: str
    parameters: tuple[Token, ...]
    values: tuple[tuple[str, tuple[Token, ...]], ...]


def classes_of(tokens: Sequence[Token], partners: Mapping[int, int]) -> Iterator[SketchClass]:
    """The classes and structs with a body; one without a name has that of its `typedef`."""
    for at, token in enumerate(tokens[:-2]):
        if token.text not in _AGGREGATES or (at and tokens[at - 1].text == "enum"):
            continue
        begin = at + 1
        while begin < len(tokens) and tokens[begin].text not in _NOT_IN_A_HEAD:
            begin += 1
        end = partners.get(begin)
        if begin == len(tokens) or tokens[begin].text != "{" or end is None:
            continue
        name = tokens[at + 1]
        if begin == at + 1:
            name = tokens[end + 1] if end + 1 < len(tokens) else token
        if name.is_name:
            yield SketchClass(name.text, begin, end, tuple(_members(tokens, begin + 1, end, partners)))


def _members(tokens: Sequence[Token], begin: int, end: int, partners: Mapping[int, int]) -> Iterator[str]:
    """The names of members: each stands before a comma, its value or the end of its declaration."""
    at, is_value, is_method = begin, False, False
    while at < end:
        token, after = tokens[at], tokens[at + 1].text
        if token.text in (";", ","):
            is_value, is_method = False, is_method and token.text == ","
        elif token.text == "=":
            is_value = True
        elif token.text in ("(", "[", "{"):
            # The head of a method ends with its body, or with the end of its declaration.
            is_method = token.text == "(" or (is_method and token.text == "[")
            at = partners.get(at, at)
        elif token.is_name and not is_value and not is_method and after in (",", ";", "[", "=", "{"):
            yield token.text
        at += 1


def functions_of(
    tokens: Sequence[Token],
    partners: Mapping[int, int],
    classes: Sequence[SketchClass],
    keywords: frozenset[str],
) -> Iterator[FunctionText]:
    """The functions with bodies, in the order of the text."""
    for at, token in enumerate(tokens):
        if token.text != "{" or at < 2:
            continue
        end = at - 1
        while end > 0 and tokens[end].text in ("const", "override", "noexcept", "final"):
            end -= 1
        members = []
        start = partners.get(end, 0)
        # A constructor's `: en(a), in1(b)` before its body.
        while start > 2 and tokens[start - 2].text in (",", ":") and tokens[start - 3].text in (")", "}"):
            members.append((tokens[start - 1].text, tuple(tokens[start + 1 : end])))
            mark, end = tokens[start - 2].text, start - 3
            start = partners.get(end, 0)
            if mark == ":":
                break
        if tokens[end].text != ")":
            continue
        name = tokens[start - 1] if start else token
        if not name.is_name or name.text in keywords:
            continue
        is_destructor = start > 1 and tokens[start - 2].text == "~"
        first = start - 2 if is_destructor else start - 1
        scope = next((each.name for each in classes if each.begin < start < each.end), "")
        if first > 1 and tokens[first - 1].text == "::":
            scope = tokens[first - 2].text
        shown = f"~{name.text}" if is_destructor else name.text
        yield FunctionText(at, scope, shown, tuple(tokens[start + 1 : end]), tuple(members))
