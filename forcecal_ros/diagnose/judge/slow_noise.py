"""What likelihood ratios are where the noise may have a long memory."""

from collections.abc import Callable, Iterator, Sequence

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import unpredicted
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.linearised import LinearisedModel
import numpy as np
from numpy.typing import NDArray


def long_memory_likelihood_ratio(before: LinearisedModel, after: LinearisedModel) -> float:
    """
    Log-likelihood that an effect brings where the noise may have a long memory.

    A drift, a cable and the like look as 1/f noise does. So both residuals, whitened by the
    same filter, may be predicted from the means of their own past (a heterogeneous
    autoregression) before they are compared.

    Parameters
    ----------
    before, after : LinearisedModel
        Without and with the effect, each at its best fit.
    """
    return _likelihood_ratio(before, after, unpredicted)


def of_slow_noise(before: LinearisedModel, after: LinearisedModel) -> float:
    """
    Log-likelihood that is gained by following noise whose memory is long, and by that alone.

    Parameters
    ----------
    before, after : LinearisedModel
        Without and with what follows it.
    """
    def squares(white: Array, rows: NDArray[np.bool_]) -> float:
        return float(np.sum(white[rows] ** 2))

    return max(0.0, _likelihood_ratio(before, after, squares)
               - long_memory_likelihood_ratio(before, after))


def held_out_likelihood_ratio(before: LinearisedModel, after: LinearisedModel) -> float:
    """
    Log-likelihood of the held-out blocks that is gained, noise as it is.

    Parameters
    ----------
    before, after : LinearisedModel
        Without and with what was fitted to the training blocks.
    """
    total = 0.0
    for i, rows, white in _whitened(after, before.residuals, after.residuals):
        squares = np.sum(white[:, rows & after.datasets[i].held] ** 2, axis=1)
        total += 0.5 * float(squares[0] - squares[1])
    return total


def _whitened(model: LinearisedModel, *residuals: Sequence[Array]
              ) -> Iterator[tuple[int, NDArray[np.bool_], Array]]:
    """
    Whiten residuals of each recording and channel by a model's noise, where they differ.

    Yields
    ------
    recording : int
    rows : ndarray of bool, shape (n,)
        Samples that count.
    white : ndarray, shape (residuals, n)
    """
    for i, (noise, *own) in enumerate(zip(model.noise, *residuals)):
        for c in range(len(CHANNELS)):
            rows = noise.rows[:, c] & noise.sigma[noise.groups, c].astype(bool)
            stack = np.stack([one[:, c] for one in own])
            if rows.any() and not (stack == stack[0]).all():
                yield i, rows, noise.whiten(stack, c)


def _likelihood_ratio(before: LinearisedModel, after: LinearisedModel,
                      unexplained: Callable[[Array, NDArray[np.bool_]], float]) -> float:
    """Compare whitened residuals by the squares of each channel that remain unexplained."""
    total = 0.0
    for _, rows, white in _whitened(after, before.residuals, after.residuals):
        rests = [unexplained(w, rows) for w in white]
        total += 0.5 * int(rows.sum()) * float(np.log(rests[0] / rests[1]))
    return total
