"""When a simulated tool touches something: what two recordings cannot compare."""

from forcecal_ros.geometry import Array
from forcecal_ros.simulators.signals import BLOCK
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

FORCE = 1.0
"""From which a force beyond a rigid tool's is contact, at least [N]: six times a UR's noise."""

OUT = 8.0
"""And in the median deviation of what is beyond: a simulator's noise hardly ever shows that."""

AROUND = 0.2
"""Left out before and after [s]: a robot 10 mm/s fast and 1 mm off touches 0.1 s earlier."""

MOST = 0.5
"""Part of a recording that may be left out; what is more is no contact but another wrench."""


def touches(beyond: Array) -> NDArray[np.bool_]:
    """
    Tell blocks in which a simulated tool touches something, and what is near them.

    Parameters
    ----------
    beyond : ndarray, shape (n, 6)
        Block means of the simulated wrench beyond a rigid tool's.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    force = np.linalg.norm(beyond[:, :3] - np.median(beyond[:, :3], axis=0), axis=1)
    limit = max(FORCE, OUT * 1.4826 * float(np.median(np.abs(force - np.median(force)))))
    near = maximum_filter1d((force > limit).astype(np.int8), 2 * round(AROUND / BLOCK) + 1) > 0
    return near if near.mean() <= MOST else np.zeros(len(force), dtype=bool)
