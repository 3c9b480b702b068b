"""Sums, products and the like of whole numbers, as C++ computes them."""

from __future__ import annotations

from collections.abc import Sequence

from simmer_tui.sketch.cpp_tokens import Token, TokenKind

_LEVELS = (("|",), ("^",), ("&",), ("<<", ">>"), ("+", "-"), ("*", "/", "%"))
"""Operators of two numbers, those that bind least first."""
_BOUND_LESS = frozenset(("?", ":", "=", "<", ">", "<=", ">=", "==", "!=", "&&", "||", ","))
"""Marks that bind less than all of them: their expressions are no numbers of a pin."""
_OPEN, _CLOSE = "([{", ")]}"
_MOST = 1 << 31
"""A number of an `int` of 32 bits is less."""
_MOST_SHIFTED = 31


def last_operator(tokens: Sequence[Token]) -> int:
    """The place of the operator that is computed last; 0 if there is none."""
    found: dict[str, int] = {}
    depth = 0
    for at, token in enumerate(tokens):
        if token.kind is not TokenKind.MARK:
            continue
        depth += (token.text in _OPEN) - (token.text in _CLOSE)
        if depth:
            continue
        if token.text in _BOUND_LESS:
            return 0
        before = tokens[at - 1] if at else None
        # A sign, an address or a pointer has no number before it.
        if before is not None and (before.kind is not TokenKind.MARK or before.text in _CLOSE):
            found[token.text] = at
    for level in _LEVELS:
        places = [found[each] for each in level if each in found]
        if places:
            return max(places)
    return 0


def combined(one: frozenset[int], operator: str, other: frozenset[int]) -> frozenset[int] | None:
    """The numbers that two sets of numbers give; None if one of them is none that a pin or a channel has."""
    found = set()
    for left in one:
        for right in other:
            number = _computed(left, operator, right)
            if number is None or not 0 <= number < _MOST:
                return None
            found.add(number)
    return frozenset(found)


def _computed(left: int, operator: str, right: int) -> int | None:
    # No number is negative, so C++ rounds as Python does.
    match operator:
        case "+":
            return left + right
        case "-":
            return left - right
        case "*":
            return left * right
        case "/":
            return left // right if right else None
        case "%":
            return left % right if right else None
        case "<<":
            return left << right if right <= _MOST_SHIFTED else None
        case ">>":
            return left >> right if right <= _MOST_SHIFTED else None
        case "&":
            return left & right
        case "|":
            return left | right
        case _:
            return left ^ right
