"""Low-pass filters without phase, and up to which frequency a motion is clear of its noise."""

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Stream
import numpy as np
from scipy.interpolate import CubicSpline

LEAST, MOST = 1.0, 12.5
"""Clear band, at least and at most [Hz]: above, arm and gripper ring, and no tool is rigid."""

def clear_band(rows: Array, rate: float) -> float:
    """
    Tell where a signal's spectrum comes down to its floor.

    Derivatives of what lies above would be noise, in the residual and in what is fitted to it
    alike: an effect of a smooth signal would be preferred for that alone.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        At regular instants.
    rate : float
        [Hz]

    Returns
    -------
    float
        [Hz]
    """
    # length of the windows over which spectra are averaged [s]
    window = 4.0
    from scipy.signal import welch  # takes a second, which a node does not start with

    if rate < 5.0 * MOST or len(rows) < window * rate:
        return MOST  # no floor to be seen
    frequency, power = welch(rows, rate, nperseg=int(window * rate), axis=0)
    power = power.sum(axis=1)
    floor = float(np.median(power[frequency > 2.0 * MOST]))
    # clear: factor above its floor from which the power of a signal is no noise
    clear = frequency[(power > 10.0 * floor) & (frequency > 0.0)]
    return float(np.clip(clear.max(initial=0.0), LEAST, MOST))


def slow(rows: Array, rate: float, band: float = MOST) -> Array:
    """Leave out what is faster than a band; where samples are few, nothing is."""
    from scipy.signal import butter, sosfiltfilt  # takes a second, see clear_band

    if rate <= 2.0 * band or len(rows) < rate:
        return rows
    return np.asarray(sosfiltfilt(
        butter(4, band, fs=rate, output='sos'), rows, axis=0))


def slowed(stream: Stream, band: float = MOST) -> CubicSpline:
    """Return a stream as a function of time, without what is faster than a band [Hz]."""
    return CubicSpline(stream.t, slow(stream.values, stream.rate, band))
