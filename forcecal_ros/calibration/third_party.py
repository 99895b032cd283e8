"""Calibration files of other packages, read as a Calibration: mass, centre of mass, bias.

Both say what a reading at rest is in the same way as this package: weight plus bias, wire sign.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from forcecal_ros.calibration.model import Calibration, Estimate
from forcecal_ros.errors import ConfigError
from forcecal_ros.schema import read, Row, Vector3, Vector6
import numpy as np


@dataclass(frozen=True, kw_only=True)
class Kth:
    """File of kth-ros-pkg/force_torque_tools."""

    bias: Annotated[Vector6, Row('Reading without load', 'N, N m')]
    gripper_mass: Annotated[float, Row('Of what hangs on the sensor', 'kg', above=0.0)]
    gripper_com_frame_id: Annotated[str, Row('frame_id of pose and bias')] = 'ft_sensor'
    gripper_com_child_frame_id: Annotated[str, Row('frame_id at the centre')] = 'gripper_com'
    gripper_com_pose: Annotated[Vector6, Row('x y z [m], roll pitch yaw [rad]')]


@dataclass(frozen=True, kw_only=True)
class FtTools:
    """File of ft_tools_ros2."""

    mass: Annotated[float, Row('Of what hangs on the sensor', 'kg', above=0.0)]
    sensor_frame_to_com: Annotated[Vector3, Row('Centre of mass', 'm')]
    force_offset: Annotated[Vector3, Row('Reading without load', 'N')]
    torque_offset: Annotated[Vector3, Row('Reading without load', 'N m')]


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
    try:
        if 'gripper_mass' in document:
            kth = read(Kth, document, extra=True)
            return _calibration(kth.gripper_mass, kth.gripper_com_pose[:3], kth.bias,
                                'force_torque_tools', name, kth.gripper_com_frame_id.lstrip('/'))
        if 'sensor_frame_to_com' in document:
            tools = read(FtTools, document, extra=True)
            return _calibration(tools.mass, tools.sensor_frame_to_com,
                                (*tools.force_offset, *tools.torque_offset), 'ft_tools', name)
    except ConfigError as error:
        raise ConfigError(f'{name}: {error}; correct the file') from None
    return None


def _calibration(mass: float, com: Vector3, bias: Vector6, origin: str, name: str,
                 frame: str = 'ft_sensor') -> Calibration:
    return Calibration(
        mass=Estimate(mass, np.nan, 'kg'), com=Estimate(com, np.nan, 'm'),
        wrench_bias=Estimate(bias, np.nan, 'N, N m'), sensor_frame=frame,
        source={'file': name, 'of': origin})
