"""Least squares over many poses and a few parameters: solutions, samples and covariances.

The poses are a chain, each row touching only neighbours, and the parameters touch all. So the normal
equations are a band with a border: the band is factored by itself, the border by its Schur complement
(Björck, "Numerical Methods for Least Squares Problems", 1996, section 6.3).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded

from simmer_tui.calibrate.row_stack import Rows
from simmer_tui.sim.angles import FloatArray


class Posterior:
    """The normal distribution of the unknowns that weighted, linearised rows give, about their iterate."""

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
        # 1e-12 is below any information there is (1e-7 in at the most exact row gives 1e14): it keeps the
        # factors from failing where a stop has no row at all.
        lower[0] += 1e-12
        self._band = cholesky_banded(lower, lower=True, check_finite=False)
        self._border: FloatArray = normal[:chain, chain:].toarray()
        corner: FloatArray = normal[chain:, chain:].toarray()
        self._carried: FloatArray = self._along(self._border)
        self.information: FloatArray = corner - self._border.T @ self._carried
        """Of the parameters, the poses eliminated."""
        self._corner = cho_factor(self.information + 1e-12 * np.eye(len(corner)), lower=True)

    def _along(self, right: FloatArray) -> FloatArray:
        if not right.size:
            return np.zeros_like(right)
        solved: FloatArray = cho_solve_banded((self._band, True), right, check_finite=False)
        return solved

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
        inverse: FloatArray = cho_solve(self._corner, np.eye(len(self.information)))
        return inverse

    def projected(self, vectors: FloatArray) -> FloatArray:
        """J S J' times (rows, k), with S the covariance of all space: what of it the fit takes up."""
        taken: FloatArray = self.whitened @ self.solve(self.whitened.T @ vectors)
        return taken

    def sensitivities(self, chosen: FloatArray) -> FloatArray:
        """J S c for (n, k) combinations c of the space: the influence of each row on them."""
        spread: FloatArray = self.whitened @ self.solve(chosen)
        return spread

    def pose_spread(self, random: np.random.Generator, draws: int = 24) -> FloatArray:
        """Standard deviations of the chain's space, (chain,), from samples."""
        noise = random.standard_normal((self.whitened.shape[0], draws))
        sampled = self.solve(self.whitened.T @ noise)[: self._chain]
        spread: FloatArray = np.sqrt(np.square(sampled).mean(axis=1))
        return spread
