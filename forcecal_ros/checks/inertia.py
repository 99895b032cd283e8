"""Inertia that a wrench shows while its robot moves, beside what the pose's accelerations make."""

from typing import NamedTuple

from forcecal_ros.checks.pace import refuse_other_length
from forcecal_ros.checks.slowness import TOLD_LATE
from forcecal_ros.checks.units import lever_units_of
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion, STANDARD_GRAVITY
from forcecal_ros.core.streams import Recording
import numpy as np
from scipy.ndimage import gaussian_filter1d

STEP, WIDTH = 0.02, 3.0
"""Means over so long are compared [s], smoothed by a Gaussian of so many of them: 60 ms keep what
arms do and leave a thousandth of a pose's noise in its second derivative."""

FEWEST = 500
"""Fewer means tell nothing: 10 s."""

SLOWEST = 40.0
"""Poses and wrenches at a lower rate do not show an acceleration [Hz]."""

PARTS = 12
"""Stretches that are left out in turn for the standard error."""

ROUNDS, UNTOUCHED, MOVING = 6, 4.0, 0.3
"""Fits without what is farther off than so many times the median: contacts. The median is that of
the share that accelerates most, since what rests is off by less."""

SLOW, SURE = 1.5, 10.0
"""Inertia by which stamps are called slow, and how many standard errors it is off at least: sound
logs, late, lost or low-passed ones show 0.85 to 1."""

AS_MUCH = 0.85
"""Where forces show less of the inertia than that the centre of mass is not judged by it: tools on
springs and short motions show 0.55 to 0.9, and it is some 0.1 m off then."""

TURNS = 0.1
"""Angular speed from which gravity turns in the sensor [rad/s]."""

WHITE = 0.6745 * 2.0**0.5
"""Median of the differences of white noise, over its standard deviation."""

ELSEWHERE = 0.05
"""Centres of mass by torques and by inertia are apart by less where nothing is wrong [m]."""


class Inertia(NamedTuple):
    """
    What of a load's inertia the forces show.

    Attributes
    ----------
    times, times_std : float
        Force over mass times acceleration of the pose: 1 where both are in the same time.
    com, com_std : ndarray, shape (3,)
        Centre of mass from the point whose position the pose gives, in ft_sensor [m].
    late, late_std : float
        How much later than the pose the forces show the weight turn [s].
    rate : float
        How fast the weight's force changes where it turns, RMS [N/s].
    """

    times: float
    times_std: float
    com: Array
    com_std: Array
    late: float
    late_std: float
    rate: float


def inertia_shown(recording: Recording) -> Inertia | None:
    """
    Compare forces with accelerations; None where there are no positions or too few means.

    In base, smoothed: R f = w - q (a + R'' c) + R b + l R (R' z)', with load w, inertial mass q,
    centre of mass c, bias b and a small delay l.
    """
    found = _smoothed(recording)
    if found is None:
        return None
    design, force, acceleration = found
    keep = np.isfinite(force).all(axis=1)
    size = np.linalg.norm(acceleration, axis=1)
    moving = size >= np.quantile(size, 1.0 - MOVING)
    for _ in range(ROUNDS):
        theta = _fit(design[keep], force[keep])
        off = np.linalg.norm(force - design @ theta, axis=1)
        keep = off <= UNTOUCHED * np.nanmedian(off[moving])
    if keep.sum() < FEWEST or not acceleration[keep].any():
        return None
    part = np.arange(len(keep)) * PARTS // len(keep)
    found_without = [_ratios(_fit(design[rows], force[rows])) for k in range(PARTS)
                     if (rows := keep & (part != k)).any()]
    spread = np.array(found_without)
    std = np.sqrt((PARTS - 1) * spread.var(axis=0))
    theta = _fit(design[keep], force[keep])
    shown = _ratios(theta)
    turning = np.linalg.norm(design[:, :, -1], axis=1)
    rate = np.linalg.norm(theta[4:7]) * np.sqrt((turning[turning > TURNS]**2).mean()) if (
        turning > TURNS).any() else 0.0
    return Inertia(float(shown[0]), float(std[0]), shown[1:4], std[1:4], float(shown[4]),
                   float(std[4]), float(rate))


def motion_notes(recording: Recording) -> tuple[str, ...]:
    """Say in notes that stamps run slower than time, or the wrench a little late."""
    found = shown_in_metres(recording)
    return tuple(note for note in (_other_time(found), _late(recording, found)) if note)


def other_time(recording: Recording) -> str:
    """Say in a note that stamps run slower than time; empty: they do not, or nothing tells."""
    return _other_time(shown_in_metres(recording))


def shown_in_metres(recording: Recording) -> Inertia | None:
    """
    Return the inertia that forces show beside positions in metres.

    Raises
    ------
    DataError
        The positions are in another unit.
    """
    found = inertia_shown(recording)
    if found is not None and recording.pose is not None:
        refuse_other_length(found.times, found.times_std, recording.pose)
    return found


def _late(recording: Recording, found: Inertia | None) -> str:
    """Say that forces are late by what adds more to them than noise does; empty: they are not."""
    if found is None or abs(found.late) < SURE * found.late_std or any(
            TOLD_LATE.search(note) for note in recording.notes):
        return ''
    assert recording.wrench is not None
    steps = np.abs(np.diff(recording.wrench.values[:, :3], axis=0))
    size = abs(found.late) * found.rate
    if size < np.linalg.norm(np.median(steps, axis=0)) / WHITE:
        return ''
    return (f'wrench shows the weight turn {1e3 * abs(found.late):.0f} +- '
            f'{1e3 * found.late_std:.0f} ms {"later" if found.late > 0 else "earlier"} than the '
            f'pose, which leaves {size:.2g} N RMS as contact while the robot turns: a low-pass of '
            'its driver, or stamps; switch the filter off, and stamp both when they are measured')


def _other_time(found: Inertia | None) -> str:
    if found is None or found.times < SLOW or found.times - 1.0 < SURE * found.times_std:
        return ''
    return (f'wrench shows {found.times:.2g} +- {found.times_std:.1g} times the inertia that the '
            'accelerations of the pose make: the stamps run at some '
            f'{found.times**-0.5:.2g} of the speed of time, as of a log that was played slowly '
            'and stamped anew; inertia counts as contact: use the log as it was recorded')


def other_point(recording: Recording, com: Array, std: Array) -> str:
    """
    Say in a note that a centre of mass by torques is not that by inertia; empty: nothing tells.

    Parameters
    ----------
    com, std : ndarray, shape (3,)
        By torques at rest [m].

    Raises
    ------
    DataError
        Another unit explains it.
    """
    found = shown_in_metres(recording)
    if found is None or not AS_MUCH < found.times < SLOW:
        return ''
    off = com - found.com
    error = float(np.linalg.norm(np.hypot(found.com_std, std)))
    if np.linalg.norm(off) < max(ELSEWHERE, SURE * error):
        return ''
    unit = lever_units_of(com, found.com, forces=True)
    if unit:
        raise DataError(
            f'wrench: torques put the centre of mass at {_metres(com)} m, inertia in motion at '
            f'{_metres(found.com)} m: {unit}; mend the driver (or write the unit into the '
            'specification of forcecal import). If neither, they are about a point '
            f'{_metres(-off)} m away: state --sensor-from-pose {_sensor_at(recording, -off)}')
    return (f'torques put the centre of mass at {_metres(com)} m, inertia in motion at '
            f'{_metres(found.com)} m from the point whose position the pose gives: torques are '
            f'about a point {_metres(-off)} m from it; calibrate again with --sensor-from-pose '
            f'{_sensor_at(recording, -off)}, which puts the sensor there')


def _sensor_at(recording: Recording, place: Array) -> str:
    """Say the transform from the recorded pose to a place in what it was taken to [m]."""
    x, y, z, *q = recording.sensor_from_pose or (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    there = np.array([x, y, z]) + matrix_from_quaternion(q) @ place
    return ' '.join([*(f'{v:.3f}' for v in there), *(f'{v:.6g}' for v in q)])


def _metres(place: Array) -> str:
    return f'({" ".join(f"{x:.3f}" for x in place)})'


def _ratios(theta: Array) -> Array:
    """Return the inertial over the gravitational mass, the centre of mass, and the delay."""
    weight = np.linalg.norm(theta[4:7])
    return np.concatenate([[theta[0] * STANDARD_GRAVITY / weight], theta[1:4] / theta[0],
                           [theta[10] / weight]])


def _fit(design: Array, force: Array) -> Array:
    return np.asarray(np.linalg.lstsq(
        design.reshape(-1, design.shape[2]), force.ravel(), rcond=1e-9)[0])


def _smoothed(recording: Recording) -> tuple[Array, Array, Array] | None:
    """Return columns (n, 3, 11) of the model, forces in base and accelerations, (n, 3)."""
    wrench, pose = recording.wrench, recording.pose
    if wrench is None or pose is None or not pose.has_position or min(
            len(wrench), len(pose)) < FEWEST:
        return None
    if min(1.0 / np.median(np.diff(one.t)) for one in (wrench, pose)) < SLOWEST:
        return None
    edges = np.arange(max(wrench.t[0], pose.t[0]), min(wrench.t[-1], pose.t[-1]), STEP)
    if len(edges) <= FEWEST:
        return None
    force = _means(wrench.t, wrench.values[:, :3], edges)
    place = _means(pose.t, pose.position, edges)
    R = _means(pose.t, pose.R_base_sensor.reshape(-1, 9), edges).reshape(-1, 3, 3)
    turned = np.swapaxes(R, 1, 2)[:, :, 2]
    acceleration = _smooth(place - place[0], 2)
    n = len(R)
    design = np.concatenate([
        -acceleration[:, :, None], -_smooth(R.reshape(n, 9), 2).reshape(n, 3, 3),
        np.broadcast_to(np.eye(3), (n, 3, 3)), _smooth(R.reshape(n, 9), 0).reshape(n, 3, 3),
        _smooth(np.einsum('nij,nj->ni', R, np.gradient(turned, STEP, axis=0)), 0)[:, :, None],
    ], axis=2)
    return design, _smooth(np.einsum('nij,nj->ni', R, force), 0), acceleration


def _means(t: Array, values: Array, edges: Array) -> Array:
    """
    Means between edges, moved to the middle of what was sampled there.

    A few samples of another rate lie to one side of it: 2 ms of 0.3 m/s would be 0.05 m/s^2.
    """
    both = np.column_stack([t, values])
    at = np.searchsorted(t, edges)
    sums = np.vstack([np.zeros(both.shape[1]), np.cumsum(both - both[0], axis=0)])
    count = np.diff(at)
    means = np.diff(sums[at], axis=0)[count > 0] / count[count > 0, None] + both[0]
    middle = (edges[1:] + edges[:-1]) / 2.0
    return np.stack([np.interp(middle, means[:, 0], column) for column in means[:, 1:].T], axis=1)


def _smooth(values: Array, order: int) -> Array:
    return np.asarray(gaussian_filter1d(values, WIDTH, axis=0, order=order)) / STEP**order
