"""Where the misfit is: stage, channel, phase and octave, each with its significance."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import Autoregression
from forcecal_ros.diagnose.inputs.channels import Blocks, CHANNELS
from forcecal_ros.diagnose.localise.time_frequency import BANDS, RATE
from forcecal_ros.diagnose.model.jacobian import Column
import numpy as np
from scipy.special import ndtr

DISCOVERY = 0.01
"""False discovery rate (Benjamini and Hochberg)."""

MOST = 40
"""Locations that are reported, at most."""


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


def localise(datasets: Sequence[Blocks], noise: list[Autoregression], residual: list[Array],
             difference: list[Array], stage: Callable[[str, str, set[str]], str],
             sensors: Sequence[Sequence[Column]] = ()) -> tuple[Location, ...]:
    """
    Locate what a difference between two simulations explains.

    Parameters
    ----------
    residual, difference : list of ndarray, shape (n, channels)
        Measured less the one simulation; the other less the one.
    stage : callable
        (channel, phase, touched channels) -> stage.
    sensors : sequence of sequence of Column, optional
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
            columns = [one[c].values() for one in (sensors[i] if sensors else ()) if c in one]
            white = own.whiten(np.stack([r[:, c], d[:, c], *columns]), c)
            beyond = _beyond(white[1], white[2:])
            for word, rows in phases.items():
                key = (c, word)
                w = white[:, rows]
                now = np.array([w[0] @ w[1], w[1] @ w[1], float(rows.sum()),
                                beyond[rows] @ beyond[rows]])
                sums[key] = sums.get(key, np.zeros(4)) + now
                there = own.present[rows, c]
                bands[key] = bands.get(key, np.zeros(len(BANDS))) + _bands(
                    w[1, there], RATE / own.spacing(c))
    tested = sorted(((ndtr(-s[0] / np.sqrt(s[1])), key) for key, s in sums.items()
                     if s[1] > 1e-9), key=lambda one: one[0])
    kept = 0
    for i, (p, _) in enumerate(tested):
        if p <= DISCOVERY * (i + 1) / len(tested):
            kept = i + 1
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
    return tuple(found[:MOST])


def _beyond(white: Array, columns: Array) -> Array:
    """Take out what columns of unit prior explain, and spread its cost over the rest."""
    x = np.linalg.solve(np.eye(len(columns)) + columns @ columns.T, columns @ white)
    unexplained = white - x @ columns
    energy = float(unexplained @ unexplained)
    return np.asarray(unexplained * np.sqrt(1.0 + float(x @ x) / energy) if energy
                      else unexplained)


def _bands(white: Array, rate: float) -> Array:
    if not len(white):
        return np.zeros(len(BANDS))
    power = np.abs(np.fft.rfft(white)) ** 2
    frequency = np.arange(len(power)) * rate / len(white)
    return np.array([power[(frequency >= low) & (frequency < high)].sum()
                     for low, high in BANDS])
