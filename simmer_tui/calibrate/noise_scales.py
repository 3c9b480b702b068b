"""The noise scales: standard deviations of random errors, by restricted maximum likelihood.

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
"""Random vectors for each noise scale, and for the leverages."""
# The information is for the step's length alone, so that few do. Leverages move the estimates: with 16
# vectors a row's is known to a quarter, and a scale's, from some 50 rows, to a thirtieth.


def noise_scale_score(
    model: Model, state: Iterate, rows: Rows, posterior: Posterior, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Gradient and expected information of the restricted likelihood, and of the priors, with respect
    to the logarithms of the noise scales.

    Returns:
        The gradient, (k,), and the information, (k, k).
    """
    scales = model.space.noise_scales
    shares = rows.shares
    total = len(rows.residuals)
    root = np.sqrt(rows.weights)
    probes = random.choice((-1.0, 1.0), (total, _LEVERAGES))
    leverage = (posterior.projected(probes) * probes).mean(axis=1)
    leverage = np.clip(leverage, 0.0, 1.0)
    # By the logarithm of a standard deviation the derivative of a variance is twice its share. The expected
    # square of a residual is what is left of its variance after the fit: its weight less its leverage.
    excess = rows.weights * rows.residuals**2 / rows.variances - (rows.weights - leverage)
    gradient = np.asarray(shares.T @ excess)
    columns = shares.tocsc()
    information = np.zeros((len(scales), len(scales)))
    vectors, owners = [], []
    for index in range(len(scales)):
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
        squares = np.asarray(shares.T @ left**2)  # scales x (owners * probes)
        means = squares.reshape(len(scales), len(owners), _PROBES).mean(axis=2)
        information[:, owners] = 2.0 * means
        information = (information + information.T) / 2
    # For scales without data the information is only rounding; their priors hold them.
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
        # Half an outlier in one reading more: the middle of Jeffreys' prior, so that no share is ever 0.
        if count:
            outliers[index] = (float((1.0 - rows.weights[mine]).sum()) + 0.5) / (count + 1.0)
    # Above 0.4 the mixture could take the outliers for the readings.
    clipped: FloatArray = np.clip(outliers, 1e-4, 0.4)
    return clipped
