"""A rigid tool behind the measured motion: what its sensors should say, noise-free."""

from dataclasses import replace

from forcecal_ros.diagnose.body import Body, UNKNOWN_DELAY
from forcecal_ros.diagnose.channels import BLOCK
from forcecal_ros.diagnose.clear_band import clear_band, MOST
from forcecal_ros.diagnose.nuisances import (
    LEAST,
    Nuisance,
    of_sensors,
    scaled,
    shifted,
    with_inertia,
)
from forcecal_ros.diagnose.simulation import RATE, Signals, UNSEEN
from forcecal_ros.effects import AccelerometerEffects, named_effects, physical_rig, WrenchEffects
from forcecal_ros.effects.chosen import Chosen
from forcecal_ros.effects.rig import Rig, Tool
from forcecal_ros.effects.signals import INVERTIBLE, specific_force_of
from forcecal_ros.geometry import Array, rotation_vector, skew
from forcecal_ros.recording.streams import PoseStream, Recording, Stream
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation, RotationSpline

SLOW = MOST
"""Up to which any tool moves as a rigid body [Hz]: above, arm and gripper ring."""

ORDER = 4
"""Of the low-pass, there and back: a quarter of its corner passes to 1e-5, half of it to 0.4 %."""

SMOOTH = 3.0
"""Up to which a discrepancy follows the motion [Hz]: noise of the inputs is faster, mostly."""

EXACT = 0.2
"""
RMS in that of the noise, up to which a motion is known: a filtered acceleration lacks its edges.

Simulated rigid tools had 0.05 to 0.11 left in one channel or other.
"""

KEPT = 12
"""Delays at which the accelerometer's readings are remembered."""

CABLE = 'cable_force'
HYSTERESIS = frozenset({'wrench_hysteresis'})

SHOWN = frozenset({
    'wrench_delay', 'wrench_lowpass', 'wrench_bias_drift', 'wrench_gain', 'wrench_crosstalk',
    'wrench_hysteresis', 'wrench_saturation', 'accel_delay', *INVERTIBLE,
    'tool_mass', 'tool_com', 'base_tilt', CABLE})
"""Effects that a measured motion can show: none of what the robot makes of its commands."""


class MeasuredMotion:
    """
    One recorded motion, along which a tool is carried as often as needed.

    Accelerations are those of the accelerometer or, without one, of the measured position;
    without either, only weight is expected.

    Parameters
    ----------
    recording : Recording
        With measured pose; the accelerometer in volts of the body's model.
    start : float
        When block 0 begins [s].
    n_blocks : int
    accelerometer : str
        ``acc1`` or ``acc2``.
    """

    band, exact, starts_white = SLOW, EXACT, True

    def __init__(self, recording: Recording, start: float, n_blocks: int, accelerometer: str
                 ) -> None:
        self.start, self.n_blocks, self.accelerometer = start, n_blocks, accelerometer
        pose = recording.pose
        assert pose is not None
        count = 1.0 + np.arange(n_blocks * round(BLOCK * RATE))
        self._t: Array = np.asarray(start + count / RATE, dtype=np.float64)
        self._turn(pose)
        self._travel(pose)
        stream, self._slide = recording.optidrive, np.zeros(len(self._t))
        if stream is not None and len(stream) > 1:
            self._slide = stream.at(self._t)[:, 0]
        self._volts = slowed(recording.accelerometer)
        self._late: dict[float, Array] = {}

    def _turn(self, pose: PoseStream) -> None:
        spline = RotationSpline(pose.t, Rotation.from_matrix(np.array(pose.R_base_sensor)))
        self._R: Array = spline(np.clip(self._t, pose.t[0], pose.t[-1])).as_matrix()
        turns = rotation_vector(np.swapaxes(self._R[:-1], 1, 2) @ self._R[1:]) * RATE
        band = _band(pose, pose.R_base_sensor.reshape(-1, 9))
        self._omega = _slow(np.concatenate([turns[:1], turns]), RATE, band)
        self._alpha = _rate_of(self._omega)
        W = skew(self._omega)
        self._lever = skew(self._alpha) + W @ W

    def _travel(self, pose: PoseStream) -> None:
        n, self._placed = len(self._t), pose.has_position
        self._position = self._velocity = self._acceleration = np.zeros((n, 3))
        if self._placed:
            at = np.clip(self._t, pose.t[0], pose.t[-1])
            self._position = CubicSpline(pose.t, pose.position)(at)
            band = _band(pose, pose.position)
            self._velocity = _slow(_rate_of(self._position), RATE, band)
            self._acceleration = _rate_of(self._velocity)

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect can show: a delay that nobody knows is estimated along instead."""
        if effect == 'accel_delay' and isinstance(rig, Body):
            return rig.spreads.accel_behind < UNKNOWN_DELAY
        return effect in SHOWN

    def nuisances(self, rig: Rig, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
        """List what tool and sensors may differ in from what is known."""
        found = [Nuisance('tool.mass', 'mass', scaled('tool', 'mass'), least=LEAST),
                 *(Nuisance(f'tool.com.{a}', 'com', shifted('tool', 'com', i))
                   for i, a in enumerate('xyz'))]
        own = np.diag(rig.tool.inertia)
        found += [Nuisance(f'tool.inertia.{a}', 'own_inertia', with_inertia(i), least=-own[i])
                  for i, a in enumerate('xyz')]
        if self._volts is not None:
            found.append(Nuisance('accelerometer.delay', 'accel_behind', _behind))
        # what the accelerometer has of its own is in the motion, too, and so in the wrench
        found += [n._replace(where='rig') if n.where == 'volts' else n
                  for n in of_sensors(self.accelerometer, streams)]
        return tuple(n for n in found if getattr(rig.spreads, n.key) > 0.0)

    def signals(self, rig: Rig) -> Signals:
        """
        Carry a tool along.

        Parameters
        ----------
        rig : Rig
            A Body.

        Returns
        -------
        Signals
            The accelerometer's are those of rest.
        """
        body = physical_rig(rig)
        f = self._specific_force(rig, body)
        wire = self._wire(body, f)
        model = body.accelerometer.model(self.accelerometer)
        volts = self._weight(body) * model.gain + model.offset
        effects = tuple(one for one in body.effects if one[0] not in UNSEEN)
        if effects:
            wire = self._through(body, effects, wire)
            on_volts = AccelerometerEffects(
                replace(body, effects=_only(effects, INVERTIBLE)), self.accelerometer, 1.0 / RATE)
            volts = on_volts.before_noise(volts)
        n = len(self._t)
        return Signals(self.start, wire, volts, self._slide, self._position, self._R,
                       self._velocity, self._acceleration, self._omega, self._alpha, np.zeros(n),
                       np.zeros((n, 6)), f)

    def seen(self, recording: Recording) -> Array:
        """Return a recorded wrench at the instants of the signals, shape (n, 6)."""
        spline = slowed(recording.wrench)
        assert spline is not None
        return np.asarray(spline(np.clip(self._t, spline.x[0], spline.x[-1])))

    def about_origin(self, rig: Rig) -> tuple[Array, Array, Array, Array]:
        """
        Return how the origin of S moves.

        Returns
        -------
        specific_force : ndarray, shape (n, 3)
            In S [m/s^2].
        lever : ndarray, shape (n, 3, 3)
            Times a point's place in S, its acceleration beyond the origin's.
        omega, alpha : ndarray, shape (n, 3)
            In S [rad/s], [rad/s^2].
        """
        tool: Tool = replace(rig.tool, com=(0.0, 0.0, 0.0))
        still = replace(rig, tool=tool, effects=())
        return self._specific_force(still, still), self._lever, self._omega, self._alpha

    def smooth(self, signals: Signals) -> Signals:
        """Return signals without the noise of pose and accelerometer, which is in them all."""
        start, *parts = signals
        slow = [_slow(part.reshape(len(part), -1), RATE, SMOOTH).reshape(part.shape)
                for part in parts]
        return Signals(start, *slow)

    def _wire(self, body: Rig, f: Array) -> Array:
        """Return the wrench as on the wire, before its sensor's effects, shape (n, 6)."""
        return np.asarray(self._wrench(body, f) * body.wrench_sensor.gain
                          + body.wrench_sensor.bias)

    def _through(self, body: Rig, effects: Chosen, wire: Array) -> Array:
        """Let the wrench sensor's effects act; noise of the inputs is no reversal of a load."""
        lag = replace(body, effects=_only(effects, HYSTERESIS))
        if lag.effects:
            steady = _slow(wire, RATE, SMOOTH)
            wire = wire + WrenchEffects(lag, 1.0 / RATE).before_noise(steady) - steady
        others = tuple(one for one in effects if one not in lag.effects)
        on_wrench = WrenchEffects(replace(body, effects=others), 1.0 / RATE)
        return np.asarray(on_wrench.after_noise(on_wrench.before_noise(wire)))

    def _weight(self, body: Rig) -> Array:
        """Return the specific force of rest in S, shape (n, 3)."""
        return np.asarray(-np.array(body.gravity) @ self._R)

    def _specific_force(self, rig: Rig, body: Rig) -> Array:
        """Return the specific force at the centre of mass, in S, shape (n, 3)."""
        com, named = np.array(body.tool.com), named_effects(rig.effects)
        if self._volts is None:
            if not self._placed:
                return self._weight(body)
            along = np.einsum('nij,ni->nj', self._R, self._acceleration)
            return np.asarray(self._weight(body) + along + self._lever @ com)
        behind = getattr(rig, 'accel_behind', 0.0) + named.get('accel_delay', {}).get('delay', 0.0)
        f = specific_force_of(body, self.accelerometer, self._readings(behind))
        return np.asarray(f + self._lever @ (com - body.accelerometer.position))

    def _readings(self, behind: float) -> Array:
        if behind not in self._late:
            if len(self._late) >= KEPT:
                self._late.pop(next(iter(self._late)))
            assert self._volts is not None
            at = np.clip(self._t + behind, self._volts.x[0], self._volts.x[-1])
            self._late[behind] = self._volts(at)
        return self._late[behind]

    def _wrench(self, body: Rig, f: Array) -> Array:
        """Return the wrench of the tool's weight, inertia and cable in S, shape (n, 6)."""
        tool = body.tool
        inertia = np.array(tool.inertia)
        arm = np.array(tool.com) + self._slide[:, np.newaxis] * [1.0, 0.0, 0.0]
        spin = self._alpha @ inertia + np.cross(self._omega, self._omega @ inertia)
        out = np.hstack([-tool.mass * f, -tool.mass * np.cross(arm, f) - spin])
        cable = named_effects(body.effects).get(CABLE)
        if cable:
            point = np.array([cable[f'point_{x}'] for x in 'xyz'])
            place = self._position + self._R @ point
            pull = np.array([cable[x] for x in 'xyz']) - cable['stiffness'] * (place - place[0])
            own = np.einsum('nij,ni->nj', self._R, pull)
            out += np.hstack([own, np.cross(point, own)])
        return out


def _behind(rig: Rig, x: float) -> Rig:
    assert isinstance(rig, Body)
    return replace(rig, accel_behind=rig.accel_behind + x)


def _only(effects: Chosen, names: frozenset[str]) -> Chosen:
    return tuple(one for one in effects if one[0] in names)


def _rate_of(rows: Array) -> Array:
    return np.asarray(np.gradient(rows, 1.0 / RATE, axis=0))


def _slow(rows: Array, rate: float, band: float = SLOW) -> Array:
    """Leave out what is faster than a band; where samples are few, nothing is."""
    if rate <= 2.0 * band or len(rows) < rate:
        return rows
    return np.asarray(sosfiltfilt(
        butter(ORDER, band, fs=rate, output='sos'), rows, axis=0))


def _band(pose: PoseStream, rows: Array) -> float:
    """Return up to where a pose is clear of its noise [Hz]."""
    rate = (len(pose) - 1) / (pose.t[-1] - pose.t[0])
    t = pose.t[0] + np.arange(len(pose)) / rate
    return clear_band(np.stack([np.interp(t, pose.t, x) for x in rows.T], axis=1), rate)


def slowed(stream: Stream | None) -> CubicSpline | None:
    """Return a stream as a function of time, without what is faster than a rigid body."""
    return None if stream is None else CubicSpline(stream.t, _slow(stream.values, stream.rate))
