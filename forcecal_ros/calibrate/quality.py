"""What the user should know about a calibration: how far to trust it and what to look at.

"If the error is larger than a threshold defined previously, something in the setup, programs or
system are not in the right order" [Gamez2005]: here each such sentence says which estimate, by
how much, and where to look.
"""

from collections.abc import Iterator
from typing import Any

from forcecal_ros.calibrate.accelerometer import in_words
from forcecal_ros.calibrate.findings import ALL, findings
from forcecal_ros.calibrate.paper import (
    acceleration_error,
    Alignment,
    force_error,
    gravity_leak,
    mass_error,
    offset_error,
    Plain,
    plain_procedure,
)
from forcecal_ros.calibrate.poses import orientation_h, orientation_v
from forcecal_ros.calibrate.residuals import pose_errors, rejected
from forcecal_ros.calibrate.result import Stages
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.checks.hypotheses import questions_of
from forcecal_ros.checks.signals import FARTHEST
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import above, DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import phase_spans
import numpy as np


def quality_of(stages: Stages, calibration: Calibration, settings: IdentificationSettings
               ) -> dict[str, Any]:
    """
    Judge a calibration.

    Parameters
    ----------
    stages : Stages
        What it was made of.

    Returns
    -------
    dict
        ``warnings``, ``questions`` (sentences), ``suspect`` (keys of estimates that warnings call
        into question), ``notes``, ``poses``, ``condition``, ``chi_square``,
        ``rejection`` (the rejection test, pose by pose), ``paper`` (the plain equations beside
        the joint estimates), ``errors`` (Eq. 23, 24, 26, 27), ...
    """
    tool = stages.tool
    plain = _plain(stages, calibration, settings)
    found = [*findings(stages, settings)]
    quality: dict[str, Any] = {
        'warnings': [*weak_estimates(calibration, settings), *(finding.line for finding in found)],
        'suspect': [key for key in ALL if any(key in finding.suspect for finding in found)],
        'questions': list(questions_of(tool.mass, tool.com, tool.force_bias)),
        'notes': [*stages.recording.notes, *_notes(stages, calibration, plain)],
        'poses': [{'start': round(p.start, 3), 'gravity': g, 'residual': r} for p, g, r in
                  zip(stages.poses, stages.statics.gravity, tool.residuals)],
        'residual_rms': np.sqrt((tool.residuals**2).mean(axis=0)),
        'condition': tool.condition,
        'gravity_spread': tool.spread,
        'chi_square': {'value': tool.chi_square, 'degrees': tool.degrees,
                       'probability': tool.probability},
        'rejection': _rejection(stages, settings),
        'paper': plain._asdict(),
        'errors': _errors(stages, calibration, settings, plain),
    }
    if stages.recording.removed:
        quality['removed_samples'] = dict(stages.recording.removed)
    if stages.pose_delay is not None:
        quality['pose_delay'], quality['pose_delay_std'] = stages.pose_delay
    if stages.ring is not None:
        quality['optidrive_delay'] = stages.ring.slide_delay
    if stages.sag is not None:
        quality['optidrive_zero'] = stages.sag.zero
    if stages.inertia is not None:
        quality['inertia_std'] = stages.inertia.std
    return quality


def _rejection(stages: Stages, settings: IdentificationSettings) -> dict[str, Any]:
    """Return how far each pose lies from what the others predict, and which to repeat if any."""
    errors = pose_errors(stages.statics, stages.tool)
    worst = rejected(errors, settings.thresholds.probability)
    return {'threshold': settings.thresholds.probability,
            'pose': None if worst is None else worst + 1,
            'poses': [{'off': one.shift, 'mass_eq23': one.mass, 'probability': one.probability}
                      for one in errors]}


def _axis_of_x(calibration: Calibration) -> int:
    """Which accelerometer axis shows x of ft_sensor."""
    assert calibration.accelerometer is not None
    return int(np.argmax(np.abs(calibration.accelerometer.map.value[:, 0])))


def _plain(stages: Stages, calibration: Calibration, settings: IdentificationSettings) -> Plain:
    alignment = None
    accelerometer, fit = calibration.accelerometer, stages.accelerometer
    if accelerometer is not None and fit is not None:
        axis = _axis_of_x(calibration)
        variance = 0.0
        if calibration.noise is not None and calibration.noise.specific_force is not None:
            M = accelerometer.matrix
            variance = float((M @ calibration.noise.specific_force.value @ M.T)[axis, axis])
        alignment = Alignment(axis, float(accelerometer.delay), variance)
    steps = phase_spans(stages.recording.phases, ('step',))
    return plain_procedure(stages.recording, stages.poses, settings.gravity,
                           steps[0] if steps else None, alignment)


def weak_estimates(c: Calibration, settings: IdentificationSettings,
                   add: str = 'measure in more poses',
                   turn: str = 'add poses that rotate gravity about') -> Iterator[str]:
    """Yield a line for each estimate whose standard error passes its threshold."""
    limit = settings.thresholds
    rows: list[tuple[str, float, float, str, str]] = [
        ('mass', _relative(c.mass), limit.mass, '', add),
        ('centre of mass', float(c.com.std.max()), limit.com, ' m', turn),
        ('force bias', float(c.wrench_bias.std[:3].max()), limit.force_bias, ' N', add),
        ('torque bias', float(c.wrench_bias.std[3:].max()), limit.torque_bias, ' N m', add)]
    if c.accelerometer:
        a = c.accelerometer
        rows += [('accelerometer gain', _relative(a.gain), limit.gain, '',
                  'add poses with gravity along the weak axis'),
                 ('accelerometer offset', float((a.offset.std / np.abs(a.gain.value)).max()),
                  limit.offset, ' m/s^2', 'add poses with gravity in opposite directions')]
        if np.isfinite(a.delay.std):
            rows.append(('accelerometer delay', float(a.delay.std), limit.delay, ' s',
                         'make a faster step'))
    if c.tool:
        rows += [('tool stiffness', _relative(c.tool.stiffness), limit.stiffness, '',
                  'make a larger step'),
                 ('tool damping', _relative(c.tool.damping), limit.damping, '',
                  'make a larger step and let it ring out')]
    for name, std, threshold, unit, remedy in rows:
        if not std <= threshold:
            size = above(std, threshold, 2)
            yield (f'{name}: {"relative " * (not unit)}standard error {size}{unit} is above '
                   f'the threshold {threshold:.2g}{unit}; {remedy}')


def _relative(estimate: Any) -> float:
    return float((estimate.std / np.abs(estimate.value)).max())


def _notes(stages: Stages, c: Calibration, plain: Plain) -> Iterator[str]:
    """Say what was found that is neither good nor bad."""
    if c.accelerometer:
        a = c.accelerometer
        yield from in_words(a.gain.value, a.map.value)
        off = plain.gain / plain.gain_aligned - 1
        if np.isfinite(off):
            yield (f'the gain by [Gamez2005] Eq. 17 as printed is {plain.gain:.5g}; corrected for '
                   f'the delay of {1e3 * float(a.delay):.2f} ms and the noise of its regressor it '
                   f'is {plain.gain_aligned:.5g} (a difference of {off:+.2%})')
        if a.position is None:
            yield ('the position of the accelerometer is not identified and assumed at the centre '
                   'of mass; rotate faster')
    if c.inertia is None:
        yield f'inertia not identified: {_without_inertia(stages)}'
    if c.observer is None:
        yield ('observer.K not designed: the static poses do not determine the noise of position '
               'and accelerometer')
    if c.tool is None:
        yield 'tool stiffness and damping not identified: the tool did not ring after a step'


def _without_inertia(stages: Stages) -> str:
    """Say why no inertia was found, and the remedy."""
    remedy = 'rotate about all three axes between the poses'
    if stages.inertia is not None:
        i, j = np.unravel_index(int(np.argmax(stages.inertia.std)), (3, 3))
        return f'the motion hardly excites J_{"".join(sorted("xyz"[i] + "xyz"[j]))}; {remedy}'
    pose, wrench, poses = stages.recording.pose, stages.recording.wrench, stages.poses
    if pose is None or wrench is None or np.sum(np.all(
            [(pose.t < one.start) | (pose.t >= one.end) for one in poses], 0)) <= 2 * len(poses):
        return f'no rotation was recorded; {remedy}'  # or too few samples of it
    rate = 1.0 / max(float(np.median(np.diff(one.t))) for one in (pose, wrench))
    length = float(np.median([one.end - one.start for one in poses]))
    return (f'readings at {rate:.3g} Hz in poses of {length:.2g} s do not determine noise and '
            'angular acceleration; record at a higher rate, or hold each pose longer')


def _errors(stages: Stages, c: Calibration, settings: IdentificationSettings, plain: Plain
            ) -> dict[str, float]:
    """
    Errors of the plain procedure by [Gamez2005] Eq. 23 and 24, and of the result by Eq. 26, 27.

    The first two compare the measured orientations with those of Eq. 9 and 12; the last two take
    the standard errors for e_m, e_v and e_g at an acceleration of 10 m/s^2.
    """
    errors: dict[str, float] = {}
    R = [p.R_base_sensor for p in stages.poses]
    h = R[int(np.argmax([abs(r[2, 0]) for r in R]))]
    v = R[int(np.argmin([abs(r[2, 0]) for r in R]))]
    mass = float(c.mass)
    if np.isfinite(plain.mass):
        weight = mass * settings.gravity * np.array([0.0, 0.0, -1.0])
        errors['mass_eq23'] = mass_error(
            h, orientation_h(), v, orientation_v(), weight, weight, settings.gravity)
    if c.accelerometer is None:
        return errors
    a, axis = c.accelerometer, _axis_of_x(c)
    gain, offset = float(a.gain.value[axis]), float(a.offset.value[axis])
    row: Array = a.map.value[axis] * np.sign(a.map.value[axis, 0])
    tilt = _turn_x_to(row)
    if np.isfinite(plain.offset):
        errors['offset_eq24'] = offset_error(v, v @ tilt, offset * v[:, 0])
        errors['offset_gravity_leak'] = gravity_leak(v @ tilt, gain, settings.gravity)
    # acceleration at which Eq. 26 and 27 are evaluated [m/s^2]
    peak = 10.0
    e_a = acceleration_error(offset + gain * peak, offset, gain, float(a.offset.std[axis]),
                             float(a.gain.std[axis]))
    errors['acceleration_eq27'] = e_a
    errors['force_eq26'] = force_error(mass, float(c.mass.std), v, v, peak * v[:, 0],
                                       e_a * v[:, 0])
    return errors


def _turn_x_to(direction: Array) -> Array:
    """Rotation that takes x to a unit vector near it."""
    y = np.cross([0.0, 0.0, 1.0], direction)
    y /= np.linalg.norm(y)
    return np.column_stack([direction, y, np.cross(direction, y)])


def refuse_unnatural(c: Calibration) -> None:
    """
    Refuse what no tool can be.

    Raises
    ------
    DataError
        Names the estimate, its value and what makes it so.
    """
    away = float(np.linalg.norm(c.com.value))
    if not away < FARTHEST:
        raise DataError(
            f'the estimated centre of mass is {away:.3g} m away from the sensor, which is '
            'impossible for a tool; check the unit of the torques (N m, not N mm, N cm or lbf in) '
            'and their axes, or the unit of the forces (N, not kN)')


def unnatural_inertia(c: Calibration) -> str:
    """Say why an inertia is that of no body, and so not identified; empty: it may be one."""
    if c.inertia is None:
        return ''
    moments = np.linalg.eigvalsh(c.inertia.value)
    # an inertia is that of no body by so many standard errors: one identification in a million
    certain = 5.0
    margin = certain * float(np.linalg.norm(c.inertia.std))
    if moments[0] > -margin and moments[0] + moments[1] > moments[2] - 2.0 * margin and (
            moments[2] - margin < float(c.mass) * FARTHEST**2):
        return ''
    return ('inertia: not identified, because principal moments of '
            f'{", ".join(f"{one:.3g}" for one in moments)} kg m^2 are impossible for '
            f'{float(c.mass):.3g} kg; check for contact in the motion, for different clocks of '
            'pose and wrench, and the axes of the torques')
