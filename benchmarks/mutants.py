"""Mutation test: small faults drawn by a seed, and the ones that the quick tests miss.

    python benchmarks/mutants.py map                        # which test runs which line, by coverage: once
    python benchmarks/mutants.py map tests/sim tests/grade  # only these tests
    python benchmarks/mutants.py run --count 200            # survivors are listed at the end
    python benchmarks/mutants.py run --only 17 43           # these of the draw again
    python benchmarks/mutants.py run --rooms sim runlog     # faults in these rooms

Faults are those of cosmic-ray: an operator, comparison, number, constant or loop is changed. One is drawn for
each place, all places with the same chance, from the rooms that decide numbers (`ROOMS`). Annotations and the
options of classes (`frozen=True`) are left out, since they do not affect a run. So are changes that are not
Python any more.

Each fault is tested alone in a copy of the repository. The quick tests that run its statement are run, those
of its room first and then the shortest, until one fails; at last the files of its room with such a test. A
statement that runs while a module is imported (constants, defaults) is tried by the tests that run any other
line of the module; one that no test runs in its own process by the tests of the room. A fault that no test
finds survives. At the end, the tests that found faults are run without any fault: one that also fails then
has found nothing.
"""

from __future__ import annotations

import argparse
import ast
import compileall
import json
import multiprocessing
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("sim", "robot/engine", "links/protocol", "runlog", "trials", "grade", "calibrate")
COVERED = ROOT / ".mutants"
"""Results of `map`: coverage by test, and the seconds of each test."""
FIRST, MOST = (60, 20.0), (1500, 240.0)
"""Tests, and their seconds, of the first and the second attempt at a fault: most faults are found by the
first few tests, and few lines are run by more tests than those of the second."""
_NO_END = "no end"
_NO_START = "no start"
_LEFT_OUT = ("VariableReplacer", "VariableInserter", "ExceptionReplacer")
"""Operators of cosmic-ray that need arguments, or replace names at random."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault: the occurrence of an operator of cosmic-ray in a file, and its line."""

    path: str
    operator: str
    occurrence: int
    line: int


def files() -> Iterator[Path]:
    """The modules that faults are put into."""
    for room in ROOMS:
        place = ROOT / "simmer_tui" / room
        yield from sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]


def idle_spans(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Beginning and end (line, column) of code that changes nothing in a program that is right: annotations,
    decorators, the options of classes, and `strict=True` of `zip`, which only checks its callers."""
    found: list[ast.expr] = []
    for node in ast.walk(ast.parse(source)):
        noted = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        if isinstance(node, ast.ClassDef):
            noted += [each.value for each in node.keywords]
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "zip":
            noted += [each.value for each in node.keywords]
        found += [
            each for each in (*noted, *getattr(node, "decorator_list", ())) if isinstance(each, ast.expr)
        ]
    return [
        ((each.lineno, each.col_offset), (each.end_lineno or 0, each.end_col_offset or 0)) for each in found
    ]


def mutants() -> list[list[Mutant]]:
    """All faults, by place."""
    from cosmic_ray import plugins
    from cosmic_ray.ast import ast_nodes, get_ast

    names = [each for each in plugins.operator_names() if not each.endswith(_LEFT_OUT)]
    operators = {name: plugins.get_operator(name)() for name in names}
    places: dict[tuple[str, tuple[int, int]], list[Mutant]] = defaultdict(list)
    for path in files():
        source = path.read_text("utf-8")
        spans = idle_spans(source)
        nodes = list(ast_nodes(get_ast(source)))
        shown = str(path.relative_to(ROOT))
        for name, operator in operators.items():
            occurrence = 0
            for node in nodes:
                for begin, _ in operator.mutation_positions(node):
                    if not any(low <= begin < high for low, high in spans):
                        places[shown, begin].append(Mutant(shown, name, occurrence, begin[0]))
                    occurrence += 1
    return [found for _, found in sorted(places.items())]


def draw(count: int, seed: int, rooms: Collection[str] = ROOMS) -> list[Mutant]:
    """Faults in some rooms, drawn by a seed: places with the same chance, and one fault at each that is still
    Python."""
    from cosmic_ray import plugins
    from cosmic_ray.mutating import mutate_code

    generator = random.Random(seed)
    places = [found for found in mutants() if room_of(found[0]) in rooms]
    generator.shuffle(places)
    drawn: list[Mutant] = []
    for found in places:
        if len(drawn) == count:
            break
        mutant = generator.choice(found)
        source = (ROOT / mutant.path).read_text("utf-8")
        changed = mutate_code(source, plugins.get_operator(mutant.operator)(), mutant.occurrence)
        try:
            with warnings.catch_warnings(action="ignore"):
                compile(changed or "", mutant.path, "exec")
        except SyntaxError:
            continue
        drawn.append(mutant)
    return drawn


def map_tests(tests: list[str]) -> None:
    """Run quick tests once with coverage, and store the tests of each line."""
    COVERED.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "pytest", "-n", "2", "--cov=simmer_tui", "--cov-context=test"]
    command += ["--cov-report=", f"--junit-xml={COVERED / 'durations.xml'}", *tests]
    environment = {**os.environ, "COVERAGE_FILE": str(COVERED / "coverage")}
    subprocess.run(command, cwd=ROOT, check=False, env=environment)


def statements(source: str) -> dict[int, range]:
    """The lines of each line's statement; for a compound one, those before its body."""
    found: dict[int, range] = {}
    for node in ast.walk(ast.parse(source)):  # from the outside in: the innermost statement stays
        if isinstance(node, ast.stmt):
            body: list[ast.stmt] = getattr(node, "body", [])
            end = max(node.lineno + 1, body[0].lineno) if body else (node.end_lineno or node.lineno) + 1
            found |= dict.fromkeys(range(node.lineno, end), range(node.lineno, end))
    return found


def test_of(context: str) -> str:
    """The test in a context of coverage; all cases of its function, if pytest cannot select the case by its
    name."""
    test = context.rpartition("|")[0]
    return test if re.fullmatch(r"[\w./:-]+(\[[\w.-]+\])?", test) else test.partition("[")[0]


class Coverage:
    """The tests that run the lines of the files, and the seconds of each."""

    def __init__(self) -> None:
        from xml.etree import ElementTree

        from coverage import CoverageData

        self._took: dict[str, float] = {}
        for case in ElementTree.parse(COVERED / "durations.xml").iter("testcase"):
            self._took[f"{case.get('classname')}.{case.get('name')}"] = float(case.get("time", "0"))
        data = CoverageData(no_disk=True)
        for path in COVERED.glob("coverage*"):
            one = CoverageData(str(path))
            one.read()
            data.update(one)
        self._by_line: dict[str, dict[int, set[str]]] = {}
        for file in data.measured_files():
            lines = data.contexts_by_lineno(file)
            self._by_line[os.path.relpath(file, ROOT)] = {
                line: {test_of(context) for context in contexts if context}
                for line, contexts in lines.items()
            }
        self._statements = {name: statements((ROOT / name).read_text("utf-8")) for name in self._by_line}

    def seconds(self, test: str) -> float:
        """Time that a test took, seconds; 0.3, the mean, if it is not known."""
        file, _, name = test.partition("::")
        module = file.removesuffix(".py").replace("/", ".")
        return self._took.get(f"{module}.{name.replace('::', '.')}", 0.3)

    def tests(self, mutant: Mutant) -> list[str]:
        """The tests that run a fault's statement, or any other of its file if that runs at import: those of
        its room first, then the shortest."""
        by_line = self._by_line.get(mutant.path, {})
        lines = self._statements.get(mutant.path, {}).get(mutant.line, range(0))
        found = set().union(*(by_line.get(line, set()) for line in lines))
        found = found or set().union(*by_line.values())
        own = tests_of(room_of(mutant))
        return sorted(found, key=lambda test: (not test.startswith(own), self.seconds(test), test))

    def most(self, tests: list[str], count: int, seconds: float) -> list[str]:
        """The first of some tests, within a count and a time."""
        chosen: list[str] = []
        for test in tests[:count]:
            seconds -= self.seconds(test)
            if seconds < 0 and chosen:
                break
            chosen.append(test)
        return chosen


def room_of(mutant: Mutant) -> str:
    """The one of `ROOMS` with a fault."""
    place = mutant.path.removeprefix("simmer_tui/").removesuffix(".py")
    return next(room for room in ROOMS if f"{place}/".startswith(f"{room}/"))


def tests_of(room: str) -> tuple[str, str]:
    """The folder and the file that the tests of a room may be in: tests mirror the package."""
    folder, _, name = room.rpartition("/")
    return f"tests/{room}/", f"tests/{folder}/test_{name}.py".replace("//", "/")


def mutate(copy: Path, mutant: Mutant) -> str:
    """Put a fault into a copy of the repository; returns the file's text as it was."""
    from cosmic_ray import plugins
    from cosmic_ray.mutating import apply_mutation

    path = copy / mutant.path
    before = path.read_text("utf-8")
    apply_mutation(path, plugins.get_operator(mutant.operator)(), mutant.occurrence)
    return before


class _FirstFailure:
    """A plugin of pytest that keeps the name of the first test that failed."""

    def __init__(self) -> None:
        self.name = ""

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.name:
            self.name = report.nodeid

    pytest_collectreport = pytest_runtest_logreport


def _in_copy(copy: Path, tests: list[str], every: bool, told: Connection) -> None:
    """Run tests in a copy and tell the first that fails ("" if none does), in a process of its own."""
    os.setsid()  # processes that the tests start end with them
    os.chdir(copy)
    sys.path.insert(0, str(copy))
    sys.dont_write_bytecode = True
    os.environ |= {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nowhere, stream)
    import pytest

    first = _FirstFailure()
    ends = [] if every else ["-x"]
    code = pytest.main([*ends, "-n", "0", "-q", "-p", "no:cacheprovider", *tests], plugins=[first])
    told.send(first.name or (_NO_START if code not in (0, 5) else ""))  # 5: no test was collected


def failing(copy: Path, tests: list[str], expected: float, every: bool = False) -> str:
    """The first of some tests that fails in a copy, or "" if none does.

    Their time limit is three times their usual time, and a minute: a fault that makes them hang is found.
    """
    listening, telling = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("forkserver").Process(
        target=_in_copy, args=(copy, tests, every, telling)
    )
    process.start()
    telling.close()
    try:
        return str(listening.recv()) if listening.poll(60.0 + 3.0 * expected) else _NO_END
    except EOFError:  # the fault ended the process of the tests
        return _NO_START
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid or 0, signal.SIGKILL)
        process.join()


def found_by(copy: Path, mutant: Mutant, known: Coverage) -> str:
    """The first test that finds a fault, or "" if none does."""
    path = copy / mutant.path
    times = path.stat()
    before = mutate(copy, mutant)
    try:
        covering = known.tests(mutant)
        first = known.most(covering, *FIRST)
        then = known.most(covering[len(first) :], *MOST)
        room = room_of(mutant)
        own = [place for place in tests_of(room) if (copy / place).exists()]
        # What a shared fixture runs counts for the first of its tests alone: the others look at it too.
        files = {test.partition("::")[0] for test in covering}
        last = sorted(file for file in files if file.startswith(tuple(own))) if covering else own
        for tests in filter(None, (first, then, last)):
            if found := failing(copy, tests, MOST[1] if tests is last else sum(map(known.seconds, tests))):
                return found
        return ""
    finally:
        path.write_text(before, "utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # its compiled form is valid again


def shown(mutant: Mutant) -> str:
    """A fault in a line: its place, the old code and the new code."""
    line = (ROOT / mutant.path).read_text("utf-8").splitlines()[mutant.line - 1].strip()
    return f"{mutant.path}:{mutant.line} {mutant.operator.removeprefix('core/')}: {line[:90]}"


def run(count: int, seed: int, workers: int, only: list[int], rooms: list[str]) -> int:
    """Try faults in some rooms, drawn by a seed, or only some of them by their number; returns the number of
    survivors."""
    known = Coverage()
    drawn = dict(enumerate(draw(count, seed, rooms), start=1))
    tried = {number: drawn[number] for number in only or drawn}
    survivors: list[str] = []
    finders: set[str] = set()
    multiprocessing.get_context("forkserver").set_forkserver_preload(
        ["numpy", "shapely", "msgspec", "pytest", "rich.console"]
    )
    with tempfile.TemporaryDirectory() as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        ignored = shutil.ignore_patterns(".git", ".mutants", ".mypy_cache", ".ruff_cache", ".venv")
        for number in range(workers):
            copy = Path(folder) / str(number)
            shutil.copytree(ROOT, copy, ignore=ignored, symlinks=True)
            compileall.compile_dir(copy / "simmer_tui", quiet=2)
            copies.put(copy)

        def one(mutant: Mutant) -> tuple[str, float]:
            copy, begun = copies.get(), time.monotonic()
            try:
                return found_by(copy, mutant, known), time.monotonic() - begun
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(workers) as pool:
            for (number, mutant), (test, took) in zip(
                tried.items(), pool.map(one, tried.values()), strict=True
            ):
                if test:
                    finders.add(test)
                else:
                    survivors.append(f"{number:4} {shown(mutant)}")
                print(f"{number:4} {shown(mutant)}\n       {test or 'SURVIVED'} ({took:.0f} s)", flush=True)
        named = sorted(finders - {_NO_END, _NO_START})
        print(f"Failing without a fault: {failing(copies.get(), named, MOST[1], every=True) or 'none'}")
    total = len(tried)
    print(f"{total - len(survivors)} of {total} found, {1 - len(survivors) / total:.1%}; seed {seed}")
    print("survived:", *survivors, sep="\n")
    return len(survivors)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("map", "run", "list"))
    parser.add_argument("tests", nargs="*", help="tests to map; without any, all quick ones")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=22)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", type=int, nargs="+", default=[], help="numbers of faults in the draw")
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS), choices=ROOMS, help="draw in these alone")
    options = parser.parse_args()
    if options.what == "map":
        map_tests(options.tests)
    elif options.what == "list":
        drawn = [shown(each) for each in draw(options.count, options.seed, options.rooms)]
        print(json.dumps(drawn, indent=1))
    else:
        left = run(options.count, options.seed, options.workers, options.only, options.rooms)
        sys.exit(left > options.count * 0.08)


if __name__ == "__main__":
    main()
