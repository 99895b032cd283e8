"""The rig file (YAML), the rig's URDF, and its true calibration."""

from collections.abc import Iterator
from importlib.resources import files
from itertools import takewhile
from math import sqrt
from pathlib import Path
import sys

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import columns, load, Section, yaml_value
from forcecal_ros.effects.library import Chosen, chosen_effects, EFFECTS, named_effects
from forcecal_ros.effects.rig import AccelerometerModel, physical_rig, Rig
from forcecal_ros.motion.optimal_design import Sensors
import numpy as np

_EXAMPLE: Chosen = chosen_effects({'wrench_delay': {'delay': 0.004}})
"""What a file without effects shows as a comment."""


def load_rig(path: Path | str | None = None) -> Rig:
    """
    Read and check a rig file.

    Parameters
    ----------
    path : Path or str, optional
        The nominal rig of this package where none is given. A bare name of a file that is not
        there is looked for among the rigs of this package (``rig.yaml``, ``rigid_tool.yaml``,
        ``rehearsal.yaml``).

    Raises
    ------
    ConfigError
        The file is missing or no YAML; a key is missing, unknown, or its value is wrong.
    """
    name = 'rig.yaml' if path is None else str(path)
    packaged = files('forcecal_ros') / 'config' / name
    take_packaged = path is None or (
        Path(name).name == name and not Path(name).exists() and packaged.is_file())
    return load(Rig, packaged if take_packaged else Path(name), name=name,
                remedy='compare with config/rig.yaml, the nominal rig')


def dump_rig(rig: Rig, heading: str = '') -> str:
    """
    Return the text of a rig file, each number with its unit as comment.

    ``heading`` is comment for its beginning; :func:`load_rig` reads an equal rig back.
    """
    return '\n'.join([heading, *_lines(rig, '')]).lstrip() + '\n'


def rewritten(path: Path) -> str:
    """Return a rig file under its own heading, with what the rows say now as comments."""
    heading = ''.join(takewhile(lambda line: line.startswith('#'),
                                path.read_text().splitlines(keepends=True)))
    return dump_rig(load_rig(path), heading)


def _lines(section: Section, indent: str) -> Iterator[str]:
    for column in columns(type(section)):
        value, row, start = getattr(section, column.name), column.row, indent + column.key
        if column.name == 'effects':
            yield from _effect_lines(value)
        elif value is None and row.omit:
            continue
        elif column.holds_sections:
            note = row.meaning or column.kind.__doc__.split('\n')[0].rstrip('.')
            yield from [] if indent else ['']
            yield f'{start}:{" null" * (value is None)}'.ljust(25) + f' # {note}'
            yield from [] if value is None else _lines(value, indent + '  ')
        else:
            note = ', '.join(filter(None, (row.unit, row.meaning)))
            yield from [] if indent else ['']
            yield f'{start}: {yaml_value(value)}'.ljust(44) + f' # {note}'


def _effect_lines(chosen: Chosen) -> Iterator[str]:
    comment = '' if chosen else '# '
    yield ''
    yield f'{comment}effects:'.ljust(25) + (
        ' # in what the rig differs from the above; docs/reference/effects.md lists them')
    for name, values in named_effects(chosen or _EXAMPLE).items():
        effect = EFFECTS[name]
        yield f'{comment}  {name}:'.ljust(25) + f' # {effect.stage}'
        for q in effect.parameters:
            yield f'{comment}    {q.name}: {yaml_value(values[q.name])}'.ljust(44) + \
                f' # {q.unit}'


def _visual(shape: str, centre: Array | tuple[float, ...], colour: str) -> str:
    x, y, z = centre
    return (f'    <visual>\n      <origin xyz="{x:g} {y:g} {z:g}" rpy="0 0 0"/>\n'
            f'      <geometry>{shape}</geometry>\n'
            f'      <material name="{colour}"/>\n    </visual>')


def _inertial(mass: float, com: Array, J: Array) -> str:
    x, y, z = com
    pairs = ' '.join(f'i{"xyz"[i]}{"xyz"[j]}="{J[i, j]:g}"' for i, j in zip(*np.triu_indices(3)))
    return (f'    <inertial>\n      <origin xyz="{x:g} {y:g} {z:g}"/>\n'
            f'      <mass value="{mass:g}"/>\n      <inertia {pairs}/>\n    </inertial>')


def urdf(rig: Rig) -> str:
    """Return the URDF of what hangs on the sensor of a rig."""
    # of the joint, either way: twice what the nominal tool's weight bends its spring [m]
    travel = 0.05
    tool, com, tip = rig.tool, np.array(rig.tool.com), np.array(rig.tool.tip)
    size = 2 * np.abs(com[:2]) + 0.1
    body = f'<box size="{size[0]:g} {size[1]:g} {2 * com[2]:g}"/>'
    joint = 'prismatic' if rig.optidrive is not None else 'fixed'
    limit = ('' if joint == 'fixed' else '\n    <axis xyz="1 0 0"/>\n    '
             f'<limit lower="{-travel}" upper="{travel}" effort="500" velocity="1"/>')
    return '\n'.join((
        '<?xml version="1.0"?>', '<robot name="rig">',
        '  <material name="steel"><color rgba="0.6 0.6 0.65 1"/></material>',
        '  <material name="tool"><color rgba="0.3 0.5 0.8 0.7"/></material>',
        '  <link name="ft_sensor">',
        _visual('<cylinder radius="0.05" length="0.04"/>', (0, 0, -0.02), 'steel'),
        '  </link>',
        f'  <joint name="optidrive" type="{joint}">',
        f'    <parent link="ft_sensor"/>\n    <child link="tool"/>{limit}', '  </joint>',
        '  <link name="tool">', _inertial(tool.mass, com, np.array(tool.inertia)),
        _visual(body, com, 'tool'),
        _visual('<sphere radius="0.01"/>', tip, 'steel'), '  </link>',
        '  <link name="tip"/>',
        '  <joint name="tip" type="fixed">',
        '    <parent link="tool"/>\n    <child link="tip"/>',
        f'    <origin xyz="{tip[0]:g} {tip[1]:g} {tip[2]:g}"/>', '  </joint>',
        '</robot>')) + '\n'


if __name__ == '__main__':
    sys.stdout.write(urdf(load_rig(sys.argv[1] if len(sys.argv) > 1 else None)))


def true_calibration(rig: Rig, accelerometer: str | None = None) -> dict[str, Array]:
    """
    Return the true value of everything that is identified.

    Parameters
    ----------
    rig : Rig
        Of its effects, those that change numbers of tool and wall count.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.

    Returns
    -------
    dict of str to ndarray
        By key of ``calibration.yaml``, as ``accelerometer.gain``; SI units, ft_sensor.
    """
    rig = physical_rig(rig)
    name = accelerometer or rig.accelerometer.mounted
    model: AccelerometerModel = getattr(rig.accelerometer, name)
    truth: dict[str, object] = {
        'mass': rig.tool.mass,
        'com': rig.tool.com,
        'inertia': rig.tool.inertia,
        'wrench_bias': rig.wrench_sensor.bias,
        'accelerometer.offset': model.offset,
        'accelerometer.gain': model.gain,
        'accelerometer.map': np.eye(3),
        'accelerometer.delay': 0.0,
    }
    if rig.optidrive is not None:
        truth['tool.stiffness'] = rig.optidrive.stiffness
        truth['tool.damping'] = rig.optidrive.damping
    return {key: np.array(value, dtype=float) for key, value in truth.items()}


def expected_sensors(rig: Rig) -> Sensors:
    """Return mass, centre of mass and noise densities of a rig."""
    wrench, accelerometer = rig.wrench_sensor, rig.accelerometer
    return Sensors(
        rig.tool.mass, np.array(rig.tool.com), wrench.force_noise / sqrt(wrench.rate),
        wrench.torque_noise / sqrt(wrench.rate), accelerometer.noise / sqrt(accelerometer.rate),
        float(np.abs(accelerometer.model().gain).mean()), float(np.linalg.norm(rig.gravity)))
