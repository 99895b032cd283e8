"""A rigid tool behind the measured motion: what its sensors should say, noise-free."""

from dataclasses import replace

from forcecal_ros.diagnose.body import Body, UNKNOWN_DELAY
from forcecal_ros.diagnose.carried_tool import CABLE, CarriedTool, only, slow, SMOOTH
from forcecal_ros.diagnose.clear_band import MOST
from forcecal_ros.diagnose.nuisances import (
    LEAST,
    Nuisance,
    of_sensors,
    scaled,
    shifted,
    with_inertia,
)
from forcecal_ros.diagnose.simulation import RATE, Signals
from forcecal_ros.effects import AccelerometerEffects, EFFECTS, physical_rig
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import INVERTIBLE
from forcecal_ros.recording.streams import Recording
import numpy as np

EXACT = 0.2
"""
RMS in that of the noise, up to which a motion is known: a filtered acceleration lacks its edges.

Simulated rigid tools had 0.05 to 0.11 left in one channel or other.
"""

SHOWN = frozenset({
    'wrench_delay', 'wrench_lowpass', 'wrench_bias_drift', 'wrench_gain', 'wrench_crosstalk',
    'wrench_hysteresis', 'wrench_saturation', 'accel_delay', *INVERTIBLE,
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
        With measured pose; the accelerometer in volts of the body's model.
    start : float
        When block 0 begins [s].
    n_blocks : int
    accelerometer : str
        ``acc1`` or ``acc2``.
    body : Body
        The nominal one.
    """

    band, exact, starts_white, library = MOST, EXACT, True, EFFECTS

    def __init__(self, recording: Recording, start: float, n_blocks: int, accelerometer: str,
                 body: Body) -> None:
        self.start, self.n_blocks, self.accelerometer = start, n_blocks, accelerometer
        given = recording, start, n_blocks, accelerometer
        self._full, self._clear = CarriedTool(*given), CarriedTool(*given, clear=True)
        self._unclear = self._full.wire(body) - self._clear.wire(body)

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
        if self._clear.accelerated:
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
        body, full = physical_rig(rig), self._full
        wire = self._clear.wire(rig) + self._unclear
        model = body.accelerometer.model(self.accelerometer)
        on_volts = AccelerometerEffects(
            replace(body, effects=only(body.effects, INVERTIBLE)), self.accelerometer, 1.0 / RATE)
        volts = on_volts.before_noise(full.weight(body) * model.gain + model.offset)
        n = len(full.t)
        return Signals(self.start, wire, volts, full.slide, full.position, full.R_base_sensor,
                       full.velocity, full.acceleration, full.omega, full.alpha, np.zeros(n),
                       np.zeros((n, 6)), full.specific_force(rig))

    def smooth(self, signals: Signals) -> Signals:
        """Return signals without the noise of pose and accelerometer, which is in them all."""
        start, *parts = signals[:-1]  # no joints
        smooth = [slow(part.reshape(len(part), -1), RATE, SMOOTH).reshape(part.shape)
                  for part in parts]
        return Signals(start, *smooth)


def _behind(rig: Rig, x: float) -> Rig:
    assert isinstance(rig, Body)
    return replace(rig, accel_behind=rig.accel_behind + x)
