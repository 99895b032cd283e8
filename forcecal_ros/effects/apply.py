"""Effects applied to a rig: its numbers, and signals that lack the effects."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.effects.library import chosen_effects, Effect, named_effects, SLIDE_ONLY, Values
from forcecal_ros.effects.rig import Optidrive, Rig, Tool, Wall
from forcecal_ros.effects.signals import AccelerometerEffects, WrenchEffects
import numpy as np

Named = Mapping[str, float]


def _tool_mass(rig: Rig, v: Named) -> Rig:
    tool: Tool = replace(rig.tool, mass=rig.tool.mass * (1.0 + v['change']))
    return replace(rig, tool=tool)


def _tool_com(rig: Rig, v: Named) -> Rig:
    x, y, z = rig.tool.com
    return replace(rig, tool=replace(rig.tool, com=(x + v['x'], y + v['y'], z + v['z'])))


def _optidrive(name: str) -> Callable[[Rig, Named], Rig]:
    def change(rig: Rig, v: Named) -> Rig:
        if rig.optidrive is None:
            return rig
        optidrive: Optidrive = replace(
            rig.optidrive, **{name: getattr(rig.optidrive, name) * (1.0 + v['change'])})
        return replace(rig, optidrive=optidrive)
    return change


def _wall(name: str) -> Callable[[Rig, Named], Rig]:
    def change(rig: Rig, v: Named) -> Rig:
        wall: Wall = replace(rig.wall, **{name: getattr(rig.wall, name) * (1.0 + v['change'])})
        return replace(rig, wall=wall)
    return change


def _wall_position(rig: Rig, v: Named) -> Rig:
    return replace(rig, wall=replace(rig.wall, position=rig.wall.position + v['shift']))


def _base_tilt(rig: Rig, v: Named) -> Rig:
    """Gravity in a base that is tilted by a rotation vector about its X and Y."""
    R_level_base = rotation_from_vector(np.array([v['x'], v['y'], 0.0]))
    x, y, z = R_level_base.T @ rig.gravity
    return replace(rig, gravity=(x, y, z))


NUMBERS: Mapping[str, Callable[[Rig, Named], Rig]] = {
    'tool_mass': _tool_mass, 'tool_com': _tool_com,
    'tool_stiffness': _optidrive('stiffness'), 'tool_damping': _optidrive('damping'),
    'contact_stiffness': _wall('stiffness'), 'contact_damping': _wall('damping'),
    'wall_position': _wall_position, 'base_tilt': _base_tilt,
}
"""Name of the effect -> the rig with its numbers."""


def physical_rig(rig: Rig) -> Rig:
    """
    Apply the effects that change numbers of the rig.

    Returns
    -------
    Rig
        Without these effects, with the others.
    """
    others = tuple(one for one in rig.effects if one[0] not in NUMBERS)
    for name, values in named_effects(rig.effects).items():
        if name in NUMBERS:
            rig = NUMBERS[name](rig, values)
    return rig if others == rig.effects else replace(rig, effects=others)


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
    Add effects to a rig; one that it has already gets the new values.

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
