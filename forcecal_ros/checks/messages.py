"""Messages of the table of hypotheses: each with its numbers and one remedy."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from forcecal_ros.checks.evidence import Motion
from forcecal_ros.core.axes import DOWN, pose_from_wire
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import (
    Array,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_vector,
)
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.schema import Vector7
from forcecal_ros.core.streams import CHANNELS
import numpy as np

TOLERANCE_DEG = 3.0
"""Rotations and tilts below are tolerances of mounts and floors, and noted: flanges are pinned to
0.1 deg, floors level to 1, and 3 deg take 0.2 % off the mass."""

MAX_SLIGHT_CROSSTALK = float(np.radians(TOLERANCE_DEG))
"""Share up to which crosstalk is noted: as much as a rotation that is."""

EXPLAINED = 0.5
"""Share of the changes of forces at rest that a weight explains at least, in sum of squares: of
sound recordings it explains 0.98 or more, of wrenches of other poses 0.3 or less."""

SLIGHT = 0.05
"""Share of a weight by which bias, load or vertical may change without a refusal: drift."""

CONTRADICTION_SIGMA = 10.0
"""Standard errors by which an estimate contradicts: they come from one recording's residuals."""

STANDSTILL = ('mass', 'com', 'wrench_bias')
"""Keys of calibration.yaml that are estimated from the static poses."""

SIGN, WEIGHT_REMOVED = 'sign', 'weight removed'
"""What an error is about: the wrench has the opposite sign; it holds no weight."""

ITSELF: Vector7 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

FIXED = {
    'inverted': ('pose: it is inverted (pose of the base in the sensor frame)',
                 'publish the pose of the sensor in the base frame'),
    'wxyz': ('pose: its quaternions are in the order w, x, y, z',
             'publish them in the order x, y, z, w'),
    'base': ('wrench: it is expressed in the base frame, not in the sensor frame',
             'configure the driver to publish in the sensor frame, and record again'),
    'exchanged': ('wrench: force and torque are swapped', 'correct their order in the driver'),
    'torque in base': (
        'wrench: its torques are expressed in the base frame, its forces in the sensor frame',
        'configure the driver to publish both in the sensor frame, and record again'),
    'zeroed in poses': ('wrench: it is tared at every standstill, which removes the weight',
                        'record without taring between poses'),
}
"""Cause and remedy of hypotheses that have no numbers of their own."""


class Finding(str):  # noqa: SLOT000 - it has attributes
    """
    One sentence that calls estimates into question.

    Attributes
    ----------
    suspect : tuple of str
        Keys of these estimates in a calibration; none where a standard error says so already.
    point : ndarray, shape (3,), or None
        Place in ft_sensor that torques are about [m].
    """

    suspect: tuple[str, ...]
    point: Array | None

    def __new__(cls, text: str, suspect: tuple[str, ...] = (), point: Array | None = None
                ) -> 'Finding':
        """Return a text that knows what it calls into question."""
        self = super().__new__(cls, text)
        self.suspect, self.point = suspect, point
        return self

    @property
    def line(self) -> str:
        """The sentence with the estimates that it spoils."""
        return f'{self}; suspect: {", ".join(self.suspect)}' if self.suspect else str(self)


class Stated(NamedTuple):
    """
    What was stated of sensor and base, by which a recording is judged.

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


def of(best: Any, plain: Any, stated: Stated, close: Sequence[Any]) -> str:
    """
    Say which hypothesis holds; empty: it is within tolerance, or never refused.

    Parameters
    ----------
    best, plain : Candidate
        The likeliest one, and the recording as it is.
    close : sequence of Candidate
        Others that the recording does not separate from the best.
    """
    named = [found for one in (best, *close) if (found := _cause(one, plain, stated))]
    if len(named) < 1 + len(close) or not named:
        return ''
    part, unit = ('torque', 'N m') if best.name.startswith('torque') else ('force', 'N')
    then, now = (getattr(one.fit, part).scale for one in (best, plain))
    recorded = f' with a mass of {plain.fit.mass:.4g} kg' if plain.fit.mass < 0.0 else ''
    cause = ', or '.join(dict.fromkeys(one for one, _ in named))
    others = ', or record poses in more directions to distinguish the causes' * (len(named) > 1)
    return (f'{cause}. Residual {part}s: {then:.2g} {unit} RMS if corrected, {now:.2g} '
            f'{unit}{recorded} as recorded; {named[0][1]}{others}')


def slight(best: Any, stated: Stated) -> str:
    """Name what is too slight to be refused."""
    if best.name in SIZED:
        return '; '.join(SIZED[best.name](best)[1:])
    if best.name == 'bias drifts':
        drift = best.motion.extra @ best.fit.force.theta[-9:-3]
        return (f'the force bias drifts by {np.linalg.norm(np.ptp(drift, axis=0)):.2g} N during '
                'the recording; let the sensor warm up, and record again')
    if best.name == 'smoothed':
        tau = best.motion.path.smoothing
        how = f'a low-pass of {0.5 / np.pi / tau:.2g} Hz' if tau > 0.0 else (
            f'a moving average over {-tau:.2g} s')
        return (f'the driver filters the wrench ({how}), which smooths contacts and removes the '
                'weight too early while the robot moves; disable the filter')
    if best.name == 'crosstalk':
        return f'the wrench has {crosstalk(best.motion)[0]}'
    parts = []
    if 'tilted' in best.name:
        parts.append(f'gravity is {_tilt(best, stated)} off {_numbers(stated.down)} of base '
                     f'(--gravity-direction {_numbers(_down(best))})')
    if 'rotated' in best.name:
        parts.append(f'the sensor is rotated by {_turn(best.motion.axes, _turn_std(best))} '
                     'relative to its pose')
    return f'{" and ".join(parts)}, according to the forces' if parts else ''


def crosstalk(motion: Motion) -> tuple[str, float]:
    """Name the largest crosstalk or gain error; return its share of the weight, or its moment."""
    assert motion.axes is not None
    assert motion.levers is not None
    parts = np.vstack([motion.axes - np.eye(3), motion.levers / motion.arm])
    i, j = (int(k) for k in np.unravel_index(np.argmax(np.abs(parts)), parts.shape))
    shown, of, size = CHANNELS['wrench'][i], CHANNELS['wrench'][j], float(abs(parts[i, j]))
    share = (f'{100 * parts[i, j]:+.2g} %' if i < 3
             else f'{1e3 * motion.levers[i - 3, j]:+.2g} mm')
    what = (f'a gain error of {share} in {shown}' if i == j
            else f'crosstalk of {share} from {of} to {shown}')
    return what, size


def angle_of(one: Any, stated: Stated) -> tuple[float, float]:
    """Return the angle of a rotation or a tilt, with its standard error [rad]."""
    if one.name == 'tilted':
        return np.radians(_angle_between(_down(one), stated.down)), _turn_std(one)
    return np.radians(_angle(one.motion.axes)), _turn_std(one)


def refuse_weightless(plain: Any) -> None:
    """
    Refuse forces that do not turn with the sensor as a weight does.

    Raises
    ------
    UnobservableError, DataError
        Says what mass they show, and how much of the forces a weight explains.
    """
    fit, motion = plain.fit, plain.motion
    force, changes, residual = _changes(plain)
    inertial, std = float(fit.force.theta[1]), float(fit.force.std[1])
    if fit.moving and inertial > CONTRADICTION_SIGMA * std and abs(fit.mass) < min(
            SLIGHT * inertial, CONTRADICTION_SIGMA * fit.mass_std):  # more is a length in mm
        raise DataError(
            f'wrench: its inertia is that of {inertial:.3g} kg, its weight that of '
            f'{quantity(max(fit.mass, 0.0), fit.mass_std, "kg")}: the driver removes the weight; '
            'disable this in the driver, or record the raw sensor topic', WEIGHT_REMOVED)
    explained = 1.0 - (residual / max(changes, 1e-300))**2
    if abs(fit.mass) < 3.0 * fit.mass_std or (fit.mass < 0.0 and explained < EXPLAINED):
        # forces without weight that change by more change for another reason
        no_noise_n = 1.0
        if residual > no_noise_n:
            raise DataError(
                f'the forces vary by {changes:.2g} N, but not like a weight in any frame (mass '
                f'{quantity(fit.mass, fit.mass_std, "kg")}, residual RMS {residual:.2g} N): the '
                'driver removes the weight, or wrench and pose are of different robots or times; '
                'record the raw sensor topic, or compare wrench and pose in each pose')
        raise UnobservableError(
            'the forces show no weight that rotates with the sensor (mass '
            f'{quantity(fit.mass, fit.mass_std, "kg")}, residual RMS {residual:.2g} '
            f'N){as_in_base(force, motion.gravity)}; attach the tool, add poses, and check that '
            'the driver publishes in the sensor frame')
    refuse_unexplained(plain)


def refuse_unexplained(one: Any) -> None:
    """
    Refuse forces of which a weight explains too little.

    Raises
    ------
    DataError
        Says how much it explains.
    """
    _, changes, residual = _changes(one)
    explained = 1.0 - (residual / max(changes, 1e-300))**2
    if explained < EXPLAINED and residual > 3.0 * one.fit.force.floor and not one.fit.moving:
        raise DataError(
            f'a weight explains only {explained:.0%} of the variation of the forces in any frame '
            f'(residual RMS {residual:.2g} of {changes:.2g} N): '
            'wrench and pose were not recorded in the same poses, or another force acts on '
            'the tool; compare wrench and pose in each pose')


def _changes(one: Any) -> tuple[Array, float, float]:
    """Return forces (n, 3), how much they change, and what a weight leaves of it [N]."""
    force = one.motion.wrench[one.motion.usable, :3]
    residual = one.fit.force.scale if one.motion.step else float(
        np.sqrt((one.fit.force.residual**2).mean()))
    return force, float((force - force.mean(axis=0)).std()), residual


def as_in_base(force: Array, gravity: Array) -> str:
    """Say where a force (n, 3) that never changes would be a weight, were it in base."""
    mean = force.mean(axis=0)
    weight = float(mean @ gravity) / float(gravity @ gravity)
    # a mean force this close to the vertical of base may be a weight; a bias points so by chance
    # once in four hundred times
    vertical_rad = 0.1
    if weight <= 0.0 or np.linalg.norm(mean - weight * gravity) > vertical_rad * (
            np.linalg.norm(mean)):
        return ''
    return (f', but a force that is vertical in base, equal to the weight of {weight:.3g} kg: the '
            'wrench may be expressed in base')


def about(one: Any) -> str:
    """Return what a refusal is about: the row, or the sign where axes are all reversed."""
    reversed_ = one.name == 'mirrored' and _angle(-one.motion.axes) < TOLERANCE_DEG
    return SIGN if reversed_ else str(one.name)


def _cause(one: Any, plain: Any, stated: Stated) -> tuple[str, str] | None:
    """Cause and remedy of what is beyond tolerance; None: within it, or no reason to refuse."""
    name = one.name
    if name in FIXED:
        return FIXED[name]
    if about(one) == SIGN:
        sign = -stated.wrench_sign
        return ('wrench: it has the opposite sign', (
            f'set wrench.sign to {sign} (--wrench-sign {sign}), unless the robot is mounted '
            f'upside down: then {_level(-stated.down, stated)}'))
    if name == 'mirrored':
        return (f'wrench: its axes are mirrored (left-handed){_order(one.motion.axes)}',
                'correct the order and the signs of its axes in the driver')
    if name == 'force axes':
        return ((f'wrench: the axes of its forces are mirrored{_order(one.motion.axes)}, those '
                 'of its torques are not'),
                'correct the order and the signs of the forces in the driver')
    if name == 'torque axes':
        Q = one.motion.axes
        return ((f'wrench: its torques are about other axes than its forces{_order(Q)}, or all '
                 'three have the opposite sign'),
                'correct the order and the signs of the torques in the driver')
    if name == 'crosstalk':
        what, size = crosstalk(one.motion)
        return (f'wrench: it has {what}',
                'calibrate its matrix (forcecal insitu)') if size > MAX_SLIGHT_CROSSTALK else None
    if name == 'clock':
        return clock('wrench', one.motion, plain.motion)
    if name in SIZED:
        size, *said = SIZED[name](one)
        return (said[0], said[1]) if size > SLIGHT * abs(one.fit.mass) else None
    causes = []
    if 'rotated' in name and _angle(Q := one.motion.axes) > TOLERANCE_DEG:
        causes.append(((f'wrench: its axes are rotated by {_turn(Q, _turn_std(one))} relative to '
                        f'the pose of the sensor{_order(Q)}'), _rotation_option(Q, stated)))
    if 'tilted' in name and _angle_between(_down(one), stated.down) > TOLERANCE_DEG:
        causes.append((f'the base is tilted: gravity is {_tilt(one, stated)} off',
                       _level(_down(one), stated)))
    return (' and '.join(cause for cause, _ in causes),
            ' and '.join(remedy for _, remedy in causes)) if causes else None


def clock(stream: str, moved: Motion, plain: Motion) -> tuple[str, str]:
    """Cause and remedy of stamps of another clock."""
    late = float(moved.t[0] - plain.t[0])
    side = 'later' if late > 0 else 'earlier'
    return (f'{stream}: by its stamps, gravity rotates {abs(late):.2f} s {side} than in the pose',
            ('synchronise the clocks of all computers (PTP or chrony) and record again, or add '
             f'{-late:+.2f} s to all stamps of {stream}'))


def _cable(one: Any) -> tuple[float, str, str]:
    """Say what pulls at the tool, by how much as a mass [kg], and what to do."""
    theta, std = one.fit.force.theta[-6:-3], one.fit.force.std[-6]
    pull = np.linalg.norm((one.motion.extra @ theta)[one.motion.usable], axis=1).max()
    return (pull / float(np.linalg.norm(one.motion.gravity)), (
        f'something pulls at the tool by up to {pull:.2g} N, like a spring of '
        f'{quantity(-theta[0], std, "N/m")} to a place that does not move (a cable, a hose, a '
        'balancer)'), 'detach it or let it hang loosely, and record again')


def _changed(one: Any) -> tuple[float, str, str]:
    """Say what changes half-way, by how much as a mass [kg], and when."""
    motion, theta, g = one.motion, one.fit.force.theta, float(np.linalg.norm(one.motion.gravity))
    after = motion.extra.any(axis=(1, 2)) if motion.part is None else motion.part > 0
    begin = f'from {motion.t[int(np.argmax(after))]:.1f} s on'
    if one.name == 'bias changes':
        x, y, z = off = theta[-3:] - theta[-6:-3]
        return (float(np.linalg.norm(off)) / g, (
            f'{begin} the wrench differs by {x:+.2g} {y:+.2g} {z:+.2g} N in all orientations: the '
            'bias changed (a tare, an overload, a restart of the driver), or a contact began or '
            'ended'), 'calibrate with a recording without this change')
    if one.name == 'load changes':
        more = 'more' if theta[-4] > 0 else 'less'
        return (abs(theta[-4]), (
            f'{begin} the sensor carries {abs(theta[-4]):.3g} kg {more}: something was gripped or '
            'released; its weight is reported as contact'),
            'calibrate without this change (forcecal estimate --track-tool follows it)')
    size = float(np.linalg.norm(theta[-5:-3]))
    return (size / g, (
        f'{begin} a horizontal force of {size:.2g} N keeps its direction in base in all '
        'orientations: the base tilted (or drives over a slope), or a constant force acts'),
        'its force is reported as contact; calibrate with a recording without this change')


SIZED = {'cable': _cable, **dict.fromkeys(
    ('bias changes', 'load changes', 'vertical changes'), _changed)}
"""Rows that are refused from a part of the weight on, and what says their size and words."""


def _turn_std(one: Any) -> float:
    """Return the standard error of a rotation, or of the vertical [rad]."""
    return float(one.motion.axes_std or one.fit.mass_std / max(abs(one.fit.mass), 1e-300))


def _rotation_option(Q: Array, stated: Stated) -> str:
    given = stated.sensor_from_pose or (ITSELF if stated.by == 'rig' else None)
    if given is not None:
        right = quaternion_from_matrix(matrix_from_quaternion(given[3:]) @ Q.T)
        return _stating(f'--sensor-from-pose {_numbers(np.append(given[:3], right))}', stated)
    before = pose_from_wire(stated.sensor_rotation)
    vector = rotation_vector(Q.T if before is None else Q.T @ before)
    option = f'--sensor-rotation {_numbers(np.degrees(vector))}'
    if not stated.by and before is None:
        option += (' (if the pose is that of the flange: --sensor-from-pose X Y Z '
                   f'{_numbers(quaternion_from_matrix(Q.T))}, with the sensor position X Y Z in '
                   'the flange [m])')
    return _stating(option, stated)


def _stating(option: str, stated: Stated) -> str:
    return f'{"calibrate again with" if stated.by == "calibration" else "pass"} {option}'


def _level(down: Array, stated: Stated) -> str:
    if stated.by == 'rig':
        return f'set gravity in the rig along {_numbers(down)}'
    return _stating(f'--gravity-direction {_numbers(down)}', stated)


def _order(Q: Array) -> str:
    """Say which axes of the sensor the channels show, if they show one each."""
    nearest = np.where(np.abs(Q) > np.cos(np.radians(TOLERANCE_DEG)), np.sign(Q), 0.0)
    if np.abs(nearest).sum() != 3.0:
        return ''
    names = (f'{"-" * bool(row.sum() < 0.0)}{"xyz"[int(np.argmax(np.abs(row)))]}'
             for row in nearest)
    return f' (x, y, z measure {", ".join(names)})'


def _turn(Q: Array, std: float) -> str:
    """Say how the wire's axes are turned, seen from the frame of the pose."""
    vector = np.degrees(rotation_vector(Q.T))
    angle = max(float(np.linalg.norm(vector)), 1e-300)
    axis = vector / angle
    i = int(np.argmax(np.abs(axis)))
    about = f'({_numbers(axis)})'
    if np.abs(axis[i]) > 0.99 and (1.0 - np.abs(axis[i])) * angle < TOLERANCE_DEG:
        angle, about = angle * float(np.sign(axis[i])), 'xyz'[i]
    return f'{quantity(np.radians(angle), std, "rad")} about {about}'


def _angle(Q: Array) -> float:
    return float(np.degrees(np.linalg.norm(rotation_vector(Q))))


def _angle_between(a: Array, b: Array) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _down(one: Any) -> Array:
    weight = one.fit.force.theta[:3]
    return np.asarray(weight / np.linalg.norm(weight))


def _tilt(one: Any, stated: Stated) -> str:
    return quantity(
        np.radians(_angle_between(_down(one), stated.down)), _turn_std(one), 'rad')


def _numbers(vector: Array) -> str:
    return ' '.join(f'{x + 0.0:.4g}' for x in np.round(vector, 4))
