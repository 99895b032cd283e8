"""A rigid tool and its sensors: what is known of both, and the wrench along a motion."""

from dataclasses import dataclass, fields, replace
from typing import Annotated, TypeVar

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.geometry import Array, rotation_vector, skew
from forcecal_ros.core.schema import Row
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.effects import named_effects, physical_rig, WrenchEffects
from forcecal_ros.effects.library import Chosen
from forcecal_ros.effects.nuisances import possible, rows_of
from forcecal_ros.effects.rig import AccelerometerModel, NominalTolerances, Rig, Tool
from forcecal_ros.effects.signals import specific_force_of
from forcecal_ros.sim.signals import (
    BLOCK,
    block_means,
    clear_band,
    clear_of,
    EXACT,
    KEPT,
    Last,
    LowPass,
    MOST,
    RATE,
    Signals,
    slow,
    slowed,
    STEEP,
    UNSEEN,
)
import numpy as np

Spreads = TypeVar('Spreads', bound=NominalTolerances)

UNKNOWN_DELAY = 0.01
"""Delay between two sensors that no calibration gives, 1 sigma [s]; three are a slow driver."""

FAST, SHAKE = 5.0, 0.3
"""
Motion above this frequency [Hz] may be larger or smaller than poses show, by this ratio, 1 sigma.

Commands are slower. A filter of poses with its corner at 9 Hz hides 0.3 of a shake of 9 Hz.
"""

SHAKE_DELAY_S = 0.007
"""
Delay of motion above that frequency behind poses, 1 sigma [s]; negative where poses are late, as
behind a filter with its corner at 23 Hz.
"""

COMPLIANCE = 1.3e-4
"""
Displacement of the flange from where encoders see it for an acceleration, 1 sigma [s^2]: joints
with a resonance at 14 Hz, 1 / w^2.
"""

POSE_ERRORS = 'shake', 'shake_delay', 'compliance'
"""Ways in which poses may misreport a motion."""

GYRATION = 0.05
"""Radius of gyration of a tool whose inertia is not known, 1 sigma: a gripper's [m]."""


@dataclass(frozen=True)
class RigidToolSpreads(NominalTolerances):
    """Nominal tolerances, and those of what a calibration may not know."""

    accel_behind: Annotated[float, Row('of accel_behind', 's', 0.0)] = 0.0
    own_inertia: Annotated[float, Row('absolute', 'kg m^2', 0.0)] = 0.0
    shake: Annotated[float, Row('absolute', '1', 0.0)] = SHAKE
    shake_delay: Annotated[float, Row('absolute', 's', 0.0)] = SHAKE_DELAY_S
    compliance: Annotated[float, Row('absolute', 's^2', 0.0)] = COMPLIANCE


@dataclass(frozen=True)
class RigidTool(Rig):
    """A rig of which only tool and sensors count, and whose sensors' stamps may be apart."""

    spreads: Annotated[RigidToolSpreads, Row('')]
    accel_behind: Annotated[float, Row(
        'how much later than the wrench the accelerometer shows the same instant', 's')] = 0.0
    shake: Annotated[float, Row(
        'how much larger fast motion is than poses show', '1')] = 0.0
    shake_delay: Annotated[float, Row(
        'how much later fast motion is than poses show', 's')] = 0.0
    compliance: Annotated[float, Row(
        'displacement of the flange that encoders do not see, for an acceleration', 's^2')] = 0.0

    @property
    def accelerometer_unit(self) -> str:
        """Of its accelerometer's readings: ``m/s^2`` where they need no gain."""
        return 'm/s^2' if set(self.accelerometer.model().gain) == {1.0} else 'V'


def rigid_tool_of_rig(rig: Rig) -> RigidTool:
    """Take tool and sensors of a rig; its sensors have one clock."""
    own = {f.name: getattr(rig, f.name) for f in fields(Rig)}
    tolerances = {f.name: getattr(rig.spreads, f.name) for f in fields(NominalTolerances)}
    return RigidTool(**{**own, 'spreads': RigidToolSpreads(**tolerances)})


def rigid_tool_of_calibration(calibration: Calibration, rig: Rig) -> RigidTool:
    """
    Take tool and sensors as they were calibrated.

    Parameters
    ----------
    rig : Rig
        Gives the tolerances: a sensor's zero drifts also after it was calibrated.

    Returns
    -------
    RigidTool
        Its accelerometer speaks m/s^2 along the axes of ft_sensor.
    """
    c, a, tool = calibration, calibration.accelerometer, rig.tool
    inertia = np.zeros((3, 3)) if c.inertia is None else c.inertia.value
    changed: Tool = replace(tool, mass=float(c.mass), com=_three(c.com.value),
                            inertia=rows_of(possible(inertia)))
    rigid_tool = rigid_tool_of_rig(replace(rig, effects=(), optidrive=None))
    place = changed.com if a is None or a.position is None else _three(a.position.value)
    scale = AccelerometerModel((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0)
    return replace(rigid_tool, tool=changed, gravity=(0.0, 0.0, -c.gravity),
                   spreads=_tolerances(c, rigid_tool.spreads),
                   wrench_sensor=replace(rig.wrench_sensor, gain=(1.0,) * 6,
                                         bias=tuple(c.wrench_bias.value.tolist())),
                   accelerometer=replace(rig.accelerometer, mounted='acc1', acc1=scale,
                                         position=place),
                   accel_behind=0.0 if a is None else float(a.delay))


def _tolerances(c: Calibration, usual: RigidToolSpreads) -> RigidToolSpreads:
    """Add what the calibration does not know to what changes from day to day."""
    mass, a = float(c.mass), c.accelerometer
    late = np.inf if a is None else float(a.delay.std)
    offset = 0.0 if a is None else float(np.abs(
        np.linalg.solve(a.matrix, np.nan_to_num(a.offset.std))).max())
    gyration = mass * GYRATION ** 2
    return replace(
        widened(usual, **tool_uncertainty(c), accelerometer_offset=offset),
        accel_behind=late if np.isfinite(late) else UNKNOWN_DELAY,
        own_inertia=gyration if c.inertia is None else min(gyration, known_std(c.inertia).max()))


def widened(usual: Spreads, **unknown: float) -> Spreads:
    """Add, by name, what is not known to how far a healthy rig departs from its file."""
    return replace(usual, **{
        name: float(np.hypot(getattr(usual, name), std)) for name, std in unknown.items()})


def tool_uncertainty(c: Calibration) -> dict[str, float]:
    """Return by name of the tolerance what a calibration does not know of tool and biases."""
    bias = known_std(c.wrench_bias)
    return {'mass': known_std(c.mass).max() / float(c.mass), 'com': known_std(c.com).max(),
            'force_bias': bias[:3].max(), 'torque_bias': bias[3:].max()}


def known_std(estimate: Estimate) -> Array:
    """Return standard errors, 0 of what has none."""
    return np.nan_to_num(np.atleast_1d(estimate.std))


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


SMOOTH = 3.0
"""Frequency up to which a discrepancy follows the motion [Hz]: noise is mostly faster."""

CABLE = 'cable_force'

HYSTERESIS = frozenset({'wrench_hysteresis'})


MARGIN_S = 2.0 / MOST
"""Time before and after what is compared that filters need [s]: two periods of the band."""


class CarriedTool:
    """
    One recorded motion, along which tools are carried.

    Accelerations are those of the accelerometer or, without one, of the measured position;
    without either, only weight is expected.

    Parameters
    ----------
    recording : Recording
        With measured pose; the accelerometer in volts of the rig's model.
    start : float
        When block 0 begins [s].
    accelerometer : str
        ``acc1`` or ``acc2``.
    clear : bool
        Whether to leave out of each input what is not clear of its noise.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Instants of all the others [s].
    R_base_sensor : ndarray, shape (n, 3, 3)
    position, velocity, acceleration : ndarray, shape (n, 3)
        Of S in base [m], [m/s], [m/s^2]; zero where no position was measured.
    omega, alpha : ndarray, shape (n, 3)
        In S [rad/s], [rad/s^2].
    lever : ndarray, shape (n, 3, 3)
        Times a point's place in S, its acceleration beyond the origin's.
    slide : ndarray, shape (n,)
        Of the tool along x [m].
    beyond : ndarray, shape (n, 6)
        What the wrench holds in addition to a rigid tool's.
    """

    def __init__(self, recording: Recording, start: float, n_blocks: int, accelerometer: str,
                 *, clear: bool = False) -> None:
        pose = recording.pose
        assert pose is not None
        # filters see what is before and after, as far as it was recorded
        n = n_blocks * round(BLOCK * RATE)
        before, after = (int(RATE * np.clip(there, 0.0, MARGIN_S)) for there in (
            start - pose.t[0], pose.t[-1] - start - n / RATE))
        count = np.arange(1.0 - before, 1.0 + n + after)
        self.t: Array = np.asarray(start + count / RATE, dtype=np.float64)
        self.start, self.accelerometer, self._clear = start, accelerometer, clear
        moved = pose.at(np.clip(self.t, pose.t[0], pose.t[-1]))
        self.R_base_sensor = moved.R_base_sensor
        self._turn(pose)
        self._travel(pose, moved.position)
        rows = np.hstack([self.acceleration, self.alpha])
        self._fast = rows - slow(rows, RATE, FAST, STEEP)
        self._deflecting = -_rate_of(_rate_of(rows))
        for name in ('t', 'R_base_sensor', 'position', 'velocity', 'acceleration', 'omega',
                     'alpha', 'lever', '_fast', '_deflecting'):
            setattr(self, name, getattr(self, name)[before:before + n])
        self._along = np.einsum('nij,ni->nj', self.R_base_sensor, self.acceleration)
        self._weight = Last[Array]()
        stream, self.slide = recording.optidrive, np.zeros(len(self.t))
        if stream is not None and len(stream) > 1:
            self.slide = stream.at(self.t)[:, 0]
        volts = recording.accelerometer
        self._volts = None if volts is None else slowed(
            volts, clear_band(*_evenly(volts.t, volts.values)) if clear else MOST)
        self.beyond = np.zeros((len(self.t), 6))

    def _low_pass(self, t: Array, rows: Array) -> LowPass:
        """Return the filter for poses, which are to be derived, so that their noise grows."""
        even, rate = _evenly(t, rows)
        return clear_of(even, rate, t[0], KEPT) if self._clear else LowPass(
            max(MOST, clear_band(even, rate, EXACT)))

    def _turn(self, pose: PoseStream) -> None:
        R, t = self.R_base_sensor, self.t
        turns = rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]) * RATE
        low_pass = self._low_pass(pose.t, pose.R_base_sensor.reshape(-1, 9))
        if self._clear:
            self.R_base_sensor = low_pass.of(t, R.reshape(-1, 9), RATE).reshape(-1, 3, 3)
        self.omega = low_pass.of(t, np.concatenate([turns[:1], turns]), RATE)
        self.alpha = _rate_of(self.omega)
        W = skew(self.omega)
        self.lever = skew(self.alpha) + W @ W

    def _travel(self, pose: PoseStream, position: Array) -> None:
        self._placed = pose.has_position
        self.position = self.velocity = self.acceleration = np.zeros((len(self.t), 3))
        if self._placed:
            self.position = position
            low_pass = self._low_pass(pose.t, pose.position)
            self.velocity = low_pass.of(self.t, _rate_of(self.position), RATE)
            if self._clear:
                self.position = low_pass.of(self.t, self.position, RATE)
            self.acceleration = _rate_of(self.velocity)

    @property
    def accelerated(self) -> bool:
        """Whether an accelerometer measures how it moves."""
        return self._volts is not None

    def wire(self, rig: Rig) -> Array:
        """Return the wrench of its sensor, with all of a rig's effects, shape (n, 6)."""
        rigid_tool = physical_rig(rig)
        wrench = self._wrench(rigid_tool, self.specific_force(rig))
        out = np.asarray(wrench * rigid_tool.wrench_sensor.gain + rigid_tool.wrench_sensor.bias
                         + self.beyond)
        effects = tuple(one for one in rigid_tool.effects if one[0] not in UNSEEN)
        return self._through(rigid_tool, effects, out) if effects else out

    def signals(self, rig: Rig, wrench: Array, volts: Array) -> Signals:
        """Return what sensors report along its motion, in free space."""
        n = len(self.t)
        return Signals(self.start, wrench, volts, self.slide, self.position, self.R_base_sensor,
                       self.velocity, self.acceleration, self.omega, self.alpha, np.zeros(n),
                       np.zeros((n, 6)), self.specific_force(rig))

    def weight(self, rigid_tool: Rig) -> Array:
        """Return the specific force of rest in S, shape (n, 3)."""
        g = rigid_tool.gravity
        return self._weight.of(g, lambda: np.asarray(-np.array(g) @ self.R_base_sensor))

    def specific_force(self, rig: Rig) -> Array:
        """Return the specific force at the centre of mass, in S, shape (n, 3)."""
        rigid_tool = physical_rig(rig)
        com, named = np.array(rigid_tool.tool.com), named_effects(rig.effects)
        if self._volts is None:
            if not self._placed:
                return self.weight(rigid_tool)
            return np.asarray(self.weight(rigid_tool) + self._along + self.lever @ com
                              + self.acceleration_error(rig, com))
        behind = getattr(rig, 'accel_behind', 0.0) + named.get('accel_delay', {}).get('delay', 0.0)
        at = np.clip(self.t + behind, self._volts.x[0], self._volts.x[-1])
        f = specific_force_of(rigid_tool, self.accelerometer, self._volts(at))
        return np.asarray(f + self.lever @ (com - rigid_tool.accelerometer.position))

    def _pose_error(self, rig: Rig) -> Array | None:
        """Return what poses lack of S's acceleration in base, and of alpha, (n, 6)."""
        shake, delay, compliance = (getattr(rig, name, 0.0) for name in POSE_ERRORS)
        if not (shake or delay or compliance):
            return None
        delayed = _delay(self._fast, delay) if delay else self._fast
        return (1.0 + shake) * delayed - self._fast + compliance * self._deflecting

    def acceleration_error(self, rig: Rig, point: Array) -> Array:
        """Return what poses lack of the acceleration of a point of S, in S, (n, 3)."""
        more = self._pose_error(rig)
        return np.zeros(3) if more is None else np.asarray(np.einsum(
            'nij,ni->nj', self.R_base_sensor, more[:, :3]) + np.cross(more[:, 3:], point))

    def specific_force_of_origin(self, rig: Rig) -> Array:
        """Return the specific force in the origin of S, shape (n, 3)."""
        tool: Tool = replace(rig.tool, com=(0.0, 0.0, 0.0))
        return self.specific_force(replace(rig, tool=tool, effects=()))

    def recorded_wrench(self, recording: Recording, band: float = MOST) -> Array:
        """Return a recorded wrench at the same instants, up to a frequency [Hz], shape (n, 6)."""
        return _wrench_at(self.t, recording, band)

    def _wrench(self, rigid_tool: Rig, f: Array) -> Array:
        """Return the wrench of the tool's weight, inertia and cable in S, shape (n, 6)."""
        tool = rigid_tool.tool
        inertia = np.array(tool.inertia)
        arm = np.array(tool.com) + self.slide[:, np.newaxis] * [1.0, 0.0, 0.0]
        more = self._pose_error(rigid_tool)
        alpha = self.alpha if more is None else self.alpha + more[:, 3:]
        spin = alpha @ inertia + np.cross(self.omega, self.omega @ inertia)
        out = np.hstack([-tool.mass * f, -tool.mass * np.cross(arm, f) - spin])
        cable = named_effects(rigid_tool.effects).get(CABLE)
        if cable:
            point = np.array([cable[f'point_{x}'] for x in 'xyz'])
            place = self.position + self.R_base_sensor @ point
            pull = np.array([cable[x] for x in 'xyz']) - cable['stiffness'] * (place - place[0])
            own = np.einsum('nij,ni->nj', self.R_base_sensor, pull)
            out += np.hstack([own, np.cross(point, own)])
        return out

    def _through(self, rigid_tool: Rig, effects: Chosen, wire: Array) -> Array:
        """Let the wrench sensor's effects act; noise of the inputs is no reversal of a load."""
        lag = replace(rigid_tool, effects=only(effects, HYSTERESIS))
        if lag.effects:
            steady = slow(wire, RATE, SMOOTH)
            wire = wire + WrenchEffects(lag, 1.0 / RATE).before_noise(steady) - steady
        others = tuple(one for one in effects if one not in lag.effects)
        on_wrench = WrenchEffects(replace(rigid_tool, effects=others), 1.0 / RATE)
        return np.asarray(on_wrench.after_noise(on_wrench.before_noise(wire)))


def beyond(recording: Recording, signals: Signals) -> Array:
    """Return what a recorded wrench has beyond a simulated, in block means, (blocks, 6)."""
    n_blocks = len(signals.wrench) // round(BLOCK * RATE)
    return block_means(wrench_of_blocks(recording, signals.start, n_blocks) - signals.wrench)


def wrench_of_blocks(recording: Recording, start: float, n_blocks: int, band: float = MOST
                     ) -> Array:
    """Return a recorded wrench up to a frequency [Hz], at the instants of blocks, (n, 6)."""
    count = 1.0 + np.arange(n_blocks * round(BLOCK * RATE), dtype=np.float64)
    return _wrench_at(start + count / RATE, recording, band)


def _wrench_at(t: Array, recording: Recording, band: float = MOST) -> Array:
    assert recording.wrench is not None
    spline = slowed(recording.wrench, band)
    return np.asarray(spline(np.clip(t, spline.x[0], spline.x[-1])))


def only(effects: Chosen, names: frozenset[str]) -> Chosen:
    """Keep some effects."""
    return tuple(one for one in effects if one[0] in names)


def _evenly(t: Array, rows: Array) -> tuple[Array, float]:
    """Return rows at regular instants, and their rate [Hz]."""
    rate = (len(t) - 1) / (t[-1] - t[0])
    return Stream(t, rows).at(t[0] + np.arange(len(t)) / rate), rate


def _delay(rows: Array, seconds: float) -> Array:
    t = np.arange(len(rows)) / RATE
    return np.stack([np.interp(t - seconds, t, row) for row in rows.T], axis=1)


def _rate_of(rows: Array) -> Array:
    return np.asarray(np.gradient(rows, 1.0 / RATE, axis=0))
