"""Progress of a robot: new ground, and the stretch at the end without any."""

import numpy as np
from msgspec import Struct

from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import BoolArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE

GROUND = CELL_SIZE / 2
"""Side of the squares by which new ground is counted, inches: half a cell leads nowhere."""
# The slowest of 80 clean runs of the samples turned 62 times on the spot to find the block.
HUNDRED = 100
"""Movements allowed for each new square of ground, and at the start: a robot that needs more only drifts."""
# Judged: a cell at 6 in/s takes as long. The number of legs says how often a program steers, not how much.
LEG = 2.0
"""Seconds of continuous motion that count as one movement."""


class StalledPeriod(Struct, frozen=True):
    """The latest stretch in which the robot reached no goal, and hardly any ground that was new since the
    last goal. It has its begin (elapsed seconds) and place, its movements, its path in inches and degrees,
    and the seconds of driving."""

    place: Pose
    since: float
    movements: int
    driven: float
    turned: float
    driving: float


def without_progress(rows: Columns, legs: BoolArray, place: Pose, since: float) -> StalledPeriod:
    """The stretch without progress at the end of movements since a goal, (n,).

    Args:
        rows: Columns of `MovementRow`.
        legs: True for legs of continuous motion, (n,).
        place: Pose before them, where they are the first of a run.
        since: The moment then, elapsed seconds.
    """
    squares = np.floor(rows["x"] / GROUND) + 1j * np.floor(rows["y"] / GROUND)
    # The movement that first reached each square of ground; being stopped by a wall is no progress.
    _, first = np.unique(squares, return_index=True)
    reached = np.sort(first[~rows["contact"][first]])
    last = int(reached[-1]) if len(reached) else -1
    left = len(reached) - np.arange(len(reached))
    # A robot that goes to and fro drifts, and comes to a new square after a hundred movements.
    counts = np.where(legs, (rows["elapsed"] - rows["begin"]) / LEG, 1.0)
    drifted = np.flatnonzero(counts.sum() - np.cumsum(counts)[reached] >= HUNDRED * left)
    if len(drifted):
        last = int(reached[drifted[0]])
    rest = rows[last + 1 :]
    if last >= 0:
        x, y, heading = (float(rows[name][last]) for name in ("x", "y", "heading"))
        place, since = Pose(x, y, heading), float(rows["elapsed"][last])
    return StalledPeriod(
        place,
        since,
        movements=round(float(counts[last + 1 :].sum())),
        driven=float(rest["went"].sum()),
        turned=float(rows["turned"][-1] - rows["turned"][last]) if len(rest) and last >= 0 else 0.0,
        driving=float((rest["elapsed"] - rest["begin"]).sum()),
    )
