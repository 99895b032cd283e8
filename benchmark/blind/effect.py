"""What an effect is: a name, where it acts, a range of sizes and one function."""

from collections.abc import Callable
from typing import Any, NamedTuple

from blind.rig import Rig, Stage
import numpy as np


class Effect(NamedTuple):
    """
    One way in which a rig departs from the nominal one.

    Attributes
    ----------
    name : str
    stage : str
        The part of the rig it sits in.
    low, high : float
        Sizes from invisible to gross, in ``unit``.
    unit : str
    apply : callable
        (rig, size, randomness) -> rig. Axes, signs and secondary numbers come from the
        randomness, so that one seed gives one effect at any size.
    nuisance : str
        What it shares a name with among the nuisances, or empty; that one then stays nominal.
    random : bool
        Whether it adds nothing to the mean: noise, stamps, lattice.
    """

    name: str
    stage: str
    low: float
    high: float
    unit: str
    apply: Callable[[Rig, float, np.random.Generator], Rig]
    nuisance: str = ''
    random: bool = False


def sign(rng: np.random.Generator) -> float:
    """Draw -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


def direction(rng: np.random.Generator) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Draw a unit vector."""
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def sensing(rig: Rig, **stages: Stage) -> Rig:
    """Return the rig with one stage more in the named chains of its sensors."""
    sensors = rig.sensors
    longer: dict[str, Any] = {
        name: (*getattr(sensors, name), stage) for name, stage in stages.items()}
    return rig._replace(sensors=sensors._replace(**longer))
