"""Whether an effect still counts once noise may be slower than its model's few lags reach."""

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.recording.noise.long_memory import unpredicted
import numpy as np


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
            rests = [unpredicted(w, rows) for w in white]
            total += 0.5 * int(rows.sum()) * float(np.log(rests[0] / rests[1]))
    return total
