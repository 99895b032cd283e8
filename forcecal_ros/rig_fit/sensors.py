"""Rates and noise of streams, as measured."""

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array, rotation_vector
from forcecal_ros.recording.streams import PoseStream
import numpy as np

_SMOOTHEST = (1.0, -4.0, 6.0, -4.0, 1.0)
"""Fourth difference: of a motion within 10 Hz at 250 Hz it leaves less than a hundredth."""

FEWEST = 50
"""Samples from which rate and noise are told."""

ROUND = 1e-3
"""Of a rate: as far from a whole number of hertz as computers' clocks are apart at most."""

IRREGULAR = 0.1
"""Share of intervals between commands that may be off by half a period: some get lost."""

TENTH = 1e-4
"""Periods that are no whole number of hertz are taken in these steps [s]."""


def period_of(t: Array) -> float:
    """Return the mean interval between samples, those that got lost counted [s]."""
    steps = np.diff(t)
    middle = float(np.median(steps))
    return float((t[-1] - t[0]) / np.maximum(1.0, np.round(steps / middle)).sum())


def command_period(t: Array) -> float:
    """
    Return the period of commands, rounded to a whole rate, or to 0.1 ms [s].

    Raises
    ------
    DataError
        They come irregularly, or too few.
    """
    if len(t) < FEWEST:
        raise DataError(f'target_frame: {len(t)} commands do not tell how the robot follows; '
                        'record the commands while it moves, 10 s or more')
    period = period_of(t)
    steps = np.diff(t) / period
    off = float(np.mean(np.abs(steps - np.maximum(1.0, np.round(steps))) > 0.5 - 1e-9)
                + np.mean(steps > 1.5))
    if off > IRREGULAR:
        raise DataError(f'target_frame: {100.0 * off:.0f} % of the commands come irregularly, '
                        f'expected one every {1e3 * period:.3g} ms; stream them at a fixed rate')
    rate = round(1.0 / period)
    if rate and abs(rate * period - 1.0) < ROUND:
        return 1.0 / rate
    return round(period / TENTH) * TENTH


def rate_beside(t: Array, period: float) -> float:
    """Return a stream's rate as a rig may have it: a whole multiple of the commands' [Hz]."""
    return max(1, round(period / period_of(t))) / period


def noise_of(values: Array) -> float:
    """Return the noise of one sample, white, by fourth differences of all columns together."""
    rows = np.reshape(values, (len(values), -1))
    if len(rows) < FEWEST:
        return 0.0
    apart = sum(c * rows[i:len(rows) - 4 + i] for i, c in enumerate(_SMOOTHEST))
    scale = float(np.sqrt(np.square(_SMOOTHEST).sum()))
    return float(np.sqrt(np.mean(np.median(np.abs(apart), axis=0) ** 2))) / (0.6745 * scale)


def orientation_noise(pose: PoseStream) -> float:
    """Return the noise of an orientation, per axis [rad]."""
    turns = rotation_vector(np.swapaxes(pose.R_base_sensor[:-1], 1, 2) @ pose.R_base_sensor[1:])
    return noise_of(np.cumsum(turns, axis=0))
