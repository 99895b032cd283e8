"""What is said of a wrench in another frame, and of a base that is not level: cause and remedy."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.frames import Fit, Judgement
from forcecal_ros.core.axes import DOWN, pose_from_wire
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import (
    Array,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_vector,
)
from forcecal_ros.core.schema import Vector7
import numpy as np

ITSELF: Vector7 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""ft_sensor in its own frame."""


class Stated(NamedTuple):
    """
    What was stated of sensor and base, by which a judgement was made.

    Attributes
    ----------
    down : ndarray, shape (3,)
        Unit vector of gravity in base.
    wrench_sign : int
        What the readings were multiplied by.
    sensor_rotation : sequence of 3 float or None
        What they were turned by [rad].
    sensor_from_pose : tuple of 7 float or None
        By which the poses were taken to ft_sensor, x y z [m] qx qy qz qw.
    by : str
        Where it is stated: '' in options of this command, or in a ``calibration`` or a ``rig``.
    """

    down: Array = DOWN
    wrench_sign: int = 1
    sensor_rotation: Sequence[float] | None = None
    sensor_from_pose: Vector7 | None = None
    by: str = ''


def refuse_other_frame(judgement: Judgement, stated: Stated = Stated(), or_else: str = '') -> None:
    """
    Refuse forces that fit another frame, other axes or another way down.

    Parameters
    ----------
    or_else : str
        What else the poses cannot tell this from.

    Raises
    ------
    DataError
        Names the cause, how well it fits, and the remedy; where poses cannot tell causes apart,
        all of them, and the remedy of the likeliest.
    """
    plain, likely = judgement.plain, judgement.likely
    if likely == (plain,):
        return
    named = [one for fit in sorted(likely, key=_oddness)
            if (one := _beyond_tolerance(fit, stated))]
    if len(named) == len(likely):
        causes = ', or '.join(cause for cause, _ in named)
        remedy = named[0][1] + (
            '; poses in more directions tell whether it is the other'
            if len(named) > 1 else '')
        otherwise = f'; or else the orientation is read wrongly: {or_else}' if or_else else ''
        recorded = f' with a mass of {plain.mass:.4g} kg' if plain.mass < 0.0 else ''
        raise DataError(
            f'wrench: {causes}; RMS of the residual forces{" at rest" * judgement.rests} '
            f'{likely[0].rms:.2g} N then, '
            f'{plain.rms:.2g} N{recorded} as recorded; {remedy}{otherwise}')


def refuse_weightless(judgement: Judgement) -> None:
    """
    Refuse forces that do not turn with the sensor as a weight does.

    Raises
    ------
    UnobservableError
        Says what mass they show.
    """
    plain = judgement.plain
    if judgement.likely == (plain,) and abs(plain.mass) < limits.SURE_WEIGHT * plain.mass_std:
        if plain.rms > limits.NO_NOISE:
            raise DataError(
                f'the forces of the static poses change by {judgement.changes:.2g} N, and not as '
                f'a weight does (mass {plain.mass:.3g} +- {plain.mass_std:.2g} kg, residual RMS '
                f'{plain.rms:.2g} N), in whatever frame: the weight was taken off, as from what a '
                'robot says of external forces, wrench and pose are not of the same robot or of '
                'the same time, the frame changed meanwhile, or something else pulls; record the '
                "sensor's own readings, or compare them pose by pose")
        raise UnobservableError(
            'the forces of the static poses show no weight that turns with the sensor (mass '
            f'{plain.mass:.3g} +- {plain.mass_std:.2g} kg, residual RMS {plain.rms:.2g} N)'
            f'{as_in_base(judgement)}; hang the tool on the sensor, add poses, and look '
            "whether the driver publishes in the sensor's frame")


def refuse_unexplained(judgement: Judgement) -> None:
    """
    Refuse forces that change for other reasons than a weight, in whatever frame.

    Raises
    ------
    DataError
        Says how much of them a weight explains.
    """
    plain = judgement.plain
    if judgement.likely != (plain,) or plain.degrees < 1:
        return
    explained = 1.0 - (plain.rms / max(judgement.changes, limits.TINY)) ** 2
    if explained < limits.EXPLAINED:
        raise DataError(
            f'a weight explains {explained:.0%} of how the forces of the static poses change '
            f'(residual RMS {plain.rms:.2g} of {judgement.changes:.2g} N), in whatever frame: '
            'orientations and wrenches are not of the same poses, or something else pulls; '
            'compare them pose by pose')


def slightly_off(judgement: Judgement, believed: Array = DOWN) -> str:
    """Name a turn or a tilt too small to be refused; empty: there is none."""
    fit = judgement.likely[0]
    if fit is judgement.plain:
        return ''
    parts = []
    if fit.name in ('tilted', 'both'):
        parts.append(f'gravity is {_deg(_tilt(fit, believed), fit.tilt_std)} off '
                     f'{_numbers(believed)} of base, as --gravity-direction '
                     f'{_numbers(_down(fit))} would state')
    if fit.name in ('turned', 'both'):
        parts.append(f'the sensor is turned by {_turn(fit.Q, fit.turn_std)} against its pose')
    return f'{" and ".join(parts)}, by the forces at rest'


def _oddness(fit: Fit) -> tuple[bool, bool]:
    """Order of causes that poses cannot tell apart: whole axes first, mirrored ones last."""
    return not _order(fit.Q), fit.name == 'mirrored'


def _beyond_tolerance(fit: Fit, stated: Stated) -> tuple[str, str] | None:
    """Cause and remedy of what no tolerance of a mount explains; None: it may be tolerance."""
    tilt, mirrored = _tilt(fit, stated.down), np.linalg.det(fit.Q) < 0.0
    if fit.name == 'base':
        return ('it is expressed in base, not in the frame of the sensor',
                "set the driver to publish in the sensor's frame")
    Q, flipped = fit.Q, tilt > 180.0 - limits.TILTED_OFF
    if flipped:
        Q, tilt, mirrored = -Q, 0.0, not mirrored
    if mirrored and _angle(-Q) < limits.TURNED_OFF:
        sign = -stated.wrench_sign
        return 'it has the opposite sign', (
            f'set wrench.sign to {sign} (--wrench-sign {sign}), unless the robot hangs upside '
            f'down: then {_level(-stated.down, stated)}')
    found = [*_axes(Q, mirrored, fit.turn_std, stated),
             *(() if flipped else _tilted(fit, tilt, stated))]
    return (' and '.join(cause for cause, _ in found),
            ' and '.join(remedy for _, remedy in found)) if found else None


def _axes(Q: Array, mirrored: bool, std: float, stated: Stated) -> Iterator[tuple[str, str]]:
    """Cause and remedy of axes that are turned, swapped or mirrored."""
    order = _order(Q)
    if mirrored:
        yield (f'its axes are mirrored (left-handed){order}',
               'correct the order and the signs of its axes in the driver')
    elif _angle(Q) > limits.TURNED_OFF:
        yield (f"its axes are turned by {_turn(Q, std)} against the sensor's pose{order}",
               _stating(_rotation(Q, stated), stated))


def _rotation(Q: Array, stated: Stated) -> str:
    """Say the option by which the pose's axes become the wire's: the one given, set right."""
    given = stated.sensor_from_pose or (ITSELF if stated.by == 'rig' else None)
    if given is not None:
        right = quaternion_from_matrix(matrix_from_quaternion(given[3:]) @ Q.T)
        return f'--sensor-from-pose {_numbers(np.append(given[:3], right))}'
    before = pose_from_wire(stated.sensor_rotation)
    vector = rotation_vector(Q.T if before is None else Q.T @ before)
    option = f'--sensor-rotation {_numbers(np.degrees(vector))}'
    return option if stated.by or before is not None else (
        f'{option} (where the pose is that of a flange: --sensor-from-pose X Y Z '
        f'{_numbers(quaternion_from_matrix(Q.T))}, with the place of the sensor in it)')


def _stating(option: str, stated: Stated) -> str:
    return f'{"calibrate again with" if stated.by == "calibration" else "state"} {option}'


def _level(down: Array, stated: Stated) -> str:
    if stated.by == 'rig':
        return f'turn gravity in the rig along {_numbers(down)}'
    return _stating(f'--gravity-direction {_numbers(down)}', stated)


def _tilted(fit: Fit, tilt: float, stated: Stated) -> Iterator[tuple[str, str]]:
    if fit.name in ('tilted', 'both') and tilt > limits.TILTED_OFF:
        yield (f'base is not level, gravity in it is {_deg(tilt, fit.tilt_std)} off',
               _level(_down(fit), stated))


def _order(Q: Array) -> str:
    """Say which axes of the sensor the channels show, where they show one each."""
    nearest = np.where(np.abs(Q) > np.cos(np.radians(limits.TURNED_OFF)), np.sign(Q), 0.0)
    if np.abs(nearest).sum() != 3.0:
        return ''
    names = (f'{"-" * bool(row.sum() < 0.0)}{"xyz"[int(np.argmax(np.abs(row)))]}'
             for row in nearest)
    return f': x, y, z show {", ".join(names)}'


def _turn(Q: Array, std: float) -> str:
    """Say how the wire's axes are turned, seen from the frame of the pose."""
    vector = np.degrees(rotation_vector(Q.T))
    angle = float(np.linalg.norm(vector))
    axis = vector / angle
    i = int(np.argmax(np.abs(axis)))
    about = f'({_numbers(axis)})'
    if np.abs(axis[i]) * angle > angle - limits.TURNED_OFF and np.abs(axis[i]) > 0.99:
        angle, about = angle * float(np.sign(axis[i])), 'xyz'[i]
    return f'{_deg(angle, std)} about {about}'


def _deg(angle: float, std: float) -> str:
    """Say an angle [deg] with its standard error [rad], to the digits that this warrants."""
    error = float(np.degrees(std))
    decimals = int(np.clip(1 - np.floor(np.log10(max(error, limits.TINY))), 0, 3))
    return f'{angle:.{decimals}f} +- {error:.{decimals}f} deg'


def _angle(Q: Array) -> float:
    """Angle of a rotation [deg]."""
    return float(np.degrees(np.linalg.norm(rotation_vector(Q))))


def _down(fit: Fit) -> Array:
    return np.asarray(fit.gravity / np.linalg.norm(fit.gravity))


def _tilt(fit: Fit, believed: Array) -> float:
    """Angle between gravity as fitted and as believed [deg]."""
    cross, along = np.linalg.norm(np.cross(_down(fit), believed)), _down(fit) @ believed
    return float(np.degrees(np.arctan2(cross, along)))


def _numbers(vector: Array) -> str:
    return ' '.join(f'{x + 0.0:.4g}' for x in np.round(vector, 4))


def as_in_base(judgement: Judgement) -> str:
    """Say where a force that never changes would be a weight, were it expressed in base."""
    fit, mean = judgement.plain, judgement.mean
    weight = float(mean @ fit.gravity) / float(fit.gravity @ fit.gravity)
    if weight <= 0.0 or np.linalg.norm(mean - weight * fit.gravity) > limits.VERTICAL * (
            np.linalg.norm(mean)):
        return ''
    return (f', but a force that stays vertical in base, as of {weight:.3g} kg in a wrench '
            'expressed in base')
