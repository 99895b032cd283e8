"""A recording ready for diagnosis: its channels, its residual in block means, its parts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple
from weakref import ref

from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import (
    JointStream,
    Phase,
    PoseStream,
    Recording,
    Stream,
    TOUCHING,
)
from forcecal_ros.effects import Effect
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.signals import BLOCK, block_means, JOINTS, padded, RATE, Signals, Simulation
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.sparse import csr_array

STAGES = ('robot', 'tool', 'environment', 'wrench_sensor', 'accelerometer', 'pose', 'timing')
"""Stages along the chain from command to sensor; the clocks last."""

STREAM_SLICES = {
    'wrench': slice(0, 6), 'accelerometer': slice(6, 9), 'optidrive': slice(9, 10),
    'pose': slice(10, 16), 'joints': slice(16, 16 + JOINTS),
}
"""Which channels each stream has, by their place in CHANNELS."""


class Channel(NamedTuple):
    """One scalar signal: its name, unit, and the stream it comes from."""

    name: str
    unit: str
    stream: str
    stage: str


CHANNELS = (
    *(Channel(f'force.{a}', 'N', 'wrench', 'wrench_sensor') for a in 'xyz'),
    *(Channel(f'torque.{a}', 'N m', 'wrench', 'wrench_sensor') for a in 'xyz'),
    *(Channel(f'accel.{a}', 'V', 'accelerometer', 'accelerometer') for a in 'xyz'),
    Channel('optidrive', 'm', 'optidrive', 'tool'),
    *(Channel(f'pose.{a}', 'm', 'pose', 'robot') for a in 'xyz'),
    *(Channel(f'pose.r{a}', 'rad', 'pose', 'robot') for a in 'xyz'),
    *(Channel(f'joint.{i}', 'rad', 'joints', 'robot') for i in range(JOINTS)),
)
"""In the order of the columns of every residual."""


def units(accelerometer: str = 'V') -> dict[str, str]:
    """Return every channel's unit, the accelerometer's in what its readings were brought to."""
    return {c.name: accelerometer if c.stream == 'accelerometer' else c.unit for c in CHANNELS}


GRID_TOLERANCE = 1e-3
"""A stamp this close to a simulated sample, in samples, takes it as it is."""


class _Stream(NamedTuple):
    """
    How one stream's samples fall into blocks and onto the simulated samples.

    ``at``: interpolates simulated samples to the measured ones; ``mean``: averages these over each
    of ``blocks``; ``mean_at``: both; ``means``: of the values.
    """

    t: Array
    values: Array
    at: csr_array
    mean: csr_array
    mean_at: csr_array
    counts: Array
    blocks: NDArray[np.intp]
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
        for name in STREAM_SLICES:
            if (measured := getattr(recording, name)) is not None:
                self._add(name, measured.t, _columns(measured))
        joints = recording.joints
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
        ok &= u <= last + GRID_TOLERANCE
        if not ok.any():
            return
        # a stretch of a recording needs no copy
        first_kept, last_kept = ok.argmax(), len(ok) - ok[::-1].argmax()
        kept = slice(first_kept, last_kept) if ok[first_kept:last_kept].all() else ok
        u, block = u[kept], block[kept]
        n, nearest = len(u), np.rint(u)
        if np.abs(u - nearest).max() < GRID_TOLERANCE:
            first, weights = nearest.astype(np.intp), np.ones((n, 1))
        else:
            first = np.clip(np.floor(u).astype(np.intp) - 1, 0, last - 3)
            weights = _lagrange(u - first)
        k = weights.shape[1]
        at = csr_array((weights.ravel(), (first[:, np.newaxis] + np.arange(k)).ravel(),
                        k * np.arange(n + 1)), shape=(n, last + 1))
        starts = np.flatnonzero(np.diff(block, prepend=-1))
        counts = np.diff(starts, append=n).astype(float)
        mean = csr_array((np.repeat(1.0 / counts, counts.astype(np.intp)), np.arange(n),
                          np.append(starts, n)), shape=(len(starts), n))
        self._streams[name] = _Stream(t[kept], values[kept], at, mean, csr_array(mean @ at),
                                      counts, block[starts], mean @ values[kept])

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
                means = stream.means - stream.mean_at @ _simulated(name, signals)
            out[stream.blocks, STREAM_SLICES[name]] = means
        return out

    def _pose(self, stream: _Stream, signals: Signals) -> Array:
        """Return block means of one pose's residual: most simulations move as the last one did."""
        known = self._last_pose
        if known is None or known[0]() is not signals.position \
                or known[1]() is not signals.R_base_sensor:
            means = stream.mean @ self._rows('pose', stream, signals)
            self._last_pose = known = ref(signals.position), ref(signals.R_base_sensor), means
        return known[2]

    def of_wrench(self, simulated: Array) -> Array:
        """Block means of another simulated signal at the samples of the wrench, (n_blocks, k)."""
        out = np.zeros((self.n_blocks, simulated.shape[1]))
        if 'wrench' in self._streams:
            stream = self._streams['wrench']
            out[stream.blocks] = stream.mean_at @ simulated
        return out

    def since(self, name: str, instant: float) -> Array:
        """Share of each block's samples of one stream from an instant on, shape (n_blocks,)."""
        out = np.zeros(self.n_blocks)
        if name in self._streams:
            stream = self._streams[name]
            out[stream.blocks] = stream.mean @ (stream.t >= instant)
        return out

    def times(self, name: str) -> Array:
        """Stamps of the measured samples of one stream [s]."""
        return self._streams[name].t

    def scatter(self, signals: Signals) -> Array:
        """Mean square of the samples about their block means, shape (channels,)."""
        out = np.zeros(len(CHANNELS))
        for name, stream in self._streams.items():
            rows = self._rows(name, stream, signals)
            means = np.repeat(stream.mean @ rows, stream.counts.astype(np.intp), axis=0)
            out[STREAM_SLICES[name]] = np.sum((rows - means) ** 2, axis=0) / max(
                1.0, float(np.sum(stream.counts - 1.0))) * (1.0 - 1.0 / stream.counts.mean())
        return out

    def samples(self, name: str, signals: Signals) -> Array:
        """Measured less simulated of one stream, sample by sample, shape (n, columns)."""
        return self._rows(name, self._streams[name], signals)

    def _rows(self, name: str, stream: _Stream, signals: Signals) -> Array:
        if name != 'pose':
            return np.asarray(stream.values - stream.at @ _simulated(name, signals))
        position = stream.at @ signals.position
        rotation = (stream.at @ signals.R_base_sensor.reshape(-1, 9)).reshape(-1, 3, 3)
        turned = np.swapaxes(rotation, 1, 2) @ stream.values[:, 3:].reshape(-1, 3, 3)
        turn = 0.5 * np.stack([turned[:, 2, 1] - turned[:, 1, 2],
                               turned[:, 0, 2] - turned[:, 2, 0],
                               turned[:, 1, 0] - turned[:, 0, 1]], axis=1)
        return np.concatenate([stream.values[:, :3] - position, turn], axis=1)


def _columns(measured: Stream | PoseStream) -> Array:
    if isinstance(measured, PoseStream):
        return np.hstack([measured.position, measured.R_base_sensor.reshape(-1, 9)])
    return padded(measured.values) if isinstance(measured, JointStream) else measured.values


def _simulated(name: str, s: Signals) -> Array:
    found = {'wrench': s.wrench, 'accelerometer': s.volts, 'joints': s.joints,
             'optidrive': s.optidrive[:, np.newaxis]}[name]
    assert found is not None
    return found


def _lagrange(x: Array) -> Array:
    """Weights of four equidistant samples for a place ``x`` after the first, shape (n, 4)."""
    return np.stack([
        -(x - 1.0) * (x - 2.0) * (x - 3.0) / 6.0, x * (x - 2.0) * (x - 3.0) / 2.0,
        -x * (x - 1.0) * (x - 3.0) / 2.0, x * (x - 1.0) * (x - 2.0) / 6.0], axis=1)


REST_AFTER_BLOCKS = 50
"""Blocks without motion before it counts as standstill."""

HYSTERESIS = 'wrench_hysteresis'
"""Effect whose range the recordings themselves narrow."""


@dataclass(frozen=True)
class Dataset:
    """
    A recording ready for diagnosis.

    Attributes
    ----------
    rig : Rig
        As given.
    groups : ndarray of int, shape (n,)
        Index into autoregression.GROUPS of each block.
    phases : tuple of Phase
        As recorded, else made up from the motion.
    train, held : ndarray of bool, shape (n,)
        Blocks to fit on, and to judge on.
    """

    recording: Recording
    simulation: Simulation
    measured: MeasuredBlocks
    rig: Rig
    groups: NDArray[np.intp]
    phases: tuple[Phase, ...]
    train: NDArray[np.bool_]
    held: NDArray[np.bool_]

    @property
    def nominal(self) -> Signals:
        """Simulate the rig as given: the signals of ten minutes fill much memory."""
        return self.simulation.signals(self.rig)

    @property
    def times(self) -> Array:
        """Middle of each block [s]."""
        return np.asarray(self.measured.start + BLOCK * (0.5 + np.arange(len(self.groups))))

    def phase_rows(self) -> dict[str, NDArray[np.bool_]]:
        """Say which blocks each phase word covers."""
        t = self.times
        found: dict[str, NDArray[np.bool_]] = {}
        for phase in self.phases:
            rows = (t >= phase.start) & (t < phase.end)
            found[phase.name] = found.get(phase.name, np.zeros(len(t), dtype=bool)) | rows
        return {name: rows for name, rows in found.items() if rows.any()}

    def exclude_contact(self) -> bool:
        """Leave out phases that touch something; return whether there are any."""
        touching = [rows for phase, rows in self.phase_rows().items() if phase in TOUCHING]
        for rows in touching:
            self.measured.present[rows] = False
        return bool(touching)


def make_dataset(recording: Recording, compared: Recording, simulation: Simulation, rig: Rig,
                 groups: NDArray[np.intp]) -> Dataset:
    """
    Join a recording and its simulation; all blocks are for training.

    Parameters
    ----------
    compared : Recording
        The streams of it that are compared.
    groups : ndarray of int, shape (n_blocks,)
        0 at rest, 1 in motion, 2 in contact.
    """
    start, n = simulation.start, simulation.n_blocks
    return Dataset(recording, simulation, MeasuredBlocks(compared, start, n), rig, groups,
                   recording.phases or infer_phases(groups, start), np.ones(n, dtype=bool),
                   np.zeros(n, dtype=bool))


def possible_effects(datasets: Sequence[Dataset]) -> Mapping[str, Effect]:
    """
    Narrow the library by what recordings show without a model.

    The load's range is twice the width of a hysteresis at least, so that the load can turn for
    that much: of a wider one only a gain would show.
    """
    library = dict(datasets[0].simulation.library)
    if HYSTERESIS in library:
        widest = 0.5 * max(float(np.ptp(dataset.nominal.wrench[:, :3], axis=0).max())
                           for dataset in datasets)
        library[HYSTERESIS] = library[HYSTERESIS]._replace(parameters=tuple(
            q if q.name != 'width' else q._replace(
                high=max(q.low, min(q.high, widest)),
                starts=tuple(s for s in q.starts if s <= widest) or q.starts[:1])
            for q in library[HYSTERESIS].parameters))
    return library


def split_datasets(datasets: Sequence[Dataset], by_phase: bool = False) -> tuple[Dataset, ...]:
    """
    Judge on all of a second recording or, of one, on some of its blocks.

    Parameters
    ----------
    datasets : sequence of Dataset
        One or two.
    by_phase : bool
        Whether these are parts of every phase, else every other second.
    """
    one, *others = datasets
    if others:
        return one, replace(others[0], train=others[0].held, held=others[0].train)
    if by_phase:
        return (split_by_phase(one),)
    held = np.floor(one.times - one.measured.start).astype(int) % 2 == 1
    return (replace(one, train=~held, held=held),)


def split_by_phase(dataset: Dataset) -> Dataset:
    """
    Hold out parts of every phase of one recording.

    Phases that occur more than once alternate; the last half of every other one is held out.
    """
    held, t = np.zeros(len(dataset.groups), dtype=bool), dataset.times
    count: dict[str, int] = {}
    for phase in dataset.phases:
        rows = (t >= phase.start) & (t < phase.end)
        several = sum(p.name == phase.name for p in dataset.phases) > 1
        turn = count[phase.name] = count.get(phase.name, -1) + 1
        if not several:
            rows &= t >= 0.5 * (phase.start + phase.end)
        if not several or turn % 2:
            held |= rows
    if not held.any():
        held = t >= t.mean()
    return replace(dataset, train=~held, held=held)


def infer_phases(groups: NDArray[np.intp], start: float) -> tuple[Phase, ...]:
    """Name the phases of a recording that does not say them, by its kinds of motion."""
    words = ('measure', 'move', 'contact')
    edges = [0, *(np.flatnonzero(np.diff(groups)) + 1), len(groups)]
    return tuple(Phase(words[groups[i]], start + BLOCK * i, start + BLOCK * j)
                 for i, j in pairwise(edges))


MIN_MOTION_S = 3.0
"""Length of a recording without commands, at least, that can be diagnosed [s]."""


def require_wrench_and_pose(recording: Recording, otherwise: str) -> None:
    """Refuse a recording without them in some words, and one that has too few of them."""
    if recording.wrench is None or recording.pose is None:
        raise DataError(otherwise)
    if why := too_few(recording):
        raise DataError(f'{why}; record 15 s of motion without losing messages')


def too_few(recording: Recording) -> str:
    """Return that wrench or pose have too few samples for a comparison; empty if not."""
    needed = {'wrench': 100, 'pose': 20}
    few = [f'{len(stream)} samples of the {name}' for name, least in needed.items()
           if (stream := getattr(recording, name)) is not None and len(stream) < least]
    return f'{" and ".join(few)} are too few for a comparison' if few else ''


def span(*recordings: Recording, margin: float = 0.0) -> tuple[float, int]:
    """Return when all streams are there, with a margin [s] about it, and how many blocks."""
    streams = [s.t for r in recordings for s in (r.wrench, r.pose, r.accelerometer)
               if s is not None]
    edge = margin + 0.03  # so late may one sensor be behind another [s]
    first = max(float(t[0]) for t in streams) + edge
    last = min(float(t[-1]) for t in streams) - edge
    if last - first < MIN_MOTION_S:
        common = below(max(0.0, last - first), MIN_MOTION_S)
        raise DataError(f'wrench and motion overlap for {common} s; at '
                        f'least {MIN_MOTION_S:g} s are needed; record a longer motion')
    return first, int((last - first) / BLOCK)


def motion_groups(signals: Signals) -> NDArray[np.intp]:
    """Sort blocks into rest (0), of a compliant axis, too, and motion or near it (1), by means."""
    slide = np.gradient(signals.optidrive, 1.0 / RATE)[:, np.newaxis]
    means = [uniform_filter1d(block_means(rows), REST_AFTER_BLOCKS // 2, axis=0, mode='nearest')
             for rows in (signals.omega, np.hstack([signals.velocity, slide]))]
    # noisy poses show less than 5 mrad/s and 2 mm/s
    speed = np.maximum(*(np.linalg.norm(m, axis=1) / s for m, s in zip(means, (0.005, 0.002))))
    near = maximum_filter1d((speed > 1.0).astype(float), 2 * REST_AFTER_BLOCKS + 1)
    return np.asarray(near, dtype=np.intp)
