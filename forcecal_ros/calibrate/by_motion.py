"""A calibration of a recording whose robot does not rest in different poses."""

from collections.abc import Iterator
from typing import Any

from forcecal_ros.calibrate.axes import split_matrix
from forcecal_ros.calibrate.joint import accelerometer_fit, joint_fit, JointFit
from forcecal_ros.calibrate.quality import weak_estimates
from forcecal_ros.calibrate.requirements import require_wrench
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.static_readings import refuse_negative
from forcecal_ros.checks.hypotheses import questions_of
from forcecal_ros.core.calibration import Accelerometer, Calibration, Estimate
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording, Stream
import numpy as np

MAX_RELATIVE_INERTIA_STD = 0.3
"""Largest standard error of an element of inertia, of its mean moment: above, it is left out."""


MAX_RELATIVE_MAP_STD = 0.05
"""Largest standard error of an element of the accelerometer's map, of its largest: above, it is
left out."""

ESTIMATED_KEYS = ('mass', 'com', 'wrench_bias', 'inertia')
"""Keys that are estimated from motion."""

SUSPECT_UNEXPLAINED = 0.1
"""Share of the weight's variation in the residual above which estimates are suspect: axes that
are rotated by 6 deg have as much."""


def calibrate_by_motion(recording: Recording, settings: IdentificationSettings, why: str
                        ) -> dict[str, Any]:
    """
    Identify mass, centre of mass, biases and inertia from motion.

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
    UnobservableError, DataError
        As :func:`forcecal_ros.calibrate.joint.joint_fit`.
    """
    assert recording.pose is not None
    wrench, slide = require_wrench(recording), recording.optidrive
    if settings.tool_compliance == 'no':
        slide = None
    gravity = np.array([0.0, 0.0, -settings.gravity])
    found = joint_fit(wrench, recording.pose, gravity, settings.largest_delay, slide)
    refuse_negative(float(found.theta[0]))
    inertia = inertia_about_com(found)
    size = float(np.trace(inertia.value)) / 3
    known = size > 0.0 and float(inertia.std.max()) < MAX_RELATIVE_INERTIA_STD * size
    accelerometer, missing = _accelerometer(recording, settings, gravity, slide, found)
    fields: dict[str, Any] = {
        'accelerometer': accelerometer,
        'mass': Estimate(found.theta[0], found.std[0], 'kg'),
        'com': Estimate(found.com, found.com_std, 'm'),
        'wrench_bias': Estimate(found.theta[10:], found.std[10:], 'N, N m'),
        'inertia': inertia if known else None}
    warnings = [*weak_estimates(Calibration(**fields), settings, 'rotate further and for longer',
                                'rotate further about two horizontal axes'),
                *_not_identified(recording, None if known else inertia, size), *missing]
    suspect = [key for key in ESTIMATED_KEYS if found.unexplained > SUSPECT_UNEXPLAINED]
    if suspect:
        warnings.append(
            f'forces differ from those of a rigid tool by {found.fit.scale[0]:.2g} N RMS, '
            f'{found.unexplained:.0%} of the variation of its weight; compare the axes of wrench '
            f'and pose, and record free of contact; suspect: {", ".join(suspect)}')
    quality = {
        'method': 'motion', 'warnings': warnings, 'suspect': suspect,
        'questions': list(questions_of(float(found.theta[0]), float(np.linalg.norm(found.com)))),
        'notes': [*recording.notes, f'{why}: estimated from motion'],
        'residual_rms': np.repeat(found.fit.scale, 3),
        'apparent_gravity_spread': found.spread,
        'rejection': {'threshold': settings.thresholds.probability, 'pose': None, 'poses': []},
        'pose_delay': -found.delay, 'pose_delay_std': found.delay_std}
    return {**fields, 'quality': quality}


def inertia_about_com(found: JointFit) -> Estimate:
    """Return the inertia about the centre of mass, with its standard error [kg m^2]."""
    def about(p: Array) -> Array:
        xx, yy, zz, xy, xz, yz = p[4:]
        first = p[1:4]
        offset = (first @ first * np.eye(3) - np.outer(first, first)) / p[0]
        return np.asarray(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - offset).ravel()

    p, C = found.theta[:10], found.fit.covariance[:10, :10]
    steps = 1e-4 * np.maximum(np.sqrt(np.diag(C)), 1e-12)
    J = np.array([(about(p + one) - about(p - one)) / (2 * size)
                  for one, size in zip(np.diag(steps), steps)]).T
    std = np.sqrt(np.maximum(np.einsum('ij,jk,ik->i', J, C, J), 0.0))
    if not np.isfinite(found.std[4:10]).all():
        std[:] = np.inf
    return Estimate(about(p).reshape(3, 3), std.reshape(3, 3), 'kg m^2')


def _not_identified(recording: Recording, inertia: Estimate | None, size: float) -> Iterator[str]:
    """Name what this motion does not show, and the motion that would."""
    assert recording.pose is not None
    if not recording.pose.has_position:
        yield ('inertia: not identified, and accelerations of the sensor are taken as 0, because '
               'the pose has no position; record the position as well')
    elif inertia is not None:
        error = float(inertia.std.max())
        share = f' ({error / size:.0%} of the mean moment)' if size > 0.0 else ''
        yield (f'inertia: not identified, its standard error is {error:.2g} kg m^2{share}; rotate '
               'faster about all three axes')


def _accelerometer(recording: Recording, settings: IdentificationSettings, gravity: Array,
                   slide: Stream | None, found: JointFit
                   ) -> tuple[Accelerometer | None, tuple[str, ...]]:
    """Return what motion shows of the accelerometer, or a line that says why it shows none."""
    stream, pose, unit = recording.accelerometer, recording.pose, recording.accelerometer_unit
    assert pose is not None
    if stream is None or len(stream) < 2:
        return None, ()
    if settings.coupling == 'ac' or not pose.has_position:
        why = ('the pose has no position; record it as well' if settings.coupling == 'dc' else
               'an AC-coupled one is identified beside rests only; hold 4 poses for 2 s each')
        return None, (f'accelerometer: not identified, {why}',)
    fit = accelerometer_fit(stream, pose, gravity, settings.largest_delay, slide)
    std = np.sqrt(np.diag(fit.covariance))
    matrix, size = fit.theta[:9].reshape(3, 3), float(np.abs(fit.theta[:9]).max())
    if std[:9].max() > MAX_RELATIVE_MAP_STD * size:
        why = f'the standard error of its gains is {std[:9].max() / size:.0%}'
        why += '; rotate further about two horizontal axes'
        return None, (f'accelerometer: not identified, {why}',)
    axes = split_matrix(matrix, fit.covariance[:9, :9], unit != 'V')
    place = Estimate(fit.theta[12:15], std[12:15], 'm')
    if settings.accelerometer_position is not None:
        place = Estimate(settings.accelerometer_position, 0.0, 'm')
    known = place.std.max() <= settings.thresholds.position
    return Accelerometer(
        offset=Estimate(fit.theta[9:12], std[9:12], unit),
        gain=Estimate(axes.gain, axes.gain_std, '1' if unit != 'V' else 'V/(m/s^2)'),
        map=Estimate(axes.map, axes.map_std, '1'),
        delay=Estimate(fit.theta[15] - found.delay, np.hypot(std[15], found.delay_std), 's'),
        position=place if known else None), ()
