"""Optimal experimental design of a calibration: which poses, in which order, for how long.

Of all sequences within the time and the limits, the one with the greatest Fisher information:

- D-optimal: least determinant of the covariance of all parameters;
- c-optimal for one parameter: least variance of that. On its own it likes designs that tell
  nothing else, so it is compounded with D-optimality in equal parts [Atkinson2007].

The search is an exchange algorithm [Fedorov1972]: one pose after the other is replaced by the
candidate that helps, for three, four and five poses, until nothing helps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.core.geometry import (
    Array,
    POSE_LENGTH,
    rotation_from_vector,
    skew,
    STANDARD_GRAVITY,
)
from forcecal_ros.core.parameters import Parameter, parameter_file, parameters_of
from forcecal_ros.core.quantity import size, sizes
from forcecal_ros.motion.limits import check_move, Limits, pace_within, share_allowed
from forcecal_ros.motion.plan import Timing
from forcecal_ros.motion.profiles import (
    flatten_poses,
    Move,
    Pace,
    Pose,
    quintic,
    shortest_duration,
    step_goal,
)
import numpy as np
from scipy.linalg import block_diag

TOOL, PARAMETERS = 10, 26
"""Of the tool: mass, force bias, first moment, torque bias; with those of the accelerometer:
offset, map (row by row), delay, lever from the centre of mass."""


class Sensors(NamedTuple):
    """
    What is expected of tool and sensors, and how noisy they are.

    Attributes
    ----------
    mass : float
        [kg]
    com : ndarray, shape (3,)
        In ft_sensor [m].
    force, torque : float
        Noise densities [N/sqrt(Hz)], [N m/sqrt(Hz)]: the standard error of a mean over one
        second.
    volts : float
        Of the accelerometer [V/sqrt(Hz)], or [m/s^2/sqrt(Hz)] of one that is not in volts; NaN
        where there is none.
    gain : float
        Of the accelerometer [V/(m/s^2)], or 1.
    gravity : float
        [m/s^2]
    """

    mass: float
    com: Array
    force: float
    torque: float
    volts: float
    gain: float = 1.0
    gravity: float = STANDARD_GRAVITY

    @property
    def has_accelerometer(self) -> bool:
        """Whether there is one."""
        return not np.isnan(self.volts)


def sensors_of(calibration: Calibration) -> Sensors:
    """
    Return what a calibration states of tool and sensors.

    Raises
    ------
    DataError
        It holds no noise.
    """
    noise, accelerometer = calibration.noise, calibration.accelerometer
    if noise is None:
        raise DataError('the calibration has no noise, which is required to predict errors; '
                        'calibrate from a recording with poses of 1 s')
    wrench = _density(noise.wrench_density, noise.wrench, noise.wrench_rate)
    force, torque = (float(np.sqrt(wrench[part].mean())) for part in (slice(3), slice(3, 6)))
    gain, volts = 1.0, np.nan
    if accelerometer is not None and noise.specific_force is not None:
        gain = float(np.abs(accelerometer.gain.value).mean())
        volts = gain * float(np.sqrt(_density(
            noise.specific_force_density, noise.specific_force, noise.accelerometer_rate).mean()))
    return Sensors(float(calibration.mass), calibration.com.value, force, torque, volts, gain,
                   calibration.gravity)


def _density(density: Estimate | None, covariance: Estimate, rate: float) -> Array:
    """Return the spectral density at low frequencies, by channel; white where not measured."""
    if density is None and not rate > 0:
        raise DataError('the calibration has neither the density of its noise nor the rate of '
                        'the readings; calibrate again')
    return np.diag(covariance.value / rate if density is None else density.value)


def at_rest(R_base_sensor: Array, sensors: Sensors) -> Array:
    """Return the Fisher information of one second in a pose, shape (26, 26)."""
    g = -sensors.gravity * R_base_sensor[2]
    J = np.zeros((9, PARAMETERS))
    J[:3, 0] = g
    J[:3, 1:4] = J[3:6, 7:TOOL] = np.eye(3)
    J[3:6, 4:7] = -skew(g)
    J[:6] /= np.repeat([sensors.force, sensors.torque], 3)[:, None]
    if sensors.has_accelerometer:
        J[6:, TOOL:] = _accelerometer_rows(-g[None], np.zeros((1, 3)), np.zeros((1, 3, 3)),
                                           sensors)[0] / sensors.volts
    return np.asarray(J.T @ J)


def in_motion(move: Move, sensors: Sensors) -> Array:
    """Return the same of a move, or of settling where it has no distance."""
    if not sensors.has_accelerometer:
        return np.zeros((PARAMETERS, PARAMETERS))
    # moves are sampled that densely [s]: the block length of the identification
    n = max(2, round(move.duration / 0.02))
    s, rate, change = quintic((np.arange(n) + 0.5) / n)
    omega = rate[:, None] * move.turn / move.duration
    alpha = change[:, None] * move.turn / move.duration**2
    R = move.start.R_base_sensor @ rotation_from_vector(s[:, None] * move.turn)
    f = sensors.gravity * R[:, 2]
    J = np.zeros((n, 3, PARAMETERS))
    J[:, :, TOOL:] = _accelerometer_rows(
        f, -np.cross(omega, f), skew(alpha) + skew(omega) @ skew(omega), sensors)
    # f = (b_F - F) / m, by the mass and by the force bias
    J[:, :, 0] = -f * sensors.gain / sensors.mass
    J[:, :, 1:4] = np.eye(3) * sensors.gain / sensors.mass
    J *= np.sqrt(move.duration / n / (
        sensors.volts**2 + (sensors.gain * sensors.force / sensors.mass)**2))
    information = np.einsum('nij,nik->jk', J, J)
    information[:TOOL, :TOOL] = 0.0  # the tool is identified at rest alone
    return np.asarray(information)


def _accelerometer_rows(f: Array, slope: Array, turning: Array, sensors: Sensors) -> Array:
    """Jacobian of the three readings at each of n instants, shape (n, 3, 16)."""
    J = np.zeros((len(f), 3, PARAMETERS - TOOL))
    for i in range(3):
        J[:, i, i] = 1.0
        J[:, i, 3 + 3 * i:6 + 3 * i] = f
    J[:, :, 12] = -sensors.gain * slope
    J[:, :, 13:] = sensors.gain * turning
    return J


def _inverse(matrix: Array) -> Array:
    """Invert a positive semidefinite matrix; infinite variances where there is no information."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    scaled = scale[:, None] * vectors
    return np.asarray(scaled / np.maximum(values, 1e-12) @ scaled.T)


SETTLE = 0.5
"""How long the tool is expected to settle after each move [s]: 0.3 to 0.6 s on the nominal rig."""

GROUPS = {'mass': ('kg', (0,)), 'force bias': ('N', (1, 2, 3)), 'com': ('m', (4, 5, 6)),
          'torque bias': ('N m', (7, 8, 9)), 'offset': ('', (10, 11, 12)),
          'gain': ('', (13, 17, 21))}
"""Parameters by name: unit, and where they stand among tool (10), offset (3) and map (9)."""


class Errors(NamedTuple):
    """Predicted covariance of tool (10) and, where there is one, accelerometer (12)."""

    covariance: Array

    def std(self, name: str) -> Array:
        """Return the predicted standard errors of one of ``GROUPS``."""
        places = list(GROUPS[name][1])
        return np.sqrt(np.diag(self.covariance)[places])

    @property
    def names(self) -> list[str]:
        """Those of ``GROUPS`` that there are."""
        return [name for name, (_, at) in GROUPS.items() if at[-1] < len(self.covariance)]


def errors_of(information: Array, sensors: Sensors) -> Errors:
    """Return the covariance that an information promises, the centre of mass in metres."""
    tool = _inverse(information[:TOOL, :TOOL])
    to_com = np.eye(TOOL)
    to_com[4:7, 4:7] /= sensors.mass
    to_com[4:7, 0] = -sensors.com / sensors.mass
    in_metres = to_com @ tool @ to_com.T
    if not sensors.has_accelerometer:
        return Errors(in_metres)
    inverse = _inverse(information[TOOL:, TOOL:])
    carried = inverse @ information[TOOL:, :TOOL]
    accelerometer = inverse + carried @ tool @ carried.T
    return Errors(np.asarray(block_diag(in_metres, accelerometer[:12, :12])))


def d_optimality(errors: Errors) -> float:
    """Return the logarithm of the determinant of the covariance, per parameter."""
    sign, value = np.linalg.slogdet(errors.covariance)
    return float(value) / len(errors.covariance) if sign > 0 else np.inf


class Robot(NamedTuple):
    """Where the robot starts, and what it may do."""

    home: Pose
    limits: Limits = Limits()
    pace: Pace = Pace()
    tilt: float = np.radians(100.0)
    """Largest rotation of a pose from home [rad]."""


@dataclass(frozen=True)
class Design:
    """
    A calibration sequence, and what it promises.

    Attributes
    ----------
    duration : float
        Expected, settling included [s].
    """

    robot: Robot
    sensors: Sensors
    poses: dict[str, Pose]
    timing: Timing
    errors: Errors
    duration: float


def step_within(robot: Robot, timing: Timing) -> Timing:
    """Shorten the step to what the limits allow in its time."""
    move = Move(robot.home, step_goal(robot.home, timing.step_distance), timing.step_duration)
    share = share_allowed(move, robot.limits)
    return replace(timing, step_distance=float(np.trunc(1e6 * share * timing.step_distance) / 1e6))


def candidates(robot: Robot) -> list[Pose]:
    """Return home, and rotations from it in 26 directions by the largest tilt and parts of it."""
    directions = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    home = robot.home
    return [home, *(
        Pose(home.position, home.R_base_sensor @ rotation_from_vector(share * robot.tilt * d))
        for share in (1.0, 0.7) for d in directions)]


@dataclass(frozen=True)
class Planner:
    """
    Adds up what sequences of candidates tell; stretches are computed once.

    Attributes
    ----------
    poses : list of Pose
        Candidates; the first is home, where the step is made.
    duration : float
        That a sequence may take [s].
    """

    robot: Robot
    sensors: Sensors
    poses: Sequence[Pose]
    timing: Timing
    duration: float

    @cached_property
    def _moves(self) -> dict[tuple[int, int], tuple[float, Array] | None]:
        """Duration and information of the moves looked at so far; None where not allowed."""
        return {}

    def move(self, i: int, j: int) -> tuple[float, Array] | None:
        """Return duration and information of a move; None where a limit forbids it."""
        if (i, j) not in self._moves:
            try:
                self._moves[i, j] = self._moved(self.poses[i], self.poses[j])
            except MotionError:
                self._moves[i, j] = None
        return self._moves[i, j]

    def require_room(self) -> None:
        """Refuse limits that allow fewer than two poses beside home, with what one exceeds."""
        refused = []
        for pose in self.poses[1:]:
            try:
                self._moved(self.poses[0], pose)
            except MotionError as error:
                refused.append(error)
        others = len(self.poses) - 1
        if refused and others - len(refused) < 2:
            raise MotionError(f'only {others - len(refused)} of {others} candidate poses are '
                              f'within the limits: {refused[0]}')

    def _moved(self, start: Pose, goal: Pose) -> tuple[float, Array] | None:
        # largest rotation between two poses, as far from half a turn as a base may be tilted
        if Move(start, goal, 1.0).angle > np.radians(165.0):
            return None
        move = Move(start, goal, shortest_duration(start, goal, self.robot.pace))
        check_move(move, self.robot.limits)
        return move.duration, in_motion(move, self.sensors)

    @cached_property
    def _rests(self) -> list[tuple[Array, Array]]:
        """What a second of measuring and of settling contributes in each pose."""
        return [(at_rest(pose.R_base_sensor, self.sensors),
                 in_motion(Move(pose, pose, 1.0), self.sensors)) for pose in self.poses]

    def measure(self, sequence: Sequence[int]) -> float:
        """Return the time left to measure in each pose [s]; -inf where a limit forbids a move."""
        moves = [self.move(i, j) for i, j in self._pairs(sequence)]
        if None in moves:
            return -np.inf
        moving = sum(one[0] for one in moves if one)
        fixed = SETTLE * (len(sequence) + 1) + self._step + shortest_duration(
            self.poses[0], self.poses[0], self.robot.pace)
        return (self.duration - moving - fixed) / len(sequence)

    @property
    def _step(self) -> float:
        return 2 * (self.timing.step_duration + self.timing.ring)

    def _pairs(self, sequence: Sequence[int]) -> list[tuple[int, int]]:
        return list(zip(sequence, [*sequence[1:], sequence[0]]))

    def errors(self, sequence: Sequence[int], measure: float) -> Errors:
        """Return what a sequence of allowed moves promises."""
        total = np.zeros((PARAMETERS, PARAMETERS))
        for pair in self._pairs(sequence):
            if one := self.move(*pair):
                total += one[1]
        for i in sequence:
            resting, settling = self._rests[i]
            total += measure * resting + SETTLE * settling
        return errors_of(total + (SETTLE + self._step) * self._rests[0][1], self.sensors)

    def value(self, sequence: Sequence[int]) -> float:
        """Return the criterion; infinite where the sequence does not fit."""
        measure = self.measure(sequence)
        # shortest measurement: of a pose [s]: 20 blocks of the identification, twice as many as
        # its noise is measured on
        if not measure >= 0.4:
            return np.inf
        return d_optimality(self.errors(sequence, measure))

    def exchange(self, sequence: list[int]) -> tuple[float, list[int]]:
        """Replace poses, the first excepted, until none helps; return the criterion."""
        best = self.value(sequence)
        while True:
            before = best
            for place in range(1, len(sequence)):
                for other in sorted(set(range(len(self.poses))) - set(sequence)):
                    tried = [*sequence[:place], other, *sequence[place + 1:]]
                    if (value := self.value(tried)) < best:
                        best, sequence = value, tried
            if not best < before:
                return best, sequence

    def search(self, sizes: Sequence[int], seed: int = 0) -> tuple[float, list[int]]:
        """Return the best criterion and sequence, of a random start for each number of poses."""
        rng = np.random.default_rng(seed)
        starts = ([0, *(1 + rng.choice(len(self.poses) - 1, n - 1, replace=False))] for n in sizes)
        return min(map(self.exchange, starts), key=lambda one: one[0])


def design_calibration(robot: Robot, sensors: Sensors, duration: float,
                       timing: Timing = Timing()) -> Design:
    """
    Choose poses and times of a calibration.

    Parameters
    ----------
    duration : float
        That the sequence may take, settling included [s].

    Raises
    ------
    MotionError
        No sequence of three poses fits into the time and the limits.
    """
    timing = step_within(robot, timing)
    robot = robot._replace(pace=pace_within(robot.limits, robot.pace))
    poses = candidates(robot)
    planner = Planner(robot, sensors, poses, timing, duration)
    planner.require_room()
    value, sequence = planner.search((3, 4, 5))
    if not np.isfinite(value):
        raise MotionError(f'three poses do not fit into {duration:g} s; increase --duration')
    measure = float(np.floor(100 * planner.measure(sequence)) / 100)
    names = ['home', *(f'pose_{k}' for k in range(1, len(sequence)))]
    return Design(robot, sensors, {name: poses[i] for name, i in zip(names, sequence)},
                  replace(timing, measure=measure), planner.errors(sequence, measure), duration)


def sequencer_parameters(sequence: str, poses: Mapping[str, Pose], timing: Timing, pace: Pace,
                         limits: Limits, heading: str) -> str:
    """
    Return a parameter file, YAML, with the poses and all that differs from the defaults.

    Parameters
    ----------
    heading : str
        Comment at its top.
    """
    given = (one for name, section, usual in (
        ('timing', timing, Timing()), ('pace', pace, Pace()), ('limits', limits, Limits()))
        for one, other in zip(parameters_of(name, section), parameters_of(name, usual))
        if one.default != other.default)
    return parameter_file('sequencer', [
        Parameter('sequence', sequence, 'Sequence that a start runs'),
        Parameter('poses.names', list(poses), 'Names of the poses in their order'),
        Parameter('poses.values', flatten_poses(poses), 'x y z [m] qx qy qz qw of each pose',
                  per_line=POSE_LENGTH), *given], heading)


def as_text(design: Design) -> str:
    """Return the predicted standard errors as a table."""
    lines = [f'{"parameter":12}  predicted standard error (x y z)']
    lines += [f'{name:12}  {sizes(design.errors.std(name).tolist(), _unit(design, name) or "1")}'
              for name in design.errors.names]
    what = (f'{len(design.poses)} poses of {size(design.timing.measure, "s")}, '
            f'step {size(design.timing.step_distance, "m")}')
    return '\n'.join([*lines, '', what])


def to_document(design: Design) -> dict[str, Any]:
    """Return it as a dictionary."""
    return {'format': 'forcecal-plan/1', 'for': 'calibration', 'duration': design.duration,
            'poses': {name: {'position': pose.position.tolist(),
                             'R_base_sensor': pose.R_base_sensor.tolist()}
                      for name, pose in design.poses.items()},
            'measure': design.timing.measure,
            'std': {name: {'value': design.errors.std(name).tolist(),
                           'unit': _unit(design, name)} for name in design.errors.names}}


def to_parameters(design: Design) -> str:
    """Return it as a parameter file of the sequencer, the table in its comments."""
    return sequencer_parameters(
        'calibrate', design.poses, design.timing, design.robot.pace, design.robot.limits,
        f'Recording for forcecal calibrate, about {design.duration:g} s.\n{as_text(design)}')


def _unit(design: Design, name: str) -> str:
    unit = GROUPS[name][0]
    if unit:
        return unit
    volts = design.sensors.gain != 1.0
    return {'offset': ('m/s^2', 'V'), 'gain': ('', 'V/(m/s^2)')}[name][volts]
