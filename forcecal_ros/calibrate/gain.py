"""The paper's observer: its matrices, covariances at rest, and its gain, steps 9 to 11.

Model, [Gamez2005] Eq. 5 with xi = [x, dx/dt], u the force of the robot on the tool and F that
of the tool on its environment:

    d xi/dt = A xi + B (u - F)
    y = C xi + D_u u + D_F F,    y = [x, dx/dt, d2x/dt2],    d2x/dt2 = (u - F) / m

Observer d xi^/dt = A xi^ + B u + K (y - C xi^ - D_u u), whose error xi~ = xi - xi^ obeys

    d xi~/dt = (A - K C) xi~ - (B + K D_F) F                               [Gamez2005] Eq. 4

(in print y stands for y - C xi). The third row of C is zero, so the third column of K cannot
move A - K C: setting k23 = 1 leaves the stability alone, and with B + K D_F = [-k13, 1 - k23] / m
it takes F out of the second equation.

Q and R of Eq. 6, for which the paper has no recipe:

- x is the measured position of ft_sensor along x plus the Optidrive's displacement; dx/dt its
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

from forcecal_ros.calibrate.poses import StaticPose, values_in
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_windows
from forcecal_ros.core.streams import PoseStream, Stream
from forcecal_ros.core.time_grid import Averager
import numpy as np
from scipy.linalg import solve_continuous_are


class ObserverModel(NamedTuple):
    """Matrices of [Gamez2005] Eq. 5; shapes (2, 2), (2,), (3, 2), (3,), (3,)."""

    A: Array
    B: Array
    C: Array
    D_u: Array
    D_F: Array


def observer_model(mass: float) -> ObserverModel:
    """
    Tool dynamics along x, [Gamez2005] Eq. 5.

    Parameters
    ----------
    mass : float
        [kg]
    """
    A, C = np.eye(2, k=1), np.eye(3, 2)
    third = np.array([0.0, 0.0, 1 / mass])
    return ObserverModel(A, np.array([0.0, 1 / mass]), C, third, -third)


def error_dynamics(model: ObserverModel, K: Array) -> tuple[Array, Array]:
    """
    Matrices of the observer's error, [Gamez2005] Eq. 4.

    Parameters
    ----------
    K : ndarray, shape (2, 3)

    Returns
    -------
    tuple of ndarray, shapes (2, 2), (2,)
        d xi~/dt = first xi~ + second F.
    """
    return model.A - K @ model.C, -(model.B + K @ model.D_F)


def riccati_gain(A: Array, C: Array, Q: Array, R: Array) -> Array:
    """
    Gain K = P C^T R^-1 with P A^T + A P - P C^T R^-1 C P + Q = 0.

    [Gamez2005] Eq. 18 and [Gamez2005] Eq. 19 (in the text before: [Gamez2005] Eq. 7 and
    [Gamez2005] Eq. 8).

    Parameters
    ----------
    A, C : ndarray, shapes (n, n), (m, n)
    Q, R : ndarray, shapes (n, n), (m, m)
        Continuous covariances of Eq. 6.

    Returns
    -------
    ndarray, shape (n, m)

    Raises
    ------
    UnobservableError
        R is singular, or Q and R lie too far apart.
    """
    scale = np.sqrt(np.diag(R))
    if not (scale > 0).all() or np.linalg.cond(R / np.outer(scale, scale)) > 1e12:
        raise UnobservableError('R is singular: a signal has no noise, or two signals are the '
                                'same; record the sensors at full resolution')
    # measurements in units of their own noise: metres and m/s^2 lie ten decades apart
    c, r = C / scale[:, np.newaxis], R / np.outer(scale, scale)
    try:
        K = np.linalg.solve(r, c @ solve_continuous_are(A.T, c.T, Q, r)).T
    except ValueError as error:  # LinAlgError is one; reordering the pencil raises others
        raise UnobservableError(f'no stationary gain for these covariances ({error}): they differ '
                                'by too many decades; check the units') from error
    if not np.isfinite(K).all():
        raise UnobservableError('no finite gain for these covariances; check their units')
    return K / scale


def pole_gain(A: Array, C: Array, poles: tuple[float, ...]) -> Array:
    """
    Gain that puts the poles of A - K C where they are wanted, the paper's other way.

    Parameters
    ----------
    A, C : ndarray, shapes (2, 2), (3, 2)
    poles : tuple of float
        [1/s]

    Returns
    -------
    ndarray, shape (2, 3)
        Its third column is zero: that one moves no pole.
    """
    from scipy.signal import place_poles  # takes a second, and the other way needs none of it

    K = np.zeros((len(A), len(C)))
    seen = np.abs(C).any(axis=1)
    K[:, seen] = place_poles(A.T, C[seen].T, poles).gain_matrix.T
    return K


def with_unit_k23(K: Array) -> Array:
    """Return K with k23 = 1, step 11 of the procedure: Newton's law in Eq. 3."""
    K = np.array(K, dtype=float)
    K[1, 2] = 1.0
    return K


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
    return sample_covariance(values_in(stream, poses), stream.rate)


def slow_density(stream: Stream, poses: list[StaticPose]) -> Array | None:
    """
    Spectral density at low frequencies of a stream's noise in the static poses, shape (k, k).

    The long-run covariance over the rate: that of white noise where no lag stands out. None where
    no pose was held long enough.
    """
    try:
        return noise_of_windows(values_in(stream, poses)).at_least_white / stream.rate
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
