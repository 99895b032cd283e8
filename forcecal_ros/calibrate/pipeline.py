"""From a recording to a calibration: every step of the procedure in its order."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from typing import Any

from forcecal_ros.calibrate.accelerometer import (
    accelerometer_fit,
    AccelerometerFit,
    identify_static_accelerometer,
)
from forcecal_ros.calibrate.findings import NO_ACCELEROMETER
from forcecal_ros.calibrate.joint import (
    Blocks,
    blocks_of,
    joint_fit,
    JointFit,
    MIN_GRAVITY_SPREAD,
    most_unexplained,
    principal_spread,
    require_overlap,
    require_rotation,
    require_tool,
    SUSPECT_UNEXPLAINED,
)
from forcecal_ros.calibrate.poses import (
    NeverAtRest,
    refuse_poses_at_a_limit,
    require_wrench,
    static_poses,
    StaticPose,
    values_in,
    window_mean,
)
from forcecal_ros.calibrate.quality import (
    quality_of,
    refuse_unnatural,
    unnatural_inertia,
    weak_estimates,
)
from forcecal_ros.calibrate.residuals import DRIFT, drift
from forcecal_ros.calibrate.result import (
    accelerometer_of,
    inertia_of,
    known_inertia,
    noise_of,
    observer_of,
    Stages,
    tool_of,
)
from forcecal_ros.calibrate.ringing import displacement, ring_of, sag_of
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.tool import (
    check_poses,
    check_weight,
    gravity_spread,
    identify_tool,
    read_statics,
    refuse_negative,
    Statics,
    tool_of_motion,
    with_noise,
)
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.gravity import refuse_on_another_link, refuse_other_unit
from forcecal_ros.checks.hypotheses import (
    judge,
    questions_of,
    refuse_late_accelerometer,
    slight_misfit,
)
from forcecal_ros.checks.messages import Finding, STANDSTILL, Stated
from forcecal_ros.checks.signals import clipped, SENSORS
from forcecal_ros.core.axes import DOWN, in_axes_of_pose, level_from_base, levelled, unit_direction
from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import SHORTEST
from forcecal_ros.core.stamps import with_even_streams
from forcecal_ros.core.streams import Recording, Stream
import numpy as np

MIN_SAMPLES = 20
"""Of a stream that is fitted in motion: poses of fewer are single samples."""

MAX_DELAY_STD = 2e-3
"""Standard error from which a delay is not identified [s]: a sample of a sensor at 500 Hz."""


def identify(recording: Recording, settings: IdentificationSettings = IdentificationSettings()
             ) -> Calibration:
    """
    Identify tool, sensors and observer gain from one recording.

    Parameters
    ----------
    recording : Recording
        Wrench and pose; with accelerometer, Optidrive and phases where there are any. Static
        poses are its phases ``measure``, of one sample or more each.

    Returns
    -------
    Calibration
        Without the gains of mode ``kalman``, which :mod:`forcecal_ros.observe.design` makes.

    Raises
    ------
    DataError
        A stream is missing or does not make sense.
    UnobservableError
        The poses do not determine the tool or the accelerometer.
    """
    recording = checked(recording)
    try:
        with np.errstate(all='ignore'):
            recording, found = _judged(with_even_streams(recording, SENSORS), settings)
            points = [one.point for one in found if one.point is not None]
            stages = _stages_or_motion(recording, settings, *points)
    except ValueError as error:
        if not isinstance(error, np.linalg.LinAlgError) and 'infs or NaNs' not in str(error):
            raise
        raise DataError(f'{recording.source or "the recording"}: the fit failed ({error}); check '
                        'for extreme readings and stamps of another clock') from error
    if isinstance(stages, dict):
        return _natural(Calibration(**stages, **_stated(recording, settings)), found)
    noise = noise_of(stages, settings.coupling)
    tool, std = stages.tool, np.sqrt(np.diag(stages.tool.covariance))
    calibration = Calibration(
        mass=Estimate(tool.mass, std[0], 'kg'),
        com=Estimate(tool.com, std[4:7], 'm'),
        wrench_bias=Estimate(np.concatenate([tool.force_bias, tool.torque_bias]),
                             std[[1, 2, 3, 7, 8, 9]], 'N, N m'),
        inertia=known_inertia(stages.inertia, settings.thresholds.inertia),
        accelerometer=accelerometer_of(stages.accelerometer, recording.accelerometer_unit,
                                       settings),
        tool=tool_of(stages),
        noise=noise,
        observer=observer_of(noise, stages.tool.mass, settings) if noise else None,
        **_stated(recording, settings))
    return _natural(replace(calibration, quality=quality_of(stages, calibration, settings)),
                    found)


def _natural(calibration: Calibration, found: Sequence[Finding]) -> Calibration:
    """Refuse what no tool can be; leave out an inertia that no body has; add warnings."""
    refuse_unnatural(calibration)
    quality = calibration.quality
    quality['warnings'][:0] = [one.line for one in found]
    quality['suspect'].extend(key for one in found for key in one.suspect
                              if key not in quality['suspect'])
    if not (no_body := unnatural_inertia(calibration)):
        return calibration
    quality['warnings'].append(no_body)
    return replace(calibration, inertia=None)


def _stated(recording: Recording, settings: IdentificationSettings) -> dict[str, Any]:
    """Return what a calibration holds of its settings and its recording."""
    wrench = require_wrench(recording)
    return {
        'gravity': settings.gravity,
        'gravity_direction': unit_direction(settings.gravity_direction),
        'sensor_rotation': turn if (turn := settings.sensor_rotation) and any(turn) else None,
        'sensor_frame': wrench.frame or 'ft_sensor', 'wrench_sign': recording.wrench_sign or 1,
        'sensor_from_pose': recording.sensor_from_pose,
        'source': {**provenance(recording), **settings.source}}


def _stages_or_motion(recording: Recording, settings: IdentificationSettings,
                      point: Array | None = None) -> Stages | dict[str, Any]:
    """Identify from static poses, or from motion where they are missing or all alike."""
    try:
        return identify_stages(recording, settings, point)
    except NeverAtRest as error:
        try:
            return _by_motion(recording, settings, 'the robot never stands still', point)
        except (DataError, UnobservableError) as refused:
            refused.args = (f'{error}; calibration from motion is not possible either: {refused}',)
            raise
    except UnobservableError as error:
        if not _same_orientation(recording, settings):
            raise
        try:
            return _by_motion(recording, settings, 'the static poses have one orientation', point)
        except (DataError, UnobservableError):
            raise error from None


def _by_motion(recording: Recording, settings: IdentificationSettings, why: str,
               point: Array | None) -> dict[str, Any]:
    recording = levelled(recording, settings.gravity_direction)
    recording = in_axes_of_pose(recording, settings.sensor_rotation)
    slide = settings.optidrive_of(recording)
    joint = fit_motion(recording, settings, (), slide, point)
    assert joint is not None and recording.pose is not None  # without poses it is one or refused
    require_tool(joint, recording.pose.has_position, settings.largest_delay)
    accelerometer = None
    if recording.pose.has_position and settings.coupling == 'dc':
        accelerometer = fit_accelerometer(recording, settings, joint, (), slide)
    return calibrate_by_motion(recording, settings, joint, accelerometer, why)


def _same_orientation(recording: Recording, settings: IdentificationSettings) -> bool:
    """Whether all static poses point gravity the same way, within `MIN_GRAVITY_SPREAD`."""
    poses = static_poses(levelled(recording, settings.gravity_direction))
    spread, _ = gravity_spread(np.stack([pose.gravity(settings.gravity) for pose in poses]))
    return bool(spread[0] < MIN_GRAVITY_SPREAD)


def provenance(recording: Recording) -> dict[str, str]:
    """Return whose recording it is, and when it began, where that is known."""
    if not recording.start_ns > 0:
        return {'recording': recording.source}
    start = datetime.fromtimestamp(recording.start_ns // 10**9, timezone.utc)
    return {'recording': recording.source, 'recorded': start.isoformat()}


def identify_stages(recording: Recording, settings: IdentificationSettings,
                    point: Array | None = None) -> Stages:
    """
    Run every stage; :func:`identify` makes the calibration of them.

    Parameters
    ----------
    point : ndarray, shape (3,), or None
        As of :func:`fit_motion`.

    Raises
    ------
    DataError, UnobservableError
        As :func:`identify`.
    """
    require_wrench(recording)
    recording = levelled(recording, settings.gravity_direction)
    poses = static_poses(recording)
    stops = clipped(recording)
    refuse_poses_at_a_limit(recording, stops, poses)
    recording = in_axes_of_pose(recording, settings.sensor_rotation)
    _refuse_other_unit(recording, poses, settings)
    statics = read_statics(recording, poses, settings)
    check_weight(statics.gravity, settings.thresholds.condition)
    slide = settings.optidrive_of(recording)
    joint = fit_motion(recording, settings, poses, slide, point)
    assert recording.pose is not None
    if joint is None:
        return replace(_single_samples(recording, poses, statics, settings), stops=stops)
    refuse_negative(float(joint.theta[0]), recording.wrench_sign)
    ring, sag = None, None
    if settings.tool_compliance != 'no':
        sag = sag_of(joint, require_wrench(recording))
        ring = ring_of(recording, poses, statics, joint, sag)
    if ring is not None:
        slide = displacement(recording, ring, joint)
        joint = fit_motion(recording, settings, poses, slide, point) or joint
        if not statics.slide.any():
            statics = statics._replace(slide=np.array([
                window_mean(slide, pose.start, pose.end)[0] for pose in poses]))
    elif joint.theta[17]:
        statics = statics._replace(
            slide=joint.theta[17] / joint.theta[0] * statics.gravity[:, 0])
    refuse_negative(float(joint.theta[0]), recording.wrench_sign)
    statics = with_noise(statics, joint, recording, poses)
    tool = tool_of_motion(joint, statics)
    moves = bool((joint.blocks.groups == 1).any())
    shows = moves and joint.unexplained <= most_unexplained(recording.pose.has_position)
    # standard error from which a centre of mass is not identified [m]: the size of tools
    largest_std = 0.1
    if not shows or not np.sqrt(np.diag(tool.covariance)[4:7].max()) < largest_std:
        check_poses(statics.gravity, settings.thresholds.condition)
    late = (-joint.delay, joint.delay_std)
    known = moves and joint.delay_std < MAX_DELAY_STD
    return Stages(recording, poses, statics, tool, sag, ring,
                  fit_accelerometer(recording, settings, joint, poses, slide),
                  inertia_of(joint) if moves else None, late if known else None, joint,
                  stops=stops)


def fit_motion(recording: Recording, settings: IdentificationSettings,
               poses: Sequence[StaticPose] = (), slide: Stream | None = None,
               point: Array | None = None) -> JointFit | None:
    """
    Fit the tool to a recording; None where its poses are too short for that.

    Parameters
    ----------
    slide : Stream or None
        Displacement of the tool along x [m].
    point : ndarray, shape (3,), or None
        Place in ft_sensor that torques are about [m]: the tool is fitted as one on a sensor that
        is near it, where it explains most. None: the origin of ft_sensor, exactly.
    """
    wrench, pose = require_wrench(recording), recording.pose
    assert pose is not None
    if point is not None:
        moved = (replace(recording, pose=replace(
            pose, position=pose.position + pose.R_base_sensor @ (point + step)))
            for step in 1e-3 * np.eye(4, 3, -1))  # none, and a millimetre along each axis
        fit, *others = (fit_motion(one, settings, poses, slide) for one in moved)
        return fit and _with_best_point(fit, [one for one in others if one])
    if not len(poses):
        require_overlap(wrench, pose)
    if min(len(wrench), len(pose)) < MIN_SAMPLES:
        if not len(poses):
            raise UnobservableError(f'{len(wrench)} readings of the wrench and {len(pose)} poses '
                                    f'are too few to calibrate; record {MIN_SAMPLES} of each')
        return None
    sag = settings.tool_compliance == 'yes' and slide is None
    blocks = _blocks(wrench, recording, settings, poses, slide)
    at = np.bincount(blocks.pose + 1, minlength=len(poses) + 1)[1:]
    held = np.bincount(blocks.still + 1, minlength=len(poses) + 1)[1:]
    if len(poses) and (at.min() < 1 or held.max() < SHORTEST):
        return None
    if not len(poses):
        require_rotation(blocks)
    return joint_fit(wrench, blocks, pose.has_position, settings.largest_delay, sag)


def _blocks(stream: Stream, recording: Recording, settings: IdentificationSettings,
            poses: Sequence[StaticPose], slide: Stream | None) -> Blocks:
    assert recording.pose is not None
    return blocks_of(stream, recording.pose, settings.gravity * DOWN, settings.largest_delay,
                     slide, [(p.start, p.end) for p in poses], recording.phases if poses else ())


def _with_best_point(fit: JointFit, others: Sequence[JointFit]) -> JointFit:
    """Move a fit to where it leaves least, by fits that are a step away along each axis."""
    by_step = np.stack([fit.residual - one.residual for one in others], axis=2)
    steps = robust_fit(by_step, fit.residual, groups=fit.blocks.groups)
    off = np.transpose([one.theta - fit.theta for one in others])
    return fit._replace(theta=fit.theta + off @ steps.theta,
                        covariance=fit.covariance + off @ steps.covariance @ off.T,
                        residual=steps.residual.reshape(-1, 6))


def fit_accelerometer(recording: Recording, settings: IdentificationSettings, joint: JointFit,
                      poses: Sequence[StaticPose] = (), slide: Stream | None = None
                      ) -> AccelerometerFit | None:
    """Fit the accelerometer to a recording; its delay is that after the wrench."""
    stream, place = recording.accelerometer, settings.accelerometer_position
    if stream is None or len(stream) < MIN_SAMPLES:
        return None
    fit = accelerometer_fit(
        stream, _blocks(stream, recording, settings, poses, slide), settings.coupling,
        settings.cutoff, None if place is None else np.array(place), settings.largest_delay)
    # largest standard error of an element of the accelerometer's map, of its largest: above, it is
    # not identified
    most_relative = 0.05
    if fit.std[3:12].max() > most_relative * np.abs(fit.matrix).max():
        return None
    C = fit.covariance.copy()
    C[12, 12] += joint.covariance[16, 16]
    late = fit.delay - joint.delay
    known = np.sqrt(C[12, 12]) < MAX_DELAY_STD
    return fit._replace(delay=late if known else np.nan, covariance=C)


def _judged(recording: Recording, settings: IdentificationSettings
            ) -> tuple[Recording, list[Finding]]:
    """Refuse what another hypothesis explains better; return what is questioned."""
    level = level_from_base(settings.gravity_direction)
    down = DOWN if level is None else level.T @ DOWN
    stated = Stated(down, recording.wrench_sign or 1, settings.sensor_rotation,
                    recording.sensor_from_pose)
    judged = in_axes_of_pose(recording, settings.sensor_rotation)
    if settings.coupling == 'dc':
        refuse_late_accelerometer(judged, settings.gravity * down)
    found = judge(judged, settings.gravity * down, stated)
    questions = [one for one in found if isinstance(one, Finding)]
    if slight := slight_misfit(judged, settings.gravity * down, stated):
        questions.append(Finding(slight, STANDSTILL))
    # others are of what is estimated as well, as a delay
    notes = [one for one in found if not isinstance(one, Finding)]
    return replace(recording, notes=(*recording.notes, *notes)), questions


def _refuse_other_unit(recording: Recording, poses: list[StaticPose],
                       settings: IdentificationSettings) -> None:
    """Refuse an accelerometer in m/s^2 that does not show gravity; one in volts may show any."""
    stream = recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V' or settings.coupling == 'ac':
        return
    parts = values_in(stream, poses)
    shown = [(part.mean(axis=0), pose.gravity(settings.gravity))
             for part, pose in zip(parts, poses) if len(part)]
    if shown:
        means, gravity = (np.array(column) for column in zip(*shown, strict=True))
        sigmas, *_ = drift(parts)
        refuse_other_unit(means, settings.gravity, decays=sigmas > DRIFT)
        refuse_on_another_link(means, gravity)


def _single_samples(recording: Recording, poses: list[StaticPose], statics: Statics,
                    settings: IdentificationSettings) -> Stages:
    """Identify from poses that are single samples: noise from residuals, nothing from motion."""
    condition = settings.thresholds.condition
    tool, accelerometer = identify_tool(statics, condition), None
    refuse_negative(tool.mass, recording.wrench_sign)
    if recording.accelerometer is not None:
        volts = np.stack([window_mean(recording.accelerometer, p.start, p.end, 'accelerometer')
                          for p in poses])
        accelerometer = identify_static_accelerometer(statics.gravity, volts, condition)
    return Stages(recording, poses, statics, tool, None, None, accelerometer, None, None, None)


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
    refuse_negative(float(found.theta[0]), recording.wrench_sign)
    inertia = inertia_of(found)
    # largest standard error of an element of inertia, of its mean moment: above, it is left out
    most_relative = 0.3
    known = known_inertia(inertia, most_relative)
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
            f'{found.unexplained:.0%} of the variation of its weight; check that wrench and pose '
            'have the same axes, and record without contact or cable forces; suspect: '
            + ', '.join(suspect))
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
        yield ('inertia: not identified, and accelerations of the sensor are assumed to be 0, '
               'because the pose has no position; record the position as well')
    elif inertia is not None:
        error, size = float(inertia.std.max()), float(np.trace(inertia.value)) / 3
        share = f' ({error / size:.0%} of the mean moment)' if size > 0.0 else ''
        yield (f'inertia: not identified, its standard error is {error:.2g} kg m^2{share}; rotate '
               'faster about all three axes')
    if accelerometer is None and recording.accelerometer is not None:
        yield NO_ACCELEROMETER
