"""Effects that act for a part of the time: from an instant on, or until one."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS, MeasuredBlocks, STREAM_SLICES
from forcecal_ros.diagnose.model.jacobian import Column, Compact
from forcecal_ros.effects import Effect, Quantity
from forcecal_ros.effects.nuisances import Nuisance
from forcecal_ros.effects.rig import Rig
import numpy as np

BIAS = Effect('wrench_bias_step', 'wrench_sensor', (
    *(Quantity(name, 'N', 0.0, -1e3, 1e3, 1.0) for name in ('fx', 'fy', 'fz')),
    *(Quantity(name, 'N m', 0.0, -1e2, 1e2, 0.05) for name in ('tx', 'ty', 'tz'))),
    ('measure', 'contact'), True, 'signal', 'wrench.bias')
"""A bias that is there for a part of the time; one for all of it is a nuisance."""


def kind_of(name: str) -> str:
    """Return the effect that a name stands for: a recording may have several bias steps."""
    return BIAS.name if name.startswith(BIAS.name) else name


class Gate(NamedTuple):
    """
    When an effect acts.

    Attributes
    ----------
    recording : int
        In which it begins or ends; with neither, the only one it acts in.
    instant : float or None
        When it does, on that recording's clock [s].
    ends : bool
        Whether it ends there; else it begins.
    elsewhere : bool
        Whether it acts in the other recordings.
    """

    recording: int
    instant: float | None = None
    ends: bool = False
    elsewhere: bool = False

    def acts_in(self, recording: int) -> bool:
        """Whether it acts at some time in a recording."""
        return self.elsewhere or recording == self.recording

    def lasts(self, recordings: int) -> bool:
        """Whether it acts at the end of the last of some recordings."""
        return not self.ends if self.recording == recordings - 1 else self.elsewhere

    def rows(self, measured: MeasuredBlocks, recording: int) -> Array:
        """Return the part of each block's samples that it acts in, shape (n_blocks, channels)."""
        if recording != self.recording:
            return np.full((measured.n_blocks, len(CHANNELS)), float(self.elsewhere))
        out = np.zeros((measured.n_blocks, len(CHANNELS)))
        for name in measured.streams:
            later = (np.ones(measured.n_blocks) if self.instant is None
                     else measured.since(name, self.instant))
            acts = 1.0 - later if self.ends else later
            out[:, STREAM_SLICES[name]] = acts[:, np.newaxis]
        return out


def gated(one: Column, rows: Array) -> Column:
    """Let a column of one recording act for a part of the time only."""
    return {c: signal if rows[:, c].min() == 1.0
            else Compact.of(signal.values() * rows[:, c])
            for c, signal in one.items() if rows[:, c].any()}


def nuisances_of(nuisances: Sequence[Nuisance], effect: Effect) -> list[int]:
    """List the nuisances, by position, whose departure beyond their tolerance an effect is."""
    if effect.name == BIAS.name:
        return [i for i, n in enumerate(nuisances) if n.name.startswith('wrench.bias.')]
    return [i for i, n in enumerate(nuisances) if n.key == effect.nuisance]


def physical(rig: Rig, key: str, unit: str) -> float:
    """Turn a nuisance's departure, relative where its prior is, into an effect's unit."""
    relative = {'mass': rig.tool.mass, 'wall_stiffness': rig.wall.stiffness,
                'wall_damping': rig.wall.damping}
    if rig.optidrive is not None:
        relative |= {'stiffness': rig.optidrive.stiffness, 'damping': rig.optidrive.damping}
    return relative.get(key, 1.0) if unit != '1' else 1.0


def departed(rig: Rig, own: Sequence[Nuisance], effect: Effect, values: Mapping[str, float]
             ) -> Rig:
    """Give a rig an effect that is a departure of nuisances."""
    for n, q in zip(own, effect.parameters):
        away = values.get(q.name, q.nominal) - q.nominal
        if away:
            rig = n.apply(rig, away / physical(rig, n.key, q.unit))
    return rig
