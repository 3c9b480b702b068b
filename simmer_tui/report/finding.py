"""A finding: one difference of a sensor or a drive from its nominal set, or of a real one from its set.

A finding has its figure with an interval, the number of readings or movements behind it, and a sentence.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.document.formats import COUNT, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.sim.command import counted

FEWEST = {"set": 8, "nominal": 3}
"""Readings or movements below which nothing is claimed, by basis. Beyond the set: with fewer, one outlier is
more than an eighth. Against the nominal set it is known that the rows differ: the median of three is
enough."""
# Below these nothing changes in a maze of 12 in cells.
LEAST_INCHES, LEAST_DEGREES, LEAST_SHARE = 1.0, 2.0, 0.02
"""Least sizes that matter: of an offset, in inches or degrees, and of a gain."""


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
