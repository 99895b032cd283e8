"""The figures of one closed-loop run: what the force feedback was worth."""

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
