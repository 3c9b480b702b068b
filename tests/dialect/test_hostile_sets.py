"""Hostile dialects: nothing in them is executed, and no expression takes more memory than its share."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.bench_dialect_expressions import FIELDS, HARD, MOST_BYTES, Names, cost, hardest
from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import find_set, load
from simmer_tui.dialect.dialect_rules import Parts
from simmer_tui.dialect.expressions import Expression
from simmer_tui.dialect.patterns import Pattern
from simmer_tui.dialect.templates import LONGEST_REPLY, parsed_reply
from simmer_tui.errors import ExpressionError, Problem

SPEC = load(find_set("default")).simulation
PARTS = Parts(SPEC.sensors, SPEC.drives, SPEC.gripper, SPEC.velocities)
EVIL = "__import__('os').system('touch executed')"
EXECUTING = ("exec", "os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "import")
_happened: list[str] = []
_listens = False


def _note(event: str, arguments: Sequence[object]) -> None:
    if _listens and event in EXECUTING:
        _happened.append(f"{event} {arguments}")


@pytest.fixture
def executed() -> Iterator[list[str]]:
    """Code that Python has executed since; a hook once added stays for ever, so it is told when to listen."""
    global _listens
    if not hasattr(sys, "_dialect_hook"):
        sys._dialect_hook = True  # type: ignore[attr-defined]
        sys.addaudithook(_note)
    _happened.clear()
    _listens = True
    yield _happened
    _listens = False


@pytest.mark.parametrize(
    "text",
    [
        f'[[command]]\nmatch = "a"\nreply = "{{{EVIL}}}"',
        f'[[command]]\nmatch = "a"\ndo = "d1-{{{EVIL}}}"',
        f'[[command]]\nmatch = "a"\nif = "{EVIL}"',
        f'[[command]]\nmatch = "a"\ntakes = "{EVIL}"',
        f'[[command]]\nmatch = "a"\ndo = "pause {EVIL}"',
        f'[[command]]\nmatch = "a"\ndo = "run {{{EVIL}}} for 1 s"',
        f'[state]\nx = 1\n[[command]]\nmatch = "a"\ndo = "x = {EVIL}"',
        f'[[stream]]\nevery = 1\nsend = "{{{EVIL}}}"',
        '[[command]]\nmatch = "a"\nreply = "{u1.__class__}"',
        '[[command]]\nmatch = "a"\nreply = "{u1!r}"',
        '[[command]]\nmatch = "a"\nreply = "{u1:{u1}}"',
        '[[command]]\nmatch = "a"\nreply = "{().__class__.__bases__[0]}"',
        '[[command]]\nmatch = "{__class__.x}"',
        '[[command]]\nmatch = "a"\nreply = "{open(chr(97))}"',
    ],
)
def test_nothing_is_executed(tmp_path: Path, executed: list[str], text: str) -> None:
    (tmp_path / "dialect.toml").write_text(text, "utf-8")
    problems: list[Problem] = []
    load_dialect(tmp_path, PARTS, problems)
    assert problems
    assert not executed
    assert not Path("executed").exists()


@pytest.mark.quick_cases(6)
@pytest.mark.parametrize("kind", HARD)
def test_no_expression_takes_more_than_its_memory(kind: str) -> None:
    expression, names = hardest(HARD[kind]), Names()
    _, size = cost(lambda: expression.value(names), 1)
    assert size <= MOST_BYTES


@pytest.mark.parametrize("kind", FIELDS)
def test_no_field_takes_more_than_its_memory(kind: str) -> None:
    field, names = parsed_reply(FIELDS[kind])[0], Names()
    _, size = cost(lambda: field.text(names, ""), 1)
    assert size <= MOST_BYTES


@pytest.mark.parametrize(
    "text", ["scan(0, 1, 2)[0] + scan(0, 1, 2)[0]", "+".join(["ray(0)"] * 5), "scan(0,1,2)[0]+ray(1)"]
)
def test_the_robot_is_asked_a_few_times(text: str) -> None:
    with pytest.raises(ValueError, match=r"one scan\(\) or four ray\(\) are allowed"):
        Expression(text)


def test_replies_do_not_grow_without_a_bound() -> None:
    field = "{f:99.17f}"
    with pytest.raises(ExpressionError, match=f"replies go up to {LONGEST_REPLY}"):
        parsed_reply(field * 1000)[0].text(Names(), "")


@pytest.mark.parametrize("source", ["say {t:text} x", "{a:word} {b:text} {c:number}z", "{l:list} {t:text} ,"])
def test_a_message_of_blanks_is_gone_through_once(source: str) -> None:
    # With a step for each pair of blanks this would take half an hour.
    blanks = " " * 60_000
    for message in (f"say {blanks}", f"u0,u1 {blanks}y", f"a{blanks}b{blanks}"):
        assert Pattern(source).match(message) is None


def test_texts_and_blanks_match_as_before() -> None:
    assert Pattern("say {t:text} x").match("say one  two   x") == {"t": "one  two"}
    assert Pattern("say {t:text}").match("say  hi ") == {"t": "hi "}


_PARTS = st.sampled_from(["s", "h", "i", "f", "1e308", "'ab'", "2", "0", "scan(0,1,360)", "ray(3)"])
_TEXTS = st.recursive(
    _PARTS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "*", "**", "//", "%", "==", "<", " and ", "-"]), inner).map(
            lambda each: f"({each[0]}{each[1]}{each[2]})"
        ),
        st.tuples(st.sampled_from(["round", "abs", "len", "int"]), inner).map(
            lambda each: f"{each[0]}({each[1]})"
        ),
        st.lists(inner, min_size=2, max_size=12).map(lambda each: f"pick({', '.join(each)})"),
        inner.map(lambda each: f"{each}[0]"),
    ),
    max_leaves=60,
)


@pytest.mark.slow
@given(_TEXTS)
@settings(max_examples=2000, deadline=None)
def test_whatever_is_written_takes_no_more_than_its_memory(text: str) -> None:
    try:
        expression = Expression(text)
    except ValueError:
        return
    names = Names()
    tracemalloc.start()
    try:
        expression.value(names)
    except ExpressionError:
        pass
    finally:
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert size <= MOST_BYTES, text
