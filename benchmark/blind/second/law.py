"""A discrepancy: what it needs to know of a motion, and what it adds to the signals."""

from collections.abc import Callable
from typing import NamedTuple

from blind.robot import Array
import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

Random = np.random.Generator
WRENCH_SCALE = np.repeat([1.0, 0.08], 3)
"""Forces and torques in the proportion of a sensor's noise."""


class Moved(NamedTuple):
    """
    How the nominal tool moves and what it feels, on one grid of time.

    Attributes
    ----------
    t : ndarray, shape (n,)
    R : ndarray, shape (n, 3, 3)
        Sensor to base.
    position, velocity, acceleration : ndarray, shape (n, 3)
        Of S in base; zero where nothing measures a position.
    omega, alpha, force : ndarray, shape (n, 3)
        In S; specific force at S [m/s^2].
    wrench : ndarray, shape (n, 6)
        On the wire without bias.
    contact : ndarray, shape (n, 3)
        In S [N].
    mass : float
    com : ndarray, shape (3,)
    index : int
        Of the recording in its case.
    """

    t: Array
    R: Array
    position: Array
    velocity: Array
    acceleration: Array
    omega: Array
    alpha: Array
    force: Array
    wrench: Array
    contact: Array
    mass: float
    com: Array
    index: int  # type: ignore[assignment]  # no one counts in a motion

    @property
    def dt(self) -> float:
        """Between two instants [s]."""
        return float(self.t[1] - self.t[0])

    @property
    def turned(self) -> Array:
        """Rotation vector since the start [rad], (n, 3)."""
        return np.asarray(Rotation.from_matrix(self.R[0].T @ self.R).as_rotvec())

    @property
    def up(self) -> Array:
        """Unit vector upwards, in S, (n, 3)."""
        return self.R[:, 2, :]

    @property
    def load(self) -> float:
        """What the sensor carries at most, roughly [N]."""
        return 9.81 * self.mass + 50.0 * bool(self.contact.any())

    def in_sensor(self, v: Array) -> Array:
        """Turn vectors of base (n, 3) into S."""
        return np.asarray(np.einsum('nji,nj->ni', self.R, v))


class Added(NamedTuple):
    """What is added: wrench (n, 6), specific force (n, 3) in S, position in base (n, 3)."""

    wrench: Array
    accel: Array
    position: Array

    def times(self, scale: float) -> 'Added':
        """Return so many times as much."""
        return Added(*(scale * one for one in self))

    def plus(self, other: 'Added') -> 'Added':
        """Return both together."""
        return Added(*(a + b for a, b in zip(self, other)))


Law = Callable[[Moved], Added]


class Kind(NamedTuple):
    """
    One kind of discrepancy.

    Attributes
    ----------
    draw : callable
        Randomness -> law; amplitudes are arbitrary.
    alias : tuple of str
        Effects of the library that it resembles: to name them is neither right nor false.
    wants : frozenset of str
        ``accel``, ``contact``, ``position``: what a generator must have for it to show.
    """

    draw: Callable[[Random], Law]
    alias: tuple[str, ...] = ()
    wants: frozenset[str] = frozenset()


def added(m: Moved, force: Array | float = 0.0, torque: Array | float = 0.0,
          accel: Array | float = 0.0, position: Array | float = 0.0) -> Added:
    """Put parts where they belong; those that are not given are zero."""
    zero = np.zeros((len(m.t), 3))
    return Added(np.hstack([zero + force, zero + torque]), zero + accel, zero + position)


def in_wrench(m: Moved, course: Array) -> Added:
    """Add a course (n, 6) to the wrench."""
    return added(m, course[:, :3], course[:, 3:])


def tilted(m: Moved, turn: Array) -> Added:
    """Meet gravity and inertia with a tool that is turned by a small rotation vector in S."""
    change = np.cross(m.force, turn)
    return added(m, -m.mass * change, np.cross(m.com, -m.mass * change), change)


def shaken(m: Moved, acceleration: Array) -> Added:
    """Accelerate the whole tool by so much more, in S."""
    return added(m, -m.mass * acceleration, np.cross(m.com, -m.mass * acceleration), acceleration)


def unit(rng: Random, n: int = 3) -> Array:
    """Draw a unit vector."""
    v = rng.standard_normal(n)
    return np.asarray(v / np.linalg.norm(v))


def between(rng: Random, low: float, high: float) -> float:
    """Draw evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def lagged(x: Array, dt: float, time: float) -> Array:
    """Follow with a lag of first order, settled at first."""
    a = np.exp(-dt / time)
    return np.asarray(lfilter([1 - a], [1, -a], x - x[0], axis=0) + x[0])


def swung(x: Array, dt: float, hz: float, damping: float) -> Array:
    """Follow as a mode of unit static gain does, at rest at first."""
    w = 2 * np.pi * hz * dt
    pole = np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * w)
    a = [1.0, -2 * pole.real, abs(pole)**2]
    return np.asarray(lfilter([sum(a)], a, x - x[0], axis=0) + x[0])
