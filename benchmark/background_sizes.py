"""Effects of the library in forms of their own, at the size that has a wanted energy."""

from collections.abc import Callable, Mapping
from typing import Any

from forcecal_ros.core.streams import Recording
from forcecal_ros.effects import EFFECTS, Quantity
from forcecal_ros.effects.rig import Rig
import numpy as np

CERTAIN = 3.5
"""Tolerances that an effect of a nuisance's name departs by, to which the sized part is added."""

LATE = ('wrench_saturation', 'accel_saturation')
"""Effects on readings, noise and background included."""

LOWEST = 1.0
"""How far a limit falls below the largest value, as a logarithm."""

CLOSE = 0.03
"""Relative error of an effect's energy that is close enough."""


Sizes = Callable[[float], dict[str, float]]


def shape_of(name: str, rig: Rig, clean: Recording, rng: np.random.Generator) -> Sizes:
    """
    Draw the form of an effect: its values by one scale, which does nothing at 0.

    Parameters
    ----------
    name : str
    rig : Rig
    clean : Recording
    rng : numpy.random.Generator
    """
    effect = EFFECTS[name]
    if name in LATE:
        return _clipping(name, rig, clean, rng)
    shapes = {q.name: _formed(q, rng) for q in effect.parameters if q.shapes}
    sized = [q for q in effect.parameters if not q.shapes]
    chosen = [sized[i] for i in rng.permutation(len(sized))[:rng.integers(1, 4)]]
    weights = [_sign(q, rng) * rng.uniform(0.4, 1.0) for q in chosen]
    least = CERTAIN * getattr(rig.spreads, effect.nuisance) if effect.nuisance else 0.0

    def values(scale: float) -> dict[str, float]:
        return shapes | {q.name: float(q.nominal + w * scale * (q.typical - q.nominal)
                                       + np.sign(w) * least) for q, w in zip(chosen, weights)}

    return values


def _sign(q: Quantity, rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0])) if -q.low >= 0.5 * q.high or q.name == 'change' else 1.0


def _formed(q: Quantity, rng: np.random.Generator) -> float:
    """Draw a parameter that only shapes its effect, near one of its starts."""
    usual = float(rng.choice(q.starts))
    if q.name.startswith('point_'):
        return usual + 0.02 * float(rng.standard_normal())
    if q.name in ('before', 'softness', 'grounded', 'second_order'):
        return usual
    return float(np.clip(usual * np.exp(0.2 * rng.standard_normal()), q.low, q.high))


def _clipping(name: str, rig: Rig, clean: Recording, rng: np.random.Generator) -> Sizes:
    """Clip one axis of the forces or of the accelerometer, from its largest value down."""
    axis = int(rng.integers(0, 3))
    if name == 'wrench_saturation':
        values, word = clean.wrench.values[:, axis], ('fx', 'fy', 'fz')[axis]
    else:
        model = rig.accelerometer.model()
        volts = clean.accelerometer.values[:, axis]
        values, word = (volts - model.offset[axis]) / model.gain[axis], 'xyz'[axis]
    top = float(np.abs(values).max())
    return lambda scale: {word: top * float(np.exp(-min(scale, LOWEST)))}


def _inside(name: str, values: Mapping[str, float]) -> bool:
    """Say whether no parameter goes further than half-way to its limits."""
    for q in EFFECTS[name].parameters:
        value = values.get(q.name, q.nominal)
        limit = q.high if value > q.nominal else q.low
        if not q.shapes and name not in LATE and abs(value - q.nominal) > 0.5 * abs(
                limit - q.nominal):
            return False
    return True


def sized(name: str, shape: Sizes, ground: Any, energy: float
          ) -> tuple[dict[str, float], float]:
    """
    Find the values at which an effect has an energy, or the largest that its limits allow.

    Parameters
    ----------
    name : str
    shape : callable
        Scale -> values.
    ground : Ground or background_kuka.Arm
    energy : float

    Returns
    -------
    values : dict of str to float
    energy : float
        Theirs, net of the nuisances.
    """
    nuisance = EFFECTS[name].nuisance
    at_rest = ground.departure({name: shape(0.0)}) if nuisance else 0.0
    best, scale, slope = (shape(0.0), 0.0), 0.1, 2.0
    before: tuple[float, float] | None = None
    for _ in range(9):
        while not _inside(name, shape(scale)):
            scale *= 0.8
        with np.errstate(all='ignore'):
            found = ground.net(ground.departure({name: shape(scale)}) - at_rest, nuisance)
        if not np.isfinite(found) or found > 1e12:
            scale *= 0.3
            continue
        if abs(np.log(max(found, 1e-9) / energy)) < abs(np.log(max(best[1], 1e-9) / energy)):
            best = (shape(scale), found)
        if abs(found / energy - 1.0) < CLOSE:
            break
        slope = _slope(before, (scale, found), slope)
        if found > 0.0:
            before = (scale, found)
        factor = (energy / max(found, 1e-9)) ** (1.0 / slope)
        wanted = scale * float(np.clip(factor, 0.01, 100.0))
        if wanted > scale and not _inside(name, shape(scale * 1.02)):
            break
        scale = wanted
    return best


def _slope(before: tuple[float, float] | None, now: tuple[float, float], usual: float) -> float:
    """Return the power by which the energy grows with the scale, from two of them."""
    if not before or now[1] <= 0.0 or now[0] == before[0]:
        return usual
    own = np.log(now[1] / before[1]) / np.log(now[0] / before[0])
    return float(np.clip(own, 0.7, 6.0)) if np.isfinite(own) else 2.0
