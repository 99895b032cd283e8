"""What the static poses show, and whether they show enough."""

from typing import NamedTuple

from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.checks.frame_faults import (
    refuse_other_frame,
    refuse_unexplained,
    refuse_weightless,
    slightly_off,
    Stated,
)
from forcecal_ros.checks.frames import Forces, judge
from forcecal_ros.checks.orientations import (
    refuse_other_orientation,
    simpler_reading,
)
from forcecal_ros.checks.torques import refuse_exchanged, refuse_other_torques
from forcecal_ros.core.axes import DOWN, level_from_base
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import Vector7
import numpy as np


class Statics(NamedTuple):
    """
    What was read in each static pose.

    Attributes
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    wrench : ndarray, shape (n, 6)
        Mean on the wire [N, N m].
    covariance : ndarray, shape (n, 6, 6), or None
        Of these means; None: not known, taken from the residuals.
    slide : ndarray, shape (n,), or None
        Mean displacement of the tool along x; zeros for a rigid one, None where it slides
        unobserved [m].
    slide_variance : ndarray, shape (n,)
        Of these means [m^2].
    sag : tuple of float or None
        m^2 / k and its variance where the stiffness is known otherwise [kg^2 m/N].
    ringing : ndarray, shape (n, 2), or None
        Mean of what the tool still rings along x: displacement, which is a share of ``slide``,
        and acceleration [m, m/s^2]; None: not known.
    """

    gravity: Array
    wrench: Array
    covariance: Array | None
    slide: Array | None
    slide_variance: Array
    sag: tuple[float, float] | None = None
    ringing: Array | None = None

    @property
    def carried(self) -> Array:
        """Gravity less the tool's own acceleration: the sensor's load over mass, (n, 3)."""
        if self.ringing is None:
            return self.gravity
        return np.asarray(self.gravity - self.ringing[:, 1:] * [1.0, 0.0, 0.0])

    @property
    def slide_at_rest(self) -> Array | None:
        """Displacement that the weight alone gives, shape (n,) [m]."""
        if self.slide is None or self.ringing is None:
            return self.slide
        return np.asarray(self.slide - self.ringing[:, 0])


def gravity_spread(gravity: Array) -> tuple[Array, Array]:
    """
    How far the poses turn gravity about in ft_sensor.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor, one row a pose [m/s^2].

    Returns
    -------
    spread : ndarray, shape (3,)
        Singular values about the mean, per root of poses, gravity taken as 1.
    directions : ndarray, shape (3, 3)
        Rows: the directions they belong to, in ft_sensor.
    """
    unit = gravity / np.linalg.norm(gravity, axis=1, keepdims=True)
    centred = unit - unit.mean(axis=0)
    padded = np.vstack([centred, np.zeros((3, 3))])
    _, spread, directions = np.linalg.svd(padded, full_matrices=False)
    return spread / np.sqrt(len(gravity)), directions


def check_weight(gravity: Array, condition: float) -> None:
    """
    Refuse poses that do not tell the mass from the bias.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    condition : float
        Largest reciprocal of the first spread.

    Raises
    ------
    UnobservableError
        Names what is short and the pose to add.
    """
    spread, _ = gravity_spread(gravity)
    n = len(gravity)
    if spread[0] < 1 / condition:
        raise UnobservableError(
            f'{n} static pose{"s" * (n > 1)} with gravity along one direction of ft_sensor '
            f'(spread {spread[0]:.2g}, wanted {1 / condition:.2g}): mass and bias cannot be told '
            'apart; add a pose tilted by 90 deg about y of ft_sensor and one about x')


def check_poses(gravity: Array, condition: float) -> None:
    """
    Refuse poses that do not determine mass, centre of mass and biases.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    condition : float
        Largest ratio of the first to the second spread.

    Raises
    ------
    UnobservableError
        Names what is short and the pose to add.
    """
    check_weight(gravity, condition)
    spread, directions = gravity_spread(gravity)
    if spread[1] * condition >= spread[0]:
        return
    mean = gravity.mean(axis=0) / np.linalg.norm(gravity, axis=1).mean()
    # across the line that gravity moves along, out of the plane it spans with the mean
    missing = np.cross(directions[0], mean)
    if np.linalg.norm(missing) < 1e-3:
        missing = directions[1]
    axis = int(np.argmax(np.round(np.abs(np.cross(mean, missing)), 3)))
    raise UnobservableError(
        f'centre of mass and torque bias are not observable from {len(gravity)} static poses: '
        f'gravity moves along one line of ft_sensor (condition '
        f'{spread[0] / max(spread[1], 1e-12):.3g} > {condition:.3g}); '
        f'add a pose tilted about {"xyz"[axis]} of ft_sensor')


class TurnedWrench(DataError):
    """The wrench has the opposite sign: what is measured is the other body's."""


def refuse_negative(mass: float) -> None:
    """
    Refuse a mass below zero.

    Raises
    ------
    TurnedWrench
    """
    if mass <= 0:
        raise TurnedWrench(
            f'the mass comes out as {mass:.4g} kg: the wrench has the opposite sign')


def slight_misfit(poses: list[StaticPose], statics: Statics, settings: IdentificationSettings,
                  sensor_from_pose: Vector7 | None = None) -> str:
    """
    Name a small turn of the sensor or tilt of the base; empty: there is none.

    Parameters
    ----------
    sensor_from_pose : tuple of 7 float or None
        By which the poses were taken to ft_sensor, x y z [m] qx qy qz qw.

    Raises
    ------
    UnobservableError
        The poses do not tell mass from bias, or show no weight.
    DataError
        The wrench is in another frame, has other axes, its torques other ones than its forces,
        or base is far from level.
    """
    if len(poses) == 1:  # which no frame fits better than another
        check_weight(statics.gravity, settings.thresholds.condition)
    R_level_base = level_from_base(settings.gravity_direction)
    back: Array = np.eye(3) if R_level_base is None else R_level_base.T
    believed = back @ DOWN
    noise = None
    if statics.covariance is not None:
        noise = np.sqrt(np.trace(statics.covariance[:, :3, :3], axis1=1, axis2=2) / 3.0)
    forces = Forces(back @ np.stack([pose.R_base_sensor for pose in poses]),
                    statics.wrench[:, :3], settings.gravity * believed, noise)
    judgement = judge(forces)
    refuse_exchanged(forces, statics.wrench[:, 3:])
    refuse_other_orientation(forces, judgement)
    refuse_other_frame(judgement, Stated(
        believed, settings.wrench_sign, settings.sensor_rotation, sensor_from_pose),
        simpler_reading(forces, judgement))
    check_weight(statics.gravity, settings.thresholds.condition)
    refuse_weightless(judgement)
    refuse_unexplained(judgement)
    torque_noise = None if statics.covariance is None else np.sqrt(np.diagonal(
        statics.covariance[:, 3:, 3:], axis1=1, axis2=2).mean(axis=0))
    refuse_other_torques(judgement.plain.mass * statics.gravity, statics.wrench[:, 3:],
                         torque_noise, forces.R_base_sensor)
    return slightly_off(judgement, believed)
