"""What the compiled filters remember: one type for all, because compiled code wants one."""

from math import inf, nan
from typing import NamedTuple

from forcecal_ros.observe.filters.noise_level import AS_CALIBRATED, NoiseLevel
from forcecal_ros.observe.sample import NO_WRENCH, Wrench
from forcecal_ros.observe.tracking import Vector, ZERO

KALMAN, NEWTON, UNFILTERED = range(3)
"""``Model.filter``; see :func:`forcecal_ros.observe.contact.filtered`."""


class NewtonState(NamedTuple):
    """Position [m] and velocity [m/s] of the tool along x, as the paper's observer has them."""

    x: float
    v: float


STOPPED = NewtonState(nan, nan)


class Memory(NamedTuple):
    """
    What a filter remembers of the last wrench that was used.

    Attributes
    ----------
    t : float
        Its stamp [s].
    contact : tuple of 6 float
        [N, N m]
    newton : NewtonState
        NaN where it is not running.
    axis : tuple of 3 float
        x of ft_sensor in base, which ``newton`` is along.
    noise : NoiseLevel
        As ``kalman`` hears it.
    """

    t: float = -inf
    contact: Wrench = NO_WRENCH
    newton: NewtonState = STOPPED
    axis: Vector = ZERO
    noise: NoiseLevel = AS_CALIBRATED
