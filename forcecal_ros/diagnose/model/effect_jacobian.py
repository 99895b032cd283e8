"""The Jacobian by an effect's parameters, at their values."""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.diagnose.model.hypotheses import bounds_of, nominal_of, values_of
from forcecal_ros.diagnose.model.jacobian import Column, column
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.effects import Effect
from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

FAR = 20.0
"""A nominal value so many times the typical one stands for no limit at all."""


class EffectJacobian(NamedTuple):
    """
    Columns of an effect's estimated parameters at their values.

    Attributes
    ----------
    free : ndarray of int, shape (k,)
        Which parameters.
    units : ndarray, shape (k,)
        Of the columns.
    away : ndarray, shape (k,)
        How far the parameters are from where the effect does nothing, in these units.
    columns : tuple of list of Column
        One list per recording.
    """

    name: str
    free: NDArray[np.intp]
    units: Array
    away: Array
    columns: tuple[list[Column], ...]


def unit_of(effect: Effect, theta: Array) -> Array:
    """Scale of each parameter, shape (p,)."""
    nominal = nominal_of(effect)
    typical = np.array([q.typical for q in effect.parameters])
    unit = np.maximum(np.abs(typical - nominal), np.abs(theta - nominal))
    limit = np.abs(nominal) > FAR * np.abs(typical)
    unit = np.where(limit, np.abs(theta), unit)
    shapes = np.array([q.shapes for q in effect.parameters])
    unit = np.where(shapes, np.abs(typical - nominal), unit)
    return np.asarray(np.where(unit > 0.0, unit, 1.0))


def effect_jacobian(model: LinearisedModel, name: str, theta: Array, free: NDArray[np.intp],
                    residuals: Sequence[Array], datasets: Sequence[int]) -> EffectJacobian:
    """
    Take an effect's columns at its parameters by finite steps.

    Parameters
    ----------
    theta : ndarray, shape (p,)
    free : ndarray of int, shape (k,)
        Which parameters.
    residuals : sequence of ndarray, shape (n, channels)
        Measured less simulated with the effect at ``theta``, of the chosen recordings.
    datasets : sequence of int
        Chosen recordings; the others get empty columns.
    """
    effect = model.library[name]
    units, high = unit_of(effect, theta)[free], bounds_of(effect)[1]
    fraction = 0.02 if effect.smooth else 0.1
    columns: list[list[Column]] = [[] for _ in model.datasets]
    for i, unit in zip(free, units):
        moved = theta.copy()
        h = fraction * unit if theta[i] + fraction * unit <= high[i] else -fraction * unit
        moved[i] += h
        changed = {**model.effects, name: values_of(effect, moved)}
        for dataset in range(len(model.datasets)):
            one: Column = {}
            if dataset in datasets:
                before = residuals[list(datasets).index(dataset)]
                one = column((before - model.simulate(changed, dataset)) * (unit / h),
                             model.level)
            columns[dataset].append(one)
    away = (theta - nominal_of(effect))[free] / units
    shapes = np.array([effect.parameters[i].shapes for i in free])
    return EffectJacobian(name, free, units, np.where(shapes | (np.abs(away) > FAR), 0.0, away),
                          tuple(columns))
