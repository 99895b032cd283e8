"""Whether a calibration belongs to a recording, by what weighs on the sensor whatever it does."""

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.identify.lasting_change import lasting_change
from forcecal_ros.recording.checks import limits
from forcecal_ros.recording.checks.frame_faults import refuse_other_frame
from forcecal_ros.recording.checks.frames import Fit, Forces, judge
from forcecal_ros.recording.checks.units import force_unit_of
from forcecal_ros.recording.level import DOWN
from forcecal_ros.recording.streams import PoseStream, Recording, Stream
from forcecal_ros.recording.time_grid import Averager
import numpy as np

LENGTH = 0.5
"""Means over so long even out what moves and rings [s]."""

TURNS = 0.1
"""Means in which the sensor turns by more tell no direction [rad]."""

FEWEST = 12
"""So many means at least tell weight and frame."""

UNTOUCHED = 3.0
"""Means farther from a fit than so many times the median are taken for contact."""

EXPLAINED = 0.3
"""What a calibration leaves of the forces, and a weight fitted anew does not to this share, is no
contact: of sound recordings with pushes the ratio is 0.8 and more."""

SLIGHT = 0.05
"""Share of the tool's weight that a sensor may drift by from day to day."""

GRAVITY_OFF = 0.2
"""An accelerometer that shows gravity off by this share of it is not as it was calibrated:
offsets wander by a hundredth."""


def refuse_foreign(recording: Recording, calibration: Calibration) -> tuple[str, ...]:
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
    pose, wrench = recording.pose, recording.wrench
    if pose is None or wrench is None or len(pose) < FEWEST or len(wrench) < FEWEST:
        return ()
    begins = np.arange(max(pose.t[0], wrench.t[0]), min(pose.t[-1], wrench.t[-1]) - LENGTH, LENGTH)
    begins, R = _resting(pose, begins)
    if len(begins) < FEWEST:
        return ()
    _refuse_other_gravity(recording, calibration, begins, R)
    force = _means(wrench, begins)[:, :3]
    whole = np.isfinite(force).all(axis=1)
    forces = Forces(R[whole], force[whole], calibration.gravity * DOWN, None)
    changed = _changed(forces, begins[whole], calibration)
    return (changed,) if changed else _judged(forces, calibration)


def _resting(pose: PoseStream, begins: Array) -> tuple[Array, Array]:
    """Return the stretches in which a sensor hardly turns, and its orientation there."""
    first, middle, last = (np.searchsorted(pose.t, begins + share * LENGTH).clip(
        max=len(pose) - 1) for share in (0.0, 0.5, 1.0))
    R = pose.R_base_sensor
    turned = np.linalg.norm(R[first] - R[last], axis=(1, 2)) / np.sqrt(2.0)
    near = np.abs(pose.t[middle] - begins - LENGTH / 2.0) < LENGTH / 2.0
    rest = near & (turned < TURNS)
    return begins[rest], R[middle[rest]]


def _means(stream: Stream, begins: Array) -> Array:
    return np.asarray(Averager(stream.t, stream.values).means(begins, LENGTH))


def _refuse_other_gravity(recording: Recording, calibration: Calibration, begins: Array, R: Array
                          ) -> None:
    """Refuse an accelerometer that shows gravity elsewhere than the pose and its calibration."""
    stream, sensor = recording.accelerometer, calibration.accelerometer
    if stream is None or sensor is None or sensor.coupling != 'dc' or (
            recording.accelerometer_unit != sensor.unit or not len(stream)):
        return
    shown = (_means(stream, begins) - sensor.offset.value) @ np.linalg.inv(sensor.matrix).T
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


def _judged(forces: Forces, calibration: Calibration) -> tuple[str, ...]:
    forces = _untouched(forces)
    mass, bias = float(calibration.mass), calibration.wrench_bias.value[:3]
    left = _rms(forces.wire - mass * forces.in_sensor - bias)
    weight = mass * calibration.gravity
    if len(forces.wire) < FEWEST or left < SLIGHT * weight or (
            np.linalg.norm(forces.in_sensor.std(axis=0)) < limits.SPANNED * calibration.gravity):
        return ()
    judgement = judge(forces)
    best = judgement.likely[0]
    if best.rms > EXPLAINED * left:
        return _made_worse(forces, mass)
    if best is not judgement.plain and best.name not in ('tilted', 'both'):
        refuse_other_frame(judgement, DOWN, calibration.wrench_sign, calibration.sensor_rotation)
    _refuse_other_force_unit(judgement.plain, mass)
    if best is not judgement.plain:
        return ((f'a force of {left:.2g} N RMS keeps its direction in base beside the weight: '
                 'steady contact, or a base that is not level as it was calibrated'),)
    now = best.gravity @ forces.R_base_sensor * best.mass + best.residuals
    off = (forces.wire - now).mean(axis=0) - bias
    return ((f'what weighs on the sensor all along is {best.mass:.4g} +- {best.mass_std:.2g} kg '
             f'and a bias {" ".join(f"{x:+.2g}" for x in off)} N off, {mass:.4g} kg by the '
             f'calibration, which leaves {left:.2g} N RMS of that as contact: another tool, a '
             'payload, or a sensor tared since; calibrate again, or tare'),)


def _made_worse(forces: Forces, mass: float) -> tuple[str, ...]:
    """Say that forces change more without a weight than with it; empty: they change less."""
    weight = mass * forces.in_sensor
    before, taken_off, without = (_rms(x - x.mean(axis=0)) for x in (
        forces.wire, weight, forces.wire - weight))
    if without < before or taken_off < EXPLAINED * before:
        return ()
    return ((f'forces change by {before:.2g} N RMS as recorded, and by {without:.2g} N with the '
             'weight taken off: pose and wrench may not belong to each other, or the pose is that '
             'of base in the sensor; look at both'),)


def _refuse_other_force_unit(plain: Fit, mass: float) -> None:
    unit = force_unit_of(plain.mass, mass)
    if unit is not None:
        name, factor = unit
        raise DataError(
            f'wrench: the tool of {mass:.4g} kg weighs {plain.mass:.4g} kg in this recording: '
            f'its forces are in {name}; multiply by {factor:.5g} in the driver or in the import')


def _untouched(forces: Forces) -> Forces:
    """Leave out what lies far from any matrix of gravity and a bias: contact."""
    rows = np.column_stack([forces.in_sensor, np.ones(len(forces.wire))])
    keep = np.ones(len(rows), dtype=bool)
    for _ in range(10):
        fit = np.linalg.lstsq(rows[keep], forces.wire[keep], rcond=1e-6)[0]
        off = np.linalg.norm(forces.wire - rows @ fit, axis=1)
        keep = off <= UNTOUCHED * max(float(np.median(off)), limits.NIL)
    return Forces(forces.R_base_sensor[keep], forces.wire[keep], forces.gravity, None)


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))
