"""The library of effects: how a real rig may differ from the nominal one, as data.

A row lists an effect's parameters, their ranges and the values at which it does nothing. What it
does is in :mod:`forcecal_ros.effects.rig` and :mod:`forcecal_ros.effects.signals` and, if it
enters the integration, in :mod:`forcecal_ros.sim.rig.tool`. Which effects a rig has, and how
strongly, is a tuple that compares and hashes, in the order of the library.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.schema import instead, Row


class Quantity(NamedTuple):
    """
    One parameter of an effect, in SI units.

    Attributes
    ----------
    nominal : float
        With every parameter at its nominal value the effect does nothing. A parameter that only
        shapes the effect (a frequency, say) does nothing by itself at any value.
    low, high : float
        Limits.
    typical : float
        A clearly visible value; |typical - nominal| is a natural unit for it.
    starts : tuple of float
        Where to begin a search: several values where one may miss, the usual value where the
        parameter only shapes the effect.
    shapes : bool
        It only shapes the effect.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    typical: float
    starts: tuple[float, ...] = ()
    shapes: bool = False


class Effect(NamedTuple):
    """
    One way in which a rig differs from the nominal one.

    Attributes
    ----------
    stage : str
        ``robot``, ``tool``, ``environment``, ``wrench_sensor``, ``accelerometer`` or ``timing``.
    parameters : tuple of Quantity
        Where ``nuisance`` is given: its parameters one by one, in its units.
    excited_by : tuple of str
        Phases of a recording that show it.
    smooth : bool
        False: its output has kinks in the parameters, which requires finite steps and several
        starts.
    where : str
        ``rig``: it changes the physics; ``signal``: it acts on a sampled signal; ``stamps``: on
        time stamps and arrival.
    nuisance : str or None
        Key of the rig's spreads (nominal tolerances) that it exceeds.
    begins_anew : bool
        It grows from the first sample of each recording, and begins at no other instant.
    """

    name: str
    stage: str
    parameters: tuple[Quantity, ...]
    excited_by: tuple[str, ...]
    smooth: bool
    where: str
    nuisance: str | None = None
    begins_anew: bool = False


# phases of a recording that excite an effect
ALWAYS = ('measure', 'move', 'step', 'sweep', 'reverse', 'approach', 'contact', 'retract')
STATIC = ('measure', 'contact')
MOVING = ('move', 'step', 'sweep', 'reverse', 'retract')
FAST = ('step', 'sweep', 'contact')
TOUCHING = ('contact',)
SLIDING = ('step', 'sweep', 'reverse', 'contact')

FORCES, AXES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz'), ('x', 'y', 'z')
STREAMS = ('wrench', 'accelerometer', 'optidrive', 'pose')


def _each(names: tuple[str, ...], unit: str, size: float, typical: float, *,
          prefix: str = '') -> tuple[Quantity, ...]:
    """Make parameters of one kind, nominal at 0 within symmetric limits."""
    return tuple(Quantity(prefix + name, unit, 0.0, -size, size, typical) for name in names)


def _change(size: float = 0.9, typical: float = 0.1) -> tuple[Quantity, ...]:
    return (Quantity('change', '1', 0.0, -size, 9.0, typical),)


def _delay() -> tuple[Quantity, ...]:
    return (Quantity('delay', 's', 0.0, 0.0, 0.05, 0.004),)


def _shape(name: str, unit: str, usual: float, low: float, high: float, unit_size: float,
           starts: tuple[float, ...] = ()) -> Quantity:
    """Make a parameter that only shapes its effect, with its usual value."""
    return Quantity(name, unit, usual, low, high, usual + unit_size, starts or (usual,), True)


def _point(x: float, y: float, z: float) -> tuple[Quantity, ...]:
    return tuple(_shape(f'point_{axis}', 'm', at, -1.0, 1.0, 0.05)
                 for axis, at in zip(AXES, (x, y, z)))


EFFECTS: Mapping[str, Effect] = MappingProxyType({effect.name: effect for effect in (
    Effect('wrench_delay', 'wrench_sensor', _delay(), FAST, True, 'signal'),
    Effect('wrench_lowpass', 'wrench_sensor', (
        Quantity('time_constant', 's', 0.0, 0.0, 0.2, 0.004),
        # 1 / (1 + T s + c T^2 s^2): c = 0 first order, 1/2 Butterworth
        _shape('second_order', '1', 0.0, 0.0, 2.0, 0.25, (0.0, 0.5)),
    ), FAST, True, 'signal'),
    Effect('wrench_bias_drift', 'wrench_sensor', (
        *_each(FORCES[:3], 'N/s', 10.0, 0.05), *_each(FORCES[3:], 'N m/s', 1.0, 0.005),
        # 0: a ramp; else it levels off at rate / settling
        _shape('settling', '1/s', 0.0, 0.0, 5.0, 0.02, (0.0, 0.05)),
    ), STATIC, True, 'signal', begins_anew=True),
    Effect('wrench_gain', 'wrench_sensor', _each(FORCES, '1', 0.9, 0.05), ALWAYS, True,
           'signal', 'wrench_gain'),
    # fx_of_fz: the part of fz that is added to fx
    Effect('wrench_crosstalk', 'wrench_sensor', (
        *(Quantity(f'{to}_of_{source}', '1', 0.0, -0.9, 0.9, 0.03)
          for group in (FORCES[:3], FORCES[3:]) for to in group for source in group
          if to != source),
        *(Quantity(f'{to}_of_{source}', 'm', 0.0, -0.5, 0.5, 0.003)
          for to in FORCES[3:] for source in FORCES[:3])), ALWAYS, True, 'signal'),
    Effect('wrench_hysteresis', 'wrench_sensor', (
        # lags by the height once a force has gone on for the width, or turned for twice that;
        # runs ahead where it is negative; the torques' width is the forces' times the lever
        Quantity('height', 'N', 0.0, -20.0, 20.0, 1.0, (1.0,)),
        Quantity('torque_height', 'N m', 0.0, -2.0, 2.0, 0.05, (0.05,)),
        _shape('width', 'N', 2.0, 0.01, 200.0, 1.0, (0.5, 2.0, 10.0, 40.0)),
        _shape('lever', 'm', 0.05, 1e-3, 1.0, 0.02),
        # 0: elasto-plastic; 1: as Bouc and Wen have it with the exponent 1
        _shape('softness', '1', 0.0, 0.0, 1.0, 0.25, (0.0, 1.0)),
    ), ('reverse', 'sweep', 'contact', 'measure'), False, 'signal'),
    Effect('wrench_saturation', 'wrench_sensor', (
        Quantity('limit', 'N', 1e4, 1.0, 1e4, 120.0),
        Quantity('torque_limit', 'N m', 1e3, 0.1, 1e3, 5.0),
        # of one axis alone
        *(Quantity(name, 'N', 1e4, 0.1, 1e4, 60.0) for name in FORCES[:3]),
        *(Quantity(name, 'N m', 1e3, 0.01, 1e3, 5.0) for name in FORCES[3:]),
    ), ALWAYS, False, 'signal'),
    Effect('wrench_quantisation', 'wrench_sensor', (
        Quantity('step', 'N', 0.0, 0.0, 20.0, 1.0),
        Quantity('torque_step', 'N m', 0.0, 0.0, 2.0, 0.1),
    ), ALWAYS, False, 'signal'),
    Effect('accel_delay', 'accelerometer', _delay(), FAST, True, 'signal'),
    Effect('accel_gain', 'accelerometer', _each(AXES, '1', 0.9, 0.05), ALWAYS, True, 'signal',
           'accelerometer_gain'),
    Effect('accel_bias', 'accelerometer', _each(AXES, 'V', 5.0, 0.1), STATIC, True, 'signal',
           'accelerometer_offset'),
    # the rotation vector that turns the axes of S into the accelerometer's
    Effect('accel_misalignment', 'accelerometer', _each(AXES, 'rad', 0.5, 0.03), ALWAYS, True,
           'signal'),
    Effect('accel_highpass', 'accelerometer', (
        Quantity('rate', '1/s', 0.0, 0.0, 20.0, 0.1, (0.03, 0.3)),
        # how long it had been switched on at rest
        _shape('before', 's', 1e3, 0.0, 1e4, -1e2, (0.0, 1e3)),
    ), ('measure', 'move'), False, 'signal'),
    Effect('accel_saturation', 'accelerometer', (
        Quantity('limit', 'm/s^2', 1e3, 0.1, 1e3, 9.0),
        *(Quantity(axis, 'm/s^2', 1e3, 0.1, 1e3, 9.0) for axis in AXES),  # of one axis alone
    ), FAST, False, 'signal'),
    Effect('accel_resonance', 'accelerometer', (
        # 1: the sensor on a spring; between 0 and 1: part of the way
        Quantity('amplitude', '1', 0.0, -2.0, 2.0, 1.0),
        _shape('frequency', 'Hz', 40.0, 3.0, 400.0, 5.0, (15.0, 30.0, 60.0, 120.0)),
        _shape('damping', '1', 0.1, 0.005, 2.0, 0.05),
    ), FAST, True, 'signal'),
    # change: relative, of the rig's number
    Effect('tool_mass', 'tool', _change(0.5, 0.05), ALWAYS, True, 'rig', 'mass'),
    Effect('tool_com', 'tool', _each(AXES, 'm', 0.2, 0.005), ALWAYS, True, 'rig', 'com'),
    Effect('tool_stiffness', 'tool', _change(), SLIDING, True, 'rig', 'stiffness'),
    Effect('tool_damping', 'tool', _change(0.99, 0.3), SLIDING, True, 'rig', 'damping'),
    Effect('tool_stiffening', 'tool', (
        Quantity('cubic', 'N/m^3', 0.0, -2e6, 1e9, 1e7),
    ), SLIDING, True, 'rig'),
    Effect('tool_friction', 'tool', (
        # -force tanh(speed / velocity_scale); with presliding it holds at rest, too: -force z /
        # presliding, z following the displacement within +-presliding
        Quantity('force', 'N', 0.0, 0.0, 30.0, 3.0, (0.3, 3.0)),
        _shape('velocity_scale', 'm/s', 0.002, 1e-4, 0.1, 1e-3, (5e-4, 2e-3, 1e-2)),
        _shape('presliding', 'm', 0.0, 0.0, 1e-3, 5e-5, (0.0, 5e-5)),
    ), SLIDING, False, 'rig'),
    Effect('tool_backlash', 'tool', (
        # in all, half of it either way
        Quantity('gap', 'm', 0.0, 0.0, 0.01, 0.0005, (0.0003, 0.001)),
    ), SLIDING, False, 'rig'),
    Effect('cable_force', 'tool', (
        # a force fixed in base, and a spring to where the point is at home
        *_each(AXES, 'N', 100.0, 3.0),
        Quantity('stiffness', 'N/m', 0.0, -200.0, 1000.0, 20.0),
        *_point(0.05, 0.0, 0.18),
    ), ('measure', 'move', 'sweep'), True, 'rig'),
    Effect('spindle_vibration', 'tool', (
        # in ft_sensor; the phase counts from the start
        *_each(AXES, 'N', 200.0, 2.0, prefix='sine_'),
        *_each(AXES, 'N', 200.0, 2.0, prefix='cosine_'),
        _shape('frequency', 'Hz', 30.0, 0.5, 450.0, 0.1, (10.0, 30.0, 50.0, 100.0)),
        *_point(0.20, 0.0, 0.10),
    ), ALWAYS, True, 'rig'),
    Effect('robot_delay', 'robot', _delay(), MOVING, True, 'rig'),
    Effect('robot_resonance', 'robot', (
        # 1: the robot's position passes through the mode; less: a part of it
        Quantity('gain', '1', 0.0, -2.0, 2.0, 0.2),
        _shape('frequency', 'Hz', 12.0, 1.0, 100.0, 1.0, (6.0, 12.0, 25.0)),
        _shape('damping', '1', 0.05, 0.005, 1.0, 0.03),
        # how much of the damping acts against the world, not against the moving robot
        _shape('grounded', '1', 1.0, 0.0, 1.0, -0.5, (0.0, 1.0)),
    ), FAST, True, 'rig'),
    # the rotation vector, about X and Y of base, by which base is tilted
    Effect('base_tilt', 'robot', _each(AXES[:2], 'rad', 0.5, 0.01), STATIC, True, 'rig'),
    Effect('contact_stiffness', 'environment', _change(typical=0.3), TOUCHING, True, 'rig',
           'wall_stiffness'),
    Effect('contact_damping', 'environment', _change(0.99, 1.0), TOUCHING, True, 'rig',
           'wall_damping'),
    Effect('wall_position', 'environment', (
        Quantity('shift', 'm', 0.0, -0.2, 0.2, 0.001),), TOUCHING, True, 'rig',
        'wall_position'),
    # by how much the stamps of each stream run fast
    Effect('clock_skew', 'timing', _each(STREAMS, '1', 0.05, 1e-3), MOVING, True, 'stamps'),
    # the fraction of each stream's samples that never arrives
    Effect('dropouts', 'timing', tuple(
        Quantity(name, '1', 0.0, 0.0, 0.95, 0.02) for name in STREAMS), ALWAYS, False,
        'stamps'),
)})
"""Every effect by its name."""

SLIDE_ONLY = frozenset({
    'tool_stiffness', 'tool_damping', 'tool_stiffening', 'tool_friction', 'tool_backlash'})
"""Effects of the Optidrive: a rigid tool has none of them."""


Chosen = tuple[tuple[str, tuple[float, ...]], ...]
"""Name of an effect and the values of its parameters, for each effect that a rig has."""

Values = Mapping[str, Mapping[str, float]]
"""Effect -> parameter -> value."""


def chosen_effects(effects: Values | Chosen | None) -> Chosen:
    """
    Check the effects of a rig.

    Parameters
    ----------
    effects : mapping of str to mapping of str to float, Chosen or None
        Parameters that are not named stay at their nominal value.

    Raises
    ------
    ConfigError
        No such effect or parameter; no finite number; outside the limits.
    """
    if isinstance(effects, tuple):
        effects = named_effects(effects)
    if not isinstance(effects, Mapping | None):
        raise ConfigError(f'effects: expected effect names with parameters, got {effects!r}; '
                          'write for example effects: {wrench_delay: {delay: 0.004}}')
    for name in effects or ():
        if name not in EFFECTS:
            raise ConfigError(f'effects: unknown effect {name}; {instead(name, EFFECTS)}')
    return tuple((name, _values(effect, effects[name]))
                 for name, effect in EFFECTS.items() if effects and name in effects)


def named_effects(chosen: Chosen) -> dict[str, dict[str, float]]:
    """Name the parameters of the effects of a rig."""
    return {name: dict(zip((q.name for q in EFFECTS[name].parameters), values))
            for name, values in chosen}


def _values(effect: Effect, given: Any) -> tuple[float, ...]:
    where = f'effects.{effect.name}'
    if not isinstance(given, Mapping):
        raise ConfigError(f'{where}: expected {_listed(effect)}, got {given!r}; write them by '
                          'name')
    unknown = [str(key) for key in given if key not in {q.name for q in effect.parameters}]
    if unknown:
        raise ConfigError(f'{where}: unknown key {", ".join(unknown)}; expected only '
                          f'{_listed(effect)}')
    return tuple(Row('', q.unit, q.low, q.high).take(
        float, given.get(q.name, q.nominal), f'{where}.{q.name}') for q in effect.parameters)


def _listed(effect: Effect) -> str:
    return ', '.join(f'{q.name} [{q.unit}]' for q in effect.parameters)
