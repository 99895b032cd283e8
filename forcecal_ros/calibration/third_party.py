"""Calibration files of other packages, read as a Calibration: mass, centre of mass, bias.

Both say what a reading at rest is in the same way as this package: weight plus bias, wire sign.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from forcecal_ros.calibration.model import Calibration, Estimate
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array
import numpy as np

KTH = ('gripper_mass', 'gripper_com_pose', 'bias', 'gripper_com_frame_id')
"""Keys of a file of kth-ros-pkg/force_torque_tools: mass, CoM with RPY, bias, frame of both."""

FT_TOOLS = ('mass', 'sensor_frame_to_com', 'force_offset', 'torque_offset')
"""Keys of a file of ft_tools_ros2."""


class _Numbers(NamedTuple):
    document: Mapping[str, Any]
    name: str

    def read(self, key: str, count: int) -> Array:
        """Return some numbers in SI units."""
        value = self.document.get(key)
        try:
            numbers = np.array(value, dtype=float).reshape(-1)
        except (TypeError, ValueError):
            numbers = np.array([])
        if len(numbers) != count or not np.isfinite(numbers).all():
            raise ConfigError(f'{self.name}: {key} is {str(value)[:80]}, expected '
                              f'{f"{count} numbers" if count > 1 else "a number"}')
        return numbers


def recognise(document: Mapping[str, Any], name: str) -> Calibration | None:
    """
    Turn the file of another package into a calibration.

    Parameters
    ----------
    document : mapping
        Read from YAML.
    name : str
        File, for messages.

    Returns
    -------
    Calibration or None
        With mass, centre of mass and wrench bias, standard errors not known; None where the
        document is none of theirs.

    Raises
    ------
    ConfigError
        A number is missing or malformed.
    """
    numbers = _Numbers(document, name)
    if KTH[0] in document:
        mass, com, bias = (numbers.read(key, count) for key, count in zip(KTH, (1, 6, 6)))
        frame, origin = str(document.get(KTH[3], 'ft_sensor')).lstrip('/'), 'force_torque_tools'
    elif FT_TOOLS[1] in document:
        mass, com, force, torque = (
            numbers.read(key, count) for key, count in zip(FT_TOOLS, (1, 3, 3, 3)))
        bias, frame, origin = np.concatenate([force, torque]), 'ft_sensor', 'ft_tools'
    else:
        return None
    if not mass[0] > 0:
        raise ConfigError(f'{name}: the mass is {mass[0]:g}, expected a positive one [kg]')
    return Calibration(
        mass=Estimate(mass[0], np.nan, 'kg'), com=Estimate(com[:3], np.nan, 'm'),
        wrench_bias=Estimate(bias, np.nan, 'N, N m'), sensor_frame=frame,
        source={'file': name, 'of': origin})
