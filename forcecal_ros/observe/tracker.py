"""The payload along a running chain: samples in, blocks, an estimate out."""

from collections.abc import Sequence
from math import nan

from forcecal_ros.observe import sample as st
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.motion import carried, gravity_in_sensor, MotionEstimate
from forcecal_ros.observe.payload import (
    begin,
    Block,
    Change,
    estimate,
    FROZEN,
    on_block,
    PayloadModel,
    ToolEstimate,
    TRACKING,
)
from forcecal_ros.observe.sample import ContactSample
from forcecal_ros.observe.step import State
import numpy as np

UNUSABLE = st.INVALID | st.NO_POSE | st.SATURATED
"""Status of a sample that shows nothing about the tool."""


class Tracker:
    """
    What hangs on the sensor, followed beside a chain.

    Attributes
    ----------
    model : PayloadModel
    latest : ToolEstimate
        Of the last block.
    announced : ToolEstimate
        What :meth:`news` returned last.
    """

    def __init__(self, model: PayloadModel) -> None:
        self.model = model
        self.restart()

    def restart(self) -> None:
        """Believe in the calibrated tool again."""
        self._state = begin(self.model)
        self._rows: list[tuple[float, ...]] = []
        self._newest = nan
        self.latest = self.announced = estimate(self._state, self.model)

    def take(self, sample: ContactSample, state: State, model: Model) -> ToolEstimate | None:
        """Take in a sample of the chain, and what the chain was then; None between blocks."""
        self._newest = sample.t
        if sample.status & UNUSABLE or (self._rows and sample.t <= self._rows[-1][0]):
            self._rows.clear()
            return None
        self._rows.append(row_of(sample, state.motion, state.tool.s, model))
        # vibrations average out over a block, and a payload is noticed after eight [s]; four
        # samples show a scatter, so that slower sensors have longer blocks
        if len(self._rows) < 4 or sample.t - self._rows[0][0] < 0.05:
            return None
        block = block_of(self._rows)
        self._rows.clear()
        if block is None:
            return None
        self._state = on_block(self._state, block, self.model)
        self.latest = estimate(self._state, self.model)
        return self.estimate

    def news(self) -> ToolEstimate | None:
        """
        Return the tool where it is known, and is another than this has returned last.

        Another is one whose weight differs by more than the errors of a weight are anyway, or
        one after a change; not more often than once a second.
        """
        now, model = self.estimate, self.model
        since = now.t - self.announced.t
        # a tool that is still being learned is announced again after this: twice the time in
        # which another is faded in [s]
        if now.state != TRACKING or 0 <= since < 1.0:
            return None
        more = now.mass - self.announced.mass
        moment = now.mass * now.com - self.announced.mass * self.announced.com
        force, torque = np.sqrt(model.floor[[0, 3], [0, 3]]) / model.gravity
        if abs(more) <= force and np.linalg.norm(moment) <= torque:
            return None
        self.announced = now
        return now

    @property
    def estimate(self) -> ToolEstimate:
        """What hangs on the sensor by now; frozen where readings have ceased to tell."""
        # readings that show nothing of the tool for so long leave it unwatched: a payload is to
        # be noticed in that time [s]
        if not self._newest - self._state.t <= 1.0:
            return self.latest._replace(state=FROZEN)
        return self.latest

    @property
    def changes(self) -> tuple[Change, ...]:
        """Changes that were taken over."""
        return self._state.changes


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


def block_of(rows: Sequence[tuple[float, ...]]) -> Block | None:
    """Average rows; None where there is a gap among them."""
    table = np.array(rows)
    duration = float(table[-1, 0] - table[0, 0])
    # a block that spans more has a gap, and is left out: a tool may turn far in it [s]
    if duration > 0.5:
        return None
    means = table.mean(axis=0)
    return Block(float(table[-1, 0]), duration, means[1:7], table[:, 20:].var(axis=0) / len(rows),
                 means[7:10], means[10:13], means[13:16], means[16:19], float(means[19]))
