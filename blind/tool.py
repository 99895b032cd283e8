"""Motion of S to the tool's slide, to what the sensor carries and what the accelerometer feels."""

import math
from typing import NamedTuple

from blind.robot import Array, Motion, STEP
from numba import njit
import numpy as np

REST = 12000
"""Steps for which the tool settles before t = 0."""


class Tool(NamedTuple):
    """
    The compliant tool; everything from ``hardening`` on is absent on the nominal rig.

    Attributes
    ----------
    mass, stiffness, damping : float
        [kg, N/m, N s/m]
    com, inertia : ndarray, shape (3,)
        In S at zero displacement [m]; diagonal about the CoM [kg m^2].
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    hardening : float
        1/s0 of a spring k s0 sinh(s / s0) [1/m]; 0: straight.
    friction, presliding : float
        Dahl's model: force [N], displacement [m].
    gap, corner : float
        Free travel and rounding of its ends [m].
    branch, relaxation : float
        Maxwell element beside the spring [N/m, s].
    stop, stop_stiffness : float
        Where the slide hits a stop on either side [m, N/m].
    slosh_mass, slosh_hz, slosh_damping : float
        A part of the mass that swings along y.
    cable_tension, cable_rate, cable_length : float
        Cable as a spring [N, N/m, m at tension].
    cable_anchor, cable_end : ndarray, shape (3,)
        In base; in S.
    whirl, whirl_hz, whirl_wander : float
        Unbalance of the spindle in the x-y plane [N, Hz], share by which its speed wanders.
    """

    mass: float
    com: Array
    inertia: Array
    stiffness: float
    damping: float
    gravity: Array
    hardening: float = 0.0
    friction: float = 0.0
    presliding: float = 1e-4
    gap: float = 0.0
    corner: float = 2e-5
    branch: float = 0.0
    relaxation: float = 1.0
    stop: float = 1.0
    stop_stiffness: float = 0.0
    slosh_mass: float = 0.0
    slosh_hz: float = 2.0
    slosh_damping: float = 0.05
    cable_tension: float = 0.0
    cable_rate: float = 0.0
    cable_length: float = 1.0
    cable_anchor: Array = np.array([0.6, 0.3, 2.0])
    cable_end: Array = np.array([0.05, 0.0, 0.16])
    whirl: float = 0.0
    whirl_hz: float = 80.0
    whirl_wander: float = 0.002


class Wall(NamedTuple):
    """
    The screen.

    Attributes
    ----------
    place, stiffness, damping : float
        [m, N/m, N s/m]
    tip : ndarray, shape (3,)
        In S at zero displacement [m].
    power, depth : float
        Force k depth (delta / depth)^power.
    grip : float
        Coulomb friction along the screen.
    pull, reach : float
        Attraction [N] up to this distance [m].
    mass, back_stiffness, back_damping : float
        A screen that itself moves on a spring; mass 0: it does not.
    """

    place: float
    stiffness: float
    damping: float
    tip: Array
    power: float = 1.0
    depth: float = 0.003
    grip: float = 0.0
    pull: float = 0.0
    reach: float = 0.001
    mass: float = 0.0
    back_stiffness: float = 1e5
    back_damping: float = 60.0


class Felt(NamedTuple):
    """
    What the sensors are exposed to, on a grid of two :data:`STEP`.

    Attributes
    ----------
    wrench : ndarray, shape (n, 6)
        Of the tool's surroundings on it as the sensor says it, -(u, n), without bias.
    specific : ndarray, shape (n, 3)
        Specific force at the accelerometer [m/s^2].
    slide : ndarray, shape (n,)
        [m]
    contact : ndarray, shape (n, 3)
        Force of the screen on the tool, in S [N].
    """

    wrench: Array
    specific: Array
    slide: Array
    contact: Array


@njit(cache=True)
def _spring(s, tool):  # type: ignore[no-untyped-def]
    if tool.gap > 0.0:
        half, c = 0.5 * tool.gap, tool.corner
        right, left = (s - half) / c, (-s - half) / c
        right = right if right > 30.0 else math.log1p(math.exp(right))
        left = left if left > 30.0 else math.log1p(math.exp(left))
        s = c * (right - left)
    if tool.hardening > 0.0:
        force = tool.stiffness / tool.hardening * math.sinh(s * tool.hardening)
    else:
        force = tool.stiffness * s
    if tool.stop_stiffness > 0.0 and abs(s) > tool.stop:
        force += math.copysign(tool.stop_stiffness * (abs(s) - tool.stop), s)
    return force


@njit(cache=True)
def _press(depth, speed, slip_y, slip_z, wall):  # type: ignore[no-untyped-def]
    """Return the force of the screen on the tool, in base."""
    out = np.zeros(3)
    normal = 0.0
    if depth > 0.0:
        elastic = wall.stiffness * depth
        if wall.power != 1.0:
            elastic = wall.stiffness * wall.depth * (depth / wall.depth) ** wall.power
        normal = max(0.0, elastic + wall.damping * speed)
    out[0] = -normal
    if wall.pull > 0.0 and depth > -wall.reach:
        out[0] += wall.pull * min(1.0, 1.0 + depth / wall.reach)
    if wall.grip > 0.0 and normal > 0.0:
        slip = math.sqrt(slip_y * slip_y + slip_z * slip_z + 1e-6)
        out[1] = -wall.grip * normal * slip_y / slip
        out[2] = -wall.grip * normal * slip_z / slip
    return out


@njit(cache=True)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                     a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def _balance(t, y, x, v, a, R, omega, alpha, tool, wall):  # type: ignore[no-untyped-def]
    """Return dy/dt, the screen's force in S, other forces on the tool in S and their moment.

    y: slide and its speed, friction, Maxwell element, slosh and speed, screen and speed.
    """
    dy = np.zeros(8)
    s, ds = y[0], y[1]
    gravity = R.T @ tool.gravity
    base = R.T @ a - gravity
    r = tool.com.copy()
    r[0] += s
    rest = base + _cross(alpha, r) + _cross(omega, _cross(omega, r))
    rest[1] += 2.0 * omega[2] * ds
    rest[2] -= 2.0 * omega[1] * ds
    p = wall.tip.copy()
    p[0] += s
    tip = x + R @ p
    along = _cross(omega, p)
    along[0] += ds
    speed = v + R @ along
    press = _press(tip[0] - wall.place - y[6], speed[0] - y[7], speed[1], speed[2], wall)
    contact = R.T @ press
    other, moment = np.zeros(3), np.zeros(3)
    if tool.cable_tension > 0.0 or tool.cable_rate > 0.0:
        end = tool.cable_end.copy()
        end[0] += s
        line = tool.cable_anchor - (x + R @ end)
        length = math.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
        tension = max(0.0, tool.cable_tension + tool.cable_rate * (length - tool.cable_length))
        force = R.T @ (line * (tension / length))
        other += force
        moment += _cross(end, force)
    if tool.whirl > 0.0:
        turn = 2 * math.pi * tool.whirl_hz * (
            t + tool.whirl_wander * math.sin(2 * math.pi * 0.3 * t) / (2 * math.pi * 0.3))
        force = np.array([tool.whirl * math.cos(turn), tool.whirl * math.sin(turn), 0.0])
        place = np.array([0.12 + s, 0.0, 0.12])
        other += force
        moment += _cross(place, force)
    if tool.slosh_mass > 0.0:
        w = 2 * math.pi * tool.slosh_hz
        dy[4] = y[5]
        dy[5] = -rest[1] - w * w * y[4] - 2 * tool.slosh_damping * w * y[5]
        force = np.array([0.0, -tool.slosh_mass * dy[5], 0.0])
        other += force
        moment += _cross(r, force)
    slide = -_spring(s, tool) - tool.damping * ds
    if tool.friction > 0.0:
        dy[2] = ds - abs(ds) / tool.presliding * y[2]
        slide -= tool.friction / tool.presliding * y[2]
    if tool.branch > 0.0:
        dy[3] = (s - y[3]) / tool.relaxation
        slide -= tool.branch * (s - y[3])
    dy[0] = ds
    dy[1] = (slide + contact[0] + other[0]) / tool.mass - rest[0]
    if wall.mass > 0.0:
        dy[6] = y[7]
        dy[7] = (-press[0] - wall.back_stiffness * y[6]
                 - wall.back_damping * y[7]) / wall.mass
    rest[0] += dy[1]
    return dy, contact, other, moment, rest, base


@njit(cache=True)
def _run(x, v, a, R, omega, alpha, tool, wall, accelerometer, rest_steps):  # type: ignore
    h = 2.0 * STEP
    count = (len(x) - 1) // 2
    wrench, specific = np.empty((count, 6)), np.empty((count, 3))
    slide, pressed = np.empty(count), np.empty((count, 3))
    y = np.zeros(8)
    y[0] = 0.0
    still = np.zeros(3)
    for n in range(-rest_steps, 0):
        y = y + _increment(n * h, h, y, x[0], x[0], x[0], still, still, still, still, still,
                           still, R[0], R[0], R[0], still, still, still, still, still, still,
                           tool, wall)
    for n in range(count):
        i = 2 * n
        dy, contact, other, moment, acceleration, base = _balance(
            n * h, y, x[i], v[i], a[i], R[i], omega[i], alpha[i], tool, wall)
        r, p = tool.com.copy(), wall.tip.copy()
        r[0] += y[0]
        p[0] += y[0]
        momentum = tool.mass * acceleration
        wrench[n, :3] = -(momentum - contact - other)
        spin = tool.inertia * omega[i]
        wrench[n, 3:] = -(_cross(r, momentum) + tool.inertia * alpha[i]
                          + _cross(omega[i], spin) - _cross(p, contact) - moment)
        q = accelerometer.copy()
        q[0] += y[0]
        felt = base + _cross(alpha[i], q) + _cross(omega[i], _cross(omega[i], q))
        felt[0] += dy[1]
        felt[1] += 2.0 * omega[i, 2] * y[1]
        felt[2] -= 2.0 * omega[i, 1] * y[1]
        specific[n] = felt
        slide[n] = y[0]
        pressed[n] = contact
        y = y + _increment(n * h, h, y, x[i], x[i + 1], x[i + 2], v[i], v[i + 1], v[i + 2],
                           a[i], a[i + 1], a[i + 2], R[i], R[i + 1], R[i + 2], omega[i],
                           omega[i + 1], omega[i + 2], alpha[i], alpha[i + 1], alpha[i + 2],
                           tool, wall)
    return wrench, specific, slide, pressed


@njit(cache=True)
def _increment(t, h, y, x0, x1, x2, v0, v1, v2, a0, a1, a2, R0, R1, R2,  # type: ignore
               w0, w1, w2, b0, b1, b2, tool, wall):
    k1 = _balance(t, y, x0, v0, a0, R0, w0, b0, tool, wall)[0]
    k2 = _balance(t + 0.5 * h, y + 0.5 * h * k1, x1, v1, a1, R1, w1, b1, tool, wall)[0]
    k3 = _balance(t + 0.5 * h, y + 0.5 * h * k2, x1, v1, a1, R1, w1, b1, tool, wall)[0]
    k4 = _balance(t + h, y + h * k3, x2, v2, a2, R2, w2, b2, tool, wall)[0]
    return h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def feel(tool: Tool, wall: Wall, motion: Motion, accelerometer: Array) -> Felt:
    """
    Return what the sensors are exposed to.

    Parameters
    ----------
    tool : Tool
    wall : Wall
    motion : Motion
    accelerometer : ndarray, shape (3,)
        Its place in S at zero displacement [m].

    Returns
    -------
    Felt
    """
    rest = REST * (3 if tool.branch else 1)
    return Felt(*_run(*motion, tool, wall, accelerometer, rest))
