"""Findings of all runs of a set of trials: which sensors and drives were not as they should be.

A run has its findings whether it failed or not: a program may cope with a wrong sensor, or only just.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

from simmer_tui.document.formats import COUNT, NUMBERS, SHARE, number
from simmer_tui.document.model import DataColumn, DataTable
from simmer_tui.report.finding import FINDINGS
from simmer_tui.trials.trial import TrialResult

DEVICES = DataTable(
    "devices",
    "Wrong sensors and drives",
    (
        DataColumn("of"),
        DataColumn("kind"),
        DataColumn("against"),
        DataColumn("median", number(".3g")),
        DataColumn("unit"),
        DataColumn("runs", COUNT),
        DataColumn("share", SHARE, "share of all"),
        DataColumn("which", NUMBERS, wraps=True),
        DataColumn("text", heading="for example", wraps=True),
    ),
)
RUN_FINDINGS = DataTable(
    "findings",
    "Findings of all runs",
    (DataColumn("run", COUNT), *FINDINGS.columns),
    hidden=True,
)


def findings_tables(results: Sequence[TrialResult]) -> list[DataTable]:
    """The findings by device, those of most runs first, and a row a finding of every run."""
    groups: dict[tuple[str, str, str], list[tuple[int, dict[str, Any]]]] = {}
    for result in results:
        for each in result.findings:
            key = (str(each["of"]), str(each["kind"]), str(each["basis"]))
            groups.setdefault(key, []).append((result.number, each))
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
