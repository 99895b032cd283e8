"""Steps of the wrench's bias: when a channel's level jumps, by how much, and that it stays."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.steps import steps
from forcecal_ros.diagnose.dataset import STREAM_SLICES
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.instants import interval
from forcecal_ros.effects.nuisances import Nuisance
from forcecal_ros.sim.signals import BLOCK
import numpy as np

TOGETHER = 0.02
"""Channels that jump within that time jump at once [s]: five blocks, more than any was off by."""

TOUCHING = 0.1
"""
Time around the simulated beginning and end of contact, where forces jump by themselves [s].

A wall that is 3 prior standard deviations (3 mm) elsewhere is met that much earlier at 30 mm/s.
"""

AGREES, IN_STD = 0.25, 3.0
"""
Part by which the level after a jump may differ from the jump, and standard errors besides. Of 32
steps laid on development recordings with a background, and found, one differs by more; of seven
other jumps beside them four.
"""

SURE = 8.0
"""Height in its standard error, of the fit to everything, from which a step is claimed."""

NEAR = 0.3
"""How far from where it was first seen an instant is sought [s]: ten blocks at 30 Hz."""


class Event(NamedTuple):
    """
    Channels of the wrench that step at one instant.

    Attributes
    ----------
    instant : float
        [s], on the recording's clock.
    low, high : float
        Between which it lies with 95 %.
    heights : dict of int to float
        Channel -> jump.
    """

    recording: int
    instant: float
    low: float
    high: float
    heights: dict[int, float]


def with_steps(model: LinearisedModel) -> tuple[LinearisedModel, tuple[Event, ...]]:
    """
    Find the steps of the wrench's bias and fit them beside the nuisances.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated.

    Returns
    -------
    model : LinearisedModel
        With a nuisance for each channel of each step; the same where there is none.
    events : tuple of Event
    """
    # nuisances that were fitted to a large step bend what is around it
    nominal = [c.measured.residual(c.nominal) for c in model.datasets]
    for residuals in (model.residuals, nominal):
        out, events = _fitted(model, [e for i, r in enumerate(residuals)
                                      for e in _detected_steps(model, i, r)])
        if events:
            return out, events
    return model, ()


def _fitted(model: LinearisedModel, events: list[Event]) -> tuple[LinearisedModel,
                                                                  tuple[Event, ...]]:
    """Fit steps and leave out, one after the other, those that the fit does not bear out."""
    events = _sharpened(_as_seen(model, events), events) if events else events
    while events:
        out = _with_events(model, events)
        kept = _agreeing(out, events)
        if kept == events:
            return out, tuple(kept)
        events = _sharpened(out, kept)
    return model, ()


def _name(e: Event, channel: int) -> str:
    return f'wrench.step.{e.recording}.{e.instant:.6f}.{channel}'


def _detected_steps(model: LinearisedModel, dataset: int, residual: Array) -> list[Event]:
    """List the steps of one recording's residual, away from where contact begins and ends."""
    one = model.datasets[dataset]
    touching = np.abs(model.signals(dataset).contact[:, :3]).max(axis=1) > 0.0
    edges = one.measured.start + 1e-3 * np.flatnonzero(np.diff(touching))
    seen: list[tuple[float, int, float]] = []
    for c in range(STREAM_SLICES['wrench'].start, STREAM_SLICES['wrench'].stop):
        there = np.flatnonzero(one.measured.present[:, c])
        for step in steps(residual[there, c]):
            instant = float(one.times[there[step.first]]) - 0.5 * BLOCK
            if not np.any(np.abs(edges - instant) < TOUCHING):
                seen.append((instant, c, step.height))
    events: list[Event] = []
    for instant, c, height in sorted(seen):
        if events and instant - events[-1].instant < TOGETHER and c not in events[-1].heights:
            events[-1].heights[c] = height
        else:
            events.append(Event(dataset, instant, instant, instant, {c: height}))
    return events


def _beside(model: LinearisedModel, events: Sequence[Event]) -> LinearisedModel:
    """Add a nuisance for each channel of each step, where it was seen."""
    own = [(Nuisance(_name(e, c), 'wrench_step', lambda rig, x: rig, 'step', c,
                     recording=e.recording, instant=e.instant), abs(h))
           for e in events for c, h in e.heights.items()]
    sign = [np.sign(h) for e in events for h in e.heights.values()]
    out = replace(model, nuisances=(*model.nuisances, *(n for n, _ in own)),
                  prior_std=np.append(model.prior_std, [h for _, h in own]),
                  centre=np.append(model.centre, sign))
    out.linearise()
    return out


def _as_seen(model: LinearisedModel, events: Sequence[Event]) -> LinearisedModel:
    """Fit steps and nuisances beside the noise as it is: good enough to tell their instants."""
    out = _beside(model, events)
    out.centre = out.moved(out.fit_nuisances_to_all().x)
    out.evaluate()
    return out


def _with_events(model: LinearisedModel, events: Sequence[Event]) -> LinearisedModel:
    """Fit steps beside the nuisances, noise along."""
    out = _beside(model, events)
    out.recalibrate()
    if any(not model.datasets[e.recording].train.any() for e in events):
        step = out.fit_nuisances_to_all().x
        out.centre = out.centre + np.where([n.acts_on == 'step'
                                            and not model.datasets[n.recording].train.any()
                                            for n in out.nuisances], step, 0.0)
        out.evaluate()
        out.refit_noise(np.zeros(len(out.nuisances)))
    return out


def height_of(model: LinearisedModel, e: Event, channel: int) -> tuple[float, float]:
    """Return the height of a channel's step, as fitted, and its standard error."""
    k = _position(model, e, channel)
    trained = model.datasets[e.recording].train.any()
    fitted = model.fit_nuisances() if trained else model.fit_nuisances_to_all()
    size = float(model.prior_std[k])
    return size * float(model.centre[k]), size * float(np.sqrt(fitted.covariance[k, k]))


def _position(model: LinearisedModel, e: Event, channel: int) -> int:
    return next(i for i, n in enumerate(model.nuisances) if n.name == _name(e, channel))


def _agreeing(model: LinearisedModel, events: Sequence[Event]) -> list[Event]:
    """Keep channels whose level, of the fit to everything, has changed by what it jumped."""
    kept = []
    for e in events:
        heights = {}
        for c, jump in e.heights.items():
            height, std = height_of(model, e, c)
            if abs(height) > SURE * std and abs(height - jump) < AGREES * abs(jump) + IN_STD * std:
                heights[c] = jump
        if heights:
            kept.append(e if heights == e.heights else e._replace(heights=heights))
    return kept


def _sharpened(model: LinearisedModel, events: Sequence[Event]) -> list[Event]:
    """Find the instant of each step, to a sample, from its posterior."""
    out = []
    for e in events:
        t = model.datasets[e.recording].measured.times('wrench')
        near = t[np.abs(t - e.instant) < NEAR]
        before = t[np.maximum(np.searchsorted(t, near) - 1, 0)]
        weight = np.sum([_likelihood(model, e, c, near) for c in e.heights], axis=0)
        low, i, high = interval(weight)
        # a step lies between the last sample without and the first one with it
        out.append(e._replace(instant=0.5 * float(before[i] + near[i]), low=float(before[low]),
                              high=float(near[high])))
    return out


def _likelihood(model: LinearisedModel, e: Event, channel: int, instants: Array) -> Array:
    """Log-likelihood of a channel's step at some instants, its height fitted to each."""
    dataset, noise = model.datasets[e.recording], model.noise[e.recording]
    k = _position(model, e, channel)
    column = model.jacobian[e.recording][k][channel].values()
    without = model.residuals[e.recording][:, channel] + model.centre[k] * column
    rows = np.stack([without, *(dataset.measured.since('wrench', t) for t in instants)])
    white = noise.whiten(rows, channel)
    product, square = white[1:] @ white[0], np.sum(white[1:] ** 2, axis=1)
    return np.asarray(0.5 * product ** 2 / np.maximum(square, 1e-12))
