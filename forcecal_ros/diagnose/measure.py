"""How strong the noise is, how sure the parameters are, and how far the gap shrinks."""

from collections.abc import Sequence

from forcecal_ros.diagnose import remainder
from forcecal_ros.diagnose.bench import Bench
from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.gap import Arms, contact_error, Errors, Gap, gap
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.diagnose.remainder import Cell
from forcecal_ros.diagnose.tangent import Tangent
from forcecal_ros.geometry import Array
import numpy as np


def sample_noise(p: Problem, explained: Array, left: Sequence[Array] = ()) -> Array:
    """
    RMS of the noise of one sample of every channel: of what is neither explained nor predicted.

    Parameters
    ----------
    p : Problem
        As far as is explained.
    explained : ndarray, shape (channels,)
        Mean square of what else is no noise, such as what wrong parameters leave.
    left : sequence of ndarray, shape (n, channels)
        What else is predicted, in each recording.

    Returns
    -------
    ndarray, shape (channels,)
        0 where there is no channel.
    """
    total, weight, within = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS)), []
    for i, case in enumerate(p.cases):
        rest = p.blocks[i] - (left[i] if left else 0.0)
        rows = case.held[:, np.newaxis] & case.measured.present
        total += np.sum(np.where(rows, rest, 0.0) ** 2, axis=0)
        weight += rows.sum(axis=0)
        if case.held.any():
            within.append(case.measured.scatter(p.base[i]))
    mean = np.maximum(total / np.maximum(weight, 1.0) - explained, 0.0)
    return np.asarray(np.sqrt(np.where(weight > 0.0, mean + np.mean(within, axis=0), 0.0)))


def parameter_errors(p: Problem, tangents: Sequence[Tangent]) -> Errors:
    """
    Say what wrong parameters leave on held-out blocks.

    Parameters
    ----------
    p : Problem
        At the joint fit.
    tangents : sequence of Tangent
        Of its effects.

    Returns
    -------
    Errors
    """
    bench = Bench(p, tangents)
    k = len(bench.null.x)
    grams, n = np.zeros((len(CHANNELS), k, k)), 0
    for i, case in enumerate(p.cases):
        columns = [*p.columns[i], *bench.extra[i]]
        n += int(case.held.sum())
        for c in range(len(CHANNELS)):
            there = [j for j in range(k) if c in columns[j]]
            if there and case.held.any():
                rows = np.stack([columns[j][c][case.held] for j in there]).astype(float)
                grams[c][np.ix_(there, there)] += rows @ rows.T
    return Errors(grams / max(1, n), bench.null.covariance)


def unpredictable(p: Problem, cells: list[Cell], left: Sequence[Array]) -> Array:
    """
    Mean square of what is left, is no noise, and is not predicted from the motion.

    Parameters
    ----------
    p : Problem
    cells : list of Cell
        Of its remainder.
    left : sequence of ndarray, shape (n, channels)
        What of it is predicted, in each recording.

    Returns
    -------
    ndarray, shape (channels,)
        0 where a channel has no strong cell, or a predicted part that stands for it.
    """
    energy = np.zeros(len(CHANNELS))
    for c in {x.channel for x in cells if x.z > remainder.STRONG}:
        if not any(x[:, c].any() for x in left):
            held = [b[case.held, c] for b, case in zip(p.blocks, p.cases)]
            level = np.mean([n.rms(0)[c] ** 2 for n in p.noise])
            energy[c] = max(0.0, float(np.mean(np.concatenate(held) ** 2) - level))
    return energy


def measured_gap(p: Problem, final: Problem, residuals: tuple[list[Array], ...], noise: Array,
                 energy: Array, errors: Errors) -> Gap:
    """
    Measure the gap in its three arms, the error of the contact force with it.

    Parameters
    ----------
    p, final : Problem
        Recalibrated; with the effects.
    residuals : tuple of three lists of ndarray, shape (n, channels)
        Of each recording: measured less nominal, measured less recalibrated, and what of the
        final remainder is predictable.
    noise : ndarray, shape (channels,)
        RMS of one sample.
    energy : ndarray, shape (channels,)
        Mean square of what else is left and is no noise.
    errors : Errors

    Returns
    -------
    Gap
    """
    arms, contact = [], []
    for i, (nominal, before, left) in enumerate(zip(*residuals)):
        case = p.cases[i]
        arms.append(Arms(before, nominal - before, before - final.blocks[i], left))
        contact.append([case.measured.of_wrench(s.contact) for s in (
            case.nominal, p.base[i], final.base[i])])
    out = gap(p.cases, arms, noise, energy, errors)
    forces = [out.channels.get(c.name) for c in CHANNELS[:3]]
    # one whose rest is all explained has no noise left, and counts as met
    remaining = np.array([0.0 if one is None else one[2] ** 2 for one in forces]
                         if any(forces) else [])
    return out._replace(contact_force=contact_error(p.cases, arms, contact, remaining))
