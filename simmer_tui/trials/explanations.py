"""Explanations of failed runs: each runs again, with one change at a time; changes that make it succeed are
named.

Those changes are then repeated with other errors, beside the unchanged run: `chance_control.py`.
Results are lines of `why/results.jsonl` in the folder of the trials, so that they can be continued. Logs of
changed runs are not kept: a set's files cannot express such changes.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Protocol

from msgspec import Struct

from simmer_tui.config.nominal import nominal_of
from simmer_tui.document.formats import COUNT, Format
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.errors import TrialsError
from simmer_tui.report.causes import LIKELY, Kind
from simmer_tui.run.phrases import capitalized
from simmer_tui.sim.rules import listed
from simmer_tui.trials.chance_control import REPEATS, ChanceControl, control_of, control_table
from simmer_tui.trials.failures import failures_in_turn, grouped
from simmer_tui.trials.figures import logged_run
from simmer_tui.trials.folder import WHY, TrialFolder
from simmer_tui.trials.interventions import UNCHANGED, ChangedPart, Intervention, interventions
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.run import TrialRun
from simmer_tui.trials.store import ResultLines
from simmer_tui.trials.trial import Ending, Trial, TrialResult, run_seed

EXPLAINED = 3
"""Failed runs that are run again, unless another number is asked for: each takes some ten runs, and twenty or
more to control for chance."""


class ChangedRun(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The result of a run with one change. `succeeded` is None if the simulator failed. `part` is the changed
    part, `codes` are the changed sensors. `text` is its verdict. `repeat` is 0 with its own errors, else the
    number of the other errors. `commands` is the number of commands that came, None in older files."""

    run: int
    change: str
    part: ChangedPart
    codes: tuple[str, ...]
    succeeded: bool | None
    text: str
    repeat: int = 0
    commands: int | None = None


@dataclass(frozen=True, slots=True)
class Explanation:
    """The explanation of a failed run by the changes that make it succeed. `confirmed` is True or False where
    its verdict was only likely and the changes confirm or contradict it, else None. `controls` are those of
    these changes, and `sure` are the changes that save it surely not by chance."""

    run: int
    text: str
    suspected: str
    confirmed: bool | None
    controls: tuple[ChanceControl, ...] = ()
    sure: tuple[str, ...] = ()


_Asked = tuple[int, Intervention, int]
"""A run by its number, its change, and the number of its errors: 0 for its own."""


class ExplainedRuns(Protocol):
    """Runs that can be done again, each by a number."""

    @property
    def path(self) -> Path:
        """Folder of the results of changed runs."""

    @property
    def start(self) -> Path | None:
        """Folder in which the program is started; None for the working directory."""

    @property
    def results(self) -> Mapping[int, TrialResult]:
        """Results, by number."""

    def trial(self, number: int) -> Trial:
        """The plan of a run."""

    def read(self, number: int) -> Collection[str] | None:
        """IDs of the sensors that the program read in a run; None if they are not known."""


class FolderRuns:
    """The runs of a set of trials."""

    def __init__(self, folder: TrialFolder) -> None:
        self._folder = folder
        self.path = folder.path
        self.start: Path | None = None
        self.results: Mapping[int, TrialResult] = folder.results
        self.trial = folder.trial

    def read(self, number: int) -> Collection[str] | None:
        """IDs of the sensors in the log of a run."""
        run = logged_run(self._folder.log(number))
        return None if run is None else run.history.totals.sensors.keys()


class Explanations:
    """The changed runs of some runs."""

    def __init__(self, runs: ExplainedRuns) -> None:
        """Read those that are done. Raises TrialsError."""
        self._runs = runs
        self._store = ResultLines(runs.path / WHY, ChangedRun, TrialsError)
        self.done: dict[tuple[int, str, int], ChangedRun] = {}
        """By run, change and repeat."""
        for _, each in self._store.lines():
            self.done.setdefault((each.run, each.change, each.repeat), each)
        self.most = 0
        """Most runs of the present and the earlier stages of `explain`."""
        self.planned: dict[str, None] = {}
        """Names of all changes of `explain`, in their order."""

    def explain(self, most: int, jobs: int) -> Generator[ChangedRun, None, None]:
        """Run up to `most` failed runs again, without and then with changes, and keep the results.

        Only runs that fail again without a change get changes. Raises TrialsError, ConfigurationError.
        """
        with contextlib.suppress(FileExistsError):
            self._store.path.mkdir()
        with self._store.locked():
            results = self._runs.results
            numbers = failures_in_turn([results[number] for number in sorted(results)])[:most]
            planned = {number: self._interventions(number) for number in numbers}
            self.planned |= {each.change: None for number in numbers for each in planned[number]}
            yield from self._stage([(number, planned[number][0], 0) for number in numbers], jobs)
            failing = [number for number in numbers if self.done[number, UNCHANGED, 0].succeeded is False]
            changed = [(number, each, 0) for number in failing for each in planned[number][1:]]
            yield from self._stage(changed, jobs)
            saved = {number: self._saved(planned[number], number) for number in failing}
            self.most += sum(REPEATS * (len(each) + 1) for each in saved.values() if each)
            yield from self._run(
                (each for number in failing for each in self._repeats(saved[number], number)), jobs
            )

    def _stage(self, asked: Sequence[_Asked], jobs: int) -> Iterator[ChangedRun]:
        """Runs that are all needed."""
        self.most += len(asked)
        return self._run(asked, jobs)

    def _saved(self, planned: Sequence[Intervention], number: int) -> list[Intervention]:
        """The changes that saved a run."""
        done = [self.done[number, each.change, 0] for each in planned[1:]]
        saved = {each.change for each in _simplest([each for each in done if each.succeeded])}
        return [each for each in planned if each.change in saved]

    def _repeats(self, saved: Sequence[Intervention], number: int) -> Iterator[_Asked]:
        """Runs with other errors: of the changes that saved a run, and of the unchanged run. Each is
        determined when it can begin: a change that is decided needs no more."""
        trial = self._runs.trial(number)
        unchanged = Intervention(UNCHANGED, ChangedPart.NOTHING, trial.configuration)
        for repeat in range(1, REPEATS + 1):
            changed = [each.change for each in saved]
            open_ones = [each for each in saved if not self._is_decided(number, each.change, changed)]
            if not open_ones:
                return
            yield from ((number, each, repeat) for each in (unchanged, *open_ones))

    def _is_decided(self, number: int, change: str, saved: Sequence[str]) -> bool:
        """True if further repeats of a change cannot show another result."""
        done = [each for (run, _, repeat), each in self.done.items() if run == number and repeat]
        control = _control(change, done, len(saved))
        if control is None:
            return False
        ended = {each.repeat for each in done if each.change == change}
        return control.is_decided(
            REPEATS - len(ended & {each.repeat for each in done if each.change == UNCHANGED})
        )

    def explanations(self) -> list[Explanation]:
        """Explanations of all runs that ran again, by number."""
        runs = grouped(self.done.values(), attrgetter("run"))
        results = self._runs.results
        return [explained(results[number], runs[number]) for number in sorted(runs) if number in results]

    def _interventions(self, number: int) -> list[Intervention]:
        trial, result = self._runs.trial(number), self._runs.results[number]
        cause = result.verdict.get("cause") or {}
        return interventions(
            trial.configuration,
            nominal_of(trial.configuration),
            read=self._runs.read(number),
            suspects=cause.get("culprits", ()),
            time_was_up=result.ending is Ending.TIME_LIMIT,
        )

    def _trial(self, asked: _Asked, place: int) -> Trial:
        """A run with a change, with its own errors or with other ones. `place` is its number among all: it
        names its files; programs see `repetition`."""
        number, each, repeat = asked
        trial = self._runs.trial(number)
        # More simulated time takes more real time.
        longer = 2.0 if each.part is ChangedPart.TIME_LIMIT else 1.0
        return replace(
            trial,
            number=place,
            configuration=each.configuration,
            errors_seed=run_seed(trial.seed, repeat) if repeat else None,
            tells_start=each.tells_start,
            time_limit=longer * trial.time_limit,
        )

    def _run(self, asked: Iterable[_Asked], jobs: int) -> Iterator[ChangedRun]:
        """The results of runs, each taken from `asked` when it can begin."""
        begun: dict[int, _Asked] = {}

        def trials() -> Iterator[Trial]:
            for each in asked:
                if (each[0], each[1].change, each[2]) not in self.done:
                    begun[len(begun) + 1] = each
                    yield self._trial(each, len(begun))

        make = partial(TrialRun, start=self._runs.start)
        with (
            tempfile.TemporaryDirectory() as logs,
            contextlib.closing(run_locally(trials(), Path(logs), jobs, make)) as results,
        ):
            for result in results:
                number, each, repeat = begun[result.number]
                failed_itself = result.ending is Ending.FAULT
                done = ChangedRun(
                    run=number,
                    change=each.change,
                    part=each.part,
                    codes=each.codes,
                    succeeded=None if failed_itself else result.success,
                    text=str(result.verdict.get("text") or result.reason),
                    repeat=repeat,
                    commands=result.commands,
                )
                self._store.append(done)
                self.done[number, each.change, repeat] = done
                yield done


# -- results of changes ----------------------------------------------------------------------------

_SENSORS = frozenset((ChangedPart.SENSOR, ChangedPart.SENSORS, ChangedPart.SENSOR_ERRORS))
_DRIVES = frozenset((ChangedPart.NOISE, ChangedPart.BIAS, ChangedPart.DRIVES))
_BY_KIND: Mapping[str, frozenset[ChangedPart]] = {
    Kind.SENSOR_WRONG: _SENSORS,
    Kind.DRIVE_WRONG: _DRIVES,
    Kind.TOO_SLOW: frozenset((ChangedPart.TIME, ChangedPart.LINK, ChangedPart.TIME_LIMIT)),
}
"""Changes that would save a run which failed by such a cause. Other causes are decisions of the program."""
_LIKELY = {
    ChangedPart.SENSOR: "the sensor",
    ChangedPart.SENSORS: "the sensors together",
    ChangedPart.NOISE: "drive noise",
    ChangedPart.BIAS: "drive bias",
    ChangedPart.DRIVES: "drive noise and bias together",
    ChangedPart.SENSOR_ERRORS: "the noise and bias of the sensor",
    ChangedPart.ROBOT: "the sensors and drives together",
    ChangedPart.TIME: "the time that readings and the link take",
    ChangedPart.LINK: "the delay of the link",
    ChangedPart.BELIEF: "the program's belief of its start",
    ChangedPart.TIME_LIMIT: "the time limit",
}


def explained(result: TrialResult, changed: Sequence[ChangedRun], name: str = "") -> Explanation:
    """Explanation of a failed run by its changed runs; `name` is its name in the text, by default
    `Run 7`."""
    name = name or f"Run {result.number}"
    cause = result.verdict.get("cause") or {}
    likely = cause.get("sure") == LIKELY
    own = [each for each in changed if not each.repeat]
    repeats = not any(each.succeeded for each in own if each.part is ChangedPart.NOTHING)
    tried = [each for each in own if each.part is not ChangedPart.NOTHING and each.succeeded is not None]
    saved = _simplest([each for each in tried if each.succeeded])
    text = f"{name} succeeds when repeated unchanged: the program does not repeat exactly."
    controls: list[ChanceControl] = []
    if repeats:
        controls = _controls(saved, changed)
        text = f"{name} {_outcome_text(len(tried), saved, controls)}"
    suspected = str(cause.get("kind", "")) if likely else ""
    confirmed = _confirmed(cause, tried, saved, controls) if likely and repeats else None
    sure = tuple(each.change for each in _sure(saved, controls))
    return Explanation(result.number, text, suspected, confirmed, tuple(controls), sure)


def _controls(saved: Sequence[ChangedRun], changed: Sequence[ChangedRun]) -> list[ChanceControl]:
    """The controls of the changes that saved a run, as far as they were repeated."""

    found = (_control(each.change, changed, len(saved)) for each in saved)
    return [each for each in found if each is not None]


def _control(change: str, changed: Sequence[ChangedRun], tested: int) -> ChanceControl | None:
    """The control of one of `tested` changes; None if it was not repeated."""

    def outcomes(change: str) -> dict[int, bool]:
        return {
            each.repeat: each.succeeded
            for each in changed
            if each.repeat and each.change == change and each.succeeded is not None
        }

    return control_of(change, outcomes(change), outcomes(UNCHANGED), tested)


def _outcome_text(tried: int, saved: Sequence[ChangedRun], controls: Sequence[ChanceControl]) -> str:
    """The rest of the sentences about a run that fails again without a change."""
    if not tried:
        return "has not been repeated with changes yet."
    if not saved:
        return f"fails with each of {tried} changes. The likely cause is the program itself."
    sure = _sure(saved, controls)
    named = sure or list(saved)
    changes = [each.change for each in named]
    text = f"succeeds with {listed(changes)}"
    if not controls:
        return f"{text}. That has not been repeated yet and may be chance."
    if not sure:
        text += ", perhaps by chance"
    elif len(changes) > 1:
        text += ". These cannot be distinguished"
    else:
        text += f". The likely cause is {_LIKELY[named[0].part]}"
    return f"{text}. {_shown([each for each in controls if each.change in changes])}"


def _sure(saved: Sequence[ChangedRun], controls: Sequence[ChanceControl]) -> list[ChangedRun]:
    """The changes that saved a run, and surely not by chance. If noise and bias of a sensor suffice, its true
    readings are left out: they contain them."""
    names = {each.change for each in controls if each.is_sure}
    sure = [each for each in saved if each.change in names]
    noisy = {code for each in sure if each.part is ChangedPart.SENSOR_ERRORS for code in each.codes}
    return [each for each in sure if each.part is not ChangedPart.SENSOR or noisy.isdisjoint(each.codes)]


def _shown(controls: Sequence[ChanceControl]) -> str:
    """The figures of controls, each with its change if there are several."""
    if len(controls) == 1:
        return f"{capitalized(controls[0].text)}."
    return " ".join(f"{capitalized(each.change)}: {each.text}." for each in controls)


def _simplest(saved: Sequence[ChangedRun]) -> list[ChangedRun]:
    """The changes that saved a run, without those that contain another of them."""
    parts = {each.part for each in saved}
    alone = {code for each in saved if each.part is ChangedPart.SENSOR for code in each.codes}
    kept: list[ChangedRun] = []
    for each in saved:
        if each.part is ChangedPart.ROBOT and len(saved) > 1:
            continue
        if each.part is ChangedPart.SENSORS:
            within = any(set(other.codes) < set(each.codes) for other in saved)
            if within or not alone.isdisjoint(each.codes):
                continue
        if each.part is ChangedPart.TIME and ChangedPart.LINK in parts:
            continue
        if each.part is ChangedPart.DRIVES and parts & {ChangedPart.NOISE, ChangedPart.BIAS}:
            continue
        kept.append(each)
    return kept


def _confirmed(
    cause: Mapping[str, Any],
    tried: Sequence[ChangedRun],
    saved: Sequence[ChangedRun],
    controls: Sequence[ChanceControl],
) -> bool | None:
    """True if only changes of the suspected parts saved the run, False if none of them did; None if that
    cannot be decided. A change that may have saved it by chance neither confirms nor contradicts a cause."""
    sure = _sure(saved, controls)
    parts, named = _BY_KIND.get(cause.get("kind", "")), set(cause.get("culprits", ()))
    if parts is None or (saved and not sure):
        return None

    def is_suspected(each: ChangedRun) -> bool:
        if each.part not in parts:
            return False
        return each.part not in _SENSORS or not named or set(each.codes) <= named

    if not any(map(is_suspected, tried)):
        return None
    if not any(map(is_suspected, sure)):
        return False
    return True if all(map(is_suspected, sure)) else None


# -- tables ----------------------------------------------------------------------------------------

_YES_NO = Format(lambda value: "yes" if value else "no")
WHY_FAILED = data_table(
    "why",
    "Failed runs, repeated with one change at a time",
    DataColumn("run", COUNT),
    DataColumn("text", heading="result", wraps=True),
    DataColumn("suspected", heading="likely cause"),
    DataColumn("confirmed", _YES_NO),
)
CHANGED_RUNS = data_table(
    "interventions",
    "Changed runs",
    DataColumn("run", COUNT),
    DataColumn("change", wraps=True),
    DataColumn("repeat", COUNT),
    DataColumn("succeeded", _YES_NO),
    DataColumn("text", heading="what happened", wraps=True),
    hidden=True,
)


def explanation_tables(folder: TrialFolder) -> list[DataTable]:
    """Tables of explanations and of changed runs; without rows if there are none. Raises TrialsError."""
    found = Explanations(FolderRuns(folder))
    explanations = found.explanations()
    rows = [(each.run, each.text, each.suspected, each.confirmed) for each in explanations]
    controls = [(each.run, control) for each in explanations for control in each.controls]
    changed = [
        (each.run, each.change, each.repeat, each.succeeded, each.text) for each in found.done.values()
    ]
    changed.sort(key=lambda row: (row[0], row[2]))
    return [WHY_FAILED.filled(rows), control_table(controls), CHANGED_RUNS.filled(changed)]
