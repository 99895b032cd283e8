"""Where a channel seems to stop although the simulation goes on."""

from forcecal_ros.diagnose.inputs.channels import CHANNELS, COLUMNS
from forcecal_ros.diagnose.model.linearised import Problem
from forcecal_ros.effects import EFFECTS
from forcecal_ros.geometry import Array
import numpy as np

CLIPPING = {'wrench_saturation': tuple(c.name for c in CHANNELS if c.stream == 'wrench'),
            'accel_saturation': tuple(c.name for c in CHANNELS if c.stream == 'accelerometer')}
"""Effects that the data show without a model and that a model has to follow: their channels."""

LEVELS = 40
"""Limits that are tried, between the largest magnitude and half of it."""

LEAST = 30.0
"""Squares that a limit has to remove, in those of the noise, to be worth a try."""


def limit_starts(problem: Problem, effect: str) -> dict[str, float]:
    """
    Find limits at which a saturation may act, one for each of its channels that shows any.

    Parameters
    ----------
    problem : Problem
        Recalibrated.
    effect : str
        One of CLIPPING.

    Returns
    -------
    dict of str to float
        Parameter of the effect -> limit.
    """
    names = [q.name for q in EFFECTS[effect].parameters][-len(CLIPPING[effect]):]
    stream = 'wrench' if effect == 'wrench_saturation' else 'accelerometer'
    first, found = COLUMNS[stream].start, {}
    if any(stream not in case.measured.streams for case in problem.cases):
        return {}
    pairs = [_physical(problem, i, stream) for i in range(len(problem.cases))]
    for k, name in enumerate(names):
        simulated = np.concatenate([s[:, k] for s, _ in pairs])
        measured = np.concatenate([m[:, k] for _, m in pairs])
        limit, removed = _best_limit(simulated, measured)
        scale = problem.level[first + k] * 2.0
        if stream == 'accelerometer':
            scale /= abs(_model_gain(problem)[k])
        if removed > LEAST * scale ** 2 and CHANNELS[first + k].name in CLIPPING[effect]:
            found[name] = limit
    return found


def _model_gain(problem: Problem) -> Array:
    case = problem.cases[0]
    return np.array(problem.rig.accelerometer.model(case.simulation.accelerometer).gain)


def _physical(problem: Problem, i: int, stream: str) -> tuple[Array, Array]:
    """Give simulated and measured samples, the accelerometer's as specific force."""
    case, base = problem.cases[i], problem.base[i]
    rest, measured = case.measured.samples(stream, base), case.measured.values(stream)
    if stream == 'accelerometer':
        model = problem.current().accelerometer.model(case.simulation.accelerometer)
        measured, rest = (measured - model.offset) / model.gain, rest / model.gain
    return measured - rest, measured


def _best_limit(simulated: Array, measured: Array) -> tuple[float, float]:
    """Return the limit that removes most squares, and how many."""
    size = np.abs(simulated)
    high = np.flatnonzero(size > 0.5 * size.max())
    s, m = simulated[high], measured[high]
    before = (m - s) ** 2
    limits = size.max() * np.linspace(0.5, 1.0, LEVELS, endpoint=False)
    removed = [float(np.sum(before - (m - np.clip(s, -x, x)) ** 2)) for x in limits]
    best = int(np.argmax(removed))
    return float(limits[best]), removed[best]
