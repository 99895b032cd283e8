"""One recording made ready: simulated, aligned, in blocks, its motion sorted into kinds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Phase, Recording, TOUCHING
from forcecal_ros.diagnose.inputs.accelerometer import in_volts, mounted
from forcecal_ros.diagnose.inputs.command_timing import refuse_sparse_commands, start_of
from forcecal_ros.diagnose.inputs.residuals import MeasuredBlocks
from forcecal_ros.effects import Effect, EFFECTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import FORCES
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.signals import BLOCK, Signals, Simulation
import numpy as np
from numpy.typing import NDArray

FARTHEST = EFFECTS['wall_position'].parameters[0].high
"""Distance by which a wall may be nearer than in a rig's file: as an effect may shift it [m]."""

MARGIN = 25
"""Blocks before and after contact that count as contact."""

STILL = 50
"""Blocks without motion before it counts as standstill."""

HYSTERESIS, SATURATION = 'wrench_hysteresis', 'wrench_saturation'
"""Effects whose range the recordings themselves narrow."""

CLIPPED, NOISY = 0.99, 3.0
"""
Share of a channel's readings that are below a limit of its range, give or take so many standard
deviations of what neighbouring readings differ by: bursts that come after the limit are rarer.
"""

SHORTEST = 5.0
"""Length of a recording with commands, at least, that can be diagnosed [s]."""


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


def possible_effects(datasets: Sequence[Dataset]) -> Mapping[str, Effect]:
    """
    Narrow the library by what recordings show without a model.

    A hysteresis is no wider than its load's range: a wider one is a gain by another name. A range
    ends nowhere that the readings go beyond.
    """
    library = dict(datasets[0].simulation.library)
    if HYSTERESIS in library:
        library[HYSTERESIS] = within_load(datasets, library[HYSTERESIS])
    if SATURATION in library and all('wrench' in d.measured.streams for d in datasets):
        least = np.max([_reached(d.measured.values('wrench')) for d in datasets], axis=0)
        library[SATURATION] = _narrowed(library[SATURATION], {
            name: max(q.low, min(q.high, float(x))) for name, x in zip(FORCES, least)
            for q in library[SATURATION].parameters if q.name == name})
    return library


def within_load(datasets: Sequence[Dataset], effect: Effect) -> Effect:
    """Keep a hysteresis as narrow as the load's range."""
    widest = max(float(np.ptp(dataset.nominal.wrench[:, :3], axis=0).max())
                 for dataset in datasets)
    return effect._replace(parameters=tuple(
        q if q.name != 'width' else q._replace(
            high=max(q.low, min(q.high, widest)),
            starts=tuple(s for s in q.starts if s <= widest) or q.starts[:1])
        for q in effect.parameters))


def _narrowed(effect: Effect, lowest: Mapping[str, float]) -> Effect:
    return effect._replace(parameters=tuple(
        q._replace(low=lowest.get(q.name, q.low)) for q in effect.parameters))


def _reached(values: Array) -> Array:
    """Return what the magnitude of each channel reaches, its noise allowed for."""
    noise = np.diff(values, axis=0).std(axis=0) / np.sqrt(2.0)
    return np.asarray(np.quantile(np.abs(values), CLIPPED, axis=0) - NOISY * noise)


def without_touches(dataset: Dataset, rig: Rig) -> bool:
    """Leave out phases that touch what a rig has no wall for; say whether there are any."""
    signals = dataset.nominal
    tip = signals.position + signals.R_base_sensor @ np.array(rig.tool.tip)
    if tip[:, 0].max() + FARTHEST > rig.wall.position:
        return False
    touching = [rows for phase, rows in dataset.phase_rows().items() if phase in TOUCHING]
    for rows in touching:
        dataset.measured.present[rows] = False
    return bool(touching)


def prepare(recording: Recording, rig: Rig, accelerometer: str | None = None) -> Dataset:
    """
    Make one recording ready; all of its blocks are for training.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised by its volts where none is given.

    Raises
    ------
    DataError
        Commands or wrench are missing, most commands are, or they overlap for too short a time.
    """
    name = accelerometer or mounted(recording, rig)
    refuse_sparse_commands(recording, rig, name)
    start = start_of(recording, rig, name)
    assert recording.target is not None
    sensed = [s.t for s in (recording.wrench, recording.accelerometer, recording.optidrive)
              if s is not None and len(s)]
    if not sensed:
        raise DataError('the recording holds neither wrench nor accelerometer nor displacement; '
                        'record at least the wrench')
    end = min(max(float(t[-1]) for t in sensed), float(recording.target.t[-1]) + BLOCK)
    if end - max(start, min(float(t[0]) for t in sensed)) < SHORTEST:
        common = below(max(0.0, end - start), SHORTEST)
        raise DataError(f'commands and sensors overlap for {common} s; at least {SHORTEST:g} s '
                        'are needed: record a longer sequence')
    replay = Replay(rig, recording.target, start, end, name)
    nominal = replay.signals(rig)
    n = replay.n_blocks
    measured = MeasuredBlocks(in_volts(replace(recording, joints=None), rig, name), start, n)
    groups = _kinds(nominal, n)
    phases = recording.phases or made_up(groups, start)
    return Dataset(recording, replay, measured, rig, groups, phases,
                   np.ones(n, dtype=bool), np.zeros(n, dtype=bool))


def held_apart(train: Dataset, held: Dataset) -> tuple[Dataset, Dataset]:
    """Fit on all of one recording, judge on all of another."""
    return train, replace(held, train=held.held, held=held.train)


def split(dataset: Dataset) -> Dataset:
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


def _kinds(signals: Signals, n: int) -> NDArray[np.intp]:
    touching = np.abs(signals.contact[:, :3]).max(axis=1).reshape(n, -1).max(axis=1) > 0.0
    rate = np.abs(signals.velocity).max(axis=1) + np.abs(signals.omega).max(axis=1) \
        + np.abs(signals.speed)
    moving = rate.reshape(n, -1).max(axis=1) > 1e-4
    groups = np.zeros(n, dtype=np.intp)
    groups[_after(moving, STILL)] = 1
    groups[_after(touching, MARGIN)] = 2
    return groups


def _after(flag: NDArray[np.bool_], blocks: int) -> NDArray[np.bool_]:
    """Spread each true value over the blocks that follow it, and a few before."""
    count = np.convolve(flag, np.ones(blocks + 1))[:len(flag)] > 0.5
    before = np.convolve(flag[::-1], np.ones(6))[:len(flag)][::-1] > 0.5
    return np.asarray(count | before)


def made_up(groups: NDArray[np.intp], start: float) -> tuple[Phase, ...]:
    """Name the phases of a recording that does not say them, by its kinds of motion."""
    words = ('measure', 'move', 'contact')
    edges = [0, *(np.flatnonzero(np.diff(groups)) + 1), len(groups)]
    return tuple(Phase(words[groups[i]], start + BLOCK * i, start + BLOCK * j)
                 for i, j in pairwise(edges))
