"""The readings of the sensors: wrench of the tool on the wrist, volts, displacement, pose."""

import math
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_from_vector
from forcecal_ros.core.jit import compiled, Record
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.robot import Motion
from forcecal_ros.sim.rig.tool import Slide
import numpy as np

HIGHPASS_STATE = np.dtype([
    ('input', 'f8', 3),     # [m/s^2] specific force at the last step
    ('output', 'f8', 3),    # [m/s^2] what passes
])


class Response(NamedTuple):
    """
    What the sensors respond to, at the steps of the integration, the start left out.

    Attributes
    ----------
    wrench : ndarray, shape (n, 6)
        Wrench that the tool exerts on the sensor: environment on tool, in S [N], [N m].
    contact : ndarray, shape (n, 6)
        The environment's part of it.
    specific_force : ndarray, shape (n, 3)
        At the accelerometer, in S, high-passed where it is AC-coupled [m/s^2].
    """

    wrench: Array
    contact: Array
    specific_force: Array

    @classmethod
    def empty(cls, n: int) -> 'Response':
        """Make room for n steps."""
        return cls(np.empty((n, 6)), np.empty((n, 6)), np.empty((n, 3)))


def highpass_settled(p: Record, R_base_sensor: Array) -> Array:
    """
    State of the accelerometer's high-pass after rest at one orientation for ever.

    Parameters
    ----------
    R_base_sensor : ndarray, shape (3, 3)

    Returns
    -------
    ndarray of HIGHPASS_STATE, shape (1,)
        Its ``[0]`` is the record that :func:`respond` takes and changes.
    """
    specific_force = -(R_base_sensor.T @ p['gravity'])
    return np.array([(specific_force, (0.0, 0.0, 0.0))], dtype=HIGHPASS_STATE)


@compiled
def respond(p: Record, state: Record, motion: Motion, slide: Slide, h: float,
            out: Response) -> None:
    """
    Newton and Euler for the moving tool, and its specific force at the accelerometer.

    a_c = a_S + alpha x r + omega x (omega x r) + 2 omega x (ds/dt x_hat) + d2s/dt2 x_hat with the
    centre of mass at r, all in S; u = m (a_c - g) - f_env ([Gamez2005]'s u = F + m a, F = -f_env),
    n = r x m (a_c - g) + J alpha + omega x J omega - p x f_env; the wrench is -(u, n).

    Parameters
    ----------
    state : record of HIGHPASS_STATE
        Before; after the call, at the last step.
    motion : Motion
        At 2 n + 1 nodes, half a step apart.
    slide : Slide
        At n + 1 steps.
    h : float
        Step [s].
    out : Response
        Filled, n steps.
    """
    specific, force, torque = np.empty(3), np.empty(3), np.empty(3)
    r, tip, q = np.empty(3), np.empty(3), np.empty(3)
    w, spin, contact = np.empty(3), np.empty(3), np.empty(6)
    R, omega, alpha = motion.R_base_sensor, motion.omega, motion.alpha
    decay = math.exp(-p.highpass * h)
    rise = (1.0 - decay) / (p.highpass * h) if p.highpass > 0.0 else 1.0
    for i in range(len(out.wrench)):
        j, k = 2 * i + 2, i + 1
        for axis in range(3):
            r[axis], tip[axis] = p.com[axis], p.tip[axis]
            q[axis] = p.accelerometer_position[axis]
            w[axis] = omega[j, axis]
            contact[axis] = -slide.push[k] * R[j, 0, axis]
        r[0] += slide.slide[k]
        tip[0] += slide.slide[k]
        q[0] += slide.slide[k]
        contact[3] = tip[1] * contact[2] - tip[2] * contact[1]
        contact[4] = tip[2] * contact[0] - tip[0] * contact[2]
        contact[5] = tip[0] * contact[1] - tip[1] * contact[0]
        _specific_force(p, motion, slide, j, w, r, specific)
        for axis in range(3):
            force[axis] = p.mass * specific[axis]
        _cross(r, force, torque)
        _add_euler(p.inertia, w, alpha, j, torque, spin)
        for axis in range(6):
            out.contact[i, axis] = contact[axis]
        for axis in range(3):
            out.wrench[i, axis] = contact[axis] - force[axis]
            out.wrench[i, 3 + axis] = contact[3 + axis] - torque[axis]
        if p.extra > 0.0:
            for axis in range(6):
                out.wrench[i, axis] += slide.load[k, axis]
        _specific_force(p, motion, slide, j, w, q, specific)
        # the high-pass dy/dt = df/dt - cutoff y, exact for f linear within the step
        for axis in range(3):
            step = specific[axis] - state.input[axis]
            state.output[axis] = decay * state.output[axis] + rise * step
            state.input[axis] = specific[axis]
            out.specific_force[i, axis] = (state.output[axis] if p.highpass > 0.0
                                           else specific[axis])


@compiled
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@compiled
def _specific_force(p: Record, motion: Motion, slide: Slide, j: int, w: Array, r: Array,
                    out: Array) -> None:
    """Write a - g in S of the point r of the tool, by the formula of a_c with r for the CoM."""
    R, alpha, acceleration = motion.R_base_sensor, motion.alpha, motion.acceleration
    k = j // 2
    dot = w[0] * r[0] + w[1] * r[1] + w[2] * r[2]
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    out[0] = alpha[j, 1] * r[2] - alpha[j, 2] * r[1]
    out[1] = alpha[j, 2] * r[0] - alpha[j, 0] * r[2]
    out[2] = alpha[j, 0] * r[1] - alpha[j, 1] * r[0]
    for axis in range(3):
        out[axis] += w[axis] * dot - square * r[axis]
        for i in range(3):
            out[axis] += R[j, i, axis] * (acceleration[j, i] - p.gravity[i])
    out[0] += slide.acceleration[k]
    out[1] += 2.0 * w[2] * slide.speed[k]
    out[2] -= 2.0 * w[1] * slide.speed[k]


@compiled
def _add_euler(inertia: Array, w: Array, alpha: Array, j: int, torque: Array, spin: Array
               ) -> None:
    """Add J alpha + omega x J omega, alpha of node j; ``spin`` is room for J omega."""
    for axis in range(3):
        spin[axis] = 0.0
        for i in range(3):
            torque[axis] += inertia[axis, i] * alpha[j, i]
            spin[axis] += inertia[axis, i] * w[i]
    torque[0] += w[1] * spin[2] - w[2] * spin[1]
    torque[1] += w[2] * spin[0] - w[0] * spin[2]
    torque[2] += w[0] * spin[1] - w[1] * spin[0]


class Noise:
    """
    White noise of every sensor, each from a generator of its own.

    A signal's noise does not depend on the other signals, nor on how the samples are divided
    into blocks.

    Parameters
    ----------
    seed : int, optional
        Fresh noise each time where none is given.

    Attributes
    ----------
    seed_of_losses : numpy.random.SeedSequence
        For what else is random.
    """

    def __init__(self, rig: Rig, seed: int | None = None) -> None:
        self._rig = rig
        names = ('wrench', 'volts', 'optidrive', 'position', 'orientation')
        *seeds, self.seed_of_losses = np.random.SeedSequence(seed).spawn(len(names) + 1)
        self._generators = {n: np.random.default_rng(s) for n, s in zip(names, seeds)}

    def _draw(self, name: str, shape: tuple[int, ...]) -> Array:
        return np.asarray(self._generators[name].standard_normal(shape))

    def wrench(self, n: int) -> Array:
        """Noise of n wrenches, shape (n, 6) [N], [N m]."""
        sensor = self._rig.wrench_sensor
        noise = self._draw('wrench', (n, 6))
        noise[:, :3] *= sensor.force_noise
        noise[:, 3:] *= sensor.torque_noise
        return noise

    def volts(self, n: int) -> Array:
        """Noise of n accelerometer samples, shape (n, 3) [V]."""
        return self._draw('volts', (n, 3)) * self._rig.accelerometer.noise

    def optidrive(self, n: int) -> Array:
        """Noise of n displacements, shape (n,) [m]."""
        level = self._rig.optidrive.noise if self._rig.optidrive else 0.0
        return self._draw('optidrive', (n,)) * level

    def position(self, n: int) -> Array:
        """Noise of n positions, shape (n, 3) [m]."""
        return self._draw('position', (n, 3)) * self._rig.pose_sensor.position_noise

    def turn(self, n: int) -> Array:
        """Noise of n orientations, rotations in S, shape (n, 3, 3)."""
        vectors = self._draw('orientation', (n, 3)) * self._rig.pose_sensor.orientation_noise
        return rotation_from_vector(vectors)
