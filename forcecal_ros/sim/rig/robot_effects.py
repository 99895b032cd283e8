"""Effects of the robot: its motion comes late, axis by axis, or rings."""

import math

from forcecal_ros.core.geometry import Array
from forcecal_ros.effects.chosen import named_effects
from forcecal_ros.effects.filters import Delay, Filter
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.robot import Motion
import numpy as np
from scipy.spatial.transform import Rotation


class MotionEffects:
    """
    What a rig's effects do to the motion of S, block after block.

    Parameters
    ----------
    dt : float
        Between the nodes of the motion [s].
    """

    def __init__(self, rig: Rig, dt: float) -> None:
        named = named_effects(rig.effects)
        delay = named.get('robot_delay', {}).get('delay', 0.0)
        self._delays = [Delay(delay, dt) for _ in Motion._fields] if delay else []
        ringing = named.get('robot_resonance', {'gain': 0.0})
        self._ringing = Ringing(**ringing, dt=dt) if ringing['gain'] else None
        self._end: Motion | None = None

    def __call__(self, motion: Motion) -> Motion:
        """
        Change the next block of motion.

        Parameters
        ----------
        motion : Motion
            Its first node is the last one of the block before, or rest.
        """
        if not self._delays and self._ringing is None:
            return motion
        start = Motion(*(part[:1] for part in motion)) if self._end is None else self._end
        if self._end is None:
            self._change(start)  # settles
        changed = self._change(Motion(*(part[1:] for part in motion)))
        self._end = Motion(*(part[-1:] for part in changed))
        return Motion(*map(np.concatenate, zip(start, changed)))

    def _change(self, motion: Motion) -> Motion:
        if self._delays:
            motion = Motion(*(delay(part.reshape(len(part), -1)).reshape(part.shape)
                              for delay, part in zip(self._delays, motion)))
        return motion if self._ringing is None else self._ringing(motion)


class Ringing:
    """
    A lightly damped mode in the path of the position.

    x = x0 + gain d, d'' + 2 zeta w d' + w^2 d = -(a0 + g 2 zeta w v0). With g = 1 that is
    x = x0 + gain (H x0 - x0), H = w^2 / (s^2 + 2 zeta w s + w^2), in a form that loses no digits
    where w is large; with g = 0 the mode is damped within the robot and feels its acceleration
    alone.

    Parameters
    ----------
    gain, frequency, damping, grounded : float
        [1], [Hz], zeta [1], g [1].
    dt : float
        Between the nodes of the motion [s].
    """

    def __init__(self, gain: float, frequency: float, damping: float, grounded: float,
                 dt: float) -> None:
        w = 2.0 * np.pi * frequency
        self._gain, self._stiffness, self._drag = gain, w * w, 2.0 * damping * w
        self._dragged = grounded * self._drag
        denominator = [1.0, self._drag, self._stiffness]
        self._excess = Filter([1.0], denominator, dt)
        self._rate = Filter([1.0, 0.0], denominator, dt)

    def __call__(self, motion: Motion) -> Motion:
        """Add the ringing to the next nodes of a motion."""
        drive = -(motion.acceleration + self._dragged * motion.velocity)
        d, rate = self._excess(drive), self._rate(drive)
        second: Array = drive - self._drag * rate - self._stiffness * d
        return motion._replace(
            position=motion.position + self._gain * d,
            velocity=motion.velocity + self._gain * rate,
            acceleration=motion.acceleration + self._gain * second)


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
        sent = np.concatenate([self._positions, positions])
        turns = np.concatenate([self._xyzw, xyzw])
        at = self._kept + np.arange(float(len(positions)))
        late = np.stack([np.interp(at - delay, np.arange(float(len(sent))), sent[:, axis])
                         for axis, delay in enumerate(self._late)], axis=1)
        self._positions, self._xyzw = sent[-self._kept:], turns[-self._kept:]
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
