"""Rates at which reports say rightly why a run failed: kinds of faults by seeds and programs.

    python benchmarks/faults.py [--kinds WORD,...] [--seeds N] [--programs NAME,...] [--jobs N]
                                [--table NAME] [--first-seed N] [--misses] [--keep DIR] [--again]
                                [--minutes M] [--json FILE]

Faults are made by a proxy between program and simulator, by sets that differ from the bundled one, by
people's hands and by programs. `fault_kinds.py` has the kinds and what counts as right for each, written
down before any result was seen; `report --json` is compared with that, key by key. `--table independent` has
the kinds of `fault_independent.py` instead, `--table third` those of `fault_third.py`: one program a seed,
with seeds of their own.

Only failed runs count, with seeds with which the same program succeeds without a fault. They are counted as
right, right in part, wrong (something else was named) and silent (nothing was named). The clean runs are
counted separately: how many have a cause, a finding, or an alarm about a belief.

Logs are kept in --keep, and existing runs are not repeated, unless with --again. So a newer report can read
the same logs. A run takes 1 to 3 s of a processor, a whole table of 10 seeds an hour.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from fault_answers import CRASHED, PROGRAMS, SENSOR, Case, Fault, says
from fault_flights import CLEAN, case_of, flown, log_of, report_of
from fault_independent import INDEPENDENT
from fault_kinds import KINDS, TOLD, right_if_told
from fault_third import THIRD

RIGHT, PARTLY, WRONG, SILENT = "right", "partly", "wrong", "silent"
GRADES = (RIGHT, PARTLY, WRONG, SILENT)
ALL = {**KINDS, **INDEPENDENT, **THIRD}
"""The kinds of all tables. Their names differ, because their logs are in one folder."""
CLEAN_SEEDS = 25
"""Clean runs of each program: 100 with all four, and enough of them succeed for 10 seeds."""


class Task(NamedTuple):
    """One run: its kind of fault, its program and its seed."""

    kind: str
    program: str
    seed: int


@dataclass(frozen=True)
class Outcome:
    """Result of a run and the grade of its report, with `grade` empty where that does not count."""

    kind: str
    program: str
    seed: int
    failed: bool
    struck: bool
    grade: str
    first_grade: str
    """The grade without the answers that were admitted later."""
    said: str
    culprits: tuple[str, ...]
    has_cause: bool
    findings: tuple[str, ...]
    localized: bool
    alarmed: bool
    text: str


# -- one run ----------------------------------------------------------------------------------


def grade(report: Mapping[str, Any], case: Case, *, crash_decides: bool = True) -> str:
    """The grade of a report of a run that failed.

    A fault of sensors, drives or people may make a program crash, which then ends the run. With
    `crash_decides` that cause is right in part; this was added after a table had been seen.
    """
    verdict = report["verdict"]
    cause = verdict["cause"]
    if cause is None:
        return SILENT if verdict["outcome"] in case.outcomes else WRONG
    if verdict["outcome"] not in case.outcomes:
        return WRONG
    first = _grade_cause(cause, report, case)
    # The last lines of a long traceback are without its heading.
    crashed = says(CRASHED, printed=", line ").matches(cause, report)
    if crash_decides and crashed and first != RIGHT:
        # The devices that stand behind a crash are named with it.
        behind = {**cause, "kind": SENSOR} if cause["culprits"] else cause
        return RIGHT if _grade_cause(behind, report, case) == RIGHT else PARTLY
    return first


def _grade_cause(cause: Mapping[str, Any], report: Mapping[str, Any], case: Case) -> str:
    if any(answer.matches(cause, report) for answer in (*case.expected.right, *case.expected.admitted)):
        return RIGHT
    return PARTLY if any(answer.matches(cause, report) for answer in case.expected.partly) else WRONG


def outcome_of(task: Task, keep: Path, *, again: bool = False) -> Outcome:
    """Do a run, unless its files exist, and grade its report."""
    flight = flown(keep, *task, again=again)
    report = report_of(log_of(keep, *task))
    verdict, episodes = report["verdict"], [each["kind"] for each in report["episodes"]]
    failed, graded, first = flight.failed(task.program), "", ""
    if task.kind in TOLD:
        graded = first = RIGHT if right_if_told(task.kind, report) else WRONG
    elif task.kind in ALL and failed and flight.struck:
        case = case_of(task.kind, task.seed)
        graded, first = grade(report, case), grade(report, case.as_first_written, crash_decides=False)
    named = [] if verdict["cause"] is None else [verdict["cause"]]
    return Outcome(
        **task._asdict(),
        failed=failed,
        struck=flight.struck,
        grade=graded,
        first_grade=first,
        said=" + ".join(each["kind"] for each in named),
        culprits=tuple(code for each in named for code in each["culprits"]),
        has_cause=bool(named),
        findings=tuple(f"{each['of']} {each['kind']}" for each in report["findings"]),
        localized="localized" in episodes,
        alarmed="lost" in episodes,
        text=verdict["text"],
    )


# -- all of them ------------------------------------------------------------------------------


class Pilots:
    """Processes that do runs, with a time after which no more are begun."""

    def __init__(self, keep: Path, jobs: int, *, again: bool, until: float) -> None:
        self._keep, self._again, self._until = keep, again, until
        self._pool = ProcessPoolExecutor(jobs, initializer=_silence)

    def outcomes(self, tasks: Iterable[Task], known: bool = False) -> Iterator[Outcome]:
        """Results of the tasks, without those that cannot be run; `known` ones are never repeated."""
        flights = [
            self._pool.submit(self._fly, self._keep, self._again and not known, self._until, task)
            for task in tasks
        ]
        for done, flight in enumerate(flights, 1):
            outcome = flight.result()
            print(f"\r{done} of {len(flights)} runs", end="", file=sys.stderr, flush=True)
            if isinstance(outcome, str):
                print(f"\n{outcome}", file=sys.stderr)
            elif outcome is not None:
                yield outcome
        print(file=sys.stderr)

    def close(self) -> None:
        """End the processes."""
        self._pool.shutdown()

    @staticmethod
    def _fly(keep: Path, again: bool, until: float, task: Task) -> Outcome | str | None:
        is_late = time.time() > until
        if is_late and (again or not log_of(keep, *task).exists()):
            return None
        try:
            return outcome_of(task, keep, again=again)
        except Exception as error:  # noqa: BLE001 - one run that cannot be flown or read must not end an hour's table
            return f"{' '.join(map(str, task))}: {type(error).__name__}: {error}"


def _silence() -> None:
    """Discard the output of this process and of its programs."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)


@dataclass(frozen=True)
class Table:
    """Kinds of faults of one table.

    Args:
        kinds: The kinds that are graded.
        told: The faults of runs that succeed.
        first_seed: The first of the clean runs' seeds.
        rotates: True for one program a seed, in turn; else all programs.
    """

    kinds: Mapping[str, Fault]
    told: Mapping[str, Fault]
    first_seed: int = 1
    rotates: bool = False


TABLES = {
    "first": Table(KINDS, TOLD),
    # Other seeds than the first table's: the diagnosis may be fitted to those.
    "independent": Table(INDEPENDENT, {}, first_seed=101, rotates=True),
    "third": Table(THIRD, {}, first_seed=201, rotates=True),
}


def rotating_tasks_of(kinds: Sequence[str], seeds: Mapping[str, Sequence[int]], count: int) -> list[Task]:
    """`count` runs of each kind, each with the next of its programs."""
    tasks = []
    for number in range(count):
        for offset, kind in enumerate(kinds):
            programs = [each for each in ALL[kind].programs if seeds.get(each)]
            if programs:
                program = programs[(number + offset) % len(programs)]
                usable = seeds[program]
                tasks.append(Task(kind, program, usable[number % len(usable)]))
    return list(dict.fromkeys(tasks))


def tasks_of(kinds: Iterable[str], seeds: Mapping[str, Sequence[int]], count: int) -> list[Task]:
    """All runs of a table, seed by seed, so that an interrupted table has all kinds."""
    known = {**KINDS, **TOLD}
    return [
        Task(kind, program, usable[number])
        for number in range(count)
        for kind in kinds
        for program, usable in seeds.items()
        if program in known[kind].programs and number < len(usable)
    ]


# -- what is printed ---------------------------------------------------------------------------


def tables(outcomes: Sequence[Outcome]) -> str:
    """The tables of kinds, of programs, of successful runs with a fault, and of the clean runs."""
    graded = [each for each in outcomes if each.kind in ALL]
    kinds = [kind for kind in ALL if any(each.kind == kind for each in graded)]
    lines = ["", _row("kind", "runs", "failed", *GRADES, "% right")]
    lines += [_counts(kind, [each for each in graded if each.kind == kind]) for kind in kinds]
    lines += [_counts("all", graded)]
    as_written = [replace(each, grade=each.first_grade) for each in graded]
    lines += [_counts("all, as first written", as_written), ""]
    lines += [
        _counts(f"all of {program}", [each for each in graded if each.program == program])
        for program in PROGRAMS
    ]
    groups = dict.fromkeys(each.kind.partition(":")[0] for each in graded)
    lines += [
        _counts(f"all of {group}", [each for each in graded if each.kind.startswith(f"{group}:")])
        for group in groups
    ]
    new = [each for each in graded if not ALL[each.kind].known]
    lines += [_counts(f"{len({each.kind for each in new})} kinds new here", new), ""]
    for kind in TOLD:
        told = Counter(each.grade for each in outcomes if each.kind == kind)
        if told:
            lines.append(f"{kind}: right in {told[RIGHT]} of {sum(told.values())} runs")
    return "\n".join([*lines, *_clean([each for each in outcomes if each.kind == CLEAN])])


def _counts(name: str, outcomes: Sequence[Outcome]) -> str:
    counted = [each for each in outcomes if each.grade]
    grades = Counter(each.grade for each in counted)
    share = f"{100 * grades[RIGHT] / len(counted):.0f}" if counted else "-"
    return _row(name, len(outcomes), len(counted), *(grades[each] for each in GRADES), share)


def misses(outcomes: Sequence[Outcome], keep: Path) -> str:
    """A line for each report that is wrong or silent: its log, its answer and the truth."""
    return "\n".join(
        f"{log_of(keep, each.kind, each.program, each.seed)} {each.grade}\n"
        f"    said: {each.said or 'nothing'} [{' '.join(each.culprits)}]: {each.text}\n"
        f"    true: {' '.join((ALL[each.kind].draw.__doc__ or '').split())}"
        for each in outcomes
        if each.kind in ALL and each.grade in (WRONG, SILENT)
    )


def _row(name: str, *cells: object) -> str:
    widths = (6, 7, 6, 7, 6, 7, 8)
    return f"{name:30}" + "".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))


def _clean(outcomes: Sequence[Outcome]) -> list[str]:
    if not outcomes:
        return []
    good = [each for each in outcomes if not each.failed]
    localized = [each for each in good if each.localized]
    # Step 6 has taken the block, and ends before the mission is done: that is a cause, and a right one.
    done = [each for each in good if each.said != "program ended"]
    with_cause, findings = sum(each.has_cause for each in done), sum(bool(each.findings) for each in good)
    alarms = sum(each.alarmed for each in localized)
    return [
        f"clean: {len(good)} of {len(outcomes)} succeed; {with_cause} have a cause, {findings} a finding",
        f"clean and localized: {alarms} of {len(localized)} have a belief alarm",
    ]


# -- the command ------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly what is asked for, and print the tables."""
    options = _options(arguments)
    words = [word for word in options.kinds.split(",") if word]
    table = TABLES[options.table]
    kinds = [kind for kind in (*table.kinds, *table.told) if not words or any(word in kind for word in words)]
    programs = [program for program in PROGRAMS if program in options.programs.split(",")]
    until = time.time() + 60.0 * options.minutes
    pilots = Pilots(options.keep, options.jobs, again=options.again, until=until)
    try:
        first = table.first_seed if options.first_seed is None else options.first_seed
        clean = [
            Task(CLEAN, program, seed) for seed in range(first, first + options.clean) for program in programs
        ]
        outcomes = list(pilots.outcomes(clean, known=bool(words)))
        seeds = {
            program: sorted(each.seed for each in outcomes if each.program == program and not each.failed)
            for program in programs
        }
        arranged = rotating_tasks_of if table.rotates else tasks_of
        outcomes += pilots.outcomes(arranged(kinds, seeds, options.seeds))
    finally:
        pilots.close()
    print(tables(outcomes))
    if options.misses:
        print("\n" + misses(outcomes, options.keep))
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(each) for each in outcomes], indent=1))
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="How often a report says rightly why a run failed.")
    parser.add_argument("--table", choices=TABLES, default="first", help="which kinds of faults")
    parser.add_argument("--misses", action="store_true", help="print each report that was wrong or silent")
    parser.add_argument("--kinds", default="", metavar="WORD,...", help="only kinds with one of these words")
    parser.add_argument("--seeds", type=int, default=10, metavar="N", help="runs of a kind and program")
    parser.add_argument("--clean", type=int, default=CLEAN_SEEDS, metavar="N", help="clean runs of a program")
    parser.add_argument("--first-seed", type=int, metavar="N", help="first seed of the clean runs")
    parser.add_argument("--programs", default=",".join(PROGRAMS), metavar="NAME,...")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="runs at a time")
    parser.add_argument("--keep", type=Path, default=Path("faults"), metavar="DIR", help="folder of the logs")
    parser.add_argument("--again", action="store_true", help="fly also the runs that are there")
    parser.add_argument("--minutes", type=float, default=1e6, metavar="M", help="no run is begun afterwards")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write a record of each run")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
