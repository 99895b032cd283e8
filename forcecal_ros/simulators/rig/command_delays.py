"""Commands that take effect late: each axis, and the orientation, by a time of its own."""

import math

from forcecal_ros.effects.rig import Rig
from forcecal_ros.geometry import Array
import numpy as np
from scipy.spatial.transform import Rotation


class CommandDelays:
    """
    What a rig's delays do to commands, block after block.

    A part of a period lies on the way, straight or geodesic, from one command to the next.

    Parameters
    ----------
    position : ndarray, shape (3,)
        Where it has rested for ever, in base [m].
    xyzw : ndarray, shape (4,)
    """

    def __init__(self, rig: Rig, position: Array, xyzw: Array) -> None:
        period = rig.robot.period
        self._late = [(axis.delay if axis else 0.0) / period for axis in rig.robot.axes]
        self._turned = (rig.servo.orientation_delay or 0.0) / period
        self._kept = 1 + math.ceil(max(*self._late, self._turned))
        self._positions = np.tile(position, (self._kept, 1))
        self._xyzw = np.tile(xyzw, (self._kept, 1))

    def __call__(self, positions: Array, xyzw: Array) -> tuple[Array, Array]:
        """
        Delay the next commands.

        Parameters
        ----------
        positions : ndarray, shape (m, 3)
        xyzw : ndarray, shape (m, 4)
        """
        if not (any(self._late) or self._turned):
            return positions, xyzw
        told = np.concatenate([self._positions, positions])
        turns = np.concatenate([self._xyzw, xyzw])
        at = self._kept + np.arange(float(len(positions)))
        late = np.stack([np.interp(at - delay, np.arange(float(len(told))), told[:, axis])
                         for axis, delay in enumerate(self._late)], axis=1)
        self._positions, self._xyzw = told[-self._kept:], turns[-self._kept:]
        return late, self._along(turns, at - self._turned) if self._turned else xyzw

    @staticmethod
    def _along(turns: Array, at: Array) -> Array:
        before = np.floor(at + 1e-9).astype(int)
        share = at - before
        start, end = (Rotation.from_quat(turns[i]) for i in (
            before, np.minimum(before + 1, len(turns) - 1)))
        way = (start.inv() * end).as_rotvec()
        return np.asarray((start * Rotation.from_rotvec(
            np.maximum(share, 0.0)[:, np.newaxis] * way)).as_quat())
