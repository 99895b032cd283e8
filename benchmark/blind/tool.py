"""What the compliant tool and the screen are, and what the sensors are exposed to."""

from typing import NamedTuple

from blind.robot import Array
import numpy as np


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
    stribeck, stribeck_speed : float
        By which it sticks more than it slides, relative; speed of that [m/s].
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
    stribeck: float = 0.0
    stribeck_speed: float = 0.01
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
