"""Faults of single sensors, switched on and off while the rig runs: failure injection.

An effect of the library is how a rig departs from its model; a fault is what is not modelled. Both
the ``sim`` node and recordings made offline take them from here.
"""

from collections.abc import Callable
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.sim.rig.simulator import Samples, SIGNALS
import numpy as np
from numpy.typing import NDArray

SENSORS = tuple(SIGNALS)

FAULTS = {
    'none': 'healthy',
    'off': 'publishes nothing',
    'stuck': 'repeats its last reading, freshly stamped',
    'garbage': 'random numbers, one reading in ten is NaN',
    'wrong': 'plausible, but shifted by a constant',
    'slow': 'one sample in twenty',
    'delayed': 'arrives 0.3 s late, correctly stamped',
    'intermittent': 'silent for 0.1 s in every 0.3 s',
}
"""What a sensor can be made to do, by the word that switches it on."""

OFFSETS = {'wrench': (20.0, 20.0, 20.0, 2.0, 2.0, 2.0), 'volts': 0.5, 'specific_force': 2.0,
           'optidrive': 0.005, 'position': 0.03, 'R_base_sensor': 0.0}
"""Error of a wrong sensor [N, N m], [V], [m/s^2], [m]; a pose keeps its orientation."""

RUNAWAY = 0.5
"""Speed of a robot that runs away, towards its base [m/s]."""

ROBOT_FAULTS = {'none': 'follows its commands', 'stuck': 'does not move',
                'runaway': f'moves at {RUNAWAY:g} m/s towards its base'}
"""What a robot can be made to do, by the word that switches it on."""

CLOCK_FAULTS = {'none': 'runs', 'stopped': 'stops', 'forward': 'jumps 0.5 s ahead, once',
                'back': 'jumps 0.5 s back, once'}
"""What a clock of the simulator's own can be made to do."""

CLOCK_JUMP = 0.5
"""Jump of a faulty clock [s]."""


class _Block(NamedTuple):
    """Samples of one sensor: stamps, and the fields that go with them by name."""

    t: Array
    fields: dict[str, Array]

    def where(self, chosen: NDArray[np.bool_]) -> '_Block':
        return _Block(self.t[chosen], {k: v[chosen] for k, v in self.fields.items()})

    def after(self, before: '_Block | None') -> '_Block':
        if before is None:
            return self
        return _Block(np.concatenate([before.t, self.t]), {
            k: np.concatenate([before.fields[k], v]) for k, v in self.fields.items()})


class SensorFault:
    """
    The fault of one sensor, none to begin with.

    Parameters
    ----------
    sensor : str
        One of ``SENSORS``.
    seed : int, optional
        Of garbage.

    Attributes
    ----------
    kind : str
        One of ``FAULTS``; may be changed at any time.
    """

    def __init__(self, sensor: str, seed: int | None = None) -> None:
        self.sensor, self.kind = sensor, 'none'
        self._rng = np.random.default_rng(seed)
        self._last: _Block | None = None
        self._held: _Block | None = None
        self._count = 0
        # silence and cycle: an intermittent sensor is silent for the first part of each cycle [s]
        self._ways: dict[str, Callable[[_Block], _Block]] = {
            'off': lambda block: block.where(block.t != block.t),
            'stuck': self._stuck, 'garbage': self._garbage, 'wrong': self._wrong,
            'slow': self._slow, 'delayed': self._delayed,
            'intermittent': lambda block: block.where(block.t % 0.3 >= 0.1)}

    def __call__(self, samples: Samples) -> Samples:
        """Pass on the next samples of all sensors, those of this one as it reports them."""
        stamps, *names = SIGNALS[self.sensor]
        block = self.block(_Block(getattr(samples, stamps),
                                  {name: getattr(samples, name) for name in names}))
        return samples._replace(**{stamps: block.t}, **block.fields)

    def block(self, block: _Block) -> _Block:
        """Return what the sensor reports instead of its next samples."""
        if self.kind != 'delayed':
            self._held = None
        if self.kind != 'none':
            return self._ways[self.kind](block)
        if len(block.t):
            self._last = block.where(block.t == block.t[-1])
        return block

    def _stuck(self, block: _Block) -> _Block:
        if self._last is None:
            self._last = block.where(np.arange(len(block.t)) == 0)
        return _Block(block.t, {k: np.repeat(v, len(block.t), axis=0)
                                for k, v in self._last.fields.items()})

    def _garbage(self, block: _Block) -> _Block:
        fields = dict(block.fields)
        for name, values in block.fields.items():
            if name != 'R_base_sensor':
                size = 10.0 ** self._rng.uniform(-3.0, 9.0, values.shape)
                size[self._rng.random(len(values)) < 0.1] = np.nan
                fields[name] = size * self._rng.choice([-1.0, 1.0], values.shape)
        return _Block(block.t, fields)

    def _wrong(self, block: _Block) -> _Block:
        return _Block(block.t, {k: v + np.asarray(OFFSETS[k]) for k, v in block.fields.items()})

    def _slow(self, block: _Block) -> _Block:
        index = self._count + np.arange(len(block.t))
        self._count += len(block.t)
        # a slow sensor delivers one sample in this many
        return block.where(index % 20 == 0)

    def _delayed(self, block: _Block) -> _Block:
        """Hold back what is younger than the delay, counted from the newest sample."""
        block = block.after(self._held)
        # lateness of a delayed sensor [s]
        due = block.t <= (block.t[-1] if len(block.t) else 0.0) - 0.3
        self._held = block.where(~due)
        return block.where(due)


class RobotFault:
    """
    What a robot can be made to do in addition to following its commands.

    Attributes
    ----------
    kind : str
        One of ``ROBOT_FAULTS``; may be changed at any time.
    """

    def __init__(self) -> None:
        self.kind = 'none'
        self._away = 0.0

    def __call__(self, position: Array, period: float) -> Array | None:
        """Return where the robot goes instead of ``position`` (3,) [m]; None: no place."""
        if self.kind == 'stuck':
            return None
        self._away = self._away + RUNAWAY * period if self.kind == 'runaway' else 0.0
        return np.asarray(position) - [self._away, 0.0, 0.0]
