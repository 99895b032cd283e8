"""The compliant tool on its slide, and the wall it meets.

The slide is integrated by Runge-Kutta 4; the instants at which contact begins and ends are found
by bisection, since a step across them would be of first order only.

Effects, all absent from the nominal rig: with z the displacement s beyond the play of +-gap / 2,
the slide's force is -(k + k3 z^2) z - d ds/dt - f tanh(ds/dt / v0), or, where friction holds at
rest, -f b / w with b following s within +-w in the place of the last term; a cable pulls at a
point of the tool with a force that is constant in base plus that of a spring to where the point
is at home; the spindle shakes the tool at another point with a force that is sinusoidal in S.
"""

import math
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled, Record
from forcecal_ros.sim.rig.robot import Motion
import numpy as np

TOOL_STATE = np.dtype([
    ('slide', 'f8'),       # [m]
    ('speed', 'f8'),       # [m/s]
    ('touching', 'f8'),    # 1: the wall pushes
    ('steps', 'f8'),       # since the start
    ('anchor', 'f8'),      # [m] displacement at which static friction is zero
])


class Slide(NamedTuple):
    """
    Displacement of the tool along x of S, and the wall's push, at the steps, start included.

    Attributes
    ----------
    slide, speed, acceleration : ndarray, shape (n,)
        [m], [m/s], [m/s^2]
    push : ndarray, shape (n,)
        Force of the wall on the tool along -X of base [N].
    load : ndarray, shape (n, 6)
        Wrench of cable and spindle on the tool, in S [N], [N m]; not filled where the parameters
        say that there is nothing extra.
    """

    slide: Array
    speed: Array
    acceleration: Array
    push: Array
    load: Array

    @classmethod
    def empty(cls, n: int) -> 'Slide':
        """Make room for n steps."""
        return cls(np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty((n, 6)))


def tool_at_rest(p: Record, position: Array, R_base_sensor: Array) -> Array:
    """
    State of a tool in equilibrium under gravity and, where the tip is in the wall, its push.

    k s = m g.x + f_env.x, with f_env.x = -k_e max(0, delta) R_base_sensor[0, 0].

    Parameters
    ----------
    position : ndarray, shape (3,)
        Of S in base [m].
    R_base_sensor : ndarray, shape (3, 3)

    Returns
    -------
    ndarray of TOOL_STATE, shape (1,)
        Its ``[0]`` is the record that :func:`slide_along` takes and changes.
    """
    tilt = R_base_sensor[0, 0]
    depth = position[0] + R_base_sensor[0] @ p['tip'] - p['wall_position']
    slide = 0.0
    if not p['rigid'] and p['extra']:
        slide = _rest_with_effects(p, position, R_base_sensor)
    elif not p['rigid']:
        weight = p['mass'] * (R_base_sensor[:, 0] @ p['gravity'])
        slide = weight / p['stiffness']
        if depth + tilt * slide > 0.0:
            wall = p['wall_stiffness'] * tilt
            slide = (weight - wall * depth) / (p['stiffness'] + wall * tilt)
    touching = depth + tilt * slide > 0.0
    return np.array([(slide, 0.0, touching, 0.0, slide)], dtype=TOOL_STATE)


def _rest_with_effects(p: Record, position: Array, R_base_sensor: Array) -> float:
    """Find where the forces balance; within the play, as near to its middle as they do."""
    # net force that counts as zero when looking for equilibrium [N]
    balanced = 1e-8
    # largest displacement at which equilibrium is looked for [m]
    furthest = 1.0
    along = R_base_sensor[:, 0]
    depth = position[0] + R_base_sensor[0] @ p['tip'] - p['wall_position']
    stretch = position + R_base_sensor @ p['cable_point'] - p['cable_home']
    constant = along @ (p['mass'] * p['gravity'] + p['cable_force']
                        - p['cable_stiffness'] * stretch)

    def force(s: float) -> float:
        wall = p['wall_stiffness'] * max(0.0, depth + along[0] * s)
        return float(constant - p['cable_stiffness'] * s - wall * along[0]
                     - _spring(p['stiffness'], p['stiffening'], p['half_gap'], s))

    def edge(least: float) -> float:
        low, high = -furthest, furthest
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if force(middle) > least else (low, middle)
        return 0.5 * (low + high)

    return min(max(0.0, edge(balanced)), edge(-balanced))


@compiled
def slide_along(p: Record, state: Record, motion: Motion, h: float, out: Slide) -> None:
    """
    Let the tool slide while S moves.

    x: m (a_c - g).x = -k s - d ds/dt + f_env.x, a_c the acceleration of the centre of mass
    ([Gamez2005] Eq. 29 where S moves along x only).

    Parameters
    ----------
    state : record of TOOL_STATE
        Before; after the call, at the last step.
    motion : Motion
        At 2 n + 1 nodes, half a step apart.
    h : float
        Step [s].
    out : Slide
        Filled, n + 1 steps.
    """
    f, at = np.empty((3, 6)), np.empty((4, 6))
    for i in range(len(out.slide)):
        if i > 0:
            for j in range(6):
                f[0, j] = f[2, j]
            _forcing(p, motion, 2 * i - 1, f, 1)
        _forcing(p, motion, 2 * i, f, 2)
        if p.extra > 0.0:
            t = (state.steps + i) * h
            if i > 0:
                _add_load(p, motion, 2 * i - 1, t - 0.5 * h, f[1])
            _add_load(p, motion, 2 * i, t, f[2])
        if i > 0:
            _step(p, state, f, h, at)
        _write_slide(p, state, f, i, out)
        if p.extra > 0.0:
            _write_load(p, motion, 2 * i, t, state.slide, out.load[i])
    state.steps += len(out.slide) - 1


@compiled
def _forcing(p: Record, motion: Motion, j: int, f: Array, row: int) -> None:
    """
    Write what the motion of S does: s'' = f0 + f1 s + (-k s - d s' - push R_xx) / m.

    The tip's depth in the wall is f2 + f5 s, its rate f3 + f4 s + f5 s', and f5 = R_xx. Numbers
    are read one by one: a view of each row would cost more than the arithmetic.
    """
    position, velocity, a = motion.position, motion.velocity, motion.acceleration
    R, w, alpha = motion.R_base_sensor, motion.omega, motion.alpha
    c0, c1, c2 = p.com[0], p.com[1], p.com[2]
    tip0, tip1, tip2 = p.tip[0], p.tip[1], p.tip[2]
    w0, w1, w2 = w[j, 0], w[j, 1], w[j, 2]
    xx, xy, xz = R[j, 0, 0], R[j, 0, 1], R[j, 0, 2]
    along = 0.0
    along += xx * (p.gravity[0] - a[j, 0])
    along += R[j, 1, 0] * (p.gravity[1] - a[j, 1])
    along += R[j, 2, 0] * (p.gravity[2] - a[j, 2])
    dot = w0 * c0 + w1 * c1 + w2 * c2
    square = w0 * w0 + w1 * w1 + w2 * w2
    f[row, 0] = along - (alpha[j, 1] * c2 - alpha[j, 2] * c1) - (w0 * dot - square * c0)
    f[row, 1] = square - w0 * w0
    depth = position[j, 0] + xx * tip0 + xy * tip1 + xz * tip2
    f[row, 2] = depth - p.wall_position
    rate = velocity[j, 0] + xx * (w1 * tip2 - w2 * tip1)
    f[row, 3] = rate + (xy * (w2 * tip0 - w0 * tip2) + xz * (w0 * tip1 - w1 * tip0))
    f[row, 4] = xy * w2 - xz * w1
    f[row, 5] = xx


@compiled
def _cable(p: Record, motion: Motion, j: int, axis: int) -> float:
    """Give the cable's force on the undisplaced tool along an axis of S [N]."""
    R, force = motion.R_base_sensor[j], 0.0
    for i in range(3):
        stretch = motion.position[j, i] - p.cable_home[i]
        for k in range(3):
            stretch += R[i, k] * p.cable_point[k]
        force += R[i, axis] * (p.cable_force[i] - p.cable_stiffness * stretch)
    return force


@compiled
def _spindle(p: Record, axis: int, t: float) -> float:
    angle = p.spindle_rate * t
    return (p.spindle_sine[axis] * math.sin(angle)  # type: ignore[no-any-return]
            + p.spindle_cosine[axis] * math.cos(angle))


@compiled
def _add_load(p: Record, motion: Motion, j: int, t: float, f: Array) -> None:
    """Add what cable and spindle do to the slide to f0 and f1."""
    f[0] += (_cable(p, motion, j, 0) + _spindle(p, 0, t)) / p.mass
    f[1] -= p.cable_stiffness / p.mass


@compiled
def _write_load(p: Record, motion: Motion, j: int, t: float, s: float, out: Array) -> None:
    """Write the wrench of cable and spindle on the tool, in S."""
    c, q = p.cable_point, p.spindle_point
    f0 = _cable(p, motion, j, 0) - p.cable_stiffness * s
    f1, f2 = _cable(p, motion, j, 1), _cable(p, motion, j, 2)
    g0, g1, g2 = _spindle(p, 0, t), _spindle(p, 1, t), _spindle(p, 2, t)
    out[0], out[1], out[2] = f0 + g0, f1 + g1, f2 + g2
    out[3] = c[1] * f2 - c[2] * f1 + q[1] * g2 - q[2] * g1
    out[4] = c[2] * f0 - (c[0] + s) * f2 + q[2] * g0 - (q[0] + s) * g2
    out[5] = (c[0] + s) * f1 - c[1] * f0 + (q[0] + s) * g1 - q[1] * g0


@compiled
def _spring(stiffness: float, stiffening: float, half_gap: float, s: float) -> float:
    """Give the force of the slide's spring against a displacement [N]."""
    z = max(0.0, s - half_gap) + min(0.0, s + half_gap)
    return (stiffness + stiffening * z * z) * z


@compiled
def _push(p: Record, f: Array, row: int, s: float, v: float) -> float:
    """Give the force of the wall's spring and damper [N], negative where it had to pull."""
    depth, rate = f[row, 2] + f[row, 5] * s, f[row, 3] + f[row, 4] * s + f[row, 5] * v
    return p.wall_stiffness * depth + p.wall_damping * rate  # type: ignore[no-any-return]


@compiled
def _touches(p: Record, f: Array, row: int, s: float, v: float) -> bool:
    return bool(f[row, 2] + f[row, 5] * s > 0.0 and _push(p, f, row, s, v) > 0.0)


@compiled
def _held(p: Record, s: float, anchor: float) -> float:
    """Give how far friction that holds is bent [m]."""
    return min(max(s - anchor, -p.presliding), p.presliding)  # type: ignore[no-any-return]


@compiled
def _friction(p: Record, s: float, v: float, anchor: float) -> float:
    if p.presliding > 0.0:
        return p.friction * _held(p, s, anchor) / p.presliding  # type: ignore[no-any-return]
    return p.friction * math.tanh(v / p.friction_speed)  # type: ignore[no-any-return]


@compiled
def _slide_acceleration(p: Record, f: Array, row: int, s: float, v: float, touching: bool,
                        anchor: float) -> float:
    force = -p.stiffness * s - p.damping * v
    if p.extra > 0.0:
        force = -p.damping * v - _friction(p, s, v, anchor)
        force -= _spring(p.stiffness, p.stiffening, p.half_gap, s)
    if touching:
        force -= _push(p, f, row, s, v) * f[row, 5]
    return f[row, 0] + f[row, 1] * s + force / p.mass  # type: ignore[no-any-return]


@compiled
def _interpolate(f: Array, fraction: float, out: Array, row: int) -> None:
    start = (1.0 - fraction) * (1.0 - 2.0 * fraction)
    middle, end = 4.0 * fraction * (1.0 - fraction), fraction * (2.0 * fraction - 1.0)
    for i in range(6):
        out[row, i] = start * f[0, i] + middle * f[1, i] + end * f[2, i]


@compiled
def _advance(p: Record, f: Array, begin: float, end: float, h: float, s: float, v: float,
             touching: bool, anchor: float, at: Array) -> tuple[float, float]:
    """Go over a part of the step by Runge-Kutta 4, contact kept as it is; give s, v."""
    dt = (end - begin) * h
    for i in range(3):
        _interpolate(f, begin + 0.5 * i * (end - begin), at, i)
    a1 = _slide_acceleration(p, at, 0, s, v, touching, anchor)
    v2 = v + 0.5 * dt * a1
    a2 = _slide_acceleration(p, at, 1, s + 0.5 * dt * v, v2, touching, anchor)
    v3 = v + 0.5 * dt * a2
    a3 = _slide_acceleration(p, at, 1, s + 0.5 * dt * v2, v3, touching, anchor)
    v4 = v + dt * a3
    a4 = _slide_acceleration(p, at, 2, s + dt * v3, v4, touching, anchor)
    return (s + dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4),
            v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4))


@compiled
def _step(p: Record, state: Record, f: Array, h: float, at: Array) -> None:
    """Advance by one step, cut where contact begins or ends; ``at`` is room for 4 rows of f."""
    s, v, touching, begin = state.slide, state.speed, state.touching > 0.0, 0.0
    anchor = state.anchor
    if p.rigid > 0.0:
        state.touching = _touches(p, f, 2, s, v)
        return
    # most beginnings and ends of contact that are located within one step
    for _ in range(8):
        s_end, v_end = _advance(p, f, begin, 1.0, h, s, v, touching, anchor, at)
        if _touches(p, f, 2, s_end, v_end) == touching:
            break
        low, high = begin, 1.0
        for _ in range(40):
            middle = 0.5 * (low + high)
            s_end, v_end = _advance(p, f, begin, middle, h, s, v, touching, anchor, at)
            _interpolate(f, middle, at, 3)
            if _touches(p, at, 3, s_end, v_end) == touching:
                low = middle
            else:
                high = middle
        s, v = _advance(p, f, begin, high, h, s, v, touching, anchor, at)
        anchor = s - _held(p, s, anchor)
        touching, begin = not touching, high
    else:
        s_end, v_end = _advance(p, f, begin, 1.0, h, s, v, touching, anchor, at)
    state.slide, state.speed, state.touching = s_end, v_end, touching
    state.anchor = s_end - _held(p, s_end, anchor)


@compiled
def _write_slide(p: Record, state: Record, f: Array, i: int, out: Slide) -> None:
    s, v, touching = state.slide, state.speed, state.touching > 0.0
    out.slide[i], out.speed[i] = s, v
    out.acceleration[i] = 0.0
    if p.rigid == 0.0:
        out.acceleration[i] = _slide_acceleration(p, f, 2, s, v, touching, state.anchor)
    out.push[i] = _push(p, f, 2, s, v) if touching else 0.0
