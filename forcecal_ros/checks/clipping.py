"""Channels whose values stop at a limit, or come in steps."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.held import dead_band
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.white import difference_gain
from forcecal_ros.core.streams import CHANNELS, PoseStream, Recording, Stream
import numpy as np
from numpy.typing import NDArray


class Steps(NamedTuple):
    """Values of one channel that are multiples of a step."""

    channel: str
    step: float


class Clipping(NamedTuple):
    """Values of one channel that stop at a limit: how many, and when the first of them."""

    channel: str
    limit: float
    samples: int
    start: float = 0.0

    def __str__(self) -> str:
        return (f'{self.channel} stops at {self.limit:.4g} ({self.samples} samples, the first '
                f'at {self.start:.2f} s)')


class Extreme(NamedTuple):
    """How often a channel reaches its extreme, and how often twice in a row."""

    samples: int
    repeated: int

    def is_limit(self, least: int = limits.CLIPPED) -> bool:
        """Whether it stops there: that often, and half of the time in a row."""
        return self.samples >= least and self.repeated >= 0.5 * self.samples


def noise_of(recording: Recording) -> dict[str, float]:
    """Return the RMS of each channel's noise, of neighbouring samples: white to motion."""
    found = {}
    for name, _, values in columns(recording):
        rough = np.abs(np.diff(values, n=3))
        scale = 0.6745 * np.sqrt(difference_gain(3))
        found[name] = float(np.median(rough) / scale) if len(rough) else 0.0
    return found


def quantisation(recording: Recording, noise: Mapping[str, float]) -> tuple[Steps, ...]:
    """
    Find channels whose values are multiples of a step that matters.

    Parameters
    ----------
    noise : mapping of str to float
        RMS of one sample of each channel.
    """
    found = []
    for name, _, values in columns(recording):
        step = resolution(values)
        if step > limits.STEPS * noise[name] and np.ptp(values) > 2.0 * step:
            found.append(Steps(name, step))
    return tuple(found)


def resolution(values: Array) -> float:
    """Return the step whose multiples values are; 0: they are none, or too few."""
    different = np.unique(values)
    if len(different) > 0.5 * len(values) or len(different) < 3:
        return 0.0
    gaps = np.diff(different)
    gaps = gaps[gaps > 1e-9 * np.abs(different).max()]
    step = float(np.percentile(gaps, 10))
    if step <= 0.0:
        return 0.0
    turns = (different - different[0]) / step
    step *= float(turns[-1] / np.rint(turns[-1])) if turns[-1] > 0.5 else 1.0
    off = (different - different[0]) / step
    return step if np.sqrt(np.mean((off - np.rint(off)) ** 2)) < 0.1 else 0.0


def clipping(recording: Recording, steps: tuple[Steps, ...], noise: Mapping[str, float]
             ) -> tuple[Clipping, ...]:
    """
    Find channels that stop at a limit.

    Parameters
    ----------
    steps : tuple of Steps
        Channels that come in steps repeat values of themselves; rough ones say nothing.
    noise : mapping of str to float
        RMS of one sample of each channel.
    """
    coarse, found = {s.channel: s.step for s in steps}, []
    for name, t, values in columns(recording):
        if coarse.get(name, 0.0) > limits.ROUGH * noise[name] or not np.ptp(values) > 0.0:
            continue
        least = limits.CLIPPED_IN_STEPS if name in coarse else limits.CLIPPED
        for extreme in (values.max(), values.min()):
            at = values == extreme
            if Extreme(int(at.sum()), int(np.sum(at[1:] & at[:-1]))).is_limit(least):
                found.append(Clipping(name, float(extreme), int(at.sum()),
                                      float(t[np.argmax(at)])))
    return tuple(found)


def clipped(recording: Recording) -> tuple[Clipping, ...]:
    """
    Find channels that stop at a limit, by the noise that they show themselves.

    One that mostly repeats itself, without noise or in coarse steps, rests at its extreme; zeros
    of a dead band are no end of the range.
    """
    noise = noise_of(recording)
    found = clipping(recording, quantisation(recording, noise), noise)
    banded = {name for name, _, values in columns(recording) if dead_band(values)}
    return tuple(one for one in found
                 if noise[one.channel] > limits.ROUNDING * abs(one.limit)
                 and (one.limit or one.channel not in banded))


def columns(recording: Recording) -> Iterator[tuple[str, Array, Array]]:
    """Name, stamps and values of each channel of a sensor."""
    for name in ('wrench', 'accelerometer', 'optidrive'):
        stream: Stream | None = getattr(recording, name)
        if stream is not None and len(stream):
            for channel, values in zip(CHANNELS[name], stream.values.T):
                yield channel, stream.t, values


def refuse_wrapped(stream: Stream, channels: Sequence[str], pose: PoseStream) -> None:
    """
    Refuse channels that leap from one end of their range to the other, as counts that wrap do.

    Parameters
    ----------
    pose : PoseStream
        Which does not leap meanwhile.

    Raises
    ------
    DataError
        Names the channels and the ends.
    """
    found = [f'{channel} leaps from one end of its range to the other ({values.min():.4g}, '
             f'{values.max():.4g}) {count} times'
             for channel, values in zip(channels, stream.values.T)
             if (count := _wraps(stream.t, values, pose))]
    if found:
        raise DataError(f'{"; ".join(found)}: its counts wrap around; raise the range of the '
                        'sensor')


def _wraps(t: Array, values: Array, pose: PoseStream) -> int:
    """Count how often a channel leaps from one end of its range to the other; 0: it does not."""
    span = float(np.ptp(values))
    steps = np.diff(values)
    at = np.flatnonzero(np.abs(steps) > limits.LEAP * span)
    if len(values) <= limits.DEAD or not len(at) or (
            np.median(np.abs(steps)) > limits.SMOOTH * span) or (
            span < limits.COUNTED * resolution(values)):
        return 0
    # noise leaps to and fro at the border, spikes stay at one end only
    if _crossed(values, at) < limits.WRAPS and not _wraps_once(values, int(at[0]), span):
        return 0
    ends = np.sort(np.stack([values[at], values[at + 1]]), axis=0)
    off = np.maximum(ends[0] - values.min(), values.max() - ends[1])
    before, after = (pose.R_base_sensor[np.searchsorted(pose.t, t[i]).clip(max=len(pose) - 1)]
                     for i in (at, at + 1))
    turned = np.linalg.norm(after - before, axis=(1, 2))
    return len(at) if (np.median(off) < limits.SMOOTH * span
                       and np.median(turned) < limits.TILTED) else 0


def _crossed(values: Array, at: NDArray[np.intp]) -> int:
    """Count how often a channel leaves one half of its range to stay in the other one."""
    upper = values > 0.5 * (values.max() + values.min())
    first = np.concatenate([[True], np.diff(at) >= limits.STAYS])
    crossed = 0
    for begin, end in zip(at[first], at[np.concatenate([first[1:], [True]])]):
        before, after = upper[:begin + 1][-limits.STAYS:], upper[end + 1:][:limits.STAYS]
        crossed += bool((before.all() and not after.any()) or (after.all() and not before.any()))
    return crossed


def _wraps_once(values: Array, at: int, span: float) -> bool:
    """Whether a channel leaps between ends of the same size, from and to where it stays long."""
    before, after = values[:at + 1][-limits.DEAD:], values[at + 1:][:limits.DEAD]
    return bool(abs(values.max() + values.min()) < limits.SYMMETRIC * span
                and abs(np.median(after) - np.median(before)) > 0.5 * span)
