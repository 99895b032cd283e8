"""The signals that are compared: their channels, units and stages; block by block."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from forcecal_ros.core.geometry import Array
from forcecal_ros.sim.signals import JOINTS
import numpy as np
from numpy.typing import NDArray

STAGES = ('robot', 'tool', 'environment', 'wrench_sensor', 'accelerometer', 'pose', 'timing')
"""Stages along the chain from command to sensor; the clocks last."""

STREAM_SLICES = {
    'wrench': slice(0, 6), 'accelerometer': slice(6, 9), 'optidrive': slice(9, 10),
    'pose': slice(10, 16), 'joints': slice(16, 16 + JOINTS),
}
"""Which channels each stream has, by their place in CHANNELS."""


class Channel(NamedTuple):
    """One scalar signal: its name, unit, and the stream it comes from."""

    name: str
    unit: str
    stream: str
    stage: str


CHANNELS = (
    *(Channel(f'force.{a}', 'N', 'wrench', 'wrench_sensor') for a in 'xyz'),
    *(Channel(f'torque.{a}', 'N m', 'wrench', 'wrench_sensor') for a in 'xyz'),
    *(Channel(f'accel.{a}', 'V', 'accelerometer', 'accelerometer') for a in 'xyz'),
    Channel('optidrive', 'm', 'optidrive', 'tool'),
    *(Channel(f'pose.{a}', 'm', 'pose', 'robot') for a in 'xyz'),
    *(Channel(f'pose.r{a}', 'rad', 'pose', 'robot') for a in 'xyz'),
    *(Channel(f'joint.{i}', 'rad', 'joints', 'robot') for i in range(JOINTS)),
)
"""In the order of the columns of every residual."""


def units(accelerometer: str = 'V') -> dict[str, str]:
    """Return every channel's unit, the accelerometer's in what its readings were brought to."""
    return {c.name: accelerometer if c.stream == 'accelerometer' else c.unit for c in CHANNELS}


class Blocks(Protocol):
    """A recording in blocks, of which each phase covers some."""

    @property
    def groups(self) -> NDArray[np.intp]:
        """Say of each block whether it rests (0), moves (1) or is in contact (2)."""

    @property
    def times(self) -> Array:
        """Middle of each block [s]."""

    def phase_rows(self) -> Mapping[str, NDArray[np.bool_]]:
        """Say which blocks each phase word covers."""
