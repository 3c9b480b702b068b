"""Two sets of trials on the same seeds and the same task, compared run by run."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterable
from itertools import product
from operator import attrgetter
from typing import Any

from simmer_tui.config import drive_csv, maze_csv, mission_toml, robot_csv, sensors_csv
from simmer_tui.config.loader import Configuration
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.settings import SettingsTable, all_settings, tables, value_of
from simmer_tui.document.formats import COUNT, ESTIMATE, TYPED, Format, estimate, number, numbers
from simmer_tui.document.model import DataColumn, DataTable, Document, Paragraph, data_table
from simmer_tui.errors import TrialsError
from simmer_tui.sim.command import counted, cut
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.trials.failures import CHANGED_CAUSES, changed_causes, success_rate
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import (
    RESAMPLES,
    SIGNIFICANCE,
    IntervalEstimate,
    PairCounts,
    mcnemar,
    mean_difference,
    paired_difference,
)
from simmer_tui.trials.trial import RANDOM, TrialResult, clocks_text

SETS = data_table(
    "sets",
    "Trials",
    DataColumn("set", heading=""),
    DataColumn("folder", Format(str), hidden=True),
    DataColumn("program", TYPED, wraps=True),
    DataColumn("configuration", TYPED, wraps=True),
    DataColumn("runs", COUNT),
    DataColumn("clock"),
    DataColumn("success_rate", ESTIMATE),
)
PAIRED = data_table(
    "pairs",
    "Run by run",
    DataColumn("the_same_run"),
    DataColumn("runs", COUNT),
    DataColumn("which", numbers(12), wraps=True),
)
DIFFERENCE = data_table(
    "difference",
    "Difference",
    DataColumn("success_rate", estimate("+.3f"), "B - A, success rate"),
    DataColumn("p", Format(lambda p: f"{p:.2g}")),
    record=True,
)
MEANS = data_table(
    "means",
    "Means",
    DataColumn("mean_of"),
    DataColumn("unit"),
    DataColumn("runs", COUNT),
    DataColumn("a", number(".4g"), "A"),
    DataColumn("b", number(".4g"), "B"),
    DataColumn("difference", estimate("+.3g"), "B - A"),
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
            f"A and B have no run with the same seed and maze (their seeds are {seeds}): start both sets of "
            "trials with the same --seed and the same mazes"
        )
    if differences := task_differences(first, second, {a.maze for a, _ in pairs}):
        raise TrialsError(
            f"A and B had different tasks: they differ in {', '.join(differences)}; run both with the same "
            "maze, mission and block"
        )
    if not other_robot and (differences := robot_differences(first, second)):
        raise TrialsError(
            f"A and B had different robots: they differ in {', '.join(differences)}; add "
            "--other-robot to compare them anyway"
        )
    return pairs


def comparison(first: TrialFolder, second: TrialFolder, pairs: list[RunPair]) -> Document:
    """Tables: the two sets, outcomes run by run, causes of failure, figures of the successes."""
    made = [_sets(first, second, pairs), _outcomes(pairs), _difference(pairs), changed_causes(pairs)]
    shown = [table for table in (*made, _means(pairs)) if table.rows]
    return Document("Comparison", [*shown, Paragraph(verdict(pairs), "verdict", "strong")])


def count_pairs(pairs: list[RunPair]) -> PairCounts:
    """Numbers of runs in which both succeed, only one, or neither."""
    return PairCounts.of([(a.success, b.success) for a, b in pairs])


def verdict(pairs: list[RunPair]) -> str:
    """Sentence that compares the success rates."""
    counts = count_pairs(pairs)
    if mcnemar(counts) >= SIGNIFICANCE:
        return f"These runs do not show which program succeeds more often ({mcnemar_text(counts)})."
    better, worse = "BA" if counts.second_only > counts.first_only else "AB"
    return f"{better} succeeds more often than {worse} ({mcnemar_text(counts)})."


def mcnemar_text(counts: PairCounts) -> str:
    """The test behind the verdict, with enough digits to show on which side of 5 % it lies."""
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
        plan, rated = folder.plan, success_rate([pair[index] for pair in pairs])
        clock = clocks_text([pair[index] for pair in pairs])
        rows.append((name, folder.path, plan.program, plan.configuration, len(folder.results), clock, rated))
    left_out = len(first.results) + len(second.results) - 2 * len(pairs)
    note = f"Compared: the {counted(len(pairs), 'run')} that both have. In brackets: 95 % Wilson intervals."
    more = f" Left out: {counted(left_out, 'run')} that only one of them has." if left_out else ""
    if differences := robot_differences(first, second):
        more += f" They differ in {', '.join(differences)}."
    return SETS.filled(rows, note + more)


def _outcomes(pairs: list[RunPair]) -> DataTable:
    names = ("both succeed", "only A succeeds", "only B succeeds", "neither succeeds")
    rows = []
    for name, (of_a, of_b) in zip(names, product((True, False), repeat=2), strict=True):
        runs = [a.number for a, b in pairs if (a.success, b.success) == (of_a, of_b)]
        rows.append((name, len(runs), runs if of_a != of_b else None))
    return PAIRED.filled(rows)


def _difference(pairs: list[RunPair]) -> DataTable:
    counts = count_pairs(pairs)
    note = (
        "In brackets: the 95 % interval by Newcombe's method 10 for paired proportions (1998), an "
        f"approximation. The decision is by {mcnemar_text(counts)}."
    )
    row = (paired_difference(counts), mcnemar(counts))
    return DIFFERENCE.filled([row], note)


def _means(pairs: list[RunPair]) -> DataTable:
    both = [pair for pair in pairs if pair[0].success and pair[1].success]
    means: list[tuple[str, str, list[RunPair], Callable[[TrialResult], float]]] = [
        ("time, both succeed", "s", both, attrgetter("time")),
        ("distance, both succeed", "in", both, attrgetter("distance")),
        ("commands, both succeed", "", both, attrgetter("commands")),
        ("contacts, all runs", "", pairs, attrgetter("contacts")),
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
        "In brackets, from three runs on: the 95 % interval of the mean over the pairs. It is the wider of "
        f"Student's t and the bootstrap-t ({RESAMPLES // 1000} 000 resamples, fixed seed)."
    )
    return MEANS.filled(rows, note)


_OF_THE_TASK = (*mission_toml.OVERRIDDEN, "blocksize", "motion.block_solid")
_NOT_OF_A_RUN = ("seed", "randerror", "sim", "plot_robot", "plot_sense")
"""Settings that trials do not use, or set themselves."""

_ROBOT_FILES: dict[str, Callable[[SimulationSpec], object]] = {
    robot_csv.FILE: attrgetter("robot"),
    sensors_csv.FILE: attrgetter("sensors"),
    drive_csv.FILE: attrgetter("drives", "gripper", "velocities"),
}


def task_differences(first: TrialFolder, second: TrialFolder, mazes: Iterable[str]) -> list[str]:
    """The names of the parts of the task and its maze that differ between the two, for runs in some `mazes`.
    Comments and line ends make no difference."""
    one, other = first.configuration, second.configuration
    found = []
    if one.mission != other.mission:
        found.append(mission_toml.FILE)
    if first.plan.points != second.plan.points:
        found.append("the values of --vary")
    kinds = set(mazes)
    one_maze, other_maze = one.simulation.maze, other.simulation.maze
    if kinds & {"", RANDOM} and one_maze.cells != other_maze.cells:
        found.append(maze_csv.FILE)
    if one_maze.floor != other_maze.floor:
        found.append(maze_csv.FLOOR_FILE)
    found += [
        f"the maze {cut(name)}"
        for name in sorted(kinds - {"", RANDOM})
        if first.mazes[name].cells != second.mazes[name].cells
    ]
    settled = mission_toml.OVERRIDDEN if one.mission is not None else ()
    return found + _settings(one, other, lambda name: name in _OF_THE_TASK and name not in settled)


def robot_differences(first: TrialFolder, second: TrialFolder) -> list[str]:
    """The names of the files and settings of the robot itself that differ."""
    one, other = first.configuration, second.configuration
    found = [
        name
        for name, part in _ROBOT_FILES.items()
        if part(one.simulation) != part(other.simulation) and _lines(one, name) != _lines(other, name)
    ]
    if bool(first.plan.sketches) != bool(second.plan.sketches):
        found.append("boards, which drive only one of them")
    elif first.plan.sketches and _wiring(one) != _wiring(other):
        found.append(WIRING_FILE)
    return found + _settings(one, other, _is_of_the_robot)


def _wiring(configuration: Configuration) -> dict[str, Any]:
    """The values of a set's wiring.toml without the paths of its sketches, which are programs."""
    values = tomllib.loads(configuration.files[WIRING_FILE].removeprefix("\ufeff"))
    for board in values.get("boards", {}).values():
        board.pop("sketch", None)
    return values


def _is_of_the_robot(name: str) -> bool:
    table = name.partition(".")[0]
    return name not in (*_OF_THE_TASK, *_NOT_OF_A_RUN) and tables().get(table, SettingsTable).is_of_robot


def _settings(one: Configuration, other: Configuration, matters: Callable[[str], bool]) -> list[str]:
    found = []
    for item in all_settings():
        values = [value_of(each.settings, item.name) for each in (one, other)]
        if matters(item.name) and values[0] != values[1]:
            shown = " and ".join(cut(str(value)) for value in values)
            found.append(f"the setting {item.name} ({shown})")
    return found


def _lines(configuration: Configuration, name: str) -> list[str]:
    """A file's lines; a profile is not in them, though it changes the values."""
    return configuration.files.get(name, "").splitlines()
