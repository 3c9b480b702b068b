"""The sizes of random errors, by restricted maximum likelihood.

Their joint mode with the poses would let each movement explain itself and end at 0; what the poses take up
is accounted for by its leverage (Patterson and Thompson 1971). Traces are estimated from random vectors
(Hutchinson 1990).
"""

from __future__ import annotations

import numpy as np

from simmer_tui.calibrate.posterior import Posterior
from simmer_tui.calibrate.row_stack import RANGE, Iterate, Rows
from simmer_tui.calibrate.rows import Model
from simmer_tui.sim.angles import FloatArray

_PROBES = 3
_LEVERAGES = 16
"""Random vectors for each error size, and for the leverages."""


def noise_scale_score(
    model: Model, state: Iterate, rows: Rows, posterior: Posterior, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Gradient and expected information of the restricted likelihood, and of the priors, with respect
    to the logarithms of the error sizes."""
    sizes = model.space.noise_scales
    shares = rows.shares
    total = len(rows.residuals)
    root = np.sqrt(rows.weights)
    probes = random.choice((-1.0, 1.0), (total, _LEVERAGES))
    leverage = (posterior.projected(probes) * probes).mean(axis=1)
    leverage = np.clip(leverage, 0.0, 1.0)
    # With sizes as logarithms of standard deviations the derivative of a variance is twice its share.
    excess = rows.weights * rows.residuals**2 / rows.variances - (rows.weights - leverage)
    gradient = np.asarray(shares.T @ excess)
    columns = shares.tocsc()
    information = np.zeros((len(sizes), len(sizes)))
    vectors, owners = [], []
    for index in range(len(sizes)):
        mine = slice(columns.indptr[index], columns.indptr[index + 1])
        if mine.start == mine.stop:
            continue
        where = columns.indices[mine]
        vector = np.zeros((total, _PROBES))
        signs = random.choice((-1.0, 1.0), (len(where), _PROBES))
        vector[where] = np.sqrt(columns.data[mine])[:, None] * signs
        vectors.append(vector)
        owners.append(index)
    if vectors:
        stacked = np.concatenate(vectors, axis=1)
        left = root[:, None] ** 2 * stacked - posterior.projected(stacked)
        squares = np.asarray(shares.T @ left**2)  # sizes x (owners * probes)
        means = squares.reshape(len(sizes), len(owners), _PROBES).mean(axis=2)
        information[:, owners] = 2.0 * means
        information = (information + information.T) / 2
    # The second derivative is in sight of rounding for sizes without data; their priors hold them.
    spreads = np.array([each.spread for each in sizes])
    centres = np.log(np.array([each.prior for each in sizes]))
    information += np.diag(1.0 / spreads**2)
    gradient = gradient - (np.log(state.noise_scales) - centres) / spreads**2
    return gradient, information


def outliers_in(rows: Rows, state: Iterate) -> FloatArray:
    """Each sensor's share of outliers as its readings have it now."""
    outliers = state.outliers.copy()
    for index in range(len(outliers)):
        mine = (rows.family == RANGE) & (rows.source == index)
        count = int(mine.sum())
        if count:  # with half a reading's worth of doubt
            outliers[index] = (float((1.0 - rows.weights[mine]).sum()) + 0.5) / (count + 1.0)
    clipped: FloatArray = np.clip(outliers, 1e-4, 0.4)
    return clipped
