"""Monitoring of the sensors while the robot moves: alive, finite, within limits, still.

Times of arrival are the caller's, on a steady clock; header stamps only give the age of a sample
and the length of a window.
"""

from collections import deque
from dataclasses import dataclass
from itertools import islice, pairwise
from math import asin, dist, inf, isfinite, sqrt
from typing import Annotated, NamedTuple, TypeAlias

from forcecal_ros.checks.signals import ABSURD
from forcecal_ros.core.errors import above, below, DataError, MotionError
from forcecal_ros.core.geometry import Array, rotate
from forcecal_ros.core.schema import Row
from forcecal_ros.motion.limits import Limits
import numpy as np

VISIBLE_TRAVEL, VISIBLE_TURN = 1e-3, 5e-3
"""Readings that repeat count as frozen only once the commands have moved that far [m], [rad]. A
pose published with four digits changes every 0.1 mm, and at the default pace the commands are
1 mm ahead of a robot that lags by 50 ms: what lags more shows as an error of tracking."""

Timed: TypeAlias = tuple[float, tuple[float, ...]]
"""A time [s] and the values at that time."""

KEPT = 2.0
"""Samples are kept for that long [s]: eight windows of stillness at the defaults, of which a start
needs two to learn the noise."""


class Channel:
    """
    The last sample of one topic, and those of the last two seconds.

    Attributes
    ----------
    received, changed : float
        When a sample arrived last, and when one that differs from the one before, on the
        caller's clock [s].
    rest_timeout : float
        Repeating the same reading for longer is no habit of the robot at rest [s].
    moving_since : float
        Since when the commanded motion should show in the readings, on the caller's clock [s].
    stamp : float
        Header stamp of the last sample [s].
    late_since : float
        Since when the newest stamp has been too old, on the caller's clock [s].
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.received = -inf
        self.changed = -inf
        self.rest_timeout = inf
        self.moving_since = inf
        self.stamp = -inf
        self.late_since = inf
        self.values: tuple[float, ...] = ()
        self.recent: deque[Timed] = deque()

    def take(self, now: float, stamp: float, values: tuple[float, ...]) -> None:
        """Take in a sample that arrives at ``now`` of the caller's clock."""
        if values != self.values:
            self.changed = now
        self.received, self.stamp, self.values = now, stamp, values

    def keep(self) -> None:
        """Keep the last sample to judge stillness and repeated readings by."""
        recent = self.recent
        recent.append((self.stamp, self.values))
        while recent and not 0.0 <= self.stamp - recent[0][0] <= KEPT:
            recent.popleft()

    def learn(self, shortest: float) -> None:
        """
        Learn from the samples kept, of a robot at rest, for how long readings usually repeat.

        Where they change too rarely to tell, what an earlier start has learnt holds. The longest
        repetitions are left out, so that a freeze which has healed does not excuse the next.

        Parameters
        ----------
        shortest : float
            Repetitions for that long are never too long [s].
        """
        changes = [self.recent[0][0]] if self.recent else []
        for (_, before), (stamp, values) in zip(self.recent, islice(self.recent, 1, None)):
            if values != before:
                changes.append(stamp)
        same = sorted(end - begin for begin, end in pairwise(changes))
        # two of the longest repetitions before a start are no habit but a sensor that had frozen;
        # fewer than 20 changes show no habit
        if len(same) >= 20:
            usual = same[-3]
            # readings at rest that repeat for so many times as long as they use to are frozen:
            # live, a false alarm ends a motion, a miss is found in the recording
            self.rest_timeout = max(shortest, 5.0 * usual)

    @property
    def span(self) -> float:
        """How long the samples kept reach back [s]."""
        return self.recent[-1][0] - self.recent[0][0] if self.recent else 0.0

    def spaced(self, interval: float, count: int) -> list[Timed]:
        """Return up to ``count`` of the samples kept, newest first, ``interval`` [s] apart."""
        chosen: list[Timed] = []
        for sample in reversed(self.recent):
            if not chosen or chosen[-1][0] - sample[0] >= interval - 1e-6:
                chosen.append(sample)
                if len(chosen) == count:
                    break
        return chosen

    def window(self, length: float, columns: int) -> Array:
        """Return the samples of the newest ``length`` seconds, (n, columns); empty if short."""
        recent = self.recent
        if not recent or self.span < length:
            return np.empty((0, columns))
        begin = recent[-1][0] - length
        return np.array([values[:columns] for stamp, values in recent if stamp >= begin])


def angle_between(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the angle between two unit xyzw quaternions [rad]."""
    same = sum((x - y) ** 2 for x, y in zip(a, b))
    opposite = sum((x + y) ** 2 for x, y in zip(a, b))
    return 4.0 * asin(min(1.0, sqrt(min(same, opposite)) / 2))


def rates(samples: list[Timed]) -> list[Timed]:
    """Return the difference quotients of consecutive samples, at the times halfway between."""
    return [((t1 + t0) / 2, tuple((x1 - x0) / (t1 - t0) for x1, x0 in zip(v1, v0)))
            for (t1, v1), (t0, v0) in pairwise(samples)]


LATE_PATIENCE = 0.02
"""A sensor is late only where its stamps stay too old for that long: a caller that was late itself
first works off its queue, in five periods at 250 Hz [s]."""

POSITIONING_ERROR = (5e-4, 2e-3)
"""Error with which a robot may reach its command, however short the motion [m], [rad]."""

FOLLOW = 'check that the controller is active and follows, or lower pace.*'
"""Remedy for a robot that is too far from its commands."""

NAMES = {'wrench': ('force.x', 'force.y', 'force.z', 'torque.x', 'torque.y', 'torque.z'),
         'pose': ('position.x', 'position.y', 'position.z')}


class Stillness(NamedTuple):
    """Whether the tool is still, and if not, which channel moves, with numbers."""

    still: bool
    detail: str


@dataclass(frozen=True)
class WatchSettings:
    """
    When a sensor counts as lost, late, frozen or still; the names are the parameters' keys.

    At rest, and at the start, readings that repeat count only where the sensor does not usually
    repeat them so long, see :meth:`Channel.learn`.
    """

    pause_timeout: Annotated[float, Row(
        'Timeout of a sensor that pauses the motion', 's', 0.008, 10.0)
        ] = 0.04
    most_pauses: Annotated[int, Row(
        'Largest number of pauses by silent or late sensors in one sequence; 0: no limit',
        low=0, high=1_000_000)] = 20
    lost_timeout: Annotated[float, Row(
        'Time that a sensor may be silent or late before the motion ends', 's', 0.01, 60.0)
        ] = 1.0
    frozen_timeout: Annotated[float, Row(
        'Duration of identical readings that stops the motion; 0: not checked',
        's', 0.0, 10.0)] = 0.035
    max_age: Annotated[float, Row(
        'Age of the newest header stamp above which a sensor is late; 0: not checked',
        's', 0.0, 10.0)] = 0.25
    clock_timeout: Annotated[float, Row(
        'Standstill of /clock that ends the motion, with use_sim_time',
        's', 0.02, 60.0)] = 0.1
    window: Annotated[float, Row(
        'Window in which readings must be as quiet as before the start', 's', 0.05, 5.0)] = 0.25
    factor: Annotated[float, Row(
        'Factor by which standard deviations may exceed those before the start',
        low=1.0, high=100.0)] = 1.25
    force_floor: Annotated[float, Row(
        'Standard deviation of forces that always counts as rest', 'N', 0.0, 100.0)] = 0.02
    torque_floor: Annotated[float, Row(
        'Standard deviation of torques that always counts as rest', 'N m', 0.0, 10.0)] = 0.002
    position_floor: Annotated[float, Row(
        'Standard deviation of positions that always counts as rest', 'm', 0.0, 0.1)] = 5e-6


class Monitor:
    """
    Monitor of the sensors of one robot.

    Parameters
    ----------
    topics : dict
        Topic by channel: ``wrench``, ``pose`` and any others that have to be alive.

    Attributes
    ----------
    fault : str
        The first fault of a sample since the start, in one line; empty: there was none.
    """

    def __init__(self, settings: WatchSettings, limits: Limits, topics: dict[str, str]) -> None:
        self.settings, self.limits = settings, limits
        self.channels = {name: Channel(topic) for name, topic in topics.items()}
        self.fault = ''
        self._now = 0.0
        self._ticked = -inf
        self._was_stale = False
        self._resting: tuple[float, ...] = ()
        self._moved = inf
        self._arrived: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        self._commanded: tuple[float, ...] = ()
        self._commands: deque[tuple[float, tuple[float, ...]]] = deque()
        self._noise: dict[str, Array] = {}

    # Samples in -----------------------------------------------------------------------------

    def wrench(self, stamp: float, values: tuple[float, ...]) -> None:
        """Take one reading, six numbers [N, N m], at ``stamp`` [s]."""
        channel = self._take('wrench', stamp, values)
        fx, fy, fz, nx, ny, nz = values
        limits = self.limits
        for key, square, limit, unit in (
                ('force', fx * fx + fy * fy + fz * fz, limits.force, 'N'),
                ('torque', nx * nx + ny * ny + nz * nz, limits.torque, 'N m')):
            if square > limit * limit:
                self._fault(f'{channel.topic}: {key} {above(sqrt(square), limit)} {unit} exceeds '
                            f'limits.{key} {limit:g} {unit}')
        channel.keep()

    def pose(self, stamp: float, values: tuple[float, ...]) -> None:
        """Take one measured pose, x y z [m] qx qy qz qw, at ``stamp`` [s]."""
        channel = self._take('pose', stamp, values)
        norm = sum(x * x for x in values[3:])
        # unit norm: largest departure of the squared norm of a measured quaternion from 1:
        # rounding and single precision stay far below it
        if not abs(norm - 1.0) <= 1e-2:
            self._fault(f'{channel.topic}: a quaternion has norm {sqrt(max(norm, 0.0)):.3g}, '
                        'not 1')
            return
        self._check_workspace(channel, values[:3], 'ft_sensor')
        x, y, z, a, b, c, d = values
        u, v, w = rotate((a, b, c, d), self.limits.tip.tolist())
        self._check_workspace(channel, (x + u, y + v, z + w), 'the tip')
        channel.keep()
        self._check_speed(channel)
        self._check_changes(channel)

    def other(self, name: str, stamp: float, values: tuple[float, ...]) -> None:
        """Take a sample of any other channel."""
        channel = self._take(name, stamp, values)
        if not max(map(abs, values), default=0.0) < ABSURD:
            self._fault(f'{channel.topic}: a reading is beyond {ABSURD:g}')
        channel.keep()

    def _take(self, name: str, stamp: float, values: tuple[float, ...]) -> Channel:
        channel = self.channels[name]
        if not isfinite(sum(values)):
            self._fault(f'{channel.topic}: a reading is not finite')
        channel.take(self._now, stamp, values)
        return channel

    def _fault(self, fault: str) -> None:
        self.fault = self.fault or fault

    def _check_workspace(self, channel: Channel, position: tuple[float, ...], name: str) -> None:
        # a measured position may be that far outside the workspace, to which plans may go: a
        # robot there overshoots a little [m]
        workspace_slack = 0.002
        limits = self.limits
        for axis, x, low, high in zip('xyz', position, limits.workspace_min, limits.workspace_max):
            if not low - workspace_slack <= x <= high + workspace_slack:
                self._fault(f'{channel.topic}: {axis} = '
                            f'{below(x, low, 4) if x < low else above(x, high, 4)} m of {name} is '
                            f'outside limits.workspace_min/max {low:g} to {high:g} m')

    def _check_speed(self, channel: Channel) -> None:
        now, values = channel.recent[-1]
        for stamp, before in reversed(channel.recent):
            # measured speeds are difference quotients over at least that
            # long: ten poses at 250 Hz [s]
            if now - stamp >= 0.04:
                break
        else:
            return
        span = now - stamp
        self._check_overspeed(f'{channel.topic}: moves at', 'speed', 'm/s',
                              dist(values[:3], before[:3]) / span)
        self._check_overspeed(f'{channel.topic}: rotates at', 'angular_speed', 'rad/s',
                              angle_between(values[3:], before[3:]) / span)

    def _check_overspeed(self, what: str, key: str, unit: str, found: float) -> None:
        limit: float = getattr(self.limits, key)
        most = self.limits.overspeed * limit
        if found > most:
            self._fault(f'{what} {above(found, most)} {unit}, above limits.overspeed '
                        f'{self.limits.overspeed:g} times limits.{key} {limit:g} {unit}')

    def _check_changes(self, channel: Channel) -> None:
        """Check acceleration and jerk by difference quotients of the newest positions."""
        # measured accelerations and jerks are difference quotients of positions that far apart:
        # five poses at 250 Hz, whose noise they would amplify otherwise [s]
        spaced = channel.spaced(0.02, 4)
        if len(spaced) < 4:
            return
        acceleration = rates(rates([(t, values[:3]) for t, values in spaced]))
        for key, rows, unit in (('acceleration', acceleration, 'm/s^2'),
                                ('jerk', rates(acceleration), 'm/s^3')):
            self._check_overspeed(f'{channel.topic}: {key} of', key, unit,
                                  sqrt(sum(x * x for x in rows[0][1])))

    # Faults out ---------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Advance the clock on which silence is measured to ``now`` of a steady clock [s]."""
        # longest tick: of the time between two ticks no more than that counts as silence of the
        # sensors: a caller that ticks every 4 ms and was away for longer has not listened
        # to them [s]
        self._now += min(max(now - self._ticked, 0.0), 0.01)
        self._ticked = now

    def command(self, stamp: float, pose: tuple[float, ...]) -> None:
        """Note a command, x y z [m] qx qy qz qw, with which poses of its time are compared."""
        self._commands.append((stamp, pose))
        travel = dist(pose[:3], (self._resting or pose)[:3]) / VISIBLE_TRAVEL
        turn = angle_between(pose[3:], (self._resting or pose)[3:]) / VISIBLE_TURN
        self._note_command(stamp, pose, max(travel, turn))

    def joints(self, stamp: float, positions: tuple[float, ...]) -> None:
        """Note a command of joints [rad], with which poses are not compared."""
        turns = (abs(a - b) for a, b in zip(positions, self._resting or positions))
        self._note_command(stamp, positions, max(turns) / VISIBLE_TURN)

    def _note_command(self, stamp: float, command: tuple[float, ...], travel: float) -> None:
        """Note a command, and its stamp where motion begins to show: from a ``travel`` of 1 on."""
        self._resting = self._resting or command
        self._commanded = command
        if travel >= 1.0:
            self._moved = min(self._moved, stamp)

    def check(self, moving: bool) -> str:
        """
        Return the fault that calls for an abort, in one line; empty: there is none.

        Parameters
        ----------
        moving : bool
            Whether the commands move.
        """
        if not moving:
            self._moved, self._resting = inf, self._commanded
        for channel in self.channels.values():
            moved = moving and channel.stamp >= self._moved
            channel.moving_since = min(channel.moving_since, self._now) if moved else inf
        return self.fault or self._frozen() or self._tracking_fault()

    def stale(self, ros_now: float) -> str:
        """
        Return which sensor is silent or late, a reason to pause, in one line; empty: none is.

        Parameters
        ----------
        ros_now : float
            Time on the clock of the header stamps [s].
        """
        patience = 0.0 if self._was_stale else LATE_PATIENCE
        stale = self._silent(self.settings.pause_timeout) or self._late(ros_now, patience)
        self._was_stale = bool(stale)
        return stale

    def _silent(self, timeout: float) -> str:
        for channel in self.channels.values():
            silent = self._now - channel.received
            if silent > timeout:
                return f'{channel.topic}: silent for {silent:.3f} s'
        return ''

    def _late(self, ros_now: float, patience: float) -> str:
        for channel in self.channels.values():
            age = ros_now - channel.stamp
            if not 0 < self.settings.max_age < age:
                channel.late_since = inf
                continue
            channel.late_since = min(channel.late_since, self._now)
            if self._now - channel.late_since >= patience:
                return (f'{channel.topic}: newest stamp is {age:.3f} s old, watch.max_age is '
                        f'{self.settings.max_age:g} s; synchronise the clocks')
        return ''

    def _frozen(self) -> str:
        timeout = self.settings.frozen_timeout
        for channel in self.channels.values():
            stuck = channel.received - max(channel.changed, channel.moving_since)
            if 0 < timeout < stuck:
                return f'{channel.topic}: the same reading for {stuck:.3f} s of motion'
        return self._frozen_at_rest()

    def _frozen_at_rest(self) -> str:
        for channel in self.channels.values():
            same = channel.received - channel.changed
            if self.settings.frozen_timeout and same > channel.rest_timeout:
                usual = below(channel.rest_timeout, same)
                return (f'{channel.topic}: the same reading for {above(same, float(usual))} s, at '
                        f'rest it changed within {usual} s')
        return ''

    def _tracking_fault(self) -> str:
        pose, commands = self.channels['pose'], self._commands
        while len(commands) > 1 and commands[1][0] <= pose.stamp:
            commands.popleft()
        if not commands or commands[0][0] > pose.stamp:
            return ''
        commanded, limits = commands[0][1], self.limits
        for off, key, limit, unit in (
                (dist(pose.values[:3], commanded[:3]), 'error', limits.tracking_error, 'm'),
                (angle_between(pose.values[3:], commanded[3:]), 'angle', limits.tracking_angle,
                 'rad')):
            if off > limit:
                return (f'{pose.topic}: {above(off, limit)} {unit} from the command, '
                        f'limits.tracking_{key} is {limit:g} {unit}; {FOLLOW}')
        return ''

    def begin(self, ros_now: float) -> None:
        """
        Prepare for a sequence: all sensors alive, within limits and still; learn the noise.

        Raises
        ------
        DataError
            A topic is silent, stale, frozen, not finite, or too short for the stillness window.
        MotionError
            The robot moves.
        """
        for channel in self.channels.values():
            if channel.received == -inf:
                raise DataError(f'{channel.topic}: nothing received yet; check that its driver '
                                'runs and the topic is remapped')
        self.fault = ''
        self._commands.clear()
        self._resting, self._commanded, self._moved, self._arrived = (), (), inf, None
        for fault in (self._silent(self.settings.lost_timeout), self._late(ros_now, 0.0)):
            if fault:
                raise DataError(fault)
        for name in NAMES:
            self._noise[name] = self._noise_at_rest(name)
        for channel in self.channels.values():
            channel.learn(self.settings.frozen_timeout)
        if frozen := self._frozen_at_rest():
            raise DataError(frozen)

    def _noise_at_rest(self, name: str) -> Array:
        channel, window = self.channels[name], self.settings.window
        windows = int(channel.span / window)
        if windows < 2:
            raise DataError(f'{channel.topic}: only {below(channel.span, 2 * window)} s received, '
                            f'{2 * window:g} s are required; wait, then start again')
        values = np.array_split(channel.window(channel.span, len(NAMES[name])), windows)
        if not all(np.isfinite(part).all() for part in values):
            raise DataError(f'{channel.topic}: a reading is not finite')
        noise = np.sqrt(np.mean([part.var(axis=0) for part in values], axis=0))
        drift = np.ptp([part.mean(axis=0) for part in values], axis=0)
        excess = drift / (noise + 3 * self._floor(name))
        if excess.max() > 1:
            i = int(np.argmax(excess))
            raise MotionError(f'{channel.topic}: {NAMES[name][i]} drifts by {drift[i]:.3g} '
                              f'in {channel.span:.2g} s; start with the robot at rest')
        return np.asarray(noise)

    def _floor(self, name: str) -> Array:
        settings = self.settings
        if name == 'pose':
            return np.full(3, settings.position_floor)
        return np.repeat([settings.force_floor, settings.torque_floor], 3)

    def stillness(self) -> Stillness:
        """Compare the newest window with the noise at the start, once the robot has arrived."""
        if not_arrived := self._not_arrived():
            return Stillness(False, not_arrived)
        for name, labels in NAMES.items():
            channel = self.channels[name]
            values = channel.window(self.settings.window, len(labels))
            if len(values) < 5:
                return Stillness(False, f'{channel.topic}: too few samples')
            std = values.std(axis=0)
            bound = np.hypot(self.settings.factor * self._noise[name], self._floor(name))
            i = int(np.argmax(std / bound))
            if not std[i] <= bound[i]:
                most = below(bound[i], std[i])
                return Stillness(False, f'{channel.topic}: standard deviation of {labels[i]} is '
                                        f'{above(std[i], float(most))} > {most}')
        if self._commands:
            self._arrived = self._commands[-1][1], self.channels['pose'].values
        return Stillness(True, '')

    def _not_arrived(self) -> str:
        """Return how much of a commanded motion the robot has done; empty: it has arrived."""
        if self._arrived is None or not self._commands:
            return ''
        pose, (target, seen), now = self.channels['pose'], self._arrived, self._commands[-1][1]
        for way, done, error, unit in (
                (dist(now[:3], target[:3]), dist(pose.values[:3], seen[:3]),
                 POSITIONING_ERROR[0], 'm'),
                (angle_between(now[3:], target[3:]), angle_between(pose.values[3:], seen[3:]),
                 POSITIONING_ERROR[1], 'rad')):
            # a robot that has done this share of the commanded motion has
            # arrived: its gain may be below 1
            if done < 0.9 * way - error:
                return f'{pose.topic}: moved only {done:.3g} of the commanded {way:.3g} {unit}'
        return ''

    def mean(self, name: str) -> Array:
        """Return the mean of the newest window of ``wrench`` (6,) or ``pose`` positions (3,)."""
        return np.asarray(
            self.channels[name].window(self.settings.window, len(NAMES[name])).mean(axis=0))
