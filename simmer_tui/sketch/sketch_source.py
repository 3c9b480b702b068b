"""A sketch read as text: its calls, constants, arrays, functions, classes and loops. It is no compiler: what
it does not know it leaves out."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, KeysView, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Self

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.set_sketches import library_paths, source_paths
from simmer_tui.sketch.boards import BoardKind
from simmer_tui.sketch.cpp_tokens import LARGEST_SOURCE, SourceDirective, Token, TokenKind, tokens_of
from simmer_tui.sketch.known_headers import is_provided
from simmer_tui.sketch.sketch_classes import SketchClass, classes_of, functions_of
from simmer_tui.sketch.sketch_macros import functions_of_macros
from simmer_tui.sketch.token_lists import partners_of, split

_KEYWORDS = frozenset(
    (
        "if",
        "for",
        "while",
        "switch",
        "return",
        "catch",
        "sizeof",
        "else",
        "do",
        "case",
        "new",
        "delete",
        "throw",
    )
)
"""Names before `(` that are no calls, or before a name that are no types."""
_CHANGED = ("++", "--", "+=", "-=", "*=", "/=")
# More than the pins of a Mega.
MOST_VALUES = 100
"""Values of a name, or rows of an array, that are looked at."""
# Bounds for files that are no sketches: judged, ten times a long sketch.
MOST_CALLS = 20_000
LONGEST_CALL = 500
"""Most tokens of a call's arguments."""
_MOST_LOOPS = 4
"""Loops in each other that are looked at."""

Row = tuple[tuple[Token, ...], ...]
"""A row of an array: expressions. An array with one index has rows of one."""


class SketchLoop(Struct, frozen=True):
    """A loop that counts by one, `for (int i = first; i < limit; i++)`, or that takes each element of an
    array."""

    name: str
    first: tuple[Token, ...]
    limit: tuple[Token, ...]
    is_inclusive: bool
    array: str = ""


class SketchCall(Struct, frozen=True):
    """A call, or the definition of an object with arguments: `type` is the object's class then.

    `object` is what stands before the dot. `function` is the function that it is in, empty outside, and
    `loops` are those that it is in, from the outside.
    """

    name: str
    object: str
    type: str
    arguments: tuple[tuple[Token, ...], ...]
    function: str
    token: Token
    order: int
    """The number of its token in the sketch."""
    loops: tuple[SketchLoop, ...] = ()
    owner: tuple[Token, ...] = ()
    """The object with its index, `motors[0]`."""
    block: int = -1
    """The index of the innermost brace that it is in."""


class DeclaredObject(Struct, frozen=True):
    """An object of a class that is declared without arguments, or an array of them: `count` has its size."""

    type: str
    name: str
    count: tuple[Token, ...]
    spot: str


class SketchSource:
    """The text of one sketch.

    Args:
        sources: The texts of its files by name, the sketch's own first.
        kind: The board that it is for.
    """

    def __init__(self, sources: Mapping[str, str], kind: BoardKind) -> None:
        self.file = next(iter(sources), "")
        self.files = frozenset(sources)
        self.kind = kind
        self.includes: list[tuple[str, str]] = []
        """Names of the headers that it includes, with their places."""
        self.expressions: dict[str, list[tuple[tuple[Token, ...], str]]] = defaultdict(list)
        """The expressions that a name is set to, each with the function that it is in."""
        self.arrays: dict[str, tuple[Row, ...]] = {}
        self.changed: set[str] = set()
        """Names that `++` and its kind change."""
        self.parameters: dict[str, list[str]] = {}
        self.returned: dict[str, list[tuple[Token, ...]]] = defaultdict(list)
        """The expressions that a function returns."""
        self.class_methods: dict[str, list[str]] = defaultdict(list)
        """The methods of a class with a body."""
        self.scopes: dict[str, str] = {}
        """The class of each function, empty without."""
        self.classes: dict[str, SketchClass] = {}
        self.types: dict[str, str] = {}
        """The classes of objects, arrays, pointers and parameters, by their names."""
        self.aggregates: dict[str, tuple[tuple[Token, ...], ...]] = {}
        """The values in braces of an object, `Wheel left = {5, 7, 8}`."""
        self.declared: list[DeclaredObject] = []
        self._scopes_of: dict[str, set[str]] = defaultdict(set)
        """The classes with a function of a name; "" stands for none."""
        self.values_of_members: list[tuple[str, str, tuple[Token, ...]]] = []
        """The values that constructors give to members: the constructor, the member and the value."""
        self._defined: tuple[int, Token] | None = None
        """The end of the last definition of an object, and its class."""
        self._loops: list[tuple[int, SketchLoop]] = []
        """The loops around the token that is read, with their ends."""
        self._blocks: list[int] = []
        """The braces around the token that is read."""
        self.calls: list[SketchCall] = []
        """Calls and definitions of objects, in the order of the text."""
        tokens: list[Token] = []
        macros: list[SourceDirective] = []
        for name, text in sources.items():
            found, directives = tokens_of(text, name)
            tokens += found
            macros += directives
            self._read_directives(directives, name)
        self._read([*functions_of_macros(macros, tokens), *tokens])

    @classmethod
    def read(cls, sketch: Path, kind: BoardKind) -> Self:
        """The facts of a sketch by its .ino file or its folder. Raises OSError, or ValueError for a source
        that is too long."""
        return cls(texts_of(sketch), kind)

    @property
    def functions(self) -> KeysView[str]:
        """The names of its own functions."""
        return self.parameters.keys()

    # -- reading ------------------------------------------------------------------------------------

    def _read_directives(self, directives: Sequence[SourceDirective], file: str) -> None:
        for each in directives:
            rest = each.rest
            if each.name == "include" and rest:
                name = "".join(token.text for token in rest).strip('<>"')
                self.includes.append((name, f"{file}:{each.line}"))
            elif each.name == "define" and len(rest) > 1 and not each.has_parameters:
                self.expressions[rest[0].text].append((rest[1:], ""))

    def _read(self, tokens: Sequence[Token]) -> None:
        partners = partners_of(tokens)
        self._find_functions(tokens, partners)
        function, end = "", -1
        for at, token in enumerate(tokens):
            if at > end:
                function = ""
            if at in self._bodies:
                function, end = self._bodies[at], partners.get(at, len(tokens))
            after = tokens[at + 1].text if at + 1 < len(tokens) else ""
            before = tokens[at - 1].text if at else ""
            if token.text == "{":
                self._blocks.append(at)
            elif token.text == "}" and self._blocks and partners.get(at) == self._blocks[-1]:
                self._blocks.pop()
            if not token.is_name:
                continue
            while self._loops and at > self._loops[-1][0]:
                self._loops.pop()
            if token.text == "enum":
                self._read_enumerators(tokens, at, partners)
            if token.text == "return" and function:
                self._read_return(tokens, at, function)
            if token.text == "for" and after == "(":
                self._read_loop(tokens, at, partners)
            if at + 1 < len(tokens) and tokens[at + 1].is_name and token.text not in _KEYWORDS:
                self._read_declaration(tokens, at, partners)
            self._read_type(tokens, at)
            if after in _CHANGED or before in ("++", "--"):
                self.changed.add(token.text)
            elif after == "=" and (before not in (".", "->") or (at > 1 and tokens[at - 2].text == "this")):
                self._read_value(tokens, at, partners, function)
            elif after == "[":
                self._read_array(tokens, at, partners)
            elif after in ("(", "{") and token.text not in _KEYWORDS:
                self._read_call(tokens, at, partners, function)
        self.calls = [self._resolved(call) for call in (*self.calls, *self._made_members())]

    def _read_enumerators(self, tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> None:
        """Take the names in `enum { LEFT, RIGHT }` without a value of their own: one more than the last."""
        begin = at + 1
        while begin < len(tokens) and tokens[begin].text not in ("{", ";", "(", ")", "="):
            begin += 1
        if begin == len(tokens) or tokens[begin].text != "{":
            return
        last: tuple[Token, ...] = ()
        count = 0
        for item in split(tokens[begin + 1 : partners.get(begin, begin + 1)])[:MOST_VALUES]:
            if len(item) > 1:
                last, count = item[2:], 0
            elif item:
                number = replace(item[0], kind=TokenKind.NUMBER, text=str(count))
                plus = replace(item[0], kind=TokenKind.MARK, text="+")
                self.expressions[item[0].text].append(((*last, plus, number) if last else (number,), ""))
            count += 1

    def _read_return(self, tokens: Sequence[Token], at: int, function: str) -> None:
        end = at + 1
        while end < len(tokens) and tokens[end].text != ";" and end - at < LONGEST_CALL:
            end += 1
        if at + 1 < end and len(self.returned[function]) < MOST_VALUES:
            self.returned[function].append(tuple(tokens[at + 1 : end]))

    def _read_loop(self, tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> None:
        """Take a loop that counts by one, or over an array, until its end."""
        close = partners.get(at + 1)
        if close is None or close - at > LONGEST_CALL or len(self._loops) == _MOST_LOOPS:
            return
        # It ends with its block, with its only statement, or with the block around it.
        end = close + 1
        while end < len(tokens) and tokens[end].text != ";":
            partner = partners.get(end, end)
            if partner < end or tokens[end].text == "{":
                end = max(end, partner)
                break
            end = partner + 1
        loop = _loop_of(tokens[at + 2 : close])
        if loop is not None:
            self._loops.append((end, loop))

    def _read_type(self, tokens: Sequence[Token], at: int) -> None:
        """Take the class of `Wheel left`, `Wheel *left` and `const Wheel &left`."""
        place = at + 1 + (tokens[at + 1].text in ("*", "&") if at + 1 < len(tokens) else 0)
        if tokens[at].text in self.classes and place < len(tokens) and tokens[place].is_name:
            self.types[tokens[place].text] = tokens[at].text

    def _read_declaration(self, tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> None:
        """Take `Class one, two[3];`, and `Class one = Class();`."""
        place = at + 1
        while place + 1 < len(tokens) and len(self.declared) < MOST_CALLS:
            name, mark, end = tokens[place], tokens[place + 1].text, place + 1
            count: tuple[Token, ...] = ()
            if not name.is_name:
                return
            if mark == "[":
                end = partners.get(end, end)
                count = tuple(tokens[place + 2 : end])
                end += 1
                mark = tokens[end].text if end < len(tokens) else ""
            if mark not in (",", ";", "="):
                return
            self.declared.append(DeclaredObject(tokens[at].text, name.text, count, name.spot))
            if tokens[at].text in self.classes:
                self.types[name.text] = tokens[at].text
            if mark != ",":
                return
            place = end + 1

    def _find_functions(self, tokens: Sequence[Token], partners: Mapping[int, int]) -> None:
        """Find the bodies of functions, by the index of their brace, and the names of their parameters.

        A method whose name functions of other classes have too is `Wheel::stop`."""
        self._bodies: dict[int, str] = {}
        classes = list(classes_of(tokens, partners))
        self.classes = {each.name: each for each in classes}
        # `struct Wheel { ... } left;`
        objects = ((tokens[each.end + 1], each) for each in classes if each.end + 1 < len(tokens))
        self.types |= {token.text: each.name for token, each in objects if token.is_name}
        found = list(functions_of(tokens, partners, classes, _KEYWORDS))
        for each in found:
            self._scopes_of[each.name].add(each.scope)
        for each in found:
            name = self._method(each.scope, each.name)
            self._bodies[each.brace] = name
            self.class_methods[each.scope].append(name)
            self.scopes[name] = each.scope
            self.parameters[name] = [_parameter(one) for one in split(each.parameters)]
            self.values_of_members += [(name, *given) for given in each.values[:MOST_VALUES]]
            for member, value in each.values[:MOST_VALUES]:
                self.expressions[member].append((value, name))

    def _made_members(self) -> Iterator[SketchCall]:
        """The objects that are members of others, by the values in constructors: `: left(5, 7)`."""
        for function, member, value in self.values_of_members:
            kind = self.types.get(member, "")
            if kind in self.parameters and value:
                arguments, order = tuple(split(value)), len(self.calls)
                yield SketchCall(member, "", kind, arguments, function, value[0], order)

    def _method(self, scope: str, name: str) -> str:
        """The name of a function in a class (empty without) that no other one has."""
        is_shared = len(self._scopes_of[name]) > 1 and scope and name != scope
        return f"{scope}::{name}" if is_shared else name

    def _resolved(self, call: SketchCall) -> SketchCall:
        """A call of a method whose name other classes have too, with that of its object's class."""
        scopes = self._scopes_of.get(call.name, set())
        if len(scopes) < 2 or call.type:
            return call
        own = self.scopes.get(call.function, "")
        scope = own if call.object in ("", "this") else self.types.get(call.object, "")
        return replace(call, name=self._method(scope, call.name)) if scope in scopes else call

    def _read_value(
        self, tokens: Sequence[Token], at: int, partners: Mapping[int, int], function: str
    ) -> None:
        """Take `name = value` up to the next comma or end."""
        start = end = at + 2
        while end < len(tokens) and tokens[end].text not in (",", ";", ")", "}", "]"):
            end = partners.get(end, end) + 1
        value = tuple(tokens[start : min(end, start + LONGEST_CALL)])
        known = self.expressions[tokens[at].text]
        if value and value[0].text == "{":
            self.aggregates[tokens[at].text] = tuple(split(value[1:-1])[:MOST_VALUES])
        elif value and len(known) < MOST_VALUES:
            known.append((value, function))

    def _read_array(self, tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> None:
        """Take the elements of `name[...] = {...}`, of inner braces as well."""
        end = at + 1
        while end < len(tokens) and tokens[end].text == "[" and end in partners:
            end = partners[end] + 1
        if end + 1 < len(tokens) and tokens[end].text == ")" and tokens[end + 1].text == "(":
            end = partners.get(end + 1, end) + 1  # of functions: `void (*ticks[])() = {...}`
        if end + 1 < len(tokens) and tokens[end].text == "=" and tokens[end + 1].text == "{":
            inner = tokens[end + 2 : partners.get(end + 1, end + 2)]
            rows = []
            for item in split(inner)[:MOST_VALUES]:
                if not item:
                    continue  # after a last comma
                is_row = item[0].text == "{"
                rows.append(tuple(split(item[1:-1])[:MOST_VALUES]) if is_row else (item,))
            self.arrays[tokens[at].text] = tuple(rows)

    def _read_call(
        self, tokens: Sequence[Token], at: int, partners: Mapping[int, int], function: str
    ) -> None:
        close = partners.get(at + 1)
        if close is None or not at or close - at > LONGEST_CALL or len(self.calls) == MOST_CALLS:
            return
        before = tokens[at - 1]
        is_definition = before.is_name and before.text not in _KEYWORDS
        if before.text == "," and self._defined is not None and self._defined[0] == at - 2:
            before, is_definition = self._defined[1], True  # `Motor left(9), right(10);`
        if close + 1 in self._bodies and tokens[close + 1].text == "{":
            return  # the head of a function
        if tokens[at + 1].text == "{" and not is_definition:
            return
        name = tokens[at]
        if before.text == "=" and at > 2 and tokens[at - 3].text == name.text and tokens[at - 2].is_name:
            # `Motor left = Motor(9);`
            name, before, is_definition = tokens[at - 2], name, True
        elif before.text == "new" and at > 2 and tokens[at - 2].text == "=" and tokens[at - 3].is_name:
            # `Motor *left = new Motor(9);`
            name, before, is_definition = tokens[at - 3], name, True
        arguments = tuple(split(tokens[at + 2 : close]))
        if is_definition and any(_is_parameter(each) for each in arguments):
            return  # the prototype of a function
        has_members = close + 1 < len(tokens) and tokens[close + 1].text == ":"
        if has_members and arguments and all(_is_parameter(each) for each in arguments):
            return  # the head of a constructor with values of members
        owner = () if is_definition else _owner_before(tokens, at, partners)
        call = SketchCall(
            name=name.text,
            object=owner[0].text if owner else "",
            type=before.text if is_definition else "",
            arguments=arguments,
            function=function,
            token=tokens[at],
            order=len(self.calls),
            loops=tuple(loop for _, loop in self._loops),
            owner=owner,
            block=self._blocks[-1] if self._blocks else -1,
        )
        self.calls.append(call)
        if is_definition:
            self._defined = (close, before)
            if before.text in self.classes:
                self.types[name.text] = before.text


def texts_of(sketch: Path) -> dict[str, str]:
    """The texts of a sketch's files by name, then those of `src/` and of libraries beside it, by path, that
    none of the simulator's replaces. Libraries that are longer than any sketch are left out. Raises OSError.
    """
    found = {path.name: path.read_text("utf-8", "replace") for path in source_paths(sketch)}
    others: dict[str, str] = {}
    for path, name in library_paths(sketch if sketch.is_dir() else sketch.parent):
        if not any(is_provided(each.name, ()) for each in path.parent.glob("*.h")):
            others[name] = path.read_text("utf-8", "replace")
    return found | (others if sum(map(len, others.values())) <= LARGEST_SOURCE else {})


def _loop_of(head: Sequence[Token]) -> SketchLoop | None:
    """The loop of a head without its brackets; None for one of another form."""
    marks = [token.text for token in head]
    if marks.count(";") != 2:
        # for (int pin : pins)
        is_range = len(marks) > 3 and marks[-2] == ":" and head[-1].is_name and head[-3].is_name
        return SketchLoop(marks[-3], (), (), False, marks[-1]) if is_range else None
    begin, end = marks.index(";"), len(marks) - 1 - marks[::-1].index(";")
    start, middle, step = head[:begin], head[begin + 1 : end], marks[end + 1 :]
    at = next((place for place, token in enumerate(start) if token.text == "="), 0)
    if not at or len(middle) < 3 or middle[1].text not in ("<", "<="):
        return None
    name = start[at - 1].text
    if middle[0].text != name or sorted(step) != sorted(("++", name)):
        return None
    return SketchLoop(name, tuple(start[at + 1 :]), tuple(middle[2:]), middle[1].text == "<=")


def _parameter(tokens: Sequence[Token]) -> str:
    """The name of a parameter: the last one before its default and its brackets."""
    name = ""
    for token in tokens:
        if token.text in ("=", "["):
            break
        if token.is_name:
            name = token.text
    return name


def _is_parameter(tokens: Sequence[Token]) -> bool:
    """True for `int x`: two names side by side, which no argument has."""
    return any(one.is_name and other.is_name for one, other in pairwise(tokens))


def _owner_before(tokens: Sequence[Token], at: int, partners: Mapping[int, int]) -> tuple[Token, ...]:
    """The object before the dot of a method, with its index: `sonar[1]` of `sonar[1].ping(`."""
    if at < 2 or tokens[at - 1].text not in (".", "->"):
        return ()
    place = at - 2
    if tokens[place].text == "]":
        place = partners.get(place, 0) - 1
    return tuple(tokens[place : at - 1]) if place >= 0 and tokens[place].is_name else ()
