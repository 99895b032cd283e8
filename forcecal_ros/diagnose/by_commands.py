"""From one recording with commands, or a pair, to a diagnosis."""

from dataclasses import replace

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.dataset import (
    exclude_contact,
    MIN_COMMANDED_S,
    prepare_commanded,
    split_by_phase,
    split_by_recording,
)
from forcecal_ros.diagnose.engine import diagnose_datasets, Outcome
from forcecal_ros.diagnose.recordings import correct_clocks, require_axes_of, require_same_sensors
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.effects.rig import Rig

NO_WALL = ('phases that touch something are left out, as the rig has no wall within reach; write '
           'where it is into the rig to have them compared')


def diagnose(recording: Recording, heldout: Recording | None, rig: Rig,
             accelerometer: str | None = None) -> Outcome:
    """
    Find out where, why and how far a recording departs from a rig.

    Parameters
    ----------
    recording : Recording
        To fit on.
    heldout : Recording or None
        To judge on; parts of ``recording`` are held out where none is given.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised where none is given.

    Returns
    -------
    Outcome
        Data that cannot answer come out as such, with the reason.
    """
    given = [recording] if heldout is None else [recording, heldout]
    try:
        require_same_sensors(given)
        stamps = [correct_clocks(r, rig, MIN_COMMANDED_S) for r in given]
        require_axes_of(rig, [s.recording for s in stamps])
        datasets = [prepare_commanded(s.recording, rig, accelerometer) for s in stamps]
    except DataError as error:
        return Outcome(Diagnosis('invalid_data', str(error)), rig)
    left_out = [exclude_contact(dataset, rig) for dataset in datasets]
    ready = split_by_recording(*datasets) if len(datasets) > 1 else (split_by_phase(datasets[0]),)
    outcome = diagnose_datasets(rig, ready, stamps, given)
    if not any(left_out):
        return outcome
    return replace(outcome, diagnosis=replace(
        outcome.diagnosis, notes=(NO_WALL, *outcome.diagnosis.notes)))
