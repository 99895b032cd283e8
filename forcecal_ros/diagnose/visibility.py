"""What recordings could show at all: how much moves, and which effects would be seen."""

from forcecal_ros.diagnose.channels import COLUMNS
from forcecal_ros.diagnose.hypotheses import Hypothesis
from forcecal_ros.diagnose.problem import Problem
import numpy as np

VISIBLE = 25.0
"""Whitened energy that a typical size must have in order to be seen."""


def excitation(p: Problem) -> float:
    """
    Say how much the motion moves the signal that it moves most.

    Parameters
    ----------
    p : Problem

    Returns
    -------
    float
        RMS about the mean over the rig's noise, of wrench and specific force.
    """
    most = 0.0
    for case in p.cases:
        for name, signal in (('wrench', case.nominal.wrench), ('accelerometer',
                                                               case.nominal.volts)):
            if name in case.measured.streams:
                noise = 2.0 * p.level[COLUMNS[name]]
                most = max(most, float((signal.std(axis=0) / noise).max()))
    return most


def not_excited(p: Problem, found: list[Hypothesis]) -> list[str]:
    """
    List the effects of the library that these recordings could not show at a typical size.

    Parameters
    ----------
    p : Problem
    found : list of Hypothesis

    Returns
    -------
    list of str
    """
    m = len(p.nuisances)
    extra = [[c for h in found for a in h.atoms[:1] for c in a.columns[i]]
             for i in range(len(p.cases))]
    train, held = p.grams(extra)
    energy = np.diag(train.matrix) + np.diag(held.matrix)
    visible, position = set(), m
    for h in found:
        if h.releases:
            index = [i for i, n in enumerate(p.nuisances) if n.name in h.releases[0]]
            best = 9.0 * max(energy[i] for i in index)
        else:
            k = len(h.atoms[0].free)
            best, position = max(energy[position:position + k]), position + k
        if best > VISIBLE:
            visible.add(h.name)
    return [h.name for h in found if h.name not in visible]
