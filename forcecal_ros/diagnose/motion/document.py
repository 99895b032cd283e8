"""``diagnosis.json`` of a recording without commands."""

from typing import Any

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.motion.arms import SLOW
from forcecal_ros.diagnose.motion.pipeline import MotionOutcome
from forcecal_ros.diagnose.result import to_document as document_of

UNITS = {c.name: 'm/s^2' if c.name.startswith('accel') else c.unit for c in CHANNELS}


def to_document(outcome: MotionOutcome, calibration: str | None) -> dict[str, Any]:
    """
    Return the diagnosis as a dictionary.

    Parameters
    ----------
    outcome : MotionOutcome
    calibration : str or None
        Name of the patched calibration beside it.

    Returns
    -------
    dict
        ``gap`` speaks of slow motion, ``gap_all_frequencies`` of all.
    """
    document = document_of(outcome.diagnosis, UNITS, None)
    document['explained_by'] = 'measured motion'
    if outcome.full is not None:
        document['gap']['below_hz'] = SLOW
        document['gap_all_frequencies'] = {
            name: {'nominal_rms': v[0], 'recalibrated_rms': v[1], 'explained_rms': v[2],
                   'noise_rms': v[3], 'unit': UNITS[name]}
            for name, v in outcome.full.channels.items()}
    if calibration:
        document['calibration'] = calibration
    return document
