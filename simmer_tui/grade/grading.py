"""The order of the runs of a grading, and their execution, here or on a Dask cluster.

Each team's files are sent to each worker of a cluster once, and run in a sandbox there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui.errors import GradeError
from simmer_tui.grade import bubblewrap, container
from simmer_tui.grade.course import LONG, Course, absent, shown_name
from simmer_tui.grade.grade_folder import Entry, GradeFolder
from simmer_tui.grade.grade_run import GradeRun, GradeTrial
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.sim.command import first_of
from simmer_tui.trials.cluster import Files, PackedFile, itself, results_of, run_in_folders, unpack_files
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.trial import Ending, TrialResult

if TYPE_CHECKING:
    from distributed import Client, Future

# One fault may be the machine's (no memory, a killed worker); three in a row are the program's.
_TRIES = 3
"""Attempts at a run in which the simulator, not the program, fails."""

_MOST_NAMED = 5
"""Teams that are named in a message."""
RunSource = Callable[[Iterable[GradeTrial]], Generator[TrialResult, None, None]]
"""A function that does runs, and gives the result of each as soon as it is there."""


@dataclass
class Grading:
    """Open runs of a grading. Teams take turns, so that all have a first result soon. A team gets a second
    run under way only if no other team needs one."""

    folder: GradeFolder
    _under_way: dict[int, Entry] = field(default_factory=dict)
    _faults: Counter[int] = field(default_factory=Counter)

    def trials(self) -> Iterator[GradeTrial]:
        """The runs to do; each is chosen when it can begin."""
        return iter(self._next, None)

    def take(self, result: TrialResult) -> None:
        """Keep a result. A fault of the simulator itself is not the team's, unless it is repeated `_TRIES`
        times. Raises GradeError."""
        self._under_way.pop(result.number, None)
        if result.ending is Ending.FAULT:
            self._faults[result.number] += 1
            if self._faults[result.number] < _TRIES:
                return
        self.folder.append(result)

    def _next(self) -> GradeTrial | None:
        waiting = Counter(id(entry) for entry in self._under_way.values())
        candidates = []
        for entry in self.folder.entries:
            if self.folder.is_open(entry):
                done = len(entry.results) + waiting[id(entry)]
                if done < self.folder.test.cap:
                    candidates.append((waiting[id(entry)], done, entry))
        if not candidates:
            return None
        entry = min(candidates, key=lambda each: each[:2])[2]
        for number in count(1):
            trial = self.folder.trial(entry, number)
            if number not in entry.results and trial.number not in self._under_way:
                self._under_way[trial.number] = entry
                return trial
        raise AssertionError("numbers do not end")


def grade(folder: GradeFolder, source: RunSource, on_result: Callable[[TrialResult], None]) -> None:
    """Do the remaining runs of a grading. Raises GradeError, TrialsError."""
    grading = Grading(folder)
    while True:
        results = source(grading.trials())
        try:
            for result in results:
                grading.take(result)
                on_result(result)
        finally:
            results.close()
        if not any(folder.is_open(entry) for entry in folder.entries):
            return


def here(folder: GradeFolder, jobs: int) -> RunSource:
    """Runs on this machine, `jobs` at a time."""
    return lambda trials: run_locally(trials, folder.runs, jobs, GradeRun)


def check_isolation(isolation: Isolation, path: Path, course: Course) -> None:
    """Check a grading in the folder `path`. Raises GradeError if programs cannot be sandboxed as asked."""
    missing = what_is_missing(isolation, course.image)
    if missing:
        raise GradeError(
            f"programs cannot be sandboxed: {missing}. Without it, a program can read this grading's seed, "
            "logs and results; --isolation none grades without it"
        )
    seen = bubblewrap.seen_folders(course.read_only)
    inside = [place for place in seen if path.resolve().is_relative_to(place.resolve())]
    if isolation is Isolation.BWRAP and inside:
        raise GradeError(f"the grading would lie in {inside[0]}, which programs can read: name another --out")


def what_is_missing(isolation: Isolation, image: str = "") -> str:
    """Missing piece without which programs cannot be sandboxed, in a container of an image, or an empty
    string."""
    match isolation:
        case Isolation.NONE:
            return ""
        case Isolation.BWRAP:
            return bubblewrap.what_is_missing()
        case engine:
            return container.what_is_missing(engine.value, image)


def missing_there(isolation: Isolation, image: str, read_only: Sequence[str]) -> str:
    """The same on a worker of a cluster, which also needs the folders of `read_only`."""
    for each in absent(read_only) if isolation is not Isolation.NONE else ():
        return f"{shown_name(each, LONG)} does not exist (read_only)"
    return what_is_missing(isolation, image)


def on_cluster(folder: GradeFolder, client: Client) -> RunSource:
    """Runs on the workers of a cluster. Raises GradeError if one of them cannot sandbox programs, or a team
    has boards."""
    boards = [shown_name(each.team.name) for each in folder.entries if each.check.sketches is not None]
    if boards:
        names = first_of(boards, _MOST_NAMED)
        raise GradeError(f"boards run on this machine alone ({names}): resume without --dask")
    course = folder.course
    answers = client.run(missing_there, folder.plan.isolation, course.image, course.read_only)
    missing = {where: why for where, why in answers.items() if why}
    if missing:
        where, why = next(iter(missing.items()))
        raise GradeError(f"programs cannot be sandboxed on the worker {where}: {why}")

    def source(trials: Iterable[GradeTrial]) -> Generator[TrialResult, None, None]:
        packed: dict[str, Future] = {}

        def submit(trial: GradeTrial) -> Future:
            if trial.slug not in packed:
                (folder.runs / trial.slug).mkdir(exist_ok=True)
                packed[trial.slug] = client.submit(itself, _packed(trial.files), pure=False)
            return client.submit(grade_there, trial, packed[trial.slug], pure=False)

        return results_of(trials, submit, folder.runs, client)

    return source


def _packed(folder: Path) -> dict[str, PackedFile]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): PackedFile(path.read_bytes(), bool(path.stat().st_mode & 0o100))
        for path in paths
    }


def grade_there(trial: GradeTrial, submission: dict[str, PackedFile]) -> tuple[TrialResult, Files]:
    """A run, and the files it leaves; on the cluster. Raises TrialsError if it cannot be done."""

    def make(runs: Path, files: Path) -> GradeRun:
        # The user of a sandbox, an ID that nobody has, must be able to reach the files; others need not.
        runs.parent.chmod(0o755 if trial.isolation is not Isolation.NONE else 0o700)
        unpack_files(submission, files)
        return GradeRun(replace(trial, files=files), runs)

    return run_in_folders(make)
