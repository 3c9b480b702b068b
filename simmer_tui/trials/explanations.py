"""Explanations of failed runs: each runs again, with one change at a time; what made it succeed is named.

Results are lines of `why/results.jsonl` in the folder of the trials, so that they can be gone on with. Logs
of changed runs are not kept: a set's files do not hold such changes.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec import Struct

from simmer_tui.config.nominal import nominal_of
from simmer_tui.document.formats import COUNT, Format
from simmer_tui.document.model import DataColumn, DataTable
from simmer_tui.errors import ConfigurationError, RunLogError, TrialsError
from simmer_tui.report.causes import Kind, Sureness
from simmer_tui.report.run_statistics import report_of
from simmer_tui.runlog.reader import LogReader
from simmer_tui.trials.failures import failures_in_turn
from simmer_tui.trials.folder import WHY, TrialFolder, TrialPlan
from simmer_tui.trials.interventions import UNCHANGED, ChangedPart, Intervention, interventions
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.store import RunStore, StoreKind
from simmer_tui.trials.trial import Ending, Trial, TrialResult

EXPLAINED = 3
"""Failed runs that are run again, unless another number is asked for: each takes some ten runs."""


class ChangedRun(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The result of a run with one change. `succeeded` is None if the simulator failed. `part` says what
    was changed, `codes` which sensors were. `text` is its verdict."""

    run: int
    change: str
    part: ChangedPart
    codes: tuple[str, ...]
    succeeded: bool | None
    text: str


_KIND = StoreKind(
    noun="changed runs",
    plan_file="",  # the plan is that of the trials
    folders=(),
    format=1,
    plan=TrialPlan,
    line=ChangedRun,
    error=TrialsError,
)


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why a run failed, by what made it succeed. `confirmed` is True or False where its verdict was only
    likely and the changes speak for or against it, else None."""

    run: int
    text: str
    suspected: str
    confirmed: bool | None


class Explanations:
    """The changed runs of a set of trials."""

    def __init__(self, folder: TrialFolder) -> None:
        """Read those that are done. Raises TrialsError."""
        self._folder = folder
        self._store = RunStore(folder.path / WHY, _KIND)
        self.done: dict[tuple[int, str], ChangedRun] = {}
        """By run and change."""
        for _, each in self._store.lines():
            self.done.setdefault((each.run, each.change), each)

    def explain(self, most: int, jobs: int) -> Generator[ChangedRun, None, None]:
        """Run up to `most` failed runs again, without and then with changes, and keep what comes of it.

        Changes come only to those that fail again without one. Raises TrialsError, ConfigurationError.
        """
        with contextlib.suppress(FileExistsError):
            self._store.path.mkdir()
        with self._store.locked():
            self._store.recover()
            numbers = failures_in_turn(self._folder.done)[:most]
            planned = {number: self._interventions(number) for number in numbers}
            yield from self._run([(number, planned[number][0]) for number in numbers], jobs)
            failing = [number for number in numbers if self.done[number, UNCHANGED].succeeded is False]
            yield from self._run([(number, each) for number in failing for each in planned[number][1:]], jobs)

    def explanations(self) -> list[Explanation]:
        """Explanations of all runs that ran again, by number."""
        runs: dict[int, list[ChangedRun]] = {}
        for each in self.done.values():
            runs.setdefault(each.run, []).append(each)
        results = self._folder.results
        return [explained(results[number], runs[number]) for number in sorted(runs) if number in results]

    def _interventions(self, number: int) -> list[Intervention]:
        trial = self._folder.trial(number)
        cause = self._folder.results[number].verdict.get("cause") or {}
        return interventions(
            trial.configuration,
            nominal_of(trial.configuration),
            read=_sensors_read(self._folder.log(number)),
            suspects=cause.get("culprits", ()),
        )

    def _run(self, asked: Sequence[tuple[int, Intervention]], jobs: int) -> Iterator[ChangedRun]:
        missing = [(number, each) for number, each in asked if (number, each.change) not in self.done]
        if not missing:
            return
        # The number of a trial names its files, and must differ; programs see `repetition`.
        trials = [
            replace(_trial(self._folder, number), number=place, configuration=each.configuration)
            for place, (number, each) in enumerate(missing, 1)
        ]
        with (
            tempfile.TemporaryDirectory() as logs,
            contextlib.closing(run_locally(trials, Path(logs), min(jobs, len(trials)))) as results,
        ):
            for result in results:
                number, each = missing[result.number - 1]
                failed_itself = result.ending is Ending.FAULT
                done = ChangedRun(
                    run=number,
                    change=each.change,
                    part=each.part,
                    codes=each.codes,
                    succeeded=None if failed_itself else result.success,
                    text=str(result.verdict.get("text") or result.reason),
                )
                self._store.append(done)
                self.done[number, each.change] = done
                yield done


def _trial(folder: TrialFolder, number: int) -> Trial:
    trial = folder.trial(number)
    return replace(trial, repetition=trial.repetition or number)


def _sensors_read(log: Path) -> set[str] | None:
    """IDs of the sensors that a run read; None if its log is not there or cannot be read."""
    if not log.exists():
        return None
    try:
        with LogReader(log) as reader:
            return set(report_of(reader).history.totals.sensors)
    except (RunLogError, ConfigurationError):
        return None


# -- what the changes say --------------------------------------------------------------------------

_SENSORS = frozenset((ChangedPart.SENSOR, ChangedPart.SENSORS))
_DRIVES = frozenset((ChangedPart.NOISE, ChangedPart.BIAS, ChangedPart.DRIVES))
_BY_KIND: Mapping[Kind, frozenset[ChangedPart]] = {
    Kind.SENSOR_WRONG: _SENSORS,
    Kind.MISREAD: _SENSORS,
    Kind.DRIVE_WRONG: _DRIVES,
    Kind.DRIVE_ERROR: _DRIVES,
    Kind.TOO_SLOW: frozenset((ChangedPart.TIME,)),
}
"""Changes that would save a run which failed by such a cause. Other causes are decisions of the program."""
_LIKELY = {
    ChangedPart.SENSOR: "the sensor",
    ChangedPart.SENSORS: "the sensors together",
    ChangedPart.NOISE: "the noise of the drives",
    ChangedPart.BIAS: "the bias of the drives",
    ChangedPart.DRIVES: "noise and bias of the drives together",
    ChangedPart.TIME: "the time of readings and link",
}


def explained(result: TrialResult, changed: Sequence[ChangedRun]) -> Explanation:
    """Explanation of a failed run by its changed runs."""
    cause = result.verdict.get("cause") or {}
    likely = cause.get("sure") == Sureness.LIKELY.value
    repeats = not any(each.succeeded for each in changed if each.part is ChangedPart.NOTHING)
    tried = [each for each in changed if each.part is not ChangedPart.NOTHING and each.succeeded is not None]
    saved = _simplest([each for each in tried if each.succeeded])
    text = f"Run {result.number} succeeds when it runs again unchanged: the program does not repeat."
    if repeats:
        text = f"Run {result.number} {_told(len(tried), saved)}"
    suspected = str(cause.get("kind", "")) if likely else ""
    confirmed = _confirmed(cause, tried, saved) if likely and repeats else None
    return Explanation(result.number, text, suspected, confirmed)


def _told(tried: int, saved: Sequence[ChangedRun]) -> str:
    """The rest of the sentence about a run that fails again without a change."""
    if not tried:
        return "has not been run with changes yet."
    if not saved:
        return f"fails with each of {tried} changes; the likely cause is the program itself."
    *others, last = (each.change for each in saved)
    if others:
        return f"succeeds with {', '.join(others)} or {last}; these cannot be told apart."
    return f"succeeds with {last}; the likely cause is {_LIKELY[saved[0].part]}."


def _simplest(saved: Sequence[ChangedRun]) -> list[ChangedRun]:
    """The changes that saved a run, without those that only hold another of them."""
    parts = {each.part for each in saved}
    alone = {code for each in saved if each.part is ChangedPart.SENSOR for code in each.codes}
    kept: list[ChangedRun] = []
    for each in saved:
        if each.part is ChangedPart.SENSORS:
            within = any(set(other.codes) < set(each.codes) for other in saved)
            if within or not alone.isdisjoint(each.codes):
                continue
        if each.part is ChangedPart.DRIVES and parts & {ChangedPart.NOISE, ChangedPart.BIAS}:
            continue
        kept.append(each)
    return kept


def _confirmed(
    cause: Mapping[str, object], tried: Sequence[ChangedRun], saved: Sequence[ChangedRun]
) -> bool | None:
    """True if only changes of the suspected parts saved the run, False if none of them did; None if that
    cannot be told."""
    parts = next((parts for kind, parts in _BY_KIND.items() if kind.value == cause.get("kind")), None)
    if parts is None:
        return None
    culprits = cause.get("culprits")
    named = set(culprits) if isinstance(culprits, Sequence) else set()

    def is_suspected(each: ChangedRun) -> bool:
        if each.part not in parts:
            return False
        return each.part not in _SENSORS or not named or set(each.codes) <= named

    if not any(map(is_suspected, tried)):
        return None
    if not any(map(is_suspected, saved)):
        return False
    return True if all(map(is_suspected, saved)) else None


# -- tables ----------------------------------------------------------------------------------------

_YES_NO = Format(lambda value: "yes" if value else "no")
WHY_FAILED = DataTable(
    "why",
    "Failed runs, run again with one change at a time",
    (
        DataColumn("run", COUNT),
        DataColumn("text", heading="what made it succeed", wraps=True),
        DataColumn("suspected", heading="likely cause"),
        DataColumn("confirmed", _YES_NO),
    ),
)
CHANGED_RUNS = DataTable(
    "interventions",
    "Changed runs",
    (
        DataColumn("run", COUNT),
        DataColumn("change", wraps=True),
        DataColumn("succeeded", _YES_NO),
        DataColumn("text", heading="what happened", wraps=True),
    ),
    hidden=True,
)


def explanation_tables(folder: TrialFolder) -> list[DataTable]:
    """Tables of explanations and of changed runs; without rows if there are none. Raises TrialsError."""
    found = Explanations(folder)
    told = [(each.run, each.text, each.suspected or None, each.confirmed) for each in found.explanations()]
    changed = [(each.run, each.change, each.succeeded, each.text) for each in found.done.values()]
    changed.sort(key=lambda row: row[0])
    return [WHY_FAILED.filled(told), CHANGED_RUNS.filled(changed)]
