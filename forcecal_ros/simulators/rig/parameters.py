"""What the compiled loops read of a rig: one flat record."""

import math

from forcecal_ros.effects.numbers import physical_rig
from forcecal_ros.effects.rig import Rig
from forcecal_ros.geometry import Array
from forcecal_ros.simulators.rig.slide_effects import SLIDE_EFFECTS, slide_effects
import numpy as np

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
