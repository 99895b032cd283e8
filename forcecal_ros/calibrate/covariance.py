"""Step 9 of the procedure: Q and R of [Gamez2005] Eq. 6, for which the paper has no recipe.

Ours:

- The states are [x, dx/dt], the measurements y = [x, dx/dt, d2x/dt2] of the tool along x of
  ft_sensor. x is the measured position of ft_sensor plus the Optidrive's displacement; dx/dt its
  backward difference over one period T of the pose, (x_k - x_(k-1)) / T; d2x/dt2 the
  accelerometer's specific force along x, averaged over that period.
- R is the sample covariance of y while the robot stands, all nine elements of it, times T: Eq. 6
  is continuous, and white noise of variance r per sample has the density r T. The difference
  makes x and dx/dt correlated (r_x / T); what the sample leaves between d2x/dt2 and the others
  is what gives the paper's k13 other than 0.
- Q is the noise of the force through the input matrix, B var(u) T_u B^T with B = [0, 1/m] and
  T_u the period of the wrench: u enters Eq. 5 as measured, and nothing else drives the tool.

Differences of white noise are not white, so K is not optimal in the strict sense; it is what
Eq. 7 gives.
"""

from typing import NamedTuple

from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_windows
from forcecal_ros.core.streams import PoseStream, Stream
from forcecal_ros.core.time_grid import Averager
import numpy as np


class SampleCovariance(NamedTuple):
    """Covariance of samples at standstill, its standard errors, samples, their rate [Hz]."""

    value: Array
    std: Array
    samples: int
    rate: float

    @property
    def density(self) -> Array:
        """Per-sample covariance times the period, as the continuous Eq. 6 wants it."""
        return np.asarray(self.value / self.rate)

    @property
    def density_std(self) -> Array:
        """Standard errors of :attr:`density`."""
        return np.asarray(self.std / self.rate)


def sample_covariance(windows: list[Array], rate: float) -> SampleCovariance | None:
    """
    Covariance of samples at standstill, each window's mean taken off.

    No correlation in time enters: Eq. 6 takes the noise of samples for white.

    Parameters
    ----------
    windows : list of ndarray, shape (n_i, k)
    rate : float
        Of the samples [Hz].

    Returns
    -------
    SampleCovariance or None
        None where there are too few samples.
    """
    windows = [w[np.isfinite(w).all(1)] for w in windows]
    windows = [w for w in windows if len(w) > 1]
    n = sum(len(w) - 1 for w in windows)
    if n < 30:
        return None
    centred = np.concatenate([w - w.mean(axis=0) for w in windows])
    value = centred.T @ centred / n
    variances = np.diag(value)
    return SampleCovariance(value, np.sqrt((np.outer(variances, variances) + value**2) / n),
                            n, rate)


def stream_covariance(stream: Stream, poses: list[StaticPose]) -> SampleCovariance | None:
    """Covariance of a stream's samples in the static poses."""
    return sample_covariance([np.asarray(stream.between(p.start, p.end).values) for p in poses],
                             stream.rate)


def slow_density(stream: Stream, poses: list[StaticPose]) -> Array | None:
    """
    Spectral density at low frequencies of a stream's noise in the static poses, shape (k, k).

    The long-run covariance over the rate: that of white noise where no lag stands out. None where
    no pose was held long enough.
    """
    windows = [np.asarray(stream.between(p.start, p.end).values) for p in poses]
    try:
        return noise_of_windows(windows).at_least_white / stream.rate
    except DataError:
        return None


def measurement_covariance(poses: list[StaticPose], pose: PoseStream, optidrive: Stream | None,
                           specific_force: Stream) -> SampleCovariance | None:
    """
    Sample covariance of y = [x, dx/dt, d2x/dt2]; R of [Gamez2005] Eq. 6 is its density.

    Parameters
    ----------
    pose : PoseStream
        With positions.
    specific_force : Stream
        In ft_sensor [m/s^2].

    Returns
    -------
    SampleCovariance or None
        None where the poses are too short.
    """
    if not pose.has_position or len(pose) < 3 or len(specific_force) < 3:
        return None
    period = float(np.median(np.diff(pose.t)))
    along_x = Averager(specific_force.t, specific_force.values[:, :1])
    windows = []
    for still in poses:
        cut = pose.between(still.start, still.end)
        if len(cut) < 3:
            continue
        x = cut.position @ still.R_base_sensor[:, 0]
        if optidrive is not None:
            x = x + optidrive.at(cut.t)[:, 0]
        whole = np.abs(np.diff(cut.t) - period) < period / 2
        y = np.column_stack([x[1:], np.diff(x) / period,
                             along_x.means(cut.t[1:] - period, period)])
        windows.append(y[whole])
    return sample_covariance(windows, 1 / period)


def process_covariance(force_variance: float, rate: float, mass: float) -> Array:
    """
    Q of [Gamez2005] Eq. 6: the force's noise through B = [0, 1/m].

    Parameters
    ----------
    force_variance : float
        Per sample, along x [N^2].
    rate : float
        Of the wrench [Hz].
    mass : float
        [kg]

    Returns
    -------
    ndarray, shape (2, 2)
        [(m, m/s)^2 s], continuous: per-sample variance times the period.
    """
    B = np.array([0.0, 1 / mass])
    return np.asarray(np.outer(B, B) * force_variance / rate)
