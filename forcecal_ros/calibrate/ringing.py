"""Stiffness and damping of a tool that slides along x of ft_sensor, from its sag and ringing.

Once the robot stands again nothing drives the tool, and displacement and force along x are
exponentially damped oscillations of one and the same motion:

    s = s_end + exp(-lam t) (p cos(w t) + q sin(w t)),    lam = d / 2m,  lam^2 + w^2 = k / m
    F_x = F_end + k (s - s_end) + d ds/dt

Both sensors are noisy, neither is a regressor: the motion itself is what is fitted, so noise
does not pull the estimate towards zero as it does in a regression of F_x on s and ds/dt. Decay
and frequency do not depend on how far the two sensors are apart in time, which in that
regression is all but one with the damping (k times the delay).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

from forcecal_ros.calibrate.accelerometer import lowpassed
from forcecal_ros.calibrate.joint import JointFit, smooth
from forcecal_ros.calibrate.poses import require_wrench, StaticPose
from forcecal_ros.calibrate.tool import Statics
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.rigid_body import rate_of_change
from forcecal_ros.core.streams import phase_spans, PoseStream, Recording, Stream
from forcecal_ros.core.time_grid import Averager
import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

CREEP_RATE = 8.0
"""Rate at which the end of an approach decays, in which the robot still moves while the tool is
said to ring freely [1/s]; slower adds no force, faster is over."""


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
    # least variation of the weight along x, of the weight, that shows a stiffness
    least = 0.05
    if np.ptp(weight) < least * fit.theta[0] * blocks.gravity:
        return None
    s = blocks.displacement[:, None]
    force = Averager(wrench.t, wrench.values[:, :1]).interpolated(
        blocks.starts + fit.delay, blocks.length)
    rate = rate_of_change(s, blocks.length)
    columns = smooth(np.concatenate([s, rate, np.ones_like(s)], axis=1))
    # blocks of the rows at rest for the standard error of a stiffness: 0.5 s each in the sequence,
    # five times as long as the low-pass correlates them
    independent = 12
    found = robust_fit(columns[rest, None, :], smooth(force)[rest], blocks=independent, channels=1)
    stiffness, variance = float(found.theta[0]), float(found.covariance[0, 0])
    # standard errors by which a compliance differs from zero
    sigmas = 5.0
    if stiffness**2 < sigmas**2 * variance:
        return None
    if stiffness < 0:
        raise DataError(f'optidrive: the tool moves against its load ({1e3 / stiffness:.3g} mm '
                        'per N); invert the sign of the optidrive')
    zero = (fit.theta[10] - found.theta[2]) / stiffness
    return Sag(stiffness, variance, float(zero))


def fit_creep(pose: PoseStream | None) -> tuple[float, float]:
    """
    Fit x_end + way exp(-CREEP_RATE t) along x to the measured pose.

    Parameters
    ----------
    pose : PoseStream or None
        From the start of the ringing on.

    Returns
    -------
    way, std : float
        [m]
    """
    if pose is None or not pose.has_position or len(pose) < 20:
        return 0.0, 0.0
    t, x = pose.t - pose.t[0], pose.position @ pose.R_base_sensor[0, :, 0]
    rows = np.column_stack([np.ones(len(t)), np.exp(-CREEP_RATE * t)])
    solution = np.linalg.lstsq(rows, x, rcond=None)[0]
    variance = float(((x - rows @ solution)**2).sum()) / (len(t) - 2)
    return float(solution[1]), float(np.sqrt(variance * np.linalg.inv(rows.T @ rows)[1, 1]))


def follow(way: float, t: Array, k: float, d: float, mass: float) -> tuple[Array, Array]:
    """
    Say how the tool follows a robot that creeps: m s" + d s' + k s = -m x".

    Parameters
    ----------
    way : float
        That the robot still has to go at first [m].
    t : ndarray, shape (n,)
        Since the start of the ringing [s].
    k, d, mass : float
        [N/m], [N s/m], [kg]

    Returns
    -------
    tuple of ndarray, shape (n,)
        Displacement [m] and the force that goes with it [N].
    """
    size = -mass * CREEP_RATE**2 * way / (mass * CREEP_RATE**2 - d * CREEP_RATE + k)
    slide = size * np.exp(-CREEP_RATE * t)
    return slide, (k - d * CREEP_RATE) * slide


class Ring(NamedTuple):
    """
    Readings along x while the tool rings.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Of the wrench, from the start of the ringing [s].
    force : ndarray, shape (n,)
        On the wire [N].
    slide_t, slide : ndarray, shape (m,)
        Displacement [s], [m]; empty without an Optidrive.
    way, way_std : float
        That the robot still moves along x, with its standard error [m].
    """

    t: Array
    force: Array
    slide_t: Array
    slide: Array
    way: float = 0.0
    way_std: float = 0.0


class RingFit(NamedTuple):
    """
    Result of the ringing.

    Attributes
    ----------
    stiffness, damping : float
        [N/m], [N s/m]
    slide_delay : float
        How much later than the wrench the Optidrive shows the same instant [s].
    covariance : ndarray, shape (3, 3)
        Of these three, the mass' uncertainty left out.
    unexplained : float
        What a spring and a damper leave of the swing beyond noise, as a share of it.
    """

    stiffness: float
    damping: float
    slide_delay: float
    covariance: Array
    unexplained: float


def ring_of(recording: Recording, poses: Sequence[StaticPose], statics: Statics, fit: JointFit,
            sag: Sag | None) -> RingFit | None:
    """Fit what rings after the step while the robot stands; None where nothing rang."""
    assert fit.noise is not None
    wrench, pose, ringing = require_wrench(recording), recording.pose, []
    optidrive = recording.optidrive if statics.slide.any() else None
    spans = (_stands(*window, pose, recording.target)
             for window in phase_spans(recording.phases, ('step',)))
    for start, stop in chain(*spans):
        # ringing is fitted over this long at most [s]
        longest = 2.0
        stop = min(stop, start + longest)
        cut = wrench.between(start, stop)
        # stretches that are shorter do not tell a decay [s]
        shortest = 0.15
        if stop - start < shortest or len(cut) < 20:
            continue
        slide = optidrive.between(start, stop) if optidrive else Stream(
            np.empty(0), np.empty((0, 1)))
        ringing.append(Ring(cut.t - start, cut.values[:, 0], slide.t - start, slide.values[:, 0],
                            *fit_creep(pose and pose.between(start, stop))))
    return stiffness_and_damping(
        ringing, float(fit.theta[0]), float(fit.noise.at_least_white[0, 0]) * fit.blocks.length,
        float(statics.slide_variance[0] * (poses[0].end - poses[0].start)),
        (sag.stiffness, sag.variance) if sag else None)


def _stands(begin: float, end: float, pose: PoseStream | None, target: PoseStream | None
            ) -> list[tuple[float, float]]:
    """Stretches within a window in which the robot has stopped moving."""
    stream = pose if pose is not None and pose.has_position else target
    if stream is None or not stream.has_position:
        return [(begin + 0.3, end)]
    cut = stream.between(begin - 0.1, end)
    if len(cut) < 10:
        return []
    step = max(1, round(float(0.02 / np.median(np.diff(cut.t)))))
    place = uniform_filter1d(cut.position, step, axis=0, mode='nearest')
    # a robot that moves by less within 20 ms has stopped [m]
    still = 1e-4
    moving = (np.linalg.norm(place[step:] - place[:-step], axis=1) > still).astype(int)
    edges = np.diff(np.concatenate([[1], moving, [1]]))
    stop, go = np.flatnonzero(edges == -1), np.flatnonzero(edges == 1)
    t = np.append(cut.t, end)
    spans = []
    for i, j in zip(stop.tolist(), go.tolist()):
        # by how much the robot's servos still settle once its pose does not change any more [s]
        servo = 0.06
        arrived = float(t[min(i + step, len(t) - 1)]) + servo
        # by how much a robot leaves before its pose shows it [s]. The force feels the acceleration
        # at once, the pose has to move by 0.1 mm first: up to 0.09 s on the rig where its commands
        # come late
        before = 0.1
        spans.append((arrived, float(t[j]) - before if j < len(moving) else end))
    return [(a, b) for a, b in spans if a > begin]


def stiffness_and_damping(
        ringing: list[Ring], mass: float, force_density: float, slide_density: float,
        stiffness: tuple[float, float] | None = None) -> RingFit | None:
    """
    Fit all stretches of ringing at once, [Gamez2005] Eq. 29.

    Parameters
    ----------
    mass : float
        [kg]
    force_density, slide_density : float
        Noise variance times its correlation time: variance of a mean times its duration
        [N^2 s], [m^2 s].
    stiffness : tuple of float, optional
        What the static sag says, with its variance [N/m].

    Returns
    -------
    RingFit or None
        None where the ringing does not stand out of the noise: a rigid tool, or no step.
    """
    if not ringing:
        return None
    with_slide = all(len(ring.slide) for ring in ringing)
    if not with_slide:
        ringing = [ring._replace(slide_t=np.empty(0), slide=np.empty(0)) for ring in ringing]

    def residuals(p: Array, ringing: Sequence[Ring] = ringing) -> Array:
        """Residuals in the nonlinear unknowns alone, the linear ones projected out."""
        out = [_left_over(ring, p, mass, force_density, slide_density) for ring in ringing]
        if stiffness is not None:
            out.append(np.array([(np.exp(p[0]) - stiffness[0]) / np.sqrt(stiffness[1])]))
        return np.concatenate(out)

    # from where the linear part of the problem fits best
    guesses = [np.array([np.log(k), np.log(2 * z * np.sqrt(k * mass)), *[0.0] * with_slide])
               for k in ([stiffness[0]] if stiffness else np.geomspace(500, 5e5, 31))
               for z in (0.05, 0.2, 0.5)]
    best = min(guesses, key=lambda p: float((residuals(p)**2).sum()))
    fit = least_squares(residuals, best, x_scale='jac', method='trf', max_nfev=60)
    (k, d), delay = np.exp(fit.x[:2]), float(fit.x[2]) if with_slide else 0.0
    # ringing of a smaller strength does not stand out of the noise
    significant = 8.0
    strength = np.array([_strength(ring, k, d, mass, force_density) for ring in ringing])
    if strength.max() < significant or not fit.success:
        return None
    inverse = np.linalg.pinv(fit.jac.T @ fit.jac)
    full = inverse
    for i, ring in enumerate(ringing):
        moved = ring._replace(way=ring.way + ring.way_std)
        off = residuals(fit.x, [*ringing[:i], moved, *ringing[i + 1:]]) - fit.fun
        shift = inverse @ fit.jac.T @ off
        full = full + np.outer(shift, shift)
    # stiffness and damping with a larger relative error are not worth giving
    precise = 0.3
    if np.diag(full)[:2].max() > precise**2:
        return None
    scale = np.array([k, d, 1.0][:len(fit.x)])
    covariance = np.pad(full * np.outer(scale, scale), (0, 3 - len(scale)))
    excess = np.sqrt(max(0.0, float(fit.fun @ fit.fun) - len(fit.fun)))
    return RingFit(float(k), float(d), delay, covariance,
                   float(excess / np.linalg.norm(strength)))


def _basis(t: Array, k: float, d: float, mass: float) -> tuple[Array, Array]:
    """Displacement and force of the two free motions, shapes (n, 2)."""
    lam = d / (2 * mass)
    square = k / mass - lam**2
    w = np.sqrt(complex(square))
    if abs(w) < 1e-3:
        w = complex(1e-3)
    decay = np.exp(-lam * t)
    c, s = decay * np.cos(w * t).real, decay * (np.sin(w * t) / w).real
    motion = np.stack([c, s], axis=1)
    rate = np.stack([-lam * c - square * s, c - lam * s], axis=1)
    return motion, k * motion + d * rate


def _left_over(ring: Ring, p: Array, mass: float, force: float, slide: float) -> Array:
    """Weighted residual of one stretch, linear in [p, q, F_end, s_end]."""
    k, d = np.exp(p[:2])
    n, m = len(ring.t), len(ring.slide)
    rows = np.zeros((n + m, 4 if m else 3))
    rows[:n, :2] = _basis(ring.t, k, d, mass)[1]
    rows[:n, 2] = 1
    weight = np.full(n + m, np.sqrt(_period(ring.t) / force))
    slide_t = ring.slide_t
    if m:
        slide_t = slide_t - p[2]
        rows[n:, :2] = _basis(slide_t, k, d, mass)[0]
        rows[n:, 3] = 1
        weight[n:] = np.sqrt(_period(ring.slide_t) / slide)
    right = np.concatenate([ring.force - follow(ring.way, ring.t, k, d, mass)[1],
                            ring.slide - follow(ring.way, slide_t, k, d, mass)[0]]) * weight
    q, _ = np.linalg.qr(rows * weight[:, None])
    return np.asarray(right - q @ (q.T @ right))


def _period(t: Array) -> float:
    return float((t[-1] - t[0]) / (len(t) - 1))


def _strength(ring: Ring, k: float, d: float, mass: float, force: float) -> float:
    """Root of a stretch's energy over the density of the force's noise."""
    basis = _basis(ring.t, k, d, mass)[1]
    rows = np.column_stack([basis, np.ones(len(ring.t))])
    swing = basis @ np.linalg.lstsq(rows, ring.force, rcond=None)[0][:2]
    return float(np.sqrt((swing**2).sum() * _period(ring.t) / force))


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
