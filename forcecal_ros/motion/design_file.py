"""A designed calibration as a table, a document, and parameters that the sequencer runs."""

from typing import Any

from forcecal_ros.motion.optimal_design import Design, GROUPS, Robot
from forcecal_ros.motion.plan_file import sequencer_parameters


def as_text(design: Design) -> str:
    """Return the predicted standard errors as a table."""
    lines = [f'{"parameter":12}  predicted standard error (x y z)']
    for name in design.errors.names:
        numbers = ' '.join(f'{one:.2g}' for one in design.errors.std(name))
        lines.append(f'{name:12}  {numbers} {_unit(design, name)}'.rstrip())
    what = (f'{len(design.poses)} poses of {design.timing.measure:g} s, '
            f'step {1e3 * design.timing.step_distance:g} mm')
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
