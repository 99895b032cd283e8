"""Whether a calibration belongs to a recording, by what weighs on the sensor whatever it does."""

from forcecal_ros.calibrate.lasting_change import lasting_change
from forcecal_ros.checks.at_rest import (
    at_rest,
    AtRest,
    means_at,
    place_of,
    refuse_other_force_unit,
    refuse_other_lever,
    UNEXPLAINED,
)
from forcecal_ros.checks.frame_faults import refuse_other_frame, Stated
from forcecal_ros.checks.frames import Forces, judge
from forcecal_ros.checks.inertia import motion_notes
from forcecal_ros.checks.orientations import (
    refuse_other_orientation,
    simpler_reading,
)
from forcecal_ros.checks.torques import refuse_exchanged, refuse_other_torques
from forcecal_ros.core.axes import DOWN
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
import numpy as np

SLIGHT = 0.05
"""Share of the tool's weight that a sensor may drift by from day to day."""

GRAVITY_OFF = 0.2
"""An accelerometer that shows gravity off by this share of it is not as it was calibrated:
offsets wander by a hundredth."""


HALF = 0.5
"""Another tool or bias is noted where it leaves less than this share of what the calibration
leaves; a sensor that drifts, or is tared now and then, leaves more than a frame may."""

BETTER = 0.6
"""Another frame that leaves more than this share of what another tool leaves is not believed:
drift fits a turn by a quarter better."""

ARM = 0.05
"""Torques of a tool whose centre of mass is nearer are judged as of one so far [m]."""

MOVED = 0.01
"""A centre of mass that is off by less may be a gripper that has opened [m]."""


def refuse_disagreeing(recording: Recording, calibration: Calibration) -> tuple[str, ...]:
    """
    Refuse a recording whose sensors are in other axes or units than those calibrated.

    Parameters
    ----------
    recording : Recording
        In the axes of the calibration.

    Returns
    -------
    tuple of str
        What weighs or pulls that the calibration does not know.

    Raises
    ------
    DataError
        Names cause and remedy, as ``forcecal calibrate`` does.
    """
    found = at_rest(recording, calibration.gravity * DOWN)
    if found is None:
        return ()
    _refuse_other_gravity(recording, calibration, found.begins, found.forces.R_base_sensor)
    changed = _changed(found.forces, found.begins, calibration)
    if changed:
        return (changed,)
    untouched = found.untouched
    found_at_rest = _judged(untouched, calibration) or _torques_judged(untouched, calibration)
    return (*found_at_rest, *motion_notes(recording))


def _refuse_other_gravity(recording: Recording, calibration: Calibration, begins: Array, R: Array
                          ) -> None:
    """Refuse an accelerometer that shows gravity elsewhere than the pose and its calibration."""
    stream, sensor = recording.accelerometer, calibration.accelerometer
    if stream is None or sensor is None or sensor.coupling != 'dc' or (
            recording.accelerometer_unit != sensor.unit or not len(stream)):
        return
    shown = (means_at(stream, begins) - sensor.offset.value) @ np.linalg.inv(sensor.matrix).T
    g = calibration.gravity
    off = np.linalg.norm(shown - g * R[:, 2], axis=1)
    if not np.isfinite(off).any() or np.nanmedian(off) < GRAVITY_OFF * g:
        return
    size = float(np.nanmedian(np.linalg.norm(shown, axis=1)))
    raise DataError(
        f'accelerometer: by the calibration it shows {size:.3g} m/s^2 at rest, '
        f'{float(np.nanmedian(off)):.3g} m/s^2 off the {g:.3g} m/s^2 of gravity as the pose turns '
        'it: its unit or its mount is another than calibrated, or it hangs on another link; '
        'calibrate again with the sensor as it is')


def _changed(forces: Forces, times: Array, calibration: Calibration) -> str:
    mass = float(calibration.mass)
    off = forces.wire - mass * forces.in_sensor - calibration.wrench_bias.value[:3]
    return lasting_change(forces, times, off, SLIGHT * mass * calibration.gravity)


def _judged(found: AtRest, calibration: Calibration) -> tuple[str, ...]:
    forces = found.forces
    mass, bias = float(calibration.mass), calibration.wrench_bias.value[:3]
    residual = _rms(forces.wire - mass * forces.in_sensor - bias)
    weight = mass * calibration.gravity
    if residual < SLIGHT * weight or not found.tells:
        return ()
    judgement = judge(forces)
    refuse_exchanged(forces, found.torque)
    refuse_other_orientation(forces, judgement)
    best, plain = judgement.likely[0], judgement.plain
    if plain.mass > 0.0 and best.rms > BETTER * plain.rms:
        best = plain
    if best.rms > (HALF if best is plain else UNEXPLAINED) * residual:
        return _made_worse(forces, mass)
    if best is not plain and best.name not in ('tilted', 'both'):
        refuse_other_frame(judgement, Stated(
            DOWN, calibration.wrench_sign, calibration.sensor_rotation,
            calibration.sensor_from_pose, 'calibration'), simpler_reading(forces, judgement))
    if best.rms < UNEXPLAINED * residual:
        refuse_other_force_unit(plain.mass, mass)
    if best is not plain:
        return ((f'a force of {residual:.2g} N RMS keeps its direction in base beside the weight: '
                 'steady contact, or a base that is not level as it was calibrated'),)
    now = best.gravity @ forces.R_base_sensor * best.mass + best.residuals
    off = (forces.wire - now).mean(axis=0) - bias
    return ((f'what weighs on the sensor all along is {best.mass:.4g} +- {best.mass_std:.2g} kg '
             f'and a bias {" ".join(f"{x:+.2g}" for x in off)} N off, {mass:.4g} kg by the '
             f'calibration, which leaves {residual:.2g} N RMS of that as contact: another tool, a '
             'payload, a sensor tared since, or one whose zero drifts; calibrate again'),)


def _torques_judged(found: AtRest, calibration: Calibration) -> tuple[str, ...]:
    """Compare the torques that the weight makes with the calibrated centre of mass."""
    if not found.tells:
        return ()
    com = calibration.com.value
    weight = float(calibration.mass) * found.forces.in_sensor
    size = float(calibration.mass) * calibration.gravity
    torque = found.torque - calibration.wrench_bias.value[3:]
    residual = _rms(torque - np.cross(com, weight))
    if residual < SLIGHT * size * max(ARM, float(np.linalg.norm(com))):
        return ()
    refuse_other_torques(weight, found.torque, None, found.forces.R_base_sensor)
    refuse_other_lever(weight, found.torque, com)
    shown = place_of(weight, found.torque)
    off = torque - np.cross(shown, weight)
    if (np.linalg.norm(shown - com) < MOVED
            or _rms(off - off.mean(axis=0)) > UNEXPLAINED * residual):
        return ()
    return ((f'torques put the centre of mass at {_metres(shown)} m, the calibration has it at '
             f'{_metres(com)} m, though the weight is the same: they are about another point (the '
             'tool centre, not the sensor), or another tool hangs there; torques that are left '
             'count as contact: calibrate again'),)


def _metres(place: Array) -> str:
    return f'({" ".join(f"{x:.3f}" for x in place)})'


def _made_worse(forces: Forces, mass: float) -> tuple[str, ...]:
    """Say that forces change more without a weight than with it; empty: they change less."""
    weight = mass * forces.in_sensor
    before, taken_off, without = (_rms(x - x.mean(axis=0)) for x in (
        forces.wire, weight, forces.wire - weight))
    if without < before or taken_off < UNEXPLAINED * before:
        return ()
    return ((f'forces change by {before:.2g} N RMS as recorded, and by {without:.2g} N with the '
             'weight taken off: pose and wrench do not belong to each other; name the pose of '
             'this sensor with --topic pose=NAME'),)


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))
