"""
The plant from a recording in free space, its tool on a slide, and commands that excite it.

In free motion without turning, with F the force on the wire and a the tool's acceleration,

    F = k s + d ds/dt + b1        F = -m a + b2        a = d2(x_rb + s)/dt2

Each is weighted by smooth windows w and integrated by parts, int w ds/dt = -int dw/dt s, so that
nothing noisy is differentiated. The force, whose noise is the smallest, is the instrument
(two-stage least squares): noise in s and x_rb then biases nothing.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import above, DataError
from forcecal_ros.core.files import write_text
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.schema import plain
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.impedance.plant import FORMAT, Plant, Robot, Slide
from forcecal_ros.motion.profiles import quintic
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter
import yaml


class OutputError(NamedTuple):
    """
    y_k = sum_i feedback_i y_(k-i) + sum_i feedforward_i r_(k-delay-i+1), plus an offset.

    Attributes
    ----------
    delay : int
        [periods]
    feedback, feedforward : ndarray, shape (n,)
    offset : float
        Of the measured position [m].
    covariance : ndarray, shape (2 n, 2 n)
        Of feedback and feedforward, in this order.
    """

    delay: int
    feedback: Array
    feedforward: Array
    offset: float
    covariance: Array

    def predict(self, command: Array) -> Array:
        """
        Return the position that a command gives, from rest at 0.

        Parameters
        ----------
        command : ndarray, shape (n,)
            [m]

        Returns
        -------
        ndarray, shape (n,)
            [m]
        """
        return _respond(self.feedback, self.feedforward, self.delay, command) + self.offset


def fit_output_error(command: Array, position: Array, order: int, delay: int, used: Any
                     ) -> OutputError:
    """
    Fit a model whose error is that of the measured position, [Gamez2005] Eq. 28.

    Parameters
    ----------
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    order : int
        Number of poles, and of numbers in the numerator.
    delay : int
        Periods from a command to the first position that it changes.
    used : slice, or ndarray of bool, shape (n,)
        Samples whose errors count.

    Raises
    ------
    DataError
        No stable model of this order fits.
    """
    unit = float(np.std(position[used])) or 1.0
    start = _weighted_least_squares(command, position, order, delay, used)

    def residual(theta: Array) -> Array:
        """Return the errors; infinite where the model is unstable, which no step goes to."""
        if not (np.abs(np.roots(np.append(1.0, -theta[:order]))) < 1.0).all():
            return np.full(len(position[used]), np.inf)
        return np.asarray(_residual(theta, command, position, order, delay)[used] / unit)

    if not np.isfinite(residual(start)).all():
        raise DataError(f'no stable model of order {order} fits; record more motion')
    found = least_squares(
        residual, start, lambda theta: -_jacobian(theta, command, order, delay)[used] / unit,
        x_scale='jac', ftol=1e-9, xtol=1e-12, gtol=1e-12)
    return with_covariance(found.x, command, position, delay, used)


def with_covariance(theta: Array, command: Array, position: Array, delay: int, used: Any,
                    unit_gain: bool = False) -> OutputError:
    """
    Return a model of given numbers, with the covariance that its error gives them.

    Parameters
    ----------
    theta : ndarray, shape (2 n + 1,)
        Feedback, feedforward, offset.
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    delay : int
        [periods]
    used : slice, or ndarray of bool, shape (n,)
        Samples whose errors count.
    unit_gain : bool
        Whether every model comes to rest at the command.
    """
    order = len(theta) // 2
    free = np.eye(len(theta))
    if unit_gain:  # the last number of the numerator makes up for the others
        free[2 * order - 1, :-1] = -1.0
        free = np.delete(free, 2 * order - 1, axis=1)
    residual = _residual(theta, command, position, order, delay)[used]
    jacobian = _jacobian(theta, command, order, delay)[used] @ free
    degrees = max(1, len(residual) - free.shape[1])
    scale = np.linalg.norm(jacobian, axis=0)
    inverse = free @ (np.linalg.pinv(jacobian / scale) / scale[:, np.newaxis])
    covariance = inverse @ inverse.T * (residual @ residual / degrees)
    return OutputError(delay, theta[:order], theta[order:-1], float(theta[-1]),
                       covariance[:-1, :-1])


def _respond(feedback: Array, feedforward: Array, delay: int, command: Array) -> Array:
    above = np.append(np.zeros(delay), feedforward)
    return np.asarray(lfilter(above, np.append(1.0, -feedback), command))


def delayed(signal: Array, first: int, count: int) -> Array:
    """Return columns of the signal delayed by first, first + 1, ... samples."""
    return np.stack([np.append(np.zeros(k), signal[:len(signal) - k])
                     for k in range(first, first + count)], axis=1)


def _weighted_least_squares(command: Array, position: Array, order: int, delay: int,
                            used: Any) -> Array:
    """Start: least squares of the equation error, filtered by the denominator found before."""
    feedback, theta, best = np.zeros(order), np.zeros(2 * order + 1), np.inf
    for _ in range(20):
        below = np.append(1.0, -feedback)
        y, r, one = (lfilter([1.0], below, signal)
                     for signal in (position, command, np.ones(len(position))))
        columns = np.column_stack([delayed(y, 1, order), delayed(r, delay, order), one])
        found = _solved(columns[used], y[used])
        feedback = _stabilised(found[:order])
        found[-1] /= 1.0 - feedback.sum()
        found[:order] = feedback
        cost = float(np.linalg.norm(_residual(found, command, position, order, delay)[used]))
        change, worst = best - cost, best
        if cost < best:
            theta, best = found, cost
        if np.isfinite(worst) and abs(change) <= 1e-9 * worst:
            break
    return theta


def _solved(columns: Array, values: Array) -> Array:
    """Least squares of columns that are scaled to the same length."""
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(np.linalg.lstsq(columns / size, values, rcond=1e-13)[0] / size)


def _stabilised(feedback: Array) -> Array:
    """Mirror poles outside the unit circle into it."""
    poles = np.roots(np.append(1.0, -feedback))
    size = np.abs(poles)
    if (size < 1.0).all():
        return feedback
    size = np.maximum(size, 1e-12)
    mirrored = np.where(size >= 1.0, poles / size * np.minimum(1.0 / size, 0.999), poles)
    return np.asarray(-np.real(np.poly(mirrored))[1:])


def _residual(theta: Array, command: Array, position: Array, order: int, delay: int) -> Array:
    explained = theta[-1] + _respond(theta[:order], theta[order:-1], delay, command)
    return np.asarray(position - explained)


def _jacobian(theta: Array, command: Array, order: int, delay: int) -> Array:
    """Return the derivatives of the prediction, one column a parameter."""
    below = np.append(1.0, -theta[:order])
    r = lfilter([1.0], below, command)
    y = lfilter([1.0], below, _respond(theta[:order], theta[order:-1], delay, command))
    return np.column_stack([delayed(y, 1, order), delayed(r, delay, order),
                            np.ones(len(command))])


class Candidate(NamedTuple):
    """The best model of one order, and its squared errors on what was held out [m^2]."""

    order: int
    model: OutputError
    squares: Array

    @property
    def error(self) -> float:
        """RMS on what was held out [m]."""
        return float(np.sqrt(self.squares.mean()))


def identify_robot(command: Array, position: Array, period: float, *,
                   orders: Sequence[int] = (1, 2, 3, 4, 5, 6), delays: Sequence[int] = (1, 2, 3)
                   ) -> tuple[Robot, dict[str, Any]]:
    """
    Identify the robot as output-error model, [Gamez2005] Eq. 28.

    Of each order the best delay is taken; of the orders the smallest one whose error on the
    data held out is no greater than the least one, within its standard error.

    Parameters
    ----------
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    period : float
        [s]
    orders, delays : sequence of int
        Of the difference equation, and from command to position [periods], to choose from.

    Returns
    -------
    robot : Robot
    quality : dict
        ``fit``, 1 - error / standard deviation on what was held out; ``error`` there, RMS, and
        ``offset`` of the measured position [m]; ``static_gain``; ``orders`` that were tried.

    Raises
    ------
    DataError
        Too few samples, no motion, or no model that fits.
    """
    # fewest samples that a robot is identified from: 2 s at 250 Hz
    min_samples = 500
    n = len(command)
    if n < min_samples or not np.ptp(command) > 0.0 or not np.ptp(position) > 0.0:
        raise DataError(f'{n} commands over {1e3 * np.ptp(command) if n else 0.0:.3g} mm do not '
                        f'identify the robot; record {min_samples} or more that move it')
    # held out: last share of a recording, not fitted: it chooses the order and judges the model
    held_out = slice(round(n * 2.0 / 3.0), n)
    # start of a recording in which errors do not count, since the robot may have moved before [s]
    used = slice(round(0.25 / period), held_out.start)
    candidates = [min((judged(
        fit_output_error(command, position, order, delay, used), order, command, position,
        held_out) for delay in delays), key=lambda one: one.error) for order in orders]
    chosen = _smallest_of_the_best(candidates, float(np.mean(position**2)))
    model, order = chosen.model, chosen.order
    std = np.sqrt(np.diag(model.covariance))
    robot = Robot(period, model.delay, Estimate(model.feedback, std[:order], '1'),
                  Estimate(model.feedforward, std[order:], '1'))
    return robot, {
        'fit': 1.0 - chosen.error / float(np.std(position[held_out])), 'error': chosen.error,
        'offset': model.offset, 'static_gain': robot.static_gain,
        'orders': [{'order': c.order, 'delay': c.model.delay, 'error': c.error}
                   for c in candidates]}


def judged(model: OutputError, order: int, command: Array, position: Array, held_out: Any
           ) -> Candidate:
    """Judge a model on what was held out, a slice or an ndarray of bool."""
    return Candidate(order, model, (position - model.predict(command))[held_out]**2)


def _smallest_of_the_best(candidates: Sequence[Candidate], power: float) -> Candidate:
    """
    Return the smallest order that is no worse than the best as far as standard errors tell.

    Parameters
    ----------
    power : float
        Mean square of the position [m^2], whose rounding does not count.
    """
    best = min(candidates, key=lambda one: one.error)
    for candidate in candidates:
        worse = candidate.squares - best.squares
        chance = float(np.std(worse)) / np.sqrt(len(worse)) + 1e-24 * power
        if float(worse.mean()) <= chance:
            return candidate
    return best


WINDOW = 0.1
"""Length of a weighting window [s]."""


Signal: TypeAlias = tuple[Array, Array]
"""Stamps [s] and values of one signal, each of shape (n,)."""


def identify_slide(force: Signal, slide: Signal, position: Signal) -> tuple[Slide, dict[str, Any]]:
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

    Returns
    -------
    slide : Slide
    quality : dict
        Number of ``windows``; ``spring_error`` and ``inertia_error``, RMS residual of the force
        over them by spring and damper, and by the mass [N].

    Raises
    ------
    DataError
        Too short, or no motion that identifies them.
    """
    # standard errors below zero from which a spring or a mass has the opposite sign
    sure = 3.0
    # fewest windows that a slide is identified from
    min_windows = 50
    # distance of window starts in window lengths; closer windows would share their errors
    spacing = 0.75
    begin = max(t[0] for t, _ in (force, slide, position))
    end = min(t[-1] for t, _ in (force, slide, position))
    starts = np.arange(begin, end - WINDOW, spacing * WINDOW)
    if len(starts) < min_windows:
        raise DataError(f'{max(0.0, end - begin):.1f} s of force, displacement and pose in common '
                        f'are too few to identify the compliant axis; record '
                        f'{min_windows * spacing * WINDOW:.0f} s or more')
    f, df, _ = _weighted(force, starts)
    s, ds, dds = _weighted(slide, starts)
    one = np.ones(len(starts))
    acceleration = dds + _weighted(position, starts)[2]
    spring, spring_std, spring_error = _two_stage(
        np.column_stack([s, ds, one]), f, np.column_stack([f, df, one]))
    mass, mass_std, inertia_error = _two_stage(
        np.column_stack([-acceleration, one]), f, np.column_stack([f, one]))
    if not (spring[:2] > 0.0).all() or not mass[0] > 0.0:
        turned = spring[0] < -sure * spring_std[0] or mass[0] < -sure * mass_std[0]
        raise DataError(f'mass {mass[0]:.3g} kg, stiffness {spring[0]:.3g} N/m and damping '
                        f'{spring[1]:.3g} N s/m are not plausible; ' + (
                            'force and displacement have opposite signs: give --wrench-sign the '
                            'other sign' if turned else 'the tool hardly moves on its spring: '
                            'shake it more'))
    return (Slide(Estimate(mass[0], mass_std[0], 'kg'), Estimate(spring[0], spring_std[0], 'N/m'),
                  Estimate(spring[1], spring_std[1], 'N s/m')),
            {'windows': len(starts), 'spring_error': spring_error,
             'inertia_error': inertia_error})


def _weighted(signal: Signal, starts: Array) -> tuple[Array, Array, Array]:
    """Return the windows' means of a signal, of its rate and of the rate of that."""
    t, values = signal
    edges = np.searchsorted(t, [starts, starts + WINDOW])
    means = np.empty((len(starts), 3))
    for i, (first, last) in enumerate(edges.T):
        if last - first < 8:
            raise DataError(f'{last - first} samples in {WINDOW:g} s at {starts[i]:.2f} s; at '
                            'least 8 are needed: record without gaps')
        angle = np.pi / WINDOW * (t[first:last] - starts[i])
        sine, cosine = np.sin(angle), np.cos(angle)
        rate = np.pi / WINDOW
        weights = np.stack([sine**4, -4.0 * rate * sine**3 * cosine,
                            4.0 * rate**2 * sine**2 * (3.0 * cosine**2 - sine**2)])
        means[i] = weights @ values[first:last] / weights[0].sum()
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


class PlantFit(NamedTuple):
    """
    Robot and slide, and how well they are identified.

    Attributes
    ----------
    quality : dict
        Of :func:`identify_robot` and of :func:`identify_slide`.
    """

    plant: Plant
    quality: dict[str, Any]


def identify_plant(recording: Recording) -> PlantFit:
    """
    Identify robot and slide from commands that shake the tool along x of ft_sensor.

    Parameters
    ----------
    recording : Recording
        In free space, in one orientation, from rest, with commands, poses, wrench and
        displacement.

    Raises
    ------
    DataError
        A signal is missing, the sensor turns, or the motion does not tell the models.
    """
    target, pose = recording.target, recording.pose
    wrench, optidrive = recording.wrench, recording.optidrive
    if target is None or pose is None or wrench is None or optidrive is None:
        lacking = [name for name in ('target', 'pose', 'wrench', 'optidrive')
                   if getattr(recording, name) is None]
        raise DataError(f'{recording.source}: {", ".join(lacking)} is missing; record commands, '
                        'poses, wrench and displacement')
    axis = _axis(pose)
    period, command, position = _sampled(target, pose, axis)
    robot, quality = identify_robot(command, position, period)
    slide, of_slide = identify_slide(
        (wrench.t, wrench.values[:, 0]), (optidrive.t, optidrive.values[:, 0]),
        (pose.t, pose.position @ axis))
    return PlantFit(Plant(robot, slide), quality | of_slide)


def _axis(pose: PoseStream) -> Array:
    """Return x of ft_sensor in base, which must not turn."""
    # largest rotation of the sensor within a recording that a plant is identified from [rad]
    most_turn = 0.01
    start = pose.R_base_sensor[0]
    turn = max((float(np.linalg.norm(rotation_vector(start.T @ R)))
                for R in pose.R_base_sensor[::10]), default=0.0)
    if turn > most_turn:
        raise DataError(f'the sensor rotates by {above(turn, most_turn)} rad; move it along x of '
                        f'ft_sensor only ({most_turn} rad at most)')
    return np.array(start[:, 0])


def _sampled(target: PoseStream, pose: PoseStream, axis: Array) -> tuple[float, Array, Array]:
    """Return period, commands and positions, one a period, from the first command on."""
    if len(target) < 2:
        raise DataError(f'{len(target)} commands; record target_frame while the robot moves')
    period = round(float(np.median(np.diff(target.t))), 9)
    end = min(target.t[-1], pose.t[-1])
    t = np.arange(max(target.t[0], pose.t[0]), end + 0.5 * period, period)
    held = np.maximum(np.searchsorted(target.t, t + 0.5 * period, side='right') - 1, 0)
    start = target.position[0] @ axis
    position = np.interp(t, pose.t, pose.position @ axis)
    return period, target.position[held] @ axis - start, position - start


def excitation_commands(seconds: float, period: float, *, seed: int = 0) -> Array:
    """
    Return commands along x of ft_sensor, from rest at 0.

    Parameters
    ----------
    seconds : float
        Length.
    period : float
        From one command to the next [s].
    seed : int
        Of the random code and the random goals.

    Returns
    -------
    ndarray, shape (n,)
        [m]
    """
    # amplitude of the pseudo-random binary code on top [m], and the periods that it stays the
    # same at least: it excites up to 0.44 / (chip period) Hz
    code, chip = 0.0005, 2
    # minimum-jerk moves within plus and minus that [m], and their duration [s]
    reach, move = 0.02, 0.4
    n, rng = round(seconds / period), np.random.default_rng(seed)
    t = np.arange(n) * period
    goals = np.append(0.0, rng.uniform(-reach, reach, int(seconds / move) + 1))
    stage = (t / move).astype(int)
    way, _, _ = quintic(t / move - stage)
    slow = goals[stage] + (goals[stage + 1] - goals[stage]) * way
    chips = rng.choice((-code, code), n // chip + 1)
    fast = np.repeat(chips, chip)[:n]
    fast[:chip] = 0.0
    return np.asarray(slow + fast)


def to_document(fit: PlantFit) -> dict[str, Any]:
    """Return the content of ``plant.yaml``, which ``--json`` prints too."""
    document: dict[str, Any] = plain({
        'format': FORMAT, **plain(fit.plant), 'quality': fit.quality})
    return document


def save_plant(fit: PlantFit, path: Path | str) -> None:
    """
    Write ``plant.yaml``; an existing one is kept as ``plant.yaml~``.

    Raises
    ------
    ConfigError
        The file cannot be written.
    """
    write_text(path, yaml.safe_dump(to_document(fit), sort_keys=False, width=99))
