"""From samples of the chain to block means, whatever tool the chain takes off by now."""

from collections.abc import Sequence

from forcecal_ros.observe import status as st
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.motion import carried, gravity_in_sensor, MotionEstimate
from forcecal_ros.observe.payload.model import Block
from forcecal_ros.observe.sample import ContactSample
import numpy as np

DURATION = 0.05
"""Of a block: vibrations average out over it, and a payload is heard of after eight [s]."""

LONGEST = 0.5
"""A block that spans more has a gap, and is left out: a tool may turn far in it [s]."""

FEWEST = 4
"""Samples that a scatter is taken from; slower sensors have longer blocks."""

UNUSABLE = st.INVALID | st.NO_POSE | st.SATURATED
"""Status of a sample that says nothing about the tool."""


def usable(sample: ContactSample) -> bool:
    """Whether a sample says anything about the tool."""
    return not sample.status & UNUSABLE


def row_of(sample: ContactSample, motion: MotionEstimate, s: float, model: Model
           ) -> tuple[float, ...]:
    """
    Return what a block is made of: 26 numbers.

    Stamp, reading (6), specific force at the tool's origin (3), gravity, omega, alpha (3 each),
    s, ``measured`` (6). In the reading, bias and load are put back on, so that it makes no
    difference which tool the model has.
    """
    rotation, load = motion.rotation, model.load
    h = sample.t - rotation.t
    (wx, wy, wz), (ax, ay, az) = rotation.omega, rotation.alpha
    wx, wy, wz = wx + h * ax, wy + h * ay, wz + h * az
    down = carried(gravity_in_sensor(rotation.q, model.gravity), (wx, wy, wz), h)
    i0, i1, i2 = sample.inertial[:3]
    m, x, y, z = load.m, load.cx, load.cy, load.cz
    w2, wc = wx * wx + wy * wy + wz * wz, wx * x + wy * y + wz * z
    return (sample.t,
            *(a + b + c for a, b, c in zip(sample.measured, sample.inertial, model.bias)),
            -i0 / m - (ay * z - az * y + wx * wc - w2 * x),
            -i1 / m - (az * x - ax * z + wy * wc - w2 * y),
            -i2 / m - (ax * y - ay * x + wz * wc - w2 * z),
            *down, wx, wy, wz, ax, ay, az, s, *sample.measured)


def is_full(rows: Sequence[tuple[float, ...]]) -> bool:
    """Whether rows make a block."""
    return len(rows) >= FEWEST and rows[-1][0] - rows[0][0] >= DURATION


def block_of(rows: Sequence[tuple[float, ...]]) -> Block | None:
    """Average rows; None where there is a gap among them."""
    table = np.array(rows)
    duration = float(table[-1, 0] - table[0, 0])
    if duration > LONGEST:
        return None
    means = table.mean(axis=0)
    return Block(float(table[-1, 0]), duration, means[1:7], table[:, 20:].var(axis=0) / len(rows),
                 means[7:10], means[10:13], means[13:16], means[16:19], float(means[19]))
