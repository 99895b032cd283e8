"""Where a channel seems to stop although the simulation goes on."""

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.model.linearised import LinearisedModel
import numpy as np

CLIPPING = {'wrench_saturation': tuple(c.name for c in CHANNELS if c.stream == 'wrench'),
            'accel_saturation': tuple(c.name for c in CHANNELS if c.stream == 'accelerometer')}
"""Effects that the data show without a model and that a model has to follow: their channels."""

LEVELS = 40
"""Limits that are tried, between the largest magnitude and half of it."""

LEAST = 30.0
"""Squares that a limit has to remove, in those of the noise, to be worth a try."""


def limit_starts(model: LinearisedModel, effect: str) -> dict[str, float]:
    """
    Find limits at which a saturation may act, one for each of its channels that shows any.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated.
    effect : str
        One of CLIPPING.

    Returns
    -------
    dict of str to float
        Parameter of the effect -> limit, within the range that the library leaves it.
    """
    quantities = model.library[effect].parameters[-len(CLIPPING[effect]):]
    stream = 'wrench' if effect == 'wrench_saturation' else 'accelerometer'
    first, found = STREAM_SLICES[stream].start, {}
    if any(stream not in dataset.measured.streams for dataset in model.datasets):
        return {}
    pairs = [_physical(model, i, stream) for i in range(len(model.datasets))]
    for k, q in enumerate(quantities):
        simulated = np.concatenate([s[:, k] for s, _ in pairs])
        measured = np.concatenate([m[:, k] for _, m in pairs])
        limit, removed = _best_limit(simulated, measured, q.low, q.high)
        scale = model.level[first + k] * 2.0
        if stream == 'accelerometer':
            scale /= abs(_model_gain(model)[k])
        if removed > LEAST * scale ** 2 and CHANNELS[first + k].name in CLIPPING[effect]:
            found[q.name] = limit
    return found


def _model_gain(model: LinearisedModel) -> Array:
    dataset = model.datasets[0]
    return np.array(model.rig.accelerometer.model(dataset.simulation.accelerometer).gain)


def _physical(model: LinearisedModel, i: int, stream: str) -> tuple[Array, Array]:
    """Give simulated and measured samples, the accelerometer's as specific force."""
    dataset, base = model.datasets[i], model.signals(i)
    rest, measured = dataset.measured.samples(stream, base), dataset.measured.values(stream)
    if stream == 'accelerometer':
        sensor = model.current().accelerometer.model(dataset.simulation.accelerometer)
        measured, rest = (measured - sensor.offset) / sensor.gain, rest / sensor.gain
    return measured - rest, measured


def _best_limit(simulated: Array, measured: Array, low: float, high: float
                ) -> tuple[float, float]:
    """Return the limit in a range that removes most squares, and how many; 0 where none is."""
    size = np.abs(simulated)
    near = np.flatnonzero(size > 0.5 * size.max())
    s, m = simulated[near], measured[near]
    before = (m - s) ** 2
    limits = size.max() * np.linspace(0.5, 1.0, LEVELS, endpoint=False)
    limits = limits[(limits >= low) & (limits <= high)]
    if not len(limits):
        return 0.0, 0.0
    removed = [float(np.sum(before - (m - np.clip(s, -x, x)) ** 2)) for x in limits]
    best = int(np.argmax(removed))
    return float(limits[best]), removed[best]
