"""Causes of failed runs, and the most frequent one; and the findings about sensors and drives.

A successful run has its findings too: its program may only just tolerate a wrong sensor.
"""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import zip_longest
from typing import Any, TypeVar

from simmer_tui.document.formats import COUNT, ESTIMATE, NUMBERS, SHARE, Format, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.report.cause_order import advice_on
from simmer_tui.report.causes import Kind
from simmer_tui.report.finding import FINDINGS
from simmer_tui.trials.intervals import IntervalEstimate, wilson
from simmer_tui.trials.trial import Ending, TrialResult

UNKNOWN = "not known"
_Item = TypeVar("_Item")
_Key = TypeVar("_Key")
_OTHER = "#999999"
_CHANGED = Format(lambda runs: f"{len(runs)}: {NUMBERS.text(runs)}" if runs else "")


CAUSES = data_table(
    "causes",
    "Why runs failed",
    DataColumn("cause"),
    DataColumn("runs", COUNT),
    DataColumn("share", ESTIMATE, "share of all"),
    DataColumn("which", NUMBERS, wraps=True),
    DataColumn("text", heading="try", wraps=True),
)
CHANGED_CAUSES = data_table(
    "causes",
    "Why runs failed",
    DataColumn("cause"),
    DataColumn("a", COUNT, "A"),
    DataColumn("b", COUNT, "B"),
    DataColumn("gone_in_b", _CHANGED, "gone in B", wraps=True),
    DataColumn("new_in_b", _CHANGED, "new in B", wraps=True),
)

DEVICES = data_table(
    "devices",
    "Wrong sensors and drives",
    DataColumn("of"),
    DataColumn("kind"),
    DataColumn("against"),
    DataColumn("median", number(".3g")),
    DataColumn("unit"),
    DataColumn("runs", COUNT),
    DataColumn("share", SHARE, "share of all"),
    DataColumn("which", NUMBERS, wraps=True),
    DataColumn("text", heading="for example", wraps=True),
)
RUN_FINDINGS = data_table(
    "findings", "Findings of all runs", DataColumn("run", COUNT), *FINDINGS.columns, hidden=True
)


def grouped(items: Iterable[_Item], key: Callable[[_Item], _Key]) -> dict[_Key, list[_Item]]:
    """Items by their key, in the order in which the keys first come."""
    groups: dict[_Key, list[_Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def success_rate(results: Sequence[TrialResult]) -> IntervalEstimate:
    """The success rate of at least one run."""
    return wilson(sum(result.success for result in results), len(results))


def cause_name(result: TrialResult) -> str:
    """Cause of a failed run; empty for a success."""
    if result.success:
        return ""
    if result.ending is Ending.FAULT:
        return Ending.FAULT.value
    return result.cause or UNKNOWN


def color_of(name: str) -> str:
    """The colour of a cause on the map."""
    kind = cause_kind(name)
    return _OTHER if kind is None else kind.color


def cause_kind(name: str) -> Kind | None:
    """The kind of a cause's name; None for an unknown name."""
    return next((kind for kind in Kind if kind.value == name), None)


def counted_causes(results: Sequence[TrialResult]) -> list[tuple[str, list[TrialResult]]]:
    """The failed runs by cause, the most frequent one first."""
    groups = grouped((result for result in results if not result.success), cause_name)
    return sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))


def failures_in_turn(results: Sequence[TrialResult]) -> list[int]:
    """Numbers of the failed runs, the causes taking turns: a rare one is not crowded out."""
    turns = zip_longest(*(group for _, group in counted_causes(results)))
    return [result.number for turn in turns for result in turn if result is not None]


def failure_summary(results: Sequence[TrialResult]) -> str:
    """Most frequent cause, and the success rate without it at most; empty if no run failed."""
    for name, group in counted_causes(results):
        kind = cause_kind(name)
        if kind is None:
            continue
        whole, failed = len(results), sum(not result.success for result in results)
        best = (whole - failed + len(group)) / whole
        told = f" Try: {advice}" if (advice := advice_on(kind)) else ""
        return (
            f"Most frequent cause: {name}, {len(group)} of {failed} failed runs.{told} Without it "
            f"up to {round(best * whole)} of {whole} runs could have succeeded, not {whole - failed}. "
            f"Example, run {group[0].number}: {group[0].why or name}"
        )
    return ""


def causes_table(results: Sequence[TrialResult]) -> DataTable:
    """The failed runs by cause."""
    rows = []
    for name, group in counted_causes(results):
        kind = cause_kind(name)
        share = wilson(len(group), len(results))
        listed = [result.number for result in group]
        rows.append((name, len(group), share, listed, None if kind is None else advice_on(kind)))
    return CAUSES.filled(rows)


def changed_causes(pairs: Sequence[tuple[TrialResult, TrialResult]]) -> DataTable:
    """Causes of failure that the change from the first to the second of each pair removed and brought."""
    before = Counter(cause_name(a) for a, _ in pairs)
    after = Counter(cause_name(b) for _, b in pairs)
    rows = []
    for name in sorted((before | after).keys() - {""}, key=lambda each: (-(before | after)[each], each)):
        gone = [a.number for a, b in pairs if cause_name(a) == name != cause_name(b)]
        new = [a.number for a, b in pairs if cause_name(b) == name != cause_name(a)]
        rows.append((name, before[name], after[name], gone, new))
    return CHANGED_CAUSES.filled(rows)


def findings_tables(results: Sequence[TrialResult]) -> list[DataTable]:
    """The findings by device, those of most runs first, and a row a finding of every run."""

    def device(found: tuple[int, dict[str, Any]]) -> tuple[str, str, str]:
        _, each = found
        return str(each["of"]), str(each["kind"]), str(each["basis"])

    groups = grouped(((result.number, each) for result in results for each in result.findings), device)
    rows = []
    for key, group in sorted(groups.items(), key=lambda item: (-len(item[1]), item[0])):
        median = statistics.median(each["value"] for _, each in group)
        numbers = list(dict.fromkeys(number for number, _ in group))
        _, example = group[0]
        share = len(numbers) / len(results)
        rows.append((*key, median, example["unit"], len(numbers), share, numbers, example["text"]))
    keys = [column.key for column in FINDINGS.columns]
    listed = [(result.number, *(each[key] for key in keys)) for result in results for each in result.findings]
    return [DEVICES.filled(rows), RUN_FINDINGS.filled(listed)]
