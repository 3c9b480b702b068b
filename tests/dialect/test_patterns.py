"""Patterns of messages and templates of replies."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.dialect.expressions import Expression, FieldValue
from simmer_tui.dialect.patterns import Pattern
from simmer_tui.dialect.templates import BinaryReply, check_pack, parsed_reply


class Names:
    """Values by name."""

    def __init__(self, **values: FieldValue) -> None:
        self.values = values

    def value(self, name: str) -> FieldValue:
        return self.values[name]

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        return (1.5, 2.5)


@pytest.mark.parametrize(
    ("pattern", "message", "values"),
    [
        ("getData", "getData", {}),
        ("getData", "getdata", None),
        ("w {n}", "w 13", {"n": 13}),
        ("w {n}", "w   -2.5e1", {"n": -25.0}),
        ("w {n}", "w 13 ", None),
        ("w{n:int}", "w1.5", None),
        ("[l{i:digit}{angle:int}]", "[l090]", {"i": 0, "angle": 90}),
        ("p{n:int=5}", "p", {"n": 5}),
        ("p{n:int=5}", "p3", {"n": 3}),
        ("[{way:f=0|d=1|fast=2}{ms=300}]", "[fast]", {"way": 2, "ms": 300}),
        ("[{way:f=0|d=1|fast=2}{ms=300}]", "[d50]", {"way": 1, "ms": 50}),
        ("say {what:text}", "say a b  c", {"what": "a b  c"}),
        ("{a:word} {b:word}", "left right", {"a": "left", "b": "right"}),
        ("read {codes:list}", "read u0, u1", {"codes": ("u0", "u1")}),
        ("r {n}", "r 1" + "0" * 50, None),
        ("a.b", "axb", None),
        ('{{"cmd": "drive", "cm": {n}}}', '{"cmd": "drive", "cm": 7}', {"n": 7}),
        ("{{}}", "{}", {}),
        ("{", "{", {}),
    ],
)
def test_a_pattern_takes_values_out_of_a_whole_message(
    pattern: str, message: str, values: dict[str, FieldValue] | None
) -> None:
    found = Pattern(pattern).match(message)
    assert found == values
    if found is not None and values is not None:
        assert {name: type(value) for name, value in found.items()} == {n: type(v) for n, v in values.items()}


@pytest.mark.parametrize(
    "source", ["w {n}", "p{n:int=5}", "[{way:f=0|d=1}{ms=300}]", "{a:word}-{b:text}", '{{"a": {n}}}']
)
def test_a_pattern_matches_its_own_example(source: str) -> None:
    pattern = Pattern(source)
    assert pattern.match(pattern.example) is not None


@pytest.mark.parametrize(
    "source", ["", "{}", "{1}", "{n:float}", "{n}{n}", "{a:text}{b:text}", "{n=x}", "{w:a=1|a=2}", "{n!r}"]
)
def test_a_wrong_pattern_is_refused(source: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        Pattern(source)


FORMS = ("{a}", "{b:int}", "{c:digit=1}", "{d:word}", "{e:list}", "{f:f=0|far=1}", "{g=5}", "{h:list=u0}")
PIECES = (" ", "   ", ",", "x", "-")
MESSAGES = ("u0", ",", " , ", "  ", "1", "-2.5", "1e", "far", ".", "x", "-")


def lines_of(work: Callable[[], object]) -> int:
    """The lines of Python that run. What the parts of a pattern take at once is bounded, or one pass."""
    count = 0

    def trace(frame: FrameType, event: str, argument: object) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return count


def holds_its_steps(parts: list[str], text: int, unit: str, end: str, count: int) -> None:
    """Twice the message takes at most twice the steps."""
    source = "".join([*parts[:text], "{text:text}", *parts[text:]])
    try:
        pattern = Pattern(source)
    except ValueError:  # a field twice
        return
    once, twice = (lines_of(lambda n=n: pattern.match(unit * n + end)) for n in (count, 2 * count))  # type: ignore[misc]
    assert twice <= 2 * once + 200, (source, unit, end)


PARTS = st.lists(st.sampled_from(FORMS + PIECES), max_size=6)
UNITS = st.lists(st.sampled_from(MESSAGES), min_size=1, max_size=3).map("".join)


@given(PARTS, st.integers(0, 6), UNITS, st.sampled_from(("", "!", " ")))
@settings(max_examples=25, deadline=None)
def test_a_pattern_takes_steps_by_the_length_of_its_message(
    parts: list[str], text: int, unit: str, end: str
) -> None:
    holds_its_steps(parts, text, unit, end, 20)


@pytest.mark.slow
@given(PARTS, st.integers(0, 6), UNITS, st.sampled_from(("", "!", " ")))
@settings(max_examples=1000, deadline=None)
def test_any_pattern_takes_steps_by_the_length_of_its_message(
    parts: list[str], text: int, unit: str, end: str
) -> None:
    holds_its_steps(parts, text, unit, end, 100)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("{a:text},{b:list}", ",a" * 30_000 + ","),
        ("{a:text}{b:word}X", "a" * 60_000),
        ("{a}{b=1}{c=2}{d:word=x}{e:word=y}{f:text}!", "1" * 60_000),
    ],
)
def test_a_long_message_takes_a_few_steps_a_character(source: str, message: str) -> None:
    pattern = Pattern(source)
    # With a step for each pair of characters this would take minutes.
    assert pattern.match(message) is None
    assert lines_of(lambda: pattern.match(message[:2000])) < 30 * 2000


def test_a_reply_has_its_values_in_their_formats() -> None:
    reply, _ = parsed_reply("u1: {u1*cm:.2f} {i:d}|{named:s}|{{{rays:.1f|,}}} {word}")
    names = Names(u1=1.0, i=2.5, named="x", rays=(1.25, float("inf"), 3.0), word="ok")
    assert reply.text(names, "-1.00") == "u1: 2.54 2|x|{1.2,-1.00,3.0} ok"
    assert parsed_reply("{u1/0:.2f}")[0].text(names, "none") == "none"
    assert parsed_reply("{pick(1, '}', 'a:b')}")[0].text(names, "") == "a:b"
    assert parsed_reply("{scan(0, 90, 2)|;}")[0].text(names, "") == "1.5;2.5"


@pytest.mark.parametrize(
    "source", ["{", "}", "{n:.200f}", "{n:100000000d}", "{n:q}", "{}", "{n +}", "{n:{m}}"]
)
def test_a_wrong_reply_is_refused(source: str) -> None:
    assert any(parsed_reply(source)[1])


def test_a_binary_reply_is_packed() -> None:
    values = tuple(Expression(each) for each in ("u1*mm", "1/0", "k"))
    reply = BinaryReply(8, pack="<fhB", values=values)
    assert reply.content(Names(u1=1.0, k=3), "inf") == bytes.fromhex("3333cb41 0000 03")
    check_pack("<fhB", 3)
    check_pack("<3h4sx", 4)
    for pack, count in (("<fh", 3), ("zz", 1), ("100000s", 1)):
        with pytest.raises(ValueError, match=r"\w"):
            check_pack(pack, count)
