"""How a robot follows its commands: position by an equation an axis, orientation on SO(3).

Commands and measured poses are brought onto the grid of the robot's periods first. A pole on the
negative real axis, or one that hardly decays, fits noisy poses as well as another if commands are
smooth. But what it adds alternates from period to period, and micrometres of that are newtons at
the tool.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.core.errors import above, below, DataError
from forcecal_ros.core.estimation import jacobian
from forcecal_ros.core.geometry import Array, quaternion_from_matrix, rotation_vector
from forcecal_ros.core.schema import Matrix3
from forcecal_ros.core.streams import phase_spans, Recording, TOUCHING
from forcecal_ros.diagnose.recordings import grid_shift
from forcecal_ros.effects.rig import Axis, Directions, Rig, Servo
from forcecal_ros.impedance.plant_fit import (
    Candidate,
    delayed,
    judged,
    OutputError,
    with_covariance,
)
from forcecal_ros.sim.rig.plant import Plant
from forcecal_ros.sim.rig.robot import Motion
from forcecal_ros.sim.rig.simulator import held_commands
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, OptimizeResult
from scipy.signal import lfilter

EVERY = 3
"""
Second that is not fitted, where no recording is given to judge on: programs move one axis after
the other, and each has to be in both parts.
"""


class Followed(NamedTuple):
    """
    One recording, a row a period: what was commanded in it, what was reached at its end.

    Attributes
    ----------
    position, reached : ndarray, shape (m, 3)
    R_command, R_reached : ndarray, shape (m, 3, 3)
    used, held : ndarray of bool, shape (m,)
        To fit on, and to judge on.
    """

    position: Array
    R_command: Array
    reached: Array
    R_reached: Array
    used: NDArray[np.bool_]
    held: NDArray[np.bool_]

    @property
    def xyzw(self) -> Array:
        """Commanded orientations."""
        return quaternion_from_matrix(self.R_command)


def followed(recording: Recording, period: float) -> Followed:
    """
    Bring a recording onto the grid of the commands.

    Raises
    ------
    DataError
        Commands and poses overlap for too short a time.
    """
    # commands and poses that a robot is fitted to, at least [s]: some ten of its slowest motions
    shortest = 10.0
    target, pose = recording.target, recording.pose
    assert target is not None and pose is not None
    start = float(target.t[0]) + grid_shift(target.t, pose.t, period)
    end = min(float(target.t[-1]) + period, float(pose.t[-1]))
    m = int((end - start) / period)
    starts: Array = start + period * np.arange(float(max(0, m)))
    seen = starts + period >= pose.t[0]
    if seen.sum() * period < shortest:
        raise DataError(f'{recording.source}: commands (target_frame) and poses (current_pose) '
                        f'overlap for {below(seen.sum() * period, shortest, 2)} s, expected at '
                        f'least {shortest:g} s; record a longer motion')
    held = held_commands(target.t, starts, period / 2.0)
    reached = pose.at(np.clip(starts + period, pose.t[0], pose.t[-1]))
    # start of a recording whose errors do not count, since the robot may have moved before [s]
    free = seen & (starts > max(start, float(pose.t[0])) + 0.5)
    for begin, end in phase_spans(recording.phases, TOUCHING):
        free &= (starts + period < begin) | (starts >= end)
    late = np.floor(starts - start).astype(int) % EVERY == EVERY - 1
    return Followed(target.position[held], target.R_base_sensor[held], reached.position,
                    reached.R_base_sensor, free & ~late, free & late)


def fit_and_judge(recordings: Sequence[Recording], heldout: Recording | None, period: float
                  ) -> list[Followed]:
    """Bring recordings onto the grid; one to judge on alone leaves the others to fit on."""
    ready = [followed(one, period) for one in recordings]
    if heldout is None:
        return ready
    last = followed(heldout, period)
    return [*(one._replace(used=one.used | one.held, held=np.zeros_like(one.held))
              for one in ready),
            last._replace(used=np.zeros_like(last.used), held=last.used | last.held)]


MOST_DELAY = 0.25
"""From command to position, at most [s]; robots' controllers take 10 to 100 ms."""

COARSE = 0.002
"""
Longest integration step while fitting [s]; half of it, times 1800 rad/s, is stable: orientations
of any bandwidth and damping that are tried. Positions are exact at any step.
"""


class AxisFit(NamedTuple):
    """
    One axis.

    Attributes
    ----------
    model : Axis
    order : int
        0 where the axis did not move and has another one's model.
    lag, lag_std : float
        From the stamp of a slow command to the position [s].
    """

    model: Axis
    order: int
    lag: float
    lag_std: float


def fit_translation(rig: Rig, followed: Sequence[Followed]) -> list[AxisFit]:
    """
    Fit the axes.

    Parameters
    ----------
    rig : Rig
        Its period and servo count.

    Raises
    ------
    DataError
        No axis moved, or the motion does not tell a lag.
    """
    # stroke of the commands from which an axis counts as moved [m]: ten times a pose's noise
    moved = 1e-3
    strokes = np.max([np.ptp(one.position[one.used], axis=0) for one in followed
                      if one.used.any()], axis=0)
    if strokes.max() < moved:
        raise DataError('target_frame: the commands move by '
                        f'{below(1e3 * strokes.max(), 1e3 * moved, 2)} mm, expected at least '
                        f'{1e3 * moved:g} mm along one axis; record a motion')
    # where a robot without equation would be at the end of each period
    smooth = [at_ends(rig, one).position for one in followed]
    found = {axis: _fit_axis(rig, followed, smooth, axis)
             for axis in range(3) if strokes[axis] >= moved}
    leading = found[max(found, key=lambda axis: float(strokes[axis]))]
    return [found.get(axis, leading._replace(order=0)) for axis in range(3)]


def at_ends(rig: Rig, one: Followed) -> Motion:
    """Return how a rig's robot moves, at each period's end."""
    steps = int(np.ceil(rig.robot.period / COARSE))
    rate = 1.0 / rig.robot.period
    bare = replace(rig, optidrive=None, **{name: replace(getattr(rig, name), rate=rate)
                                           for name in ('wrench_sensor', 'accelerometer',
                                                        'pose_sensor')})
    plant = Plant(bare, steps=steps)
    plant.rest(one.position[0], one.xyzw[0])
    every = 2 * steps
    return Motion(*(part[every::every] for part in plant.move(one.position, one.xyzw)))


def _fit_axis(rig: Rig, followed: Sequence[Followed], smooth: Sequence[Array], axis: int
              ) -> AxisFit:
    # standard error of an axis's lag, in periods, up to which its delay is identified
    sure = 1.0
    period = rig.robot.period
    # rest that is put between recordings, in which one's motion dies away [s]
    gap = np.zeros(round(0.5 / period))
    command = np.concatenate([np.append(s[:, axis] - s[0, axis], gap) for s in smooth])
    position = np.concatenate([np.append(one.reached[:, axis] - one.reached[0, axis], gap)
                               for one in followed])
    used, held = (np.concatenate([np.append(getattr(one, name), gap > 0.0) for one in followed])
                  for name in ('used', 'held'))
    most = _shift(command, position, used, round(MOST_DELAY / period))
    candidates = []
    # orders: of the difference equation that are tried: a rig holds three
    for order in (1, 2, 3):
        tried: dict[int, Candidate] = {}
        delays = {0, most // 3, 2 * most // 3, most}
        for _ in range(3):
            for delay in sorted(delays - set(tried)):
                if 0 <= delay <= most + 1:
                    model = fit_damped(command, position, order, delay, used)
                    tried[delay] = judged(model, order, command, position, held)
            best = min(tried.values(), key=lambda one: one.error)
            delays = {best.model.delay + k for k in (-2, -1, 1, 2)}
        candidates.append(best)
    # not the smallest that is hardly worse: what it leaves would be in the forces, and what the
    # greater one does not know of itself is in its tolerance
    known = [one for one in candidates if _lag(one.model)[1] < sure]
    if not known:
        surest = min(_lag(one.model)[1] for one in candidates)
        raise DataError(f'target_frame: the lag of axis {"xyz"[axis]} is not identifiable: its '
                        f'standard error is {above(surest, sure, 2)} periods, expected less than '
                        f'{sure:g}; move this axis farther')
    chosen = min(known, key=lambda one: one.error)
    lag, std = _lag(chosen.model)
    # a command is reached at the end of its period, without servo and equation
    servo = 3.0 / rig.servo.position_bandwidth + period
    return AxisFit(_axis(chosen.model, period), chosen.order, lag * period + servo, std * period)


def _shift(command: Array, position: Array, used: Array, most: int) -> int:
    """Return by how many periods a command has to be shifted to be nearest to the position."""
    def apart(k: int) -> float:
        return float(np.std((position[k:] - command[:len(command) - k])[used[k:]]))
    return min(range(most + 1), key=apart)


def _axis(model: OutputError, period: float) -> Axis:
    feedback, feedforward = (tuple(np.pad(c, (0, 3 - len(c))).tolist())
                             for c in (model.feedback, model.feedforward))
    return Axis(model.delay * period, feedback, feedforward, _directions(model))


def _directions(model: OutputError) -> Directions:
    """Return the principal changes of the six coefficients, the static gain kept."""
    order = len(model.feedback)
    values, vectors = np.linalg.eigh(model.covariance)
    rows = np.zeros((5, 6))
    for i, k in enumerate(np.argsort(values)[::-1][:2 * order - 1]):
        step = np.sqrt(max(0.0, values[k])) * vectors[:, k]
        rows[i, :order], rows[i, 3:3 + order] = step[:order], step[order:]
    rows[:, 3] -= rows.sum(axis=1)  # rounding
    return tuple(map(tuple, rows.tolist()))  # type: ignore[return-value]


def _lag(model: OutputError) -> tuple[float, float]:
    """Return the lag of slow commands, and its standard error [periods]."""
    order = len(model.feedback)
    theta = np.append(model.feedback, model.feedforward)

    def lag(x: Array) -> Array:
        a, b, i = x[:order], x[order:], np.arange(order)
        return np.array([(b @ i + a @ (i + 1.0)) / (1.0 - a.sum())])

    slope = jacobian(lag, theta, np.full(2 * order, 1e-6))[0]
    return (model.delay + float(lag(theta)[0]),
            float(np.sqrt(max(0.0, slope @ model.covariance @ slope))))


_FREQUENCY = (1e-3, 2.0 * np.pi / 3.0, 0.3, 0.3, 0.8)
"""
Of a pair [rad/period]: from a thousand periods to a third of the commands' rate, near half of
which sampling hides it.
"""

_DAMPING = (0.05, 30.0, 1.0, 4.0, 0.5)
"""Of a pair: an arm's structure has 0.05 and more, and 30 is two poles far from each other."""

_DECAY = (1e-3, 8.0, 0.5, 3.0, 0.1)
"""Of a real pole [1/period]: from a thousand periods to one that is over within the period."""

_NUMBERS = {1: (_DECAY,), 2: (_FREQUENCY, _DAMPING), 3: (_FREQUENCY, _DAMPING, _DECAY)}
"""What of the poles is searched for, by order: each between two limits, from three starts."""


def fit_damped(command: Array, position: Array, order: int, delay: int, used: Any) -> OutputError:
    """
    Fit a model that comes to rest at the command.

    The numerator follows from the poles by least squares, [Golub1973], so that only these are
    searched for, from three starts.

    Parameters
    ----------
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    order : int
        1 to 3.
    delay : int
        Periods from a command to the first position that it changes.
    used : slice, or ndarray of bool, shape (n,)
        Samples whose errors count.
    """
    low, high, *starts = np.log(_NUMBERS[order]).T
    unit = max(float(np.std(position[used])), np.finfo(float).tiny)

    def residual(x: Array) -> Array:
        return np.asarray(_numerator(_feedback(x), command, position, delay, used)[1][used] / unit)

    found = min((least_squares(residual, start, bounds=(low, high)) for start in starts),
                key=lambda one: one.cost)
    feedback = _feedback(found.x)
    rest, _ = _numerator(feedback, command, position, delay, used)
    return with_covariance(np.append(feedback, rest), command, position, delay, used,
                           unit_gain=True)


def _feedback(x: Array) -> Array:
    """Return the coefficients of y at k-1, k-2, ... of the logarithms of ``_NUMBERS``."""
    numbers = np.exp(x)
    poles = [-numbers[-1]] if len(x) != 2 else []
    if len(x) > 1:
        frequency, damping = numbers[:2]
        apart = np.sqrt(complex(damping ** 2 - 1.0))
        poles += [-frequency * (damping + apart), -frequency * (damping - apart)]
    return np.asarray(-np.real(np.poly(np.exp(poles)))[1:])


def _numerator(feedback: Array, command: Array, position: Array, delay: int, used: Any
               ) -> tuple[Array, Array]:
    """Return feedforward with the offset, and what they leave of the position."""
    order, gain = len(feedback), 1.0 - feedback.sum()
    columns = delayed(lfilter([1.0], np.append(1.0, -feedback), command), delay, order)
    # the last number makes the static gain 1
    free = np.column_stack([columns[:, :-1] - columns[:, -1:], np.ones(len(command))])
    target = position - gain * columns[:, -1]
    solution = np.linalg.lstsq(free[used], target[used], rcond=None)[0]
    rest = np.concatenate([solution[:-1], [gain - solution[:-1].sum()], solution[-1:]])
    return rest, np.asarray(target - free @ solution)


LIMITS = ((2.0, 0.3), (300.0, 3.0))
"""Bandwidth [rad/s] and damping that are tried: the integration is right within them."""


class RotationFit(NamedTuple):
    """
    Orientation.

    Attributes
    ----------
    servo : Servo
    identified : bool
        Whether it turned.
    lag : float
        From the stamp of a slow command to the orientation [s].
    """

    servo: Servo
    identified: bool
    lag: float


def fit_rotation(rig: Rig, followed: Sequence[Followed], lag: float) -> RotationFit:
    """
    Fit the orientation, output error on SO(3).

    Parameters
    ----------
    rig : Rig
        Its period counts.
    lag : float
        Of the position, taken where nothing turned [s].
    """
    turn = max(float(np.linalg.norm(_away(one), axis=1).max()) for one in followed)
    # turn of the commands from which orientation counts as moved [rad]: ten times a pose's noise
    if turn < 0.01:
        rest = max(lag - rig.robot.period, 2.0 * COARSE)
        servo = replace(rig.servo, orientation_bandwidth=2.0 / rest)
        return RotationFit(servo, False, lag)
    late = _orientation_shift(followed, round(MOST_DELAY / rig.robot.period)) * rig.robot.period
    late = max(late, rig.robot.period)
    delay, best = _best(rig, followed, late)
    servo = replace(_servo(rig, best.x, delay), orientation_tolerance=_servo_directions(best))
    w, damping = best.x
    return RotationFit(servo, True, float(rig.robot.period + delay + 2.0 * damping / w))


def _best(rig: Rig, followed: Sequence[Followed], late: float) -> tuple[float, OptimizeResult]:
    """Search bandwidth and damping for each delay, in whole periods, as long as it gets better."""
    period, found = rig.robot.period, []
    start = [2.0 / late, 1.0]
    for k in range(1 + round(MOST_DELAY / period)):
        found.append((k * period, _searched(rig, followed, k * period, start)))
        start = found[-1][1].x.tolist()
        costs = [float(one.cost) for _, one in found]
        # longer delays, each worse than the best, that end the search for it
        if len(costs) - 1 - int(np.argmin(costs)) >= 2:
            break
    return min(found, key=lambda one: float(one[1].cost))


def _servo_directions(best: OptimizeResult) -> Matrix3:
    """Return independent changes of bandwidth and damping, each 1 sigma; the delay's are 0."""
    scale = np.maximum(np.linalg.norm(best.jac, axis=0), 1e-12)
    variance = 2.0 * float(best.cost) / max(1, len(best.fun) - 2)
    inverse = np.linalg.pinv(best.jac / scale) / scale[:, np.newaxis]
    values, vectors = np.linalg.eigh(inverse @ inverse.T * variance)
    (a, b), (c, d) = ((vectors * np.sqrt(np.maximum(values, 0.0))).T).tolist()
    return (a, b, 0.0), (c, d, 0.0), (0.0, 0.0, 0.0)


def _searched(rig: Rig, followed: Sequence[Followed], delay: float, start: list[float]
              ) -> OptimizeResult:
    used = [one for one in followed if one.used.any()]

    def residual(x: Array) -> Array:
        changed = replace(rig, servo=_servo(rig, x, delay))
        return np.concatenate([centred(turned_apart(changed, one)[one.used]).ravel()
                               for one in used])

    low, high = np.array(LIMITS)
    inside = np.clip(start, low + 0.01 * (high - low), high - 0.01 * (high - low))
    return least_squares(residual, inside, bounds=(low, high), x_scale=0.1 * inside,
                         diff_step=1e-3, ftol=1e-6, xtol=1e-5, max_nfev=20)


def _servo(rig: Rig, x: Array, delay: float) -> Servo:
    w, damping = x.tolist()
    servo: Servo = replace(rig.servo, orientation_bandwidth=w, orientation_damping=damping,
                           orientation_delay=delay)
    return servo


def turned_apart(rig: Rig, one: Followed) -> Array:
    """Return the rotation from simulated to measured at each period's end, in S, shape (m, 3)."""
    R = at_ends(rig, one).R_base_sensor
    return rotation_vector(np.swapaxes(R, 1, 2) @ one.R_reached)


def centred(rows: Array) -> Array:
    """Remove the mean of each column."""
    return np.asarray(rows - rows.mean(axis=0))


def _away(one: Followed) -> Array:
    return rotation_vector(one.R_command[0].T @ one.R_command)


def _orientation_shift(followed: Sequence[Followed], most: int) -> int:
    def apart(k: int) -> float:
        return sum(float(np.square(rotation_vector(
            np.swapaxes(one.R_command[:len(one.R_command) - k:8], 1, 2) @ one.R_reached[k::8])
            ).sum()) for one in followed)
    return min(range(most + 1), key=apart)
