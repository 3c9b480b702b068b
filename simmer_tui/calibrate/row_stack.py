"""Rows of a least-squares problem as they are collected, and the point at which they are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from simmer_tui.sim.angles import FloatArray

LAW, WAY, COUNTER, RANGE, COMPASS, START, PRIOR = range(7)
IntArray = np.ndarray[tuple[int], np.dtype[np.int64]]


@dataclass(frozen=True)
class State:
    """A point: (stops, 6) poses and totals, the parameters, the error sizes, which movements met a wall,
    which of them did by what was read (the others by where the robot was), and how often each sensor's
    readings are anything."""

    chain: FloatArray
    places: FloatArray
    sizes: FloatArray
    contacts: np.ndarray[tuple[int], np.dtype[np.bool_]]
    slipped: np.ndarray[tuple[int], np.dtype[np.bool_]]
    outliers: FloatArray


@dataclass(frozen=True)
class Rows:
    """All rows at one point. `shares` (rows x error sizes) is what part of a row's variance comes from
    which error size; `family` and `source` (drive or sensor) say where a row belongs, `stop` where its
    reading was made."""

    residuals: FloatArray
    variances: FloatArray
    weights: FloatArray
    jacobian: Any
    shares: Any
    family: IntArray
    source: IntArray
    stop: IntArray


class RowStack:
    """Collects rows."""

    def __init__(self) -> None:
        self.count = 0
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
        entries: Sequence[tuple[IntArray | int, FloatArray | float]],
        parts: Sequence[tuple[int, FloatArray]] = (),
        weights: FloatArray | None = None,
    ) -> None:
        """`entries` are (column, derivative of the residual), a row each, or one column for all of them;
        `parts` (error size, its share of the variance, in units of the variance)."""
        count = len(residuals)
        rows = np.arange(self.count, self.count + count)
        for column, value in entries:
            columns = np.broadcast_to(np.asarray(column), (count,))
            known = columns >= 0
            self._entries.append(
                (rows[known], columns[known], np.broadcast_to(np.asarray(value, float), (count,))[known])
            )
        for size, part in parts:
            if size >= 0:
                self._shares.append((rows, np.full(count, size), part / variances))
        self._parts["residuals"].append(residuals)
        self._parts["variances"].append(variances)
        self._parts["weights"].append(np.ones(count) if weights is None else weights)
        self._parts["family"].append(np.full(count, family))
        self._parts["source"].append(np.broadcast_to(np.asarray(source), (count,)))
        self._parts["stop"].append(stop)
        self.count += count

    def rows(self, columns: int, sizes: int) -> Rows:
        def matrix(entries: list[tuple[Any, Any, Any]], width: int) -> Any:
            if not entries:
                return sparse.csr_matrix((self.count, width))
            row, column, value = (np.concatenate(each) for each in zip(*entries, strict=True))
            return sparse.csr_matrix((value, (row, column)), shape=(self.count, width))

        parts = {name: np.concatenate(each) for name, each in self._parts.items()}
        return Rows(jacobian=matrix(self._entries, columns), shares=matrix(self._shares, sizes), **parts)
