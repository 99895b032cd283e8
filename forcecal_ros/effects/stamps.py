"""Effects on stamps and arrival: clocks that run fast or slow, samples that get lost."""

from forcecal_ros.effects.chosen import named_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

STREAMS = ('wrench', 'accelerometer', 'optidrive', 'pose')


class StampEffects:
    """
    What a rig's effects do to the stamps of its sensors' samples.

    Parameters
    ----------
    seed : numpy.random.SeedSequence
        Of the losses; those of one stream do not depend on the others.
    """

    def __init__(self, rig: Rig, seed: np.random.SeedSequence) -> None:
        named = named_effects(rig.effects)
        self._skew = named.get('clock_skew', {})
        self._lost = named.get('dropouts', {})
        self._generators = dict(zip(STREAMS, map(
            np.random.default_rng, seed.spawn(len(STREAMS)))))

    @property
    def loses(self) -> bool:
        """Whether anything gets lost."""
        return any(self._lost.values())

    def stamps(self, stream: str, t: Array) -> Array:
        """Return what the stream's clock says at times since the start [s]."""
        return t * (1.0 + self._skew.get(stream, 0.0))

    def arrived(self, stream: str, n: int) -> NDArray[np.bool_]:
        """Say which of the next n samples arrive."""
        fraction = self._lost.get(stream, 0.0)
        return np.asarray(self._generators[stream].random(n) >= fraction)
