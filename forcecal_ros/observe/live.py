"""The chain as a node runs it: models change without a jump, and biases can be tared."""

from math import nan, tau
from typing import NamedTuple

from forcecal_ros.core.axes import level_from_base, pose_from_wire
from forcecal_ros.core.geometry import Array, quaternion_of
from forcecal_ros.observe.bandwidth import NoiseLevels
from forcecal_ros.observe.design import Model, with_tool
from forcecal_ros.observe.filters.memory import KALMAN, Memory
from forcecal_ros.observe.filters.noise_level import rate_at
from forcecal_ros.observe.payload.tracker import Tracker
from forcecal_ros.observe.sample import ContactSample, NO_WRENCH, Wrench
from forcecal_ros.observe.step import (
    finish,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    Result,
    State,
)
from forcecal_ros.observe.tare import (
    refuse_motion,
    Tare,
    tare,
    Window,
    with_bias,
    without_learned_bias,
)
from forcecal_ros.observe.tracking import product, Quaternion, rotate
import numpy as np

Values = tuple[float, ...]
Samples = tuple[ContactSample, ...]


class Tally(NamedTuple):
    """What happened since the last report: samples, and all their status bits."""

    samples: int = 0
    status: int = 0


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
        Follows what hangs on the sensor, where it is wanted.
    takes_tracked : bool
        Whether the load of that is taken off from then on.
    """

    def __init__(self, tare_duration: float, fade_duration: float) -> None:
        self.model: Model | None = None
        self.window, self.fade_duration = Window(tare_duration), fade_duration
        self.tracker: Tracker | None = None
        self.takes_tracked = False
        self._negative = False
        self._direction: Values | None = None
        self._rotation: Values | None = None
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
        self._tally = Tally()

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
        self._changed = self.model is not None and self._last is not None
        self.model, self._negative = model, wrench_sign < 0
        self._direction = gravity_direction
        R = level_from_base(gravity_direction)
        self._level = None if R is None else quaternion_of(R)
        self._rotation = sensor_rotation
        self._turn = pose_from_wire(sensor_rotation)
        self.state = without_learned_bias(self.state)

    def take_settings(self, model: Model) -> None:
        """Do the same for a model of the same calibration, whose bias may have been tared."""
        if self.model is not None:
            model = with_bias(model, self.model.bias)
        self.take_over(model, -1 if self._negative else 1, self._direction,
                       self._rotation)

    def take_tool(self, mass: float, com: Array, inertia: Array | None = None) -> None:
        """Take off another load from the next wrench on; see ``design.with_tool``."""
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
        return self._answer(on_wrench(self.state, t, values, self.model))  # type: ignore[arg-type]

    def on_accelerometer(self, t: float, values: Values) -> Samples:
        """Take in an acceleration."""
        return self._answer(on_accelerometer(self.state, t, values, self.model))  # type: ignore[arg-type]

    def on_displacement(self, t: float, values: Values) -> Samples:
        """Take in a displacement."""
        return self._answer(on_displacement(
            self.state, t, values[0], self.model))  # type: ignore[arg-type]

    def on_pose(self, t: float, values: Values) -> Samples:
        """Take in a pose: position, quaternion xyzw."""
        if self._level is not None:
            x, y, z, a, b, c, d = values
            values = (*rotate(self._level, (x, y, z)), *product(self._level, (a, b, c, d)))
        self.window.add_pose(t, values)
        return self._answer(on_pose(
            self.state, t, values[:3], values[3:], self.model))  # type: ignore[arg-type]

    def finish(self) -> Samples:
        """Answer the wrenches still waiting."""
        return () if self.model is None else self._answer(finish(self.state, self.model))

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
        """Fade over from what was published before, and keep what a tare and a report want."""
        kept = sample
        if self._changed and self._last is not None:
            self._changed = False
            self.state, kept = rebased(self.state, self._last, sample)
            self._fade = begin_fade(kept.t, self.fade_duration, self._published, kept.contact)
        sample = kept
        if self._fade is not None:
            contact = faded(self._fade, sample.t, sample.contact)
            if contact is None:
                self._fade = None
            else:
                sample = sample._replace(contact=contact)
        self._last, self._published = kept, sample.contact
        self.window.add(kept)
        self._tally = Tally(self._tally.samples + 1, self._tally.status | kept.status)
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
        self.state = without_learned_bias(self.state)
        self.window.clear()
        if self.tracker is not None:
            self.tracker.tared(result.shift)
        return result

    @property
    def refused(self) -> tuple[int, ...]:
        """Messages that were not used: wrench, accelerometer, pose, displacement."""
        return self.state.refusals.counts

    @property
    def noise_level(self) -> float:
        """Variance of the wrench's noise over that in the calibration, as ``kalman`` hears it."""
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

    @property
    def status(self) -> int:
        """All status bits since the last report."""
        return self._tally.status

    def report(self) -> Tally:
        """Return the tally, and begin a new one."""
        tally, self._tally = self._tally, Tally()
        return tally


class Fade(NamedTuple):
    """A difference that is still to be taken off, from ``start`` on, over ``duration`` [s]."""

    start: float
    duration: float
    difference: Wrench


def rebased(state: State, before: ContactSample, sample: ContactSample
            ) -> tuple[State, ContactSample]:
    """
    Move the contact filter to where a new model puts it, so that only a fade is seen of that.

    ``state`` is that after ``sample``, the first of the new model; ``before`` is the last of the
    old one. Filters that estimate biases begin anew with a model, and stay as they are.
    """
    if not isinstance(state.filter, Memory):
        return state, sample
    a, b, c, d, e, f = (old + new - was for old, new, was in zip(
        before.contact, sample.measured, before.measured))
    contact = (a, b, c, d, e, f)
    return (state._replace(filter=state.filter._replace(contact=contact)),
            sample._replace(contact=contact))


def begin_fade(t: float, duration: float, before: Wrench, after: Wrench) -> Fade:
    """
    Begin at the first estimate of a new model.

    Parameters
    ----------
    t : float
        Its stamp [s].
    duration : float
        [s]
    before, after : tuple of 6 float
        What was published last, and what the new model says [N, N m].
    """
    a, b, c, d, e, f = (x - y for x, y in zip(before, after))
    return Fade(t, duration, (a, b, c, d, e, f))


def faded(fade: Fade, t: float, wrench: Wrench) -> Wrench | None:
    """
    Take off what is due of the difference at ``t`` [s], smoothly.

    None once the fade is over, or where time went back.
    """
    x = (t - fade.start) / fade.duration
    if not 0.0 <= x < 1.0:
        return None
    k = 1.0 - x * x * (3.0 - 2.0 * x)
    a, b, c, d, e, f = (w + k * difference for w, difference in zip(wrench, fade.difference))
    return a, b, c, d, e, f
