"""The signals that are compared: their channels, units, and the stage that makes them."""

from typing import NamedTuple

STAGES = ('robot', 'tool', 'environment', 'wrench_sensor', 'accelerometer', 'pose', 'timing')
"""Along the chain from command to sensor; the clocks last."""


JOINTS = 8
"""Joints whose positions can be compared: an arm of seven, and the rail that it stands on."""


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

COLUMNS = {
    'wrench': slice(0, 6), 'accelerometer': slice(6, 9), 'optidrive': slice(9, 10),
    'pose': slice(10, 16), 'joints': slice(16, 16 + JOINTS),
}
"""Columns of each stream."""

BLOCK = 0.004
"""Length of the means that are compared [s]."""


def units(accelerometer: str = 'V') -> dict[str, str]:
    """Return every channel's unit, the accelerometer's in what its readings were brought to."""
    return {c.name: accelerometer if c.stream == 'accelerometer' else c.unit for c in CHANNELS}
