"""Motion of S to the tool's slide, to what the sensor carries and what the accelerometer feels."""

import math

from blind.robot import Array, Motion, STEP
from blind.tool import Felt, Tool, Wall
from numba import njit
import numpy as np

REST = 12000
"""Steps for which the tool settles before t = 0."""


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
        reach = tool.presliding
        if tool.stribeck > 0.0:
            reach *= 1.0 + tool.stribeck * math.exp(-(ds / tool.stribeck_speed) ** 2)
        bristle = ds - abs(ds) / reach * y[2]
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
def _advance(t, y, i, j, k, x, v, a, R, omega, alpha, tool, wall):  # type: ignore[no-untyped-def]
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
def _run(  # type: ignore[no-untyped-def]
        x, v, a, R, omega, alpha, tool, wall, accelerometer, rest_steps):
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
