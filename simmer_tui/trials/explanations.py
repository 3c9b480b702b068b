"""Explanations of failed runs: each runs again, with one change at a time; changes that make it succeed are
named.

Those changes are then repeated with other errors, beside the unchanged run: `chance_control.py`.
Results are lines of `why/results.jsonl` in the folder of the trials, so that they can be continued. Logs of
changed runs are not kept: a set's files cannot express such changes.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

from msgspec import Struct

from simmer_tui.config.nominal import nominal_of
from simmer_tui.document.formats import COUNT, Format
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.errors import TrialsError
from simmer_tui.report.causes import Kind, Sureness
from simmer_tui.run.phrases import capitalized
from simmer_tui.sim.rules import listed
from simmer_tui.trials.chance_control import REPEATS, ChanceControl, control_of, control_table
from simmer_tui.trials.failures import failures_in_turn, grouped
from simmer_tui.trials.figures import logged_run
from simmer_tui.trials.folder import WHY, TrialFolder, TrialPlan
from simmer_tui.trials.interventions import UNCHANGED, ChangedPart, Intervention, interventions
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.store import RunStore, StoreKind
from simmer_tui.trials.trial import Ending, Trial, TrialResult, run_seed

EXPLAINED = 3
"""Failed runs that are run again, unless another number is asked for: each takes some ten runs, and twenty or
more to control for chance."""


class ChangedRun(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The result of a run with one change. `succeeded` is None if the simulator failed. `part` is the changed
    part, `codes` are the changed sensors. `text` is its verdict. `repeat` is 0 with its own errors, else the
    number of the other errors."""

    run: int
    change: str
    part: ChangedPart
    codes: tuple[str, ...]
    succeeded: bool | None
    text: str
    repeat: int = 0


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
    """The explanation of a failed run by the changes that make it succeed. `confirmed` is True or False where
    its verdict was only likely and the changes confirm or contradict it, else None. `controls` are those of
    these changes."""

    run: int
    text: str
    suspected: str
    confirmed: bool | None
    controls: tuple[ChanceControl, ...] = ()


_Asked = tuple[int, Intervention, int]
"""A run by its number, its change, and the number of its errors: 0 for its own."""


class Explanations:
    """The changed runs of a set of trials."""

    def __init__(self, folder: TrialFolder) -> None:
        """Read those that are done. Raises TrialsError."""
        self._folder = folder
        self._store = RunStore(folder.path / WHY, _KIND)
        self.done: dict[tuple[int, str, int], ChangedRun] = {}
        """By run, change and repeat."""
        for _, each in self._store.lines():
            self.done.setdefault((each.run, each.change, each.repeat), each)

    def explain(self, most: int, jobs: int) -> Generator[ChangedRun, None, None]:
        """Run up to `most` failed runs again, without and then with changes, and keep the results.

        Only runs that fail again without a change get changes. Raises TrialsError, ConfigurationError.
        """
        with contextlib.suppress(FileExistsError):
            self._store.path.mkdir()
        with self._store.locked():
            numbers = failures_in_turn(self._folder.done)[:most]
            planned = {number: self._interventions(number) for number in numbers}
            yield from self._run([(number, planned[number][0], 0) for number in numbers], jobs)
            failing = [number for number in numbers if self.done[number, UNCHANGED, 0].succeeded is False]
            changed = [(number, each, 0) for number in failing for each in planned[number][1:]]
            yield from self._run(changed, jobs)
            yield from self._run(
                [each for number in failing for each in self._repeats(planned[number], number)], jobs
            )

    def _repeats(self, planned: Sequence[Intervention], number: int) -> Iterator[_Asked]:
        """Runs with other errors: of the changes that saved a run, and of the unchanged run."""
        done = [self.done[number, each.change, 0] for each in planned[1:]]
        saved = {each.change for each in _simplest([each for each in done if each.succeeded])}
        if saved:
            for repeat in range(1, REPEATS + 1):
                wanted = (each for each in planned if each.change in saved | {UNCHANGED})
                yield from ((number, each, repeat) for each in wanted)

    def explanations(self) -> list[Explanation]:
        """Explanations of all runs that ran again, by number."""
        runs = grouped(self.done.values(), attrgetter("run"))
        results = self._folder.results
        return [explained(results[number], runs[number]) for number in sorted(runs) if number in results]

    def _interventions(self, number: int) -> list[Intervention]:
        trial, run = self._folder.trial(number), logged_run(self._folder.log(number))
        cause = self._folder.results[number].verdict.get("cause") or {}
        return interventions(
            trial.configuration,
            nominal_of(trial.configuration),
            read=None if run is None else run.history.totals.sensors.keys(),
            suspects=cause.get("culprits", ()),
        )

    def _trial(self, number: int, repeat: int) -> Trial:
        """A run of the trials, with its own errors, or with other ones."""
        trial = self._folder.trial(number)
        return replace(trial, errors_seed=run_seed(trial.seed, repeat) if repeat else None)

    def _run(self, asked: Sequence[_Asked], jobs: int) -> Iterator[ChangedRun]:
        missing = [each for each in asked if (each[0], each[1].change, each[2]) not in self.done]
        if not missing:
            return
        # The number of a trial names its files, and must be unique; programs see `repetition`.
        trials = [
            replace(self._trial(number, repeat), number=place, configuration=each.configuration)
            for place, (number, each, repeat) in enumerate(missing, 1)
        ]
        with (
            tempfile.TemporaryDirectory() as logs,
            contextlib.closing(run_locally(trials, Path(logs), min(jobs, len(trials)))) as results,
        ):
            for result in results:
                number, each, repeat = missing[result.number - 1]
                failed_itself = result.ending is Ending.FAULT
                done = ChangedRun(
                    run=number,
                    change=each.change,
                    part=each.part,
                    codes=each.codes,
                    succeeded=None if failed_itself else result.success,
                    text=str(result.verdict.get("text") or result.reason),
                    repeat=repeat,
                )
                self._store.append(done)
                self.done[number, each.change, repeat] = done
                yield done


# -- results of changes ----------------------------------------------------------------------------

_SENSORS = frozenset((ChangedPart.SENSOR, ChangedPart.SENSORS))
_DRIVES = frozenset((ChangedPart.NOISE, ChangedPart.BIAS, ChangedPart.DRIVES))
_BY_KIND: Mapping[str, frozenset[ChangedPart]] = {
    Kind.SENSOR_WRONG: _SENSORS,
    Kind.DRIVE_WRONG: _DRIVES,
    Kind.TOO_SLOW: frozenset((ChangedPart.TIME,)),
}
"""Changes that would save a run which failed by such a cause. Other causes are decisions of the program."""
_LIKELY = {
    ChangedPart.SENSOR: "the sensor",
    ChangedPart.SENSORS: "the sensors together",
    ChangedPart.NOISE: "drive noise",
    ChangedPart.BIAS: "drive bias",
    ChangedPart.DRIVES: "drive noise and bias together",
    ChangedPart.TIME: "the time that readings and the link take",
}


def explained(result: TrialResult, changed: Sequence[ChangedRun]) -> Explanation:
    """Explanation of a failed run by its changed runs."""
    cause = result.verdict.get("cause") or {}
    likely = cause.get("sure") == Sureness.LIKELY.value
    own = [each for each in changed if not each.repeat]
    repeats = not any(each.succeeded for each in own if each.part is ChangedPart.NOTHING)
    tried = [each for each in own if each.part is not ChangedPart.NOTHING and each.succeeded is not None]
    saved = _simplest([each for each in tried if each.succeeded])
    text = f"Run {result.number} succeeds when repeated unchanged: the program does not repeat exactly."
    controls: list[ChanceControl] = []
    if repeats:
        controls = _controls(saved, changed)
        text = f"Run {result.number} {_outcome_text(len(tried), saved, controls)}"
    suspected = str(cause.get("kind", "")) if likely else ""
    confirmed = _confirmed(cause, tried, saved, controls) if likely and repeats else None
    return Explanation(result.number, text, suspected, confirmed, tuple(controls))


def _controls(saved: Sequence[ChangedRun], changed: Sequence[ChangedRun]) -> list[ChanceControl]:
    """The controls of the changes that saved a run, as far as they were repeated."""

    def outcomes(change: str) -> dict[int, bool]:
        return {
            each.repeat: each.succeeded
            for each in changed
            if each.repeat and each.change == change and each.succeeded is not None
        }

    unchanged = outcomes(UNCHANGED)
    found = (control_of(each.change, outcomes(each.change), unchanged, len(saved)) for each in saved)
    return [each for each in found if each is not None]


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
    """The changes that saved a run, and surely not by chance."""
    sure = {each.change for each in controls if each.is_sure}
    return [each for each in saved if each.change in sure]


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
        if each.part is ChangedPart.SENSORS:
            within = any(set(other.codes) < set(each.codes) for other in saved)
            if within or not alone.isdisjoint(each.codes):
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
    found = Explanations(folder)
    explanations = found.explanations()
    rows = [(each.run, each.text, each.suspected, each.confirmed) for each in explanations]
    controls = [(each.run, control) for each in explanations for control in each.controls]
    changed = [
        (each.run, each.change, each.repeat, each.succeeded, each.text) for each in found.done.values()
    ]
    changed.sort(key=lambda row: (row[0], row[2]))
    return [WHY_FAILED.filled(rows), control_table(controls), CHANGED_RUNS.filled(changed)]
