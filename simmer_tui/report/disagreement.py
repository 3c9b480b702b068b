"""Disagreements: a sensor's replies or a drive's commands by which a program and its log differ.

The log has replies as they were sent and commands as the robot got them. The program's use of them shows in
its beliefs, and in the commands that followed. Where the two do not fit, either a message was changed on the
link, or the program misunderstands that sensor or drive. A log cannot distinguish these, but it can name the
device.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from simmer_tui.report.finding import holm
from simmer_tui.report.robust_fit import MAD_ERROR, Z_95
from simmer_tui.run.table import Columns


@dataclass(frozen=True, slots=True)
class Disagreement:
    """One explanation of why program and log differ: `of` are the codes of the sensors or drives, none where
    it may be any. `text` says what was different, `count` is the number of readings or movements behind it.

    `probability` is that of evidence as strong without a disagreement, corrected for all tests of its kind.
    `scatter` is the residual scatter, in a unit of the evidence. `elapsed` (seconds) and `line` (of the log)
    are where it began. With `command_lost`, a command never reached the robot.
    """

    of: tuple[str, ...]
    text: str
    count: int
    probability: float
    scatter: float
    elapsed: float
    line: int
    command_lost: bool = False


def moment(row: Columns) -> tuple[float, int]:
    """The elapsed time and the line of a row of a history's table."""
    return float(row["elapsed"]), int(row["line"])


def kept_disagreements(found: Iterable[Sequence[Disagreement]]) -> list[list[Disagreement]]:
    """The explanations that hold an error of 1 % a run together (`holm`), the surest first.

    Args:
        found: For each thing that was tested, its explanations. Of those that explain the same evidence, the
            ones that leave about as little as the best are kept.
    """
    standing = []
    for each in holm(found, lambda test: min(one.probability for one in test)):
        best = min(each, key=lambda one: one.scatter)
        # A scatter within the error of the best one may be larger only by chance.
        most = best.scatter * (1.0 + Z_95 * MAD_ERROR / best.count**0.5)
        standing.append(sorted((one for one in each if one.scatter <= most), key=lambda one: one.scatter))
    return standing
