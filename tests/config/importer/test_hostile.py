"""Files that try to run something, or to take all time and memory: they are read as data, within bounds."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import pytest

from simmer_tui.config.importer.simmer_python import read_simmer_python
from simmer_tui.errors import ConfigurationError

# {F} is the path of a file that must not exist afterwards.
DEEDS = (
    *("open('{F}', 'w')", "__import__('os').mkdir('{F}')", "eval(\"open('{F}', 'w')\")"),
    *("exec(\"open('{F}', 'w')\")", "exec('import os; os.mkdir(\"{F}\")')", "(lambda: open('{F}', 'w'))()"),
    *("().__class__.__base__.__subclasses__()", "getattr(open, '__call__')('{F}', 'w')"),
    *("globals()['__builtins__']['open']('{F}', 'w')", "vars(__builtins__)['open']('{F}', 'w')"),
    *("compile('open(1)', '', 'exec')", "breakpoint()", "input()", "print(open('{F}', 'w'))"),
    *("map(open, ['{F}'])", "list(map(eval, [\"open('{F}', 'w')\"]))", "sorted([1], key=lambda n: exit(n))"),
    *("__import__('pathlib').Path('{F}').touch()", "'{0.__class__.__init__.__globals__}'.format(print)"),
    *("[0] * 10**9", "'a' * 10**9", "9**9**9", "'%999999999d' % 1", "f'{1:999999999}'", "range(10**18)[5]"),
    *("[[0] * 99999 for i in range(99999)]", "(lambda f: f(f))(lambda f: f(f))", "json.loads('[' * 90000)"),
    *("eval('eval(' * 900 + '1' + ')' * 900)", "globals() | {'a': globals()}", "-" * 300 + "1"),
    *("[x for x in range(99999) for y in range(99999)]", "'a'.join('b' * 99999 for i in range(99999))"),
    "sum(range(99999)) if [n for n in range(99999) if n < 0] else max(range(99999))",
    "exec('while True: pass')",
)
# Where a file may have an expression.
PLACES = (
    "x = {D}",
    "{D}",
    "x: int = {D}",
    "x = [{D}]",
    "x = {{'a': {D}}}",
    "x = f'{{{D}}}'",
    "if {D}:\n    x = 1",
    "while {D}:\n    pass",
    "for x in {D}:\n    pass",
    "x = [n for n in {D}]",
    "def f(n={D}):\n    return n\nx = f()",
    "def f():\n    return {D}\nx = f()",
    "class C:\n    x = {D}\ny = C.x",
    "class C:\n    def __init__(self):\n        self.x = {D}\ny = C().x",
    "try:\n    x = {D}\nexcept Exception:\n    x = 1",
    "sensors = {{'u0': Ultrasonic({{'position': {D}}})}}",
    "sensors = {{'u0': Ultrasonic({D})}}",
    "class Ultrasonic:\n    def __init__(self, i):\n        self.max_range = {D}\n"
    "sensors = {{'u0': Ultrasonic({{}})}}",
    "walls = {D}",
    "x = [1]\nx[0] = {D}",
)


def harmless(deed: str, place: str, folder: Path) -> None:
    made = folder / "made"
    text = place.format(D=deed.replace("{F}", str(made)))
    before = set(sys.modules)
    with contextlib.suppress(ConfigurationError):
        read_simmer_python(text)
    assert not made.exists(), text
    assert set(sys.modules) == before, text


def test_no_file_is_executed(tmp_path: Path) -> None:
    # Those that want much time take some of it up to their bounds, so they are slow.
    for deed in DEEDS:
        if "{F}" in deed:
            harmless(deed, PLACES[0], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_no_file_is_executed_or_takes_all_time_wherever_it_asks_for_it(place: str, tmp_path: Path) -> None:
    for deed in DEEDS:
        harmless(deed, place, tmp_path)
