"""From a recording without commands to a diagnosis: the wrench against the measured motion."""

from dataclasses import replace

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.engine import diagnose_datasets, Outcome
from forcecal_ros.diagnose.inputs.motion_dataset import held_out, moves, prepare_motion, SHORTEST
from forcecal_ros.diagnose.judge.named_effects import AT_BOUND
from forcecal_ros.diagnose.recordings import (
    apply_accelerometer_calibration,
    even_stamps,
    require_axes_of,
    require_overlap,
    require_same_sensors,
)
from forcecal_ros.diagnose.result import Diagnosis, NO_MOTION
from forcecal_ros.effects.signals import FORCES
from forcecal_ros.sim.rigid_tool import RigidTool

DELAY = 'accelerometer.delay'
"""The nuisance that says how far the accelerometer is behind the wrench."""

TOLD = 0.5
"""Standard error, in its prior's, up to which the motion tells a delay or an inertia."""

MOVED = 3.0
"""Standard errors of a recalibration from which it is told; one in four hundred is by chance."""

UNITS = {DELAY: ' s', 'tool.com': ' m', 'tool.inertia': ' kg m^2'}
"""Units of nuisances, by their names without axis; those that are not here are relative."""


def diagnose_motion(recording: Recording, heldout: Recording | None, rigid_tool: RigidTool,
                    calibration: Calibration | None = None,
                    accelerometer: str | None = None) -> Outcome:
    """
    Find out why a wrench is not what the measured motion says.

    Parameters
    ----------
    recording : Recording
        To fit on.
    heldout : Recording or None
        To judge on; every other second of ``recording`` where none is given.
    calibration : Calibration, optional
        That the rigid tool was made of: says what the accelerometer's readings mean.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the mounted one where none is given.

    Returns
    -------
    Outcome
        Data that cannot answer come out as such, with the reason.
    """
    given = [r for r in (recording, heldout) if r is not None]
    try:
        require_same_sensors(given)
        stamps = [even_stamps(r) for r in given]
        require_axes_of(rigid_tool, [s.recording for s in stamps],
                        'calibration' if calibration else 'rig')
        if calibration is not None:
            stamps = [s._replace(recording=apply_accelerometer_calibration(s.recording,
                                                             calibration.accelerometer))
                      for s in stamps]
        for one in stamps:
            require_overlap(one.recording, 'pose', SHORTEST)
        datasets = [prepare_motion(s.recording, rigid_tool, accelerometer) for s in stamps]
    except DataError as error:
        return Outcome(Diagnosis('invalid_data', str(error)), rigid_tool)
    if not moves(datasets):
        return Outcome(NO_MOTION, rigid_tool)
    outcome = diagnose_datasets(rigid_tool, held_out(datasets), stamps, given)
    unit = rigid_tool.accelerometer_unit
    d = in_unit(unit, outcome.diagnosis)
    notes = (*d.notes, *recalibration_notes(outcome, unit))
    return replace(outcome, diagnosis=replace(d, notes=notes))


def delay_std(outcome: Outcome) -> float | None:
    """Return the standard error of the delay between the sensors [s]; None where none is told."""
    delay = outcome.recalibrations.get(DELAY)
    if delay is None or not isinstance(outcome.rig, RigidTool):
        return None
    return delay[1] if 0.0 < delay[1] < TOLD * outcome.rig.spreads.accel_behind else None


def inertia_std(outcome: Outcome) -> tuple[float, float, float] | None:
    """Return the standard errors of the tool's inertia, where all of it is told [kg m^2]."""
    stds = [outcome.recalibrations.get(f'tool.inertia.{axis}', (0.0, 0.0))[1] for axis in 'xyz']
    if not isinstance(outcome.rig, RigidTool):
        return None
    most = TOLD * outcome.rig.spreads.own_inertia
    x, y, z = stds
    return (x, y, z) if all(0.0 < std < most for std in stds) else None


def in_unit(unit: str, diagnosis: Diagnosis) -> Diagnosis:
    """Name the unit that the accelerometer speaks, in sentence and parameters."""
    return replace(
        diagnosis, reason=diagnosis.reason.replace(' V RMS in accel', f' {unit} RMS in accel'),
        effects=tuple(replace(e, parameters={
            k: replace(p, unit=unit) if p.unit == 'V' else p for k, p in e.parameters.items()})
            for e in diagnosis.effects))


def recalibration_notes(outcome: Outcome, unit: str) -> list[str]:
    """Say what was recalibrated by more than it is known to, accelerometers in ``unit``."""
    out = []
    for name, (value, std) in outcome.recalibrations.items():
        if abs(value) > MOVED * std and not name.startswith('wrench.step'):
            sure, bound = (f' +- {std:.2g}', '') if std else ('', f' ({AT_BOUND})')
            out.append(f'recalibrated: {_named(name)} by {value:+.3g}{sure}{_unit(name, unit)}'
                       f'{bound}')
    return out


def _named(name: str) -> str:
    """Call a sensor's axis by its name."""
    stem, _, axis = name.rpartition('.')
    axes = FORCES if stem.startswith('wrench') else 'xyz'
    return f'{stem}.{axes[int(axis)]}' if axis.isdigit() else name


def _unit(name: str, accelerometer: str) -> str:
    stem, _, axis = name.rpartition('.')
    if stem == 'wrench.bias':
        return ' N' if int(axis) < 3 else ' N m'
    if stem == 'accelerometer.offset':
        return f' {accelerometer}'
    return UNITS.get(name) or UNITS.get(stem, '')
