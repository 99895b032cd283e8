"""Which effects a rig has, and how strongly: checked, hashable, in the order of the library."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
import math
from typing import Any

from forcecal_ros.effects.library import Effect, EFFECTS, Quantity
from forcecal_ros.errors import ConfigError
import numpy as np

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
            raise ConfigError(f'effects: unknown effect {name}; {_instead(name, EFFECTS)}')
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
                          f'{_listed(effect)}: remove or rename it')
    return tuple(_value(f'{where}.{q.name}', given.get(q.name, q.nominal), q)
                 for q in effect.parameters)


def _value(where: str, value: Any, q: Quantity) -> float:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(f'{where}: expected a finite number [{q.unit}], got {value!r}; '
                          'write it so, without the unit')
    if not q.low <= value <= q.high:
        raise ConfigError(f'{where}: must be from {q.low:g} to {q.high:g} [{q.unit}], '
                          f'got {value!r}')
    return float(value)


def _listed(effect: Effect) -> str:
    return ', '.join(f'{q.name} [{q.unit}]' for q in effect.parameters)


def _instead(name: Any, known: Iterable[str]) -> str:
    close = get_close_matches(str(name), known, n=3)
    return (f'did you mean {" or ".join(close)}?' if close
            else f'expected one of {", ".join(known)}')
