"""What the chain answers: one sample for each wrench, and the same over a whole recording."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.status import INVALID
import numpy as np
from numpy.typing import NDArray

Wrench = tuple[float, float, float, float, float, float]
"""Force [N] and torque [N m]."""

NO_WRENCH: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Learned(NamedTuple):
    """
    What a filter that estimates the wrench biases says of itself.

    Shapes are those of one sample; over a recording each has the samples first.

    Attributes
    ----------
    std : ndarray, shape (6,)
        Standard error of the contact wrench [N, N m].
    bias, bias_std : ndarray, shape (6,)
        Reading without any load, and its standard error [N, N m].
    correlation : ndarray, shape (6,)
        Of each wrench component with its bias; 0 where the biases are no states.
    nis : float, or ndarray
        Normalised innovation squared of "nothing touches": chi-square with 6 degrees of freedom
        where that is true, large in contact. NaN where the wrench was not used.
    touching : bool, or ndarray
        Whether contact is assumed, and the biases are kept as they were.
    """

    std: Array
    bias: Array
    bias_std: Array
    correlation: Array
    nis: Any
    touching: Any


class ContactSample(NamedTuple):
    """
    What one wrench was found to hold; all in ft_sensor, about its origin, environment on tool.

    Attributes
    ----------
    t : float
        Stamp of the wrench [s].
    contact : tuple of 6 float
        Contact wrench [N, N m]; the last estimate where the status is ``INVALID``.
    status : int
        Bits of :mod:`forcecal_ros.observe.status`.
    measured : tuple of 6 float
        Contact wrench before the filter: wire - bias - inertial (the paper's u - m a).
    innovation : tuple of 6 float
        ``measured`` less what the filter expected; zero where it expected nothing.
    inertial : tuple of 6 float
        What weight and motion of the tool put on the wire.
    learned : Learned or None
        Of filters ``ukf`` and ``ekf``, and without a pose.
    """

    t: float
    contact: Wrench
    status: int
    measured: Wrench
    innovation: Wrench
    inertial: Wrench
    learned: Learned | None


class ByImu(NamedTuple):
    """
    What a chain without a pose found besides; the samples first.

    Attributes
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    mass, mass_std : ndarray, shape (n,)
        Of the tool with its payload [kg].
    """

    gravity: Array
    mass: Array
    mass_std: Array


@dataclass(frozen=True)
class ContactEstimate:
    """
    Contact wrench over time, one row for every wrench; see :class:`ContactSample`.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Stamps of the wrench [s].
    contact, measured, innovation, inertial : ndarray, shape (n, 6)
        [N, N m]
    status : ndarray of int, shape (n,)
    dropped : tuple of int, length 4
        Messages not used: wrench, accelerometer, pose, displacement.
    learned : Learned or None
        Its arrays have n rows.
    by_imu : ByImu or None
    """

    t: Array
    contact: Array
    measured: Array
    innovation: Array
    inertial: Array
    status: NDArray[np.int64]
    dropped: tuple[int, ...] = (0, 0, 0, 0)
    learned: Learned | None = None
    by_imu: ByImu | None = None

    def __post_init__(self) -> None:
        arrays: list[Any] = [self.contact, self.measured, self.innovation, self.inertial,
                             self.status, *(self.learned or ()), *(self.by_imu or ())]
        for array in arrays:
            array.setflags(write=False)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which rows are an answer to their own wrench, not the last estimate repeated."""
        return np.asarray(self.status & INVALID == 0)


def stacked(rows: list[Learned]) -> Learned:
    """Put those of many samples together."""
    return Learned(*(np.array(column) for column in zip(*rows)))


Progress = Callable[[int], object]
"""Told by a long replay how many samples were done since it was told last."""


def silent(samples: int) -> None:
    """Show no progress."""
