"""
Calibrations of other packages: read as a Calibration, written as what each of them requires.

A reading at rest is ``sign (m g + bias)`` on the wire; what each consumer makes of it decides.

Both say what a reading at rest is in the same way as this package: weight plus bias, wire sign.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import plain, read, Row, Vector3, Vector6
import numpy as np
from numpy.typing import ArrayLike
import yaml


class Place(NamedTuple):
    """
    What a calibration does not know of the robot it is exported for.

    Attributes
    ----------
    node : str
        Name of the node that takes the parameters; empty: the usual one.
    base_frame : str
        Frame whose z points up.
    R_flange_sensor : ndarray, shape (3, 3)
    sensor_in_flange : ndarray, shape (3,)
        Pose of ft_sensor in the flange of the robot [m].
    """

    node: str = ''
    base_frame: str = 'base_link'
    R_flange_sensor: Array = np.eye(3)
    sensor_in_flange: Array = np.zeros(3)


class Consumer(NamedTuple):
    """
    One package that takes a calibration.

    Attributes
    ----------
    notes : str
        What its user has to know; the head of the snippet.
    document : callable
        (calibration, place) -> what goes into the YAML.
    turns : bool
        Whether it can cope with readings of the opposite sign.
    reads_raw : bool
        Whether it works on the readings as they are on the wire.
    """

    notes: str
    document: Callable[[Calibration, Place], Mapping[str, Any]]
    turns: bool
    reads_raw: bool


def export(calibration: Calibration, consumer: str, place: Place | None = None) -> str:
    """
    Write the snippet that a consumer requires.

    Parameters
    ----------
    consumer : str
        One of ``CONSUMERS``.

    Returns
    -------
    str
        YAML with a head of comments.

    Raises
    ------
    ConfigError
        The consumer does not exist, or cannot take such readings.
    """
    if consumer not in CONSUMERS:
        raise ConfigError(f'unknown consumer {consumer!r}; use one of {", ".join(CONSUMERS)}')
    one = CONSUMERS[consumer]
    if calibration.wrench_sign < 0 and not one.turns:
        raise ConfigError(
            f'{consumer} requires the wrench of the environment on the tool, but the sensor '
            'reports the opposite (sensor.sign -1); invert it first (as --for broadcaster does)')
    if calibration.matrix is not None and one.reads_raw:
        raise ConfigError(
            f'{consumer} cannot apply the sensor matrix to raw channels; let it use '
            'observer/contact_wrench instead')
    if calibration.sensor_rotation is not None:
        raise ConfigError(
            f'{consumer} cannot rotate readings by sensor.rotation; let it use '
            'observer/contact_wrench instead')
    notes = f'{one.notes}\nCalibrated with gravity {calibration.gravity:.5f} m/s^2.'
    if calibration.gravity_direction is not None:
        notes += f'\nIt points along {_plain(calibration.gravity_direction)} of base.'
    head = ''.join(f'# {line}\n' for line in notes.splitlines())
    body = yaml.safe_dump(dict(one.document(calibration, place or Place())), sort_keys=False,
                          width=99, default_flow_style=None)
    return head + body


def _plain(values: ArrayLike) -> Any:
    """Return numbers of nine digits, as floats that YAML keeps as floats."""
    array = np.asarray(values, dtype=float)
    if array.ndim:
        return [_plain(value) for value in array]
    return float(f'{float(array):.9g}') + 0.0


def _by_axis(values: ArrayLike) -> dict[str, dict[str, float]]:
    force, torque = _plain(np.reshape(values, (2, 3)))
    return {'force': dict(zip('xyz', force)), 'torque': dict(zip('xyz', torque))}


def _parameters(node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    return {node: {'ros__parameters': dict(values)}}


def _broadcaster(c: Calibration, place: Place) -> dict[str, Any]:
    """Offsets are added before the multipliers: sign (raw - sign bias)."""
    return _parameters(place.node or 'force_torque_sensor_broadcaster', {
        'frame_id': c.sensor_frame,
        'offset': _by_axis(-c.wrench_sign * c.wrench_bias.value),
        'multiplier': _by_axis(np.full(6, float(c.wrench_sign)))})


def _upright(c: Calibration, place: Place) -> str:
    """
    Return the frame whose z points up.

    Raises
    ------
    ConfigError
        It would be a base that is not level.
    """
    if c.gravity_direction is not None and place.base_frame == Place().base_frame:
        raise ConfigError(
            f'z of {place.base_frame} does not point up: gravity was calibrated along '
            f'{_plain(c.gravity_direction)} of base; pass a level frame with --base-frame')
    return place.base_frame


def _gravity_filter(c: Calibration, place: Place) -> dict[str, Any]:
    return _parameters(place.node or 'force_torque_sensor_broadcaster', {
        'sensor_filter_chain': {'filter1': {
            'name': 'gravity_compensation',
            'type': 'control_filters/GravityCompensationWrench',
            'params': {
                'world_frame': _upright(c, place),
                'sensor_frame': c.sensor_frame,
                'tool': {'mass': _plain(c.mass.value), 'CoG': _plain(c.com.value),
                         'gravity_field': [0.0, 0.0, _plain(-c.gravity)]}}}}})


def _admittance(c: Calibration, place: Place) -> dict[str, Any]:
    return _parameters(place.node or 'admittance_controller', {
        'ft_sensor': {'frame': {'id': c.sensor_frame}},
        'fixed_world_frame': {'frame': {'id': _upright(c, place)}},
        'gravity_compensation': {
            'frame': {'id': c.sensor_frame},
            'CoG': {'pos': _plain(c.com.value), 'force': _plain(c.mass.value * c.gravity)}}})


def _ur(c: Calibration, place: Place) -> dict[str, Any]:
    x, y, z = _plain(place.sensor_in_flange + place.R_flange_sensor @ c.com.value)
    document = {'mass': _plain(c.mass.value), 'center_of_gravity': {'x': x, 'y': y, 'z': z}}
    if c.inertia is not None:
        inertia = place.R_flange_sensor @ c.inertia.value @ place.R_flange_sensor.T
        document |= {f'i{"xyz"[i]}{"xyz"[j]}': _plain(inertia[i, j])
                     for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))}
    return document


def _kth(c: Calibration, place: Place) -> dict[str, Any]:
    return dict(plain(Kth(
        bias=_plain(c.wrench_bias.value), gripper_mass=_plain(c.mass.value),
        gripper_com_frame_id=c.sensor_frame,
        gripper_com_pose=(*_plain(c.com.value), 0.0, 0.0, 0.0))))


def _ft_tools(c: Calibration, place: Place) -> dict[str, Any]:
    bias = _plain(c.wrench_bias.value)
    return dict(plain(FtTools(
        mass=_plain(c.mass.value), sensor_frame_to_com=_plain(c.com.value),
        force_offset=bias[:3], torque_offset=bias[3:])))


CONSUMERS: Mapping[str, Consumer] = {
    'broadcaster': Consumer(
        'force_torque_sensor_broadcaster (ros2_controllers): removes the bias and sets the sign.\n'
        'It publishes (raw + offset) * multiplier, so offset = -bias; the weight is not removed.',
        _broadcaster, turns=True, reads_raw=True),
    'gravity_filter': Consumer(
        'GravityCompensation (control_filters), in the filter chain of the broadcaster: removes\n'
        'the weight, after the settings of --for broadcaster have removed the bias.',
        _gravity_filter, turns=True, reads_raw=False),
    'admittance': Consumer(
        'admittance_controller (ros2_controllers): removes the weight; CoG.force is m g.\n'
        'It does not remove the bias: use a sensor whose bias is removed.',
        _admittance, turns=False, reads_raw=True),
    'ur': Consumer(
        'Request of ur_msgs/srv/SetPayload (/io_and_status_controller/set_payload), in the frame\n'
        'of the flange. The sensor and what is between it and the flange are not included.\n'
        'ur_msgs before 2.4 has mass and center_of_gravity only.',
        _ur, turns=True, reads_raw=False),
    'kth': Consumer(
        'gravity_compensation (kth-ros-pkg/force_torque_tools): removes bias and weight.',
        _kth, turns=False, reads_raw=True),
    'ft_tools': Consumer(
        'ft_estimation (ft_tools_ros2): removes bias and weight.',
        _ft_tools, turns=False, reads_raw=True),
}
"""Name -> how to write for it."""


@dataclass(frozen=True, kw_only=True)
class Kth:
    """File of kth-ros-pkg/force_torque_tools."""

    bias: Annotated[Vector6, Row('Reading without load', 'N, N m')]
    gripper_mass: Annotated[float, Row('Mass of the tool', 'kg', above=0.0)]
    gripper_com_frame_id: Annotated[str, Row('frame_id of pose and bias')] = 'ft_sensor'
    gripper_com_child_frame_id: Annotated[str, Row('frame_id at the centre')] = 'gripper_com'
    gripper_com_pose: Annotated[Vector6, Row('x y z [m], roll pitch yaw [rad]')]


@dataclass(frozen=True, kw_only=True)
class FtTools:
    """File of ft_tools_ros2."""

    mass: Annotated[float, Row('Mass of the tool', 'kg', above=0.0)]
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
