"""Frame and axes of a wrench, and the way down: hypotheses about forces at rest, before physics.

With R_i the orientation of the sensor in base, g gravity there and b the bias, the wire reads

    F_i = m R_i^T g + b           plain; opposite: -m
    F_i = m Q R_i^T g + b         sensor turned by Q on the flange, or mirrored: det Q = -1
    F_i = R_i^T u + b             base not level: u = m g points anywhere
    F_i = m g + R_i b             wrench expressed in base

each by least squares (the turn after Wahba, SIAM Review 7, 1965, with the mass as Umeyama, IEEE
PAMI 13, 1991, has it), weighed by the Bayesian information criterion (Schwarz, Ann. Stat. 6, 1978)
and, against the plain one, by an F-test.
"""

from collections.abc import Iterator
from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.core.geometry import Array, rotation_from_vector, rotation_vector, skew
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, fdtrc

_QUARTER_TURNS = Rotation.create_group('O').as_matrix()
"""The 24 ways to put a cube down: the best of them is where a fit of turn and tilt begins."""


class Forces(NamedTuple):
    """
    Mean forces of static poses.

    Attributes
    ----------
    R_base_sensor : ndarray, shape (n, 3, 3)
    wire : ndarray, shape (n, 3)
        [N]
    gravity : ndarray, shape (3,)
        In base, as it is believed to be [m/s^2].
    noise : ndarray, shape (n,), or None
        Standard deviation of each mean; None: not known, taken from the residuals [N].
    specific : ndarray, shape (n, 3), or None
        Of a tool in motion: gravity less its acceleration, in base [m/s^2].
    rests : bool
        Whether the sensor rested.
    """

    R_base_sensor: Array
    wire: Array
    gravity: Array
    noise: Array | None
    specific: Array | None = None
    rests: bool = True

    @property
    def in_sensor(self) -> Array:
        """Gravity in ft_sensor, less acceleration where there is one, shape (n, 3) [m/s^2]."""
        return np.asarray(np.einsum('ni,nij->nj', self.in_base, self.R_base_sensor))

    @property
    def in_base(self) -> Array:
        """The same in base."""
        if self.specific is not None:
            return self.specific
        return np.broadcast_to(self.gravity, (len(self.wire), 3))

    @property
    def weight(self) -> Array:
        """One over the standard deviation of each mean, shape (n,), at least of rounding."""
        rounding = limits.TRUE * float(np.ptp(self.wire, axis=0).max())
        noise = np.zeros(len(self.wire)) if self.noise is None else self.noise
        return np.asarray(1.0 / np.maximum(np.hypot(noise, rounding), limits.TINY))


class Fit(NamedTuple):
    """
    One hypothesis, fitted.

    Attributes
    ----------
    name : str
        plain, opposite, base, tilted, turned, mirrored or both (turned and tilted).
    mass, mass_std : float
        [kg]; below 0 where the hypothesis does not hold.
    Q : ndarray, shape (3, 3)
        From ft_sensor, as the pose has it, to the axes of the wire.
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    turn_std, tilt_std : float
        Standard errors of Q and of the direction of gravity [rad]; 0 where they are not fitted.
    residuals : ndarray, shape (n, 3)
        [N]
    chi_square : float
    unknowns : int
    """

    name: str
    mass: float
    mass_std: float
    Q: Array
    gravity: Array
    turn_std: float
    tilt_std: float
    residuals: Array
    chi_square: float
    unknowns: int

    @property
    def degrees(self) -> int:
        """Readings minus unknowns."""
        return int(self.residuals.size) - self.unknowns

    @property
    def rms(self) -> float:
        """Of the residuals [N]."""
        return float(np.sqrt((self.residuals**2).mean()))


class Judgement(NamedTuple):
    """
    What forces at rest say of their frame.

    Attributes
    ----------
    plain : Fit
        The recording taken as it says it is.
    likely : tuple of Fit
        The hypotheses that hold, the best first; the plain one where no other is clearly better.
    mean : ndarray, shape (3,)
        Of the forces on the wire [N].
    changes : float
        RMS of the forces about it [N].
    rests : bool
        Whether the sensor rested.
    """

    plain: Fit
    likely: tuple[Fit, ...]
    mean: Array
    changes: float
    rests: bool = True


def judge(forces: Forces) -> Judgement:
    """
    Say in which frame forces are, which way their axes point, and which way is down.

    Parameters
    ----------
    forces : Forces
        Of poses whose directions of gravity differ.
    """
    plain, mean = plain_fit(forces), forces.wire.mean(axis=0)
    changes = float((forces.wire - mean).std())
    fits = [fit for fit in (plain, *_others(forces, plain)) if fit.mass > 0.0 and fit.degrees > 0]
    if not fits or not np.ptp(forces.wire, axis=0).any():
        return Judgement(plain, (plain,), mean, changes, forces.rests)
    variance = max(1.0, min(fit.chi_square / fit.degrees for fit in fits))
    best = min(fits, key=lambda fit: criterion(fit, variance))
    if best.name == 'both':  # a second cause has to be as sure as a first
        best = min((fit for fit in fits if fit is best or (
            fit.name in ('tilted', 'turned')
            and _chance(best, fit, forces) > limits.BY_CHANCE)), key=lambda fit: fit.unknowns)
    reference = plain if plain.mass > 0.0 else _weightless(forces)
    if best is plain or _chance(best, reference, forces) > limits.BY_CHANCE:
        return Judgement(plain, (plain,), mean, changes, forces.rests)
    holds = [fit for fit in fits if fit.unknowns <= best.unknowns
             and _chance(best, fit, forces) >= 1.0 / limits.ODDS]
    # one more unknown is no simpler: a turn has one more than a tilt
    simplest = min(fit.unknowns for fit in holds) + 1
    return Judgement(plain, tuple(sorted((fit for fit in holds if fit.unknowns <= simplest),
                                         key=lambda fit: fit.chi_square)), mean, changes,
                     forces.rests)


def criterion(fit: Fit, variance: float) -> float:
    """Bayesian information criterion, ``variance`` the one that the weights leave over."""
    return fit.chi_square / variance + fit.unknowns * float(np.log(fit.residuals.size))


def _chance(best: Fit, other: Fit, forces: Forces) -> float:
    """How probable it is that a hypothesis fits so much better than another that holds."""
    more = max(1, best.unknowns - other.unknowns)
    gain = max(0.0, other.chi_square - best.chi_square)
    if forces.noise is not None and chdtrc(best.degrees, best.chi_square) > 1.0 / limits.ODDS:
        return float(chdtrc(more, gain / limits.NOISE_KNOWN**2))
    variance = max(1.0, best.chi_square / best.degrees)
    return float(fdtrc(more, best.degrees, gain / variance / more))


def _others(forces: Forces, plain: Fit) -> Iterator[Fit]:
    """Every hypothesis but the plain one, as far as the poses tell it."""
    if plain.mass < 0.0:
        yield plain._replace(name='opposite', mass=-plain.mass, Q=-np.eye(3))
    yield _base(forces)
    n, in_sensor = len(forces.wire), forces.in_sensor / np.linalg.norm(forces.gravity)
    # any direction is as good as down where gravity is not known, or is not all there is
    tells_down = forces.specific is None and (
        _singular_values(np.swapaxes(forces.R_base_sensor, 1, 2))[-1] > limits.SPANNED)
    if tells_down:
        yield _tilted(forces)
    if n > 1 and _singular_values(in_sensor[:, None])[1] > limits.SPANNED:
        yield turned_fit(forces)
        yield turned_fit(forces, -1.0)
    if n > 3 and tells_down:
        yield _both(forces)


def _singular_values(rows: Array) -> Array:
    """Singular values of (n, j, k) about the mean of the n, per root of n."""
    about = (rows - rows.mean(axis=0)).reshape(-1, rows.shape[2])
    return np.asarray(np.linalg.svd(about, compute_uv=False) / np.sqrt(len(rows)))


def _solved(design: Array, forces: Forces) -> tuple[Array, Array, Array, float, int]:
    """
    Fit a linear model.

    Parameters
    ----------
    design : ndarray, shape (n, 3, k)

    Returns
    -------
    theta, covariance, residuals, chi_square, rank
    """
    weight = np.repeat(forces.weight, 3)
    rows = design.reshape(len(weight), -1) * weight[:, None]
    theta, _, rank, _ = np.linalg.lstsq(rows, forces.wire.ravel() * weight, rcond=1e-9)
    residuals = forces.wire - design @ theta
    chi_square = float(((residuals * forces.weight[:, None])**2).sum())
    variance = max(1.0, chi_square / max(1, len(rows) - int(rank)))
    return theta, variance * np.linalg.pinv(rows.T @ rows), residuals, chi_square, int(rank)


def _biased(columns: Array) -> Array:
    """Append a bias of the three channels to a design (n, 3, k)."""
    return np.concatenate([columns, np.broadcast_to(np.eye(3), (len(columns), 3, 3))], axis=2)


def plain_fit(forces: Forces) -> Fit:
    """Take the recording as it says it is."""
    theta, covariance, residuals, chi_square, rank = _solved(
        _biased(forces.in_sensor[:, :, None]), forces)
    return Fit('plain', float(theta[0]), float(np.sqrt(covariance[0, 0])), np.eye(3),
               forces.gravity, 0.0, 0.0, residuals, chi_square, rank)


def _weightless(forces: Forces) -> Fit:
    """Nothing but the bias: what a negative mass is compared with."""
    _, _, residuals, chi_square, rank = _solved(
        _biased(np.empty((len(forces.wire), 3, 0))), forces)
    return Fit('plain', 0.0, 0.0, np.eye(3), forces.gravity, 0.0, 0.0, residuals, chi_square, rank)


def _base(forces: Forces) -> Fit:
    theta, covariance, residuals, chi_square, rank = _solved(
        np.concatenate([forces.in_base[:, :, None], forces.R_base_sensor], axis=2), forces)
    return Fit('base', float(theta[0]), float(np.sqrt(covariance[0, 0])), np.eye(3),
               forces.gravity, 0.0, 0.0, residuals, chi_square, rank)


def _tilted(forces: Forces) -> Fit:
    theta, covariance, residuals, chi_square, rank = _solved(
        _biased(np.swapaxes(forces.R_base_sensor, 1, 2)), forces)
    return _of_weight('tilted', theta[:3], covariance[:3, :3], np.eye(3), 0.0, forces, residuals,
                      chi_square, rank)


def _of_weight(name: str, u: Array, covariance: Array, Q: Array, turn_std: float,
               forces: Forces, residuals: Array, chi_square: float, rank: int) -> Fit:
    """Make a hypothesis whose weight u in base, shape (3,) [N], points where it wants."""
    g, size = float(np.linalg.norm(forces.gravity)), float(np.linalg.norm(u))
    along = u / max(size, limits.TINY)
    across = covariance - np.outer(along, along) @ covariance
    tilt = np.sqrt(max(0.0, float(np.linalg.eigvals(across).real.max()))) / max(size, limits.TINY)
    return Fit(name, size / g, float(np.sqrt(along @ covariance @ along)) / g, Q, g * along,
               turn_std, float(tilt), residuals, chi_square, rank)


def turned_fit(forces: Forces, hand: float = 1.0) -> Fit:
    """Fit a turn where ``hand`` is 1, a mirrored one where it is -1."""
    g, w = forces.in_sensor, forces.weight**2
    centred, read = g - np.average(g, 0, w), forces.wire - np.average(forces.wire, 0, w)
    U, S, Vt = np.linalg.svd((read * w[:, None]).T @ centred)
    last = hand * np.linalg.det(U @ Vt)
    Q = U @ np.diag([1.0, 1.0, last]) @ Vt
    mass = float((S[0] + S[1] + last * S[2]) / (w @ (centred**2).sum(axis=1)))
    predicted = g @ Q.T
    _, covariance, residuals, chi_square, _ = _solved_turn(predicted, mass, forces)
    name = 'turned' if hand > 0 else 'mirrored'
    return Fit(name, mass, float(np.sqrt(covariance[0, 0])), Q, forces.gravity,
               _turn_std(Q * hand, covariance[1:4, 1:4]), 0.0, residuals, chi_square, 7)


def _solved_turn(predicted: Array, mass: float, forces: Forces
                 ) -> tuple[Array, Array, Array, float, int]:
    """Mass, small turn and bias about a turn that is the best already, ``predicted`` (n, 3)."""
    rows = np.concatenate([predicted[:, :, None], -mass * skew(predicted)], axis=2)
    return _solved(_biased(rows), forces)


def _turn_std(Q: Array, covariance: Array) -> float:
    """Return the standard error of a turn's angle, by the covariance of a small turn after it."""
    axis = rotation_vector(Q)
    if np.linalg.norm(axis) < 3.0 * np.sqrt(np.trace(covariance)):
        return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    axis = axis / np.linalg.norm(axis)
    return float(np.sqrt(axis @ covariance @ axis))


def _both(forces: Forces) -> Fit:
    """Fit a turned sensor on a tilted base, from the best of the quarter turns on."""
    weight = forces.weight[:, None]
    back = np.swapaxes(forces.R_base_sensor, 1, 2)

    def off(x: Array) -> Array:
        predicted = (back @ x[3:6]) @ (rotation_from_vector(x[:3]) @ start).T
        return np.asarray(((predicted + x[6:] - forces.wire) * weight).ravel())

    starts = [(_solved(_biased(Q @ back), forces), Q) for Q in _QUARTER_TURNS]
    (theta, *_), start = min(starts, key=lambda one: one[0][3])
    found = least_squares(off, np.concatenate([np.zeros(3), theta]), x_scale='jac')
    chi_square = float(found.fun @ found.fun)
    variance = max(1.0, chi_square / max(1, len(found.fun) - 9))
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac)
    Q = rotation_from_vector(found.x[:3]) @ start
    return _of_weight('both', found.x[3:6], covariance[3:6, 3:6], Q,
                      _turn_std(Q, covariance[:3, :3]), forces,
                      -found.fun.reshape(-1, 3) / weight, chi_square, 9)
