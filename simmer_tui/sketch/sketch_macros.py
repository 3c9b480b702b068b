"""Macros of a sketch that do something, taken for functions: `#define stop() { digitalWrite(IN1, LOW); }`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

from msgspec.structs import replace

from simmer_tui.sketch.cpp_tokens import SourceDirective, Token, TokenKind

_STATEMENTS = frozenset(("{", ";", "=", "if", "for", "while", "do"))
"""Tokens that no single expression has."""


def functions_of_macros(macros: Sequence[SourceDirective], tokens: Sequence[Token]) -> list[Token]:
    """The macros that a text or another used macro names, as the tokens of functions, `void stop() { ... }`.
    A name without parameters is one if it has a call."""
    bodies: dict[str, Sequence[Token]] = {}
    for each in macros:
        if each.name == "define" and each.rest and (each.has_parameters or _has_call(each.rest[1:])):
            bodies[each.rest[0].text] = each.rest
    with_parameters = {each.rest[0].text for each in macros if each.has_parameters}
    made: list[Token] = []
    for name in _used(bodies, tokens):
        head, *rest = bodies[name]
        count = 0
        if name in with_parameters:
            count = next((at for at, each in enumerate(rest, 1) if each.text == ")"), len(rest))
        parameters = rest[:count] or [replace(head, kind=TokenKind.MARK, text=mark) for mark in "()"]
        opened, end, closed = (replace(head, kind=TokenKind.MARK, text=mark) for mark in "{;}")
        body = rest[count:]
        if not any(each.text in _STATEMENTS for each in body):
            body = [replace(head, text="return"), *body]
        made += [replace(head, text="void"), head, *parameters, opened, *body, end, closed]
    return made


def _used(bodies: Mapping[str, Sequence[Token]], tokens: Sequence[Token]) -> list[str]:
    """The macros that a text names, and those that these name, in their own order."""
    found: dict[str, None] = {}
    texts = [tokens]
    for text in texts:
        for token in text:
            if token.text in bodies and token.text not in found:
                found[token.text] = None
                texts.append(bodies[token.text][1:])
    return [name for name in bodies if name in found]


def _has_call(body: Sequence[Token]) -> bool:
    return any(one.is_name and other.text == "(" for one, other in pairwise(body))
