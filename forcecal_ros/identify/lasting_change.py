"""A bias or a load that changes for good while a recording goes on: a tare, a payload."""

from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.recording.checks import limits
from forcecal_ros.recording.checks.frames import Forces
import numpy as np

FEWEST = 12
"""Means on either side of a change, at least: 6 s of half a second each."""

SHARE = 0.2
"""Share of a recording on either side of a change, at least."""

LEAVES = 0.25
"""A change is told where it leaves less than this share of what is left without: of 300 simulated
recordings with pushes of up to 10 s for up to half of the time none leaves less than 0.31."""


class _Change(NamedTuple):
    """One that is fitted: what it leaves and how it is said, of some forces after a time."""

    left: float
    size: float
    said: str


def lasting_change(forces: Forces, times: Array, off: Array, least: float) -> str:
    """
    Name the change after which a sensor shows another bias or another weight, to the end.

    Parameters
    ----------
    forces : Forces
        Means at rest.
    times : ndarray, shape (n,)
        Of the means, increasing [s].
    off : ndarray, shape (n, 3)
        What a calibration leaves of the forces [N].
    least : float
        A smaller change is none [N].

    Returns
    -------
    str
        Empty where nothing changed for good, or orientations do not tell it.
    """
    side = max(FEWEST, int(SHARE * len(times)))
    told = [i for i in range(side, len(times) - side + 1)
            if _spanned(forces.in_sensor[:i]) and _spanned(forces.in_sensor[i:])]
    if not told:
        return ''
    without = _sum(off - np.median(off, axis=0))
    changes = [change for i in told for change in (
        _bias(off, i, times[i]), _load(off, forces.in_sensor, i, times[i]))]
    best = min(changes, key=lambda one: one.left)
    return best.said if best.left < LEAVES * without and best.size > least else ''


def _bias(off: Array, i: int, t: float) -> _Change:
    before, after = np.median(off[:i], axis=0), np.median(off[i:], axis=0)
    jump = after - before
    x, y, z = jump
    return _Change(
        _sum(off[:i] - before) + _sum(off[i:] - after), float(np.linalg.norm(jump)),
        f'from {t:.1f} s on the wrench is {x:+.2g} {y:+.2g} {z:+.2g} N off, however the sensor '
        'turns: it was tared, or its driver started anew, while this was recorded; that is no '
        'contact: use either part alone')


def _load(off: Array, in_sensor: Array, i: int, t: float) -> _Change:
    g = float(np.linalg.norm(in_sensor[0]))
    before = off[:i] - np.median(off[:i], axis=0)
    rest = off[i:] - np.median(off[:i], axis=0)
    mass = float(np.median((rest * in_sensor[i:]).sum(axis=1))) / g**2
    return _Change(
        _sum(before) + _sum(rest - mass * in_sensor[i:]), abs(mass) * g,
        f'from {t:.1f} s on the sensor carries {abs(mass):.3g} kg '
        f'{"more" if mass > 0 else "less"}: something was gripped or let go; its weight counts as '
        'contact (--track-tool follows it)')


def _sum(off: Array) -> float:
    """Sum of magnitudes, on which a few pushes weigh little."""
    return float(np.linalg.norm(off, axis=1).sum())


def _spanned(in_sensor: Array) -> bool:
    return bool(np.linalg.norm(in_sensor.std(axis=0))
                > limits.SPANNED * np.linalg.norm(in_sensor[0]))
