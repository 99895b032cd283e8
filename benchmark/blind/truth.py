"""What there is to be found in a case: how much, in which channel, in which phase."""

from typing import Any, NamedTuple

from blind.cases import Case, Part, Runner
from blind.noise import Colour, SIGMA
from blind.robot import Array
from blind.sensors import Recorded
import numpy as np

AXES = ('x', 'y', 'z')
TOPICS = {
    'wrench': tuple(f'force.{a}' for a in AXES) + tuple(f'torque.{a}' for a in AXES),
    'volts': tuple(f'accel.{a}' for a in AXES), 'slide': ('optidrive',),
    'position': tuple(f'pose.{a}' for a in AXES)}
PRIORS = {'wrench': (np.array([0.3, 0.3, 0.3, 0.02, 0.02, 0.02]), 0.002),
          'volts': (np.full(3, 0.010), 0.002)}
"""Nuisances of a sensor: 1 sigma of its offset, and of its gain."""


class Excess(NamedTuple):
    """
    What effects add beyond a sensor's own nuisances, whitened by the noise as it truly is.

    Attributes
    ----------
    energy : float
        Sum of squares; for lost messages their number.
    cells : dict
        Channel -> phase -> root mean square.
    """

    energy: float
    cells: dict[str, dict[str, float]]


def excess(changed: Recorded, reference: Recorded, colours: dict[str, list[Colour]]) -> Excess:
    """Compare a recording with one of the same motion without the effects, both noise-free."""
    energy, cells = 0.0, {}
    for topic, names in TOPICS.items():
        stamp = 'pose_t' if topic == 'position' else f'{topic}_t'
        t, seen = getattr(reference, stamp), getattr(changed, stamp)
        was, now = (np.reshape(getattr(one, topic), (len(getattr(one, stamp)), -1))
                    for one in (reference, changed))
        energy += abs(len(t) - len(seen))
        if len(t) != len(seen) or not np.array_equal(t, seen):
            now = np.stack([np.interp(t, seen, column) for column in now.T], axis=1)
        for j, name in enumerate(names):
            sigma = SIGMA[topic][j]
            left = _beyond(now[:, j] - was[:, j], was[:, j], colours[topic][j], sigma,
                           PRIORS.get(topic), j)
            energy += float(left @ left)
            cells[name] = _by_phase(t, left, reference.phases)
    return Excess(energy, cells)


def _beyond(delta: Array, signal: Array, colour: Colour, sigma: float, prior: Any, j: int
            ) -> Array:
    """Whiten, and take out what offset and gain explain within their priors."""
    white = colour.whiten(delta, sigma)
    if prior is None or not delta.any():
        return white
    offset, gain = prior
    columns = np.stack([np.full(len(signal), offset[j]), gain * (signal - signal.mean())], axis=1)
    J = colour.whiten(columns, sigma)
    # the square root of the marginal energy, spread over the samples as the residual is
    normal = np.eye(2) + J.T @ J
    fitted = np.linalg.solve(normal, J.T @ white)
    left: Array = white - J @ fitted
    penalty = float(fitted @ fitted)
    energy = float(left @ left)
    return left * np.sqrt((energy + penalty) / energy) if energy else left


def _by_phase(t: Array, left: Array, phases: Any) -> dict[str, float]:
    sums: dict[str, list[float]] = {}
    for name, start, end in phases:
        part = left[(t >= start) & (t < end)]
        total = sums.setdefault(name, [0.0, 0.0])
        total[0] += float(part @ part)
        total[1] += len(part)
    return {name: float(np.sqrt(square / max(count, 1))) for name, (square, count)
            in sums.items()}


def describe(case: Case, runner: Runner) -> dict[str, Any]:
    """
    Return the label of a case as a document.

    Keys: ``kind``, ``accelerometer``, ``parts`` (name, size, seed, stage, random, and the
    ``energy`` that each adds to what is there without it, held out), ``energy`` and ``cells`` of
    all parts together, held out, and ``energy_fit`` in the recording to fit on.
    """
    whole = runner.recordings(noise=False)
    none = runner.recordings((), noise=False)
    fit, held = (excess(a, b, case.colours) for a, b in zip(whole, none))
    parts = []
    for part in case.parts:
        alone = held
        if len(case.parts) > 1:
            others = tuple(one for one in case.parts if one is not part)
            alone = excess(whole[1], runner.recording(1, others, noise=False), case.colours)
        parts.append({**_plain(part), 'energy': alone.energy})
    return {'kind': case.kind, 'accelerometer': case.accelerometer, 'parts': parts,
            'energy': held.energy, 'energy_fit': fit.energy, 'cells': held.cells}


def _plain(part: Part) -> dict[str, Any]:
    effect = part.effect
    where = np.log(part.size / effect.low) / np.log(effect.high / effect.low)
    return {'name': part.name, 'size': part.size, 'unit': effect.unit, 'seed': part.seed,
            'share': float(where), 'stage': effect.stage, 'random': effect.random}
