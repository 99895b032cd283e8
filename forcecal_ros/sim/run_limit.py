"""How often somebody's simulator may be run: each run of it may take minutes."""

from collections.abc import Sequence

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.sim.runs import Runs
from forcecal_ros.sim.third_party import ThirdParty

MOST = 150
"""
Runs of a simulator in one diagnosis: two recordings with 30 parameters that are tried twice take
129, and a simulator of a second a run then takes two minutes.
"""

BESIDE = 3
"""
Runs of each recording beside those of its parameters: as it is, once found, as told. With half
its step of integration, where it can be run so, it is run once more, and once with a quarter.
"""


def refuse_too_many(simulator: ThirdParty, recordings: int) -> None:
    """
    Refuse a simulator whose parameters cannot all be tried.

    Raises
    ------
    ConfigError
        With how many there may be.
    """
    n = len(simulator.parameters)
    beside = BESIDE + simulator.has_finer + simulator.has_finest
    most = (MOST - 1) // recordings - beside
    if n > most:
        enough = recordings > 1 and n <= MOST - 1 - beside
        alone = ', or diagnose without --heldout' if enough else ''
        raise ConfigError(
            f'{simulator.name}: to try its {n} parameters on {recordings} recording'
            f'{"s" if recordings > 1 else ""} it would be run more than {MOST} times; let '
            f'parameters() list at most {most}, those that are least certain{alone}')


def runs_short(simulator: ThirdParty, runs: Sequence[Runs]) -> str:
    """Say so where all parameters cannot be tried once more, else nothing."""
    done, n = sum(one.count for one in runs), len(simulator.parameters)
    if done + len(runs) * (n + BESIDE + simulator.has_finer + simulator.has_finest - 1) <= MOST:
        return ''
    return (f'the simulator was run {done} times, of at most {MOST}, so its {n} parameters were '
            'not tried again at the numbers found, where its signals are not those of a straight '
            'line: change it as told and diagnose again')
