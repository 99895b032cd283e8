"""A plan as parameters that the sequencer runs."""

from collections.abc import Mapping
from typing import Any

from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import Timing
from forcecal_ros.motion.poses import flatten_poses, POSE_LENGTH
from forcecal_ros.motion.profiles import Pace, Pose
from forcecal_ros.schema import parameters_of
from forcecal_ros.schema.plain import yaml_value


def sequencer_parameters(sequence: str, poses: Mapping[str, Pose], timing: Timing, pace: Pace,
                         limits: Limits, heading: str) -> str:
    """
    Return a parameter file, YAML, with the poses and all that differs from the defaults.

    Parameters
    ----------
    heading : str
        Comment at its top.
    """
    numbers = [round(x, 12) + 0.0 for x in flatten_poses(poses)]
    rows = [yaml_value(numbers[i:i + POSE_LENGTH])[1:-1]
            for i in range(0, len(numbers), POSE_LENGTH)]
    comment = ''.join(f'# {line}'.rstrip() + '\n' for line in heading.splitlines())
    return (f'{comment}/**/sequencer:\n  ros__parameters:\n    sequence: {sequence}\n    poses:\n'
            f'      names: {yaml_value(list(poses))}\n      values: [\n        '
            + ',\n        '.join(rows) + ']\n'
            + _group('timing', timing, Timing()) + _group('pace', pace, Pace())
            + _group('limits', limits, Limits()))


def _group(name: str, section: Any, usual: Any) -> str:
    """Return the parameters of a section that are not at their default."""
    given = [(p.name.partition('.')[2], p.default) for p, other in zip(
        parameters_of(name, section), parameters_of(name, usual)) if p.default != other.default]
    return ''.join([f'    {name}:\n' * bool(given),
                    *(f'      {key}: {yaml_value(value)}\n' for key, value in given)])
