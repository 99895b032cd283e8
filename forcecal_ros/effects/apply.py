"""Effects applied to a rig, and to signals that lack them."""

from dataclasses import replace

from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.effects.chosen import chosen_effects, named_effects, Values
from forcecal_ros.effects.library import Effect, SLIDE_ONLY
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import AccelerometerEffects, WrenchEffects
import numpy as np


def applicable(effect: Effect, rig: Rig, accelerometer: str | None = None) -> bool:
    """
    Say whether a rig can have an effect at all.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; either can have all effects of accelerometers.

    Returns
    -------
    bool
        False for effects of a slide where the tool is rigid.
    """
    return rig.optidrive is not None or effect.name not in SLIDE_ONLY


def with_effects(rig: Rig, effects: Values) -> Rig:
    """
    Give a rig some effects besides those it has; one that it has already gets the new values.

    Parameters
    ----------
    effects : mapping of str to mapping of str to float
        Parameters that are not named stay at their nominal value.

    Raises
    ------
    ConfigError
        No such effect or parameter, a value outside its limits, an effect that this rig cannot
        have.
    """
    together = {**named_effects(rig.effects), **named_effects(chosen_effects(effects))}
    return replace(rig, effects=chosen_effects(together))


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
        What :func:`~forcecal_ros.sim.rig.offline.simulate` gives for this rig, where the
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
