"""Two sets of trials on the same seeds, compared run by run."""

from __future__ import annotations

from collections.abc import Callable

from simmer_tui.errors import TrialsError
from simmer_tui.report.content import Column, Table
from simmer_tui.sim.command import escape
from simmer_tui.trials.estimate_text import rate, shown_estimate
from simmer_tui.trials.failures import changed_causes
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import PairCounts, mcnemar, mean_difference, paired_difference
from simmer_tui.trials.likeness import robot_differences, task_differences
from simmer_tui.trials.record import TrialResult

SIGNIFICANCE = 0.05
"""Below this p the runs are taken to show a difference."""
_LISTED = 12

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


def tables(first: TrialFolder, second: TrialFolder, pairs: list[RunPair]) -> list[Table]:
    """What was compared, who succeeded, why the others failed, and how the successes differ."""
    made = [_sets(first, second, pairs), _outcomes(pairs), changed_causes(pairs), _figures(pairs)]
    return [table for table in made if table.rows]


def count_pairs(pairs: list[RunPair]) -> PairCounts:
    """How many runs both did, only one, or neither."""
    outcomes = [(a.success, b.success) for a, b in pairs]
    counts = [outcomes.count(each) for each in ((True, True), (True, False), (False, True), (False, False))]
    return PairCounts(*counts)


def verdict(pairs: list[RunPair]) -> str:
    """What can be said of the success rates."""
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


def _sets(first: TrialFolder, second: TrialFolder, pairs: list[RunPair]) -> Table:
    rows = []
    for index, (name, folder) in enumerate((("A", first), ("B", second))):
        paired_results = [pair[index] for pair in pairs]
        rows.append(
            (
                name,
                escape(folder.plan.command, 120),
                escape(folder.plan.configuration, 80),
                str(len(folder.results)),
                shown_estimate(rate(paired_results)),
            )
        )
    columns = (
        Column(""),
        Column("program", wraps=True),
        Column("configuration", wraps=True),
        Column("runs", True),
        Column("success rate", True),
    )
    left_out = len(first.results) + len(second.results) - 2 * len(pairs)
    note = f"Compared are the {len(pairs)} runs that both have. In brackets: 95 % Wilson intervals."
    more = f" {left_out} runs of one of them alone are left out." if left_out else ""
    if differences := robot_differences(first, second):
        more += f" They differ in {', '.join(differences)}."
    return Table("Trials", columns, tuple(rows), note + more)


def _outcomes(pairs: list[RunPair]) -> Table:
    counts = count_pairs(pairs)
    only_first = [a.number for a, b in pairs if a.success and not b.success]
    only_second = [a.number for a, b in pairs if b.success and not a.success]
    rows = (
        ("both succeed", str(counts.both), ""),
        ("only A succeeds", str(counts.first_only), _numbers(only_first)),
        ("only B succeeds", str(counts.second_only), _numbers(only_second)),
        ("neither succeeds", str(counts.neither), ""),
        ("B - A, success rate", shown_estimate(paired_difference(counts), "+.3f"), ""),
    )
    note = (
        "In brackets: the 95 % interval by Newcombe's method 10 for paired proportions (1998), an "
        f"approximation. What can be said goes by {shown_test(counts)}."
    )
    columns = (Column("the same run"), Column("runs", True), Column("which", wraps=True))
    return Table("Run by run", columns, rows, note)


def _numbers(numbers: list[int]) -> str:
    more = f" and {len(numbers) - _LISTED} more" if len(numbers) > _LISTED else ""
    return ", ".join(map(str, numbers[:_LISTED])) + more


def _figures(pairs: list[RunPair]) -> Table:
    both = [pair for pair in pairs if pair[0].success and pair[1].success]
    figures: list[tuple[str, list[RunPair], Callable[[TrialResult], float], int]] = [
        ("time s, where both succeed", both, lambda result: result.time, 1),
        ("distance in, where both succeed", both, lambda result: result.distance, 1),
        ("commands, where both succeed", both, lambda result: float(result.commands), 0),
        ("contacts, all runs", pairs, lambda result: float(result.contacts), 2),
    ]
    rows = []
    for name, chosen, value, decimals in figures:
        if not chosen:
            continue
        values = [(value(a), value(b)) for a, b in chosen]
        means = [sum(each) / len(chosen) for each in zip(*values, strict=True)]
        difference = mean_difference([b - a for a, b in values])
        form = f"+.{decimals}f"
        rows.append(
            (
                name,
                str(len(chosen)),
                *(f"{mean:.{decimals}f}" for mean in means),
                format(means[1] - means[0], form) if difference is None else shown_estimate(difference, form),
            )
        )
    columns = (
        Column("mean of"),
        Column("runs", True),
        Column("A", True),
        Column("B", True),
        Column("B - A", True),
    )
    note = (
        "In brackets, from three runs on: the 95 % interval of the mean over the pairs, by Student's t and "
        "the bootstrap-t, whichever reaches further (10 000 resamples, fixed seed)."
    )
    return Table("Figures", columns, tuple(rows), note)
