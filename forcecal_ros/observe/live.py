"""The chain as a node runs it: models change without a jump, and biases can be tared."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, tau
from typing import NamedTuple

from forcecal_ros.core.axes import level_from_base, pose_from_wire
from forcecal_ros.core.errors import above, below, DataError
from forcecal_ros.core.geometry import (
    Array,
    compose,
    matrix_from_quaternion,
    Quaternion,
    quaternion_of,
    rotate,
    rotation_vector,
)
from forcecal_ros.core.streams import CHANNELS
from forcecal_ros.observe import step
from forcecal_ros.observe.bandwidth import NoiseLevels
from forcecal_ros.observe.bias_filter import Belief, wrench_tuple
from forcecal_ros.observe.contact import Memory, rate_at
from forcecal_ros.observe.design import KALMAN, Model, with_bias, with_tool
from forcecal_ros.observe.sample import ContactSample, describe, INVALID, NO_WRENCH, Wrench
from forcecal_ros.observe.step import Result, State
from forcecal_ros.observe.tracker import Tracker
import numpy as np

MIN_SAMPLES = 20
"""Samples of a window: of fewer, chance alone looks like a drift of many times the noise."""

MAX_PAUSE_S = 1.0
"""After so long without a wrench a window begins anew, as after stamps that go back: ten periods
of the slowest sensor that is tared, 10 Hz [s]."""

Values = tuple[float, ...]

Samples = tuple[ContactSample, ...]


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
    orientation. A steady push cannot be separated from a bias; what can be is refused.

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
    if span < seconds or len(samples) < MIN_SAMPLES:
        raise DataError(
            f'tare needs {seconds:g} s at rest and {MIN_SAMPLES} samples, the window has '
            f'{below(span, seconds)} s and {len(samples)}; wait until more wrenches arrive')
    rate = (len(samples) - 1) / span
    bad = [s.status for s in samples if s.status & INVALID]
    # share of samples that may be missing: what a busy computer was late with now and then, where
    # a sensor that is silent takes all
    if len(bad) > 0.1 * len(samples):
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


def _noise_at_rest(model: Model, levels: NoiseLevels, rate: float) -> Array:
    """
    Return the standard deviation of ``measured`` when nothing happens, shape (6,).

    A sensor that reports less often than when its noise was measured is as noisy a sample, unless
    it filters; one that reports more often may have filtered then.
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
    # a contact that begins shows in so much of the end of a window, or in its last sample: some
    # times the rise of a contact, so that few are younger [s]
    third, last = n // 3, min(max(round(0.1 * rate), 1), n // 3)
    drift = 2 * np.abs(values[-third:].mean(axis=0) - values[:third].mean(axis=0))
    change = np.abs(values[-last:].mean(axis=0) - values[:-last].mean(axis=0))
    for size, by_chance, word in (
            (values.std(axis=0), 0.0, 'scatters by'),
            (drift, 2 * np.sqrt(2 / third), 'drifts by'),
            (change, np.sqrt(1 / last + 1 / (n - last)), 'has just changed by')):
        # motion or contact is what exceeds the noise at rest so many times: noise levels drift by
        # a factor of two on their own
        # standard errors by which two means of noise may differ: one tare in a thousand is refused
        # without a cause at most, on one of its twelve channels
        allowed = np.hypot(3.0, 4.0 * by_chance) * noise
        worst = int(np.argmax(size / allowed))
        channel = CHANNELS['wrench'][worst]
        if size[worst] > allowed[worst]:
            most = below(allowed[worst], size[worst])
            raise DataError(
                f'tare refused, {what}: {channel} {word} '
                f'{above(size[worst], float(most))} > {most} {"N" if worst < 3 else "N m"}; '
                f'{remedy}')


class Window:
    """
    The last samples and poses: so many seconds, or longer where that is too few samples.

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
        """Keep a sample; what remains spans ``seconds`` as soon as so much arrived."""
        samples = self.samples
        if samples and not 0 <= sample.t - samples[-1].t <= MAX_PAUSE_S:
            self.clear()
        samples.append(sample)
        while len(samples) > MIN_SAMPLES and sample.t - samples[1].t >= self.seconds:
            samples.popleft()

    def add_pose(self, t: float, pose: tuple[float, ...]) -> None:
        """Keep a pose as long as there are samples of its time."""
        poses = self.poses
        poses.append((t, pose))
        oldest = self.samples[0].t if self.samples else t - self.seconds
        # where the wrench has stopped
        oldest = max(oldest, t - self.seconds - MIN_SAMPLES * MAX_PAUSE_S)
        while poses and poses[0][0] < oldest:
            poses.popleft()

    def poses_of_samples(self) -> list[tuple[float, ...]]:
        """Return the poses from the first sample on."""
        return [pose for t, pose in self.poses if self.samples and self.samples[0].t <= t]


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
    # a robot that stays within it over the window is at rest: 25 times the scatter of
    # the nominal rig's poses [m]
    # a robot that turns by less over the window is at rest: 50 times the scatter of the
    # nominal rig's poses [rad]
    if distance > 5e-4 or angle > 1e-3:
        raise DataError(f'tare refused, the robot moves: {distance * 1e3:.2f} mm, '
                        f'{angle * 1e3:.2f} mrad within the window; stop the robot')


class LiveObserver:
    """
    A state of the chain, with the model that it runs by.

    Attributes
    ----------
    model : Model or None
        None until the first :meth:`take_over`.
    window : Window
        What is kept for a tare.
    fade_duration : float
        Over which a new model is faded in [s].
    state : State
        Of the chain.
    tracker : Tracker or None
        Follows what hangs on the sensor, if enabled.
    takes_tracked : bool
        Whether the load of that is removed from then on.
    """

    def __init__(self, tare_duration: float, fade_duration: float) -> None:
        self.model: Model | None = None
        self.window, self.fade_duration = Window(tare_duration), fade_duration
        self.tracker: Tracker | None = None
        self.takes_tracked = False
        self._negative = False
        self._turn: Array | None = None
        self._level: Quaternion | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self.state = State()
        self._last: ContactSample | None = None
        self._published = NO_WRENCH
        self._fade: Fade | None = None
        self._changed = False
        self.window.clear()
        self._count = self._status = 0

    def let_go(self) -> None:
        """Forget the model as well."""
        self.model = None
        self.reset()

    def take_over(self, model: Model, wrench_sign: int = 1,
                  gravity_direction: Values | None = None,
                  sensor_rotation: Values | None = None) -> None:
        """
        Run by another model from the next wrench on.

        Parameters
        ----------
        wrench_sign : int
            -1: the readings are of the tool on its environment.
        gravity_direction : tuple of 3 float or None
            In base; None: along -z.
        sensor_rotation : tuple of 3 float or None
            Rotation vector of the wire's axes, seen from the frame of the pose [rad].
        """
        R = level_from_base(gravity_direction)
        self._level = None if R is None else quaternion_of(R)
        self._turn = pose_from_wire(sensor_rotation)
        self._negative = wrench_sign < 0
        self._run_by(model)

    def _run_by(self, model: Model) -> None:
        self._changed = self.model is not None and self._last is not None
        self.model = model
        forget_learned_bias(self.state)

    def take_settings(self, model: Model) -> None:
        """Do the same for a model of the same calibration, whose bias may have been tared."""
        self._run_by(model if self.model is None else with_bias(model, self.model.bias))

    def take_tool(self, mass: float, com: Array, inertia: Array | None = None) -> None:
        """Remove another load from the next wrench on; see ``design.with_tool``."""
        if self.model is not None:
            x, y, z = np.asarray(com).tolist()
            self.take_settings(with_tool(self.model, mass, (x, y, z), inertia))

    def on_wrench(self, t: float, values: Values) -> Samples:
        """Take in a wrench; ``t`` in seconds since any fixed instant, as for the others."""
        if self._negative:
            a, b, c, d, e, f = values
            values = (-a, -b, -c, -d, -e, -f)
        if self._turn is not None:
            force, torque = self._turn @ values[:3], self._turn @ values[3:]
            values = (*force.tolist(), *torque.tolist())
        return self._answer(step.on_wrench(self.state, t, values, self.model))  # type: ignore[arg-type]

    def on_accelerometer(self, t: float, values: Values) -> Samples:
        """Take in an acceleration."""
        return self._answer(step.on_accelerometer(self.state, t, values, self.model))  # type: ignore[arg-type]

    def on_displacement(self, t: float, values: Values) -> Samples:
        """Take in a displacement."""
        return self._answer(step.on_displacement(
            self.state, t, values[0], self.model))  # type: ignore[arg-type]

    def on_pose(self, t: float, values: Values) -> Samples:
        """Take in a pose: position, quaternion xyzw."""
        if self._level is not None:
            x, y, z, a, b, c, d = values
            values = (*rotate(self._level, (x, y, z)), *compose(self._level, (a, b, c, d)))
        self.window.add_pose(t, values)
        return self._answer(step.on_pose(
            self.state, t, values[:3], values[3:], self.model))  # type: ignore[arg-type]

    def finish(self) -> Samples:
        """Answer the wrenches still waiting."""
        return () if self.model is None else self._answer(step.finish(self.state, self.model))

    def _answer(self, result: Result) -> Samples:
        self.state, samples = result
        if not samples:
            return ()
        smoothed = tuple(map(self._smooth, samples))
        if self.tracker is not None:
            self._track(self.tracker, samples)
        return smoothed

    def _track(self, tracker: Tracker, samples: Samples) -> None:
        """Let the tracker have what the chain has made of its readings, by the same model."""
        assert self.model is not None
        found = [tracker.take(sample, self.state, self.model) for sample in samples]
        news = tracker.news() if any(found) else None
        if news is not None and self.takes_tracked:
            self.take_tool(news.mass, news.com)

    def _smooth(self, sample: ContactSample) -> ContactSample:
        """Fade over from what was published before, and keep what a tare and a report need."""
        kept = sample
        if self._changed and self._last is not None:
            self._changed = False
            kept = rebase(self.state, self._last, sample)
            self._fade = Fade(kept.t, self.fade_duration,
                              wrench_tuple(np.subtract(self._published, kept.contact)))
        sample = kept
        if self._fade is not None:
            contact = faded(self._fade, sample.t, sample.contact)
            if contact is None:
                self._fade = None
            else:
                sample = sample._replace(contact=contact)
        self._last, self._published = kept, sample.contact
        self.window.add(kept)
        self._count, self._status = self._count + 1, self._status | kept.status
        return sample

    def tare(self, model: Model, levels: NoiseLevels) -> Tare:
        """
        Make the contact wrench of the window zero, until the next model.

        Raises
        ------
        DataError
            The window is too short, the robot moves, or something touches the tool.
        """
        refuse_motion(self.window.poses_of_samples())
        result = tare(tuple(self.window.samples), model, levels, self.window.seconds)
        self.model = with_bias(model, result.bias)
        forget_learned_bias(self.state)
        self.window.clear()
        return result

    @property
    def refused(self) -> tuple[int, ...]:
        """Messages that were not used: wrench, accelerometer, pose, displacement."""
        return self.state.refusals.counts

    @property
    def noise_level(self) -> float:
        """Variance of the wrench's noise over that in the calibration, by ``kalman``."""
        memory = self.state.filter
        return memory.noise.level if isinstance(memory, Memory) else 1.0

    @property
    def bandwidth(self) -> float:
        """Corner of the contact wrench in filter ``kalman`` now [Hz]; NaN in others."""
        model = self.model
        if model is None or model.filter != KALMAN:
            return nan
        if not model.adaptive:
            return model.rate / tau
        return rate_at(self.noise_level, model.rate, model.slowest) / tau

    def report(self) -> tuple[int, int]:
        """Return the number of samples since the last report, and all their status bits."""
        counted = self._count, self._status
        self._count = self._status = 0
        return counted


class Fade(NamedTuple):
    """A difference that is still to be removed, from ``start`` on, over ``duration`` [s]."""

    start: float
    duration: float
    difference: Wrench


def rebase(state: State, before: ContactSample, sample: ContactSample) -> ContactSample:
    """
    Move the contact filter to where a new model puts it, so that only a fade is seen of that.

    ``state`` is that after ``sample``, the first of the new model; ``before`` is the last of the
    old one. Filters that estimate biases begin anew with a model, and stay as they are.
    """
    if not isinstance(state.filter, Memory):
        return sample
    contact = wrench_tuple(np.add(before.contact, sample.measured) - before.measured)
    state.filter = state.filter._replace(contact=contact)
    return sample._replace(contact=contact)


def faded(fade: Fade, t: float, wrench: Wrench) -> Wrench | None:
    """
    Remove what is due of the difference at ``t`` [s], smoothly.

    None once the fade is over, or where time went back.
    """
    x = (t - fade.start) / fade.duration
    if not 0.0 <= x < 1.0:
        return None
    k = 1.0 - x * x * (3.0 - 2.0 * x)
    return wrench_tuple(np.array(wrench) + k * np.array(fade.difference))


def forget_learned_bias(state: State) -> None:
    """Let a filter that estimates biases begin anew, from the bias that its model has now."""
    if isinstance(state.filter, Belief):
        state.filter = Memory()
