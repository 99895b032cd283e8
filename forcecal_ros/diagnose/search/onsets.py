"""Effects that begin or end during a recording: which, and at which instant."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.model.gates import Gate
from forcecal_ros.diagnose.model.hypotheses import (
    Atom,
    bounds_of,
    Hypothesis,
    nominal_of,
)
from forcecal_ros.diagnose.model.jacobian import Column, column
from forcecal_ros.diagnose.model.linearised import Diverged, LinearisedModel
from forcecal_ros.diagnose.search.fitted import Accepted
from forcecal_ros.diagnose.search.instants import Instants, interval
from forcecal_ros.diagnose.search.joint_fit import JointFit
from forcecal_ros.sim.signals import BLOCK
import numpy as np
from numpy.typing import NDArray

INSTANTS = 600
"""Instants of one recording at which beginnings are looked for, at most: 0.1 s in a minute."""

SHORTEST = 25
"""Blocks between two of them, at least: 0.1 s, the error that is allowed of an instant."""

NEAR = 10
"""Blocks about the likeliest instants in which each sample's stamp is tried."""

MANY = 50
"""Blocks among which an instant may lie from which its samples are not told apart."""

TEMPERATURE = 2.0
"""Of log-likelihoods of instants, as of hypotheses: noise and form are not quite as modelled."""


class Onset(NamedTuple):
    """
    An effect that begins or ends.

    Attributes
    ----------
    theta : ndarray, shape (p,)
        Its parameters, to begin a fit with.
    evidence : float
        Log-evidence against all as it is, over all instants alike.
    """

    name: str
    gate: Gate
    theta: Array
    free: NDArray[np.intp]
    evidence: float

    def accepted(self) -> Accepted:
        """Return it as an effect to fit."""
        return Accepted(self.name, self.theta, np.zeros(len(self.theta)),
                        self.free, frozenset())


class Instant(NamedTuple):
    """An instant, and between which it lies with 95 % [s]."""

    at: float
    low: float
    high: float


def likeliest_onsets(now: JointFit, found: Sequence[Hypothesis]) -> list[Onset]:
    """
    Find the likeliest instant of each hypothesis, as linear as its columns are.

    Parameters
    ----------
    now : JointFit
        What is explained already.
    found : sequence of Hypothesis
        Of :func:`~forcecal_ros.diagnose.model.hypotheses.everywhere`.

    Returns
    -------
    list of Onset
        The likeliest first.
    """
    model, explained = now.model, now.explained()
    distinct = {id(c): j for j, c in enumerate(
        {id(c): c for h in found for a in h.atoms for c in a.columns[0]}.values())}
    places = {(id(h), i): [distinct[id(c)] for c in a.columns[0]]
              for h in found for i, a in enumerate(h.atoms)}
    several: list[list[Column]] = [[{} for _ in distinct] for _ in model.datasets]
    for h in found:
        for i, a in enumerate(h.atoms):
            for j, columns in enumerate(zip(*a.columns)):
                for k, one in enumerate(columns):
                    several[k][places[id(h), i][j]] = one
    beside = [[*own, *more] for own, more in zip(model.jacobian, explained.extra)]
    best: dict[str, Onset] = {}
    for recording, one in enumerate(model.datasets):
        length = max(SHORTEST, -(-len(one.groups) // INSTANTS))
        if len(one.groups) < 4 * length:
            continue
        instants = Instants(model, beside, explained.null_prior, several, model.residuals,
                            recording, length)
        for h in found:
            for onset in _of_one(model, instants, h, [places[id(h), i] for i in range(
                    len(h.atoms))], recording):
                if h.name not in best or onset.evidence > best[h.name].evidence:
                    best[h.name] = onset
    return sorted(best.values(), key=lambda o: -o.evidence)


def _of_one(model: LinearisedModel, instants: Instants, h: Hypothesis,
            places: Sequence[Sequence[int]], recording: int) -> list[Onset]:
    """List a hypothesis' onsets in one recording, one for each start and way."""
    several, out = len(model.datasets) > 1, []
    start = model.datasets[recording].measured.start
    for atom, of in zip(h.atoms, places):
        for ends, elsewhere in product((False, True), (False, True) if several else (False,)):
            evidence, x = instants.fits(of, ends, elsewhere)
            theta = _theta(h, atom, x)
            evidence = np.where(_possible(h, atom, theta), evidence, -np.inf)
            b = int(np.argmax(evidence))
            if not np.isfinite(evidence[b]):
                continue
            at = start + BLOCK * float(instants.blocks[b])
            gate = (Gate(recording, None, at, elsewhere) if ends
                    else Gate(recording, at, None, elsewhere))
            mean = float(np.logaddexp.reduce(evidence)
                         - np.log(len(evidence) * len(h.atoms) * 2))
            low, high = bounds_of(h.effect)
            out.append(Onset(h.name, gate, np.clip(theta[b], low, high), atom.free, mean))
    return out


def _theta(h: Hypothesis, atom: Atom, x: Array) -> Array:
    """Return the parameters that coefficients stand for, shape (instants, p)."""
    nominal = nominal_of(h.effect)
    out = np.repeat(atom.start[np.newaxis], len(x), axis=0)
    out[:, atom.free] = nominal[atom.free] + x * (atom.start - nominal)[atom.free]
    return out


def _possible(h: Hypothesis, atom: Atom, theta: Array) -> Array:
    """Say at which instants one number alone is within its limits; several are clipped."""
    if len(atom.free) > 1:
        return np.ones(len(theta), dtype=bool)
    low, high = bounds_of(h.effect)
    return np.asarray(((theta >= low - 1e-12) & (theta <= high + 1e-12)).all(axis=1))


def instant_of(now: JointFit, name: str) -> Instant:
    """
    Find the instant at which an accepted effect begins or ends, to a sample where that shows.

    Parameters
    ----------
    now : JointFit
        With the effect, beginning or ending near there.
    """
    model, gate = now.model, now.model.gates[name]
    added = [column(model.added(name, model.effects, i), model.level)
             for i in range(len(model.datasets))]
    rows = [gate.rows(one.measured, i) for i, one in enumerate(model.datasets)]
    residuals = [r + a * _dense(c, len(r)) for r, a, c in zip(model.residuals, rows, added)]
    predicted = model.whitened_discrepancy().predicted(model.residuals)
    residuals = [r - p for r, p in zip(residuals, predicted)]
    explained = now._replace(jacobians=[j for j in now.jacobians if j.name != name]).explained()
    beside = [[*own, *more] for own, more in zip(model.jacobian, explained.extra)]
    i, one = gate.recording, model.datasets[gate.recording].measured
    coarse = Instants(model, beside, explained.null_prior, [[c] for c in added], residuals, i, 1)
    evidence = coarse.fits([0], gate.begin is None, gate.elsewhere).evidence
    t = one.start + BLOCK * coarse.blocks
    low, at, high = interval(evidence, TEMPERATURE)
    closer = None if high - low > MANY else _to_a_sample(
        model, gate, added[i], residuals[i], t[low], t[high])
    return closer or Instant(float(t[at]), float(t[low]), float(t[high]))


def _dense(one: Column, n: int) -> Array:
    out = np.zeros((n, len(CHANNELS)))
    for c, rows in one.items():
        out[:, c] = rows.values()
    return out


def _to_a_sample(model: LinearisedModel, gate: Gate, added: Column, residual: Array, low: float,
                 high: float) -> Instant | None:
    """Try the stamp of each sample between two instants; nothing where there is none."""
    measured, noise = model.datasets[gate.recording].measured, model.noise[gate.recording]
    signals = {c: one.values() for c, one in added.items()}
    most = max(signals, key=lambda c: float(np.ptp(signals[c]) / model.level[c]))
    stream = CHANNELS[most].stream
    t = measured.times(stream)
    near = np.flatnonzero((t > low - BLOCK * NEAR) & (t < high + BLOCK * NEAR))
    near = near[near > 0]
    if not len(near):
        return None
    acts = np.stack([measured.since(stream, s) for s in t[near]])
    if gate.begin is None:
        acts = 1.0 - acts
    slices = STREAM_SLICES[stream]
    product_, square = np.zeros(len(near)), np.full(len(near), 1e-12)
    for c in (c for c in signals if slices.start <= c < slices.stop):
        white = noise.whiten(np.concatenate([residual[np.newaxis, :, c], acts * signals[c]]), c)
        product_ += white[1:] @ white[0]
        square += np.sum(white[1:] ** 2, axis=1)
    # its size is known from all of the recording: only where it begins or ends is asked
    first, best, last = interval(product_ - 0.5 * square, TEMPERATURE)
    before, at = t[near - 1], t[near]
    return Instant(float(0.5 * (before[best] + at[best])), float(before[first]), float(at[last]))


def moved(model: LinearisedModel, name: str, instant: Instant) -> LinearisedModel:
    """Let an effect begin or end at another instant."""
    gate = model.gates[name]
    gate = (gate._replace(end=instant.at) if gate.begin is None
            else gate._replace(begin=instant.at))
    out = replace(model, gates={**model.gates, name: gate})
    try:
        out.evaluate()
    except Diverged:
        return model
    return out
