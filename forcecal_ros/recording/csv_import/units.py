"""Units that tables may be in, by quantity, and their size in SI."""

from collections.abc import Mapping
from math import pi

from forcecal_ros.geometry import STANDARD_GRAVITY

UNITS: Mapping[str, Mapping[str, float]] = {
    'force': {'N': 1.0, 'mN': 1e-3, 'kN': 1e3, 'kgf': STANDARD_GRAVITY, 'lbf': 4.4482216152605},
    'torque': {'N m': 1.0, 'Nm': 1.0, 'mN m': 1e-3, 'N mm': 1e-3, 'kN m': 1e3,
               'lbf in': 0.1129848290276167},
    'acceleration': {'m/s^2': 1.0, 'mm/s^2': 1e-3, 'g': STANDARD_GRAVITY,
                     'mg': 1e-3 * STANDARD_GRAVITY},
    'voltage': {'V': 1.0, 'mV': 1e-3},
    'angular velocity': {'rad/s': 1.0, 'deg/s': pi / 180},
    'length': {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6},
    'angle': {'rad': 1.0, 'deg': pi / 180},
    'number': {'1': 1.0},
}
"""Quantity -> unit -> its size in SI."""

NANOSECONDS: Mapping[str, int] = {'s': 10**9, 'ms': 10**6, 'us': 10**3, 'ns': 1}
"""Nanoseconds in a unit of time."""
