"""A run to a recording: sampling, noise, time stamps."""

from typing import NamedTuple

from blind.noise import Colour, SIGMA
from blind.rig import Rig, rotations, Truth
from blind.robot import Array
import numpy as np

FINE = 0.00025
"""Grid of a run [s]."""


class Recorded(NamedTuple):
    """
    A recording as arrays; times are header stamps [s].

    Attributes
    ----------
    wrench_t, wrench : ndarray, shape (n,), (n, 6)
    volts_t, volts : ndarray, shape (n,), (n, 3)
    slide_t, slide : ndarray, shape (n,), (n,)
    pose_t, position, R : ndarray, shape (k,), (k, 3), (k, 3, 3)
    target_t, target_position, target_R : ndarray, shape (m,), (m, 3), (m, 3, 3)
    phases : tuple of (name, start, end)
    """

    wrench_t: Array
    wrench: Array
    volts_t: Array
    volts: Array
    slide_t: Array
    slide: Array
    pose_t: Array
    position: Array
    R: Array
    target_t: Array
    target_position: Array
    target_R: Array
    phases: tuple[tuple[str, float, float], ...]


def settled_lowpass(signal: Array, pole: float) -> Array:
    """Filter by (1 - pole) / (1 - pole z^-1), at rest at the first sample."""
    from scipy.signal import lfilter
    b, a = [1.0 - pole], [1.0, -pole]
    out: Array = lfilter(b, a, signal - signal[0], axis=0) + signal[0]
    return out


def record(rig: Rig, truth: Truth, colours: dict[str, list[Colour]] | None, seed: int
           ) -> Recorded:
    """
    Record a run.

    Parameters
    ----------
    rig : Rig
    truth : Truth
    colours : dict or None
        Of the noise; None: no noise.
    seed : int
        Of noise and of what is random in effects; each has a stream of its own, so that a run
        with and one without an effect have the same noise.

    Returns
    -------
    Recorded
    """
    sensors, t = rig.sensors, truth.t
    streams = np.random.SeedSequence(seed).spawn(10)
    rng = [np.random.default_rng(one) for one in streams]
    each, slow = slice(4, None, 4), slice(16, None, 16)

    def noisy(values: Array, name: str, source: np.random.Generator) -> Array:
        if colours is None:
            return values
        loud = np.interp(np.linspace(0.0, 1.0, len(values)), np.linspace(0.0, 1.0, len(t)),
                         np.linalg.norm(truth.motion.acceleration, axis=1))
        noise = [colour.draw(len(values), sigma, source, loud)
                 for colour, sigma in zip(colours[name], SIGMA[name])]
        return values + np.stack(noise, axis=1)

    wrench = truth.felt.wrench
    for stage in sensors.wrench:
        wrench = stage(truth, wrench, rng[0])
    wrench = noisy((wrench * sensors.gain + sensors.bias)[each], 'wrench', rng[1])
    for stage in sensors.wrench_reading:
        wrench = stage(truth, wrench, rng[6])
    specific = truth.felt.specific
    for stage in sensors.specific:
        specific = stage(truth, specific, rng[2])
    if sensors.accel_highpass:
        pole = float(np.exp(-2 * np.pi * sensors.accel_highpass * FINE))
        specific = specific - settled_lowpass(specific, pole)
    volts = noisy((specific * sensors.accel_gain + sensors.accel_offset)[each], 'volts', rng[3])
    slide = truth.felt.slide
    for stage in sensors.slide:
        slide = stage(truth, slide, rng[4])
    slide = noisy(slide[each, None], 'slide', rng[5])[:, 0]
    for stage in sensors.volts_reading:
        volts = stage(truth, volts, rng[6])
    position, R = truth.motion.position, truth.motion.R
    for stage in sensors.pose:
        position, R = stage(truth, (position, R), rng[7])
    position = noisy(position[slow], 'position', rng[8])
    turn = noisy(np.zeros_like(position), 'turn', rng[8])
    R = R[slow] @ rotations(turn)
    commands = truth.commands
    recorded = Recorded(t[each], wrench, t[each], volts, t[each], slide, t[slow], position, R,
                        0.004 * np.arange(len(commands.position), dtype=float), commands.position,
                        commands.R, commands.phases)
    for stage in sensors.stamps:
        recorded = stage(truth, recorded, rng[9])
    return recorded
