"""How well a sequence would show each effect of the library, and what it could not tell apart."""

from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import scaled
from forcecal_ros.core.streams import Phase, PoseStream
from forcecal_ros.diagnose.inputs.dataset import prepare, split
from forcecal_ros.diagnose.model.hypotheses import hypotheses, Hypothesis
from forcecal_ros.diagnose.model.linearised import linearised_model, LinearisedModel
from forcecal_ros.effects import applicable, EFFECTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.simulator import simulate
from forcecal_ros.sim.signals import UNSEEN
import numpy as np
from numpy.typing import NDArray

VISIBLE = 25.0
"""Whitened energy from which a plan shows an effect."""

CLEAR = 80.0
"""Whitened energy from which a plan shows an effect clearly."""

CONFOUNDED = 20.0
"""Angle below which the directions of two effects are confounded: hard to tell apart [deg]."""


class Shown(NamedTuple):
    """
    How well one effect shows.

    Attributes
    ----------
    size : str
        Of the parameter that shows best: what the energy is stated at.
    energy : float
        Whitened, nuisances taken out as far as their tolerances allow; NaN where stamps or values
        show it without a model.
    weakest : str
        Parameter of it that shows worst.
    excited_by : tuple of str
        Phases.
    """

    name: str
    size: str
    energy: float
    weakest: str
    weakest_energy: float
    excited_by: tuple[str, ...]

    @property
    def word(self) -> str:
        """How well, in a word."""
        if np.isnan(self.energy):
            return 'by its stamps or values'
        return ('clearly' if self.energy >= CLEAR else
                'just so' if self.energy >= VISIBLE else 'not')


class Alias(NamedTuple):
    """Two effects that come close to each other, and the angle between them."""

    one: str
    other: str
    angle_deg: float


class Excitation(NamedTuple):
    """
    What a sequence is good for.

    Attributes
    ----------
    shown : tuple of Shown
        Every effect that applies to the rig.
    aliases : tuple of Alias
        Closest first.
    """

    shown: tuple[Shown, ...]
    aliases: tuple[Alias, ...]


def excitation(rig: Rig, target: PoseStream, phases: tuple[Phase, ...]) -> Excitation:
    """
    Judge a sequence for a rig by simulating it.

    Parameters
    ----------
    target : PoseStream
        Commands.
    """
    recording = replace(simulate(rig, target, seed=0), phases=phases)
    p = linearised_model(rig, (split(prepare(recording, rig)),))
    found = hypotheses(p)
    information, parts = _information(p, found)
    shown = [_shown(h, information, parts[h.name]) for h in found]
    accelerometer = p.datasets[0].simulation.accelerometer
    there = {h.name for h in found}
    for name, effect in EFFECTS.items():
        if name not in there and applicable(effect, rig, accelerometer):
            energy = np.nan if name in UNSEEN or name.endswith('saturation') else 0.0
            shown.append(Shown(name, '', energy, '', energy, effect.excited_by))
    order = list(EFFECTS)
    return Excitation(tuple(sorted(shown, key=lambda s: order.index(s.name))),
                      _aliases(found, information, parts))


def _information(model: LinearisedModel, found: list[Hypothesis]) -> tuple[Array,
                                                                           dict[str,
                                                                                NDArray[np.intp]]]:
    """
    Return the information of all typical sizes, nuisances within nominal tolerances taken out.

    An effect that lifts a nuisance's prior has its own column beside the nuisance's.
    """
    m, index, extra = len(model.nuisances), {n.name: i for i, n in enumerate(model.nuisances)}, []
    parts: dict[str, NDArray[np.intp]] = {}
    scale: list[float] = []
    position = m
    for h in found:
        columns = ([model.jacobian[0][index[n]] for n in _released(model, h)] if h.releases
                   else list(h.atoms[0].columns[0]))
        scale += _typical(model, h) if h.releases else [1.0] * len(columns)
        extra += columns
        parts[h.name] = np.arange(position, position + len(columns))
        position += len(columns)
    train, held = model.grams([extra])
    matrix = train.matrix + held.matrix
    size = np.concatenate([np.ones(m), scale])
    matrix = matrix * np.outer(size, size)
    nuisance = np.arange(m)
    cross = matrix[:, nuisance]
    inner = matrix[np.ix_(nuisance, nuisance)] + np.eye(m)
    projected = matrix - cross @ np.linalg.solve(inner, cross.T)
    return np.asarray(projected), parts


def _released(model: LinearisedModel, h: Hypothesis) -> list[str]:
    return [n.name for n in model.nuisances if n.name in h.releases[0]]


def _typical(model: LinearisedModel, h: Hypothesis) -> list[float]:
    sizes = {n.name: float(s) for n, s in zip(model.nuisances, model.prior_std)}
    return [(q.typical - q.nominal) / sizes[name]
            for q, name in zip(h.effect.parameters, _released(model, h))]


def _shown(h: Hypothesis, information: Array, part: NDArray[np.intp]) -> Shown:
    energy = np.diag(information)[part]
    moved = range(len(part)) if h.releases else h.atoms[0].free
    quantities = [h.effect.parameters[i] for i in moved]
    best, worst = int(energy.argmax()), int(energy.argmin())
    q = quantities[best]
    size = q.typical if h.releases else float(h.atoms[0].start[moved[best]])
    shown, factor = scaled(size, q.unit)
    return Shown(h.name, f'{q.name} {factor * size:.3g} {shown}', float(energy[best]),
                 quantities[worst].name, float(energy[worst]), h.effect.excited_by)


def _aliases(found: list[Hypothesis], information: Array, parts: dict[str, NDArray[np.intp]]
             ) -> tuple[Alias, ...]:
    bases = {}
    for h in found:
        part = parts[h.name]
        seen = part[np.diag(information)[part] > VISIBLE]
        if len(seen):
            bases[h.name] = seen
    names, out = list(bases), []
    for i, one in enumerate(names):
        for other in names[i + 1:]:
            angle = _angle(information, bases[one], bases[other])
            if angle < CONFOUNDED:
                out.append(Alias(one, other, angle))
    return tuple(sorted(out, key=lambda a: a.angle_deg))


def _angle(information: Array, one: NDArray[np.intp], other: NDArray[np.intp]) -> float:
    """Smallest angle between what two effects can do [deg]."""
    cosines = np.linalg.svd(_whitened(information, one).T
                            @ information[np.ix_(one, other)]
                            @ _whitened(information, other), compute_uv=False)
    return float(np.degrees(np.arccos(np.clip(cosines.max(), 0.0, 1.0))))


def _whitened(information: Array, part: NDArray[np.intp]) -> Array:
    values, vectors = np.linalg.eigh(information[np.ix_(part, part)])
    kept = values > 1e-9 * values.max()
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))
