"""Two passes over each recording: one to see what of it is usable, one to take its moments."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from forcecal_ros.checks.signals import REMEDY
from forcecal_ros.core.errors import DataError, ForcecalError
from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
from forcecal_ros.insitu.blocks import Blocks, Mask, Mounting, prepare, Source, to_blocks
from forcecal_ros.insitu.equations import Load
from forcecal_ros.insitu.moments import (
    accumulate,
    Moments,
    PAPER_ORDER,
    PAPER_WINDOW,
    window_samples,
)
from forcecal_ros.insitu.offset import Norm, norm
from forcecal_ros.insitu.screen import given_window, screen, Screening, untouched, whole
from forcecal_ros.insitu.uncertainty import Departure, departure
import numpy as np

LITTLE = 0.5
"""Screening that leaves less than this share of all data sets is reported, or not done."""


@dataclass(frozen=True)
class Options:
    """
    How to calibrate.

    Attributes
    ----------
    gravity : float
        Magnitude there [m/s^2].
    filter_window : float
        [s]; 0 for no filter.
    filter_order : int
    moving : bool
        Use the gyro.
    screening : bool
        Find and cut what is no free-hanging rigid body.
    poses : bool
        Every sample is the mean of one pose at rest: neither filtered nor screened.
    matrix : bool
        Estimate the matrix, not the offset alone.
    body : bool
        Something unknown hangs there beside the added masses.
    level_accelerometer : bool
        Subtract the accelerometer's offset where |g| shows it (at rest only).
    raw_unit : str
    mass_error : float
        Standard error of a stated mass, as a share; standard errors of what is found hold it.
    place_error : float
        The same of a stated place, along each axis [m].
    """

    gravity: float = STANDARD_GRAVITY
    filter_window: float = PAPER_WINDOW
    filter_order: int = PAPER_ORDER
    moving: bool = False
    screening: bool = True
    poses: bool = False
    matrix: bool = True
    body: bool = True
    level_accelerometer: bool = True
    raw_unit: str = 'raw'
    mass_error: float = 0.0
    place_error: float = 0.0


@dataclass(frozen=True)
class DataSet:
    """
    One recording of one sensor.

    Attributes
    ----------
    name : str
    source : callable
        Reads it from the beginning.
    load : Load or None
        What was added, in the sensor frame; None where it is not known.
    train : bool
    window : (float, float) or None
        To use, as the user states [s].
    """

    name: str
    source: Source
    load: Load | None = None
    train: bool = True
    window: tuple[float, float] | None = None


@dataclass(frozen=True)
class Reduced:
    """
    A data set after both passes over its samples.

    ``gravity_scatter`` is the standard deviation of |g| [m/s^2]; ``departure`` from the subspace
    is None in motion and of poses, whose noise one sample does not tell.
    """

    blocks: Blocks
    screening: Screening
    moments: Moments
    gravity_scatter: float
    departure: Departure | None

    @property
    def use(self) -> Mask:
        """Which blocks are used."""
        return self.screening.use


def reduce(data_sets: Sequence[DataSet], mounting: Mounting, options: Options
           ) -> tuple[list[Reduced], Norm | None]:
    """
    Screen all recordings, level the accelerometer, filter and accumulate.

    Returns
    -------
    list of Reduced
    Norm or None
        What |g| shows of the accelerometer; None in motion.

    Raises
    ------
    DataError
        A recording holds nothing usable; the message names it.
    """
    found_blocks = []
    for data_set in data_sets:
        with _named(data_set):
            blocks = to_blocks(prepare(data_set.source(), mounting, options.moving),
                               data_set.window, options.poses)
            _require_signal(blocks)
            found_blocks.append(blocks)
    screened = list(zip(found_blocks, _screen_all(found_blocks, data_sets, options)))
    found = None if options.moving else norm(
        [(blocks, screening.use) for blocks, screening in screened], options.gravity)
    if found and found.usable and options.level_accelerometer:
        mounting = mounting.shifted(found.offset)
        screened = [(blocks.levelled(found.offset), s) for blocks, s in screened]
    reduced = []
    for data_set, (blocks, screening) in zip(data_sets, screened):
        with _named(data_set):
            scatter = float(blocks.gravity_norm[screening.use].std())
            if not options.moving:
                blocks = blocks.of_magnitude(options.gravity)
            seconds = 0.0 if options.poses else options.filter_window
            window = window_samples(seconds, options.filter_order, 1 / blocks.period)
            reduced.append(Reduced(blocks, screening, accumulate(
                prepare(data_set.source(), mounting, options.moving), screening.kept, window,
                options.filter_order, blocks.raw_noise, blocks.gravity_noise,
                None if options.moving else options.gravity), scatter,
                None if options.moving or options.poses else departure(blocks, screening.use)))
    return reduced, found


def without_hysteresis(reduced: Sequence[Reduced], lags: Sequence[Array]) -> list[Reduced]:
    """
    Take the hysteresis that was found off the raw measurements.

    Parameters
    ----------
    lags : sequence of ndarray, shape (b, n)
        Of each data set's blocks.
    """
    return [replace(r, blocks=replace(r.blocks, raw=r.blocks.raw - lag),
                    moments=r.moments.without(lag[r.use], r.blocks.raw[r.use],
                                              r.blocks.regressors[r.use]))
            for r, lag in zip(reduced, lags)]


def _require_signal(blocks: Blocks) -> None:
    """Refuse channels that stand still all the time, and an accelerometer that does."""
    gravity = blocks.regressors[:, :3]
    if not np.ptp(gravity, axis=0).any():
        raise DataError(f'accelerometer: the values never change; {REMEDY}')
    if len(stands := np.flatnonzero(np.ptp(gravity, axis=0) == 0)):
        named = ', '.join('xyz'[k] for k in stands)
        raise DataError(f'accelerometer: gravity along {named} of the sensor never changes, not '
                        f'even by noise (check the columns); {REMEDY}')
    still = np.flatnonzero(np.ptp(blocks.raw, axis=0) == 0)
    if len(still):
        named = '; '.join(f'channel {k + 1} is constant at {blocks.raw[0, k]:.6g}'
                          for k in still)
        raise DataError(f'{named} (check the columns); {REMEDY}')


def _screen_all(all_blocks: Sequence[Blocks], data_sets: Sequence[DataSet], options: Options
                ) -> list[Screening]:
    """
    Screen each data set by itself.

    Not where every wrench is known and little would be left: errors of data sets left out hold it.
    """
    screenings: list[Screening] = []
    known = options.screening and not options.body and not any(d.window for d in data_sets)
    try:
        for blocks, data_set in zip(all_blocks, data_sets):
            with _named(data_set):
                screenings.append(_screen(blocks, data_set, options))
    except DataError:
        if not known:
            raise
    used = sum(int(screening.use.sum()) for screening in screenings)
    if known and used < LITTLE * sum(map(len, all_blocks)):
        return [untouched(blocks) for blocks in all_blocks]
    return screenings


def _screen(blocks: Blocks, data_set: DataSet, options: Options) -> Screening:
    if data_set.window is not None:
        return given_window(blocks, *data_set.window)
    return screen(blocks) if options.screening and not options.poses else whole(blocks)


@contextmanager
def _named(data_set: DataSet) -> Iterator[None]:
    try:
        yield
    except ForcecalError as error:
        error.args = (f'{data_set.name}: {error}',)
        raise
