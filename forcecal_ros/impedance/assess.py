"""The figures of one closed-loop run: what the force feedback was worth."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.impedance.program import Program
from forcecal_ros.impedance.trial import Trial
import numpy as np
from numpy.typing import NDArray

TOUCH = 0.5
"""Contact force above which the tool touches [N]."""

SETTLED = 0.05
"""Share of the final force that it stays within once settled."""

SETTLED_FLOOR = 1.0
"""The same at least [N]."""


EVEN = 0.05
"""Figures that differ by less than this share are even."""

COMPARED = {
    'phantom_rms': 'Phantom force in free motion, RMS [N]',
    'phantom_peak': 'Phantom force in free motion, peak [N]',
    'strayed': 'Strayed in free motion [m]',
    'peak': 'Peak at contact [N]',
    'bounces': 'Bounces',
    'settling': 'Settling [s]',
    'force_error': 'Force error in contact [N]',
}
"""Figures of which less is better, in words."""


class Figures(NamedTuple):
    """
    What a run came to; forces along x of ft_sensor.

    Attributes
    ----------
    phantom_rms, phantom_peak : float
        Force fed back in free movement, where there is none [N].
    strayed : float
        How far the tool in free movement is from where the true force would have had it, RMS [m].
    peak : float
        Greatest true force from the first touch to the end of the first hold [N].
    bounces : int
        How often contact was lost in that time.
    settling : float
        From the first touch until the true force stays within 5 % (or 1 N) of that at the end of
        the first hold; NaN: it does not by then [s].
    force_error : float
        RMS of force fed back less true force in constrained movement [N].
    contact_force : float
        Mean true force in constrained movement [N].
    """

    phantom_rms: float
    phantom_peak: float
    strayed: float
    peak: float
    bounces: int
    settling: float
    force_error: float
    contact_force: float


def assess(trial: Trial, ideal: Trial, program: Program) -> Figures:
    """
    Return the figures of a run.

    Parameters
    ----------
    trial : Trial
    ideal : Trial
        The same with the true force fed back, and the same noise.
    program : Program
        Their reference.

    Returns
    -------
    Figures
    """
    start, end = program.span('free')
    free = trial.feedback.between(start, end).values[:, 0]
    strayed = (trial.tool.between(start, end).values - ideal.tool.between(start, end).values)
    held = program.first_hold('contact')
    touching = trial.contact.between(program.span('approach')[0], held)
    force = -touching.values[:, 0]
    begin, bounces, settling, peak = np.nan, 0, np.nan, 0.0
    if (force > TOUCH).any():
        first = int(np.argmax(force > TOUCH))
        begin, force = touching.t[first], force[first:]
        bounces, peak = losses(force > 0.0), float(force.max())
        settling = settling_time(touching.t[first:], force) - begin
    pressed = trial.feedback.between(*program.span('contact'))
    truth = trial.contact.at(pressed.t)[:, 0]
    return Figures(
        rms(free), float(np.abs(free).max()), rms(strayed), peak, bounces, float(settling),
        rms(pressed.values[:, 0] - truth), float(-truth.mean()))


def rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def exceptions(figures: Mapping[str, Figures]) -> Iterator[str]:
    """
    Say where the Kalman observer is not the best feedback, and what the true force would give.

    Parameters
    ----------
    figures : mapping of str to Figures
        By feedback, ``true`` among them.

    Yields
    ------
    str
        One sentence a figure.
    """
    kalman, ideal = figures['kalman'], figures['true']
    even = []
    others = {name: one for name, one in figures.items() if name not in ('kalman', 'true')}
    for field, words in COMPARED.items():
        mine, best = getattr(kalman, field), min(others, key=lambda name: _rank(
            getattr(others[name], field)))
        theirs = getattr(others[best], field)
        if _rank(mine) <= (1.0 + EVEN) * _rank(theirs):
            if _rank(mine) >= (1.0 - EVEN) * _rank(theirs):
                even.append(words)
            continue
        perfect = getattr(ideal, field)
        yield (f'{words}: kalman {mine:.3g}, {best} {theirs:.3g}; with the true force '
               f'{perfect:.3g}. ' + _why(perfect, theirs, others[best], ideal))
    if even:
        yield (f'Within {EVEN:.0%} of the best of the others: {"; ".join(even)}. There the tool '
               'on its spring decides, and what the law does with position and displacement, '
               'more than the force.')


def _rank(value: float) -> float:
    """Return a figure so that less is better: what never settles is last."""
    return value if value == value else float('inf')


def _why(perfect: float, theirs: float, other: Figures, ideal: Figures) -> str:
    if other.contact_force < (1.0 - EVEN) * ideal.contact_force:
        return (f'That one presses with {other.contact_force:.1f} N in the place of '
                f'{ideal.contact_force:.1f} N: its bias counts as contact.')
    if _rank(perfect) > (1.0 + EVEN) * _rank(theirs):
        return ('The true force fares no better: it is the law that gains from a sensor which '
                'reads the spring between robot and tool, damped as it is, and not the contact.')
    return ('The observer answers later than the sensor, by its filter: that costs while the '
            'force changes.')


def losses(touching: NDArray[np.bool_]) -> int:
    """Return how often something that is true ends, the end of the array left out."""
    return int(np.count_nonzero(touching[:-1] & ~touching[1:]))


def settling_time(t: Array, force: Array) -> float:
    """
    Return when a force is settled: NaN where it is not in the last tenth.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    force : ndarray, shape (n,)
        [N]

    Returns
    -------
    float
        [s]
    """
    tenth = max(1, len(force) // 10)
    final = float(force[-tenth:].mean())
    outside = np.abs(force - final) > max(SETTLED * abs(final), SETTLED_FLOOR)
    if outside[-tenth:].any():
        return float('nan')
    last = int(np.flatnonzero(outside)[-1]) + 1 if outside.any() else 0
    return float(t[last])
