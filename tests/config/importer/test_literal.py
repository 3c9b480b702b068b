"""Python source read for its values and never run."""

from __future__ import annotations

import ast
import math
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.config.importer.literal import read_expression, read_source
from simmer_tui.config.importer.python_values import Call, Located, Unreadable
from simmer_tui.errors import ConfigurationError


def value(text: str, name: str = "x") -> Any:
    return read_source(text, "config.py").names[name].value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = -3", -3),
        ("x = 1 + 2*3 - 4/8", 6.5),
        ("x = 7 // 2 + 7 % 4 + 2**3", 14),
        ("x = [1, (2, -3), [4]]", [1, [2, -3], [4]]),
        ("a = 4\nx = a/2", 2.0),
        ("a = 4\na += 1\nx = a", 5),
        ("a, b = 1, [2]\nx = b[0] + a", 3),
        ("import math\nx = math.pi", math.pi),
        ("from math import radians as rad\nx = rad(180)", math.pi),
        ("import numpy as np\nx = np.array([1, 2])", [1, 2]),
        ("import numpy\nx = numpy.deg2rad(180)", math.pi),
        ("import pygame.math as pm\nx = pm.Vector2(1, 2)", [1, 2]),
        ("from pygame import Vector2\nx = Vector2((1, 2))", [1, 2]),
        ("x = [i/2 for i in range(3)]", [0.0, 0.5, 1.0]),
        ("x = len([1, 2]) + max(3, 4) + sum([5, 6])", 17),
        ("x = [*range(2), 5]", [0, 1, 5]),
        ("x: float = 2", 2),
        ("n = 3\nx = f'u{n}'", "u3"),
        ("x = [1] + [2]", [1, 2]),
        ("x = {'a': {'b': 4}}['a']['b']", 4),
        ("x = 0\nfor i in range(4):\n    x += i", 6),
        (
            "x = []\nfor i in (1, 2):\n    for j in range(i):\n        x.append([i, j])",
            [[1, 0], [2, 0], [2, 1]],
        ),
        ("x = []\nfor i, (a, b) in enumerate([(1, 2), (3, 4)]):\n    x.extend([i, a * b])", [0, 2, 1, 12]),
        ("x = []\nfor a, b in zip([1, 2], [3, 4, 5]):\n    x += [a + b]", [4, 6]),
        ("x = []\nfor key in {'a': 1}:\n    x.append(key)", ["a"]),
        ("y = []\nx = y\ny.append(3)", [3]),
        ("import numpy as np\nx = [a for a in np.linspace(0, 1, 3)]", [0.0, 0.5, 1.0]),
        ("import numpy as np\nx = np.linspace(0, 1, 4, endpoint=False)", [0.0, 0.25, 0.5, 0.75]),
        ("import numpy as np\nx = np.arange(0, 1, 0.25)", [0.0, 0.25, 0.5, 0.75]),
        ("import numpy as np\nx = np.arange(3)", [0, 1, 2]),
        ("from pygame import Vector2\nx = Vector2(1, 2) + Vector2(3, 4)", [4, 6]),
        ("x = [10 * i + j for i in range(3) if i for j in range(i)]", [10, 20, 21]),
        ("x = 1 if 2 > 1 else 2", 1),
        ("x = 0\nif x:\n    x = 1\nelif x is not None and 'a' in 'ab':\n    x = 2\nelse:\n    x = 3", 2),
        ("x = 0\nfor i in range(9):\n    if i > 3:\n        break\n    x = i\nelse:\n    x = 7", 3),
        ("x = 0\nfor i in range(9):\n    if i % 2:\n        continue\n    x += i", 20),
        ("x = 0\nfor i in range(2):\n    x += 1\nelse:\n    x += 9", 11),
        ("x = 1\nwhile x < 30:\n    x *= 2", 32),
        (
            "def half(n, *, by=2):\n    'Half.'\n    r = n / by\n    return r\nx = half(5) + half(3, by=4)",
            3.25,
        ),
        ("def f(*a, **k):\n    return len(a) + k['b']\nx = f(1, 2, b=3)", 5),
        ("def f(n):\n    return 1 if n < 2 else n * f(n - 1)\nx = f(5)", 120),
        ("k = 2\ndef outer():\n    k = 5\n    return lambda n: n * k\nx = outer()(3) + k", 17),
        ("x = []\ndef add(n):\n    x.append(n)\nadd(1)\nadd(2)", [1, 2]),
        ("x = 1\ndef more():\n    global x\n    x += 1\nmore()", 2),
        ("x = list(map(lambda n: n * n, [1, 2]))", [1, 4]),
        ("x = [[1] * 2 for _ in range(2)]\nx[0][1] = 5", [[1, 5], [1, 1]]),
        ("x = [1, 2, 3, 4][1:-1]", [2, 3]),
        ("x = sorted([2, 3, 1])[0]", 1),
        ("x = f'{7:02d}:{1/3:.2f}' + 'u%d' % 3 + '{}-{b}'.format(1, b='c')", "07:0.33u31-c"),
        ("x = 'u0,u1'.split(',')[1].upper()", "U1"),
        ("try:\n    x = {}['a']\nexcept KeyError:\n    x = 4", 4),
        ("class Size:\n    side = 6\n    half = side / 2\nx = Size.half", 3.0),
        (
            "class P:\n    def __init__(self, n):\n        self.n = n\n"
            "    def twice(self):\n        return 2 * self.n\nx = P(4).twice()",
            8,
        ),
        ("from types import SimpleNamespace\nx = SimpleNamespace(a=3).a", 3),
        (
            "import copy\na = {'k': [1]}\nb = copy.deepcopy(a)\nb['k'].append(2)\nx = a['k'] + b['k']",
            [1, 1, 2],
        ),
        ("d = {}\nd.setdefault('a', []).append(1)\nx = d['a'] + [d.get('b', 2)]", [1, 2]),
        ("d = {'a': 1}\nd.update(b=2)\nd |= {'c': 3}\ndel d['a']\nx = sum((d | {'d': 4}).values())", 9),
        ("x = (n := 3) + n", 6),
        ("from math import *\nx = degrees(pi)", 180.0),
        ("x = __name__ == '__main__'", False),
        ("from pygame import Vector2\nx = -Vector2(1, 2) * 2 - Vector2(1, 1) / 2", [-2.5, -4.5]),
        ("from pygame import Vector2\nv = Vector2(3, 0)\nx = (2 * v).rotate(180)", [-6.0, pytest.approx(0)]),
    ],
)
def test_plain_values_are_worked_out(text: str, expected: object) -> None:
    assert value(text) == expected


def test_the_entries_of_a_dict_know_their_lines() -> None:
    table = value("x = {\n  'a': 1,\n  'b': unknown,\n}\nx['c'] = 5\n")
    assert table["a"] == Located(1, 2)
    assert table["b"].line == 3
    assert isinstance(table["b"].value, Unreadable)
    assert table["c"] == Located(5, 5)


def test_a_dict_can_be_made_of_another_in_a_comprehension() -> None:
    table = value("infos = {'u0': 1, 'u1': 2}\nx = {k: Ultra(v) for k, v in infos.items()}")
    assert [(key, item.value.arguments) for key, item in table.items()] == [("u0", (1,)), ("u1", (2,))]


def test_the_variable_of_a_comprehension_stays_inside_it() -> None:
    assert value("i = 7\nx = [i for i in range(3)]\n", "i") == 7


def test_a_call_of_anything_else_is_kept_and_not_made() -> None:
    call = value("from devices.lidar import Lidar\nx = Lidar({'a': 1}, range=5)")
    assert isinstance(call, Call)
    assert (call.name, call.line) == ("Lidar", 2)
    assert call.arguments[0]["a"].value == 1
    assert call.keywords["range"].value == 5


@pytest.mark.parametrize(
    "text",
    [
        "x = unknown + 1",
        "x = 1 / 0",
        "x = 9 ** 9 ** 9",
        "x = (-1) ** 0.5",
        "x = 'a' * 10**9",
        "x = [0] * 10**9",
        "x = list(range(10**12))",
        "x = range(10**40)",
        "x = [1, 2][5]",
        "x = {}['a']",
        "x = 1 if unknown else 2",
        "x = (lambda n: n)()",
        "def f(n):\n    return f(n + 1)\nx = f(0)",
        "def f():\n    break\nx = f()",
        "def f():\n    if unknown:\n        return 1\n    return 2\nx = f()",
        "x = f'{1:999999999}'",
        "x = '{0.__class__}'.format(1)",
        "x = '{:>99999999}'.format(1)",
        "x = '%999999999d' % 1",
        "x = '%s' * 9000 % (['a' * 9000] * 9000)",
        "x = ('{0}' * 9000).format('a' * 9000)",
        "x = 'c'.join(['d'] * 99999)",
        "x = 'ab'.replace('', 'c' * 99999)",
        "x = [[1]] == [[1]]",
        "x = (1).__class__",
        "x = ''.__class__.__mro__",
        "import os\nx = os.environ['HOME']",
        "x = getattr('', '__class__')",
        "x = 1 << 99",
        "import os\nx = 1 if os.getenv('A') else 2",
        "import os\nx = os.getenv('A') == 'b'",
        "x = 0\nwhile True:\n    x += 1",
        "x = []\nfor i in range(10**5):\n    for j in range(10**5):\n        x.append(j)",
        "x = [1]\nfor i in range(40):\n    x.extend(x)",
        "x = 0\nfor i in unknown:\n    x = i",
        "x = 0\nfor i in range(9):\n    if i > unknown:\n        break\n    x = i",
        "import numpy as np\nx = np.linspace(0, 1, 10**9)",
        "import numpy as np\nx = np.arange(0, 1, 0)",
        "import numpy as np\nx = np.linspace([], 1, 3)",
        "import numpy as np\nx = np.linspace(0, 1, num=2.5)",
        "import numpy as np\nx = np.linspace(0, 1e300 * 1e300, 3)",
        "import numpy as np\nx = np.arange(0, 1e9, 1e-3)",
        "from pygame import Vector2\nx = Vector2(1, 2) * Vector2(1, 2)",
        "x = [1, 2].rotate(3)",
        "x = enumerate()",
        "x = enumerate([1], [2])",
        pytest.param("x = [list(range(90000)) for i in range(9000)]", marks=pytest.mark.slow),
        "x = os.sep",
        "x = math.sqrt(-1)",
        "x = math.cos('a')",
        "x = " + "-" * 70 + "1",
        "x = [[[j for j in range(9000)][0] for k in range(9000)][0] for i in range(9000)]",
    ],
)
def test_what_is_beyond_plain_values_is_said_to_be(text: str) -> None:
    found = value(text)
    assert isinstance(found, Unreadable)
    assert found.why


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("def g():\n    yield 1\nx = g()", "Yield is not understood"),
        (
            "def f(n):\n    match n:\n        case 1: return 2\n    return 4\nx = f(1)",
            "Match is not understood",
        ),
        ("x = eval('1')", "eval() is not understood"),
        ("first, *x = [1, 2, 3]", "assign on line 1 is not followed"),
        ("@cache\ndef f():\n    return 1\nx = f()", "f has a decorator"),
        ("@dataclass\nclass P:\n    a: int\nx = P(1)", "P has a decorator"),
        ("from enum import Enum\nclass S(Enum):\n    A = 3\nx = S.A.value", ".value is not a value"),
        (
            "from collections import defaultdict\nd = defaultdict(list)\nx = d['a']",
            "defaultdict(...) has no value",
        ),
        ("x = sorted([[2], [1]], key=len)", "sorted is not understood"),
        ("try:\n    x = {}['a']\nexcept IOError:\n    x = 1\nexcept KeyError:\n    x = 4", "try on line 1"),
        ("x = {1, 2}", "Set is not understood"),
    ],
)
def test_rare_forms_are_refused_with_the_reason(text: str, why: str) -> None:
    assert why in value(text).why


@pytest.mark.parametrize(
    "text",
    [
        "x = 1\nwhile x < unknown:\n    x += 1",
        "x = [3]\nx.shuffle(3)",
        "x = 1\nx.append(3)",
        "x = [1]\nx[unknown] = 2",
        "x = 1\nif unknown:\n    x = 2",
        "x = {'a': []}\nx['a'].shuffle()",
    ],
)
def test_a_name_that_a_statement_may_have_changed_is_not_trusted(text: str) -> None:
    source = read_source(text, "config.py")
    assert isinstance(source.names["x"].value, Unreadable)
    assert [line for line, _ in source.skipped] == [2]


def test_a_statement_that_is_not_followed_is_told_with_line_and_reason() -> None:
    source = read_source("n = 1\nmatch n:\n    case 1: x = 2\n", "config.py")
    assert list(source.skipped) == [(2, "match is not followed: Match is not understood")]


def test_a_statement_that_is_not_followed_inside_a_loop_is_told_once() -> None:
    source = read_source("x = []\nfor i in range(50):\n    if unknown:\n        x.append(i)\n", "config.py")
    assert [line for line, _ in source.skipped] == [3]
    assert isinstance(source.names["x"].value, Unreadable)


def test_nothing_of_the_file_is_executed(tmp_path: Path) -> None:
    target = tmp_path / "made"
    text = (
        f"import antigravity_of_tests\nopen({str(target)!r}, 'w')\n"
        f"x = __import__('os').mkdir({str(target)!r})\ny = [open({str(target)!r}, 'w') for i in range(2)]\n"
    )
    read_source(text, "config.py")
    assert not target.exists()
    assert "antigravity_of_tests" not in sys.modules


def test_lists_doubled_over_and_over_do_not_grow_without_bound() -> None:
    found = value("x = [1]\n" + "x = x + x\n" * 200 + "y = [1]\n" + "y = [y, y]\n" * 50 + "x = str(y)\n")
    assert isinstance(found, Unreadable)


@pytest.mark.parametrize("text", ["x = (", "x = '\0'", "[" * 5000, "x = " + "9" * 5000, "if True:"])
def test_what_is_not_python_is_refused_with_its_place(text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        read_source(text, "config.py")
    (problem,) = caught.value.problems
    assert problem.where.startswith("config.py")
    assert "Python" in problem.what


def test_a_backslash_in_a_text_is_no_matter() -> None:
    assert value("x = 'C:\\d'\n") == "C:\\d"


@settings(max_examples=20)
@given(number=st.floats(-1e6, 1e6), other=st.floats(-1e6, 1e6))
def test_arithmetic_is_python_s_own(number: float, other: float) -> None:
    assert read_expression(f"{number!r} - {other!r}*2") == number - other * 2


@given(text=st.text(max_size=40))
def test_any_text_is_a_value_or_said_to_be_none(text: str) -> None:
    found = read_expression(text)
    assert not isinstance(found, Unreadable) or isinstance(found.why, str)


@given(text=st.text(alphabet="xy=[](){},:'\"1 \n+-*.", max_size=40))
def test_any_source_is_read_or_refused(text: str) -> None:
    refused = False
    try:
        source = read_source(text, "config.py")
    except ConfigurationError:
        refused = True
    try:
        compile(text, "config.py", "exec", ast.PyCF_ONLY_AST)
    except SyntaxError:
        assert refused
    else:
        assert not refused
        assert all(located.line > 0 for located in source.names.values())
