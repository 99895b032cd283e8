"""From a recording to a calibration: every step of the procedure in its order."""

from dataclasses import replace
from datetime import datetime, timezone
from typing import Any

from forcecal_ros.calibrate.accelerometer import (
    AccelerometerFit,
    identify_accelerometer,
    identify_static_accelerometer,
)
from forcecal_ros.calibrate.accelerometer_model import lowpassed, MotionBlocks, ToolPart
from forcecal_ros.calibrate.by_motion import calibrate_by_motion
from forcecal_ros.calibrate.delay import pose_delay
from forcecal_ros.calibrate.joint import MIN_GRAVITY_SPREAD
from forcecal_ros.calibrate.means import (
    DRIFT,
    drift,
    grid_recording,
    GriddedRecording,
    ToolMotion,
    window_mean,
)
from forcecal_ros.calibrate.moving_tool import identify_inertia, identify_moving_tool, InertiaFit
from forcecal_ros.calibrate.poses import NeverAtRest, static_poses, StaticPose
from forcecal_ros.calibrate.quality import quality_of
from forcecal_ros.calibrate.requirements import (
    refuse_poses_at_a_limit,
    refuse_unnatural,
    require_wrench,
    unnatural_inertia,
)
from forcecal_ros.calibrate.result import (
    accelerometer_of,
    inertia_of,
    noise_of,
    observer_of,
    Stages,
    tool_of,
)
from forcecal_ros.calibrate.ringing import RingFit
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.static_readings import (
    check_weight,
    gravity_spread,
    Statics,
    TurnedWrench,
)
from forcecal_ros.calibrate.statics import read_statics, ring_of, Sag, sag_of, with_ring
from forcecal_ros.calibrate.tool import identify_tool, ToolFit, weigh, Weight
from forcecal_ros.calibrate.touched import what_touches
from forcecal_ros.calibrate.unsettled import mode_of, settled, without_ringing
from forcecal_ros.checks.accelerometer import refuse_on_another_link, refuse_other_unit
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.hypotheses import judge, slight_misfit
from forcecal_ros.checks.messages import Stated
from forcecal_ros.checks.signals import clipped
from forcecal_ros.core.axes import DOWN, in_axes_of_pose, level_from_base, levelled
from forcecal_ros.core.calibration import Calibration, Estimate, Noise, ObserverGain
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.kinematics import AngularMotion
from forcecal_ros.core.schema import Vector3
from forcecal_ros.core.stamps import with_even_stamps
from forcecal_ros.core.streams import Recording
from forcecal_ros.core.time_grid import Averager
import numpy as np


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
    recording = checked(recording).recording
    try:
        with np.errstate(all='ignore'):
            stages = _stages_or_motion(recording, settings)
    except TurnedWrench as error:
        raise DataError(f'{error}; set wrench.sign to {-settings.wrench_sign} '
                        f'(--wrench-sign {-settings.wrench_sign})') from error
    except ValueError as error:
        if not isinstance(error, np.linalg.LinAlgError) and 'infs or NaNs' not in str(error):
            raise
        raise DataError(f'{recording.source or "the recording"}: the fit breaks down ({error}); '
                        'look for readings of absurd size and stamps of another clock') from error
    if isinstance(stages, dict):
        return _natural(Calibration(**stages, **_stated(recording, settings)))
    noise = noise_of(stages, settings.coupling)
    tool, std = stages.tool, np.sqrt(np.diag(stages.tool.covariance))
    calibration = Calibration(
        mass=Estimate(tool.mass, std[0], 'kg'),
        com=Estimate(tool.com, std[4:7], 'm'),
        wrench_bias=Estimate(np.concatenate([tool.force_bias, tool.torque_bias]),
                             std[[1, 2, 3, 7, 8, 9]], 'N, N m'),
        inertia=inertia_of(stages, settings),
        accelerometer=accelerometer_of(stages, settings),
        tool=tool_of(stages),
        noise=noise,
        observer=_observer(stages, noise, settings),
        **_stated(recording, settings))
    return _natural(replace(calibration, quality=quality_of(stages, calibration, settings)))


def _natural(calibration: Calibration) -> Calibration:
    """Refuse what no tool can be; leave out an inertia that no body has."""
    refuse_unnatural(calibration)
    if not (no_body := unnatural_inertia(calibration)):
        return calibration
    calibration.quality['warnings'].append(no_body)
    return replace(calibration, inertia=None)


def _stated(recording: Recording, settings: IdentificationSettings) -> dict[str, Any]:
    """Return what a calibration holds of its settings and its recording."""
    wrench = require_wrench(recording)
    return {
        'gravity': settings.gravity, 'gravity_direction': _unit(settings.gravity_direction),
        'sensor_rotation': _turned(settings.sensor_rotation),
        'sensor_frame': wrench.frame or 'ft_sensor', 'wrench_sign': settings.wrench_sign,
        'sensor_from_pose': recording.sensor_from_pose,
        'source': {'recording': recording.source, **_recorded(recording), **settings.source}}


def _stages_or_motion(recording: Recording, settings: IdentificationSettings
                      ) -> Stages | dict[str, Any]:
    """Identify from static poses, or from motion where they are missing or all alike."""
    try:
        return identify_stages(recording, settings)
    except NeverAtRest as error:
        try:
            return _by_motion(recording, settings, 'the robot never stands still')
        except TurnedWrench:
            raise
        except (DataError, UnobservableError) as refused:
            raise type(refused)(f'{error}, or let motion show the tool: {refused}') from refused
    except UnobservableError as error:
        if not _same_orientation(recording, settings):
            raise
        try:
            return _by_motion(recording, settings, 'the static poses have one orientation')
        except (DataError, UnobservableError):
            raise error from None


def _by_motion(recording: Recording, settings: IdentificationSettings, why: str
               ) -> dict[str, Any]:
    recording = _evened(levelled(recording, settings.gravity_direction))
    return calibrate_by_motion(in_axes_of_pose(recording, settings.sensor_rotation), settings, why)


def _same_orientation(recording: Recording, settings: IdentificationSettings) -> bool:
    """Whether all static poses point gravity the same way, within `MIN_GRAVITY_SPREAD`."""
    poses = static_poses(levelled(recording, settings.gravity_direction))
    spread, _ = gravity_spread(np.stack([pose.gravity(settings.gravity) for pose in poses]))
    return bool(spread[0] < MIN_GRAVITY_SPREAD)


def _unit(direction: Vector3 | None) -> Vector3 | None:
    """Return the unit vector of a direction that is not plainly down."""
    if direction is None or level_from_base(direction) is None:
        return None
    x, y, z = np.asarray(direction) / np.linalg.norm(direction)
    return float(x), float(y), float(z)


def _turned(rotation: Vector3 | None) -> Vector3 | None:
    """Return a rotation vector that is not zero."""
    return rotation if rotation is not None and any(rotation) else None


def _recorded(recording: Recording) -> dict[str, str]:
    """Say when the recording began, where it says so."""
    if not recording.start_ns > 0:
        return {}
    start = datetime.fromtimestamp(recording.start_ns // 10**9, timezone.utc)
    return {'recorded': start.isoformat()}


def _observer(stages: Stages, noise: Noise | None, settings: IdentificationSettings
              ) -> ObserverGain | None:
    """Design the paper's gain; None where nothing was measured that it could be made of."""
    try:
        return observer_of(noise, stages.tool.mass, settings) if noise else None
    except UnobservableError:
        return None


def identify_stages(recording: Recording, settings: IdentificationSettings) -> Stages:
    """
    Run every stage; :func:`identify` makes the calibration of them.

    Raises
    ------
    DataError, UnobservableError
        As :func:`identify`.
    """
    recording, removed = checked(recording)
    require_wrench(recording)
    recording, slight = _judged(_evened(recording), settings)
    recording = levelled(recording, settings.gravity_direction)
    poses = static_poses(recording)
    stops = clipped(recording)
    refuse_poses_at_a_limit(recording, stops, poses)
    recording = in_axes_of_pose(recording, settings.sensor_rotation)
    _refuse_other_unit(recording, poses, settings)
    gridded = grid_recording(recording, poses, settings)
    statics = read_statics(recording, poses, settings, gridded)
    check_weight(statics.gravity, settings.thresholds.condition)
    if gridded is None:
        return replace(_single_samples(recording, removed, poses, statics, settings),
                       slight_misfit=slight, stops=stops)
    weight, sag, ring = _ringing(recording, poses, statics, gridded, settings)
    if ring is not None:
        gridded, statics = _settled(recording, poses, statics, gridded, weight.mass, ring,
                                    settings)
        weight, sag, ring = _ringing(recording, poses, statics, gridded, settings)
    statics = with_ring(statics, weight.mass, ring, settings)
    slide = _slide(recording, gridded, weight, ring)
    touched = what_touches(gridded, weight, settings.gravity)
    tool, inertia, late = _tool(gridded, statics, weight, slide, touched, settings)
    if touched:
        recording = replace(recording, notes=(*recording.notes, (
            f'{touched}; inertia is not taken from it')))
    turn = gridded.kinematics.angular(late[0] if late else 0.0)
    return Stages(recording, removed, poses, statics, tool, sag, ring,
                  _accelerometer(recording, gridded, tool, turn, settings), inertia, late,
                  ToolMotion(gridded, slide, turn), slight, stops)


def _judged(recording: Recording, settings: IdentificationSettings) -> tuple[Recording, str]:
    """Refuse a recording that another hypothesis explains better; name what is slight."""
    level = level_from_base(settings.gravity_direction)
    down = DOWN if level is None else level.T @ DOWN
    stated = Stated(down, settings.wrench_sign, settings.sensor_rotation,
                    recording.sensor_from_pose)
    judged = in_axes_of_pose(recording, settings.sensor_rotation)
    notes = judge(judged, settings.gravity * down, stated)
    return (replace(recording, notes=(*recording.notes, *notes)),
            slight_misfit(judged, settings.gravity * down, stated))


def _settled(recording: Recording, poses: list[StaticPose], statics: Statics,
             gridded: GriddedRecording, mass: float, ring: RingFit,
             settings: IdentificationSettings) -> tuple[GriddedRecording, Statics]:
    """Take what still rings off the poses' means; off their noise only where off all means."""
    if (mode := mode_of(ring, mass)) is not None:
        quiet = without_ringing(gridded, mode)
        read = settled(read_statics(recording, poses, settings, quiet), recording, poses, mass,
                       ring)
        if read.ringing is not None and read.ringing.any(axis=1).all():
            return quiet, read
    return gridded, settled(statics, recording, poses, mass, ring)


def _ringing(recording: Recording, poses: list[StaticPose], statics: Statics,
             gridded: GriddedRecording, settings: IdentificationSettings
             ) -> tuple[Weight, Sag | None, RingFit | None]:
    """Return mass and force bias, and what static sag and ringing say of the tool's spring."""
    weight = weigh(statics, settings.thresholds.condition)
    sag = sag_of(statics, weight.mass)
    if settings.tool_compliance == 'no':
        return weight, sag, None
    return weight, sag, ring_of(recording, poses, statics, weight.mass, sag, gridded)


def _evened(recording: Recording) -> Recording:
    """Even the stamps that jitter, and note which."""
    changes: dict[str, Any] = {}
    notes = []
    for name in ('wrench', 'accelerometer', 'optidrive', 'pose'):
        stream = getattr(recording, name)
        if stream is None:
            continue
        changes[name], jitter = with_even_stamps(stream)
        if changes[name] is not stream:
            notes.append(f'stamps of {name} jitter by {1e3 * jitter.std:.2g} ms around '
                         f'{1e3 * jitter.period:.3g} ms; evened out')
    return replace(recording, **changes, notes=(*recording.notes, *notes))


def _refuse_other_unit(recording: Recording, poses: list[StaticPose],
                       settings: IdentificationSettings) -> None:
    """Refuse an accelerometer in m/s^2 that does not show gravity; one in volts may show any."""
    stream = recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V' or settings.coupling == 'ac':
        return
    shown = [(part.mean(axis=0), pose.gravity(settings.gravity)) for pose in poses
             if len(part := stream.between(pose.start, pose.end).values)]
    if shown:
        means, gravity = (np.array(column) for column in zip(*shown, strict=True))
        sigmas, *_ = drift(stream, [(pose.start, pose.end) for pose in poses])
        refuse_other_unit(means, settings.gravity, decays=sigmas > DRIFT)
        refuse_on_another_link(means, gravity)


def _single_samples(recording: Recording, removed: dict[str, int], poses: list[StaticPose],
                    statics: Statics, settings: IdentificationSettings) -> Stages:
    """Identify from poses that are single samples: noise from residuals, nothing from motion."""
    condition = settings.thresholds.condition
    tool, accelerometer = identify_tool(statics, condition), None
    if recording.accelerometer is not None:
        volts = np.stack([window_mean(recording.accelerometer, p.start, p.end, 'accelerometer')
                          for p in poses])
        accelerometer = identify_static_accelerometer(statics.gravity, volts, condition)
    return Stages(recording, removed, poses, statics, tool, None, None, accelerometer, None, None,
                  None)


def _tool(gridded: GriddedRecording, statics: Statics, weight: Weight, slide: Array,
          touched: str, settings: IdentificationSettings
          ) -> tuple[ToolFit, InertiaFit | None, tuple[float, float] | None]:
    """
    Tool and inertia; the centre of mass by the motion where the poses do not tell it.

    What is ``touched`` in motion shows neither, nor a delay.
    """
    grid, condition = gridded.grid, settings.thresholds.condition
    spread, _ = gravity_spread(statics.gravity)
    by_motion = spread[1] * condition < spread[0] and bool(grid.free.any())
    if touched and by_motion:
        raise UnobservableError(
            'centre of mass and torque bias are not observable from '
            f'{len(statics.gravity)} static poses, and {touched}; add a pose tilted about another '
            'axis of ft_sensor, or move it with nothing that touches it')
    tool = None if by_motion else identify_tool(statics, condition)
    if touched and tool is not None:
        return tool, None, None
    late = pose_delay(
        gridded.kinematics, gridded.wrench[:, :3], slide, grid, weight.mass, weight.force_bias,
        np.zeros(3) if tool is None else tool.com, settings.gravity, settings.largest_delay)
    turn = gridded.kinematics.angular(late[0] if late else 0.0)
    if tool is None:
        return *identify_moving_tool(weight, statics, gridded.wrench, slide, turn, grid.free,
                                     grid.still, condition), late
    theta = np.concatenate([[tool.mass], tool.force_bias, tool.com, tool.torque_bias])
    return tool, identify_inertia(gridded.wrench, slide, turn.omega, turn.alpha, grid.free,
                                  grid.still, theta, tool.covariance), late


def _slide(recording: Recording, gridded: GriddedRecording, weight: Weight,
           ring: RingFit | None) -> Array:
    """Displacement of the tool in each block [m]: measured, by the spring, or none."""
    optidrive, grid = recording.optidrive, gridded.grid
    if optidrive is not None and len(optidrive) > 1:
        delay = ring.slide_delay if ring else 0.0
        means = Averager(optidrive.t, optidrive.values).means(grid.starts + delay, grid.length)
        return np.asarray(means[:, 0])
    force = gridded.wrench[:, 0] - weight.force_bias[0]
    if ring is None:
        return np.zeros(len(force))
    # k s + d ds/dt = F: the slide follows the force through a first-order low-pass
    whole = np.isfinite(force)
    filled = np.interp(grid.starts, grid.starts[whole], force[whole])
    start = filled[0] / ring.stiffness
    corner = ring.stiffness / (2 * np.pi * ring.damping)
    slide = start + lowpassed(filled / ring.stiffness - start, grid.length, corner)
    return np.where(whole, slide, np.nan)


def _accelerometer(recording: Recording, gridded: GriddedRecording, tool: ToolFit,
                   turn: AngularMotion, settings: IdentificationSettings
                   ) -> AccelerometerFit | None:
    stream, grid = recording.accelerometer, gridded.grid
    if stream is None or len(stream) < 20:
        return None
    motion = MotionBlocks(grid.length, -settings.gravity * turn.R_base_sensor[:, 2],
                    gridded.wrench[:, :3], turn.lever, grid.still, grid.free,
                    gridded.untouched, gridded.noise.mapped(np.eye(3, 6)))
    volts = Averager(stream.t, stream.values)
    place = settings.accelerometer_position
    return identify_accelerometer(
        motion, lambda delay: volts.means(grid.starts + delay, grid.length),
        ToolPart(tool.mass, tool.force_bias, tool.com, tool.covariance[:7, :7]),
        settings.coupling, settings.cutoff, None if place is None else np.array(place),
        settings.largest_delay)
