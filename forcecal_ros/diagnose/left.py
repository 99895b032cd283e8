"""What a rig as explained so far leaves of the recordings, and whether that is more than noise."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.diagnose import remainder, spectral_lines
from forcecal_ros.diagnose.bench import Bench
from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.columns import combined
from forcecal_ros.diagnose.discrepancy import NONE
from forcecal_ros.diagnose.evidence import fit
from forcecal_ros.diagnose.hypotheses import VIBRATION
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.diagnose.remainder import Ceiling, Cell
from forcecal_ros.diagnose.simulation import SMALL
from forcecal_ros.diagnose.spectral_lines import Line
from forcecal_ros.diagnose.tangent import Tangent
from forcecal_ros.diagnose.verdict import Remains
from forcecal_ros.geometry import Array
import numpy as np

WANDERING = 0.03
"""Of a vibration's frequency, within which its speed may wander."""

WITHOUT_NAME = 10.0
"""Log-evidence of a discrepancy from which something is left: odds of 20,000 to one."""

NOWHERE = Cell(0, 'no phase', remainder.BANDS[0], 0.0, 0.0)
"""Stands for the cells of recordings whose phases are too short for any."""


class Left(NamedTuple):
    """
    What a problem leaves.

    Attributes
    ----------
    ceiling : Ceiling
        Of the discrepancy, where there is one.
    strongest : list of Cell
        The strongest first.
    lines : tuple of Line
        Not those of a vibration that is explained.
    impulses : ndarray, shape (channels,)
        How many innovations of each channel noise does not make.
    notes : tuple of str
    unnamed : float
        Log-evidence of the discrepancy.
    """

    ceiling: Ceiling
    strongest: list[Cell]
    lines: tuple[Line, ...]
    impulses: Array
    notes: tuple[str, ...]
    unnamed: float = 0.0


def look(p: Problem, unnamed: float = 0.0) -> Left:
    """
    Look at what a problem leaves.

    Parameters
    ----------
    p : Problem
    unnamed : float
        Log-evidence of its discrepancy.

    Returns
    -------
    Left
    """
    found = None
    if p.allowed != NONE:
        found = discrepant(p)
        p = replace(p, blocks=[b - x for b, x in zip(p.blocks, found)])
    cells = [c for case, n, b in zip(p.cases, p.noise, p.blocks)
             for c in remainder.cells(case, n, b) if c.band[0] < case.simulation.band]
    lines, wanders = _foreign(lines_of(p), p)
    impulses = np.asarray(sum(remainder.impulses(n, b) for n, b in zip(p.noise, p.blocks)))
    strongest = sorted(cells, key=lambda c: -c.z) or [NOWHERE]
    if found is None:
        return Left(remainder.ceiling(p, p.base, p.blocks), strongest, lines, impulses, wanders)
    return Left(_as_ceiling(p, found, unnamed), strongest, lines, impulses, wanders, unnamed)


def discrepant(p: Problem) -> list[Array]:
    """
    Return the discrepancy that training blocks show.

    Parameters
    ----------
    p : Problem
        At a fit, its discrepancy not 0.

    Returns
    -------
    list of ndarray, shape (n, channels)
        In each recording.
    """
    weights = p.unexplained().trained(p.allowed)
    return p.beside().of_weights(weights, [b.shape for b in p.blocks])


def _as_ceiling(p: Problem, found: list[Array], unnamed: float) -> Ceiling:
    """Say of each channel that shows a discrepancy how significant all of it is."""
    size = np.zeros(len(CHANNELS))
    for one, noise, case in zip(found, p.noise, p.cases):
        for g in range(3):
            rows = case.groups == g
            if rows.any():
                rms = noise.rms(g)
                size = np.maximum(size, np.sqrt(np.mean(one[rows] ** 2, axis=0))
                                  / np.where(rms > 0.0, rms, np.inf))
    sigmas = float(np.sqrt(2.0 * max(0.0, unnamed)))
    seen = size > p.cases[0].simulation.exact
    return Ceiling(np.where(seen, sigmas, 0.0), size, tuple(found))


def fitted_to_all(p: Problem, tangents: Sequence[Tangent] = ()) -> Problem:
    """
    Take off what nuisances and effects explain when they are fitted to all blocks.

    What training blocks hardly show (an inertia, where they hold no turn about its axis) is known
    poorly from them, and shows on the others: that is no gap, but an error of the fit.

    Parameters
    ----------
    p : Problem
        At a fit to its training blocks.
    tangents : sequence of Tangent
        Of its effects.

    Returns
    -------
    Problem
        With the residuals, and their noise, of the fit to all; all else as it was.
    """
    bench = Bench(p, tangents)
    x = fit(bench.train + bench.held, bench.null_prior).x
    blocks = [b - combined([*columns, *extra], x, len(b)) * c.measured.present
              for b, columns, extra, c in zip(p.blocks, p.columns, bench.extra, p.cases)]
    out = replace(p, blocks=blocks)
    out.refit_noise(np.zeros(len(p.nuisances)))
    return out


def lines_of(p: Problem) -> tuple[Line, ...]:
    """
    Find spectral lines at the full rate in what remains.

    Parameters
    ----------
    p : Problem

    Returns
    -------
    tuple of Line
    """
    lines: list[Line] = []
    for case, signals in zip(p.cases, p.base):
        for name in ('wrench', 'accelerometer', 'optidrive'):
            if name in case.measured.streams:
                rows = case.measured.samples(name, signals)
                lines += spectral_lines.lines(rows, getattr(case.recording, name).rate, name)
    band = p.cases[0].simulation.band
    return tuple(line for line in lines if line.frequency < band)


def remains(left: Left) -> Remains:
    """
    Say what is strongest of what a problem leaves, in its threshold.

    Parameters
    ----------
    left : Left

    Returns
    -------
    Remains
    """
    ceiling, cell, impulses = left.ceiling, left.strongest[0], left.impulses
    z = np.where(ceiling.size > SMALL, ceiling.z, 0.0)
    c = int(z.argmax())
    several = int(impulses.max())
    line = max(left.lines, key=lambda one: one.power, default=None)
    options = [
        (left.unnamed / WITHOUT_NAME * (z[c] > 0.0), _discrepancy_in_words(left))
        if left.unnamed else
        (float(z[c]) / remainder.PREDICTABLE,
         f'{CHANNELS[c].name}, predictable from the motion ({z[c]:.1f} sigma)'),
        (cell.z / remainder.STRONG,
         (f'{CHANNELS[cell.channel].name} in {cell.phase}, {cell.band[0]:g} to '
          f'{cell.band[1]:g} Hz ({cell.z:.1f} sigma)')),
        (several / remainder.IMPULSES,
         f'{several} impulses in {CHANNELS[int(impulses.argmax())].name}')]
    if line is not None:
        options.append((line.power / spectral_lines.LINE,
                        f'a line at {line.frequency:.2f} Hz in {line.channel}'))
    return Remains(*max(options))


def _discrepancy_in_words(left: Left) -> str:
    """Say where a discrepancy is strongest beside the noise, and how large it is there."""
    c = int(left.ceiling.size.argmax())
    total = np.concatenate([one[:, c] for one in left.ceiling.prediction])
    rms = float(np.sqrt(np.mean(total ** 2)))
    return (f'a part that follows the motion and is like none of the library, '
            f'{rms:.2g} {CHANNELS[c].unit} RMS in {CHANNELS[c].name}')


def _foreign(lines: tuple[Line, ...], p: Problem
             ) -> tuple[tuple[Line, ...], tuple[str, ...]]:
    """Take off the lines beside that of a vibration that is explained, and note them."""
    if VIBRATION not in p.effects:
        return lines, ()
    speed = p.effects[VIBRATION]['frequency']
    others = tuple(x for x in lines if abs(x.frequency - speed) > WANDERING * speed)
    note = f'{VIBRATION}: its speed wanders about {speed:.2f} Hz; one speed explains a part of it'
    return others, (note,) if len(others) < len(lines) else ()


def predictable(ceiling: Ceiling, case: int) -> Array:
    """
    Return what the motion predicts of the rest of one recording, where anything is left.

    Parameters
    ----------
    ceiling : Ceiling
    case : int
        Which recording.

    Returns
    -------
    ndarray, shape (n, channels)
    """
    real = (ceiling.z > remainder.PREDICTABLE) & (ceiling.size > SMALL)
    return np.where(real, ceiling.prediction[case], 0.0)
