"""Noise that is not what textbooks have: 1/f, heavy tails, louder in motion, bursts."""

from collections.abc import Mapping
from typing import NamedTuple

from blind.noise import Colour, COLOURS
from blind.robot import Array
import numpy as np
from scipy.signal import lfilter, zpk2tf

POLES = (0.05, 0.5, 5.0, 50.0)
"""Of 1/f noise above a white floor, a zero half a decade above each [Hz]."""


class Rough(NamedTuple):
    """
    Noise of one channel.

    Attributes
    ----------
    colour : Colour
    tail : float
        Degrees of freedom of Student's t; 0: normal.
    shaken : float
        By how much louder it is at the largest acceleration, relative.
    bursts, length, size : float
        How many a sample, how long [samples], how many times louder.
    """

    colour: Colour
    tail: float = 0.0
    shaken: float = 0.0
    bursts: float = 0.0
    length: float = 1.0
    size: float = 1.0

    def draw(self, count: int, sigma: float, rng: np.random.Generator,
             loud: Array | None = None) -> Array:
        """Return ``count`` samples, whose mean level is that of the colour."""
        white = rng.standard_normal(count)
        if self.tail:
            white = rng.standard_t(self.tail, count) / np.sqrt(self.tail / (self.tail - 2))
        gain = np.ones(count)
        if loud is not None and loud.max() > 0.0:
            gain += self.shaken * loud / loud.max()
        for start in np.flatnonzero(rng.random(count) < self.bursts):
            gain[start:start + int(self.length)] *= self.size
        noise = lfilter(self.colour.b, self.colour.a, white)
        return np.asarray(self.colour.level * sigma * noise * gain / np.sqrt(np.mean(gain**2)))

    def whiten(self, signal: Array, sigma: float) -> Array:
        """Return the signal in units of the noise at its mean level."""
        return self.colour.whiten(signal, sigma)


def _pink(rate: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a filter whose power falls as 1/f up to a floor, which a draw raises."""
    top = rng.uniform(0.2, 1.0)
    poles = np.exp(-2 * np.pi * top * np.array(POLES) / rate)
    zeros = np.exp(-2 * np.pi * top * np.sqrt(10.0) * np.array(POLES) / rate)
    b, a = zpk2tf(zeros, poles, 1.0)
    return b, a


def draw_noise(rng: np.random.Generator, sigmas: Mapping[str, Array],
               rates: Mapping[str, float]) -> dict[str, list[Rough]]:
    """Draw noise for each channel of each topic; what is odd about it is common to a case."""
    tail = float(rng.uniform(3.0, 8.0)) if rng.random() < 1 / 3 else 0.0
    shaken = float(rng.uniform(0.3, 2.0)) if rng.random() < 1 / 3 else 0.0
    bursts = float(rng.uniform(0.05, 0.5)) if rng.random() < 1 / 3 else 0.0
    length, size = float(np.exp(rng.uniform(np.log(0.02), np.log(0.2)))), rng.uniform(3.0, 10.0)
    found: dict[str, list[Rough]] = {}
    for name, sigma in sigmas.items():
        rate, pink = rates[name], rng.random() < 0.5
        shape = COLOURS[rng.integers(len(COLOURS))]
        level = float(np.exp(np.clip(rng.normal(0.0, np.log(2.0)), np.log(0.4), np.log(2.5))))
        found[name] = []
        for _ in sigma:
            b, a = _pink(rate, rng) if pink else shape(rng)
            impulse = lfilter(b, a, np.eye(1, 20000)[0])
            each = level * float(np.exp(rng.normal(0.0, 0.1)))
            found[name].append(Rough(
                Colour(each, np.asarray(b) / np.sqrt(np.sum(impulse**2)), np.asarray(a)), tail,
                shaken, bursts / rate, length * rate, float(size)))
    return found


def quirks(noise: Mapping[str, list[Rough]]) -> dict[str, float]:
    """Return what is odd about the noise of a case."""
    one = next(iter(noise.values()))[0]
    return {'tail': one.tail, 'shaken': one.shaken, 'bursts': one.bursts, 'size': one.size}
