"""Which runs are to be done, and doing them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import count

from simmer_tui.errors import GradeError
from simmer_tui.grade import bubblewrap, container
from simmer_tui.grade.grade_folder import Entry, GradeFolder
from simmer_tui.grade.grade_run import GradeRun, GradeTrial
from simmer_tui.grade.limits import Isolation
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.record import Ending, TrialResult

# Once may be the machine's fault (no memory, a killed worker); three times in a row it is the program's
# doing.
_TRIES = 3
"""Attempts at a run that the simulator, not the program, does not survive."""

RunSource = Callable[[Iterable[GradeTrial]], Generator[TrialResult, None, None]]
"""Does runs, and gives the result of each when it is there."""


@dataclass
class Grading:
    """Open runs of a grading. Teams take turns, so that all have a first result soon; one whose
    turn it is gets a second run under way only if no other team needs one."""

    folder: GradeFolder
    _under_way: dict[int, Entry] = field(default_factory=dict)
    _faults: Counter[int] = field(default_factory=Counter)

    def trials(self) -> Iterator[GradeTrial]:
        """The runs to do, each decided on when it can begin."""
        while (trial := self._next()) is not None:
            yield trial

    def take(self, result: TrialResult) -> None:
        """Keep a result. A fault of the simulator itself is not the team's, unless it comes again and again.
        Raises GradeError."""
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
    """Do what is left of a grading. Raises GradeError, TrialsError."""
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
    """Runs on this machine, so many at a time."""
    return lambda trials: run_locally(trials, folder.runs, jobs, GradeRun)


def check_isolation(folder: GradeFolder) -> None:
    """Raises GradeError if programs cannot be sandboxed as asked."""
    missing = what_is_missing(folder.isolation)
    if missing:
        raise GradeError(
            f"programs cannot be sandboxed: {missing}. Without it, a program can read this grading's seed, "
            "logs and results; --isolation none grades all the same"
        )
    seen = bubblewrap.seen_folders(folder.course.read_only)
    inside = [place for place in seen if folder.path.resolve().is_relative_to(place.resolve())]
    if folder.isolation is Isolation.BWRAP and inside:
        raise GradeError(
            f"programs can read {inside[0]}, and the grading would lie in it: name another --out"
        )


def what_is_missing(isolation: Isolation) -> str:
    """Missing piece without which programs cannot be sandboxed, or an empty string."""
    match isolation:
        case Isolation.NONE:
            return ""
        case Isolation.BWRAP:
            return bubblewrap.what_is_missing()
        case engine:
            return container.what_is_missing(engine.value)
