"""From the robot's recording and a simulator's of the same commands to a diagnosis."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.checks.entry import computed
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.by_motion import in_unit, recalibration_notes
from forcecal_ros.diagnose.dataset import Dataset
from forcecal_ros.diagnose.engine import diagnose_datasets, Outcome
from forcecal_ros.diagnose.inputs.motion_dataset import held_out, moves, prepare_simulated
from forcecal_ros.diagnose.inputs.simulated_tool import SimulatedTool
from forcecal_ros.diagnose.localise import compare_motions, Tracking
from forcecal_ros.diagnose.recordings import (
    align,
    Alignment,
    Corrected,
    even_stamps,
    keep_comparable_imus,
    keep_compared_streams,
    require_same_sensors,
)
from forcecal_ros.diagnose.result import Diagnosis, NO_MOTION
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import FORCES
from forcecal_ros.sim.measured_motion import RecordedSimulation
from forcecal_ros.sim.poses import in_base_of
from forcecal_ros.sim.signals import BLOCK
import numpy as np

STIFF = 0.1
"""RMS of a simulated wrench beyond a rigid tool's that is told [N]: what a good sensor shows."""

UNTESTED = ('what the simulator makes of its commands (friction, gains and gears of joints, '
            'stiffness of contacts) cannot be tested without running it again')

ZERO = 'wrench.bias'
"""The nuisances that say where a sensor's zero is."""


class Pair(NamedTuple):
    """The robot's recording of some commands, and the simulator's."""

    real: Recording
    simulated: Recording


class SimulatedDiagnosis(NamedTuple):
    """
    A diagnosis, and what it rests on besides.

    Attributes
    ----------
    alignment : tuple of Alignment
        Of each pair; empty where the data cannot answer.
    tool : SimulatedTool or None
        The simulator's tool.
    """

    outcome: Outcome
    alignment: tuple[Alignment, ...] = ()
    compare_motions: tuple[Tracking, ...] = ()
    tool: SimulatedTool | None = None

    def document(self) -> dict[str, Any]:
        """Return what ``diagnosis.json`` says of it, beside the diagnosis."""
        if self.tool is None:
            return {}
        tool = self.tool.rigid_tool.tool
        return {
            'simulated_tool': {'mass': tool.mass, 'com': list(tool.com),
                               'inertia': [list(row) for row in tool.inertia],
                               'left': dict(zip(('force', 'torque'), self.tool.unexplained))},
            'compare_motions': [{
                'aligned_by': a.by, 'correlation': a.correlation,
                **{name: part.document() for name, part in t._asdict().items()}}
                         for a, t in zip(self.alignment, self.tracking)]}


def diagnose_simulated(pair: Pair, heldout: Pair | None, rig: Rig) -> SimulatedDiagnosis:
    """
    Find out why a wrench is not what a simulator recorded.

    Parameters
    ----------
    pair : Pair
        To fit on.
    heldout : Pair or None
        To judge on; every other second of ``pair`` where none is given.
    rig : Rig
        Gives the tolerances.

    Returns
    -------
    SimulatedDiagnosis
        Data that cannot answer come out as such, with the reason.
    """
    pairs = [one for one in (pair, heldout) if one is not None]
    try:
        require_same_sensors([one.real for one in pairs])
        prepared = [_prepared(pair, None, rig)]
        tool = prepared[0].tool
        prepared += [_prepared(one, tool, rig) for one in pairs[1:]]
    except DataError as error:
        return SimulatedDiagnosis(Outcome(Diagnosis('invalid_data', str(error)), rig))
    datasets = [one.dataset for one in prepared]
    if not moves(datasets):
        return SimulatedDiagnosis(Outcome(NO_MOTION, rig))
    outcome = diagnose_datasets(
        tool.rigid_tool, held_out(datasets), [one.stamps for one in prepared],
        [keep_compared_streams(one.real, dataset.measured.streams)
         for one, dataset in zip(pairs, datasets)])
    d = in_unit('m/s^2', outcome.diagnosis)
    moved = (note for note in recalibration_notes(outcome, 'm/s^2') if ZERO not in note)
    notes = (*d.notes, *moved, *_about(prepared, outcome), UNTESTED)
    apart = prepared[0].tracking
    reason = (f'{d.reason}; the motion itself is {1e3 * apart.translation.rms:.2g} mm and '
              f'{1e3 * apart.rotation.rms:.2g} mrad (RMS) from the simulated')
    return SimulatedDiagnosis(
        replace(outcome, diagnosis=replace(d, reason=reason, notes=notes)),
        tuple(one.alignment for one in prepared), tuple(one.tracking for one in prepared), tool)


class _Prepared(NamedTuple):
    dataset: Dataset
    stamps: Corrected
    alignment: Alignment
    compare_motions: Tracking
    tool: SimulatedTool
    note: str


def _prepared(pair: Pair, tool: SimulatedTool | None, rig: Rig) -> _Prepared:
    stamps = even_stamps(pair.real)
    try:
        made = computed(pair.simulated)
    except DataError as error:
        raise DataError(f'the simulated recording: {error}') from error
    simulated, alignment = align(stamps.recording, made)
    measured = stamps.recording.pose
    if measured is not None and simulated.pose is not None:
        simulated = replace(simulated, pose=in_base_of(measured, simulated.pose))
    real, note = stamps.recording, ''
    if measured is not None and simulated.pose is not None:
        real, simulated, note = keep_comparable_imus(real, simulated)
    dataset, tool = prepare_simulated(real, simulated, tool, rig)
    assert measured is not None
    assert simulated.pose is not None
    return _Prepared(dataset, stamps, alignment,
                     compare_motions(measured, simulated.pose, alignment.by == 'target'), tool, note)


def _touched(dataset: Dataset) -> float:
    """Return for how long the simulated tool touches something [s]."""
    assert isinstance(dataset.simulation, RecordedSimulation)
    return float(BLOCK * dataset.simulation.touching.sum())


def _about(prepared: list[_Prepared], outcome: Outcome) -> Iterator[str]:
    """Say how the recordings were compared, and how the motions differ."""
    force, torque = prepared[0].tool.unexplained
    touched = sum(_touched(one.dataset) for one in prepared)
    if force > STIFF and not touched:
        yield (f'the simulated wrench is not that of a rigid tool: {force:.2g} N and {torque:.2g} '
               'N m are something else (contact, play, noise, another frame), and are taken as '
               'they are')
    zero = [middle + outcome.recalibrations.get(f'{ZERO}.{i}', (0.0, 0.0))[0]
            for i, middle in enumerate(prepared[0].tool.zero)]
    yield ('zero of the wrench against the simulated: '
           + ', '.join(f'{axis} {value:+.3g}' for axis, value in zip(FORCES, zero))
           + ' N, N m; taken off')
    yield from dict.fromkeys(one.note for one in prepared if one.note)
    if touched:
        yield (f'for {touched:.1f} s the simulated tool touches something: left out, as a '
               'millimetre between the two motions changes such a force more than any effect; '
               'only a simulator that is run can tell how stiff a contact is')
    for one in prepared:
        for name, part, unit in zip(one.tracking._fields, one.tracking, ('mm', 'mrad')):
            motion = f'{name}: {1e3 * part.rms:.2g} {unit} from the simulated'
            if one.alignment.by == 'pose':
                yield f'{motion}, laid on it: without commands in both, a delay cannot show'
            elif np.isfinite(part.delay):
                yield (f'{motion}; the robot is {1e3 * part.delay:.1f} +- '
                       f'{1e3 * part.delay_std:.1f} ms later, which leaves '
                       f'{1e3 * part.unexplained:.2g} {unit}')
            else:
                yield motion
