"""Where the residual is more than noise: stage, channel, phase, frequency band, significance."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.noise.autoregression import Autoregression
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.diagnose.dataset import CHANNELS, Dataset, STREAM_SLICES
from forcecal_ros.diagnose.model.jacobian import Column
from forcecal_ros.sim.signals import BLOCK
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

MIN_SPEED = (1e-3, 5e-3)
"""
Speeds below which a motion does not identify a delay, RMS [m/s], [rad/s]: in 10 ms as far as the
noise of a pose.
"""


class Difference(NamedTuple):
    """
    By how much the robot's translation or rotation differs from its simulation's.

    Attributes
    ----------
    rms : float
        Of the difference [m] or [rad].
    delay, delay_std : float
        By how much the robot is later [s]; NaN if the two motions were aligned with each
        other without commands, or do not identify it.
    unexplained : float
        RMS without that delay, and without a fixed offset [m] or [rad].
    """

    rms: float
    delay: float
    delay_std: float
    unexplained: float

    def document(self) -> dict[str, float | None]:
        """Return what ``diagnosis.json`` holds of it; what is not known is null."""
        numbers = {'rms': self.rms, 'delay': self.delay, 'delay_std': self.delay_std,
                   'left': self.unexplained}
        return {k: v if np.isfinite(v) else None for k, v in numbers.items()}

    def delay_words(self, unit: str) -> str:
        """Return the delay, and what it leaves in thousandths, behind a sentence."""
        if not np.isfinite(self.delay):
            return ''
        side = 'later' if self.delay > 0.0 else 'earlier'
        return (f'; the robot is {quantity(abs(self.delay), self.delay_std, "s")} {side}; '
                f'{1e3 * self.unexplained:.2g} {unit} remain without this delay')


class Tracking(NamedTuple):
    """The difference of two motions."""

    translation: Difference
    rotation: Difference

    @property
    def size(self) -> str:
        """RMS of both, in words."""
        return (f'position {1e3 * self.translation.rms:.2g} mm, orientation '
                f'{1e3 * self.rotation.rms:.2g} mrad (RMS)')

    @property
    def delay(self) -> float:
        """By how much the robot is later, by both together; 0 where neither identifies it [s]."""
        weights = [0.0 if np.isnan(one.delay_std) else 1.0 / max(one.delay_std, 1e-9) ** 2
                   for one in self]
        total = sum(weights)
        return sum(w * one.delay for w, one in zip(weights, self) if w) / total if total else 0.0


def compare_motions(measured: PoseStream, simulated: PoseStream, own_delay: bool) -> Tracking:
    """
    Compare the measured motion with the simulated.

    Parameters
    ----------
    measured, simulated : PoseStream
        On one clock.
    own_delay : bool
        Whether that clock is the commands'.
    """
    start = max(measured.t[0], simulated.t[0])
    end = min(measured.t[-1], simulated.t[-1])
    t = start + BLOCK * np.arange(1, int((end - start) / BLOCK) - 1)
    p, R = _smooth_poses(measured, t)
    q, S = _smooth_poses(simulated, t)
    omega = rotation_vector(np.swapaxes(S[:-1], 1, 2) @ S[1:]) / BLOCK
    return Tracking(
        _motion_difference(p - q, np.gradient(q, BLOCK, axis=0), MIN_SPEED[0], own_delay),
        _motion_difference(rotation_vector(np.swapaxes(S, 1, 2) @ R),
                           np.vstack([omega[:1], omega]),
                    MIN_SPEED[1], own_delay))


def _motion_difference(apart: Array, speed: Array, slowest: float, own_delay: bool) -> Difference:
    delay, std, unexplained = np.nan, np.nan, apart - apart.mean(axis=0)
    if own_delay and _rms(speed) > slowest:
        offsets = np.tile(np.eye(3), (len(apart), 1, 1))
        fit = robust_fit(np.concatenate([-speed[:, :, np.newaxis], offsets], axis=2), apart)
        delay, std, unexplained = float(fit.theta[0]), float(fit.std[0]), fit.residual[:, 0]
    return Difference(_rms(apart), delay, std, _rms(unexplained))


def _smooth_poses(stream: PoseStream, t: Array) -> tuple[Array, Array]:
    # over a window of 20 ms, 1 sigma
    smooth = 0.02 * (len(stream) - 1) / (stream.t[-1] - stream.t[0])
    found = replace(stream, position=gaussian_filter1d(stream.position, smooth, axis=0)).at(t)
    return found.position, found.R_base_sensor


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean((rows ** 2).sum(axis=1))))


BIN_SIGMA = 9.0
"""Sigmas of a bin's energy from which it is more than noise."""

IMPULSE_SIGMA = 7.0
"""Innovation, in its sigma, that noise does not make: an impulse."""

TAIL_SIGMA = 5.0
"""Innovation, in its sigma, from which the tail of a noise shows."""

TAIL_RATIO = 0.57
"""
Part of the innovations between TAIL_SIGMA and IMPULSE_SIGMA that noise with a heavy tail has
beyond: that of Student's t with three degrees of freedom, about the heaviest that a sensor's was.
"""

MIN_IMPULSES = 4
"""So many impulses in a channel count; fewer may be by chance."""

BURST_BLOCKS, BURST_RATIO = 25, 2.5
"""
Blocks (0.1 s) over which the level of noise is taken, and the mean square in that of the noise
from which it is a burst: by chance one of 20,000 such stretches has as much.
"""

IMPULSE_BLOCKS = 3
"""Blocks that one impulse may take, cut by two of them, or filtered."""

MAX_OCTAVE_RATIO = 2.2
"""By how much the power of coloured noise may grow from one octave to the next lower one."""

BANDS = ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 16.0), (16.0, 32.0),
         (32.0, 62.5), (62.5, 125.0))
"""Octaves [Hz] of the block means."""


class TimeFrequencyBin(NamedTuple):
    """Energy of one channel, phase and octave against the noise at standstill."""

    channel: int
    phase: str
    band: tuple[float, float]
    excess: float
    z: float


def time_frequency_bins(dataset: Dataset, noise: Autoregression,
                        residual: Array) -> list[TimeFrequencyBin]:
    """
    Compare the energy of every channel, phase and octave with the noise at standstill.

    Noise that is stronger in a phase, or for a moment, at all frequencies is still noise: the
    highest octave's ratio divides the others', and bursts are brought to the usual level.

    Parameters
    ----------
    residual : ndarray, shape (n, channels)
    """
    resting = max(1, int((dataset.groups == 0).sum()))
    scatter = 2.0 / max(20.0, resting / 10.0)
    rest = noise._replace(coefficients=np.repeat(noise.coefficients[:1], 3, axis=0),
                          sigma=np.repeat(noise.sigma[:1], 3, axis=0))
    phases, found = dataset.phase_rows(), []
    for c in range(len(CHANNELS)):
        if not noise.sigma[:, c].any():
            continue
        white = rest.whiten(residual[:, c][np.newaxis], c)[0]
        there, spacing = noise.present[:, c], noise.spacing(c)
        even = _level_bursts(white[there])
        octaves = {word: _octaves(even, (rows & noise.rows[:, c])[there], spacing)
                   for word, rows in phases.items()}
        expected = _expected_colour(list(octaves.values()))
        for word, (energy, dof) in octaves.items():
            ratio = energy / np.maximum(dof, 1.0) / expected
            common = max(1.0, float(ratio[-1])) if dof[-1] > 20 else 1.0
            for b, band in enumerate(BANDS[:-1]):
                if dof[b] >= 4:
                    over = ratio[b] / common - 1.0
                    z = over / np.sqrt(2.0 / dof[b] + scatter)
                    z = min(z, _cube_root(ratio[b] / common, dof[b]))
                    found.append(TimeFrequencyBin(c, word, band, float(np.sqrt(max(0.0, over))),
                                                  float(z)))
    return sorted(found, key=lambda one: -one.z)


def _level_bursts(white: Array) -> Array:
    """Bring innovations to unit variance wherever they are larger at the highest frequencies."""
    if len(white) < BURST_BLOCKS:
        return white
    quick = np.diff(white, 2, prepend=white[:1], append=white[-1:]) / np.sqrt(6.0)
    level = np.convolve(quick ** 2, np.full(BURST_BLOCKS, 1.0 / BURST_BLOCKS), mode='same')
    return np.asarray(white / np.sqrt(np.where(level > BURST_RATIO, level, 1.0)))


def _expected_colour(octaves: list[tuple[Array, Array]]) -> Array:
    """
    Follow a channel's noise to low frequencies, where a short rest shows nothing of it.

    Noise grows steadily from octave to octave and is there in most phases; shape (bands,).
    """
    ratios = np.array([np.where(dof >= 4, energy / np.maximum(dof, 1.0), np.nan)
                       for energy, dof in octaves])
    expected = np.ones(len(BANDS))
    for b in range(len(BANDS) - 2, -1, -1):
        there = ratios[np.isfinite(ratios[:, b]), b]
        # the lowest band is many octaves
        steepest = expected[b + 1] * MAX_OCTAVE_RATIO * (2.5 if b == 0 else 1.0)
        if len(there):
            expected[b] = min(max(1.0, float(np.median(there))), steepest)
    return expected


def _cube_root(ratio: float, dof: float) -> float:
    """Give the normal score of a chi-square ratio (Wilson and Hilferty)."""
    q = 2.0 / (9.0 * dof)
    return float((np.cbrt(ratio) - (1.0 - q)) / np.sqrt(q))


def _octaves(white: Array, rows: NDArray[np.bool_], spacing: float) -> tuple[Array, Array]:
    energy, dof = np.zeros(len(BANDS)), np.zeros(len(BANDS))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    for i, j in zip(edges[::2], edges[1::2]):
        n = j - i
        if n < max(8, 50.0 / spacing):  # 0.2 s tell octaves from 5 Hz on
            continue
        power = np.abs(np.fft.rfft(white[i:j])) ** 2 / n
        weight = np.full(len(power), 2.0)
        weight[0] = 1.0
        frequency = np.arange(len(power)) / (BLOCK * spacing * n)
        energy += _in_bands(frequency, power * weight)
        dof += _in_bands(frequency, weight)
    return energy, dof


def _in_bands(frequency: Array, values: Array) -> Array:
    """Sum what lies in each of BANDS."""
    return np.array([values[(frequency >= low) & (frequency < high)].sum()
                     for low, high in BANDS])


def count_impulses(noise: Autoregression, residual: Array) -> Array:
    """Count innovations of each channel that noise does not make, shape (channels,)."""
    return np.array([
        _impulses_beyond_tail(noise.whiten(residual[:, c][np.newaxis], c)[0])
        if noise.sigma[:, c].any() else 0 for c in range(len(CHANNELS))])


def _impulses_beyond_tail(white: Array) -> int:
    """Count the impulses, not of a burst, that a heavy tail does not make by two deviations."""
    size = np.abs(white)
    single = size > IMPULSE_SIGMA
    if len(white) >= BURST_BLOCKS:
        around = np.full(BURST_BLOCKS, 1.0 / (BURST_BLOCKS - IMPULSE_BLOCKS))
        middle = (BURST_BLOCKS - IMPULSE_BLOCKS) // 2
        around[middle:middle + IMPULSE_BLOCKS] = 0.0
        single &= np.convolve(white ** 2, around, mode='same') <= BURST_RATIO
    expected = TAIL_RATIO * float(np.sum((size > TAIL_SIGMA) & (size <= IMPULSE_SIGMA)))
    return max(0, int(single.sum() - expected - 2.0 * np.sqrt(expected)))


LINE_RATIO = 30.0
"""
Power of a spectral line, at least, over the median of its neighbourhood: 3000 channels of white
noise of 23 s had 27 at most.
"""

FLOOR_BINS, FLOOR_NEIGHBOURS = 101, 5
"""Bins whose median is the floor of a spectrum; neighbours below whose median it is by chance."""


class Line(NamedTuple):
    """A spectral line in one channel's residual."""

    channel: str
    frequency: float
    amplitude: float
    power: float


def spectral_lines(rows: Array, rate: float, name: str) -> tuple[Line, ...]:
    """
    Find spectral lines in the residual of one stream.

    Parameters
    ----------
    rows : ndarray, shape (n, columns)
        Measured less simulated, equally spaced.
    rate : float
        [Hz]
    name : str
        Of the stream.

    Returns
    -------
    tuple of Line
        Above 8 Hz, the strongest of each channel.
    """
    n, found = len(rows), []
    window = np.hanning(n)
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    for i in range(rows.shape[1]):
        spectrum = np.fft.rfft((rows[:, i] - rows[:, i].mean()) * window)
        power = np.abs(spectrum) ** 2
        floor = _floor(power)
        ratio = np.where(frequency > 8.0, power / floor, 0.0)
        ratio[-3:] = 0.0
        k = int(ratio.argmax())
        wide = ratio[max(0, k - 60):k + 61]
        narrow = np.sum(wide > 0.25 * ratio[k]) <= 8
        if ratio[k] > LINE_RATIO and narrow:
            amplitude = float(np.sqrt(power[k]) * 2.0 / window.sum())
            found.append(Line(CHANNELS[STREAM_SLICES[name].start + i].name,
                              _peak(rows[:, i] * window, float(frequency[k]), rate),
                              amplitude, float(ratio[k])))
    return tuple(found)


def _peak(rows: Array, near: float, rate: float) -> float:
    """Frequency of the strongest line within a bin of one [Hz]."""
    t, width = np.arange(len(rows)) / rate, rate / len(rows)
    return float(minimize_scalar(
        lambda f: -abs(np.exp(-2j * np.pi * f * t) @ rows), method='bounded',
        bounds=(near - width, near + width), options={'xatol': 0.01 * width}).x)


def _floor(power: Array) -> Array:
    """Median of the neighbourhood of every bin, and no less than those around it have."""
    n = len(power) // FLOOR_BINS * FLOOR_BINS
    if n < FLOOR_NEIGHBOURS * FLOOR_BINS:
        return np.full(len(power), float(np.median(power)) + 1e-300)
    middle = np.median(power[:n].reshape(-1, FLOOR_BINS), axis=1)
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(middle, FLOOR_NEIGHBOURS // 2, mode='edge'),
                                                      FLOOR_NEIGHBOURS)
    middle = np.maximum(middle, np.median(around, axis=1))
    centres = (np.arange(len(middle)) + 0.5) * FLOOR_BINS
    return np.asarray(np.interp(np.arange(len(power)), centres, middle) + 1e-300)


class Location(NamedTuple):
    """
    One significant place.

    Attributes
    ----------
    band_hz : tuple of float
        Octave that holds most of the difference.
    excess : float
        RMS of the difference in noise RMS.
    """

    stage: str
    channel: str
    phase: str
    band_hz: tuple[float, float]
    excess: float
    p: float


def stage_of(channel: str, phase: str, touched: set[str]) -> str:
    """
    Name the first stage along the chain that accounts for an excess, cause unknown.

    Parameters
    ----------
    touched : set of str
        Channels with an excess anywhere.
    """
    if any(name.startswith(('pose', 'joint')) for name in touched):
        return 'robot'
    if phase == 'contact' and not channel.startswith('accel') and 'optidrive' in touched:
        return 'environment'
    if 'optidrive' in touched:
        return 'tool'
    return next(c.stage for c in CHANNELS if c.name == channel)


def localise(datasets: Sequence[Dataset], noise: list[Autoregression], residual: list[Array],
             difference: list[Array], stage: Callable[[str, str, set[str]], str],
             sensors: Sequence[Sequence[Column]]) -> tuple[Location, ...]:
    """
    Locate what a difference between two simulations explains.

    Parameters
    ----------
    residual, difference : list of ndarray, shape (n, channels)
        Measured less the one simulation; the other less the one.
    stage : callable
        (channel, phase, touched channels) -> stage.
    sensors : sequence of sequence of Column
        Of each recording, what one prior std of each sensor's own offset and gain does: of a
        difference counts what they cannot take up.

    Returns
    -------
    tuple of Location
        Strongest first; those that pass the false discovery rate.
    """
    sums: dict[tuple[int, str], Array] = {}
    bands: dict[tuple[int, str], Array] = {}
    for i, (dataset, own, r, d) in enumerate(zip(datasets, noise, residual, difference)):
        phases = dataset.phase_rows()
        for c in range(len(CHANNELS)):
            if not own.sigma[:, c].any() or not np.abs(d[:, c]).max() > 0.0:
                continue
            columns = [one[c].values() for one in sensors[i] if c in one]
            white = own.whiten(np.stack([r[:, c], d[:, c], *columns]), c)
            beyond = _beyond_sensors(white[1], white[2:])
            for word, rows in phases.items():
                key = (c, word)
                w = white[:, rows]
                now = np.array([w[0] @ w[1], w[1] @ w[1], float(rows.sum()),
                                beyond[rows] @ beyond[rows]])
                sums[key] = sums.get(key, np.zeros(4)) + now
                there = own.present[rows, c]
                bands[key] = bands.get(key, np.zeros(len(BANDS))) + _band_energy(
                    w[1, there], 1.0 / (BLOCK * own.spacing(c)))
    tested = sorted(((ndtr(-s[0] / np.sqrt(s[1])), key) for key, s in sums.items()
                     if s[1] > 1e-9), key=lambda one: one[0])
    # a false discovery rate of 1 % (Benjamini and Hochberg)
    kept = max((i for i, (p, _) in enumerate(tested, 1) if p <= 0.01 * i / len(tested)), default=0)
    chosen = [(p, key) for p, key in tested[:kept] if sums[key][1] > 4.0]
    touched = {CHANNELS[c].name for _, (c, _) in chosen if sums[c, _][1] > 25.0}
    found = []
    for p, (c, word) in chosen:
        name = CHANNELS[c].name
        band = BANDS[int(bands[c, word].argmax())]
        s = sums[c, word]
        found.append(Location(stage(name, word, touched), name, word, band,
                              float(np.sqrt(s[3] / s[2])), float(max(p, 1e-300))))
    found.sort(key=lambda place: -place.excess)
    return tuple(found[:40])


def _beyond_sensors(white: Array, columns: Array) -> Array:
    """Take out what columns of unit prior explain, and spread its cost over the rest."""
    x = np.linalg.solve(np.eye(len(columns)) + columns @ columns.T, columns @ white)
    unexplained = white - x @ columns
    energy = float(unexplained @ unexplained)
    return np.asarray(unexplained * np.sqrt(1.0 + float(x @ x) / energy) if energy
                      else unexplained)


def _band_energy(white: Array, rate: float) -> Array:
    """Return the power of a signal in each of BANDS."""
    power = np.abs(np.fft.rfft(white)) ** 2 if len(white) else np.zeros(0)
    return _in_bands(np.arange(len(power)) * rate / max(1, len(white)), power)
