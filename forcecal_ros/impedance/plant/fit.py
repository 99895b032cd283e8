"""
The plant from a recording in free space, its tool on a slide, and commands that excite it.

In free motion without turning, with F the force on the wire and a the tool's acceleration,

    F = k s + d ds/dt + b1        F = -m a + b2        a = d2(x_rb + s)/dt2

Each is weighted by smooth windows w and integrated by parts, int w ds/dt = -int dw/dt s, so that
nothing noisy is differentiated. The force, whose noise is the smallest, is the instrument
(two-stage least squares): noise in s and x_rb then biases nothing.
"""

from typing import NamedTuple

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.impedance.plant.model import Plant, Slide
from forcecal_ros.impedance.plant.robot_fit import identify_robot, RobotFit
from forcecal_ros.motion.profiles import quintic
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


MOST_TURN = 0.01
"""Largest rotation of the sensor within a recording that a plant is identified from [rad]."""

_DIGITS = 9
"""Decimals of a period, the median of stamp differences, in seconds."""


class PlantFit(NamedTuple):
    """Robot and slide with the quality of their fits."""

    robot: RobotFit
    slide: SlideFit

    @property
    def plant(self) -> Plant:
        """The models."""
        return Plant(self.robot.robot, self.slide.slide)


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
    return PlantFit(
        identify_robot(command, position, period),
        identify_slide(Signal(wrench.t, wrench.values[:, 0]),
                       Signal(optidrive.t, optidrive.values[:, 0]),
                       Signal(pose.t, pose.position @ axis)))


def _axis(pose: PoseStream) -> Array:
    """Return x of ft_sensor in base, which must not turn."""
    start = pose.R_base_sensor[0]
    turn = max((float(np.linalg.norm(rotation_vector(start.T @ R)))
                for R in pose.R_base_sensor[::10]), default=0.0)
    if turn > MOST_TURN:
        raise DataError(f'the sensor turns by {turn:.3f} rad; move it along x of ft_sensor only '
                        f'({MOST_TURN} rad at most)')
    return np.array(start[:, 0])


def _sampled(target: PoseStream, pose: PoseStream, axis: Array) -> tuple[float, Array, Array]:
    """Return period, commands and positions, one a period, from the first command on."""
    if len(target) < 2:
        raise DataError(f'{len(target)} commands; record target_frame while the robot moves')
    period = round(float(np.median(np.diff(target.t))), _DIGITS)
    end = min(target.t[-1], pose.t[-1])
    t = np.arange(max(target.t[0], pose.t[0]), end + 0.5 * period, period)
    held = np.maximum(np.searchsorted(target.t, t + 0.5 * period, side='right') - 1, 0)
    start = target.position[0] @ axis
    position = np.interp(t, pose.t, pose.position @ axis)
    return period, target.position[held] @ axis - start, position - start


REACH, MOVE = 0.02, 0.4
"""Minimum-jerk moves within plus and minus that [m], and their duration [s]."""

CODE, CHIP = 0.0005, 2
"""Amplitude of the pseudo-random binary code on top [m], and the periods that it stays the same
at least: it excites up to 0.44 / (CHIP period) Hz."""


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
    n, rng = round(seconds / period), np.random.default_rng(seed)
    t = np.arange(n) * period
    goals = np.append(0.0, rng.uniform(-REACH, REACH, int(seconds / MOVE) + 1))
    stage = (t / MOVE).astype(int)
    way, _, _ = quintic(t / MOVE - stage)
    slow = goals[stage] + (goals[stage + 1] - goals[stage]) * way
    chips = rng.choice((-CODE, CODE), n // CHIP + 1)
    fast = np.repeat(chips, CHIP)[:n]
    fast[:CHIP] = 0.0
    return np.asarray(slow + fast)
