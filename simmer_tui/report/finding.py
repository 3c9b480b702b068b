"""A finding: one difference of a sensor or a drive from its nominal set, or of a real one from its set.

A finding has its figure with an interval, the number of readings or movements behind it, and a sentence.
Explanations of beliefs are tests: those of a run have a familywise error of 0.1 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum
from typing import TypeVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.document.formats import COUNT, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.report.robust_fit import MAD_ERROR, Z_95, median_of
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import counted

FALSE_FINDING_RATE = 0.001
"""Probability that a run without a fault has any finding: of a hundred runs hardly one has one."""
FEWEST = {"set": 8, "nominal": 3}
"""Readings or movements below which nothing is claimed, by basis. Beyond the set: with fewer, one outlier is
more than an eighth. Against the nominal set it is known that the rows differ: the median of three is
enough."""
# Below these nothing changes in a maze of 12 in cells.
LEAST_INCHES, LEAST_DEGREES, LEAST_SHARE = 1.0, 2.0, 0.02
"""Least sizes that matter: of an offset, in inches or degrees, and of a gain."""

_T = TypeVar("_T")


class FindingKind(StrEnum):
    """Kinds of findings."""

    OFFSET = "offset"
    GAIN = "gain"
    STUCK = "stuck"
    SWAPPED = "swapped"
    SIGN = "sign"
    NOISE = "noise"
    DRIFT = "drift"
    BIAS = "bias"
    MOUNTING = "mounting"
    OTHER = "other"


class Basis(StrEnum):
    """Set that a device is compared with: the run's own, or the nominal one it was made from."""

    SET = "set"
    NOMINAL = "nominal"


class Finding(Struct, frozen=True):
    """A fault of the device with the code `of`: its `value` with the 95 % interval from `low` to `high`, in
    `unit`, of `count` readings or movements. `other` is the code of the device that it is swapped with."""

    of: str
    kind: FindingKind
    value: float
    low: float
    high: float
    unit: str
    count: int
    basis: Basis
    text: str
    other: str | None = None


class Device(Struct, frozen=True):
    """A sensor or drive, by its code, and the set that it is compared with. `rows` is the noun for the
    evidence; sentences name the set `against`."""

    code: str
    rows: str
    against: str = ""
    basis: Basis = Basis.SET

    def finding(
        self,
        kind: FindingKind,
        value: float,
        what: str,
        count: int,
        *,
        interval: tuple[float, float] | None = None,
        of: int | None = None,
        why: str = "",
        unit: str = "",
        other: str | None = None,
    ) -> Finding:
        """A finding, whose sentence says `what` the device does.

        Args:
            interval: Bounds of the value; by default none is known.
            of: Number of rows that were compared; by default they are the `count` of the evidence.
            why: The difference from the set, in words that name the set.
        """
        low, high = (value, value) if interval is None else interval
        evidence = counted(count, self.rows)
        if of not in (None, count):
            evidence = f"{count} of {counted(of, self.rows)}"
        if interval is not None:
            near, far = sorted((abs(low), abs(high))) if low * high > 0.0 else interval
            digits = 2 if far < 10.0 else 1
            evidence = f"{near:.{digits}f} to {far:.{digits}f}, {evidence}"
        against = f": {why}" if why else f", against {self.against}" if self.against else ""
        text = f"{self.code} {what} ({evidence}){against}"
        return Finding(self.code, kind, value, low, high, unit, count, self.basis, text, other)


def median_interval(
    values: FloatArray, known: FloatArray | float
) -> tuple[float, tuple[float, float] | None]:
    """The median of some values, and its 95 % interval by order statistics, which assumes no distribution. Of
    few values it is the median of those that are known without random errors."""
    count, ordered = len(values), np.sort(values)
    # The median is between the extremes of five with less than 95 %.
    if count <= 5:
        return median_of(np.atleast_1d(known)), None
    rank = round((count - Z_95 * math.sqrt(count)) / 2) - 1
    return median_of(values), (float(ordered[rank]), float(ordered[-1 - rank]))


def holm(
    tests: Iterable[_T], probability: Callable[[_T], float], rate: float = FALSE_FINDING_RATE
) -> Iterator[_T]:
    """The tests that hold a familywise error together, the surest first, by the p-value of each: S. Holm, "A
    simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6 (1979)."""
    ranked = sorted(tests, key=probability)
    for place, each in enumerate(ranked):
        if probability(each) * (len(ranked) - place) > rate:
            return
        yield each


_FIGURE = number(".3g")
FINDINGS = data_table(
    "findings",
    "Wrong sensors and drives",
    DataColumn("of"),
    DataColumn("kind"),
    DataColumn("value", _FIGURE),
    DataColumn("value_low", _FIGURE, "from"),
    DataColumn("value_high", _FIGURE, "to"),
    DataColumn("unit"),
    DataColumn("count", COUNT),
    DataColumn("basis", heading="against"),
    DataColumn("with"),
    DataColumn("text", heading="what", hidden=True),
)


def findings_table(found: Iterable[Finding]) -> DataTable:
    """The table of findings."""
    rows = [
        (
            *(each.of, each.kind.value, each.value, each.low, each.high, each.unit, each.count),
            *(each.basis.value, each.other, each.text),
        )
        for each in found
    ]
    # Programs always have it; people only where it is not blank.
    return replace(FINDINGS.filled(rows), hidden=not rows)


def plain_findings(found: Iterable[Finding]) -> tuple[dict[str, object], ...]:
    """Findings for programs, each by the keys of their table."""
    return tuple(findings_table(found).objects())


# -- explanations of beliefs ------------------------------------------------------------------


class Disagreement(Struct, frozen=True):
    """One explanation of beliefs that differ from the truth: `of` are the codes of the sensors or drives.
    `text` says what the beliefs fit, `count` is the number of readings or movements behind it.

    `probability` is that of evidence as strong without a disagreement, corrected for all tests of its kind.
    `scatter` is the residual scatter, in a unit of the evidence. `elapsed` (seconds) and `line` (of the log)
    are where it began. `advice` is one line to follow, empty for none.
    """

    of: tuple[str, ...]
    text: str
    count: int
    probability: float
    scatter: float
    elapsed: float
    line: int
    advice: str = ""


def moment(row: Columns) -> tuple[float, int]:
    """The elapsed time and the line of a row of a history's table."""
    return float(row["elapsed"]), int(row["line"])


def kept_disagreements(found: Iterable[Sequence[Disagreement]]) -> list[list[Disagreement]]:
    """The explanations that hold an error of 0.1 % a run together (`holm`), the surest first.

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
