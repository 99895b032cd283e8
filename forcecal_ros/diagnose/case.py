"""One recording made ready: simulated, aligned, in blocks, its motion sorted into kinds."""

from dataclasses import dataclass, replace
from itertools import pairwise

from forcecal_ros.diagnose.alignment import start_of
from forcecal_ros.diagnose.channels import BLOCK
from forcecal_ros.diagnose.replay import Replay
from forcecal_ros.diagnose.residual import Measured
from forcecal_ros.diagnose.simulation import Signals, Simulation
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import Phase, Recording, TOUCHING
import numpy as np
from numpy.typing import NDArray

FARTHEST = EFFECTS['wall_position'].parameters[0].high
"""By which a wall may be nearer than in a rig's file: as an effect may shift it [m]."""

MARGIN = 25
"""Blocks around contact that count as contact."""

STILL = 50
"""Blocks without motion before it counts as rest."""

SHORTEST = 5.0
"""Recording that can be diagnosed [s]."""


@dataclass(frozen=True)
class Case:
    """
    A recording ready for diagnosis.

    Attributes
    ----------
    recording : Recording
    simulation : Simulation
    measured : Measured
    nominal : Signals
        Of the rig as given.
    groups : ndarray of int, shape (n,)
        Index into autoregression.GROUPS of each block.
    phases : tuple of Phase
        As recorded, else made up from the motion.
    train, held : ndarray of bool, shape (n,)
        Blocks to fit on, and to judge on.
    """

    recording: Recording
    simulation: Simulation
    measured: Measured
    nominal: Signals
    groups: NDArray[np.intp]
    phases: tuple[Phase, ...]
    train: NDArray[np.bool_]
    held: NDArray[np.bool_]

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


def without_touches(case: Case, rig: Rig) -> bool:
    """Leave out phases that touch what a rig has no wall for; say whether there are any."""
    signals = case.nominal
    tip = signals.position + signals.R_base_sensor @ np.array(rig.tool.tip)
    if tip[:, 0].max() + FARTHEST > rig.wall.position:
        return False
    touching = [rows for phase, rows in case.phase_rows().items() if phase in TOUCHING]
    for rows in touching:
        case.measured.present[rows] = False
    return bool(touching)


def mounted(recording: Recording, rig: Rig) -> str:
    """Say which accelerometer was mounted: the one whose volts at the start fit better."""
    stream, name = recording.accelerometer, rig.accelerometer.mounted
    pose = recording.pose or recording.target
    if stream is None or recording.accelerometer_unit != 'V' or pose is None or not len(stream):
        return name
    first = stream.values[:max(1, int(0.3 * stream.rate))].mean(axis=0)
    up = -pose.R_base_sensor[0].T @ np.array(rig.gravity)

    def miss(candidate: str) -> float:
        model = rig.accelerometer.model(candidate)
        f = up if model.highpass == 0.0 else np.zeros(3)
        volts = np.array(model.gain) * f + model.offset
        return float(np.linalg.norm(first - volts))

    best = min(('acc1', 'acc2'), key=miss)
    return best if miss(best) < 0.5 * miss(name) else name


def in_volts(recording: Recording, rig: Rig, name: str) -> Recording:
    """
    Bring an accelerometer that speaks m/s^2 to volts.

    A driver that converts volts takes the rig's offset off; a sensor that speaks m/s^2 by itself
    does not know of it, and its readings hold it. What it says at the start tells which it is.
    """
    model, stream = rig.accelerometer.model(name), recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V' or not len(stream):
        return recording
    offset = np.array(model.offset)
    pose = recording.pose or recording.target
    if pose is not None and len(pose) and not model.highpass:
        first = stream.values[:max(1, int(0.3 * stream.rate))].mean(axis=0)
        rest = (first + pose.R_base_sensor[0].T @ np.array(rig.gravity)) * np.array(model.gain)
        if np.linalg.norm(rest - offset) < 0.5 * np.linalg.norm(rest):
            offset = np.zeros(3)
    return with_volts(recording, np.array(model.gain), offset)


def with_volts(recording: Recording, gain: Array, offset: Array) -> Recording:
    """Return volts where an accelerometer speaks m/s^2, by a gain and an offset."""
    stream = recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V':
        return recording
    return replace(recording, accelerometer=replace(stream, values=stream.values * gain + offset),
                   accelerometer_unit='V')


def prepare(recording: Recording, rig: Rig, accelerometer: str | None = None) -> Case:
    """
    Make one recording ready; all of its blocks are for training.

    Parameters
    ----------
    recording : Recording
    rig : Rig
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised by its volts where none is given.

    Returns
    -------
    Case

    Raises
    ------
    DataError
        Commands or wrench are missing, or they overlap for too short a time.
    """
    name = accelerometer or mounted(recording, rig)
    start = start_of(recording, rig, name)
    assert recording.target is not None
    sensed = [s.t for s in (recording.wrench, recording.accelerometer, recording.optidrive)
              if s is not None and len(s)]
    if not sensed:
        raise DataError('the recording holds neither wrench nor accelerometer nor displacement; '
                        'record at least the wrench')
    end = min(max(float(t[-1]) for t in sensed), float(recording.target.t[-1]) + BLOCK)
    if end - max(start, min(float(t[0]) for t in sensed)) < SHORTEST:
        raise DataError(f'commands and sensors overlap for {max(0.0, end - start):.1f} s; at '
                        f'least {SHORTEST:g} s are needed: record a longer sequence')
    replay = Replay(rig, recording.target, start, end, name)
    nominal = replay.signals(rig)
    n = replay.n_blocks
    measured = Measured(in_volts(replace(recording, joints=None), rig, name), start, n)
    groups = _kinds(nominal, n)
    phases = recording.phases or made_up(groups, start)
    return Case(recording, replay, measured, nominal, groups, phases,
                np.ones(n, dtype=bool), np.zeros(n, dtype=bool))


def held_apart(train: Case, held: Case) -> tuple[Case, Case]:
    """Fit on all of one recording, judge on all of another."""
    return train, replace(held, train=held.held, held=held.train)


def split(case: Case) -> Case:
    """
    Hold out parts of every phase of one recording.

    Phases that occur more than once alternate; the last half of every other one is held out.

    Parameters
    ----------
    case : Case

    Returns
    -------
    Case
    """
    held, t = np.zeros(len(case.groups), dtype=bool), case.times
    count: dict[str, int] = {}
    for phase in case.phases:
        rows = (t >= phase.start) & (t < phase.end)
        several = sum(p.name == phase.name for p in case.phases) > 1
        turn = count[phase.name] = count.get(phase.name, -1) + 1
        if not several:
            rows &= t >= 0.5 * (phase.start + phase.end)
        if not several or turn % 2:
            held |= rows
    if not held.any():
        held = t >= t.mean()
    return replace(case, train=~held, held=held)


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
