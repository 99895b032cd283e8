"""A rig linearised in its parameters: residual, Jacobian, noise and discrepancy at a point."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.noise.autoregression import Autoregression, fit_autoregression, white
from forcecal_ros.diagnose.dataset import (
    CHANNELS,
    Dataset,
    possible_effects,
    split_datasets,
    STREAM_SLICES,
)
from forcecal_ros.diagnose.model.discrepancy import (
    Basis,
    basis,
    Discrepancy,
    NO_DISCREPANCY,
    Products,
    Scales,
    WhitenedDiscrepancy,
)
from forcecal_ros.diagnose.model.evidence import Earlier, FIRST_RECORDING, Fit, fit, Gram, Prior
from forcecal_ros.diagnose.model.gates import departed, Gate, nuisances_of
from forcecal_ros.diagnose.model.jacobian import (
    Column,
    column,
    combined,
    Compact,
    nuisance_column,
)
from forcecal_ros.diagnose.verdict import TOLERANCE, tolerated
from forcecal_ros.effects import Effect, EFFECTS, with_effects
from forcecal_ros.effects.nuisances import apply_all, Nuisance, prior_std, ROBOT
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.signals import block_means, JOINTS, Signals
import numpy as np
from numpy.typing import NDArray

EFFECT = 1.0 / 3.0 ** 2
"""Prior precision of an effect's parameter, in units of its typical size."""

RELEASED = 1.0 / 15.0 ** 2
"""Prior precision of a released nuisance, in units of its prior std."""


QUIETEST = 1e-5
"""
Noise of a channel, at least, in its signal: single precision, in which columns are held, keeps a
hundredth of that. With less a recording is computed, not measured.
"""

FAR = 2.0
"""Step of curved nuisances, in prior std, after which their Jacobian is taken anew."""

FRACTIONS = (1.0, 0.3, 0.09, 0.027)
"""Parts of a step that are tried in turn until one is for the better."""

JOINT = 1e-4
"""
Noise of a joint's position in one block mean, at least [rad]. Encoders show a tenth of that, but
gears turn by so much more or less in each turn, and a load of the tool that is simulated beside
the arm, a cable's say, moves no joint: a tenth of a millimetre at arm's length, as poses have.
"""

Values = Mapping[str, Mapping[str, float]]
"""Values by effect and parameter."""


class Diverged(ForcecalError):
    """A simulation that is not finite: no rig behaves like that."""


@dataclass
class LinearisedModel:
    """
    Recordings, and the rig as it is explained so far.

    Attributes
    ----------
    rig : Rig
        As given, without what is estimated.
    datasets : tuple of Dataset
        To fit on and to judge on; one recording may do both.
    effects : Values
        Accepted, beside released nuisances.
    fixed : Values
        Known from the data without any model.
    centre : ndarray, shape (m,)
        Nuisances about which the simulation is linearised, in prior std.
    released : frozenset of str
        Nuisances that an accepted effect frees from their prior.
    level : ndarray, shape (channels,)
        The rig's noise of each channel in one block mean.
    residuals : list of ndarray, shape (n, channels)
        Of each recording: measured less simulated at the centre.
    jacobian : list of list of Column
        Of each recording: what each nuisance changes, by one prior std.
    discrepancy_scales : tuple of float
        Part of the signals that the discrepancy may have, stream by stream.
    gates : mapping of str to Gate
        When effects act that do not act all the time.
    tolerance : float
        RMS of what is unexplained, in that of a channel's noise, that does not matter.
    earlier : Earlier
        What earlier recordings of the same robot found.
    """

    rig: Rig
    datasets: tuple[Dataset, ...]
    nuisances: tuple[Nuisance, ...] = ()
    prior_std: Array = field(default_factory=lambda: np.zeros(0))
    level: Array = field(default_factory=lambda: np.ones(len(CHANNELS)))
    effects: Values = field(default_factory=dict)
    fixed: Values = field(default_factory=dict)
    released: frozenset[str] = frozenset()
    centre: Array = field(default_factory=lambda: np.zeros(0))
    residuals: list[Array] = field(default_factory=list)
    jacobian: list[list[Column]] = field(default_factory=list)
    noise: list[Autoregression] = field(default_factory=list)
    discrepancy: Discrepancy | None = None
    discrepancy_scales: Scales = NO_DISCREPANCY
    library: Mapping[str, Effect] = field(default_factory=lambda: EFFECTS)
    gates: Mapping[str, Gate] = field(default_factory=dict)
    tolerance: float = TOLERANCE
    earlier: Earlier = FIRST_RECORDING
    _calibrated: tuple[bytes, Rig] | None = None
    _straight: dict[Hashable, Column] = field(default_factory=dict)
    _tangents: list[list[Hashable]] = field(default_factory=list)  # to which columns belong

    def current(self, effects: Values | None = None) -> Rig:
        """Return the rig at the centre, with the accepted effects or with others."""
        key = self.centre.tobytes()
        if self._calibrated is None or self._calibrated[0] != key:
            values = dict(zip((n.name for n in self.nuisances), self.centre * self.prior_std))
            self._calibrated = key, apply_all(self.rig, self.nuisances, values)
        chosen = {**self.fixed, **(self.effects if effects is None else effects)}
        return with_effects(self._calibrated[1], chosen) if chosen else self._calibrated[1]

    def moved(self, step: Array) -> Array:
        """Return the centre after a step, nothing physical below its lowest value."""
        return np.asarray(np.maximum(self.centre + step, self.least()))

    def least(self) -> Array:
        """Return the lowest physical value of each nuisance, in prior std, shape (m,)."""
        return np.array([n.least for n in self.nuisances]) / self.prior_std

    def prior(self, released: frozenset[str] = frozenset()) -> Prior:
        """Return the prior of the nuisances, some of them released."""
        free = np.array([n.name in released | self.released for n in self.nuisances], dtype=bool)
        limits = np.array([n.limit for n in self.nuisances])
        most = np.where(free, np.inf, limits)
        return Prior(self.centre,
                     np.where(free, RELEASED, 1.0),
                     np.maximum(-most, self.least()), most)

    def simulate(self, effects: Values, dataset: int) -> Array:
        """Return measured less simulated of one recording with other effects, (n, channels)."""
        signals, measured = self.signals(dataset, effects), self.datasets[dataset].measured
        out = _finite(measured.residual(signals))
        for name in (n for n in effects if n in self.gates):
            rows = self.gates[name].rows(measured, dataset)
            if rows.any():
                out = out - rows * self.added(name, effects, dataset, signals)
        return out

    def signals(self, dataset: int, effects: Values | None = None) -> Signals:
        """
        Simulate one recording at the centre, without effects that act for a part of the time.

        Parameters
        ----------
        effects : Values, optional
            Others than the accepted ones.
        """
        always = self._always(self.effects if effects is None else effects)
        return self.datasets[dataset].simulation.signals(self.current(always))

    def _always(self, effects: Values) -> Values:
        """Leave out the effects that act for a part of the time."""
        return {name: v for name, v in effects.items() if name not in self.gates}

    def added(self, name: str, effects: Values, dataset: int, before: Signals | None = None
              ) -> Array:
        """
        Return what an effect adds if it acts all the time, shape (n, channels).

        Parameters
        ----------
        effects : Values
            Its own, and those beside it.
        before : Signals, optional
            Simulated without it.
        """
        one, effect = self.datasets[dataset], self.library[name]
        others = self._always({n: v for n, v in effects.items() if n != name})
        rig = self.current(others)
        own = [self.nuisances[i] for i in nuisances_of(self.nuisances, effect)]
        changed = (departed(rig, own, effect, effects[name]) if own
                   else with_effects(rig, {name: effects[name]}))
        signals = one.simulation.signals(rig) if before is None else before
        return _finite(one.measured.residual(signals) - one.measured.residual(
            one.simulation.signals(changed)))

    def evaluate(self) -> None:
        """Simulate at the centre; the Jacobian stays as it is."""
        self.residuals = [self.simulate(self.effects, i) for i in range(len(self.datasets))]

    def settle(self, *, whole: bool = False) -> bool:
        """
        Simulate exactly here what was predicted; say whether that changed the residual.

        Parameters
        ----------
        whole : bool
            Also linearise a simulator in all its numbers here, unless that was done near enough.
        """
        rig = self.current(self._always(self.effects))
        ran = [one.simulation.settle(rig, whole=whole) for one in self.datasets]
        if any(ran):
            self.evaluate()
        return any(ran)

    def evaluated(self, step: Array, **changes: Any) -> 'LinearisedModel | None':
        """Return it evaluated a step of the nuisances away, changed; None where that diverges."""
        out = replace(self, centre=self.moved(step), **changes)
        try:
            out.evaluate()
        except Diverged:
            return None
        return out

    def split_by_second(self) -> 'LinearisedModel':
        """Judge on every other second of each recording, not on the last recording alone."""
        datasets = tuple(one for c in self.datasets for one in split_datasets([c]))
        d = self.discrepancy
        return replace(self, datasets=datasets, discrepancy=d and Discrepancy(
            d.basis, d.signal, [c.train for c in datasets]))

    def without_effects(self) -> 'LinearisedModel':
        """Remove all effects and released nuisances; the other nuisances stay."""
        free = np.array([n.name in self.released for n in self.nuisances],
                        dtype=bool)
        out = replace(self, effects={}, released=frozenset(),
                      centre=np.where(free, 0.0, self.centre))
        out.evaluate()
        return out

    def linearise(self, names: frozenset[str] | None = None) -> None:
        """
        Simulate at the centre and take the Jacobian by the nuisances there.

        Parameters
        ----------
        names : frozenset of str, optional
            Take anew the columns of these alone, as far as they are simulated. Where signals are
            linear about points that were tried, another point may be the nearest now: those of
            all of which that is so.
        """
        rig = self.current(self._always(self.effects))
        self.jacobian = [list(columns) for columns in self.jacobian] or [
            [{} for _ in self.nuisances] for _ in self.datasets]
        self._tangents = [list(one) for one in self._tangents] or [
            [None for _ in self.nuisances] for _ in self.datasets]
        for i, c in enumerate(self.datasets if names or names is None else ()):
            s = c.simulation.signals(rig)
            b = c.measured.residual(s)
            for j, n in enumerate(self.nuisances):
                tangent = c.simulation.tangent(rig, n.name) if n.acts_on == 'rig' else None
                if names is None or (n.acts_on == 'rig' and (
                        n.name in names or tangent != self._tangents[i][j])):
                    self.jacobian[i][j] = self._column(i, j, tangent, rig, s, b)
                    self._tangents[i][j] = tangent
        self.evaluate()

    def _column(self, dataset: int, j: int, tangent: Hashable, rig: Rig, base: Signals,
                residual: Array) -> Column:
        """Return the column of a nuisance, the one of before where that holds wherever it is."""
        key = dataset, j, tangent, rig.effects
        found = None if tangent is None else self._straight.get(key)
        if found is None:
            found = nuisance_column(self.datasets[dataset], self.nuisances[j], self.prior_std[j],
                                    rig, base, residual, self.level)
        if tangent is not None:
            self._straight[key] = found
        return found

    def gram(self, extra: list[list[Column]], training: bool = False) -> Gram:
        """Return the Gram of nuisances' and further columns, over all or training blocks."""
        absent = self.discrepancy_scales == NO_DISCREPANCY
        return self.products(extra, absent, training).at(self.discrepancy_scales)

    def products(self, extra: list[list[Column]], absent: bool = False, training: bool = False
                 ) -> Products:
        """Return inner products of nuisances' and further columns, for any discrepancy or none."""
        columns = [[*own, *more] for own, more in zip(self.jacobian, extra)]
        return self.whitened_discrepancy().products(columns, self.residuals, absent, training)

    def residual_products(self, training: bool = False) -> Products:
        """Return inner products of the residuals alone."""
        return self.whitened_discrepancy().products(
            [[] for _ in self.datasets], self.residuals,
            self.discrepancy_scales == NO_DISCREPANCY, training)

    def predicted(self, sizes: Mapping[int, float], training: bool = True) -> list[Array]:
        """
        Return the discrepancy that training blocks, or all, show in each recording.

        Parameters
        ----------
        sizes : mapping of int to float
            Part of its signal that each channel has.
        """
        return self.whitened_discrepancy().of_weights(
            self.residual_products(training).weights(sizes))

    def whitened_discrepancy(self) -> WhitenedDiscrepancy:
        """Return the discrepancy, whitened by the noise; an empty one where none is set up."""
        if self.discrepancy is None:
            rows = tuple(Compact.of(np.zeros((0, len(c.groups)))) for c in self.datasets)
            self.discrepancy = Discrepancy(Basis(rows, np.zeros(0)), _signal(self),
                                           [c.train for c in self.datasets])
        return self.discrepancy.whitened(self.noise)

    def allow_discrepancy(self, frequencies: Sequence[float] = ()) -> None:
        """Set up what no library has: functions of the present motion, and lines [Hz]."""
        smooth = [c.simulation.smooth(self.signals(i)) for i, c in enumerate(self.datasets)]
        self.discrepancy = Discrepancy(basis(smooth, frequencies), _signal(self),
                                       [c.train for c in self.datasets])

    def fit_nuisances(self) -> Fit:
        """Fit the nuisances alone."""
        return fit(self.gram([[] for _ in self.datasets]), self.prior())

    def nuisance_covariance(self) -> Array:
        """Return the covariance of each nuisance whatever the others are, shape (m, m)."""
        gram, prior = self.gram([[] for _ in self.datasets]), self.prior()
        return fit(gram, prior).marginal_covariance(gram, prior, self.least(),
                                                    np.zeros_like(gram.matrix))

    def log_posterior(self, square: float | None = None) -> float:
        """
        Log-likelihood of all blocks, and prior, with everything as it is.

        Parameters
        ----------
        square : float, optional
            Of the residual's Gram, where that is known.
        """
        if square is None:
            square = self.residual_products().at(self.discrepancy_scales).square
        prior = self.prior()
        return -0.5 * (square + float((prior.centre * prior.precision) @ prior.centre))

    def refit_noise(self, x: Array) -> None:
        """Fit the noise of what a step of the nuisances, and any discrepancy, leave."""
        residuals = [b - combined(columns, x, len(b))
                     for b, columns in zip(self.residuals, self.jacobian)]
        if not self.noise and self.datasets[0].simulation.starts_white:
            self.noise = self.white_noise(residuals)
        if self.noise and self.discrepancy is not None:
            predicted = self.whitened_discrepancy().predicted(residuals)
            residuals = [r - p for r, p in zip(residuals, predicted)]
        floor = self._quietest()
        # to a drift an autoregression finds a root near 1, as to a step, and whitens it away
        residuals = [_without_trend(r, c.measured.present)
                     for r, c in zip(residuals, self.datasets)]
        fitted = [_no_less(fit_autoregression(r, c.measured.present, c.groups), floor)
                  for r, c in zip(residuals, self.datasets)]
        # features are whitened anew for each noise, which takes seconds
        self.noise = [old.or_better(new, r) for old, new, r in zip(
            self.noise or fitted, fitted, residuals)]

    def white_noise(self, residuals: Sequence[Array]) -> list[Autoregression]:
        """Return noise as strong as neighbouring samples of residuals differ by."""
        floor = self._quietest()
        return [_no_less(white(r, c.measured.present, c.groups), floor)
                for r, c in zip(residuals, self.datasets)]

    def _quietest(self) -> Array:
        """Return the least noise of each channel, shape (channels,)."""
        signal = _signal(self) if self.discrepancy is None else self.discrepancy.signal
        floor = QUIETEST * signal
        floor[STREAM_SLICES['joints']] = JOINT
        return np.asarray(floor)

    def recalibrate(self) -> None:
        """Move the centre to the best nuisances, noise refitted on the way."""
        self.refit_noise(np.zeros(len(self.nuisances)))
        self.refit_noise(self.fit_nuisances().x)
        for _ in range(6):
            step = self.fit_nuisances().x
            self._approach(step)
            if self.settle():
                self.linearise()
            self.refit_noise(np.zeros(len(self.nuisances)))
            if np.abs(step).max(initial=0.0) < 0.05:  # of its prior std
                break

    def is_far(self, step: Array) -> bool:
        """Say whether a step of the nuisances leaves where their Jacobian holds."""
        return any(abs(x) > FAR for x, n in zip(step, self.nuisances) if n.key == ROBOT)

    def _approach(self, step: Array) -> None:
        """Take a step of the nuisances, where it may mislead as far as it makes things better."""
        if not self.is_far(step):
            self.centre = self.moved(step)
            self.evaluate()
            return
        before = self.log_posterior()
        for fraction in FRACTIONS:
            tried = self.evaluated(fraction * step)
            if tried and tried.log_posterior() > before:
                self.centre = tried.centre
                break
        self.linearise()

    def difference(self, effects: Values) -> list[Column]:
        """Return what other effects do to each recording, as columns."""
        return [column(b - self.simulate(effects, i), self.level)
                for i, b in enumerate(self.residuals)]


def noise_level(rig: Rig, streams: tuple[str, ...], accelerometer: str) -> Array:
    """Return the rig's noise of every channel in one block mean, shape (channels,)."""
    optidrive = rig.optidrive.noise if rig.optidrive else 1.0
    level = [rig.wrench_sensor.force_noise] * 3 + [rig.wrench_sensor.torque_noise] * 3
    level += [rig.accelerometer.noise] * 3 + [optidrive]
    level += [2.0 * rig.pose_sensor.position_noise] * 3
    level += [2.0 * rig.pose_sensor.orientation_noise] * 3
    level += [2.0 * JOINT] * JOINTS
    return np.maximum(np.array(level) / 2.0, 1e-12)


def linearised_model(rig: Rig, datasets: tuple[Dataset, ...], tolerance: float | None = None,
                     earlier: Earlier = FIRST_RECORDING) -> LinearisedModel:
    """Set up a diagnosis, recalibrated; without a tolerance nothing finer than exact matters."""
    name, streams = datasets[0].simulation.accelerometer, datasets[0].measured.streams
    found = datasets[0].simulation.nuisances(rig, streams)
    out = LinearisedModel(rig, datasets, found, np.array(prior_std(rig, found)),
                          noise_level(rig, streams, name), centre=np.zeros(len(found)),
                          library=possible_effects(datasets),
                          tolerance=tolerated(tolerance, datasets[0].simulation.exact),
                          earlier=earlier)
    out.linearise()
    out.allow_discrepancy()
    out.recalibrate()
    return out


def _finite(residual: Array) -> Array:
    """Return a residual; refuse one that no rig has."""
    if not np.isfinite(residual).all() or np.abs(residual).max(initial=0.0) > 1e9:
        raise Diverged('a simulation is not finite')
    return residual


def _without_trend(residual: Array, present: NDArray[np.bool_]) -> Array:
    """Remove a line from each channel of a residual, shape (n, channels)."""
    t = np.linspace(-1.0, 1.0, len(residual))[:, np.newaxis]
    n = np.maximum(present.sum(axis=0), 1)
    away = np.where(present, t - (t * present).sum(axis=0) / n, 0.0)
    slope = (away * residual).sum(axis=0) / np.maximum((away ** 2).sum(axis=0), 1e-300)
    return np.asarray(residual - away * slope)


def _no_less(noise: Autoregression, floor: Array) -> Autoregression:
    return noise._replace(sigma=np.where(noise.sigma > 0.0, np.maximum(noise.sigma, floor), 0.0))


def _signal(model: LinearisedModel) -> Array:
    """Return what each channel shows, the largest of its vector: standard deviation."""
    shown = []
    for i in range(len(model.datasets)):
        s = model.signals(i)
        rotation = rotation_vector(s.R_base_sensor[0].T @ s.R_base_sensor)
        joints = np.zeros((len(rotation), JOINTS)) if s.joints is None else s.joints
        shown.append(np.concatenate([block_means(values) for values in (
            s.wrench, s.volts, s.optidrive[:, np.newaxis], s.position, rotation, joints)], axis=1))
    std = np.concatenate(shown).std(axis=0)
    vectors = np.array([c.name[:-1] for c in CHANNELS])
    return np.array([std[vectors == vector].max() for vector in vectors])
