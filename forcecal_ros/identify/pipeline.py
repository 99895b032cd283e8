"""From a recording to a calibration: every step of the procedure in its order."""

from dataclasses import replace

from forcecal_ros.calibration import Calibration, Estimate
from forcecal_ros.geometry import Array
from forcecal_ros.identify.accelerometer import (
    AccelerometerFit,
    identify_accelerometer,
    Motion,
    ToolPart,
)
from forcecal_ros.identify.blocks import Averager, block_length, Grid, make_grid
from forcecal_ros.identify.inertia import identify_inertia, InertiaFit
from forcecal_ros.identify.kinematics import Motions, pose_delay
from forcecal_ros.identify.means import Autocovariance, autocovariance, LAGS, window_mean
from forcecal_ros.identify.poses import static_poses, StaticPose
from forcecal_ros.identify.quality import quality_of
from forcecal_ros.identify.readings import clean, refuse_stuck, require_wrench
from forcecal_ros.identify.result import (
    accelerometer_of,
    inertia_of,
    noise_of,
    observer_of,
    Stages,
    tool_of,
)
from forcecal_ros.identify.ringing import RingFit, rings, stiffness_and_damping
from forcecal_ros.identify.settings import Settings
from forcecal_ros.identify.static_accelerometer import identify_static_accelerometer
from forcecal_ros.identify.tool import identify_tool, Statics, stiffness_from_sag, ToolFit
from forcecal_ros.samples import Recording, Stream
import numpy as np


def identify(recording: Recording, settings: Settings = Settings()) -> Calibration:
    """
    Identify tool, sensors and observer gain from one recording.

    Parameters
    ----------
    recording : Recording
        Wrench and pose; with accelerometer, Optidrive and phases where there are any. Static
        poses are its phases ``measure``, of one sample or more each.
    settings : Settings

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
    stages = identify_stages(recording, settings)
    measured = noise_of(stages)
    tool, std = stages.tool, np.sqrt(np.diag(stages.tool.covariance))
    calibration = Calibration(
        mass=Estimate(tool.mass, std[0], 'kg'),
        com=Estimate(tool.com, std[4:7], 'm'),
        wrench_bias=Estimate(np.concatenate([tool.force_bias, tool.torque_bias]),
                             std[[1, 2, 3, 7, 8, 9]], 'N, N m'),
        inertia=inertia_of(stages, settings),
        accelerometer=accelerometer_of(stages, settings),
        tool=tool_of(stages),
        noise=measured[0] if measured else None,
        observer=observer_of(measured[0], tool.mass, settings) if measured else None,
        gravity=settings.gravity,
        sensor_frame=require_wrench(recording).frame or 'ft_sensor',
        wrench_sign=settings.wrench_sign,
        source={'recording': recording.source, **settings.source})
    return replace(calibration, quality=quality_of(stages, calibration, settings))


def identify_stages(recording: Recording, settings: Settings) -> Stages:
    """
    Run every stage; :func:`identify` makes the calibration of them.

    Parameters
    ----------
    recording : Recording
    settings : Settings

    Returns
    -------
    Stages

    Raises
    ------
    DataError, UnobservableError
        As :func:`identify`.
    """
    recording, removed = clean(recording)
    wrench = require_wrench(recording)
    poses = static_poses(recording)
    refuse_stuck(wrench, recording.accelerometer, poses)
    grid = _lay_grid(recording, poses, settings)
    noise = None
    if grid is not None:
        noise = autocovariance(_windows(Averager(wrench.t, wrench.values), grid))
    statics = _read_statics(recording, poses, settings, grid, noise)
    statics, tool, ring = _tool(recording, poses, statics, noise, grid, settings)
    accelerometer = inertia = late = None
    if grid is not None and noise is not None:
        accelerometer, inertia, late = _in_motion(recording, grid, noise, tool, ring, settings)
    elif recording.accelerometer is not None:
        volts = np.stack([window_mean(recording.accelerometer, p.start, p.end, 'accelerometer')
                          for p in poses])
        accelerometer = identify_static_accelerometer(
            statics.gravity, volts, None, settings.thresholds.condition)
    return Stages(recording, removed, poses, statics, tool, stiffness_from_sag(statics, tool),
                  ring, accelerometer, inertia, late)


def _lay_grid(recording: Recording, poses: list[StaticPose], settings: Settings) -> Grid | None:
    """Blocks over the recording; None where the poses are too short to show any noise."""
    streams = [s for s in (recording.wrench, recording.accelerometer, recording.optidrive,
                           recording.pose) if s is not None and len(s) > 1]
    if len(streams) < 2 or len(recording.wrench or ()) < 20:
        return None
    length = block_length(settings.block, *(float(np.median(np.diff(s.t))) for s in streams))
    assert recording.wrench is not None
    windows = [(p.start, p.end) for p in poses]
    grid = make_grid(recording.wrench.t, length, windows, recording.phases)
    long_enough = [i for i in range(len(poses)) if (grid.still == i).sum() > 2 * LAGS]
    return grid if long_enough else None


def _windows(averager: Averager, grid: Grid) -> list[Array]:
    return [averager.means(grid.starts[grid.still == i], grid.length)
            for i in range(grid.still.max() + 1) if (grid.still == i).any()]


def _read_statics(recording: Recording, poses: list[StaticPose], settings: Settings,
                  grid: Grid | None, noise: Autocovariance | None) -> Statics:
    """Means of the static poses, [Gamez2005] Eq. 11 and 14 in all six axes, and their noise."""
    wrench = require_wrench(recording)
    means = np.stack([window_mean(wrench, p.start, p.end, 'wrench') for p in poses])
    gravity = np.stack([p.gravity(settings.gravity) for p in poses])
    spans = np.array([p.end - p.start for p in poses])
    covariance = slide = None
    if grid is not None and noise is not None:
        covariance = noise.total * (grid.length / spans)[:, None, None]
    variance = np.zeros(len(poses))
    optidrive = recording.optidrive
    if settings.tool_compliance == 'no' or optidrive is None or not len(optidrive):
        return Statics(gravity, means, covariance, np.zeros(len(poses)), variance)
    slide = np.array([window_mean(optidrive, p.start, p.end, 'optidrive')[0] for p in poses])
    if grid is not None:
        total = autocovariance(_windows(Averager(optidrive.t, optidrive.values), grid)).total
        variance = float(total[0, 0]) * grid.length / spans
    return Statics(gravity, means, covariance, slide, variance)


def _tool(recording: Recording, poses: list[StaticPose], statics: Statics,
          noise: Autocovariance | None, grid: Grid | None, settings: Settings
          ) -> tuple[Statics, ToolFit, RingFit | None]:
    """Statics and ringing; where nothing measures the slide, one needs the other."""
    condition = settings.thresholds.condition
    observed = statics.slide is not None and bool(statics.slide.any())
    tool = identify_tool(statics, condition)
    ring = None
    if grid is not None and noise is not None and settings.tool_compliance != 'no':
        sag = stiffness_from_sag(statics, tool) if observed else None
        density = noise.total[0, 0] * grid.length
        slide_density = 1.0
        if observed:
            optidrive = recording.optidrive
            assert optidrive is not None
            slide_density = float(statics.slide_variance[0] * (poses[0].end - poses[0].start))
        ring = stiffness_and_damping(
            rings(_phase_spans(recording, 'step'), require_wrench(recording),
                  recording.optidrive if observed else None, recording.pose, recording.target),
            tool.mass, density, slide_density, (sag.stiffness, sag.variance) if sag else None)
    if observed or (ring is None and settings.tool_compliance != 'yes'):
        return statics, tool, ring
    sag_value = None
    if ring is not None:
        value = tool.mass**2 / ring.stiffness
        relative = ring.covariance[0, 0] / ring.stiffness**2
        sag_value = (value, value**2 * relative)
    statics = statics._replace(slide=None, sag=sag_value)
    return statics, identify_tool(statics, condition), ring


def _phase_spans(recording: Recording, name: str) -> list[tuple[float, float]]:
    """Stretches of consecutive phases of that name."""
    spans: list[tuple[float, float]] = []
    for phase in recording.phases:
        if phase.name != name:
            continue
        if spans and abs(spans[-1][1] - phase.start) < 1e-6:
            spans[-1] = (spans[-1][0], phase.end)
        else:
            spans.append((phase.start, phase.end))
    return spans


def _in_motion(recording: Recording, grid: Grid, noise: Autocovariance, tool: ToolFit,
               ring: RingFit | None, settings: Settings
               ) -> tuple[AccelerometerFit | None, InertiaFit | None,
                         tuple[float, float] | None]:
    """Identify what the motion between the poses shows: accelerometer, inertia, pose delay."""
    wrench = require_wrench(recording)
    assert recording.pose is not None
    blocks = Averager(wrench.t, wrench.values).means(grid.starts, grid.length)
    slide = _slide(recording, grid, blocks, tool, ring)
    motions = Motions(recording.pose, grid)
    late = pose_delay(motions, blocks[:, :3], slide, grid, tool.mass, tool.force_bias, tool.com,
                      settings.gravity, settings.largest_delay)
    turn = motions.turning(late[0] if late else 0.0)
    theta = np.concatenate([[tool.mass], tool.force_bias, tool.com, tool.torque_bias])
    inertia = identify_inertia(blocks, slide, turn.omega, turn.alpha, grid.free, grid.still,
                               theta, tool.covariance)
    stream = recording.accelerometer
    if stream is None or len(stream) < 20:
        return None, inertia, late
    motion = Motion(
        grid.length, -settings.gravity * turn.R_base_sensor[:, 2], blocks[:, :3], turn.lever,
        grid.still, grid.free, Autocovariance(noise.lags[:, :3, :3], noise.blocks))
    volts = Averager(stream.t, stream.values)
    place = settings.accelerometer_position
    fit = identify_accelerometer(
        motion, lambda delay: volts.means(grid.starts + delay, grid.length),
        ToolPart(tool.mass, tool.force_bias, tool.com, tool.covariance[:7, :7]),
        settings.coupling, settings.cutoff, None if place is None else np.array(place),
        settings.largest_delay)
    return fit, inertia, late


def _slide(recording: Recording, grid: Grid, blocks: Array, tool: ToolFit,
           ring: RingFit | None) -> Array:
    """Displacement of the tool in each block [m]: measured, by the spring, or none."""
    optidrive: Stream | None = recording.optidrive
    if optidrive is not None and len(optidrive) > 1:
        delay = ring.slide_delay if ring else 0.0
        means = Averager(optidrive.t, optidrive.values).means(grid.starts + delay, grid.length)
        return np.asarray(means[:, 0])
    if ring is not None:
        return np.asarray((blocks[:, 0] - tool.force_bias[0]) / ring.stiffness)
    return np.zeros(len(blocks))
