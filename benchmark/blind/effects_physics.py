"""Effects in robot, tool and environment that the library names, in forms of their own."""

import math

from blind.effect import direction, Effect, sign
from blind.rig import Rig, rotation
import numpy as np

Random = np.random.Generator


def _mass(rig: Rig, size: float, rng: Random) -> Rig:
    """Clamp a payload at the CoM."""
    return rig._replace(tool=rig.tool._replace(mass=rig.tool.mass * (1 + sign(rng) * size)))


def _com(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(tool=rig.tool._replace(com=rig.tool.com + size * direction(rng)))


def _stiffness(rig: Rig, size: float, rng: Random) -> Rig:
    scale = (1 + size) ** sign(rng)
    return rig._replace(tool=rig.tool._replace(stiffness=rig.tool.stiffness * scale))


def _damping(rig: Rig, size: float, rng: Random) -> Rig:
    scale = (1 + size) ** sign(rng)
    return rig._replace(tool=rig.tool._replace(damping=rig.tool.damping * scale))


def _stiffening(rig: Rig, size: float, rng: Random) -> Rig:
    """Take k s0 sinh(s / s0), all odd powers; ``size`` is the cubic term it begins with."""
    hardening = math.sqrt(6.0 * size / rig.tool.stiffness)
    return rig._replace(tool=rig.tool._replace(hardening=hardening))


def _friction(rig: Rig, size: float, rng: Random) -> Rig:
    """Follow Dahl: it springs before it slides, and knows no velocity."""
    return rig._replace(tool=rig.tool._replace(
        friction=size, presliding=float(np.exp(rng.uniform(np.log(8e-5), np.log(2e-4))))))


def _backlash(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(tool=rig.tool._replace(gap=size, corner=max(1e-5, 0.05 * size)))


def _cable(rig: Rig, size: float, rng: Random) -> Rig:
    """Tie a spring to a point above the robot; its tension grows as it is drawn out."""
    anchor = np.array([rng.uniform(0.4, 1.0), rng.uniform(-0.5, 0.5), rng.uniform(1.8, 2.4)])
    end = np.array([rng.uniform(0.0, 0.1), rng.uniform(-0.05, 0.05), rng.uniform(0.05, 0.2)])
    length = float(np.linalg.norm(anchor - np.array([1.0, 0.0, 1.0])))
    return rig._replace(tool=rig.tool._replace(
        cable_tension=size, cable_rate=size * rng.uniform(0.3, 2.0), cable_length=length,
        cable_anchor=anchor, cable_end=end))


def _spindle(rig: Rig, size: float, rng: Random) -> Rig:
    """Turn a force in the x-y plane (unbalance) at a speed that wanders a little."""
    return rig._replace(tool=rig.tool._replace(
        whirl=size, whirl_hz=rng.uniform(25.0, 180.0), whirl_wander=rng.uniform(0.0, 0.004)))


def _robot_delay(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(robot=rig.robot._replace(delay=size))


def _robot_resonance(rig: Rig, size: float, rng: Random) -> Rig:
    """Add a mode that the acceleration of S excites, not a filter in its path."""
    return rig._replace(robot=rig.robot._replace(
        mode_share=size, mode_hz=float(np.exp(rng.uniform(np.log(6.0), np.log(25.0)))),
        mode_damping=rng.uniform(0.02, 0.08)))


def _tilt(rig: Rig, size: float, rng: Random) -> Rig:
    angle = rng.uniform(0, 2 * math.pi)
    axis = np.array([math.cos(angle), math.sin(angle), 0.0])
    return rig._replace(tool=rig.tool._replace(
        gravity=rotation(size * axis) @ rig.tool.gravity))


def _contact_stiffness(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(wall=rig.wall._replace(
        stiffness=rig.wall.stiffness * (1 + size) ** sign(rng)))


def _contact_damping(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(wall=rig.wall._replace(
        damping=rig.wall.damping * (1 + size) ** sign(rng)))


def _wall(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(wall=rig.wall._replace(place=rig.wall.place + sign(rng) * size))


DEGREE = math.pi / 180

EFFECTS = (
    Effect('tool_mass', 'tool', 0.017, 0.20, '1', _mass, 'mass'),
    Effect('tool_com', 'tool', 0.0018, 0.03, 'm', _com, 'com'),
    Effect('tool_stiffness', 'tool', 0.017, 0.5, '1', _stiffness, 'stiffness'),
    Effect('tool_damping', 'tool', 0.07, 2.0, '1', _damping, 'damping'),
    Effect('tool_stiffening', 'tool', 3e4, 3e7, 'N/m^3', _stiffening),
    Effect('tool_friction', 'tool', 0.05, 12.0, 'N', _friction),
    Effect('tool_backlash', 'tool', 2e-5, 3e-3, 'm', _backlash),
    Effect('cable_force', 'tool', 0.1, 20.0, 'N', _cable),
    Effect('spindle_vibration', 'tool', 0.02, 20.0, 'N', _spindle),
    Effect('robot_delay', 'robot', 2.5e-4, 0.04, 's', _robot_delay),
    Effect('robot_resonance', 'robot', 5e-4, 0.3, '1', _robot_resonance),
    Effect('base_tilt', 'robot', 0.02 * DEGREE, 5 * DEGREE, 'rad', _tilt),
    Effect('contact_stiffness', 'environment', 0.1, 2.0, '1', _contact_stiffness,
           'wall_stiffness'),
    Effect('contact_damping', 'environment', 0.35, 6.0, '1', _contact_damping, 'wall_damping'),
    Effect('wall_position', 'environment', 3.5e-4, 8e-3, 'm', _wall, 'wall_place'),
)
