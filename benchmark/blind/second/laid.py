"""Effects of a wrench's sensor, in the rig's forms, on any wrench."""

from types import SimpleNamespace
from typing import Any

from blind.effect import Effect
from blind.rig import nominal
from blind.robot import Array
from blind.sensors import FINE
import numpy as np

SMALLER = 10.0
"""By which the loads of a tool of about a kilogram are smaller than those of the rig's 13 kg."""

ON_WRENCH = ('wrench_bias_drift', 'wrench_crosstalk', 'wrench_delay', 'wrench_gain',
             'wrench_hysteresis', 'wrench_lowpass')
"""Effects that need nothing but the wrench."""


def laid_on(effect: Effect, size: float, seed: int, t: Array, wrench: Array) -> Array:
    """
    Return what an effect changes of a wrench without bias.

    Parameters
    ----------
    effect : Effect
        One of :data:`ON_WRENCH`.
    size : float
        As on the rig; forces of it count a tenth.
    seed : int
    t : ndarray, shape (n,)
        From zero on.
    wrench : ndarray, shape (n, 6)
    """
    rig = effect.apply(nominal(), size, np.random.default_rng(seed))
    fine = np.arange(0.0, t[-1] + FINE, FINE)
    before = SMALLER * np.stack([np.interp(fine, t, one) for one in wrench.T], axis=1)
    after: Any = before * rig.sensors.gain
    for stage in rig.sensors.wrench:
        after = stage(SimpleNamespace(t=fine), after, np.random.default_rng(seed))
    change = (after - before) / SMALLER
    return np.stack([np.interp(t, fine, one) for one in change.T], axis=1)
