"""The compliant tool on its slide, and the screen it meets.

The slide is integrated by Runge-Kutta 4; the instants at which contact begins and ends are found
by bisection, since a step across them would be of first order only.
"""

from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.sim.compiled import compiled, Record
from forcecal_ros.sim.robot import Motion
import numpy as np

TOOL_STATE = np.dtype([
    ('slide', 'f8'),       # [m]
    ('speed', 'f8'),       # [m/s]
    ('touching', 'f8'),    # 1: the wall pushes
])

MOST_EVENTS = 8
"""Beginnings and ends of contact that are looked for within one step."""

BISECTIONS = 40
"""Of a step, to find such an instant."""


class Slide(NamedTuple):
    """
    Displacement of the tool along x of S, and the wall's push, at the steps, start included.

    Attributes
    ----------
    slide, speed, acceleration : ndarray, shape (n,)
        [m], [m/s], [m/s^2]
    push : ndarray, shape (n,)
        Force of the wall on the tool along -X of base [N].
    """

    slide: Array
    speed: Array
    acceleration: Array
    push: Array

    @classmethod
    def empty(cls, n: int) -> 'Slide':
        """Make room for n steps."""
        return cls(*(np.empty(n) for _ in range(4)))


def tool_at_rest(p: Record, position: Array, R_base_sensor: Array) -> Array:
    """
    State of a tool in equilibrium under gravity and, where the tip is in the wall, its push.

    k s = m g.x + f_env.x, with f_env.x = -k_e max(0, delta) R_base_sensor[0, 0].

    Parameters
    ----------
    p : record of PARAMETERS
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
    if not p['rigid']:
        weight = p['mass'] * (R_base_sensor[:, 0] @ p['gravity'])
        slide = weight / p['stiffness']
        if depth + tilt * slide > 0.0:
            wall = p['wall_stiffness'] * tilt
            slide = (weight - wall * depth) / (p['stiffness'] + wall * tilt)
    touching = depth + tilt * slide > 0.0
    return np.array([(slide, 0.0, touching)], dtype=TOOL_STATE)


@compiled
def slide_along(p: Record, state: Record, motion: Motion, h: float, out: Slide) -> None:
    """
    Let the tool slide while S moves.

    x: m (a_c - g).x = -k s - d ds/dt + f_env.x, a_c the acceleration of the centre of mass
    ([Gamez2005] Eq. 29 where S moves along x only).

    Parameters
    ----------
    p : record of PARAMETERS
    state : record of TOOL_STATE
        Before; after the call, at the last step.
    motion : Motion
        At 2 n + 1 nodes, half a step apart.
    h : float
        Step [s].
    out : Slide
        Filled, n + 1 steps.
    """
    f = np.empty((3, 6))
    for i in range(len(out.slide)):
        if i > 0:
            for j in range(6):
                f[0, j] = f[2, j]
            _forcing(p, motion, 2 * i - 1, f[1])
        _forcing(p, motion, 2 * i, f[2])
        if i > 0:
            _step(p, state, f, h)
        _write_slide(p, state, f[2], i, out)


@compiled
def _forcing(p: Record, motion: Motion, j: int, f: Array) -> None:
    """
    Write what the motion of S does: s'' = f0 + f1 s + (-k s - d s' - push R_xx) / m.

    The tip's depth in the wall is f2 + f5 s, its rate f3 + f4 s + f5 s', and f5 = R_xx.
    """
    R, g, c, tip = motion.R_base_sensor[j], p.gravity, p.com, p.tip
    w, alpha, a = motion.omega[j], motion.alpha[j], motion.acceleration[j]
    along = 0.0
    for i in range(3):
        along += R[i, 0] * (g[i] - a[i])
    dot = w[0] * c[0] + w[1] * c[1] + w[2] * c[2]
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    f[0] = along - (alpha[1] * c[2] - alpha[2] * c[1]) - (w[0] * dot - square * c[0])
    f[1] = square - w[0] * w[0]
    f[2] = motion.position[j, 0] + R[0, 0] * tip[0] + R[0, 1] * tip[1] + R[0, 2] * tip[2]
    f[2] -= p.wall_position
    f[3] = motion.velocity[j, 0] + R[0, 0] * (w[1] * tip[2] - w[2] * tip[1])
    f[3] += R[0, 1] * (w[2] * tip[0] - w[0] * tip[2]) + R[0, 2] * (w[0] * tip[1] - w[1] * tip[0])
    f[4] = R[0, 1] * w[2] - R[0, 2] * w[1]
    f[5] = R[0, 0]


@compiled
def _push(p: Record, f: Array, s: float, v: float) -> float:
    """Give the force of the wall's spring and damper [N], negative where it had to pull."""
    depth, rate = f[2] + f[5] * s, f[3] + f[4] * s + f[5] * v
    return p.wall_stiffness * depth + p.wall_damping * rate  # type: ignore[no-any-return]


@compiled
def _touches(p: Record, f: Array, s: float, v: float) -> bool:
    return bool(f[2] + f[5] * s > 0.0 and _push(p, f, s, v) > 0.0)


@compiled
def _slide_acceleration(p: Record, f: Array, s: float, v: float, touching: bool) -> float:
    force = -p.stiffness * s - p.damping * v
    if touching:
        force -= _push(p, f, s, v) * f[5]
    return f[0] + f[1] * s + force / p.mass  # type: ignore[no-any-return]


@compiled
def _interpolate(f: Array, fraction: float, out: Array) -> None:
    start = (1.0 - fraction) * (1.0 - 2.0 * fraction)
    middle, end = 4.0 * fraction * (1.0 - fraction), fraction * (2.0 * fraction - 1.0)
    for i in range(6):
        out[i] = start * f[0, i] + middle * f[1, i] + end * f[2, i]


@compiled
def _advance(p: Record, f: Array, begin: float, end: float, h: float, s: float, v: float,
             touching: bool) -> tuple[float, float]:
    """Go over a part of the step by Runge-Kutta 4, contact kept as it is; give s, v."""
    at, dt = np.empty((3, 6)), (end - begin) * h
    for i in range(3):
        _interpolate(f, begin + 0.5 * i * (end - begin), at[i])
    a1 = _slide_acceleration(p, at[0], s, v, touching)
    v2 = v + 0.5 * dt * a1
    a2 = _slide_acceleration(p, at[1], s + 0.5 * dt * v, v2, touching)
    v3 = v + 0.5 * dt * a2
    a3 = _slide_acceleration(p, at[1], s + 0.5 * dt * v2, v3, touching)
    v4 = v + dt * a3
    a4 = _slide_acceleration(p, at[2], s + dt * v3, v4, touching)
    return (s + dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4),
            v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4))


@compiled
def _step(p: Record, state: Record, f: Array, h: float) -> None:
    """Advance by one step, cut where contact begins or ends."""
    s, v, touching, begin = state.slide, state.speed, state.touching > 0.0, 0.0
    at = np.empty(6)
    if p.rigid > 0.0:
        state.touching = _touches(p, f[2], s, v)
        return
    for _ in range(MOST_EVENTS):
        s_end, v_end = _advance(p, f, begin, 1.0, h, s, v, touching)
        if _touches(p, f[2], s_end, v_end) == touching:
            break
        low, high = begin, 1.0
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            s_end, v_end = _advance(p, f, begin, middle, h, s, v, touching)
            _interpolate(f, middle, at)
            if _touches(p, at, s_end, v_end) == touching:
                low = middle
            else:
                high = middle
        s, v = _advance(p, f, begin, high, h, s, v, touching)
        touching, begin = not touching, high
    else:
        s_end, v_end = _advance(p, f, begin, 1.0, h, s, v, touching)
    state.slide, state.speed, state.touching = s_end, v_end, touching


@compiled
def _write_slide(p: Record, state: Record, f: Array, i: int, out: Slide) -> None:
    s, v, touching = state.slide, state.speed, state.touching > 0.0
    out.slide[i], out.speed[i] = s, v
    out.acceleration[i] = 0.0
    if p.rigid == 0.0:
        out.acceleration[i] = _slide_acceleration(p, f, s, v, touching)
    out.push[i] = _push(p, f, s, v) if touching else 0.0
