"""What the compiled loops read of a rig: one flat record, effects on the tool's slide included."""

import math
from typing import Any

from forcecal_ros.core.geometry import Array
from forcecal_ros.effects.chosen import named_effects
from forcecal_ros.effects.library import EFFECTS
from forcecal_ros.effects.numbers import physical_rig
from forcecal_ros.effects.rig import Rig
import numpy as np

SLIDE_EFFECTS = (
    ('extra', 'f8'),                      # 1: something of the following is not 0
    ('stiffening', 'f8'),                 # [N/m^3]
    ('friction', 'f8'),                   # [N]
    ('friction_speed', 'f8'),             # [m/s] at which 76 % of it act
    ('presliding', 'f8'),                 # [m] after which it acts in full; 0: by speed instead
    ('half_gap', 'f8'),                   # [m] of play either way
    ('cable_force', 'f8', 3),             # [N] in base, S at home and the tool undisplaced
    ('cable_stiffness', 'f8'),            # [N/m]
    ('cable_point', 'f8', 3),             # [m] in S, tool undisplaced
    ('cable_home', 'f8', 3),              # [m] where the point is in base at home
    ('spindle_sine', 'f8', 3),            # [N] in S
    ('spindle_cosine', 'f8', 3),          # [N] in S
    ('spindle_rate', 'f8'),               # [rad/s]
    ('spindle_point', 'f8', 3),           # [m] in S, tool undisplaced
)
"""Fields of the record; :mod:`forcecal_ros.sim.rig.tool` says what they do."""

USUAL = 0.015
"""Displacement up to which the integration resolves a stiffening spring [m]."""

STICKING = 0.5
"""Share of the rate of creep in friction that the integration resolves: creep is over at once."""

NAMES = ('tool_stiffening', 'tool_friction', 'tool_backlash', 'cable_force', 'spindle_vibration')
"""Effects that enter the integration of the tool."""


def slide_effects(rig: Rig) -> tuple[Any, ...]:
    """
    Flatten the effects that enter the integration of the tool.

    Returns
    -------
    tuple
        One value for each of SLIDE_EFFECTS.
    """
    named = named_effects(rig.effects)
    extra = float(any(name in named for name in NAMES))
    stiffening, friction, backlash, cable, spindle = (
        named.get(name) or {q.name: q.nominal for q in EFFECTS[name].parameters}
        for name in NAMES)
    cable_point = [cable[f'point_{axis}'] for axis in 'xyz']
    return (
        extra, stiffening['cubic'], friction['force'], friction['velocity_scale'],
        friction['presliding'], 0.5 * backlash['gap'],
        [cable[axis] for axis in 'xyz'], cable['stiffness'], cable_point,
        np.array(rig.home.position) + rig.home.R_base_sensor @ cable_point,
        [spindle[f'sine_{axis}'] for axis in 'xyz'],
        [spindle[f'cosine_{axis}'] for axis in 'xyz'],
        2.0 * math.pi * spindle['frequency'], [spindle[f'point_{axis}'] for axis in 'xyz'],
    )


def slide_rates(rig: Rig) -> list[float]:
    """
    Return the rates that these effects add to the tool's dynamics.

    Returns
    -------
    list of float
        [rad/s]
    """
    named = named_effects(rig.effects)
    rates = []
    if 'tool_stiffening' in named and rig.optidrive:
        cubic = named['tool_stiffening']['cubic']
        rates.append(math.sqrt((rig.optidrive.stiffness + rig.wall.stiffness
                                + 3.0 * max(0.0, cubic) * USUAL ** 2) / rig.tool.mass))
    if 'tool_friction' in named:
        v = named['tool_friction']
        if v['presliding']:
            stiffness = rig.optidrive.stiffness if rig.optidrive else 0.0
            rates.append(math.sqrt((stiffness + v['force'] / v['presliding']) / rig.tool.mass))
        else:
            rates.append(v['force'] / v['velocity_scale'] / rig.tool.mass * STICKING)
    if 'spindle_vibration' in named:
        rates.append(2.0 * math.pi * named['spindle_vibration']['frequency'])
    return rates


PARAMETERS = np.dtype([
    ('period', 'f8'),                     # [s]
    ('feedback', 'f8', (3, 3)),           # [1] axis, k-1 to k-3
    ('feedforward', 'f8', (3, 3)),        # [1] the same of the commands
    ('direct', 'f8', 3),                  # 1: those are of k to k-2
    ('position_bandwidth', 'f8'),         # [rad/s]
    ('orientation_bandwidth', 'f8'),      # [rad/s]
    ('orientation_damping', 'f8'),        # [1]
    ('gravity', 'f8', 3),                 # [m/s^2] in base
    ('mass', 'f8'),                       # [kg]
    ('com', 'f8', 3),                     # [m] in S, tool undisplaced
    ('inertia', 'f8', (3, 3)),            # [kg m^2] about the CoM
    ('rigid', 'f8'),                      # 1: the tool does not slide
    ('stiffness', 'f8'),                  # [N/m]
    ('damping', 'f8'),                    # [N s/m]
    ('tip', 'f8', 3),                     # [m] in S, tool undisplaced
    ('wall_position', 'f8'),              # [m]
    ('wall_stiffness', 'f8'),             # [N/m]
    ('wall_damping', 'f8'),               # [N s/m]
    ('accelerometer_position', 'f8', 3),  # [m] in S, tool undisplaced
    ('highpass', 'f8'),                   # [rad/s]
    *SLIDE_EFFECTS,
])
"""Layout of the record; numba compiles anew when it changes."""


def kernel_parameters(rig: Rig, accelerometer: str | None = None) -> Array:
    """
    Flatten the numbers that the compiled loops need.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the mounted one where none is given.

    Returns
    -------
    ndarray of PARAMETERS, shape ()
        Its ``[()]`` is the record that the loops take.
    """
    rig = physical_rig(rig)
    slides = rig.optidrive
    model = rig.accelerometer.model(accelerometer)
    robot, damping = rig.robot, rig.servo.orientation_damping
    return np.array((
        robot.period, [(axis or robot).feedback for axis in robot.axes],
        [(axis or robot).feedforward for axis in robot.axes],
        [0.0 if axis is None else 1.0 for axis in robot.axes],
        rig.servo.position_bandwidth, rig.servo.orientation_bandwidth,
        1.0 if damping is None else damping,
        rig.gravity,
        rig.tool.mass, rig.tool.com, rig.tool.inertia,
        0.0 if slides else 1.0,
        slides.stiffness if slides else 0.0, slides.damping if slides else 0.0,
        rig.tool.tip, rig.wall.position, rig.wall.stiffness, rig.wall.damping,
        rig.accelerometer.position, 2.0 * math.pi * model.highpass,
        *slide_effects(rig),
    ), dtype=PARAMETERS)
