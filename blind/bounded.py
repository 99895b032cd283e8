"""Bounded least squares as MuJoCo's sysid does them: all numbers of a rig at once, from nominal.

Like the other baselines it is given this rig's own equations. What has a direction or axes gets
three random ones, as there; a cable gets one, a gain of the wrench six.
"""

from typing import Any, NamedTuple

from blind.baselines import asked, DIRECTED, sampled, SURE
from blind.cases import LIBRARY
from blind.rig import follow, nominal, NUISANCES, Rig, run, Truth
from blind.robot import Array
from blind.sensors import record, Recorded
import numpy as np
from scipy.optimize import least_squares

EVALUATIONS = 4
"""Most steps; one costs some fifty runs of the rig."""
COUNTS = {**dict.fromkeys(DIRECTED, 3), 'cable_force': 1, 'wrench_gain': 6}
BEYOND = -0.4
"""Where a saturation begins: that much above usual peaks, where it does nothing."""
VISIBLE = 3.5
"""Sigma at which the library's ranges of sizes begin, as those of nuisances do."""


class Number(NamedTuple):
    """One number: its effect, the seed of its direction, 1 sigma, start and bounds."""

    name: str
    seed: int
    sigma: float
    start: float
    low: float
    high: float


def numbers() -> list[Number]:
    """Return all numbers of the library's effects that change the mean of a signal."""
    found = []
    for name, one in LIBRARY.items():
        if one.random:
            continue
        both, clips = one.nuisance or COUNTS.get(name, 1) > 1, name.endswith('saturation')
        low = -min(one.high, 0.9) if both or clips else 0.0
        sigma = NUISANCES[one.nuisance][1] if one.nuisance else one.low / VISIBLE
        found += [Number(name, seed, sigma, BEYOND if clips else 0.0, low, one.high)
                  for seed in range(COUNTS.get(name, 1))]
    return found


class Fit:
    """Residuals of one recording by all numbers, each relative to what it moves in a step."""

    def __init__(self, recorded: Recorded) -> None:
        self._t, self._commands, self._accelerometer, self._measured = asked(recorded)
        self.numbers = numbers()
        self.steps = np.array([np.sqrt(LIBRARY[n.name].low * LIBRARY[n.name].high)
                               for n in self.numbers])
        self._motions: dict[str, Any] = {}
        self._truths: dict[str, Truth] = {}

    def rig(self, x: Array) -> Rig:
        """Return the rig with its numbers so many steps off."""
        rig = nominal(self._accelerometer)
        for n, size in zip(self.numbers, x * self.steps):
            if size:
                rig = LIBRARY[n.name].apply(rig, float(size), np.random.default_rng(n.seed))
        return rig

    def residual(self, x: Array) -> Array:
        """Return measured less simulated in units of the noise, without each channel's mean."""
        rig = self.rig(x)
        if f'{rig.robot}' not in self._motions:
            self._motions = dict(list(self._motions.items())[:1])  # nominal, and one other
            self._motions[f'{rig.robot}'] = follow(rig.robot, self._commands)
        whole = f'{rig.robot} {rig.tool} {rig.wall}'
        if whole not in self._truths:
            self._truths = dict(list(self._truths.items())[:1])
            self._truths[whole] = run(rig, self._commands, self._motions[f'{rig.robot}'])
        left = self._measured - sampled(record(rig, self._truths[whole], None, 0), self._t)
        return np.asarray((left - left.mean(axis=0)).ravel())

    def jacobian(self, x: Array) -> Array:
        """Return how the residual changes by a step of each, away from its nearer bound."""
        was, columns = self.residual(x), []
        for i, n in enumerate(self.numbers):
            step = 0.3 * (1.0 if (x[i] + 0.3) * self.steps[i] < n.high else -1.0)
            moved = x.copy()
            moved[i] += step
            columns.append((self.residual(moved) - was) / step)
        return np.stack(columns, axis=1)


def judge(recorded: Recorded) -> dict[str, Any]:
    """Return ``names``: effects by how many prior sigma they moved, those beyond three."""
    fit = Fit(recorded)
    start, low, high, sigma = (np.array([getattr(n, key) for n in fit.numbers]) for key in (
        'start', 'low', 'high', 'sigma'))
    found = least_squares(fit.residual, start / fit.steps, fit.jacobian, max_nfev=EVALUATIONS,
                          bounds=(low / fit.steps, high / fit.steps))
    moved: dict[str, float] = {}
    for n, z in zip(fit.numbers, (found.x * fit.steps - start) / sigma):
        moved[n.name] = float(np.hypot(moved.get(n.name, 0.0), z))
    return {'names': sorted((name for name, z in moved.items() if z > SURE),
                            key=lambda name: -moved[name])}
