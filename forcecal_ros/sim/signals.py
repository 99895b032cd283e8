"""What any simulation provides: the signals that noise-free sensors would give."""

from collections.abc import Callable, Hashable, Mapping
from typing import Generic, NamedTuple, Protocol, TypeVar

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Stream
from forcecal_ros.effects import AccelerometerEffects, Effect
from forcecal_ros.effects.nuisances import Nuisance
from forcecal_ros.effects.rig import Rig
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

T = TypeVar('T')

LEAST, MOST = 1.0, 12.5
"""Clear band, at least and at most [Hz]: above, arm and gripper ring, and no tool is rigid."""

WINDOW_S = 4.0
"""Length of the windows over which spectra are averaged [s]: a quarter of LEAST apart."""

EXACT, KEPT = 2.0, 1.25
"""
Bands of filters, in that of a signal, which leave it as it is, or 97 % of it at its edge.

An effect that acts on what a wider filter leaves would reduce noise, and be named for that.
"""

STEEP = 8
"""Order of filters that end near what is clear: others are of order 4."""

CLEAR = 10.0
"""Factor above its floor from which the power of a signal is no noise."""


def clear_band(rows: Array, rate: float, wide: float = 1.0) -> float:
    """Return where :func:`clear_of` ends [Hz]."""
    return _band_and_noise(rows, rate, wide)[0]


def _band_and_noise(rows: Array, rate: float, wide: float) -> tuple[float, Array]:
    """
    Tell where signals' spectrum comes down to its floor, and the density of each one's noise.

    Derivatives of what lies above would be noise, in the residual and in what is fitted to it
    alike: an effect of a smooth signal would be preferred for that alone.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        At regular instants.
    rate : float
        [Hz]
    wide : float
        What the band is multiplied by.

    Returns
    -------
    float
        [Hz]; MOST, whatever ``wide`` is, where no floor is to be seen.
    ndarray, shape (k,)
        0 there.
    """
    if rate < 5.0 * MOST or len(rows) < WINDOW_S * rate:
        return MOST, np.zeros(rows.shape[1])
    frequency, power = spectrum(rows, rate)
    noise = np.median(power[frequency > 2.0 * MOST], axis=0)
    clear = frequency[(power.sum(axis=1) > CLEAR * noise.sum()) & (frequency > 0.0)]
    return wide * float(np.clip(clear.max(initial=0.0), LEAST, MOST)), noise


POWER_WINDOW_S = 0.1
"""Standard deviation of the window over which power is averaged [s]: a shake lasts longer."""


def clear_share(rows: Array, noise: Array, rate: float) -> Array:
    """
    Tell how much of signals is no noise, instant by instant: one motion excites all of them.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        At regular instants.
    noise : ndarray, shape (k,)
        Mean square of each one's noise.
    rate : float
        [Hz]

    Returns
    -------
    ndarray, shape (n,)
        From 0, where they may be noise, to 1 from twice CLEAR on.
    """
    power = gaussian_filter1d(rows ** 2, POWER_WINDOW_S * rate, axis=0)
    ratio = (power / np.maximum(noise, 1e-300)).max(axis=1)
    return np.asarray(np.clip(ratio / CLEAR - 1.0, 0.0, 1.0))


class LowPass(NamedTuple):
    """
    A filter without lag that may vary with time.

    Attributes
    ----------
    band : float
        Where it ends [Hz].
    t, share : ndarray, shape (n,), optional
        Instants [s], and how much it leaves there of what is faster than LEAST.
    """

    band: float
    t: Array | None = None
    share: Array | None = None

    def of(self, t: Array, rows: Array, rate: float) -> Array:
        """Filter rows, at regular instants."""
        if self.t is None or self.share is None:
            return slow(rows, rate, self.band)
        slower, least = slow(rows, rate, self.band, STEEP), slow(rows, rate, LEAST)
        share = np.interp(t, self.t, self.share)[:, np.newaxis]
        return np.asarray(least + share * (slower - least))


def clear_of(rows: Array, rate: float, start: float, wide: float) -> LowPass:
    """
    Return the filter that leaves of a signal what is clear of its noise.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        At regular instants, from ``start`` [s] on.
    rate : float
        [Hz]
    wide : float
        Band of the filter in that of the signal: EXACT or KEPT.
    """
    band, noise = _band_and_noise(rows, rate, wide)
    fast = slow(rows, rate, band, STEEP) - slow(rows, rate, LEAST)
    return LowPass(band, start + np.arange(len(rows)) / rate,
                   clear_share(fast, noise * (band - LEAST), rate))


def spectrum(rows: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies [Hz], and the power density of signals there, shape (f, k)."""
    from scipy.signal import welch  # takes a second, which a node does not start with

    frequency, power = welch(rows, rate, nperseg=min(len(rows), int(WINDOW_S * rate)), axis=0)
    return np.asarray(frequency), np.asarray(power)


def slow(rows: Array, rate: float, band: float = MOST, order: int = 4) -> Array:
    """Leave out what is faster than a band; where samples are few, nothing is."""
    from scipy.signal import butter, sosfiltfilt  # takes a second, see spectrum

    if rate <= 2.0 * band or len(rows) < rate:
        return rows
    return np.asarray(sosfiltfilt(
        butter(order, band, fs=rate, output='sos'), rows, axis=0))


def slowed(stream: Stream, band: float = MOST) -> CubicSpline:
    """Return a stream as a function of time, without what is faster than a band [Hz]."""
    return CubicSpline(stream.t, slow(stream.values, stream.rate, band))


RATE = 1000.0
"""Rate of the simulated signals [Hz]."""

UNSEEN = ('wrench_quantisation', 'clock_skew', 'dropouts')
"""Effects that show in values and stamps, not in the mean of a signal."""

BLOCK = 0.004
"""Length of the blocks over whose means measured and simulated are compared [s]."""

JOINTS = 8
"""Joints whose positions can be compared: an arm of seven, and the rail that it stands on."""


class Last(Generic[T]):
    """The last of what takes long to compute and much memory to keep."""

    def __init__(self) -> None:
        self._key: object = None
        self._value: T | None = None

    def of(self, key: object, compute: Callable[[], T]) -> T:
        """Return what is computed by a key, or was the last time."""
        if self._value is None or self._key != key:
            self._value = None  # makes room
            self._key, self._value = key, compute()
        return self._value


class Signals(NamedTuple):
    """
    What noise-free sensors would say; sample i is the state at ``start + (i + 1) / RATE``.

    Attributes
    ----------
    start : float
        [s]
    wrench : ndarray, shape (n, 6)
        As on the wire [N], [N m].
    volts : ndarray, shape (n, 3)
    optidrive : ndarray, shape (n,)
        [m]
    position : ndarray, shape (n, 3)
        Of S in base [m].
    R_base_sensor : ndarray, shape (n, 3, 3)
    velocity, acceleration : ndarray, shape (n, 3)
        Of S in base [m/s], [m/s^2].
    omega, alpha : ndarray, shape (n, 3)
        In S [rad/s], [rad/s^2].
    speed : ndarray, shape (n,)
        Of the slide [m/s].
    contact : ndarray, shape (n, 6)
        Environment on tool, in S [N], [N m].
    specific_force : ndarray, shape (n, 3)
        [m/s^2]
    joints : ndarray, shape (n, JOINTS) or None
        Positions, 0 of those that there are not [rad] or [m].
    """

    start: float
    wrench: Array
    volts: Array
    optidrive: Array
    position: Array
    R_base_sensor: Array
    velocity: Array
    acceleration: Array
    omega: Array
    alpha: Array
    speed: Array
    contact: Array
    specific_force: Array
    joints: Array | None = None


def accelerometer_volts(rig: Rig, accelerometer: str, specific_force: Array) -> Array:
    """Return what a rig's accelerometer, its effects included, makes of (n, 3) [m/s^2] in V."""
    model = rig.accelerometer.model(accelerometer)
    effects = AccelerometerEffects(rig, accelerometer, 1.0 / RATE)
    return effects.after_noise(effects.before_noise(specific_force * model.gain + model.offset))


def padded(joints: Array) -> Array:
    """Return a column for each joint that there may be, 0 where there is none."""
    return np.pad(joints, ((0, 0), (0, JOINTS - joints.shape[1])))


def block_means(values: Array) -> Array:
    """Average replayed signals over blocks, shape (n, k) to (blocks, k)."""
    return np.asarray(values.reshape(-1, round(BLOCK * RATE), values.shape[1]).mean(axis=1))


class Simulation(Protocol):
    """
    One recording's inputs, simulated as often as needed.

    Attributes
    ----------
    start : float
        When block 0 begins [s].
    accelerometer : str
        ``acc1`` or ``acc2``.
    band : float
        Up to which frequency it is meant to hold [Hz].
    exact : float
        RMS in that of the noise of a channel, up to which it is meant to be right.
    starts_white : bool
        Whether noise is first taken for white: where a recording is all motion, nothing shows
        the noise by itself.
    library : mapping of str to Effect
        What a recording may have beside what is simulated.
    from_accelerometer : bool
        Whether its motion is that of the measured accelerometer, whose drift at rest is in the
        residual, too.
    """

    start: float
    n_blocks: int
    accelerometer: str
    band: float
    exact: float
    starts_white: bool
    library: Mapping[str, Effect]
    from_accelerometer: bool

    def signals(self, rig: Rig) -> Signals:
        """Simulate a rig, with its effects."""

    def tangent(self, rig: Rig, nuisance: str) -> Hashable:
        """
        Return about which point signals are linear in a nuisance.

        What these change is then the same as long as that point is; None where they are not.
        """

    def settle(self, rig: Rig, *, whole: bool = False) -> bool:
        """
        Simulate a rig exactly where signals are predicted; say whether that changed them.

        Parameters
        ----------
        rig : Rig
        whole : bool
            Also linearise a simulator in all its numbers there, unless that was done near enough.
        """

    def clear(self, signals: Signals) -> Signals:
        """Return signals without the noise of measured inputs, which is in the residual, too."""

    def smooth(self, signals: Signals) -> Signals:
        """Return signals without the noise of measured inputs, as a discrepancy may follow."""

    def nuisances(self, rig: Rig, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
        """List the nuisance parameters, as far as the streams at hand can show it."""

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect could be there and be seen."""
