"""The rig file (YAML), and the true calibration of a rig."""

from collections.abc import Iterator
from importlib.resources import files
from itertools import takewhile
from math import sqrt
from pathlib import Path

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
        The nominal rig of this package if it is None or ``nominal``. A bare name of a file that
        is not there is looked for among the rigs of this package (``rig.yaml``,
        ``rigid_tool.yaml``, ``rehearsal.yaml``).

    Raises
    ------
    ConfigError
        The file is missing or no YAML; a key is missing, unknown, or its value is wrong.
    """
    name = 'rig.yaml' if path in (None, 'nominal') else str(path)
    packaged = files('forcecal_ros') / 'config' / name
    take_packaged = path in (None, 'nominal') or (
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
        ' # how the rig differs from the above; docs/reference/effects.md lists them')
    for name, values in named_effects(chosen or _EXAMPLE).items():
        effect = EFFECTS[name]
        yield f'{comment}  {name}:'.ljust(25) + f' # {effect.stage}'
        for q in effect.parameters:
            yield f'{comment}    {q.name}: {yaml_value(values[q.name])}'.ljust(44) + \
                f' # {q.unit}'


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
