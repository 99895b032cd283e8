"""What an in-situ calibration yields for one sensor."""

from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.calibration.model import Estimate
from forcecal_ros.geometry import Array
from forcecal_ros.insitu.departure import Causes, Departure
from forcecal_ros.insitu.excitation import Excitation, Norm
from forcecal_ros.insitu.matrix import Load
from forcecal_ros.insitu.offset_moves import Jump
from forcecal_ros.insitu.rank import RankReport
from forcecal_ros.insitu.reduce import Options
from forcecal_ros.insitu.screen import Cut
from forcecal_ros.insitu.stated import Contradiction
from forcecal_ros.insitu.validate import LoadEstimate


class NonLinearity(NamedTuple):
    """
    What a linear map leaves where every wrench is known.

    ``share`` RMS of the wrench's error over its range, of the worst axis; ``squares`` whether
    squares of the channels make errors of data sets left out smaller, by two standard errors.
    """

    share: float
    squares: bool


@dataclass(frozen=True)
class DataSetResult:
    """
    One data set.

    Attributes
    ----------
    load : Load or None
        As stated.
    kept : tuple of (float, float)
        Stretches used [s].
    cuts : tuple of Cut
        What was left out and why.
    samples : int
        Used.
    singular_values : ndarray, shape (n,)
        Of the centred raw measurements, over sqrt(samples).
    departure : Departure or None
        What leaves the subspace; None in motion, which has no subspace.
    gravity_scatter : float
        Standard deviation of measured |g|, which motion makes [m/s^2].
    raw, gravity : ndarray, shape (b, n), (b, 3)
        Block means used, for pictures.
    added_mass, position, semi_axes : Estimate or None
        By the calibrated sensor [kg], (3,) [m], (3,) [N].
    by_manufacturer : LoadEstimate or None
        The same by the manufacturer's matrix.
    """

    name: str
    train: bool
    load: Load | None
    kept: tuple[tuple[float, float], ...]
    cuts: tuple[Cut, ...]
    samples: int
    singular_values: Array
    departure: Departure | None
    gravity_scatter: float
    raw: Array
    gravity: Array
    added_mass: Estimate | None = None
    position: Estimate | None = None
    semi_axes: Estimate | None = None
    by_manufacturer: LoadEstimate | None = None


@dataclass(frozen=True)
class SensorResult:
    """
    One sensor.

    Attributes
    ----------
    norm : Norm or None
        What |g| says of the accelerometer; None in motion.
    offset : Estimate, shape (n,)
        [raw units]
    offset_scatter : ndarray, shape (k,)
        How far each data set's own offset is from the shared one, in its standard errors.
    offset_moves : ndarray, shape (k,)
        How far each data set's own offset is from the usual one, as a share of what gravity moves.
    jumps : tuple of Jump or None
        Of the offset within each data set; empty in motion and of poses.
    causes : Causes or None
        What the residuals of the affine maps of gravity come from; None in motion.
    compensated : bool
        Whether hysteresis, where there is some, was taken off.
    manufacturer_matrix : ndarray or None, shape (6, n)
    matrix : Estimate or None, shape (6, n)
        Wire wrench = matrix (raw - offset).
    wrench_bias : Estimate or None, shape (6,)
        Zero, with the standard errors that the offset leaves of it [N, N m].
    mass, com, inertia : Estimate or None
        Of the body without added masses [kg], (3,) [m], (3, 3) about the centre of mass in
        motion [kg m^2].
    rank : RankReport or None
        Of the unknowns, on the data.
    nonlinearity : NonLinearity or None
        Where nothing hangs there but the added masses.
    contradiction : Contradiction or None
        Which stated loads cannot be.
    """

    name: str
    options: Options
    excitation: Excitation
    norm: Norm | None
    offset: Estimate
    offset_scatter: Array
    offset_moves: Array
    causes: Causes | None
    compensated: bool
    data_sets: tuple[DataSetResult, ...]
    manufacturer_matrix: Array | None
    matrix: Estimate | None = None
    wrench_bias: Estimate | None = None
    mass: Estimate | None = None
    com: Estimate | None = None
    inertia: Estimate | None = None
    rank: RankReport | None = None
    nonlinearity: NonLinearity | None = None
    contradiction: Contradiction | None = None
    jumps: tuple[Jump | None, ...] = ()
    warnings: tuple[str, ...] = ()
