"""Sudden steps in a residual: levels that jump from one sample to the next and stay there."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np
from numpy.typing import NDArray

SPANS = (25, 125)
"""Samples on either side that a jump is measured on: 0.1 and 0.5 s of the usual blocks of 4 ms."""

SUDDEN = 8.0
"""
Jump, in its standard error, from which it is one.

White and 1/f noise of 16 channels for ten minutes stay below 7; 0.5 N on the nominal rig is 15.
"""

STAYS = (0.5, 1.6)
"""Change of the mean over the time around, in that jump, within which the level stays."""

AROUND = 500
"""Samples before and after of that time, 2 s of the usual blocks; fewer where there are fewer."""

MOST, TRIED = 3, 8
"""
Steps of one channel; where more seem to be, it is something else that jumps. Jumps that are
looked at: impulses look like jumps until it shows that they do not stay.
"""


class Step(NamedTuple):
    """
    One step of one channel.

    Attributes
    ----------
    first : int
        First sample behind it.
    height : float
    std : float
        Of the height, by its surroundings.
    """

    first: int
    height: float
    std: float


def steps(values: Array) -> list[Step]:
    """
    Find the steps of a series, the largest first.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Evenly spaced.

    Returns
    -------
    list of Step
        Empty where there are more than MOST.
    """
    found: list[Step] = []
    flat = values - values.mean() if len(values) else values
    looked_at = np.zeros(len(values) + 1, dtype=bool)
    for _ in range(TRIED):
        step = _largest(flat, looked_at)
        if step is None:
            break
        looked_at[max(0, step.first - SPANS[-1]):step.first + SPANS[-1]] = True
        if _stays(flat, step):
            found.append(step)
            flat = flat - step.height * (np.arange(len(flat)) >= step.first)
    return found if len(found) <= MOST else []


def without_steps(residual: Array, present: NDArray[np.bool_]) -> Array:
    """
    Level a residual out, so that noise can be estimated on it.

    Parameters
    ----------
    residual : ndarray, shape (n, channels)
    present : ndarray of bool, shape (n, channels)

    Returns
    -------
    ndarray, shape (n, channels)
    """
    out = residual
    for c in range(residual.shape[1]):
        there = np.flatnonzero(present[:, c])
        for step in steps(residual[there, c]):
            out = out.copy() if out is residual else out
            out[there[step.first:], c] -= step.height
    return out


def _largest(values: Array, looked_at: NDArray[np.bool_]) -> Step | None:
    """Return the most significant jump, if there is one, where none was looked at yet."""
    best, most = None, SUDDEN
    for span in SPANS:
        if len(values) < 4 * span:
            continue
        jump = _jumps(values, span)
        std = max(1.4826 * float(np.median(np.abs(jump))), 1e-9 * float(np.ptp(values)), 1e-300)
        jump = np.where(looked_at[span:len(values) - span + 1], 0.0, jump)
        i = int(np.abs(jump).argmax())
        if abs(jump[i]) > most * std:
            best, most = Step(i + span, float(jump[i]), std), abs(jump[i]) / std
    return best


def _jumps(values: Array, span: int) -> Array:
    """
    Fit a line with a jump to the samples around each, shape (n - 2 span + 1,).

    The jump is a weighted sum of differences between both sides and of products with time.
    """
    n, t = len(values), np.arange(len(values), dtype=float)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    moments = np.concatenate([[0.0], np.cumsum(t * values)])
    at = np.arange(span, n - span + 1)
    sides = sums[at + span] - 2.0 * sums[at] + sums[at - span]
    middle = at - 0.5
    products = moments[at + span] - moments[at - span] - middle * (
        sums[at + span] - sums[at - span])
    local = np.arange(-span, span) + 0.5
    sign = np.sign(local)
    normal = np.array([[len(local), sign @ local], [sign @ local, local @ local]])
    weights = 2.0 * np.linalg.inv(normal)[0]
    return np.asarray(weights[0] * sides + weights[1] * products)


def _stays(values: Array, step: Step) -> bool:
    """Say whether the level is another one for a while."""
    before = values[max(0, step.first - AROUND):step.first]
    after = values[step.first:step.first + AROUND]
    change = (np.median(after) - np.median(before)) / step.height
    return bool(STAYS[0] < change < STAYS[1])
