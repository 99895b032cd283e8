"""
A rigid tool behind the measured motion: what its sensors should report, noise-free.

A robot moves much as its simulation does. Where only noise is left of the difference of the two
poses, the simulated one is the better measurement: a tool's acceleration out of noisy poses would
be in the residual and in what is fitted to it, and favour any effect that is smooth.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_from_vector, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.effects import EFFECTS, physical_rig
from forcecal_ros.effects.nuisances import NAMELESS, Nuisance, of_sensors, OF_TOOL, with_inertia
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import INVERTIBLE
from forcecal_ros.sim.rigid_tool import (
    CABLE,
    CarriedTool,
    only,
    POSE_ERRORS,
    RigidTool,
    SMOOTH,
    UNKNOWN_DELAY,
)
from forcecal_ros.sim.signals import (
    accelerometer_volts,
    BLOCK,
    block_means,
    CLEAR,
    clear_of,
    clear_share,
    EXACT,
    KEPT,
    MOST,
    RATE,
    Signals,
    slow,
    spectrum,
)
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.spatial.transform import Rotation


def merge_poses(measured: PoseStream, simulated: PoseStream, wide: float = EXACT) -> PoseStream:
    """
    Return the motion of the robot, as well as both recordings tell it.

    Parameters
    ----------
    measured, simulated : PoseStream
        On one clock; of one base, or each of its own.
    wide : float
        Band of the filter of their difference in the band in which that is clear.

    Returns
    -------
    PoseStream
        While both are there.
    """
    start = max(measured.t[0], simulated.t[0])
    end = min(measured.t[-1], simulated.t[-1])
    # at the measured pose's own rate: more instants would not have its noise
    rate = (len(measured) - 1) / (measured.t[-1] - measured.t[0])
    t = start + np.arange(int((end - start) * rate)) / rate
    made, seen = simulated.at(t), measured.at(t)
    turned = rotation_vector(np.swapaxes(made.R_base_sensor, 1, 2) @ seen.R_base_sensor)
    position = seen.position
    if measured.has_position and simulated.has_position:
        position = made.position + _without_noise(position - made.position, rate, wide)
    return replace(seen, position=position, R_base_sensor=made.R_base_sensor
                   @ rotation_from_vector(_without_noise(turned, rate, wide)))


def _without_noise(difference: Array, rate: float, wide: float) -> Array:
    """Leave out of a difference, shape (n, 3), what is no more than noise."""
    t = np.arange(len(difference)) / rate
    return clear_of(difference, rate, 0.0, wide).of(t, difference, rate)


def express_in_base(measured: PoseStream, simulated: PoseStream) -> PoseStream:
    """
    Bring simulated poses into the robot's base, which may be turned about the vertical.

    Parameters
    ----------
    measured, simulated : PoseStream
        On one clock.

    Raises
    ------
    DataError
        The sensor's frames are turned to each other, or a base is not upright.
    """
    start, end = (f(measured.t[i], simulated.t[i]) for f, i in ((max, 0), (min, -1)))
    # instants at which two motions are compared
    t = np.linspace(start, end, 500)
    R, S = (Rotation.from_matrix(p.at(t).R_base_sensor) for p in (measured, simulated))
    sensor, in_sensor = _mean_rotation(S.inv() * R)
    base, in_base = _mean_rotation(R * S.inv())
    # angle beyond which frames are others [rad]: no arm is always that far from its simulation
    if min(sensor.magnitude(), base.magnitude()) < 0.1:
        return simulated
    if in_sensor < in_base:
        raise DataError('the frames of the poses of robot and simulator are rotated by '
                        f'{np.degrees(sensor.magnitude()):.0f} deg to each other; '
                        'record the pose of the frame of the wrench in both')
    axis = base.as_rotvec() / base.magnitude()
    # how far the axis of a turn of the base may lean for gravity to stay where it is [rad]
    if np.hypot(axis[0], axis[1]) > 0.05:
        raise DataError('the bases of robot and simulator are rotated by '
                        f'{np.degrees(base.magnitude()):.0f} deg to each other, not about the '
                        'vertical; gravity must be along -Z of both')
    turn = base.as_matrix()
    return replace(simulated, position=simulated.position @ turn.T,
                   R_base_sensor=turn @ simulated.R_base_sensor)


def _mean_rotation(turns: Rotation) -> tuple[Rotation, float]:
    """Return the mean of rotations, and how far they are from it, RMS [rad]."""
    mean = turns.mean()
    apart: Array = (turns * mean.inv()).magnitude()
    return mean, float(np.sqrt(np.mean(apart ** 2)))


EXACT_RATIO = 0.2
"""
RMS in that of the noise, up to which a motion is known: a filtered acceleration lacks its edges.

Simulated rigid tools had a residual of 0.05 to 0.11 in one channel or other.
"""

EFFECTS_SHOWN = frozenset({
    'wrench_delay', 'wrench_lowpass', 'wrench_bias_drift', 'wrench_gain', 'wrench_crosstalk',
    'wrench_hysteresis', 'accel_delay', *INVERTIBLE,
    'tool_mass', 'tool_com', 'base_tilt', CABLE})
"""Effects that a measured motion can show: none of what the robot makes of its commands."""


class MeasuredMotion:
    """
    One recorded motion, along which a tool is carried as often as needed.

    Inputs are noisy, and their noise is in the residual. Were it also in what a change of the rig
    makes of the signals, an effect of smooth signals would be preferred for that alone. So a
    change is taken along the motion as far as it is clear of noise, and added to the nominal
    signals.

    Parameters
    ----------
    recording : Recording
        With measured pose; the accelerometer in volts of the rigid tool's model.
    start : float
        When block 0 begins [s].
    accelerometer : str
        ``acc1`` or ``acc2``.
    rigid_tool : RigidTool
        The nominal one.
    clear : Recording, optional
        Its motion as far as it is clear of noise, where that is known better.
    """

    band, exact, starts_white, library = MOST, EXACT_RATIO, True, EFFECTS

    def __init__(self, recording: Recording, start: float, n_blocks: int, accelerometer: str,
                 rigid_tool: RigidTool, clear: Recording | None = None) -> None:
        self.start, self.n_blocks, self.accelerometer = start, n_blocks, accelerometer
        given = start, n_blocks, accelerometer
        self._full = CarriedTool(recording, *given)
        self._clear = CarriedTool(clear or recording, *given, clear=True)
        self._unclear = self._full.wire(rigid_tool) - self._clear.wire(rigid_tool)
        self.from_accelerometer = self._full.accelerated

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect can show: a delay that is not known is estimated along instead."""
        if effect == 'accel_delay' and isinstance(rig, RigidTool):
            return rig.spreads.accel_behind < UNKNOWN_DELAY
        return effect in EFFECTS_SHOWN

    def nuisances(self, rig: Rig, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
        """List what tool and sensors may differ in from what is known."""
        own = np.diag(rig.tool.inertia)
        found = [*OF_TOOL, *(Nuisance(f'tool.inertia.{a}', 'own_inertia', with_inertia(i),
                                      least=-own[i], limit=NAMELESS)
                             for i, a in enumerate('xyz'))]
        if not self.from_accelerometer:
            found += [Nuisance(f'pose.{name}', name, _more(name)) for name in POSE_ERRORS]
        else:
            assert isinstance(rig, RigidTool)
            unknown = rig.spreads.accel_behind >= UNKNOWN_DELAY
            found.append(Nuisance('accelerometer.delay', 'accel_behind', _more('accel_behind'),
                                  least=-rig.accel_behind if unknown else -np.inf))
        # what the accelerometer has of its own is in the motion, too, and so in the wrench
        found += [n._replace(acts_on='rig') if n.acts_on == 'volts' else n
                  for n in of_sensors(self.accelerometer, streams)]
        return tuple(n for n in found if getattr(rig.spreads, n.key) > 0.0)

    def tangent(self, rig: Rig, nuisance: str) -> None:
        """Return that its signals are linear about no point."""

    def settle(self, rig: Rig, *, whole: bool = False) -> bool:
        """Return that signals are exact as they are."""
        return False

    def signals(self, rig: Rig) -> Signals:
        """
        Carry a tool along.

        Parameters
        ----------
        rig : Rig
            A rigid tool.

        Returns
        -------
        Signals
            The accelerometer's are those of rest.
        """
        rigid_tool, full = physical_rig(rig), self._full
        resting = replace(rigid_tool, effects=only(rigid_tool.effects, INVERTIBLE))
        volts = accelerometer_volts(resting, self.accelerometer, full.weight(rigid_tool))
        return full.signals(rig, self._clear.wire(rig) + self._unclear, volts)

    def clear(self, signals: Signals) -> Signals:
        """Return signals with a wrench as far as it is clear of noise."""
        return signals._replace(wrench=signals.wrench - self._unclear)

    def smooth(self, signals: Signals) -> Signals:
        """Return signals without the noise of pose and accelerometer, which is in them all."""
        start, *parts = signals[:-1]  # no joints
        smooth = [slow(part.reshape(len(part), -1), RATE, SMOOTH).reshape(part.shape)
                  for part in parts]
        return Signals(start, *smooth)


def _more(name: str) -> Callable[[Rig, float], Rig]:
    """Add to a number of a rigid tool."""
    def apply(rig: Rig, x: float) -> Rig:
        changed: dict[str, Any] = {name: getattr(rig, name) + x}
        return replace(rig, **changed)
    return apply


class RecordedSimulation(MeasuredMotion):
    """
    One recorded motion, along which a simulator's tool is carried as often as needed.

    Parameters
    ----------
    recording : Recording
        Of the robot: its pose.
    simulated : Recording
        Of the simulator, on the robot's clock: wrench and pose, and specific force where it has.
    start : float
        When block 0 begins [s].
    accelerometer : str
        ``acc1`` or ``acc2``.
    rigid_tool : RigidTool
        The simulator's tool, as its wrench and motion tell it.

    Attributes
    ----------
    touching : ndarray of bool, shape (n_blocks,)
        Where the simulated tool touches something.
    beyond : ndarray, shape (n, 6)
        What the simulated wrench holds in addition to a rigid tool's.
    """

    def __init__(self, recording: Recording, simulated: Recording, start: float, n_blocks: int,
                 accelerometer: str, rigid_tool: RigidTool) -> None:
        measured, made = recording.pose, simulated.pose
        assert measured is not None
        assert made is not None
        accel, simulated = simulated.accelerometer, replace(simulated, accelerometer=None)
        exact, kept = (replace(recording, pose=merge_poses(measured, made, wide),
                               accelerometer=None) for wide in (EXACT, KEPT))
        super().__init__(exact, start, n_blocks, accelerometer, rigid_tool, kept)
        own, smooth = (CarriedTool(simulated, start, n_blocks, accelerometer, clear=clear)
                       for clear in (False, True))
        recorded = own.recorded_wrench(simulated)
        below = recorded - own.wire(rigid_tool)
        above, clear = _above_band(simulated, own)
        self.beyond = self._full.beyond = below + above
        self._clear.beyond = recorded - smooth.wire(rigid_tool) + clear
        self._unclear = self._full.wire(rigid_tool) - self._clear.wire(rigid_tool)
        self.touching = contact_blocks(block_means(below))
        self._imu = None if accel is None else self._carried_over(
            accel.at(own.t), own, rigid_tool)

    def _carried_over(self, accel: Array, own: CarriedTool, rigid_tool: RigidTool
                      ) -> tuple[Array, Array, Array]:
        """
        Take the Imu's reading without weight to the robot's motion.

        Returns
        -------
        clear : ndarray, shape (n, 3)
            As far as that is clear of noise [m/s^2].
        unclear : ndarray, shape (n, 3)
            What the sensor makes of the rest.
        place : ndarray, shape (3,)
            Of the Imu in S [m].
        """
        f = own.specific_force_of_origin(rigid_tool)
        place = np.linalg.lstsq(own.lever.reshape(-1, 3), (accel - f).ravel(), rcond=1e-6)[0]
        full, clear = (accel - f - own.lever @ place + there.specific_force_of_origin(rigid_tool)
                       + there.lever @ place for there in (self._full, self._clear))
        sensed = [accelerometer_volts(rigid_tool, self.accelerometer, a) for a in (full, clear)]
        return clear - self._clear.weight(rigid_tool), sensed[0] - sensed[1], place

    def signals(self, rig: Rig) -> Signals:
        """Carry a tool along, and the simulator's Imu."""
        found = super().signals(rig)
        if self._imu is None:
            return found
        accel, unclear, place = self._imu
        accel = (accel + self._clear.weight(physical_rig(rig))
                 + self._clear.acceleration_error(rig, place))
        return found._replace(
            volts=accelerometer_volts(rig, self.accelerometer, accel) + unclear)


def _above_band(simulated: Recording, own: CarriedTool) -> tuple[Array, Array]:
    """
    Return what a simulated wrench holds above the band of poses, (n, 6), and what of it is clear.

    Effects act on what is clear: a low-pass would smooth the noise of a prediction, and be named
    for that alone.
    """
    wrench = simulated.wrench
    assert wrench is not None
    most = wrench.rate / 5.0
    frequency, power = spectrum(wrench.values, wrench.rate)
    floor = np.median(power[frequency > 2.0 * most], axis=0)
    clear = frequency[(power > CLEAR * floor).any(axis=1)].max(initial=0.0)
    band = min(most, 2.0 * float(clear))  # flat up to where the wrench is clear
    if band <= MOST:
        return np.zeros((len(own.t), 6)), np.zeros((len(own.t), 6))
    above = own.recorded_wrench(simulated, band) - own.recorded_wrench(simulated)
    noise = np.maximum(floor * (band - MOST), 1e-300)
    return above, above * clear_share(above, noise, RATE)[:, np.newaxis]


CONTACT_FORCE_N = 1.0
"""From which a force beyond a rigid tool's is contact, at least [N]: six times a UR's noise."""


def contact_blocks(beyond: Array) -> NDArray[np.bool_]:
    """
    Tell blocks in which a simulated tool touches something, and what is near them.

    Parameters
    ----------
    beyond : ndarray, shape (n, 6)
        Block means of the simulated wrench beyond a rigid tool's.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    force = np.linalg.norm(beyond[:, :3] - np.median(beyond[:, :3], axis=0), axis=1)
    scatter = 1.4826 * float(np.median(np.abs(force - np.median(force))))
    # contact sigma: and in the median deviation of what is beyond: a simulator's noise hardly
    # ever shows that
    limit = max(CONTACT_FORCE_N, 8.0 * scatter)
    near = widen_blocks(force > limit)
    # part of a recording that may be left out; what is more is no contact but another wrench
    return near if near.mean() <= 0.5 else np.zeros(len(force), dtype=bool)


def widen_blocks(blocks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Add what is near some blocks."""
    # time left out before and after contact [s]: a robot 10 mm/s fast and 1 mm off touches 0.1 s
    # earlier
    width = 2 * round(0.2 / BLOCK) + 1
    return np.asarray(maximum_filter1d(blocks.astype(np.int8), width) > 0)
