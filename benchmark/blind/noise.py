"""Noise of many colours; each is a known filter of white noise, so that it can be whitened."""

from typing import NamedTuple

from blind.robot import Array
import numpy as np
from scipy.signal import lfilter

SIGMA = {'wrench': np.array([0.25, 0.25, 0.25, 0.02, 0.02, 0.02]), 'volts': np.full(3, 0.010),
         'slide': np.full(1, 20e-6), 'position': np.full(3, 20e-6), 'turn': np.full(3, 20e-6)}
"""1 sigma of each channel on the nominal rig, white."""


class Colour(NamedTuple):
    """Of one channel: level relative to nominal, and the filter b / a that makes it unit."""

    level: float
    b: Array
    a: Array

    def draw(self, count: int, sigma: float, rng: np.random.Generator,
             loud: Array | None = None) -> Array:
        """Return ``count`` samples; ``loud`` is for noise that depends on the motion."""
        white = rng.standard_normal(count)
        return np.asarray(self.level * sigma * lfilter(self.b, self.a, white))

    def whiten(self, signal: Array, sigma: float) -> Array:
        """Return the signal in units in which this noise is white with 1 sigma."""
        out: Array = lfilter(self.a, self.b, signal, axis=0) / (self.level * sigma)
        return out


def _white(rng: np.random.Generator) -> tuple[Array, Array]:
    return np.ones(1), np.ones(1)


def _red(rng: np.random.Generator) -> tuple[Array, Array]:
    return np.ones(1), np.array([1.0, -rng.uniform(0.2, 0.8)])


def _blue(rng: np.random.Generator) -> tuple[Array, Array]:
    return np.array([1.0, -rng.uniform(0.2, 0.7)]), np.ones(1)


def _floor_and_red(rng: np.random.Generator) -> tuple[Array, Array]:
    pole = rng.uniform(0.9, 0.97)
    return np.array([1.0, -pole + rng.uniform(0.05, 0.2)]), np.array([1.0, -pole])


def _hump(rng: np.random.Generator) -> tuple[Array, Array]:
    radius, angle = rng.uniform(0.5, 0.8), rng.uniform(0.3, 2.5)
    return np.ones(1), np.array([1.0, -2 * radius * np.cos(angle), radius**2])


COLOURS = (_white, _red, _blue, _floor_and_red, _hump)


def draw_colours(rng: np.random.Generator) -> dict[str, list[Colour]]:
    """Draw a level (a factor of 2, 1 sigma, within 0.4 to 2.5) and a colour for each channel."""
    colours: dict[str, list[Colour]] = {}
    for name, sigma in SIGMA.items():
        shape = COLOURS[rng.integers(len(COLOURS))]
        level = float(np.exp(np.clip(rng.normal(0.0, np.log(2.0)), np.log(0.4), np.log(2.5))))
        colours[name] = []
        for _ in sigma:
            b, a = shape(rng)
            impulse = lfilter(b, a, np.eye(1, 4000)[0])
            scale = 1.0 / np.sqrt(np.sum(impulse**2))
            each = level * float(np.exp(rng.normal(0.0, 0.1)))
            colours[name].append(Colour(each, b * scale, a))
    return colours
