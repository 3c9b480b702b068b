"""Mutation test: small faults drawn by a seed, and whether the quick tests find them.

    python benchmarks/mutants.py map                    # which test runs which line, by coverage: once
    python benchmarks/mutants.py run --count 200        # survivors are listed at the end

Faults are those of cosmic-ray: an operator, comparison, number, constant or loop is changed. One is drawn for
each place, all places with the same chance, from the rooms that decide numbers (`ROOMS`). Annotations,
decorators and the options of classes (`frozen=True`) are left out, since they change nothing that runs, and
so is what is no Python any more.

Each fault stands alone in a copy of the repository. The quick tests that run its line are run, the shortest
first, until one fails; if none does, the tests of the room are run, since a test may reach the line in a
process of its own. A fault that no test finds survives.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("sim", "engine", "protocol", "runlog", "trials", "grade", "calibrate")
COVERED = ROOT / ".mutants"
"""What `map` keeps: coverage by test, and what each test takes."""
MOST_TESTS = 400
"""Tests run for one fault at most: a line that more tests run is found by one of these, or by none."""
LONGEST = 300
"""Seconds after which tests of a fault are ended; it is found then, since it made them hang."""
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
    """Beginning and end (line, column) of what changes nothing that runs: annotations, decorators and the
    options of classes."""
    found: list[ast.expr] = []
    for node in ast.walk(ast.parse(source)):
        noted = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        if isinstance(node, ast.ClassDef):
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


def draw(count: int, seed: int) -> list[Mutant]:
    """Faults drawn by a seed: places with the same chance, and one fault at each that is still Python."""
    from cosmic_ray import plugins
    from cosmic_ray.mutating import mutate_code

    generator = random.Random(seed)
    places = mutants()
    generator.shuffle(places)
    drawn: list[Mutant] = []
    for found in places:
        if len(drawn) == count:
            break
        mutant = generator.choice(found)
        source = (ROOT / mutant.path).read_text("utf-8")
        changed = mutate_code(source, plugins.get_operator(mutant.operator)(), mutant.occurrence)
        try:
            compile(changed or "", mutant.path, "exec")
        except SyntaxError:
            continue
        drawn.append(mutant)
    return drawn


def map_tests() -> None:
    """Run the quick tests once with coverage, and keep which test ran which line."""
    COVERED.mkdir(exist_ok=True)
    command = [
        *(
            sys.executable,
            "-m",
            "pytest",
            "-n",
            "2",
            "--cov=simmer_tui",
            "--cov-context=test",
            "--cov-report=",
        ),
        f"--junit-xml={COVERED / 'durations.xml'}",
    ]
    subprocess.run(
        command, cwd=ROOT, check=False, env={**os.environ, "COVERAGE_FILE": str(COVERED / "coverage")}
    )


def tests_by_line() -> dict[tuple[str, int], list[str]]:
    """The tests that run a line of a file, the shortest first."""
    from xml.etree import ElementTree

    from coverage import CoverageData

    took: dict[str, float] = {}
    for case in ElementTree.parse(COVERED / "durations.xml").iter("testcase"):
        took[f"{case.get('classname')}.{case.get('name')}"] = float(case.get("time", "0"))

    def seconds(test: str) -> float:
        file, _, name = test.partition("::")
        return took.get(f"{file.removesuffix('.py').replace('/', '.')}.{name.replace('::', '.')}", 1.0)

    data = CoverageData(str(COVERED / "coverage"))
    data.read()
    found: dict[tuple[str, int], list[str]] = {}
    for file in data.measured_files():
        shown = os.path.relpath(file, ROOT)
        for line, contexts in data.contexts_by_lineno(file).items():
            tests = {context.partition("|")[0] for context in contexts if context}
            found[shown, line] = sorted(tests, key=lambda test: (seconds(test), test))
    return found


def mutate(copy: Path, mutant: Mutant) -> str:
    """Put a fault into a copy of the repository; returns the file's text as it was."""
    from cosmic_ray import plugins
    from cosmic_ray.mutating import apply_mutation

    path = copy / mutant.path
    before = path.read_text("utf-8")
    apply_mutation(path, plugins.get_operator(mutant.operator)(), mutant.occurrence)
    return before


def fails(copy: Path, tests: list[str]) -> bool:
    """True if one of some tests fails, or hangs, in a copy."""
    command = [sys.executable, "-m", "pytest", "-x", "-n", "0", "-q", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, timeout=LONGEST, check=False
        )
    except subprocess.TimeoutExpired:
        return True
    return done.returncode not in (0, 5)  # 5: no test was collected


def is_found(copy: Path, mutant: Mutant, known: dict[tuple[str, int], list[str]]) -> bool:
    """True if the quick tests find a fault."""
    before = mutate(copy, mutant)
    try:
        covering = known.get((mutant.path, mutant.line), [])[:MOST_TESTS]
        if covering and fails(copy, covering):
            return True
        room = mutant.path.split("/")[1].removesuffix(".py")
        beside = [place for place in (f"tests/{room}", f"tests/test_{room}.py") if (copy / place).exists()]
        return bool(beside) and fails(copy, beside)
    finally:
        (copy / mutant.path).write_text(before, "utf-8")


def shown(mutant: Mutant) -> str:
    """A fault in a line: where it is, what stood there and what stands there instead."""
    line = (ROOT / mutant.path).read_text("utf-8").splitlines()[mutant.line - 1].strip()
    return f"{mutant.path}:{mutant.line} {mutant.operator.removeprefix('core/')}: {line[:90]}"


def run(count: int, seed: int, workers: int) -> int:
    """Try faults drawn by a seed; returns the number of survivors."""
    known = tests_by_line()
    drawn = draw(count, seed)
    survivors: list[Mutant] = []
    with tempfile.TemporaryDirectory() as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(workers):
            copy = Path(folder) / str(number)
            ignored = shutil.ignore_patterns(".git", ".mutants", "*_cache", "__pycache__", ".venv")
            shutil.copytree(ROOT, copy, ignore=ignored, symlinks=True)
            copies.put(copy)

        def one(mutant: Mutant) -> bool:
            copy = copies.get()
            try:
                return is_found(copy, mutant, known)
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(workers) as pool:
            for number, (mutant, found) in enumerate(zip(drawn, pool.map(one, drawn), strict=True), start=1):
                if not found:
                    survivors.append(mutant)
                print(f"{number:4} {'found   ' if found else 'SURVIVED'} {shown(mutant)}", flush=True)
    print(f"{count - len(survivors)} of {count} found, {1 - len(survivors) / count:.1%}; seed {seed}")
    for mutant in survivors:
        print(f"  survived: {shown(mutant)}")
    return len(survivors)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("map", "run", "list"))
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=22)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.what == "map":
        map_tests()
    elif options.what == "list":
        print(json.dumps([shown(each) for each in draw(options.count, options.seed)], indent=1))
    else:
        sys.exit(run(options.count, options.seed, options.workers) > options.count * 0.08)


if __name__ == "__main__":
    main()
