"""Expressions of a dialect.toml: arithmetic, and nothing else."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.dialect.expressions import MOST_STEPS, Expression, FieldValue, listed_codes
from simmer_tui.errors import ExpressionError


class Names:
    """Values by name; every call is told."""

    def __init__(self, **values: FieldValue) -> None:
        self.values = values
        self.calls: list[tuple[str, tuple[FieldValue, ...]]] = []

    def value(self, name: str) -> FieldValue:
        return self.values[name]

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        self.calls.append((function, tuple(arguments)))
        return 7.0


MISSING = [
    *("min(1/0, 3)", "min(3, 1/0)", "max(1/0, 3)", "max(3, 1/0)", "min(u0, 3)", "max(-u0, 3)"),
    *("1 / u0", "3 % u0", "3 // u0", "u0 ** 0", "0 ** u0", "abs(u0) + 1", "round(u0) - 1", "0 * u0"),
    *("(1 / far)[1]", "(far ** 0)[1]", "(far * u0)[0]", "(far % 3)[1]", "(3 - far)[1]"),
]
"""Calculations with a missing number."""


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("n*12/13", 12.0),
        ("u1*cm", 25.4),
        ("u1*mm", 254.0),
        ("1 if n < 45 else 0", 1),
        ("pick((n - 12) % 4, 'w0', 'd0', 's0')", "d0"),
        ("7 // 2 + 2 ** 3 - -1", 12),
        ("max(1, n, 4)", 13),
        ("round(2.5) + round(3.5)", 6),
        ("round(1.2345, 2)", 1.23),
        ("int(-2.7)", -2),
        ("0 < n <= 13 and not (n == 4 or n != 13)", 1),
        ("scan[1] + len(scan)", 4),
        ("'a' + 'b'", "ab"),
        ("1 / 0 + 1", math.nan),
        ("scan[2] + 1", math.nan),
        ("scan[-1]", math.nan),
        ("1e300 * 1e300", math.inf),
        *((text, math.nan) for text in MISSING),
    ],
)
def test_it_calculates(text: str, value: FieldValue) -> None:
    inf = math.inf
    found = Expression(text).value(Names(n=13, u0=inf, u1=10.0, scan=(1, 2), far=(5.0, inf)))
    assert found == value or (isinstance(found, float) and value != value and not math.isfinite(found))


class Counted(float):
    """A number that counts what is done with numbers of its kind."""

    done = 0
    __hash__ = float.__hash__


def counting(operation: str) -> Any:
    def count(number: float, other: object) -> Any:
        Counted.done += 1
        return getattr(float, operation)(number, other)

    return count


for each in ("eq", "ne", "mul", "rmul", "truediv", "pow"):
    setattr(Counted, f"__{each}__", counting(f"__{each}__"))


class CountingNames(Names):
    """Long lists; a code of a call counts as well."""

    def value(self, name: str) -> FieldValue:
        kind = float if name == "F" else Counted
        return ("u0",) * 30_000 if name == "M" else tuple(kind(each) for each in range(1, 2001))

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        Counted.done += len(listed_codes(arguments[0]))
        return "u0:1.00"


@pytest.mark.parametrize("joint", [" and ", " == ", ", ", " if 1 else "])
@pytest.mark.parametrize(
    "part", ["L==L", "not L!=F", "(L*2)[0]", "(2*F)[0]", "(L/0)[0]", "(F**2)[0]", "M==M", "named(M)", "L"]
)
def test_no_expression_takes_more_than_its_steps(part: str, joint: str) -> None:
    names, least = CountingNames(), 0
    for count in (1, 2, 3, 4, 20, 30, 40, 60):
        try:
            expression = Expression(f"pick(0, {joint.join([part] * count)})")
        except ValueError:
            continue
        Counted.done = 0
        with contextlib.suppress(ExpressionError):
            expression.value(names)
        least = max(least, Counted.done)
    assert least <= MOST_STEPS


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')",
        "().__class__",
        "n.real",
        "[x for x in (1,)]",
        "lambda: 1",
        "f'{n}'",
        "open('x')",
        "n[1:2]",
        "(n := 3)",
        "n @ n",
        "n << 3",
        "True",
        "None",
        "b'x'",
        "1j",
        "min(*n)",
        "max(n, key=abs)",
        "abs()",
        "pick(1)",
        "n is n",
        "n in n",
        "",
        "n +",
        "1" * 1001,
        "+".join("1" * 250),
        "(" * 300 + "1" + ")" * 300,
        str(2**60),
    ],
)
def test_what_is_no_calculation_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        Expression(text)


@pytest.mark.parametrize("text", ["2 ** 65", "'a' * 3", "n + 'a'", "pick(9, 1, 2)", "n[0]", "-'a'"])
def test_values_that_do_not_fit_are_told(text: str) -> None:
    expression = Expression(text)
    with pytest.raises(ExpressionError):
        expression.value(Names(n=1, scan=(1, 2)))


def test_powers_do_not_grow_without_a_bound() -> None:
    assert Expression("9 ** 64 ** 1 * 9 ** 64").value(Names()) == pytest.approx(9.0**128)
    assert Expression("((9 ** 64) ** 64) ** 64").value(Names()) == math.inf


def test_names_and_sensing_are_those_it_uses() -> None:
    expression = Expression("u1*cm + ray(30 + front) if led else abs(x)")
    assert expression.names == {"u1", "front", "led", "x"}
    assert expression.sensing == {"ray"}
    names = Names(u1=1.0, front=15, led=1, x=0)
    assert expression.value(names) == pytest.approx(9.54)
    assert names.calls == [("ray", (45,))]


@given(st.text(max_size=60))
def test_any_text_is_an_expression_or_an_error(text: str) -> None:
    try:
        expression = Expression(text)
    except ValueError:
        return
    try:
        expression.value(Names(**dict.fromkeys(expression.names, 2)))
    except ExpressionError:
        return
