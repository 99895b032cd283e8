"""Effects on sampled signals, added to recordings that lack them."""

from dataclasses import replace

from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.effects import AccelerometerEffects, WrenchEffects
from forcecal_ros.effects.rig import Rig
import numpy as np


def apply_signal_effects(recording: Recording, rig: Rig) -> Recording:
    """
    Apply a rig's effects on sampled signals to signals that lack them.

    Parameters
    ----------
    recording : Recording
        Simulated or measured, sampled without gaps.
    rig : Rig
        With effects; the accelerometer is the mounted one.

    Returns
    -------
    Recording
        What :func:`~forcecal_ros.sim.rig.simulator.simulate` gives for this rig, where the
        recording is that of the rig without these effects and without noise.
    """
    wrench, volts = recording.wrench, recording.accelerometer
    if wrench is not None and len(wrench) > 1:
        recording = replace(recording, wrench=_changed(wrench, WrenchEffects(
            rig, 1.0 / wrench.rate)))
    if volts is not None and len(volts) > 1:
        model = rig.accelerometer.model()
        gain, offset = ((np.ones(3), np.zeros(3)) if recording.accelerometer_unit == 'V'
                        else (np.array(model.gain), np.array(model.offset)))
        volts = replace(volts, values=volts.values * gain + offset)
        volts = _changed(volts, AccelerometerEffects(rig, None, 1.0 / volts.rate))
        volts = replace(volts, values=(volts.values - offset) / gain)
        recording = replace(recording, accelerometer=volts)
    return recording


def _changed(stream: Stream, effects: WrenchEffects | AccelerometerEffects) -> Stream:
    return replace(stream, values=effects.after_noise(effects.before_noise(stream.values)))
