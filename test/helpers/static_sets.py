"""Sound sets of static poses of a sensor and a tool that are drawn at random."""

from typing import NamedTuple

from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
STAND = 1.0
"""[s]"""


class Tool(NamedTuple):
    """Mass [kg], centre of mass [m], bias of the wrench [N, N m]."""

    mass: float
    com: np.ndarray
    bias: np.ndarray


def static_set(seed: int, rate: float = 0.0) -> tuple[Recording, Tool]:
    """
    Record 6 to 24 poses, with an accelerometer whose axes point anywhere.

    ``rate`` is that of the sensors [Hz]; 0: one sample a pose. Nothing is recorded between poses.
    """
    rng = np.random.default_rng(seed)
    n, samples = int(rng.integers(6, 25)), max(1, round(rate * STAND))
    tool = Tool(rng.uniform(0.3, 8.0), rng.normal(0.0, 0.04, 3),
                np.concatenate([rng.normal(0.0, 8.0, 3), rng.normal(0.0, 0.5, 3)]))
    R = Rotation.random(n, random_state=rng).as_matrix()
    P = Rotation.random(random_state=rng).as_matrix()
    noise = np.repeat([10**rng.uniform(-2.0, -0.5), 10**rng.uniform(-3.3, -2.0)], 3)
    gravity = -GRAVITY * R[:, 2]
    load = tool.mass * gravity
    wrench = np.hstack([load, np.cross(tool.com, load)]) + tool.bias
    t = (2.0 * STAND * np.arange(n)[:, None] + np.arange(samples) / max(rate, 1.0)).ravel()
    each = np.repeat(np.arange(n), samples)
    drawn = rng.standard_normal((len(t), 9))
    return Recording(
        wrench=Stream(t, wrench[each] + noise * drawn[:, :6]),
        accelerometer=Stream(t, -gravity[each] @ P.T + 0.02 * drawn[:, 6:]),
        accelerometer_unit='m/s^2', pose=PoseStream(t, np.full((len(t), 3), np.nan), R[each]),
        phases=tuple(phase for i in range(n) for phase in (
            Phase('measure', 2.0 * STAND * i, 2.0 * STAND * i + STAND),
            Phase('settle', 2.0 * STAND * i + STAND, 2.0 * STAND * (i + 1))))), tool
