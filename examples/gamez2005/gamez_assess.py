"""Figures by which a closed-loop run is judged."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.impedance.session import Program
from gamez_loop import ClosedLoopRun
import numpy as np
from numpy.typing import NDArray

TOUCH = 0.5
"""True contact force above which the tool counts as touching the wall [N]."""

SETTLED = 0.05
"""A contact force is settled once it stays within this share of its final value, ..."""

SETTLED_FLOOR = 1.0
"""... or within this force of it, where that is more: the share of a light touch is noise [N]."""


def _spans(program, phase):
    """Return begin and end of each stage of a phase [s]."""
    return [(end - stage.duration, end) for stage, end in zip(program.stages, program.ends)
            if stage.phase == phase]


def _span(program, phase):
    """Return the first begin and the last end of a phase [s]."""
    spans = _spans(program, phase)
    return spans[0][0], spans[-1][1]


class Figures(NamedTuple):
    """
    What one run is judged by; forces along x of ft_sensor.

    Attributes
    ----------
    phantom_rms, phantom_peak : float
        Force fed back in free movement, where there is none [N].
    strayed : float
        How far the tool in free movement is from where the true force would have had it, RMS [m].
    peak : float
        Greatest true force from the first touch to the end of the first hold [N].
    bounces : int
        Times that contact was lost in that span.
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


def assess(run: ClosedLoopRun, ideal: ClosedLoopRun, program: Program) -> Figures:
    """Judge a run; ``ideal`` followed the same program with the true force and the same noise."""
    start, end = _span(program, 'free')
    free = run.feedback.between(start, end).values[:, 0]
    strayed = (run.tool.between(start, end).values - ideal.tool.between(start, end).values)
    held = _spans(program, 'contact')[0][1]
    touching = run.contact.between(_spans(program, 'approach')[0][0], held)
    force = -touching.values[:, 0]
    begin, bounces, settling, peak = np.nan, 0, np.nan, 0.0
    if (force > TOUCH).any():
        first = int(np.argmax(force > TOUCH))
        begin, force = touching.t[first], force[first:]
        bounces, peak = losses(force > 0.0), float(force.max())
        settling = settling_time(touching.t[first:], force) - begin
    pressed = run.feedback.between(*_span(program, 'contact'))
    truth = run.contact.at(pressed.t)[:, 0]
    return Figures(
        rms(free), float(np.abs(free).max()), rms(strayed), peak, bounces, float(settling),
        rms(pressed.values[:, 0] - truth), float(-truth.mean()))


def rms(values: Array) -> float:
    """Return the root mean square; infinite for what has run away."""
    with np.errstate(over='ignore'):
        return float(np.sqrt(np.mean(np.square(values))))


def losses(touching: NDArray[np.bool_]) -> int:
    """Count the changes from true to false."""
    return int(np.count_nonzero(touching[:-1] & ~touching[1:]))


def settling_time(t: Array, force: Array) -> float:
    """
    Return the time from which a force stays within its band; NaN: not even in the last tenth.

    Parameters
    ----------
    t, force : ndarray, shape (n,)
        [s], [N]
    """
    tenth = max(1, len(force) // 10)
    final = float(force[-tenth:].mean())
    outside = np.abs(force - final) > max(SETTLED * abs(final), SETTLED_FLOOR)
    if outside[-tenth:].any():
        return float('nan')
    last = int(np.flatnonzero(outside)[-1]) + 1 if outside.any() else 0
    return float(t[last])
