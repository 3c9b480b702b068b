"""Two sets of trials on the same seeds, compared run by run."""

from __future__ import annotations

import math
from collections.abc import Callable

from simmer_tui.document.formats import COUNT, ESTIMATE, Format, estimate, number, numbers, short
from simmer_tui.document.model import DataColumn, DataTable, Document, Paragraph
from simmer_tui.errors import TrialsError
from simmer_tui.trials.failures import CHANGED_CAUSES, changed_causes, rate
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import (
    IntervalEstimate,
    PairCounts,
    mcnemar,
    mean_difference,
    paired_difference,
)
from simmer_tui.trials.likeness import robot_differences, task_differences
from simmer_tui.trials.record import TrialResult

# The usual level; with the interval of 95 % in the same table, both say the same.
SIGNIFICANCE = 0.05
"""Below this p the runs are taken to show a difference."""
SETS = DataTable(
    "sets",
    "Trials",
    (
        DataColumn("set", heading=""),
        DataColumn("folder", Format(str), hidden=True),
        DataColumn("program", short(120), wraps=True),
        DataColumn("configuration", short(80), wraps=True),
        DataColumn("runs", COUNT),
        DataColumn("success_rate", ESTIMATE),
    ),
)
PAIRED = DataTable(
    "pairs",
    "Run by run",
    (
        DataColumn("the_same_run"),
        DataColumn("runs", COUNT),
        DataColumn("which", numbers(12), wraps=True),
    ),
)
DIFFERENCE = DataTable(
    "difference",
    "Difference",
    (
        DataColumn("success_rate", estimate("+.3f"), "B - A, success rate"),
        DataColumn("p", Format(lambda p: f"{p:.2g}")),
    ),
    record=True,
)
MEANS = DataTable(
    "means",
    "Means",
    (
        DataColumn("mean_of"),
        DataColumn("unit"),
        DataColumn("runs", COUNT),
        DataColumn("a", number(".4g"), "A"),
        DataColumn("b", number(".4g"), "B"),
        DataColumn("difference", estimate("+.3g"), "B - A"),
    ),
)

TABLES = (SETS, PAIRED, DIFFERENCE, CHANGED_CAUSES, MEANS)
"""All tables of a comparison."""

RunPair = tuple[TrialResult, TrialResult]


def paired(first: TrialFolder, second: TrialFolder, *, other_robot: bool = False) -> list[RunPair]:
    """The runs that both have, by number.

    Raises TrialsError if there are none, if the task was not the same for both, or, without
    `other_robot`, if the robot was not.
    """
    pairs = [
        (first.results[number], second.results[number])
        for number in sorted(first.results.keys() & second.results.keys())
        if (first.results[number].seed, first.results[number].maze)
        == (second.results[number].seed, second.results[number].maze)
    ]
    if not pairs:
        seeds = f"{first.plan.seed} and {second.plan.seed}"
        raise TrialsError(
            f"there are no runs of both with the same seed and maze (the seeds are {seeds}): start both "
            "sets of trials with the same --seed and the same mazes"
        )
    if differences := task_differences(first, second, {a.maze for a, _ in pairs}):
        raise TrialsError(
            f"A and B did not do the same: they differ in {', '.join(differences)}; run both with the same "
            "maze, mission and block"
        )
    if not other_robot and (differences := robot_differences(first, second)):
        raise TrialsError(
            f"the robots of A and B are not alike: they differ in {', '.join(differences)}; add "
            "--other-robot if that is what is to be compared"
        )
    return pairs


def comparison(first: TrialFolder, second: TrialFolder, pairs: list[RunPair]) -> Document:
    """Tables: the two sets, outcomes run by run, causes of failure, figures of the successes."""
    made = [_sets(first, second, pairs), _outcomes(pairs), _difference(pairs), changed_causes(pairs)]
    shown = [table for table in (*made, _means(pairs)) if table.rows]
    return Document("Comparison", [*shown, Paragraph(verdict(pairs), "verdict", "strong")])


def count_pairs(pairs: list[RunPair]) -> PairCounts:
    """Numbers of runs in which both succeed, only one, or neither."""
    outcomes = [(a.success, b.success) for a, b in pairs]
    counts = [outcomes.count(each) for each in ((True, True), (True, False), (False, True), (False, False))]
    return PairCounts(*counts)


def verdict(pairs: list[RunPair]) -> str:
    """Sentence that compares the success rates."""
    counts = count_pairs(pairs)
    if mcnemar(counts) >= SIGNIFICANCE:
        return f"Which of them succeeds more often cannot be told from these runs ({shown_test(counts)})."
    better, worse = "BA" if counts.second_only > counts.first_only else "AB"
    return f"{better} succeeds more often than {worse} ({shown_test(counts)})."


def shown_test(counts: PairCounts) -> str:
    """The test that the verdict goes by, with as many digits as tell on which side of 5 % it lies."""
    p = mcnemar(counts)
    shown = f"{p:.2g}"
    if float(shown) == SIGNIFICANCE:
        shown = f"{p:.5f}"
    return (
        f"McNemar's exact test: p = {shown}, {'below' if p < SIGNIFICANCE else 'not below'} {SIGNIFICANCE:g}"
    )


def _sets(first: TrialFolder, second: TrialFolder, pairs: list[RunPair]) -> DataTable:
    rows = []
    for index, (name, folder) in enumerate((("A", first), ("B", second))):
        plan, rated = folder.plan, rate([pair[index] for pair in pairs])
        rows.append((name, folder.path, plan.command, plan.configuration, len(folder.results), rated))
    left_out = len(first.results) + len(second.results) - 2 * len(pairs)
    note = f"Compared are the {len(pairs)} runs that both have. In brackets: 95 % Wilson intervals."
    more = f" {left_out} runs of one of them alone are left out." if left_out else ""
    if differences := robot_differences(first, second):
        more += f" They differ in {', '.join(differences)}."
    return SETS.filled(rows, note + more)


def _outcomes(pairs: list[RunPair]) -> DataTable:
    groups: dict[tuple[bool, bool], list[int]] = {}
    for a, b in pairs:
        groups.setdefault((a.success, b.success), []).append(a.number)
    names = ("both succeed", "only A succeeds", "only B succeeds", "neither succeeds")
    rows = []
    for name, key in zip(names, ((True, True), (True, False), (False, True), (False, False)), strict=True):
        numbers_of = groups.get(key, [])
        rows.append((name, len(numbers_of), numbers_of if key[0] != key[1] else None))
    return PAIRED.filled(rows)


def _difference(pairs: list[RunPair]) -> DataTable:
    counts = count_pairs(pairs)
    note = (
        "In brackets: the 95 % interval by Newcombe's method 10 for paired proportions (1998), an "
        f"approximation. What can be said goes by {shown_test(counts)}."
    )
    row = (paired_difference(counts), mcnemar(counts))
    return DIFFERENCE.filled([row], note)


def _means(pairs: list[RunPair]) -> DataTable:
    both = [pair for pair in pairs if pair[0].success and pair[1].success]
    means: list[tuple[str, str, list[RunPair], Callable[[TrialResult], float]]] = [
        ("time, both succeed", "s", both, lambda result: result.time),
        ("distance, both succeed", "in", both, lambda result: result.distance),
        ("commands, both succeed", "", both, lambda result: float(result.commands)),
        ("contacts, all runs", "", pairs, lambda result: float(result.contacts)),
    ]
    rows = []
    for name, unit, chosen, value in means:
        if not chosen:
            continue
        values = [(value(a), value(b)) for a, b in chosen]
        a, b = (sum(each) / len(chosen) for each in zip(*values, strict=True))
        alone = IntervalEstimate(b - a, math.nan, math.nan)
        rows.append((name, unit, len(chosen), a, b, mean_difference([y - x for x, y in values]) or alone))
    note = (
        "In brackets, from three runs on: the 95 % interval of the mean over the pairs, by Student's t and "
        "the bootstrap-t, whichever reaches further (10 000 resamples, fixed seed)."
    )
    return MEANS.filled(rows, note)
