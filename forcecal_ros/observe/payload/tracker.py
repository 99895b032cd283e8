"""The payload along a running chain: samples in, blocks, an estimate out."""

from math import nan

from forcecal_ros.geometry import Array
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.payload.blocks import block_of, is_full, row_of, usable
from forcecal_ros.observe.payload.model import PayloadModel
from forcecal_ros.observe.payload.step import (
    begin,
    Change,
    estimate,
    FROZEN,
    on_block,
    tared,
    ToolEstimate,
    TRACKING,
)
from forcecal_ros.observe.sample import ContactSample
from forcecal_ros.observe.step import State
import numpy as np

SILENCE = 1.0
"""Readings that say nothing of the tool for so long leave it unwatched: a payload is to be heard
of in that time [s]."""


RETELL = 1.0
"""A tool that is still being learned is told again after this: twice the time in which another
is faded in [s]."""


class Tracker:
    """
    What hangs on the sensor, followed beside a chain.

    Attributes
    ----------
    model : PayloadModel
    latest : ToolEstimate
        Of the last block.
    told : ToolEstimate
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
        self.latest = self.told = estimate(self._state, self.model)

    def take(self, sample: ContactSample, state: State, model: Model) -> ToolEstimate | None:
        """Take in a sample of the chain, and what the chain was then; None between blocks."""
        self._newest = sample.t
        if not usable(sample) or (self._rows and sample.t <= self._rows[-1][0]):
            self._rows.clear()
            return None
        self._rows.append(row_of(sample, state.motion, state.tool.s, model))
        if not is_full(self._rows):
            return None
        block = block_of(self._rows)
        self._rows.clear()
        if block is None:
            return None
        self._state = on_block(self._state, block, self.model)
        self.latest = estimate(self._state, self.model)
        return self.estimate

    def tared(self, shift: Array) -> None:
        """Note that a tare has moved the biases by ``shift`` [N, N m]."""
        self._state = tared(self._state, shift, self.model)

    def news(self) -> ToolEstimate | None:
        """
        Return the tool where it is known, and is another than this has returned last.

        Another is one whose weight differs by more than the errors of a weight are anyway, or
        one after a change; not more often than once in ``RETELL``.
        """
        now, model = self.estimate, self.model
        if now.state != TRACKING or self.told.t <= now.t < self.told.t + RETELL:
            return None
        more = now.mass - self.told.mass
        moment = now.mass * now.com - self.told.mass * self.told.com
        force, torque = np.sqrt(model.floor[[0, 3], [0, 3]]) / model.gravity
        if abs(more) <= force and np.linalg.norm(moment) <= torque:
            return None
        self.told = now
        return now

    @property
    def estimate(self) -> ToolEstimate:
        """What hangs on the sensor by now; frozen where readings have ceased to tell."""
        if not self._newest - self._state.t <= SILENCE:
            return self.latest._replace(state=FROZEN)
        return self.latest

    @property
    def changes(self) -> tuple[Change, ...]:
        """Changes that were taken over."""
        return self._state.changes
