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
    normal = 0.0
    if depth > 0.0:
        elastic = wall.stiffness * depth
        if wall.power != 1.0:
            elastic = wall.stiffness * wall.depth * (depth / wall.depth) ** wall.power
        normal = max(0.0, elastic + wall.damping * speed)
    x, y, z = -normal, 0.0, 0.0
    if wall.pull > 0.0 and depth > -wall.reach:
        x += wall.pull * min(1.0, 1.0 + depth / wall.reach)
    if wall.grip > 0.0 and normal > 0.0:
        slip = math.sqrt(slip_y * slip_y + slip_z * slip_z + 1e-6)
        y = -wall.grip * normal * slip_y / slip
        z = -wall.grip * normal * slip_z / slip
    return x, y, z


# Vectors are tuples of numbers below: unlike small arrays they cost no memory.

@njit(cache=True)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True)
def _sum(a, b):  # type: ignore[no-untyped-def]
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@njit(cache=True)
def _slid(place, s):  # type: ignore[no-untyped-def]
    return (place[0] + s, place[1], place[2])


@njit(cache=True)
def _to_base(R, a):  # type: ignore[no-untyped-def]
    return (R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
            R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
            R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2])


@njit(cache=True)
def _to_sensor(R, a):  # type: ignore[no-untyped-def]
    return (R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
            R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
            R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2])


@njit(cache=True)
def _cable(x, R, s, tool):  # type: ignore[no-untyped-def]
    """Return force and moment about S of the cable on the tool."""
    end = _slid(tool.cable_end, s)
    at = _to_base(R, end)
    line = (tool.cable_anchor[0] - x[0] - at[0], tool.cable_anchor[1] - x[1] - at[1],
            tool.cable_anchor[2] - x[2] - at[2])
    length = math.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
    pull = max(0.0, tool.cable_tension + tool.cable_rate * (length - tool.cable_length)) / length
    force = _to_sensor(R, (pull * line[0], pull * line[1], pull * line[2]))
    return force, _cross(end, force)


@njit(cache=True)
def _unbalance(t, s, tool):  # type: ignore[no-untyped-def]
    """Return force and moment about S of the spindle."""
    turn = 2 * math.pi * tool.whirl_hz * (
        t + tool.whirl_wander * math.sin(2 * math.pi * 0.3 * t) / (2 * math.pi * 0.3))
    force = (tool.whirl * math.cos(turn), tool.whirl * math.sin(turn), 0.0)
    return force, _cross((0.12 + s, 0.0, 0.12), force)


@njit(cache=True)
def _balance(t, y, x, v, a, R, omega, alpha, tool, wall):  # type: ignore[no-untyped-def]
    """Return dy/dt, the screen's force in S, other forces on the tool in S, their moment.

    And acceleration minus gravity of the CoM and of S, in S. y: slide and its speed, friction,
    Maxwell element, slosh and its speed, screen and its speed.
    """
    s, ds = y[0], y[1]
    base = _to_sensor(R, (a[0] - tool.gravity[0], a[1] - tool.gravity[1],
                          a[2] - tool.gravity[2]))
    r = _slid(tool.com, s)
    rest = _sum(_sum(base, _cross(alpha, r)), _cross(omega, _cross(omega, r)))
    rest = (rest[0], rest[1] + 2.0 * omega[2] * ds, rest[2] - 2.0 * omega[1] * ds)
    p = _slid(wall.tip, s)
    tip = _to_base(R, p)
    speed = _to_base(R, _slid(_cross(omega, p), ds))
    press = _press(x[0] + tip[0] - wall.place - y[6], v[0] + speed[0] - y[7], v[1] + speed[1],
                   v[2] + speed[2], wall)
    contact = _to_sensor(R, press)
    other, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if tool.cable_tension > 0.0 or tool.cable_rate > 0.0:
        force, torque = _cable(x, R, s, tool)
        other, moment = _sum(other, force), _sum(moment, torque)
    if tool.whirl > 0.0:
        force, torque = _unbalance(t, s, tool)
        other, moment = _sum(other, force), _sum(moment, torque)
    swing = 0.0
    if tool.slosh_mass > 0.0:
        w = 2 * math.pi * tool.slosh_hz
        swing = -rest[1] - w * w * y[4] - 2 * tool.slosh_damping * w * y[5]
        force = (0.0, -tool.slosh_mass * swing, 0.0)
        other, moment = _sum(other, force), _sum(moment, _cross(r, force))
    slide = -_spring(s, tool) - tool.damping * ds
    bristle = creep = pushed = 0.0
    if tool.friction > 0.0:
        bristle = ds - abs(ds) / tool.presliding * y[2]
        slide -= tool.friction / tool.presliding * y[2]
    if tool.branch > 0.0:
        creep = (s - y[3]) / tool.relaxation
        slide -= tool.branch * (s - y[3])
    dds = (slide + contact[0] + other[0]) / tool.mass - rest[0]
    if wall.mass > 0.0:
        pushed = (-press[0] - wall.back_stiffness * y[6] - wall.back_damping * y[7]) / wall.mass
    dy = (ds, dds, bristle, creep, y[5] if tool.slosh_mass > 0.0 else 0.0, swing,
          y[7] if wall.mass > 0.0 else 0.0, pushed)
    return dy, contact, other, moment, _slid(rest, dds), base


@njit(cache=True)
def _on(y, h, k):  # type: ignore[no-untyped-def]
    return (y[0] + h * k[0], y[1] + h * k[1], y[2] + h * k[2], y[3] + h * k[3],
            y[4] + h * k[4], y[5] + h * k[5], y[6] + h * k[6], y[7] + h * k[7])


@njit(cache=True)
def _advance(t, y, i, j, k, x, v, a, R, omega, alpha, tool, wall):  # type: ignore
    """Go on by two steps of the motion, by Runge-Kutta, over its samples i, j and k."""
    h = 2.0 * STEP
    k1 = _balance(t, y, x[i], v[i], a[i], R[i], omega[i], alpha[i], tool, wall)[0]
    k2 = _balance(t + 0.5 * h, _on(y, 0.5 * h, k1), x[j], v[j], a[j], R[j], omega[j], alpha[j],
                  tool, wall)[0]
    k3 = _balance(t + 0.5 * h, _on(y, 0.5 * h, k2), x[j], v[j], a[j], R[j], omega[j], alpha[j],
                  tool, wall)[0]
    k4 = _balance(t + h, _on(y, h, k3), x[k], v[k], a[k], R[k], omega[k], alpha[k], tool,
                  wall)[0]
    return _on(_on(_on(_on(y, h / 6.0, k1), h / 3.0, k2), h / 3.0, k3), h / 6.0, k4)


@njit(cache=True)
def _run(x, v, a, R, omega, alpha, tool, wall, accelerometer, rest_steps):  # type: ignore
    h = 2.0 * STEP
    count = (len(x) - 1) // 2
    wrench, specific = np.empty((count, 6)), np.empty((count, 3))
    slide, pressed = np.empty(count), np.empty((count, 3))
    y = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for n in range(-rest_steps, 0):
        y = _advance(n * h, y, 0, 0, 0, x, v, a, R, omega, alpha, tool, wall)
    for n in range(count):
        i = 2 * n
        w, turn = omega[i], alpha[i]
        dy, contact, other, moment, acceleration, base = _balance(
            n * h, y, x[i], v[i], a[i], R[i], w, turn, tool, wall)
        r, p, q = _slid(tool.com, y[0]), _slid(wall.tip, y[0]), _slid(accelerometer, y[0])
        momentum = (tool.mass * acceleration[0], tool.mass * acceleration[1],
                    tool.mass * acceleration[2])
        spin = (tool.inertia[0] * w[0], tool.inertia[1] * w[1], tool.inertia[2] * w[2])
        twist = _sum(_cross(r, momentum), _cross(w, spin))
        lever = _sum(_cross(p, contact), moment)
        felt = _sum(_sum(base, _cross(turn, q)), _cross(w, _cross(w, q)))
        for j in range(3):
            wrench[n, j] = contact[j] + other[j] - momentum[j]
            wrench[n, 3 + j] = lever[j] - twist[j] - tool.inertia[j] * turn[j]
            pressed[n, j] = contact[j]
        specific[n, 0] = felt[0] + dy[1]
        specific[n, 1] = felt[1] + 2.0 * w[2] * y[1]
        specific[n, 2] = felt[2] - 2.0 * w[1] * y[1]
        slide[n] = y[0]
        y = _advance(n * h, y, i, i + 1, i + 2, x, v, a, R, omega, alpha, tool, wall)
    return wrench, specific, slide, pressed


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
