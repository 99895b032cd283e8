"""Which effects a rig has, and how strongly: checked, hashable, in the order of the library."""

from collections.abc import Mapping
from typing import Any

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.schema import instead, Row
from forcecal_ros.effects.library import Effect, EFFECTS

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
        raise ConfigError(f'effects: expected names of effects, each with its parameters, got '
                          f'{effects!r}; as in effects: {{wrench_delay: {{delay: 0.004}}}}')
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
        raise ConfigError(f'{where}: expected {_listed(effect)}, got {given!r}; write '
                          'each with its name')
    unknown = [str(key) for key in given if key not in {q.name for q in effect.parameters}]
    if unknown:
        raise ConfigError(f'{where}: unknown key {", ".join(unknown)}; expected only '
                          f'{_listed(effect)}')
    return tuple(Row('', q.unit, q.low, q.high).take(
        float, given.get(q.name, q.nominal), f'{where}.{q.name}') for q in effect.parameters)


def _listed(effect: Effect) -> str:
    return ', '.join(f'{q.name} [{q.unit}]' for q in effect.parameters)
