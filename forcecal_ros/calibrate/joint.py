"""
Tool, accelerometer and delays from any motion, by one robust fit each.

Wrench and regressor pass the same low-pass, so that what a derivative of the pose adds to the
noise is small where the motion is. Rows at rest and rows in motion have a scale each: a hand that
guides the tool spoils the motion alone.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from forcecal_ros.core.errors import above, below, DataError, UnobservableError
from forcecal_ros.core.estimation import robust_fit, RobustFit
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.noise.autocovariance import Autocovariance, noise_of_windows, SHORTEST
from forcecal_ros.core.rigid_body import body_motion, BodyMotion, INERTIAL, regressor, sliding
from forcecal_ros.core.streams import Phase, PoseStream, Stream
from forcecal_ros.core.time_grid import Averager, labelled
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter1d

STEP_S, LOWPASS_S = 0.01, 0.03
"""Grid, and standard deviation of the low-pass that wrench and regressor pass [s]."""

LOWPASS = LOWPASS_S / STEP_S
"""The same in steps: slower recordings are smoothed over as many samples."""

THINNING = 3
"""Every third row is fitted, one a `LOWPASS_S`: of what the low-pass leaves 0.7 % is above half
their rate."""

MIN_GRAVITY_SPREAD = 0.02
"""Least RMS variation of g - a in a second direction of ft_sensor, of gravity: 1.1
deg of rotation about a second axis, of which errors of the pose by 1 mrad are 5 %."""

MAX_UNEXPLAINED = 0.25
"""Largest share of the variation of a weight in the residual: a wrench with one mirrored axis has
0.3, a free tool 0.01. Where positions are missing, accelerations count as residual: 1."""

SUSPECT_UNEXPLAINED = 0.1
"""Share of the weight's variation in the residual above which estimates from motion are suspect:
axes that are rotated by 6 deg have as much."""

INFLATION = 2 * np.sqrt(np.pi) * LOWPASS / THINNING
"""Variance of the mean of n low-passed rows of white noise, times n, over that of one."""

ITERATIONS = 6
"""Steps of fits that are linear in all but delay and place: the third is exact to 1e-3 of a
standard error."""

AT_REST = [0, 10, 11, 12, 1, 2, 3, 13, 14, 15]
"""Parameters that static poses show: mass, force bias, first moments, torque bias."""


class Blocks(NamedTuple):
    """
    Motion of ft_sensor in blocks of equal length, and which of them are fitted.

    Attributes
    ----------
    starts : ndarray, shape (n,)
        [s]
    length : float
        [s]
    motion : BodyMotion
        Of the tool's origin, its displacement included.
    halves : tuple of BodyMotion
        The same by the even and by the odd poses.
    displacement : ndarray, shape (n,), or None
        Of the tool along x [m].
    still : ndarray of int, shape (n,)
        Which static pose a block lies in; -1 for none.
    rows : ndarray of int, shape (m,)
        Blocks that are fitted.
    pose : ndarray of int, shape (m,)
        Which static pose a row lies in with all that the low-pass takes in; -1 for none.
    sampled : ndarray of bool, shape (m,)
        Rows in which the low-pass takes in no gap of a stream: a straight line across it is no
        measurement, which a robust fit outweighs, but a look at single rows does not.
    gravity : float
        Magnitude [m/s^2].
    """

    starts: Array
    length: float
    motion: BodyMotion
    halves: tuple[BodyMotion, BodyMotion]
    displacement: Array | None
    still: NDArray[np.intp]
    rows: NDArray[np.intp]
    pose: NDArray[np.intp]
    sampled: NDArray[np.bool_]
    gravity: float

    @property
    def groups(self) -> NDArray[np.intp]:
        """Of the rows: 0 at rest, 1 in motion."""
        return (self.pose < 0).astype(np.intp)

    @property
    def every(self) -> int:
        """Of so many rows one suffices to choose between delays, or between corners."""
        # rows at most by which the nearest of the delays that are tried first is found
        most_rows = 1000
        return 2 + len(self.rows) // most_rows

    @property
    def apparent_gravity(self) -> Array:
        """Of the rows, low-passed, as a share of gravity, (m, 3)."""
        return smooth(self.motion.apparent_gravity)[self.rows] / self.gravity

    @property
    def times(self) -> Array:
        """Of the rows, in the middle of their blocks [s]."""
        return np.asarray(self.starts[self.rows] + self.length / 2)

    def noise_of(self, derived: Callable[[BodyMotion], Array]) -> Array:
        """
        Return a draw of the pose's noise in what is derived from the motion, low-passed.

        Even and odd poses have independent noise: half of the difference of what is derived from
        each has the covariance of the noise in what is derived from all.
        """
        even, odd = (derived(motion) for motion in self.halves)
        return smooth(odd - even) / 2


def row_noise(noise: Autocovariance) -> Array:
    """Return the standard deviation of low-passed rows (k,) from the noise of blocks."""
    return np.asarray(np.sqrt(
        np.diag(noise.at_least_white) / (2 * np.sqrt(np.pi) * LOWPASS)))


def lever(motion: BodyMotion) -> Array:
    """Return the acceleration of a place by the place, (n, 3, 3) [1/s^2]."""
    W = skew(motion.omega)
    return np.asarray(skew(motion.alpha) + W @ W)


def smooth(values: Array) -> Array:
    """Low-pass consecutive blocks (n, ...)."""
    return np.asarray(gaussian_filter1d(values, LOWPASS, axis=0))


def principal_spread(vectors: Array) -> tuple[Array, Array]:
    """Return the RMS variation (3,) of vectors (n, 3), and its principal directions (3, 3)."""
    padded = np.vstack([vectors - vectors.mean(axis=0), np.zeros((3, 3))])
    _, size, directions = np.linalg.svd(padded, full_matrices=False)
    return size / np.sqrt(len(vectors)), directions


def blocks_of(stream: Stream, pose: PoseStream, gravity: Array, largest_delay: float = 0.05,
              optidrive: Stream | None = None, windows: Sequence[tuple[float, float]] = (),
              phases: tuple[Phase, ...] = ()) -> Blocks:
    """
    Lay blocks over the time in which a stream overlaps the pose.

    Parameters
    ----------
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    largest_delay : float
        Of the stream, either way [s].
    optidrive : Stream or None
        Displacement of the tool along x [m].
    windows : sequence of tuple of float
        Start and end of each static pose [s].
    phases : tuple of Phase
        Of a sequencer: blocks in which the tool may touch something are not fitted.
    """
    periods = [float(np.median(np.diff(one.t))) for one in (pose, stream)]
    step = max(STEP_S, *periods)
    first, last = max(stream.t[0], pose.t[0]), min(stream.t[-1], pose.t[-1])
    starts = np.arange(first + largest_delay, last - largest_delay - step, step)
    if len(starts) <= 4:
        starts = np.empty(0)
    motions = [body_motion(pose.rows(part), starts, step, gravity)
               for part in (slice(None), slice(0, None, 2), slice(1, None, 2))]
    slide = None
    streams: list[tuple[Stream | PoseStream, float]] = [(pose, 0.0), (stream, largest_delay)]
    if optidrive is not None and len(optidrive) > 1 and len(starts):
        slide = Averager(optidrive.t, optidrive.values).interpolated(starts, step)[:, 0]
        motions = [sliding(motion, slide, step) for motion in motions]
        streams.append((optidrive, 0.0))
    still, free = labelled(starts, step, list(windows), phases)
    sampled, bridged = free | (still >= 0), free | (still >= 0)
    for one, late in streams:
        gaps = np.diff(one.t)
        for i in np.flatnonzero(gaps > max(2.5 * float(np.median(gaps)), step)):
            beside = (starts + step <= one.t[i] - late) | (starts >= one.t[i + 1] + late)
            sampled &= beside
            if gaps[i] > LOWPASS * step:  # straight lines do for those that are shorter
                bridged &= beside
    # steps to either side that are taken in by the low-pass, four standard deviations, and by two
    # derivatives of the pose
    reach = int(4 * LOWPASS) + 4
    rows = np.flatnonzero(binary_erosion(bridged, iterations=reach))[::THINNING]
    rests = binary_erosion(still >= 0, iterations=int(3 * LOWPASS))
    pose_of = np.where(rests, still, -1)[rows]
    whole = binary_erosion(sampled, iterations=reach)[rows]
    return Blocks(starts, step, motions[0], (motions[1], motions[2]), slide, still, rows,
                  pose_of, whole, float(np.linalg.norm(gravity)))


class JointFit(NamedTuple):
    """
    Tool, biases and delay of one recording.

    Attributes
    ----------
    theta, covariance : ndarray, shape (18,), (18, 18)
        Mass [kg], first moments [kg m], inertia about the sensor (xx, yy, zz, xy, xz, yz)
        [kg m^2], biases [N, N m], delay of the wrench after the pose [s], and square of the mass
        over a stiffness that nothing measures, or 0 [kg^2 m/N].
    unexplained : float
        Residual force over the variation of the explained force.
    residual : ndarray, shape (m, 6)
        Of the rows of `blocks` [N, N m].
    scale : ndarray, shape (2,)
        Of residual forces [N] and torques [N m], in motion where there is motion.
    noise : Autocovariance or None
        Of blocks at rest; None where the robot never rests.
    """

    theta: Array
    covariance: Array
    unexplained: float
    residual: Array
    scale: Array
    blocks: Blocks
    noise: Autocovariance | None

    @property
    def std(self) -> Array:
        """Standard errors, shape (18,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def com(self) -> Array:
        """Centre of mass, shape (3,) [m]."""
        return np.asarray(self.theta[1:4] / self.theta[0])

    @property
    def com_std(self) -> Array:
        """Its standard errors, shape (3,) [m]."""
        J = np.column_stack([-self.com, np.eye(3)]) / self.theta[0]
        return np.asarray(np.sqrt(np.diag(J @ self.covariance[:4, :4] @ J.T)))

    @property
    def delay(self) -> float:
        """By which the wrench is late after the pose [s]."""
        return float(self.theta[16])

    @property
    def delay_std(self) -> float:
        """Its standard error [s]."""
        return float(self.std[16])


def joint_fit(wrench: Stream, blocks: Blocks, has_position: bool, largest_delay: float = 0.05,
              sag: bool = False) -> JointFit:
    """
    Fit a rigid tool to wrench and pose, moving or at rest.

    Parameters
    ----------
    blocks : Blocks
        Of wrench and pose.
    has_position : bool
        Where the pose has none, accelerations of the sensor are taken as 0 and inertia is not
        fitted.
    largest_delay : float
        Delays up to this are looked for [s].
    sag : bool
        Whether the tool is displaced along x by its weight, with nothing that measures it.
    """
    rows, step = blocks.rows, blocks.length
    whole = smooth(regressor(blocks.motion, blocks.displacement))
    noise = blocks.noise_of(lambda motion: regressor(motion, blocks.displacement))
    if not has_position:
        whole[:, :, 4:] = noise[:, :, 4:] = 0.0
    (X, rates), (noise, noise_rates) = ((Z[rows], -np.gradient(Z, step, axis=0)[rows])
                                        for Z in (whole, noise))
    bias, exact = np.broadcast_to(np.eye(6), (len(rows), 6, 6)), np.zeros((len(rows), 6, 6))
    prior = np.zeros(18)
    # prior of an element of inertia, 1 sigma [kg m^2]: 100 kg with a radius of gyration of 0.3 m
    prior_inertia = 10.0
    prior[4:INERTIAL], prior[16] = prior_inertia**-2, largest_delay**-2
    readings, compliance = Averager(wrench.t, wrench.values), np.zeros((len(X), 6, 1))
    if sag:
        u = blocks.gravity * blocks.apparent_gravity
        compliance[:, 3:, 0] = u[:, :1] * np.cross([1.0, 0.0, 0.0], u)

    def fitted(delay: float, theta: Array | None, every: int = 1) -> RobustFit:
        y = smooth(readings.interpolated(blocks.starts + delay, step))[rows]
        tool = np.zeros(INERTIAL) if theta is None else theta[:INERTIAL]
        columns = np.concatenate([X, bias, (rates @ tool)[:, :, None], compliance], axis=2)
        off = np.concatenate([noise, exact, (noise_rates @ tool)[:, :, None], exact[:, :, :1]],
                             axis=2)
        return robust_fit(columns[::every], y[::every], prior, groups=blocks.groups[::every],
                          tolerance=1e-5 if every == 1 else 1e-2,
                          noise=off if every == 1 else None)

    delay, fit = nearest_delay(largest_delay, blocks, fitted)
    for _ in range(ITERATIONS):
        fit = fitted(delay, fit.theta)
        change = float(fit.theta[16])
        delay = float(np.clip(delay + change, -largest_delay, largest_delay))
        if abs(change) < 1e-6:
            break
    theta = np.array([*fit.theta[:16], delay, fit.theta[17]])
    C = fit.covariance.copy()
    if not has_position:
        C[range(4, INERTIAL), range(4, INERTIAL)] = np.inf
    explained = (X @ theta[:INERTIAL])[:, :3]
    varies = float(np.sqrt(explained.var(axis=0).mean()))
    return JointFit(theta, C, float(fit.scale[-1, 0]) / max(varies, 1e-12),
                    fit.residual.reshape(-1, 6), fit.scale[-1], blocks, noise_at_rest(
                        readings.interpolated(blocks.starts + delay, step)
                        - whole @ theta[:INERTIAL], blocks))


def noise_at_rest(residual: Array, blocks: Blocks) -> Autocovariance | None:
    """
    Measure the noise of blocks at rest, but for a constant in each static pose.

    Parameters
    ----------
    residual : ndarray, shape (n, k)
        Readings of all blocks less what the motion explains.
    """
    windows = [residual[blocks.still == i] for i in range(blocks.still.max(initial=-1) + 1)]
    windows = [window for window in windows if len(window) >= SHORTEST]
    return noise_of_windows(windows) if windows else None


def nearest_delay(largest: float, blocks: Blocks, fitted: Callable[..., RobustFit]
                  ) -> tuple[float, RobustFit]:
    """Try eleven delays on a few of the rows; return the best with its fit."""
    every = blocks.every
    share = np.bincount(blocks.groups[::every], minlength=1)
    share = share[share > 0]
    coarse = np.linspace(-largest, largest, 11)
    tried = [fitted(delay, None, every) for delay in coarse]
    best = int(np.argmin([share @ np.log(one.scale).sum(axis=1) for one in tried]))
    return float(coarse[best]), tried[best]


def require_overlap(wrench: Stream, pose: PoseStream) -> None:
    """
    Refuse a recording without rests that is too short.

    Raises
    ------
    UnobservableError
    """
    overlap = max(min(wrench.t[-1], pose.t[-1]) - max(wrench.t[0], pose.t[0]), 0.0)
    # least time in which a stream without rests overlaps the pose [s]: blocks for standard errors
    # are then 0.1 s
    least_s = 5.0
    if overlap < least_s:
        raise UnobservableError(
            f'wrench and pose overlap for {below(overlap, least_s)} s, but calibration from '
            f'motion requires {least_s:g} s; record longer')


def require_rotation(blocks: Blocks) -> None:
    """
    Refuse motion that turns gravity about one axis of ft_sensor only.

    Raises
    ------
    UnobservableError
        Names the axis, and what to rotate about.
    """
    force = blocks.apparent_gravity
    spread, directions = principal_spread(force)
    if spread[1] >= MIN_GRAVITY_SPREAD:
        return
    degrees, needed = np.degrees(spread), float(np.degrees(MIN_GRAVITY_SPREAD))
    if spread[0] < MIN_GRAVITY_SPREAD:
        raise UnobservableError(
            f'gravity rotates by {degrees[0]:.2g} deg RMS in ft_sensor: mass, centre of mass and '
            'biases are not observable; rotate the sensor by 20 deg or more about two horizontal '
            'axes')
    along = np.cross(force.mean(axis=0), directions[0])
    axis = 'xyz'[int(np.argmax(np.abs(along)))]
    other = 'xyz'[int(np.argmax(np.abs(directions[0])))]
    raise UnobservableError(
        f'the sensor rotates about only one axis, near its {axis}: gravity varies by '
        f'{degrees[0]:.2g} deg RMS in one direction and {below(degrees[1], needed, 2)} deg across '
        f'it, but centre of mass and torque bias require {needed:.3g} deg; also rotate about '
        f'{other}, by 10 deg or more')


def most_unexplained(has_position: bool) -> float:
    """Return the largest share of the variation of a weight in the residual of a tool's motion."""
    return MAX_UNEXPLAINED if has_position else 1.0


def require_tool(fit: JointFit, has_position: bool, largest_delay: float) -> None:
    """
    Refuse a mass that is chance, forces that are not a rigid tool's, and clocks apart.

    Raises
    ------
    UnobservableError, DataError
    """
    mass, std = float(fit.theta[0]), float(fit.std[0])
    most = most_unexplained(has_position)
    # standard errors by which a mass must differ from zero
    sigmas = 5.0
    if not abs(mass) > sigmas * std:
        raise UnobservableError(
            f'the mass is {mass:.3g} kg with a standard error of {std:.2g} kg, but must exceed '
            f'{sigmas:g} standard errors; rotate further, or attach the tool')
    if fit.unexplained > most:
        varies = float(fit.scale[0]) / fit.unexplained
        raise DataError(
            f'forces differ from those of a rigid tool by {fit.scale[0]:.3g} N RMS, '
            f'{above(100 * fit.unexplained, 100 * most)} % of the variation of its weight '
            f'({varies:.3g} N; at most {100 * most:g} % is accepted); record without contact or '
            'cable forces; if the message repeats, check that wrench and pose use the same axes')
    if abs(fit.delay) >= 0.95 * largest_delay:
        raise DataError(
            f'the delay between pose and wrench is {1e3 * abs(fit.delay):.3g} ms, at the search '
            f'limit ({1e3 * largest_delay:.3g} ms): their stamps are of different clocks; stamp '
            'both with one clock')
