"""Whether an effect still counts once noise may be slower than its model's few lags reach."""

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.geometry import Array
import numpy as np

SPANS = ((1, 16), (16, 64), (64, 256), (256, 1024))
"""Past blocks whose means predict slow noise, from and up to."""


def slow_gain(before: Problem, after: Problem) -> float:
    """
    Log-likelihood that an effect brings where the noise may have a long memory.

    A drift, a cable and the like look as 1/f noise does. So both residuals, whitened alike, may
    be predicted from the means of their own past (a heterogeneous autoregression) before they
    are compared.

    Parameters
    ----------
    before, after : Problem
        Without and with the effect, each at its best fit.

    Returns
    -------
    float
    """
    total = 0.0
    for noise, r0, r1 in zip(after.noise, before.blocks, after.blocks):
        for c in range(len(CHANNELS)):
            rows = noise.rows[:, c] & noise.sigma[noise.groups, c].astype(bool)
            if not rows.any() or np.array_equal(r0[:, c], r1[:, c]):
                continue
            white = noise.whiten(np.stack([r0[:, c], r1[:, c]]), c)
            rests = [_unpredicted(w, rows) for w in white]
            total += 0.5 * int(rows.sum()) * float(np.log(rests[0] / rests[1]))
    return total


def _unpredicted(white: Array, rows: Array) -> float:
    """Sum of squares that the means of the past do not predict."""
    sums = np.concatenate([[0.0], np.cumsum(white)])
    now = np.arange(len(white))
    past = np.stack([(sums[np.maximum(now - first + 1, 0)] - sums[np.maximum(now - last + 1, 0)])
                     / (last - first) for first, last in SPANS], axis=1)[rows]
    w = white[rows]
    gram = past.T @ past + 1e-9 * np.eye(len(SPANS))
    vector = past.T @ w
    return float(w @ w - vector @ np.linalg.solve(gram, vector))
