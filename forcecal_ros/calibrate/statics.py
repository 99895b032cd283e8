"""What the static poses, the tool's sag and its ringing say about the tool, put together."""

from typing import NamedTuple

from forcecal_ros.calibrate.means import GriddedRecording, window_mean, windows_of
from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.calibrate.requirements import require_wrench
from forcecal_ros.calibrate.ringing import RingFit, rings, stiffness_and_damping
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.static_readings import Statics
from forcecal_ros.checks.signals import resolution
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_windows
from forcecal_ros.core.noise.white import rounding_variance
from forcecal_ros.core.streams import phase_spans, Recording, Stream
from forcecal_ros.core.time_grid import Averager
import numpy as np


class Sag(NamedTuple):
    """
    Compliance as the static poses show it, s = (m / k) g_x + zero.

    Attributes
    ----------
    stiffness, variance : float
        [N/m] and its square; the mass' uncertainty left out.
    zero : float
        What the Optidrive reads without load [m].
    """

    stiffness: float
    variance: float
    zero: float


def stiffness_from_sag(statics: Statics, mass: float) -> Sag | None:
    """
    Stiffness of the tool from how far it sags in each pose, [Gamez2005] Eq. 29 at rest.

    Parameters
    ----------
    statics : Statics
        With a slide.
    mass : float
        [kg]

    Returns
    -------
    Sag or None
        None where the poses hardly load x.

    Raises
    ------
    DataError
        The tool slides against its load.
    """
    slide = statics.slide_at_rest
    assert slide is not None
    weight = mass * statics.gravity[:, 0]
    rows = np.stack([weight, np.ones(len(weight))], axis=1)
    if np.ptp(weight) < 0.05 * mass * np.linalg.norm(statics.gravity[0]):
        return None
    (compliance, zero), *_ = np.linalg.lstsq(rows, slide, rcond=None)
    bread = np.linalg.inv(rows.T @ rows)
    slope = (bread @ (rows.T * statics.slide_variance) @ rows @ bread)[0, 0]
    if compliance**2 < 25 * slope:
        return None
    if compliance < 0:
        raise DataError('optidrive: the tool slides against its load '
                        f'({1e3 * compliance:.3g} mm for each N); turn the sign of the optidrive')
    return Sag(float(1 / compliance), float(slope / compliance**4), float(zero))


def read_statics(recording: Recording, poses: list[StaticPose], settings: IdentificationSettings,
                 gridded: GriddedRecording | None) -> Statics:
    """
    Take the means of the static poses, [Gamez2005] Eq. 11 and Eq. 14 in all six axes.

    Parameters
    ----------
    gridded : GriddedRecording or None
        Where the noise is measured; None: the poses are single samples.
    """
    wrench, optidrive = require_wrench(recording), recording.optidrive
    means = np.stack([window_mean(wrench, p.start, p.end, 'wrench') for p in poses])
    gravity = np.stack([p.gravity(settings.gravity) for p in poses])
    spans = np.array([p.end - p.start for p in poses])
    covariance = None
    if gridded is not None:
        covariance = gridded.noise.at_least_white * (gridded.grid.length / spans)[:, None, None]
        covariance = covariance + np.diag(_rounding(wrench, poses))
    rigid = np.zeros(len(poses))
    if settings.tool_compliance == 'no' or optidrive is None or not len(optidrive):
        return Statics(gravity, means, covariance, rigid, rigid)
    slide = np.array([window_mean(optidrive, p.start, p.end, 'optidrive')[0] for p in poses])
    variance = rigid
    if gridded is not None:
        blocks = windows_of(Averager(optidrive.t, optidrive.values), gridded.grid)
        noise = noise_of_windows(blocks, gridded.ringing)
        density = noise.at_least_white[0, 0] * gridded.grid.length
        variance = float(density) / spans
    return Statics(gravity, means, covariance, slide, variance)


def _rounding(wrench: Stream, poses: list[StaticPose]) -> Array:
    """Variance that rounding to steps leaves in the mean of a pose, by channel, shape (6,)."""
    parts = [wrench.between(pose.start, pose.end).values for pose in poses]
    within = np.mean([part.var(axis=0) for part in parts if len(part) > 1], axis=0)
    return np.array([rounding_variance(resolution(values), float(variance))
                     for values, variance in zip(wrench.values.T, within)])


def ring_of(recording: Recording, poses: list[StaticPose], statics: Statics, mass: float,
            sag: Sag | None, gridded: GriddedRecording) -> RingFit | None:
    """
    Fit what rings after the step.

    Parameters
    ----------
    mass : float
        [kg]
    sag : Sag or None
        Stiffness as the static poses show it.

    Returns
    -------
    RingFit or None
        None where nothing rang.
    """
    optidrive, density = None, 1.0
    if slides(statics):
        optidrive = recording.optidrive
        density = float(statics.slide_variance[0]) * (poses[0].end - poses[0].start)
    ringing = rings(phase_spans(recording.phases, ('step',)), require_wrench(recording), optidrive,
                    recording.pose, recording.target)
    return stiffness_and_damping(
        ringing, mass, gridded.noise.at_least_white[0, 0] * gridded.grid.length, density,
        (sag.stiffness, sag.variance) if sag else None)


def slides(statics: Statics) -> bool:
    """Whether an Optidrive shows the tool's slide."""
    return statics.slide is not None and bool(statics.slide.any())


def with_ring(statics: Statics, mass: float, ring: RingFit | None,
              settings: IdentificationSettings) -> Statics:
    """
    Say by the ringing how far the tool slides where no Optidrive does.

    Parameters
    ----------
    mass : float
        [kg]

    Returns
    -------
    Statics
        As it was for a rigid tool or with an Optidrive.
    """
    if slides(statics) or (ring is None and settings.tool_compliance != 'yes'):
        return statics
    sag = None
    if ring is not None:
        value = mass**2 / ring.stiffness
        sag = (value, value**2 * ring.covariance[0, 0] / ring.stiffness**2)
    return statics._replace(slide=None, sag=sag)


def sag_of(statics: Statics, mass: float) -> Sag | None:
    """Stiffness from the static slide; None without an Optidrive that moves."""
    return stiffness_from_sag(statics, mass) if slides(statics) else None
