"""A calibration of a recording whose robot does not rest in different poses."""

from collections.abc import Iterator
from typing import Any

from forcecal_ros.calibrate.accelerometer import AccelerometerFit
from forcecal_ros.calibrate.findings import NO_ACCELEROMETER
from forcecal_ros.calibrate.joint import JointFit, SUSPECT_UNEXPLAINED
from forcecal_ros.calibrate.quality import weak_estimates
from forcecal_ros.calibrate.result import accelerometer_of, inertia_of, known_inertia
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.static_readings import principal_spread, refuse_negative
from forcecal_ros.checks.hypotheses import questions_of
from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.streams import Recording
import numpy as np

MAX_RELATIVE_INERTIA_STD = 0.3
"""Largest standard error of an element of inertia, of its mean moment: above, it is left out."""

ESTIMATED_KEYS = ('mass', 'com', 'wrench_bias', 'inertia')
"""Keys that are estimated from motion."""


def calibrate_by_motion(recording: Recording, settings: IdentificationSettings, found: JointFit,
                        accelerometer: AccelerometerFit | None, why: str) -> dict[str, Any]:
    """
    Return what motion shows of tool and accelerometer, and what it does not.

    Parameters
    ----------
    recording : Recording
        Checked, base along gravity, wrench in the axes of the pose.
    why : str
        Why the static poses do not do.

    Returns
    -------
    dict
        Fields of a :class:`Calibration`. Its noise is not identified.

    Raises
    ------
    DataError
        The wrench has the opposite sign.
    """
    refuse_negative(float(found.theta[0]))
    inertia = inertia_of(found)
    known = known_inertia(inertia, MAX_RELATIVE_INERTIA_STD)
    mass, std = float(found.theta[0]), found.std
    fields: dict[str, Any] = {
        'mass': Estimate(mass, std[0], 'kg'),
        'com': Estimate(found.com, found.com_std, 'm'),
        'wrench_bias': Estimate(found.theta[10:16], std[10:16], 'N, N m'),
        'inertia': known,
        'accelerometer': accelerometer_of(
            accelerometer, recording.accelerometer_unit, settings)}
    warnings = [*weak_estimates(Calibration(**fields), settings, 'rotate further and for longer',
                                'rotate further about two horizontal axes'),
                *_not_identified(recording, None if known else inertia, accelerometer)]
    suspect = [key for key in ESTIMATED_KEYS if found.unexplained > SUSPECT_UNEXPLAINED]
    if suspect:
        warnings.append(
            f'forces differ from those of a rigid tool by {found.scale[0]:.2g} N RMS, '
            f'{found.unexplained:.0%} of the variation of its weight; compare the axes of wrench '
            f'and pose, and record free of contact; suspect: {", ".join(suspect)}')
    quality = {
        'method': 'motion', 'warnings': warnings, 'suspect': suspect,
        'questions': list(questions_of(mass, found.com, found.theta[10:13])),
        'notes': [*recording.notes, f'{why}: estimated from motion'],
        'residual_rms': np.repeat(found.scale, 3),
        'apparent_gravity_spread': principal_spread(found.blocks.apparent_gravity)[0],
        'rejection': {'threshold': settings.thresholds.probability, 'pose': None, 'poses': []},
        'pose_delay': -found.delay, 'pose_delay_std': found.delay_std}
    return {**fields, 'quality': quality}


def _not_identified(recording: Recording, inertia: Estimate | None,
                    accelerometer: AccelerometerFit | None) -> Iterator[str]:
    """Name what this motion does not show, and the motion that would."""
    assert recording.pose is not None
    if not recording.pose.has_position:
        yield ('inertia: not identified, and accelerations of the sensor are taken as 0, because '
               'the pose has no position; record the position as well')
    elif inertia is not None:
        error, size = float(inertia.std.max()), float(np.trace(inertia.value)) / 3
        share = f' ({error / size:.0%} of the mean moment)' if size > 0.0 else ''
        yield (f'inertia: not identified, its standard error is {error:.2g} kg m^2{share}; rotate '
               'faster about all three axes')
    if accelerometer is None and recording.accelerometer is not None:
        yield NO_ACCELEROMETER
