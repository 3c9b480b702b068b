"""Containers of C++ as the arrays that they are to a reader: `std::array<int, 3> pins = {{2, 3, 4}}` as
`int pins[3] = {2, 3, 4}`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count

from simmer_tui.sketch.cpp_tokens import Token, TokenKind

_CONTAINERS = ("array", "vector")


def with_plain_arrays(tokens: Sequence[Token], partners: Mapping[int, int]) -> list[Token]:
    """The tokens of a sketch with arrays in place of containers that have their elements in braces.

    `partners` are the places of closing brackets by those of the opening ones.
    """
    made: list[Token] = []
    at = 0
    while at < len(tokens):
        marks = [each.text for each in tokens[at : at + 4]]
        found = None
        if marks[:2] == ["std", "::"] and marks[2:3] and marks[2] in _CONTAINERS and marks[3:] == ["<"]:
            found = _array_at(tokens, at + 3, partners)
        if found is None:
            made.append(tokens[at])
            at += 1
        else:
            made += found[0]
            at = found[1]
    return made


def _array_at(
    tokens: Sequence[Token], start: int, partners: Mapping[int, int]
) -> tuple[list[Token], int] | None:
    """An array by the place of its container's `<`, and the place after its values; None for another use."""
    depth, comma = 0, None
    for at in count(start):
        if at == len(tokens) or tokens[at].text in (";", "{", "("):
            return None
        depth += {"<": 1, ">": -1}.get(tokens[at].text, 0)
        if tokens[at].text == "," and depth == 1 and comma is None:
            comma = at
        if depth == 0:
            break
    end, name = at, at + 1
    begin = name + 2 if name + 1 < len(tokens) and tokens[name + 1].text == "=" else name + 1
    if begin >= len(tokens) or not tokens[name].is_name or tokens[begin].text != "{":
        return None
    close = partners.get(begin)
    if close is None:
        return None
    values = list(tokens[begin : close + 1])
    # The inner braces of `{{...}}` are those of the array within a std::array.
    if (
        comma is not None
        and len(values) > 1
        and values[1].text == "{"
        and partners.get(begin + 1) == close - 1
    ):
        values = values[1:-1]
    size = [] if comma is None else tokens[comma + 1 : end]
    kind = tokens[start + 1 : end if comma is None else comma]
    opening, closing, equal = (
        Token(TokenKind.MARK, text, tokens[name].file, tokens[name].line) for text in "[]="
    )
    return [*kind, tokens[name], opening, *size, closing, equal, *values], close + 1
