"""The robot: commanded poses in, motion of the sensor frame S out.

Position: the difference equation [Gamez2005] Eq. 28, its output interpolated, then a third-order
servo, which is solved in closed form. Orientation: a geodesic between commands, then a servo on
SO(3), integrated by Runge-Kutta 4 in unit quaternions (xyzw).
"""

import math
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled, Record
from forcecal_ros.effects.library import named_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import Delay, Filter
import numpy as np
from scipy.spatial.transform import Rotation

ROBOT_STATE = np.dtype([
    ('commands', 'f8', (3, 3)),     # [m] commanded positions k-1, k-2, k-3
    ('outputs', 'f8', (3, 3)),      # [m] of Eq. 28, k-1, k-2, k-3
    ('position', 'f8', 3),          # [m] of S in base
    ('velocity', 'f8', 3),          # [m/s]
    ('acceleration', 'f8', 3),      # [m/s^2]
    ('command_xyzw', 'f8', 4),      # commanded orientation k-1
    ('turn', 'f8', 7),              # orientation xyzw, angular velocity in S [rad/s]
])

TINY = 1e-60
"""
Below it a number of a motion is taken for 0: a robot that has come to rest moves by less and less
for ever, and with numbers below 1e-308, as their products are, processors take a hundred times as
long. No other digit depends on it: lengths and speeds that count are above 1e-12.
"""


class Motion(NamedTuple):
    """
    Motion of S at the nodes of the integration, half a step apart, the start included.

    Attributes
    ----------
    position, velocity, acceleration : ndarray, shape (n, 3)
        Of S in base [m], [m/s], [m/s^2].
    R_base_sensor : ndarray, shape (n, 3, 3)
    omega, alpha : ndarray, shape (n, 3)
        Angular velocity [rad/s] and acceleration [rad/s^2] in S.
    """

    position: Array
    velocity: Array
    acceleration: Array
    R_base_sensor: Array
    omega: Array
    alpha: Array

    @classmethod
    def empty(cls, n: int) -> 'Motion':
        """Make room for n nodes."""
        return cls(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3)),
                   np.empty((n, 3)), np.empty((n, 3)))


def robot_at_rest(position: Array, xyzw: Array) -> Array:
    """
    State of a robot that has rested at one pose for ever.

    Parameters
    ----------
    position : ndarray, shape (3,)
        Of S in base [m].
    xyzw : ndarray, shape (4,)
        Orientation of S in base, unit quaternion.

    Returns
    -------
    ndarray of ROBOT_STATE, shape (1,)
        Its ``[0]`` is the record that :func:`move` takes and changes.
    """
    zero = (0.0, 0.0, 0.0)
    state = ([position] * 3, [position] * 3, position, zero, zero, xyzw, (*xyzw, *zero))
    return np.array([state], dtype=ROBOT_STATE)


@compiled
def move(p: Record, state: Record, positions: Array, xyzw: Array, steps: int,
         motion: Motion) -> None:
    """
    Follow commands, one robot period each.

    During period k the servo's input goes linearly from output k-1 to output k of Eq. 28, and
    the orientation's along the geodesic from command k-1 to command k.

    Parameters
    ----------
    state : record of ROBOT_STATE
        Before; after the call, at the end of the last period.
    positions : ndarray, shape (m, 3)
        Commanded positions of S in base [m].
    xyzw : ndarray, shape (m, 4)
        Commanded orientations.
    steps : int
        Integration steps per period.
    motion : Motion
        Filled, 2 steps m + 1 nodes.
    """
    nodes = 2 * steps
    for k in range(len(positions)):
        for axis in range(3):
            _follow_position(p, state, axis, positions[k, axis], k * nodes, nodes, motion)
        _follow_orientation(p, state, xyzw[k], k * nodes, nodes, motion)


@compiled
def _follow_position(p: Record, state: Record, axis: int, command: float, first: int,
                     nodes: int, motion: Motion) -> None:
    r, y = state.commands, state.outputs
    previous, output = y[0, axis], 0.0
    if p.direct[axis] > 0.0:
        _shift(r, axis, command)
    for i in range(3):  # [Gamez2005] Eq. 28
        output += p.feedback[axis, i] * y[i, axis] + p.feedforward[axis, i] * r[i, axis]
    # (d/dt + w)^3 x = w^3 u for u = previous + slope t: x = u - 3 slope / w + q(t) exp(-w t)
    w, slope = p.position_bandwidth, (output - previous) / p.period
    start = previous - 3.0 * slope / w
    e0 = state.position[axis] - start
    e1 = state.velocity[axis] - slope
    c1 = e1 + w * e0
    c2 = 0.5 * state.acceleration[axis] + w * e1 + 0.5 * w * w * e0
    motion.position[first, axis] = state.position[axis]
    motion.velocity[first, axis] = state.velocity[axis]
    motion.acceleration[first, axis] = state.acceleration[axis]
    for j in range(1, nodes + 1):
        t = j * p.period / nodes
        decay = math.exp(-w * t)
        q, dq = e0 + (c1 + c2 * t) * t, c1 + 2.0 * c2 * t
        motion.position[first + j, axis] = start + slope * t + decay * q
        motion.velocity[first + j, axis] = slope + decay * (dq - w * q)
        motion.acceleration[first + j, axis] = decay * (2.0 * c2 - 2.0 * w * dq + w * w * q)
    last = first + nodes
    state.position[axis] = _no_trace(motion.position[last, axis])
    state.velocity[axis] = _no_trace(motion.velocity[last, axis])
    state.acceleration[axis] = _no_trace(motion.acceleration[last, axis])
    _shift(y, axis, output)
    if p.direct[axis] <= 0.0:
        _shift(r, axis, command)


@compiled
def _no_trace(x: float) -> float:
    return x if abs(x) > TINY else 0.0


@compiled
def without_traces(values: Array) -> None:
    """Set the numbers of a contiguous array that are too small to matter to 0."""
    flat = values.reshape(-1)
    for i in range(len(flat)):
        flat[i] = _no_trace(flat[i])


@compiled
def _shift(past: Array, axis: int, newest: float) -> None:
    past[2, axis], past[1, axis], past[0, axis] = past[1, axis], past[0, axis], newest


@compiled
def _follow_orientation(p: Record, state: Record, command: Array, first: int, nodes: int,
                        motion: Motion) -> None:
    w, drag, h = p.orientation_bandwidth, 2.0 * p.orientation_damping, p.period / nodes
    z, trial, k = np.empty(7), np.empty(7), np.empty((4, 7))
    previous, goal, goal_middle, goal_end = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    geodesic, relative = np.empty(3), np.empty(4)
    for i in range(7):
        z[i] = state.turn[i]
    for i in range(4):
        previous[i] = goal[i] = state.command_xyzw[i]
    _relative(previous, command, relative)
    _log(relative, geodesic)
    for j in range(nodes + 1):
        _turn_rate(w, drag, z, goal, relative, k[0])
        _write_turn(z, k[0], first + j, motion)
        if j == nodes:
            break
        _along(previous, geodesic, (j + 0.5) / nodes, goal_middle)
        _along(previous, geodesic, (j + 1.0) / nodes, goal_end)
        if j + 1 == nodes:
            for i in range(4):
                goal_end[i] = command[i]
        for i in range(7):
            trial[i] = z[i] + 0.5 * h * k[0, i]
        _turn_rate(w, drag, trial, goal_middle, relative, k[1])
        for i in range(7):
            trial[i] = z[i] + 0.5 * h * k[1, i]
        _turn_rate(w, drag, trial, goal_middle, relative, k[2])
        for i in range(7):
            trial[i] = z[i] + h * k[2, i]
        _turn_rate(w, drag, trial, goal_end, relative, k[3])
        for i in range(7):
            z[i] += h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])
        norm = math.sqrt(z[0] ** 2 + z[1] ** 2 + z[2] ** 2 + z[3] ** 2)
        for i in range(4):
            z[i] /= norm
            goal[i] = goal_end[i]
    for i in range(7):
        state.turn[i] = _no_trace(z[i])
    for i in range(4):
        state.command_xyzw[i] = command[i]


@compiled
def _turn_rate(w: float, drag: float, z: Array, goal: Array, relative: Array, rate: Array) -> None:
    """
    Give d/dt of (R, omega).

    dR/dt = R [omega], d omega/dt = w^2 log(R^T goal) - drag w omega, drag twice the damping.
    """
    qx, qy, qz, qw = z[0], z[1], z[2], z[3]
    ox, oy, oz = z[4], z[5], z[6]
    rate[0] = 0.5 * (qw * ox + qy * oz - qz * oy)
    rate[1] = 0.5 * (qw * oy + qz * ox - qx * oz)
    rate[2] = 0.5 * (qw * oz + qx * oy - qy * ox)
    rate[3] = -0.5 * (qx * ox + qy * oy + qz * oz)
    _relative(z, goal, relative)
    _log(relative, rate[4:])
    for i in range(4, 7):
        rate[i] = w * w * rate[i] - drag * w * z[i]


@compiled
def _write_turn(z: Array, rate: Array, j: int, motion: Motion) -> None:
    x, y, s, c = z[0], z[1], z[2], z[3]
    R = motion.R_base_sensor[j]
    R[0, 0], R[1, 1] = 1.0 - 2.0 * (y * y + s * s), 1.0 - 2.0 * (x * x + s * s)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    R[0, 1], R[1, 0] = 2.0 * (x * y - s * c), 2.0 * (x * y + s * c)
    R[0, 2], R[2, 0] = 2.0 * (x * s + y * c), 2.0 * (x * s - y * c)
    R[1, 2], R[2, 1] = 2.0 * (y * s - x * c), 2.0 * (y * s + x * c)
    for i in range(3):
        motion.omega[j, i], motion.alpha[j, i] = z[4 + i], rate[4 + i]


@compiled
def _relative(a: Array, b: Array, out: Array) -> None:
    """Write the quaternion of R_a^T R_b."""
    ax, ay, az, aw = -a[0], -a[1], -a[2], a[3]
    out[0] = aw * b[0] + ax * b[3] + ay * b[2] - az * b[1]
    out[1] = aw * b[1] - ax * b[2] + ay * b[3] + az * b[0]
    out[2] = aw * b[2] + ax * b[1] - ay * b[0] + az * b[3]
    out[3] = aw * b[3] - ax * b[0] - ay * b[1] - az * b[2]


@compiled
def _log(q: Array, out: Array) -> None:
    """Write the rotation vector of a quaternion, of norm at most pi."""
    sign = 1.0 if q[3] >= 0.0 else -1.0
    sine = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    factor = 2.0 * sign
    if sine > 1e-12:
        factor *= math.atan2(sine, sign * q[3]) / sine
    for i in range(3):
        out[i] = factor * q[i]


@compiled
def _along(start: Array, vector: Array, fraction: float, out: Array) -> None:
    """Go a fraction of the way from ``start`` by a rotation vector in its frame."""
    angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    half = 0.5 * fraction * angle
    factor = math.sin(half) / angle if angle > 1e-12 else 0.5 * fraction
    x, y, z, w = factor * vector[0], factor * vector[1], factor * vector[2], math.cos(half)
    out[0] = start[3] * x + start[0] * w + start[1] * z - start[2] * y
    out[1] = start[3] * y - start[0] * z + start[1] * w + start[2] * x
    out[2] = start[3] * z + start[0] * y - start[1] * x + start[2] * w
    out[3] = start[3] * w - start[0] * x - start[1] * y - start[2] * z


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
