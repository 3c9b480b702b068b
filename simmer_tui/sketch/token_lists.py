"""Lists of tokens by their brackets: partners, parts at commas, and an expression without its casts."""

from __future__ import annotations

from collections.abc import Sequence

from simmer_tui.sketch.cpp_tokens import Token, TokenKind

_OPEN, _CLOSE = "([{", ")]}"


def without_casts(tokens: Sequence[Token]) -> Sequence[Token]:
    """An expression without brackets around it, and without `(int)` before it."""
    while len(tokens) >= 3 and tokens[0].text == "(":
        if tokens[-1].text == ")" and partners_of(tokens).get(0) == len(tokens) - 1:
            tokens = tokens[1:-1]
        elif tokens[1].is_name and tokens[2].text == ")":
            tokens = tokens[3:]
        else:
            break
    return tokens


def partners_of(tokens: Sequence[Token]) -> dict[int, int]:
    """The index of the other bracket, by the index of each. One without a partner is missing."""
    opened: list[int] = []
    found: dict[int, int] = {}
    for at, token in enumerate(tokens):
        if token.kind is not TokenKind.MARK:
            continue
        if token.text in _OPEN:
            opened.append(at)
        elif token.text in _CLOSE:
            wanted = _OPEN[_CLOSE.index(token.text)]
            # A bracket that an #if leaves open is passed over.
            while opened and tokens[opened[-1]].text != wanted:
                opened.pop()
            if opened:
                start = opened.pop()
                found[start], found[at] = at, start
    return found


def split(tokens: Sequence[Token]) -> list[tuple[Token, ...]]:
    """The parts of a list at its commas; commas in inner brackets do not count."""
    parts: list[tuple[Token, ...]] = []
    current: list[Token] = []
    depth = 0
    for token in tokens:
        if token.kind is TokenKind.MARK:
            depth += (token.text in _OPEN) - (token.text in _CLOSE)
            if token.text == "," and depth == 0:
                parts.append(tuple(current))
                current = []
                continue
        current.append(token)
    return [*parts, tuple(current)] if current or parts else []
