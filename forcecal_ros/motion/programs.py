"""The sequences that the sequencer can run, by name."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from forcecal_ros.motion.diagnosis_plan import diagnosis_plan
from forcecal_ros.motion.plan import calibration_plan, contact_plan, Goal, Segment, Timing


class Program(NamedTuple):
    """
    A sequence that can be run.

    Attributes
    ----------
    plan : callable
        Makes the segments of goals, a goal away from the first, and timing.
    distance : callable
        How far away that one is along x of ft_sensor, from the timing [m].
    identifies : bool
        Whether a calibration is identified from it.
    """

    plan: Callable[[Mapping[str, Goal], Goal, Timing], tuple[Segment, ...]]
    distance: Callable[[Timing], float]
    identifies: bool


SEQUENCES: Mapping[str, Program] = {
    'calibrate': Program(calibration_plan, lambda timing: timing.step_distance, True),
    'contact': Program(contact_plan, lambda timing: timing.contact_distance, False),
    'diagnose': Program(diagnosis_plan, lambda timing: timing.contact_distance, False),
}
"""Every sequence by its name in the parameter ``sequence``."""
