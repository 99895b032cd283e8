"""How far the gap between wrench and motion shrinks: three arms, held out, slow or not."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.gap import DRAWS, Gap
from forcecal_ros.diagnose.motion.case import EVERY, MotionCase
from forcecal_ros.diagnose.motion.model import predict
from forcecal_ros.diagnose.remainder import BANDS, RATE
from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

SLOW = 12.5
"""Slow rows hold what is below [Hz]: there a tool moves as a rigid body."""

WRENCH = range(6)


@dataclass(frozen=True)
class Arms:
    """
    Measured less predicted, in block means, of each recording.

    Attributes
    ----------
    cases : tuple of MotionCase
    nominal, recalibrated, explained : tuple of ndarray, shape (n, 16)
    """

    cases: tuple[MotionCase, ...]
    nominal: tuple[Array, ...]
    recalibrated: tuple[Array, ...]
    explained: tuple[Array, ...]

    @classmethod
    def of(cls, cases: Sequence[MotionCase], *values: Mapping[str, float]) -> 'Arms':
        """Predict with the values of each arm."""
        found = [tuple(np.where(c.present, c.measured - predict(c, v), 0.0) for c in cases)
                 for v in values]
        return cls(tuple(cases), *found)

    def gap(self, *, slow: bool) -> Gap:
        """
        Measure the gap of the wrench on held-out seconds.

        Parameters
        ----------
        slow : bool
            Of slow rows only.

        Returns
        -------
        Gap
        """
        energy, weight = [], []
        for case, *arms in zip(self.cases, self.nominal, self.recalibrated, self.explained):
            rows = [case.slow(a) if slow else a for a in arms]
            held, present = case.held, case.present[:, 0]
            second = np.floor(case.times - case.times[0])
            if slow:
                held, present, second = held[::EVERY], case.present_slow[:, 0], second[::EVERY]
            for s in np.unique(second[held & present]):
                part = held & present & (second == s)
                energy.append([np.sum(r[part, :6] ** 2, axis=0) for r in rows])
                weight.append(float(part.sum()))
        noise = self._noise(slow)
        table, w = np.array(energy), np.array(weight)

        def arms_of(chosen: NDArray[np.intp]) -> tuple[Array, Array]:
            mean = table[chosen].sum(axis=0) / w[chosen].sum()
            rms = np.sqrt(np.maximum(mean - noise ** 2, 0.0))
            return rms, np.sqrt(np.mean((rms / noise) ** 2, axis=1))

        rms, overall = arms_of(np.arange(len(w)))
        draw = np.random.default_rng(0)
        shares = [_closed(arms_of(draw.integers(0, len(w), len(w)))[1]) for _ in range(DRAWS)]
        low, high = np.percentile(shares, [2.5, 97.5])
        channels = {CHANNELS[c].name: (float(rms[0, c]), float(rms[1, c]), float(rms[2, c]),
                                       float(noise[c])) for c in WRENCH}
        return Gap(float(overall[0]), float(overall[1]), float(overall[2]), _closed(overall),
                   (float(low), float(high)), channels)

    def offsets(self) -> Iterator[tuple[str, float, str]]:
        """Yield mean of measured less nominal, of every channel of the wrench."""
        for c in WRENCH:
            rows = np.concatenate([r[k.present[:, c], c] for k, r in zip(self.cases,
                                                                         self.nominal)])
            yield CHANNELS[c].name, float(rows.mean()), CHANNELS[c].unit

    def left(self) -> tuple[float, str]:
        """Return what is left of slow motion in RMS of the noise, and where most is left."""
        slow, full = self.gap(slow=True), self.gap(slow=False)
        ratio = max(v[2] / v[3] for v in slow.channels.values())
        name = max(full.channels, key=lambda n: full.channels[n][2] / full.channels[n][3])
        c = next(i for i in WRENCH if CHANNELS[i].name == name)
        case, rows = self.cases[-1], self.explained[-1]
        moving = rows[(case.groups == 1) & case.present[:, c], c]
        power = np.abs(np.fft.rfft(moving - moving.mean())) ** 2
        frequency = np.fft.rfftfreq(len(moving), 1.0 / RATE)
        low, high = max(BANDS, key=lambda b: float(
            power[(frequency >= b[0]) & (frequency < b[1])].sum()))
        return ratio, (f'{full.channels[name][2]:.2g} {CHANNELS[c].unit} RMS of {name}, most of '
                       f'it between {low:g} and {high:g} Hz')

    def _noise(self, slow: bool) -> Array:
        """RMS at rest about the mean of each second, shape (6,)."""
        parts = []
        for case, rows in zip(self.cases, self.explained):
            rest = (case.groups == 0) & case.present[:, 0]
            second = np.floor(case.times - case.times[0])
            r = case.slow(rows) if slow else rows
            if slow:
                rest, second = rest[::EVERY] & case.present_slow[:, 0], second[::EVERY]
            for s in np.unique(second[rest]):
                part = r[rest & (second == s), :6]
                if len(part) >= (4 if slow else 40):
                    parts.append(part - part.mean(axis=0))
        if not parts:
            parts = [np.diff(r[c.present[:, 0], :6], axis=0) / np.sqrt(2.0)
                     for c, r in zip(self.cases, self.explained)]
        return np.maximum(np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0)), 1e-9)


def _closed(overall: Array) -> float:
    return float(1.0 - overall[2] / overall[1]) if overall[1] > 1e-9 else 0.0
