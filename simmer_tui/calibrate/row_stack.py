"""Rows of a least-squares problem as they are collected, and the point at which they are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from simmer_tui.sim.angles import BoolArray, FloatArray, IntArray

PROCESS, KINEMATIC, COUNTER, RANGE, OBSERVATION, START, PRIOR = range(7)
"""Families of rows."""
VarianceShare = tuple[int | IntArray, FloatArray]
"""A noise scale, or one a row, with its part of each row's variance."""
JacobianEntry = tuple[IntArray | int, Any] | tuple[IntArray | int, Any, BoolArray]
"""Columns and derivatives of the residuals by them, a row each; with a mask, of the rows where it is True."""


@dataclass(frozen=True)
class Iterate:
    """Point at which rows are linearised: estimates so far of everything that is unknown."""

    chain: FloatArray
    """Poses and totals, (stops, 6)."""
    parameters: FloatArray
    noise_scales: FloatArray
    contacts: BoolArray
    """Movements that met a wall."""
    slipped: BoolArray
    """Those of them that did by their residuals; the others did by where the robot was."""
    outliers: FloatArray
    """Share of outliers of each sensor's readings."""


@dataclass(frozen=True)
class Rows:
    """All rows at one point."""

    residuals: FloatArray
    variances: FloatArray
    weights: FloatArray
    jacobian: Any
    """Sparse, (rows, columns)."""
    shares: Any
    """Share of each row's variance that is due to each noise scale; sparse, (rows, noise scales)."""
    family: IntArray
    source: IntArray
    """Row of the drive or sensor in the set; -1 for starts and priors."""
    stop: IntArray
    """Stop where the reading was made."""


class RowStack:
    """Collects rows."""

    def __init__(self) -> None:
        self._count = 0
        self._parts: dict[str, list[Any]] = {
            name: [] for name in ("residuals", "variances", "weights", "family", "source", "stop")
        }
        self._entries: list[tuple[Any, Any, Any]] = []
        self._shares: list[tuple[Any, Any, Any]] = []

    def add(
        self,
        family: int,
        source: int | IntArray,
        stop: IntArray,
        residuals: FloatArray,
        variances: FloatArray,
        entries: Sequence[JacobianEntry],
        parts: Sequence[VarianceShare] = (),
        weights: FloatArray | None = None,
        chosen: IntArray | None = None,
    ) -> None:
        """Add n rows, or those of them that are `chosen`, in that order.

        Args:
            entries: Derivatives of the residuals.
            parts: Noise scales that the rows' variances come from.
        """
        count = len(residuals)
        chosen = np.arange(count) if chosen is None else chosen
        numbers = np.arange(self._count, self._count + len(chosen))

        def taken(values: Any) -> Any:
            return np.broadcast_to(np.asarray(values), (count,))[chosen]

        for columns, values, *mask in entries:
            where = taken(mask[0] if mask else True)
            triple = numbers, taken(columns), taken(values)
            self._entries.append(tuple(each[where] for each in triple))
        for scale, part in parts:
            self._shares.append((numbers, taken(scale), taken(part) / taken(variances)))
        columns_of_rows = {
            "residuals": residuals, "variances": variances, "weights": 1.0 if weights is None else weights,
            "family": family, "source": source, "stop": stop,
        }  # fmt: skip
        for name, values in columns_of_rows.items():
            self._parts[name].append(taken(values))
        self._count += len(chosen)

    def rows(self, columns: int, noise_scales: int) -> Rows:
        """All rows together."""

        def matrix(entries: list[tuple[Any, Any, Any]], width: int) -> Any:
            if not entries:
                return sparse.csr_matrix((self._count, width))
            row, column, value = (np.concatenate(each) for each in zip(*entries, strict=True))
            return sparse.csr_matrix((value.astype(float), (row, column)), shape=(self._count, width))

        parts = {name: np.concatenate(each) for name, each in self._parts.items()}
        return Rows(
            jacobian=matrix(self._entries, columns), shares=matrix(self._shares, noise_scales), **parts
        )
