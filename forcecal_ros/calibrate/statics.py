"""What static poses and ringing show of a tool that is displaced along x of ft_sensor."""

from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.calibrate.accelerometer import lowpassed
from forcecal_ros.calibrate.joint import AT_REST, JointFit, smooth
from forcecal_ros.calibrate.poses import require_wrench, StaticPose, window_mean
from forcecal_ros.calibrate.ringing import RingFit, rings, stiffness_and_damping
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.tool import design_of, Statics
from forcecal_ros.checks.signals import resolution
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.white import rounding_variance, white_covariance
from forcecal_ros.core.rigid_body import rate_of_change
from forcecal_ros.core.streams import phase_spans, Recording, Stream
from forcecal_ros.core.time_grid import Averager
import numpy as np

MIN_SAG = 0.05
"""Least variation of the weight along x, of the weight, that shows a stiffness."""

SAG_BLOCKS = 12
"""Blocks of the rows at rest for the standard error of a stiffness: 0.5 s each in the sequence,
five times as long as the low-pass correlates them."""

SAG_SIGMA = 5.0
"""Standard errors by which a compliance differs from zero."""


class Sag(NamedTuple):
    """
    Compliance at rest, F_x = k (s - zero) + d ds/dt + bias.

    Attributes
    ----------
    stiffness, variance : float
        [N/m] and its square.
    zero : float
        What the Optidrive reads without load [m].
    """

    stiffness: float
    variance: float
    zero: float


def sag_of(fit: JointFit, wrench: Stream) -> Sag | None:
    """
    Fit the stiffness of a tool to force and displacement along x at rest, [Gamez2005] Eq. 29.

    Returns
    -------
    Sag or None
        None without an Optidrive, or where the poses hardly load x.

    Raises
    ------
    DataError
        The tool slides against its load.
    """
    blocks = fit.blocks
    rest = blocks.rows[blocks.groups == 0]
    if blocks.displacement is None or not blocks.displacement.any() or len(rest) < 10:
        return None
    weight = fit.theta[0] * blocks.motion.apparent_gravity[rest, 0]
    if np.ptp(weight) < MIN_SAG * fit.theta[0] * blocks.gravity:
        return None
    s = blocks.displacement[:, None]
    force = Averager(wrench.t, wrench.values[:, :1]).interpolated(
        blocks.starts + fit.delay, blocks.length)
    rate = rate_of_change(s, blocks.length)
    columns = smooth(np.concatenate([s, rate, np.ones_like(s)], axis=1))
    found = robust_fit(columns[rest, None, :], smooth(force)[rest], blocks=SAG_BLOCKS, channels=1)
    stiffness, variance = float(found.theta[0]), float(found.covariance[0, 0])
    if stiffness**2 < SAG_SIGMA**2 * variance:
        return None
    if stiffness < 0:
        raise DataError('optidrive: the tool slides against its load '
                        f'({1e3 / stiffness:.3g} mm for each N); turn the sign of the optidrive')
    zero = (fit.theta[10] - found.theta[2]) / stiffness
    return Sag(stiffness, variance, float(zero))


def read_statics(recording: Recording, poses: list[StaticPose], settings: IdentificationSettings
                 ) -> Statics:
    """
    Take the means of the static poses, [Gamez2005] Eq. 11 and Eq. 14 in all six axes.

    Returns
    -------
    Statics
        Without covariance.
    """
    wrench, optidrive = require_wrench(recording), settings.optidrive_of(recording)
    means = np.stack([window_mean(wrench, p.start, p.end, 'wrench') for p in poses])
    gravity, rigid = np.stack([p.gravity(settings.gravity) for p in poses]), np.zeros(len(poses))
    if optidrive is None or not len(optidrive):
        return Statics(gravity, means, None, rigid, rigid)
    slide = np.array([window_mean(optidrive, p.start, p.end, 'optidrive')[0] for p in poses])
    parts = [part for p in poses if len(part := optidrive.between(p.start, p.end).values) > 2]
    variance = rigid
    if parts:
        density = max(float(white_covariance(part, 1)[0, 0]) for part in parts) / optidrive.rate
        variance = density / np.array([p.end - p.start for p in poses])
    return Statics(gravity, means, None, slide, variance)


def with_noise(statics: Statics, fit: JointFit, recording: Recording, poses: list[StaticPose]
               ) -> Statics:
    """Give static poses their covariance, and take off what the tool still moves in them."""
    assert fit.noise is not None
    spans = np.array([p.end - p.start for p in poses])
    covariance = fit.noise.at_least_white * (fit.blocks.length / spans)[:, None, None]
    covariance = covariance + np.diag(_rounding(require_wrench(recording), poses))
    left = np.stack([fit.residual[fit.blocks.pose == i].mean(axis=0) for i in range(len(poses))])
    wrench = (design_of(statics)[0] @ fit.theta[AT_REST]).reshape(-1, 6) + left
    return statics._replace(covariance=covariance, wrench=wrench)


def _rounding(wrench: Stream, poses: list[StaticPose]) -> Array:
    """Variance that rounding to steps leaves in the mean of a pose, by channel, shape (6,)."""
    parts = [wrench.between(pose.start, pose.end).values for pose in poses]
    within = np.mean([part.var(axis=0) for part in parts if len(part) > 1], axis=0)
    return np.array([rounding_variance(resolution(values), float(variance))
                     for values, variance in zip(wrench.values.T, within)])


def ring_of(recording: Recording, poses: list[StaticPose], statics: Statics, fit: JointFit,
            sag: Sag | None) -> RingFit | None:
    """Fit what rings after the step; None where nothing rang."""
    assert fit.noise is not None
    ringing = rings(phase_spans(recording.phases, ('step',)), require_wrench(recording),
                    recording.optidrive if statics.slide.any() else None, recording.pose,
                    recording.target)
    return stiffness_and_damping(
        ringing, float(fit.theta[0]), float(fit.noise.at_least_white[0, 0]) * fit.blocks.length,
        float(statics.slide_variance[0] * (poses[0].end - poses[0].start)),
        (sag.stiffness, sag.variance) if sag else None)


def displacement(recording: Recording, ring: RingFit, fit: JointFit) -> Stream:
    """
    Return the displacement of the tool by the pose's clock: measured, or by the spring.

    k s + d ds/dt = F: the displacement follows the force through a first-order low-pass.
    """
    measured, wrench = recording.optidrive, require_wrench(recording)
    if measured is not None and len(measured) > 1:
        return replace(measured, t=measured.t - ring.slide_delay - fit.delay)
    period = float(np.median(np.diff(wrench.t)))
    t = np.arange(wrench.t[0], wrench.t[-1], period)
    s = (np.interp(t, wrench.t, wrench.values[:, 0]) - fit.theta[10]) / ring.stiffness
    corner = ring.stiffness / (2 * np.pi * ring.damping)
    return Stream(t - fit.delay, (s[0] + lowpassed(s - s[0], period, corner))[:, None])
