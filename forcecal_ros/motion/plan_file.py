"""Plans as documents, and as parameters that the sequencer runs."""

from collections.abc import Mapping
from typing import Any

from forcecal_ros.core.parameters import parameters_of
from forcecal_ros.core.quantity import size, sizes
from forcecal_ros.core.schema import yaml_value
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.optimal_design import Design, GROUPS, Robot
from forcecal_ros.motion.plan import Timing
from forcecal_ros.motion.poses import flatten_poses, POSE_LENGTH
from forcecal_ros.motion.profiles import Pace, Pose


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


def as_text(design: Design) -> str:
    """Return the predicted standard errors as a table."""
    lines = [f'{"parameter":12}  predicted standard error (x y z)']
    lines += [f'{name:12}  {sizes(design.errors.std(name).tolist(), _unit(design, name) or "1")}'
              for name in design.errors.names]
    what = (f'{len(design.poses)} poses of {size(design.timing.measure, "s")}, '
            f'step {size(design.timing.step_distance, "m")}')
    return '\n'.join([*lines, '', what])


def to_document(design: Design) -> dict[str, Any]:
    """Return it as a dictionary."""
    return {'format': 'forcecal-plan/1', 'for': 'calibration', 'duration': design.duration,
            'poses': {name: {'position': pose.position.tolist(),
                             'R_base_sensor': pose.R_base_sensor.tolist()}
                      for name, pose in design.poses.items()},
            'measure': design.timing.measure,
            'std': {name: {'value': design.errors.std(name).tolist(),
                           'unit': _unit(design, name)} for name in design.errors.names}}


def to_parameters(design: Design, robot: Robot) -> str:
    """Return it as a parameter file of the sequencer, the table in its comments."""
    return sequencer_parameters(
        'calibrate', design.poses, design.timing, design.robot.pace, robot.limits,
        f'Recording for forcecal calibrate, about {design.duration:g} s.\n{as_text(design)}')


def _unit(design: Design, name: str) -> str:
    unit = GROUPS[name][0]
    if unit:
        return unit
    volts = design.sensors.gain != 1.0
    return {'offset': ('m/s^2', 'V'), 'gain': ('', 'V/(m/s^2)')}[name][volts]
