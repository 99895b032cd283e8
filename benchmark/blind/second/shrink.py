"""What share of a misfit the true effect makes, in the measure that the tool states.

docs/explanation/diagnosis.md has it: means over blocks of 4 ms, their root mean square over the
noise of one sample, and the root mean square of that over all channels; noise itself is no misfit.
The noise is that which the answer states, channel by channel.
"""

from collections.abc import Mapping
from typing import Any

from blind.robot import Array
from blind.second.ground import Departure
import numpy as np

BLOCK = 0.004
"""Of the tool's comparison [s]."""
CHANNELS = {
    'wrench': tuple(f'{what}.{axis}' for what in ('force', 'torque') for axis in 'xyz'),
    'volts': ('accel.x', 'accel.y', 'accel.z'), 'slide': ('optidrive',),
    'position': ('pose.x', 'pose.y', 'pose.z'), 'turn': ('pose.rx', 'pose.ry', 'pose.rz'),
    'joints': tuple(f'joint.{i}' for i in range(6))}
"""How an answer calls the channels of a topic."""


def mean_squares(values: Array, seconds: float) -> Array:
    """Return the mean square of block means of each channel of (n, k), evenly sampled."""
    each = max(1, round(BLOCK * len(values) / seconds))
    whole = len(values) // each * each
    blocks = values[:whole].reshape(-1, each, values.shape[1]).mean(axis=1)
    return np.asarray(np.mean(blocks**2, axis=0))


def true_shrink(base: Any, effect: Departure, beside: Departure, nuisance: str = '') -> float:
    """
    Return the share that who knows the effect closes.

    Parameters
    ----------
    base : generator
        With ``ground``, ``levels`` and ``judged_seconds``.
    effect, beside : mapping of str to ndarray
        Noise-free changes by the effect and by all else that is no nuisance.
    nuisance : str
        Of the effect's name; before the effect is known it takes up what its prior lets it.

    Returns
    -------
    float
        What nuisances take up counts on neither side; the strength of the effect is known to one
        standard error, which is the root of its energy.
    """
    energy = max(1.0, base.ground.net(effect, nuisance))
    alone, rest = base.ground.left(effect, nuisance), base.ground.left(beside)
    whole = base.ground.left({topic: effect[topic] + beside[topic] for topic in effect})
    explained = recalibrated = 0.0
    for topic, levels in base.levels.items():
        noise, seconds = levels**2, base.judged_seconds
        wrong = mean_squares(alone[topic], seconds) / energy
        explained += float(np.sum((mean_squares(rest[topic], seconds) + wrong) / noise))
        recalibrated += float(np.sum(mean_squares(whole[topic], seconds) / noise))
    return float(1.0 - np.sqrt(explained / recalibrated))


def squares(base: Any, effect: Departure, beside: Departure, nuisance: str = ''
            ) -> dict[str, list[float]]:
    """
    Return what :func:`closed` needs: mean squares with and without the effect, by channel.

    Parameters
    ----------
    base, effect, beside, nuisance
        See :func:`true_shrink`.
    """
    energy = max(1.0, base.ground.net(effect, nuisance))
    alone, rest = base.ground.left(effect, nuisance), base.ground.left(beside)
    whole = base.ground.left({topic: effect[topic] + beside[topic] for topic in effect})
    found = {}
    for topic, names in CHANNELS.items():
        if topic not in effect:
            continue
        seconds = base.judged_seconds
        left = mean_squares(rest[topic], seconds) + mean_squares(alone[topic], seconds) / energy
        for name, both in zip(names, zip(mean_squares(whole[topic], seconds), left)):
            found[name] = [float(one) for one in both]
    return found


def closed(found: Mapping[str, list[float]], noise: Mapping[str, float]) -> float:
    """Return the share that the effect makes by the noise of each channel that is compared."""
    both = np.array([found[name] for name in found if noise.get(name)])
    weights = np.array([noise[name] for name in found if noise.get(name)])
    recalibrated, explained = (both / weights[:, None]**2).sum(axis=0)
    return float(np.clip(1.0 - np.sqrt(explained / recalibrated), 0.0, 1.0))
