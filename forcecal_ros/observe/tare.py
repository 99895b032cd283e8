"""Taring: a new wrench bias from a moment of rest, the tool's weight taken off first."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion, rotation_vector
from forcecal_ros.observe.bandwidth import NoiseLevels
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.bias_filter import Belief
from forcecal_ros.observe.filters.memory import Memory
from forcecal_ros.observe.sample import ContactSample
from forcecal_ros.observe.status import describe, INVALID
from forcecal_ros.observe.step import State
import numpy as np

CHANNELS = ('force.x', 'force.y', 'force.z', 'torque.x', 'torque.y', 'torque.z')

NOISE_FACTOR = 3.0
"""Motion or contact is what exceeds the noise at rest so many times: noise levels drift by a
factor of two on their own."""

FEWEST = 20
"""Samples of a window: of fewer, chance alone looks like a drift of many times the noise."""

MOST_INVALID = 0.1
"""Share of samples that may be missing: what a busy computer was late with now and then, where a
sensor that is silent takes all [1]."""

NEWEST = 0.1
"""A contact that begins shows in so much of the end of a window, or in its last sample: some
times the rise of a contact, so that few are younger [s]."""

CHANCE = 4.0
"""Standard errors by which two means of noise may differ: one tare in a thousand is refused
without a cause at most, on one of its twelve channels."""


@dataclass(frozen=True)
class Tare:
    """
    Outcome of a tare.

    Attributes
    ----------
    bias : ndarray, shape (6,)
        New reading without any load, wire sign [N, N m].
    shift : ndarray, shape (6,)
        By how much it differs from the old one.
    std : ndarray, shape (6,)
        Standard error of the mean it was taken from.
    """

    bias: Array
    shift: Array
    std: Array


def tare(samples: Sequence[ContactSample], model: Model, levels: NoiseLevels,
         seconds: float = 0.5) -> Tare:
    """
    Find the bias that makes the contact wrench of a window zero.

    The predicted weight and inertia are off already (``measured``), so the tool may be in any
    orientation. A steady push cannot be told from a bias; what can be told is refused.

    Parameters
    ----------
    samples
        The window, in order of time.
    model
        Of the chain that made them.
    levels
        Noise at rest.
    seconds : float
        Shortest window that is accepted [s].

    Raises
    ------
    DataError
        Too short, estimates in it are not valid, or the tool moves or touches.
    """
    span = samples[-1].t - samples[0].t if samples else 0.0
    if span < seconds or len(samples) < FEWEST:
        raise DataError(f'tare wants {seconds:g} s at rest and {FEWEST} samples, the window has '
                        f'{span:.3f} s and {len(samples)}; wait for the wrench to flow')
    rate = (len(samples) - 1) / span
    bad = [s.status for s in samples if s.status & INVALID]
    if len(bad) > MOST_INVALID * len(samples):
        raise DataError(f'cannot tare, {len(bad)} of {len(samples)} samples are not valid: '
                        f'{"; ".join(describe(bad[0]))}')
    valid = [s for s in samples if not s.status & INVALID]
    measured = np.array([s.measured for s in valid])
    inertial = np.array([s.inertial for s in valid])
    noise = _noise_at_rest(model, levels, rate)
    _refuse(inertial, noise, rate, 'the tool moves', 'stop the robot')
    _refuse(measured, noise, rate, 'the tool moves or touches something',
            'stop the robot and clear the tool')
    shift = measured.mean(axis=0)
    return Tare(np.array(model.bias) + shift, shift,
                measured.std(axis=0) / np.sqrt(len(valid)))


def with_bias(model: Model, bias: Array | tuple[float, ...]) -> Model:
    """Return the model with another wrench bias (6,) [N, N m]."""
    values = np.array(bias, dtype=float)
    learning = model.bias_filter
    return model._replace(
        bias=tuple(values.tolist()),
        bias_filter=None if learning is None else learning._replace(bias=values))


def without_learned_bias(state: State) -> State:
    """Let a filter that estimates biases begin anew, from the bias that its model has now."""
    return state._replace(filter=Memory()) if isinstance(state.filter, Belief) else state


def _noise_at_rest(model: Model, levels: NoiseLevels, rate: float) -> Array:
    """
    Return the standard deviation of ``measured`` when nothing happens, shape (6,).

    A sensor that says less often than when its noise was measured is as noisy a sample, unless it
    filters; one that says more often may have filtered then.
    """
    m = model.load.m
    arm = float(np.linalg.norm([model.load.cx, model.load.cy, model.load.cz]))
    wrench_rate = max(rate, levels.rate)
    f = levels.specific_force * max(rate, levels.accelerometer_rate)
    force = levels.force * wrench_rate + m * m * f
    torque = levels.torque * wrench_rate + (arm * m) ** 2 * f
    return np.sqrt(np.repeat([force, torque], 3))


def _refuse(values: Array, noise: Array, rate: float, what: str, remedy: str) -> None:
    """Raise where a channel scatters, drifts from one end to the other, or has just begun to."""
    n = len(values)
    third, last = n // 3, min(max(round(NEWEST * rate), 1), n // 3)
    drift = 2 * np.abs(values[-third:].mean(axis=0) - values[:third].mean(axis=0))
    change = np.abs(values[-last:].mean(axis=0) - values[:-last].mean(axis=0))
    for size, by_chance, word in (
            (values.std(axis=0), 0.0, 'scatters by'),
            (drift, 2 * np.sqrt(2 / third), 'drifts by'),
            (change, np.sqrt(1 / last + 1 / (n - last)), 'has just changed by')):
        allowed = np.hypot(NOISE_FACTOR, CHANCE * by_chance) * noise
        worst = int(np.argmax(size / allowed))
        if size[worst] > allowed[worst]:
            raise DataError(
                f'tare refused, {what}: {CHANNELS[worst]} {word} {size[worst]:.3g} '
                f'> {allowed[worst]:.3g} {"N" if worst < 3 else "N m"}; {remedy}')


PAUSE = 1.0
"""After so long without a wrench a window begins anew, as after stamps that go back: ten periods
of the slowest sensor that is tared, 10 Hz [s]."""


class Window:
    """
    What was heard last: so many seconds, or longer where that is too few samples.

    Attributes
    ----------
    seconds : float
        How much is kept at least [s].
    samples, poses : deque
        In order of time; poses are (stamp [s], x y z qx qy qz qw).
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.samples: deque[ContactSample] = deque()
        self.poses: deque[tuple[float, tuple[float, ...]]] = deque()

    def clear(self) -> None:
        """Begin anew."""
        self.samples.clear()
        self.poses.clear()

    def add(self, sample: ContactSample) -> None:
        """Keep a sample; what remains spans ``seconds`` as soon as so much was heard."""
        samples = self.samples
        if samples and not 0 <= sample.t - samples[-1].t <= PAUSE:
            self.clear()
        samples.append(sample)
        while len(samples) > FEWEST and sample.t - samples[1].t >= self.seconds:
            samples.popleft()

    def add_pose(self, t: float, pose: tuple[float, ...]) -> None:
        """Keep a pose as long as there are samples of its time."""
        poses = self.poses
        poses.append((t, pose))
        oldest = self.samples[0].t if self.samples else t - self.seconds
        oldest = max(oldest, t - self.seconds - FEWEST * PAUSE)  # where the wrench has stopped
        while poses and poses[0][0] < oldest:
            poses.popleft()

    def poses_of_samples(self) -> list[tuple[float, ...]]:
        """Return the poses from the first sample on."""
        return [pose for t, pose in self.poses if self.samples and self.samples[0].t <= t]


DISTANCE = 5e-4
"""A robot that stays within it over the window is at rest: 25 times the scatter of the nominal
rig's poses [m]."""

ANGLE = 1e-3
"""A robot that turns by less over the window is at rest: 50 times the scatter of the nominal
rig's poses [rad]."""


def refuse_motion(poses: Sequence[tuple[float, ...]]) -> None:
    """
    Refuse to tare a robot that is not at rest.

    Parameters
    ----------
    poses : sequence of tuple of 7 float
        Of the window: x y z [m] qx qy qz qw; NaN positions are not looked at.

    Raises
    ------
    DataError
        The robot moved in the window; with the number.
    """
    if len(poses) < 2:
        return
    table = np.array(poses)
    distance = float(np.linalg.norm(table[:, :3] - table[0, :3], axis=1).max())
    R = matrix_from_quaternion(table[:, 3:])
    angle = float(np.linalg.norm(rotation_vector(R[0].T @ R), axis=1).max())
    if distance > DISTANCE or angle > ANGLE:
        raise DataError(f'tare refused, the robot moves: {distance * 1e3:.2f} mm, '
                        f'{angle * 1e3:.2f} mrad within the window; stop the robot')
