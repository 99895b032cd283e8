"""Measured less simulated, as block means of all channels on the grid of the robot's periods."""

from typing import NamedTuple
from weakref import ref

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.inputs.channels import CHANNELS, STREAM_SLICES
from forcecal_ros.sim.signals import BLOCK, padded, RATE, Signals
import numpy as np
from numpy.typing import NDArray

EXACT = 1e-3
"""A stamp this close to a simulated sample, in samples, takes it as it is."""


class _Stream(NamedTuple):
    """
    How one stream's samples fall into blocks and onto the simulated samples.

    ``gapless``: they are consecutive simulated ones; ``per_block``: every block has so many of
    them, 0 where the blocks differ; ``means``: of the values, block by block.
    """

    t: Array
    values: Array
    first: NDArray[np.intp]
    weights: Array | None
    starts: NDArray[np.intp]
    counts: Array
    blocks: NDArray[np.intp]
    gapless: bool
    per_block: int
    means: Array


class MeasuredBlocks:
    """
    The measured channels of one recording.

    Parameters
    ----------
    recording : Recording
        The accelerometer in volts.
    start : float
        Of block 0 [s].
    """

    def __init__(self, recording: Recording, start: float, n_blocks: int) -> None:
        self.start, self.n_blocks = start, n_blocks
        self._streams: dict[str, _Stream] = {}
        self._last_pose: tuple[ref[Array], ref[Array], Array] | None = None
        if recording.wrench is not None:
            self._add('wrench', recording.wrench.t, recording.wrench.values)
        if recording.accelerometer is not None:
            self._add('accelerometer', recording.accelerometer.t, recording.accelerometer.values)
        if recording.optidrive is not None:
            self._add('optidrive', recording.optidrive.t, recording.optidrive.values)
        pose = recording.pose
        if pose is not None:
            values = np.concatenate([pose.position, pose.R_base_sensor.reshape(-1, 9)], axis=1)
            self._add('pose', pose.t, values)
        joints = recording.joints
        if joints is not None:
            self._add('joints', joints.t, padded(joints.values))
        self.present = np.zeros((n_blocks, len(CHANNELS)), dtype=bool)
        for name, stream in self._streams.items():
            rows = np.zeros(n_blocks, dtype=bool)
            rows[stream.blocks] = True
            self.present[:, STREAM_SLICES[name]] = rows[:, np.newaxis]
        if joints is not None:
            self.present[:, STREAM_SLICES['joints'].start + joints.values.shape[1]:] = False

    def _add(self, name: str, t: Array, values: Array) -> None:
        u = (t - self.start) * RATE - 1.0
        block = np.ceil((t - self.start) / BLOCK - 1e-6).astype(np.intp) - 1
        last = self.n_blocks * round(BLOCK * RATE) - 1
        ok = (block >= 0) & (block < self.n_blocks) & np.isfinite(values).all(axis=1)
        ok &= u <= last + EXACT
        if not ok.any():
            return
        # a stretch of a recording needs no copy
        first_kept, last_kept = ok.argmax(), len(ok) - ok[::-1].argmax()
        kept = slice(first_kept, last_kept) if ok[first_kept:last_kept].all() else ok
        u, block = u[kept], block[kept]
        nearest = np.rint(u)
        if np.abs(u - nearest).max() < EXACT:
            first, weights = nearest.astype(np.intp), None
        else:
            first = np.clip(np.floor(u).astype(np.intp) - 1, 0, last - 3)
            weights = _lagrange(u - first)
        starts = np.flatnonzero(np.diff(block, prepend=-1))
        counts = np.diff(starts, append=len(block)).astype(float)
        gapless = weights is None and bool((np.diff(first) == 1).all())
        per_block = int(counts[0]) if (counts == counts[0]).all() else 0
        stream = _Stream(t[kept], values[kept], first, weights, starts, counts, block[starts],
                         gapless, per_block, np.zeros(0))
        self._streams[name] = stream._replace(means=_means(stream.values, stream))

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of the streams there are."""
        return tuple(self._streams)

    def residual(self, signals: Signals) -> Array:
        """
        Block means of measured less simulated.

        Returns
        -------
        ndarray, shape (n_blocks, channels)
            Zero where nothing was measured, see ``present``.
        """
        out = np.zeros((self.n_blocks, len(CHANNELS)))
        for name, stream in self._streams.items():
            if name == 'pose':
                means = self._pose(stream, signals)
            else:
                means = stream.means - _means(_at(_simulated(name, signals), stream), stream)
            out[stream.blocks, STREAM_SLICES[name]] = means
        return out

    def _pose(self, stream: _Stream, signals: Signals) -> Array:
        """Return block means of one pose's residual: most simulations move as the last one did."""
        known = self._last_pose
        if known is None or known[0]() is not signals.position \
                or known[1]() is not signals.R_base_sensor:
            means = _means(self._rows('pose', stream, signals), stream)
            self._last_pose = known = ref(signals.position), ref(signals.R_base_sensor), means
        return known[2]

    def of_wrench(self, simulated: Array) -> Array:
        """Block means of another simulated signal at the samples of the wrench, (n_blocks, k)."""
        out = np.zeros((self.n_blocks, simulated.shape[1]))
        if 'wrench' in self._streams:
            stream = self._streams['wrench']
            out[stream.blocks] = _means(_at(simulated, stream), stream)
        return out

    def since(self, name: str, instant: float) -> Array:
        """Share of each block's samples of one stream from an instant on, shape (n_blocks,)."""
        out = np.zeros(self.n_blocks)
        if name in self._streams:
            stream = self._streams[name]
            later = (stream.t >= instant).astype(float)
            out[stream.blocks] = _means(later[:, np.newaxis], stream)[:, 0]
        return out

    def times(self, name: str) -> Array:
        """Stamps of the measured samples of one stream [s]."""
        return self._streams[name].t

    def scatter(self, signals: Signals) -> Array:
        """Mean square of the samples about their block means, shape (channels,)."""
        out = np.zeros(len(CHANNELS))
        for name, stream in self._streams.items():
            rows = self._rows(name, stream, signals)
            means = np.repeat(_means(rows, stream), stream.counts.astype(np.intp), axis=0)
            out[STREAM_SLICES[name]] = np.sum((rows - means) ** 2, axis=0) / max(
                1.0, float(np.sum(stream.counts - 1.0))) * (1.0 - 1.0 / stream.counts.mean())
        return out

    def samples(self, name: str, signals: Signals) -> Array:
        """Measured less simulated of one stream, sample by sample, shape (n, columns)."""
        return self._rows(name, self._streams[name], signals)

    def values(self, name: str) -> Array:
        """Return the measured samples of one stream, shape (n, columns)."""
        return self._streams[name].values

    def _rows(self, name: str, stream: _Stream, signals: Signals) -> Array:
        if name != 'pose':
            return np.asarray(stream.values - _at(_simulated(name, signals), stream))
        position = _at(signals.position, stream)
        rotation = _at(signals.R_base_sensor.reshape(-1, 9), stream).reshape(-1, 3, 3)
        turned = np.swapaxes(rotation, 1, 2) @ stream.values[:, 3:].reshape(-1, 3, 3)
        turn = 0.5 * np.stack([turned[:, 2, 1] - turned[:, 1, 2],
                               turned[:, 0, 2] - turned[:, 2, 0],
                               turned[:, 1, 0] - turned[:, 0, 1]], axis=1)
        return np.concatenate([stream.values[:, :3] - position, turn], axis=1)


def _simulated(name: str, s: Signals) -> Array:
    if name == 'wrench':
        return s.wrench
    if name == 'accelerometer':
        return s.volts
    if name == 'optidrive':
        return s.optidrive[:, np.newaxis]
    assert s.joints is not None
    return s.joints


def _at(values: Array, stream: _Stream) -> Array:
    if stream.weights is None:
        first = int(stream.first[0])
        if stream.gapless:
            return values[first:first + len(stream.first)]
        return values[stream.first]
    out = np.zeros((len(stream.first), values.shape[1]))
    for i in range(4):
        out += stream.weights[:, i:i + 1] * values[stream.first + i]
    return out


def _means(rows: Array, stream: _Stream) -> Array:
    k = stream.per_block
    if k:
        total = rows[::k].copy()
        for i in range(1, k):
            total += rows[i::k]
        return np.asarray(total / k)
    return np.asarray(np.add.reduceat(rows, stream.starts, axis=0)
                      / stream.counts[:, np.newaxis])


def _lagrange(x: Array) -> Array:
    """Weights of four equidistant samples for a place ``x`` after the first, shape (n, 4)."""
    return np.stack([
        -(x - 1.0) * (x - 2.0) * (x - 3.0) / 6.0, x * (x - 2.0) * (x - 3.0) / 2.0,
        -x * (x - 1.0) * (x - 3.0) / 2.0, x * (x - 1.0) * (x - 2.0) / 6.0], axis=1)
