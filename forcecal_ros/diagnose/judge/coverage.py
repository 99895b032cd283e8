"""What recordings could show: how much moves, which samples count, which effects would be seen."""

from collections.abc import Sequence

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.noise.autoregression import FEWEST
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.dataset import STREAM_SLICES
from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.recordings import STAGES_OF_STREAM
import numpy as np

VISIBLE_ENERGY = 25.0
"""Whitened energy from which an effect of typical size shows: five standard errors."""


def signal_to_noise(model: LinearisedModel) -> float:
    """
    Say how much the motion moves the signal that it moves most.

    Returns
    -------
    float
        RMS about the mean over the rig's noise, of wrench and specific force.
    """
    most = 0.0
    for dataset in model.datasets:
        nominal = dataset.nominal
        for name, signal in (('wrench', nominal.wrench), ('accelerometer', nominal.volts)):
            if name in dataset.measured.streams:
                noise = 2.0 * model.level[STREAM_SLICES[name]]
                most = max(most, float((signal.std(axis=0) / noise).max()))
    return most


def not_excited(model: LinearisedModel, found: list[Hypothesis]) -> list[str]:
    """List the effects of the library that these recordings could not show at a typical size."""
    m = len(model.nuisances)
    extra = [[c for h in found for a in h.atoms[:1] for c in a.columns[i]]
             for i in range(len(model.datasets))]
    energy = np.diag(model.gram(extra).matrix)
    visible, position = set(), m
    for h in found:
        if h.releases:
            index = [i for i, n in enumerate(model.nuisances) if n.name in h.releases[0]]
            best = 9.0 * max(energy[i] for i in index)
        else:
            k = len(h.atoms[0].free)
            best, position = max(energy[position:position + k]), position + k
        if best > VISIBLE_ENERGY:
            visible.add(h.name)
    return [h.name for h in found if h.name not in visible]


def shares(model: LinearisedModel, given: Sequence[Recording]) -> dict[str, float]:
    """
    Say which part of each stream's samples counts.

    Parameters
    ----------
    given : sequence of Recording
        As recorded.

    Returns
    -------
    dict of str to float
        0 where a stream has too few samples for its noise to be known.
    """
    out = {}
    for name in STREAM_SLICES:
        total = used = 0
        for dataset, noise, recording in zip(model.datasets, model.noise, given):
            stream = getattr(recording, name)
            total += len(stream) if stream is not None else 0
            if name in dataset.measured.streams and noise.sigma[:, STREAM_SLICES[name]].any():
                used += len(dataset.measured.times(name))
        if total:
            out[name] = used / total
    return out


def refuse_unjudged(model: LinearisedModel) -> None:
    """
    Refuse recordings of which neither wrench nor accelerometer can be judged.

    Raises
    ------
    DataError
        With how many samples there are, and are needed.
    """
    counts = _unknown_noise(model)
    if all(name in counts for name in STAGES_OF_STREAM):
        listed = ', '.join(f'{name} {counts[name]}' for name in STAGES_OF_STREAM if counts[name])
        raise DataError(f'too few samples during the commands to estimate the noise ({listed}; '
                        f'{FEWEST} evenly spaced ones are needed); record longer')


def not_compared(model: LinearisedModel) -> str:
    """
    State which stages lack their stream, and which streams are too slow or short to be judged.

    Returns
    -------
    str
        To be put behind a sentence; empty where each was compared.
    """
    missing = [f'{stages} (no {name} to compare)' for name, stages in STAGES_OF_STREAM.items()
               if not getattr(model.datasets[0].recording, name)]
    missing += [f'{name} ({count} samples, {FEWEST} evenly spaced ones are needed)'
                for name, count in _unknown_noise(model).items() if count]
    return f'; not compared: {", ".join(missing)}' if missing else ''


def _unknown_noise(model: LinearisedModel) -> dict[str, int]:
    """Count the blocks, in the longest recording, of the streams whose noise is not known."""
    return {name: max(int(np.sum(c.measured.present[:, rows.start])) for c in model.datasets)
            for name, rows in STREAM_SLICES.items()
            if not any(n.sigma[:, rows].any() for n in model.noise)}
