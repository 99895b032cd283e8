"""Mass, stiffness and damping of the tool on its slide, [Gamez2005] Eq. 29, by least squares.

In free motion without turning, with F the force on the wire and a the tool's acceleration,

    F = k s + d ds/dt + b1        F = -m a + b2        a = d2(x_rb + s)/dt2

Each is weighted by smooth windows w and integrated by parts, int w ds/dt = -int dw/dt s, so that
nothing noisy is differentiated. The force, whose noise is the smallest, is the instrument
(two-stage least squares): noise in s and x_rb then biases nothing.
"""

from typing import NamedTuple

from forcecal_ros.calibration.model import Estimate
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.impedance.plant.model import Slide
import numpy as np

WINDOW = 0.1
"""Length of a weighting window [s]."""

SPACING = 0.75
"""Distance of window starts in window lengths; closer windows would share their errors."""

FEWEST = 50
"""Fewest windows that a slide is identified from."""

SURE = 3.0
"""Standard errors below zero from which a spring or a mass has the opposite sign."""


class Signal(NamedTuple):
    """One signal with its stamps: t, values, shape (n,)."""

    t: Array
    values: Array


class SlideFit(NamedTuple):
    """
    An identified slide.

    Attributes
    ----------
    spring_error, inertia_error : float
        RMS residual of the force over the windows, by spring and damper and by the mass [N].
    """

    slide: Slide
    windows: int
    spring_error: float
    inertia_error: float


def identify_slide(force: Signal, slide: Signal, position: Signal) -> SlideFit:
    """
    Identify mass, stiffness and damping, [Gamez2005] Eq. 29.

    Parameters
    ----------
    force : Signal
        Along x of ft_sensor, environment on tool as on the wire [N].
    slide : Signal
        Displacement of the tool against S [m].
    position : Signal
        Of S along x of ft_sensor [m].

    Raises
    ------
    DataError
        Too short, or no motion that tells them.
    """
    begin = max(signal.t[0] for signal in (force, slide, position))
    end = min(signal.t[-1] for signal in (force, slide, position))
    starts = np.arange(begin, end - WINDOW, SPACING * WINDOW)
    if len(starts) < FEWEST:
        raise DataError(f'{max(0.0, end - begin):.1f} s of force, displacement and pose in common '
                        f'do not tell the slide; record {FEWEST * SPACING * WINDOW:.0f} s or more')
    f, df, _ = _weighted(force, starts)
    s, ds, dds = _weighted(slide, starts)
    one = np.ones(len(starts))
    acceleration = dds + _weighted(position, starts)[2]
    spring, spring_std, spring_error = _two_stage(
        np.column_stack([s, ds, one]), f, np.column_stack([f, df, one]))
    mass, mass_std, inertia_error = _two_stage(
        np.column_stack([-acceleration, one]), f, np.column_stack([f, one]))
    if not (spring[:2] > 0.0).all() or not mass[0] > 0.0:
        turned = spring[0] < -SURE * spring_std[0] or mass[0] < -SURE * mass_std[0]
        raise DataError(f'mass {mass[0]:.3g} kg, stiffness {spring[0]:.3g} N/m and damping '
                        f'{spring[1]:.3g} N s/m come out; ' + (
                            'force and displacement have opposite signs: give --wrench-sign the '
                            'other sign' if turned else 'the slide hardly moves: shake the tool '
                            'more'))
    return SlideFit(
        Slide(Estimate(mass[0], mass_std[0], 'kg'), Estimate(spring[0], spring_std[0], 'N/m'),
              Estimate(spring[1], spring_std[1], 'N s/m')),
        len(starts), spring_error, inertia_error)


def _weighted(signal: Signal, starts: Array) -> tuple[Array, Array, Array]:
    """Return the windows' means of a signal, of its rate and of the rate of that."""
    edges = np.searchsorted(signal.t, [starts, starts + WINDOW])
    means = np.empty((len(starts), 3))
    for i, (first, last) in enumerate(edges.T):
        if last - first < 8:
            raise DataError(f'{last - first} samples in {WINDOW:g} s at {starts[i]:.2f} s; at '
                            'least 8 are wanted: record without gaps')
        angle = np.pi / WINDOW * (signal.t[first:last] - starts[i])
        sine, cosine = np.sin(angle), np.cos(angle)
        rate = np.pi / WINDOW
        weights = np.stack([sine**4, -4.0 * rate * sine**3 * cosine,
                            4.0 * rate**2 * sine**2 * (3.0 * cosine**2 - sine**2)])
        means[i] = weights @ signal.values[first:last] / weights[0].sum()
    return means[:, 0], means[:, 1], means[:, 2]


def _two_stage(columns: Array, values: Array, instruments: Array) -> tuple[Array, Array, float]:
    """Solve columns theta = values; return theta, its standard errors and the RMS residual."""
    columns_size, instruments_size = (np.linalg.norm(a, axis=0) for a in (columns, instruments))
    X, Z = columns / columns_size, instruments / instruments_size
    cross = Z.T @ X
    if np.linalg.cond(cross) > 1e8:
        raise DataError('force and displacement do not change; shake the tool along x of '
                        'ft_sensor')
    inverse = np.linalg.inv(cross)
    theta = inverse @ (Z.T @ values)
    residual = values - X @ theta
    variance = residual @ residual / (len(values) - len(theta))
    covariance = variance * inverse @ (Z.T @ Z) @ inverse.T
    return (theta / columns_size, np.sqrt(np.diag(covariance)) / columns_size,
            float(np.sqrt(variance)))
