"""Result of the chain: one sample for each wrench, its status bits, and whole recordings."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, NamedTuple, TypeVar

from forcecal_ros.core.geometry import Array, Vector
import numpy as np
from numpy.typing import NDArray


class Status(IntFlag):
    """What was missing or wrong, one bit each; 0 when all is well."""

    OK = 0
    NO_ACCELEROMETER = 1
    NO_POSE = 2
    NO_POSITION = 4
    DISPLACEMENT_FROM_FORCE = 8
    OFFSET_HELD = 16
    NO_GRAVITY = 32
    BAD_WRENCH = 64
    RESTARTED = 128
    SATURATED = 256
    NO_GYRO = 512
    NOISY = 1024


# plain integers, because compiled code knows no IntFlag
(NO_ACCELEROMETER, NO_POSE, NO_POSITION, DISPLACEMENT_FROM_FORCE, OFFSET_HELD, NO_GRAVITY,
 BAD_WRENCH, RESTARTED, SATURATED, NO_GYRO, NOISY) = map(int, filter(None, Status))

INVALID = NO_GRAVITY | BAD_WRENCH
"""With one of these the contact wrench is not to be used: it repeats the last estimate."""

DEGRADED = NO_ACCELEROMETER | NO_POSE | RESTARTED | SATURATED | NO_GYRO | NOISY
"""With one of these it is less accurate than the calibration promises."""


_TEXT = {
    NO_ACCELEROMETER: 'no accelerometer: acceleration from the pose, slower and noisier; without '
                      'a pose, gravity from the gyro alone',
    NO_POSE: 'no pose: no rotation is assumed, gravity comes from the accelerometer',
    NO_POSITION: 'the pose holds no position',
    DISPLACEMENT_FROM_FORCE: 'no displacement sensor: the spring force replaces it',
    OFFSET_HELD: 'the accelerometer offset is frozen, not tracked',
    NO_GRAVITY: 'weight unknown: neither pose nor accelerometer shows gravity; the last estimate '
                'is repeated',
    BAD_WRENCH: 'the wrench is not finite or too large; the last estimate is repeated',
    RESTARTED: 'the filter was restarted after a pause or a numerical failure',
    SATURATED: 'a sensor is at the end of its range',
    NO_GYRO: 'no gyro: gravity is tracked with the accelerometer only',
    NOISY: 'the wrench is noisier than calibrated: the filter is slower than designed',
}


def describe(status: int) -> tuple[str, ...]:
    """Return one sentence for each bit that is set; none when all is well."""
    return tuple(text for bit, text in _TEXT.items() if status & bit)


def level(status: int) -> str:
    """Return ``error``, ``warn`` or ``ok``, as diagnostics need it."""
    if status & INVALID:
        return 'error'
    return 'warn' if status & DEGRADED else 'ok'


def saturated(values: tuple[float, ...], limits: tuple[float, ...]) -> bool:
    """Whether a reading is at the end of its sensor's range; limits infinite where unknown."""
    for value, limit in zip(values, limits):
        if abs(value) >= limit:
            return True
    return False


MAX_READING = 1e6
"""A larger value is not a reading, in N, N m, V, m/s^2 or m: no wrist sensor reads a
meganewton."""

Wrench = tuple[float, float, float, float, float, float]
"""Force [N] and torque [N m]."""

NO_WRENCH: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Unloaded(NamedTuple):
    """
    One wrench as the filters take it in.

    Attributes
    ----------
    t : float
        Stamp [s].
    status : int
        Bits of :mod:`forcecal_ros.observe.status`; ``INVALID``: all else is zero.
    measured : tuple of 6 float
        Wire - bias - inertial [N, N m].
    inertial : tuple of 6 float
        What weight and motion of the tool put on the wire [N, N m].
    f : tuple of 3 float
        Specific force at the accelerometer, as far as it counts [m/s^2].
    """

    t: float
    status: int
    measured: Wrench
    inertial: Wrench
    f: Vector


class Learned(NamedTuple):
    """
    Quality of a filter that estimates the wrench biases.

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
    What a chain without a pose also finds.

    Shapes are those of one sample; over a recording each has the samples first.

    Attributes
    ----------
    gravity : ndarray, shape (3,)
        In ft_sensor [m/s^2].
    mass, mass_std : float, or ndarray
        Of the tool with its payload [kg].
    """

    gravity: Array
    mass: Any
    mass_std: Any


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


Quality = TypeVar('Quality', Learned, ByImu)


def stacked(rows: list[Quality]) -> Quality:
    """Put those of many samples together."""
    return type(rows[0])(*(np.array(column) for column in zip(*rows)))


Progress = Callable[[int], object]
"""Called by a long replay with the number of samples done since its last call."""


def silent(samples: int) -> None:
    """Show no progress."""
