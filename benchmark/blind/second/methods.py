"""What simpler methods say of any case, of the rig or not, by the generator's own equations.

They are given more than they would have on a robot: the very equations that cases are made with,
linear about the nominal model. Noise is to them white, of its nominal level.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from blind.cases import LIBRARY
from blind.robot import Array
from blind.second.case import LIBRARY as WITH_EFFECT
from blind.second.ground import Departure
import numpy as np
from scipy.optimize import lsq_linear

BLOCK = 0.004
"""Of what is compared [s]."""
LOUD = 1.5
"""Root mean square over the noise from which a ranking by RMSE would speak of a gap."""
SURE = 3.0
"""Standard errors, or sigmas of a prior, from which an effect would be named."""
VISIBLE = 3.5
"""Sigma at which the library's ranges of sizes begin, as those of nuisances do."""
WAYS = {'cable_force': 3, 'wrench_gain': 6, 'wrench_crosstalk': 6, 'wrench_bias_drift': 3,
        'tool_com': 3, 'base_tilt': 3, 'accel_gain': 3, 'accel_bias': 3, 'accel_misalignment': 3,
        'joint_friction': 6, 'joint_gain': 6}
"""Columns of an effect that has directions or axes, drawn; others have one."""


class Column(NamedTuple):
    """One number of an effect: how it moves what is compared, its bounds and prior, in steps."""

    name: str
    moves: Array
    low: float
    high: float
    sigma: float


def compared(base: Any, change: Departure) -> Array:
    """Return a change as block means in units of the nominal noise, without means, in one row."""
    rows = []
    for topic, levels in base.nominal_levels.items():
        values = change[topic]
        each = max(1, round(BLOCK * len(values) / base.judged_seconds))
        whole = len(values) // each * each
        blocks = values[:whole].reshape(-1, each, values.shape[1]).mean(axis=1)
        # as many samples, as much weight
        rows.append(((blocks - blocks.mean(axis=0)) / levels * np.sqrt(each)).ravel())
    return np.concatenate(rows)


def columns(base: Any) -> list[Column]:
    """Return all numbers of the effects that a generator can make, in the library's own forms."""
    found = []
    known = base.knowing({})
    for name in base.effects:
        usual, largest = base.start(name)
        sigma = base.nuisance(name)[1] or _least(name, usual) / VISIBLE
        ways = WAYS.get(name, 1)
        both = bool(base.nuisance(name)[0]) or ways > 1
        for seed in range(ways):
            moves = compared(base, known.of_effect(name, usual, seed)) / usual
            found.append(Column(name, sigma * moves, -largest / sigma if both else 0.0,
                                largest / sigma, 1.0))
    return found


def _least(name: str, usual: float) -> float:
    return LIBRARY[name].low if name in LIBRARY else 0.1 * usual


def judge(base: Any, measured: Departure) -> dict[str, Any]:
    """
    Return what each method says.

    Parameters
    ----------
    base : generator
    measured : mapping of str to ndarray
        Measured less nominal, in the recording that judges.

    Returns
    -------
    dict
        ``rmse``: ``gap``; ``bic``: ``names``, best first, and their ``odds``; ``everything`` and
        ``bounded``: ``names``.
    """
    all_columns, r = columns(base), compared(base, measured)
    effects: dict[str, Array] = {}
    for name in dict.fromkeys(c.name for c in all_columns):
        effects[name] = np.stack([c.moves for c in all_columns if c.name == name], axis=1)
    bic = _bic(r, effects)
    return {'rmse': {'gap': bool(np.sqrt(np.mean(r**2)) > LOUD)}, 'bic': bic,
            'everything': {'names': _everything(r, all_columns)},
            'bounded': {'names': _bounded(r, all_columns)}}


def _bic(r: Array, effects: Mapping[str, Array]) -> dict[str, Any]:
    """Return effects that lower the BIC of white noise, and the probabilities that it gives."""
    n = len(r)
    score = {'': n * np.log(r @ r / n)}
    for name, J in effects.items():
        left = r - J @ np.linalg.lstsq(J, r, rcond=None)[0]
        score[name] = n * np.log(left @ left / n) + J.shape[1] * np.log(n)
    best = min(score.values())
    odds = {name: float(np.exp(-0.5 * (value - best))) for name, value in score.items()}
    total = sum(odds.values())
    return {'names': sorted((name for name in score if score[name] < score['']),
                            key=lambda name: score[name]),
            'odds': {name: round(one / total, 4) for name, one in odds.items()
                     if one / total > 1e-3}}


def _everything(r: Array, found: list[Column]) -> list[str]:
    """Return effects whose size in a fit of all of them is beyond its standard error."""
    J = np.stack([c.moves for c in found], axis=1)
    scale = np.linalg.norm(J, axis=0) + 1e-300
    U, s, Vt = np.linalg.svd(J / scale, full_matrices=False)
    kept = s > 1e-9 * s[0]
    x = Vt[kept].T @ ((U[:, kept].T @ r) / s[kept])
    left = r - (J / scale) @ x
    error = np.sqrt(left @ left / len(r) * np.sum((Vt[kept].T / s[kept])**2, axis=1))
    return _beyond(found, x / (error + 1e-300), np.maximum)


def _bounded(r: Array, found: list[Column]) -> list[str]:
    """Return effects by how many prior sigma a least-squares fit within bounds moves them."""
    J = np.stack([c.moves for c in found], axis=1)
    Q, R = np.linalg.qr(J)
    bounds = np.array([c.low for c in found]), np.array([c.high for c in found])
    return _beyond(found, lsq_linear(R, Q.T @ r, bounds).x, np.hypot)


def _beyond(found: list[Column], z: Array, both: Callable[[float, float], float]) -> list[str]:
    total: dict[str, float] = {}
    for column, one in zip(found, np.abs(z)):
        total[column.name] = float(both(total.get(column.name, 0.0), one))
    return sorted((name for name in total if total[name] > SURE), key=lambda name: -total[name])


def told(base: Any, label: Mapping[str, Any], measured: Departure) -> dict[str, float]:
    """
    Return what an oracle finds, who knows the effect and its form and fits its strength.

    Returns
    -------
    dict
        ``strength``, of which 1 is true, and its standard ``error`` beside noise and nuisances;
        a background is in what was measured and in no column. Empty without effect.
    """
    if label['kind'] != WITH_EFFECT:
        return {}
    effect = base.of_effect(label['effect'], label['size'], label['part_seed'])
    if label['onset'] is not None and len(base.moved) == 1:
        late = base.moved[0].t[:, None] >= label['onset']
        effect = {topic: np.where(late, values, 0.0) for topic, values in effect.items()}
    strength, error = base.ground.strength(measured, effect,
                                           base.nuisance(label['effect'])[0])
    return {'strength': strength, 'error': error}
