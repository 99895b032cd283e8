"""What was found of a simulator's numbers, and how that is told."""

from collections.abc import Iterator
from typing import NamedTuple

from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.judge.named_effects import AT_BOUND
from forcecal_ros.diagnose.verdict import FURTHER
from forcecal_ros.effects.nuisances import LIMIT
from forcecal_ros.sim.simulated_robot import STEP
from forcecal_ros.sim.third_party import ThirdParty

CERTAIN = 3.0
"""Standard errors from which a recalibrated parameter is told: once in 400 by chance."""


class Changed(NamedTuple):
    """
    A parameter of the simulator as it was, as it should be, and its standard error.

    Where it is at its bound, that says nothing.
    """

    name: str
    unit: str
    before: float
    after: float
    std: float
    at_bound: bool = False

    def __str__(self) -> str:
        unit = '' if self.unit == '1' else f' {self.unit}'
        moved = f'{self.name} {self.before:.4g} -> {self.after:.4g}'
        if self.at_bound or self.std == 0.0:
            return f'{moved}{unit} ({AT_BOUND})'
        return f'{moved} +- {self.std:.2g}{unit}'


def changes(simulator: ThirdParty, outcome: Outcome) -> tuple[Changed, ...]:
    """List the parameters that a named effect moves."""
    found = {e.name: e.parameters['value'] for e in outcome.diagnosis.effects
             if 'value' in e.parameters}
    return tuple(Changed(p.name, p.unit, p.nominal, found[p.name].value, found[p.name].std,
                         found[p.name].at_bound) for p in simulator.parameters if p.name in found)


def recalibrated(simulator: ThirdParty, outcome: Outcome) -> Iterator[str]:
    """Say which parameters are off by no more than they may be."""
    named = {e.name for e in outcome.diagnosis.effects}
    limited, told = held(simulator, outcome), []
    for p in simulator.parameters:
        x, std = outcome.recalibrations.get(p.name, (0.0, 0.0))
        if p.name not in (*named, *limited) and abs(x) > CERTAIN * std:
            told.append(str(Changed(p.name, p.unit, p.nominal, p.nominal + x, std)))
    if told:
        yield f'recalibrated, within three of their sigma: {"; ".join(told)}'
    if limited:
        yield (f'{", ".join(limited)} {FURTHER}, and beside what else is there is not certain '
               'enough for a name')
    finer, std = outcome.recalibrations.get(STEP, (0.0, 0.0))
    if abs(finer) > CERTAIN * std:
        yield (f'the step of its integration makes {_sure(finer, std)} times what half the '
               'step changes, and that was taken out: a smaller step is nearer to the robot')
    late, std = outcome.recalibrations.get('robot.delay', (0.0, 0.0))
    if 'robot_delay' not in named and abs(late) > CERTAIN * std:
        yield f'the robot is {_sure(1e3 * late, 1e3 * std)} ms later than its simulation'


def held(simulator: ThirdParty, outcome: Outcome) -> list[str]:
    """List the parameters, not named, that would move further than three of their sigma."""
    named = {e.name for e in outcome.diagnosis.effects}
    return [p.name for p in simulator.parameters if p.name not in named and abs(
        outcome.recalibrations.get(p.name, (0.0, 0.0))[0]) > 0.999 * LIMIT * p.sigma]


def _sure(value: float, std: float) -> str:
    """Write a number and its standard error, or that it could go no further."""
    return f'{value:.2g} +- {std:.1g}' if std > 0.0 else f'{value:.2g} ({AT_BOUND})'
