"""Who knows the effect of a case and its form, and fits its strength."""

from collections.abc import Mapping
from typing import Any

from blind.second.case import LIBRARY
from blind.second.on_rig import departure, OnRig
from blind.second.rules import half
from blind.sensors import Recorded


def told(label: Mapping[str, Any], judged: Recorded) -> dict[str, float]:
    """
    Return ``strength``, of which 1 is true, and its standard ``error``.

    Parameters
    ----------
    label : dict
    judged : Recorded
        The second recording. Its background is in it and in no column.
    """
    if label['kind'] != LIBRARY:
        return {}
    base = OnRig(label['seed'], half(label['half'])[1])
    effect = base.of_effect(label['effect'], label['size'], label['part_seed'])
    strength, error = base.ground.strength(departure(judged, base.clean), effect,
                                           base.nuisance(label['effect'])[0])
    return {'strength': strength, 'error': error}
