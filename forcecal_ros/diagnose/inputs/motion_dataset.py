"""A recording without commands made ready: its tool carried along the measured motion."""

from collections.abc import Sequence
from dataclasses import replace

from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.noise.autoregression import FEWEST
from forcecal_ros.core.streams import Recording, Stream, TOUCHING
from forcecal_ros.diagnose.inputs.accelerometer import in_volts
from forcecal_ros.diagnose.inputs.dataset import Dataset, held_apart, made_up, STILL
from forcecal_ros.diagnose.inputs.residuals import MeasuredBlocks
from forcecal_ros.diagnose.inputs.simulated_tool import (
    refuse_other_wrench,
    simulated_tool,
    SimulatedTool,
)
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.measured_motion import MeasuredMotion, RecordedSimulation
from forcecal_ros.sim.rigid_tool import beyond, RigidTool
from forcecal_ros.sim.signals import BLOCK, block_means, Signals
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

SHORTEST = 3.0
"""Length of a recording without commands, at least, that can be diagnosed [s]."""

EDGE = 0.03
"""Time left out at both ends, so that one sensor may be so late behind another [s]."""

MOVING = (0.005, 0.002)
"""Angular speed [rad/s] and speed [m/s] from which the robot moves: noisy poses show less."""


def prepare_motion(recording: Recording, rigid_tool: RigidTool,
                   accelerometer: str | None = None) -> Dataset:
    """
    Make one recording ready; all of its blocks are for training.

    Parameters
    ----------
    recording : Recording
        Of a calibrated tool its accelerometer is in m/s^2 along ft_sensor.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the mounted one where none is given.

    Returns
    -------
    Dataset
        Its pose is an input, and its accelerometer counts as measured at rest only.

    Raises
    ------
    DataError
        Wrench or pose are missing, or overlap for too short a time.
    """
    require_wrench_and_pose(
        recording, 'the recording holds neither commands nor wrench with measured pose; record '
        'wrench and current_pose')
    name = accelerometer or rigid_tool.accelerometer.mounted
    moved = in_volts(recording, rigid_tool, name)
    volts = moved.accelerometer if moved.accelerometer and len(moved.accelerometer) > 1 else None
    if rigid_tool.accelerometer.model(name).highpass:
        volts = None
    moved = replace(moved, accelerometer=volts)
    first, n = span(moved)
    simulation = MeasuredMotion(moved, first, n, name, rigid_tool)
    return _dataset(moved, simulation, rigid_tool, volts)


def prepare_simulated(recording: Recording, simulated: Recording, tool: SimulatedTool | None,
                      rig: Rig) -> tuple[Dataset, SimulatedTool]:
    """
    Make a recording of the robot, and its simulator's, ready; all blocks are for training.

    Parameters
    ----------
    recording, simulated : Recording
        On one clock.
    tool : SimulatedTool or None
        The simulator's tool where it is known already.
    rig : Rig
        Gives the tolerances.

    Returns
    -------
    Dataset
        Its pose is an input; accelerometers count where both have one, and nothing does where the
        simulated tool touches something.
    SimulatedTool
        The simulator's tool.

    Raises
    ------
    DataError
        Wrench or pose are missing, or overlap for too short a time.
    """
    for one, whose in ((recording, "the robot's"), (simulated, 'the simulated')):
        require_wrench_and_pose(one, f'{whose} recording lacks wrench or measured pose; record '
                                'wrench and current_pose in both')
    first, n = span(recording, simulated)
    known = tool or simulated_tool(
        replace(simulated, accelerometer=None), first, n, rig).with_accelerometer()
    refuse_other_wrench(recording, known)
    moved = replace(recording, accelerometer=None)
    simulation = RecordedSimulation(moved, simulated, first, n, 'acc1', known.simulated)
    if tool is None:
        known = known.zeroed(beyond(moved, simulation.signals(known.rigid_tool)))
    dataset = _dataset(recording, simulation, known.rigid_tool, None, recording.accelerometer)
    dataset.measured.present[simulation.touching] = False
    return dataset, known


def require_wrench_and_pose(recording: Recording, otherwise: str) -> None:
    """Refuse a recording without them in some words."""
    wrench, pose = recording.wrench, recording.pose
    if wrench is None or pose is None or len(wrench) < 100 or len(pose) < 20:
        raise DataError(otherwise)


def span(*recordings: Recording) -> tuple[float, int]:
    """Return when all is there, and how many blocks it lasts."""
    streams = [s.t for r in recordings for s in (r.wrench, r.pose, r.accelerometer)
               if s is not None]
    first = max(float(t[0]) for t in streams) + EDGE
    last = min(float(t[-1]) for t in streams) - EDGE
    if last - first < SHORTEST:
        common = below(max(0.0, last - first), SHORTEST)
        raise DataError(f'wrench and motion overlap for {common} s; at least {SHORTEST:g} s are '
                        'needed: record a longer motion')
    return first, int((last - first) / BLOCK)


def _dataset(recording: Recording, simulation: MeasuredMotion, rig: RigidTool,
             volts: Stream | None, felt: Stream | None = None) -> Dataset:
    """Compare wrench and what is felt in motion, and else an accelerometer at rest."""
    first, n = simulation.start, simulation.n_blocks
    groups = kinds(simulation.signals(rig))
    seen = replace(recording, target=None, pose=None, optidrive=None, joints=None,
                   accelerometer=felt or _at_rest(volts, groups, first))
    measured = MeasuredBlocks(seen, first, n)
    dataset = Dataset(recording, simulation, measured, rig, groups,
                      recording.phases or made_up(groups, first), np.ones(n, bool),
                      np.zeros(n, bool))
    for phase, rows in dataset.phase_rows().items():
        if phase in TOUCHING:
            measured.present[rows] = False
    return dataset


def moves(datasets: Sequence[Dataset]) -> bool:
    """Say whether the robot moves in each recording."""
    return all((c.groups == 1).any() for c in datasets)


def held_out(datasets: Sequence[Dataset]) -> tuple[Dataset, ...]:
    """Judge on the second recording or, of one, on every other second."""
    return held_apart(*datasets) if len(datasets) > 1 else (by_seconds(datasets[0]),)


def by_seconds(dataset: Dataset) -> Dataset:
    """Hold out every other second: phases that are told by the motion are of any length."""
    held = np.floor(dataset.times - dataset.measured.start).astype(int) % 2 == 1
    return replace(dataset, train=~held, held=held)


def _at_rest(stream: Stream | None, groups: NDArray[np.intp], start: float) -> Stream | None:
    """Keep what an accelerometer says at rest: in motion it is what the motion is known by."""
    if stream is None:
        return None
    block = np.floor((stream.t - start) / BLOCK).astype(int)
    rest = (block >= 0) & (block < len(groups))
    rest[rest] = groups[block[rest]] == 0
    if len(np.unique(block[rest])) < FEWEST:
        return None
    return stream.rows(rest)


def kinds(signals: Signals) -> NDArray[np.intp]:
    """Tell rest (0) from motion (1) and what is near it, by means: a pose is noisy."""
    means = [uniform_filter1d(block_means(rows), STILL // 2, axis=0, mode='nearest')
             for rows in (signals.omega, signals.velocity)]
    speed = np.maximum(*(np.linalg.norm(m, axis=1) / s for m, s in zip(means, MOVING)))
    near = maximum_filter1d((speed > 1.0).astype(float), 2 * STILL + 1)
    return np.asarray(near, dtype=np.intp)
