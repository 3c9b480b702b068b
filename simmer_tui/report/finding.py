"""A finding: one difference of a sensor or a drive from its nominal set, or of a real one from its set.

A finding has its figure with an interval, the number of readings or movements behind it, and a sentence.
Explanations of beliefs are tests: those of a run have a familywise error of 0.1 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum
from typing import TypeVar

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.document.formats import COUNT, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.report.robust_fit import MAD_ERROR, Z_95
from simmer_tui.run.table import Columns
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
    MISSED = "missed"
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
    what: str = ""
    """Its sentence without the device, the evidence and the set."""


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
        bounds: str = "",
        rests_on: str = "",
        unit: str = "",
        other: str | None = None,
        names_set: bool = False,
    ) -> Finding:
        """A finding, whose sentence says `what` the device does.

        Args:
            interval: Bounds of the value; by default it is exact.
            bounds: The interval in words; by default as `interval_text` says it.
            rests_on: The evidence in words; by default its number of rows.
            names_set: True if `what` names the set.
        """
        low, high = (value, value) if interval is None else interval
        rests_on = rests_on or counted(count, self.rows)
        # Of one or two rows there is no interval.
        if interval is not None and count >= FEWEST["nominal"]:
            rests_on = f"{bounds or interval_text(low, high, value)}, {rests_on}"
        against = f", against {self.against}" if self.against and not names_set else ""
        text = f"{self.code} {what} ({rests_on}){against}"
        return Finding(self.code, kind, value, low, high, unit, count, self.basis, text, other, what)


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


def interval_text(low: float, high: float, value: float) -> str:
    """An interval in words, from the end nearer to 0, with as many digits as its width justifies."""
    if value < 0.0 and high <= 0.0:
        low, high = -high, -low
    digits = 1 if max(abs(low), abs(high)) >= 2.0 and high - low >= 0.1 else 2
    return f"{low:.{digits}f} to {high:.{digits}f}"


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
