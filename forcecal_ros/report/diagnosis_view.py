"""The data of a diagnosis report, whether made from commands or from measured motion."""

from dataclasses import dataclass

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import fit_autoregression
from forcecal_ros.core.streams import Phase
from forcecal_ros.diagnose.dataset import Blocks, CHANNELS, units
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.localise import time_frequency_bins, TimeFrequencyBin
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.report.panels import joined
from forcecal_ros.sim.signals import JOINTS, Signals
import numpy as np
from numpy.typing import NDArray

SEEN = 4.0
"""Standard deviations above which a time-frequency bin is coloured."""

FAINT = 0.05
"""Excess, in noise RMS, below which a bin is not worth looking at however sure it is."""

LOOKED_AT = 2.0
"""What is shown at most of a phase that is twice as long [s]: some 500 block means."""

PERIODS = 8
"""Of the lowest frequency of a band, that are seen at first: of the highest they are some twenty,
each of 15 px on a phone."""

_INDEX = {c.name: i for i, c in enumerate(CHANNELS)}


@dataclass(frozen=True)
class View:
    """
    A diagnosis and the signals of the recording it was judged on, in block means.

    Attributes
    ----------
    advice : str
        What to record next; empty where nothing is missing.
    units : dict of str to str
        Of the channels.
    times : ndarray, shape (n,)
    groups : ndarray of int, shape (n,)
        0 at rest.
    present : ndarray of bool, shape (n, channels)
    measured : ndarray, shape (n, channels)
    nominal, recalibrated, explained : ndarray, shape (n, channels)
        Measured less simulated.
    cells : tuple of Cell
        Excess of the recalibrated residual.
    """

    diagnosis: Diagnosis
    advice: str
    units: dict[str, str]
    times: Array
    phases: tuple[Phase, ...]
    groups: NDArray[np.intp]
    present: NDArray[np.bool_]
    measured: Array
    nominal: Array
    recalibrated: Array
    explained: Array
    cells: tuple[TimeFrequencyBin, ...]

    def focus(self) -> TimeFrequencyBin | None:
        """Return the place that the verdict speaks of, the strongest; None where all is noise."""
        for w in self.diagnosis.localisation:
            if any(p.name == w.phase for p in self.phases):
                return TimeFrequencyBin(_INDEX[w.channel], w.phase, w.band_hz, w.excess, SEEN)
        if self.diagnosis.verdict == 'no_gap':
            return None
        return max((c for c in self.cells if c.z > SEEN and c.excess > FAINT),
                   key=lambda c: c.z, default=None)

    def span(self) -> Phase | None:
        """Return when the misfit of the focus is largest: a phase, or the worst part of it."""
        place = self.focus()
        return None if place is None else self._worst(place.channel, [
            part for phase in joined(self.phases) if phase.name == place.phase
            for part in _parts(phase, LOOKED_AT)])

    def closer(self) -> Phase | None:
        """Return the worst part of that span, so short that single periods show; None: all."""
        span, place = self.span(), self.focus()
        if span is None or place is None or place.band[0] <= 0.0:
            return None
        parts = _parts(span, PERIODS / place.band[0])
        return self._worst(place.channel, parts) if len(parts) > 1 else None

    def _worst(self, channel: int, parts: list[Phase]) -> Phase | None:
        """Return the part of the largest misfit."""
        square = np.where(self.present[:, channel], self.recalibrated[:, channel] ** 2, 0.0)
        total = np.concatenate([[0.0], np.cumsum(square)])

        def misfit(part: Phase) -> float:
            first, last = np.searchsorted(self.times, [part.start, part.end])
            return float(total[last] - total[first])

        return max(parts, key=misfit, default=None)

    def channels(self, count: int) -> list[int]:
        """Return the channels that changed most or, where none did, the first ones."""
        place = self.focus()
        listed = [] if place is None else [place.channel]
        listed += [_INDEX[w.channel] for w in self.diagnosis.localisation]
        listed += [i for i in range(len(CHANNELS)) if self.present[:, i].any()]
        return list(dict.fromkeys(listed))[:count]


def _parts(phase: Phase, length: float) -> list[Phase]:
    """Cut a phase that is twice as long as ``length``, or longer, into parts that overlap."""
    halves = int((phase.end - phase.start) / (0.5 * length))
    if halves < 4:
        return [phase]
    starts = np.linspace(phase.start, phase.end - length, halves)
    return [Phase(phase.name, float(start), float(start) + length) for start in starts]


def view_without_signals(diagnosis: Diagnosis) -> View:
    """Show a diagnosis of data that cannot answer: what its verdict says is all there is."""
    nothing = np.zeros((0, len(CHANNELS)))
    return View(diagnosis, '', units(), np.zeros(0), (), np.zeros(0, np.intp),
                np.zeros(nothing.shape, np.bool_), nothing, nothing, nothing, nothing, ())


def view_of(outcome: Outcome, advice: str, of_channels: dict[str, str]) -> View:
    """
    Show a diagnosis.

    Parameters
    ----------
    outcome : Outcome
        With cases.
    of_channels : dict of str to str
        Their units.
    """
    dataset = outcome.datasets[-1]
    present = dataset.measured.present
    nominal = dataset.measured.residual(dataset.nominal)
    measured = np.where(present, _means(dataset.nominal, len(dataset.groups)) + nominal, np.nan)
    return View(outcome.diagnosis, advice, of_channels, dataset.times, dataset.phases,
                dataset.groups, present, measured, nominal, outcome.recalibrated[-1],
                outcome.explained[-1],
                _cells(dataset, present, outcome.recalibrated[-1], outcome.explained[-1]))


def _cells(dataset: Blocks, present: NDArray[np.bool_], before: Array, after: Array
           ) -> tuple[TimeFrequencyBin, ...]:
    noise = fit_autoregression(after, present, dataset.groups)
    return tuple(time_frequency_bins(dataset, noise, before))


def _means(s: Signals, n: int) -> Array:
    """Block means of what noise-free sensors say; turns, which are differences, as zero."""
    length, joints = len(s.wrench), s.joints
    rows = np.concatenate([s.wrench, s.volts, s.optidrive[:, np.newaxis], s.position,
                           np.zeros((length, 3)),
                           np.zeros((length, JOINTS)) if joints is None else joints], axis=1)
    return np.asarray(rows.reshape(n, -1, rows.shape[1]).mean(axis=1))
