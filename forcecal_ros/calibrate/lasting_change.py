"""Changes after which a sensor shows another bias, weight or vertical, to the end."""

from collections.abc import Iterator
from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.frames import Forces
from forcecal_ros.core.geometry import Array
import numpy as np

FEWEST = 12
"""Means on either side of a change, at least: 6 s of half a second each."""

SHARE = 0.2
"""Share of a recording on either side of a change, at least."""

STEP_UNEXPLAINED = 0.25
"""A change is told where it leaves less than this share of what is left without: of 300 simulated
recordings with pushes of up to 10 s for up to half of the time none leaves less than 0.31."""

MOST, CLEAR, LASTS = 0.6, 0.2, 15.0
"""A change is told as well, however hard the pushes beside it, where on either side so many of
the means are off by less than this share of it, for so long [s]: of 150 simulated recordings with
pushes of up to 25 N and 10 s for up to half of the time none is told so; of as many with a base
that tilts by 4 to 15 deg beside them 102 are."""

SPLITS = 200
"""Times of a change that are tried at first; of 100 s of means that is each of them."""


class _Change(NamedTuple):
    """One that is fitted: from which mean on, what it leaves of each, and how it is said."""

    at: int
    off: Array
    size: float
    said: str

    @property
    def residual(self) -> float:
        """Sum of what it leaves."""
        return float(self.off.sum())

    def is_clear(self, times: Array) -> bool:
        """Say whether most means on either side leave next to nothing of it."""
        sides = (self.off[:self.at], self.off[self.at:])
        longest = times[self.at] - times[0], times[-1] - times[self.at]
        return min(longest) > LASTS and all(
            np.quantile(side, MOST) < CLEAR * self.size for side in sides)


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
    best = _likeliest(forces, times, off, range(side, len(times) - side + 1))
    if best is None or best.size <= least:
        return ''
    without = float(_sizes(off - np.median(off, axis=0)).sum())
    told = best.residual < STEP_UNEXPLAINED * without or best.is_clear(times)
    return best.said if told else ''


def _likeliest(forces: Forces, times: Array, off: Array, splits: range) -> _Change | None:
    """Return the change that leaves least, of a few times at first, then of those about it."""
    step = max(1, len(splits) // SPLITS)
    best = min((change for i in splits[::step] for change in _changes(forces, times, off, i)),
               key=lambda one: one.residual, default=None)
    if best is None or step == 1:
        return best
    near = range(max(splits.start, best.at - step), min(splits.stop, best.at + step + 1))
    return _likeliest(forces, times, off, near)


def _changes(forces: Forces, times: Array, off: Array, i: int) -> Iterator[_Change]:
    """Fit a change of bias and one of load; none where orientations do not tell them."""
    if _spanned(forces.in_sensor[:i]) and _spanned(forces.in_sensor[i:]):
        yield _bias(off, i, times[i])
        yield _load(off, forces.in_sensor, i, times[i])
        yield _tilt(off, forces, i, times[i])


def _bias(off: Array, i: int, t: float) -> _Change:
    before, after = np.median(off[:i], axis=0), np.median(off[i:], axis=0)
    jump = after - before
    x, y, z = jump
    return _Change(
        i, _sizes(np.vstack([off[:i] - before, off[i:] - after])), float(np.linalg.norm(jump)),
        f'from {t:.1f} s on the wrench is {x:+.2g} {y:+.2g} {z:+.2g} N off, however the sensor '
        'turns: it was tared, or its driver started anew, while this was recorded; that is no '
        'contact: use either part alone')


def _load(off: Array, in_sensor: Array, i: int, t: float) -> _Change:
    g = float(np.linalg.norm(in_sensor[0]))
    before = off[:i] - np.median(off[:i], axis=0)
    rest = off[i:] - np.median(off[:i], axis=0)
    mass = float(np.median((rest * in_sensor[i:]).sum(axis=1))) / g**2
    return _Change(
        i, _sizes(np.vstack([before, rest - mass * in_sensor[i:]])), abs(mass) * g,
        f'from {t:.1f} s on the sensor carries {abs(mass):.3g} kg '
        f'{"more" if mass > 0 else "less"}: something was gripped or let go; its weight counts as '
        'contact (--track-tool follows it)')


def _tilt(off: Array, forces: Forces, i: int, t: float) -> _Change:
    """Fit a force across the vertical of base, as of a base that is not level any more."""
    R = forces.R_base_sensor[i:]
    down = forces.gravity / np.linalg.norm(forces.gravity)
    before = off[:i] - np.median(off[:i], axis=0)
    rest = off[i:] - np.median(off[:i], axis=0)
    across = np.median(np.einsum('nij,nj->ni', R, rest), axis=0)
    across = across - down * (across @ down)
    size = float(np.linalg.norm(across))
    return _Change(
        i, _sizes(np.vstack([before, rest - across @ R])), size,
        f'from {t:.1f} s on a force of {size:.2g} N keeps its direction across the vertical of '
        'base, however the sensor turns: the base is not level any more (it tilted, or drives '
        'over a slope), or something pulls steadily; its pull counts as contact')


def _sizes(off: Array) -> Array:
    """Magnitudes, on whose sum a few pushes weigh little, shape (n,)."""
    return np.asarray(np.linalg.norm(off, axis=1))


def _spanned(in_sensor: Array) -> bool:
    return bool(np.linalg.norm(in_sensor.std(axis=0))
                > limits.SPANNED * np.linalg.norm(in_sensor[0]))
