"""Least squares over many poses and a few parameters: solutions, samples and covariances.

The poses are a chain in which each row depends only on neighbours, while parameters affect all rows. So the
normal equations are a band with a border: the band is factored by itself, the border by its Schur complement
(Björck, "Numerical Methods for Least Squares Problems", 1996, section 6.3).

The noise scales are the standard deviations of random errors, by restricted maximum likelihood. In a joint
mode with the poses, each movement would explain itself, and they would end at 0. So leverages account for the
degrees of freedom of the poses (Patterson and Thompson 1971). Traces are estimated from random vectors
(Hutchinson 1990).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded

from simmer_tui.calibrate.parameters import ParameterSpace
from simmer_tui.sim.arrays import BoolArray, FloatArray, IntArray

PROCESS, KINEMATIC, COUNTER, RANGE, OBSERVATION, START_POSE, PRIOR = range(7)
"""Families of rows."""
VarianceShare = tuple[int | IntArray, FloatArray]
"""A noise scale, or one for each row, with its part of each row's variance."""
JacobianEntry = tuple[IntArray | int, Any] | tuple[IntArray | int, Any, BoolArray]
"""Columns and derivatives of the residuals by them, a row each; with a mask, of the rows where it is True."""


@dataclass(frozen=True)
class Iterate:
    """Point at which rows are linearised: the present estimates of all unknowns."""

    chain: FloatArray
    """Poses and totals, (stops, 6)."""
    parameters: FloatArray
    noise_scales: FloatArray
    contacts: BoolArray
    """Movements that met a wall."""
    slipped: BoolArray
    """Contacts that were detected by their residuals, not by the robot's place."""
    outliers: FloatArray
    """Share of outliers among each sensor's readings."""


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
        self._parts: defaultdict[str, list[Any]] = defaultdict(list)
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
            row, column, value = (np.concatenate(each) for each in zip(*entries, strict=True))
            return sparse.csr_matrix((value.astype(float), (row, column)), shape=(self._count, width))

        parts = {name: np.concatenate(each) for name, each in self._parts.items()}
        return Rows(
            jacobian=matrix(self._entries, columns), shares=matrix(self._shares, noise_scales), **parts
        )


class Posterior:
    """The normal distribution of the unknowns from weighted, linearised rows, about their iterate."""

    def __init__(self, rows: Rows, chain: int, damping: float = 0.0) -> None:
        """
        Args:
            chain: Number of columns that belong to the chain; they come first.
            damping: Share of the chain's diagonal that is added to it.
        """
        self._chain = chain
        whitened: Any = sparse.diags(np.sqrt(rows.weights / rows.variances)) @ rows.jacobian
        self.whitened: Any = whitened.tocsr()
        self.residuals: FloatArray = rows.residuals * np.sqrt(rows.weights / rows.variances)
        normal: Any = (whitened.T @ whitened).tocsr()
        band = normal[:chain, :chain].tocoo()
        width = int(np.abs(band.row - band.col).max(initial=0))
        lower = np.zeros((width + 1, chain))
        keep = band.row >= band.col
        np.add.at(lower, (band.row[keep] - band.col[keep], band.col[keep]), band.data[keep])
        lower[0] *= 1.0 + damping
        # 1e-12 is below any real information (the most exact row, of 1e-7 in, gives 1e14): without it the
        # factorisation would fail at a stop without a row.
        lower[0] += 1e-12
        self._band = cholesky_banded(lower, lower=True, check_finite=False)
        self._border: FloatArray = normal[:chain, chain:].toarray()
        corner: FloatArray = normal[chain:, chain:].toarray()
        self._carried: FloatArray = self._along(self._border)
        self.information: FloatArray = corner - self._border.T @ self._carried
        """Information of the parameters, with the poses eliminated."""
        self._corner = cho_factor(self.information + 1e-12 * np.eye(len(corner)), lower=True)

    def _along(self, right: FloatArray) -> FloatArray:
        if not right.size:
            return np.zeros_like(right)
        return np.asarray(cho_solve_banded((self._band, True), right, check_finite=False))

    def solve(self, right: FloatArray) -> FloatArray:
        """The inverse of the normal equations times (n,) or (n, k)."""
        above, below = right[: self._chain], right[self._chain :]
        first = self._along(above)
        second: FloatArray = cho_solve(self._corner, below - self._border.T @ first)
        return np.concatenate((first - self._carried @ second, second))

    def step(self) -> FloatArray:
        """The Gauss-Newton step."""
        return self.solve(-(self.whitened.T @ self.residuals))

    def covariance(self) -> FloatArray:
        """Of the parameters, (p, p)."""
        return np.asarray(cho_solve(self._corner, np.eye(len(self.information))))

    def projected(self, vectors: FloatArray) -> FloatArray:
        """J S J' times (rows, k), with S the covariance of the space: the part that the fit explains."""
        return self.sensitivities(self.whitened.T @ vectors)

    def sensitivities(self, chosen: FloatArray) -> FloatArray:
        """J S c for (n, k) combinations c of the space: the influence of each row on them."""
        return np.asarray(self.whitened @ self.solve(chosen))

    def pose_spread(self, random: np.random.Generator, draws: int = 24) -> FloatArray:
        """Standard deviations of the chain's space, (chain,), from samples; 24 give them to 15 %, which is
        enough for a picture and for a filter that uses three times as much."""
        noise = random.standard_normal((self.whitened.shape[0], draws))
        sampled = self.solve(self.whitened.T @ noise)[: self._chain]
        return np.asarray(np.sqrt(np.square(sampled).mean(axis=1)))


# Random vectors. The information only determines the step's length, so that few are enough. Leverages affect
# the estimates: with 16 vectors a row's is known to a quarter, and a scale's, from some 50 rows, to a
# thirtieth.
_PROBES, _LEVERAGES = 3, 16


def noise_scale_score(
    space: ParameterSpace, state: Iterate, rows: Rows, posterior: Posterior, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Gradient and expected information of the restricted likelihood, and of the priors, with respect
    to the logarithms of the noise scales.

    Returns:
        The gradient, (k,), and the information, (k, k).
    """
    scales = space.noise_scales
    shares = rows.shares
    total = len(rows.residuals)
    root = np.sqrt(rows.weights)
    probes = random.choice((-1.0, 1.0), (total, _LEVERAGES))
    leverage = (posterior.projected(probes) * probes).mean(axis=1)
    leverage = np.clip(leverage, 0.0, 1.0)
    # By the logarithm of a standard deviation the derivative of a variance is twice its share. The expected
    # square of a residual is its variance after the fit: its weight minus its leverage.
    excess = rows.weights * rows.residuals**2 / rows.variances - (rows.weights - leverage)
    gradient = np.asarray(shares.T @ excess)
    columns = shares.tocsc()
    information = np.zeros((len(scales), len(scales)))
    owners = np.flatnonzero(np.diff(columns.indptr))
    vectors = np.zeros((total, len(owners), _PROBES))
    for number, index in enumerate(owners):
        mine = slice(*columns.indptr[index : index + 2])
        where = columns.indices[mine]
        signs = random.choice((-1.0, 1.0), (len(where), _PROBES))
        vectors[where, number] = np.sqrt(columns.data[mine])[:, None] * signs
    stacked = vectors.reshape(total, -1)
    left = root[:, None] ** 2 * stacked - posterior.projected(stacked)
    squares = np.asarray(shares.T @ left**2)  # scales x (owners * probes)
    information[:, owners] = 2.0 * squares.reshape(len(scales), len(owners), _PROBES).mean(axis=2)
    information = (information + information.T) / 2
    # For scales without data the information is only rounding; their priors fix them.
    spreads = np.array([each.spread for each in scales])
    centres = np.log(np.array([each.prior for each in scales]))
    information += np.diag(1.0 / spreads**2)
    gradient = gradient - (np.log(state.noise_scales) - centres) / spreads**2
    return gradient, information


def outliers_in(rows: Rows, state: Iterate) -> FloatArray:
    """Share of outliers among each range sensor's readings, by their weights."""
    outliers = state.outliers.copy()
    for index in range(len(outliers)):
        mine = (rows.family == RANGE) & (rows.source == index)
        count = int(mine.sum())
        # Half an outlier and one reading are added: the mean of Jeffreys' prior, so that no share is ever 0.
        if count:
            outliers[index] = (float((1.0 - rows.weights[mine]).sum()) + 0.5) / (count + 1.0)
    # Above 0.4 the mixture could swap outliers and readings; below 1e-4 no log identifies a share.
    return np.clip(outliers, 1e-4, 0.4)
