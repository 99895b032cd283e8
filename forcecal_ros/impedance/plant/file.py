"""The file ``plant.yaml``: models of robot and slide, checked when it is read."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from forcecal_ros.atomic_files import write_text
from forcecal_ros.calibration.document import plain
from forcecal_ros.calibration.model import Estimate
from forcecal_ros.errors import ConfigError
from forcecal_ros.impedance.plant.fit import PlantFit
from forcecal_ros.impedance.plant.model import Plant, Robot, Slide
from forcecal_ros.impedance.plant.state_space import state_space
from forcecal_ros.safe_yaml import LARGEST, load_yaml
import numpy as np
import yaml

FORMAT = 'forcecal-plant/1'


def to_document(fit: PlantFit) -> dict[str, Any]:
    """
    Turn an identified plant into plain dicts, lists, numbers and words.

    Parameters
    ----------
    fit : PlantFit

    Returns
    -------
    dict
        What ``plant.yaml`` holds and ``--json`` prints.
    """
    robot, slide, found = fit.robot.robot, fit.slide.slide, fit.robot
    continuous = state_space(fit.plant)
    document: dict[str, Any] = plain({
        'format': FORMAT,
        'robot': {'period': robot.period, 'delay': robot.delay, 'feedback': robot.feedback,
                  'feedforward': robot.feedforward},
        'slide': {'mass': slide.mass, 'stiffness': slide.stiffness, 'damping': slide.damping},
        'quality': {
            'fit': found.fit, 'error': found.error, 'offset': found.offset,
            'static_gain': robot.static_gain,
            'orders': [order._asdict() for order in found.orders],
            'cancelling_pairs': [
                {'pole': _complex(pair.pole), 'zero': _complex(pair.zero), 'effect': pair.effect}
                for pair in found.pairs],
            'windows': fit.slide.windows, 'spring_error': fit.slide.spring_error,
            'inertia_error': fit.slide.inertia_error},
        'state_space': continuous._asdict() if continuous else 'has no continuous form',
    })
    return document


def _complex(number: complex) -> list[float]:
    return [number.real, number.imag]


def save_plant(fit: PlantFit, path: Path | str) -> None:
    """
    Write ``plant.yaml``; one that is there is kept as ``plant.yaml~``.

    Parameters
    ----------
    fit : PlantFit
    path : Path or str

    Raises
    ------
    ConfigError
        The place cannot be written to.
    """
    write_text(path, yaml.safe_dump(to_document(fit), sort_keys=False, width=99))


def load_plant(path: Path | str | None = None) -> Plant:
    """
    Read ``plant.yaml``.

    Parameters
    ----------
    path : Path or str, optional
        What was identified on the nominal rig where none is given.

    Returns
    -------
    Plant

    Raises
    ------
    ConfigError
        The file cannot be read, or is none of ``forcecal identify-robot``.
    """
    name = 'plant.yaml' if path is None else str(path)
    source = files('forcecal_ros') / 'config' / name if path is None else Path(path)
    try:
        with source.open('rb') as file:
            document = load_yaml(file.read(LARGEST + 1), name)
    except OSError as error:
        raise ConfigError(f'{name}: cannot be read ({error.strerror}); give a file of forcecal '
                          'identify-robot') from error
    try:
        if document['format'] != FORMAT:
            raise ConfigError(f'{name}: format {document["format"]!r}, expected {FORMAT!r}')
        robot, slide = document['robot'], document['slide']
        return Plant(
            Robot(float(robot['period']), int(robot['delay']), _estimate(robot['feedback'], 1),
                  _estimate(robot['feedforward'], 1)),
            Slide(*(_estimate(slide[key], 0) for key in ('mass', 'stiffness', 'damping'))))
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f'{name}: no plant ({error!r}); give a file of forcecal '
                          'identify-robot') from error


def _estimate(entry: Mapping[str, Any], dimensions: int) -> Estimate:
    value = np.array(entry['value'], dtype=float)
    if value.ndim != dimensions or not value.size or not np.isfinite(value).all():
        raise ValueError(f'{entry["value"]!r} where '
                         f'{"a list of numbers" if dimensions else "a number"} is expected')
    std = entry['std']
    return Estimate(value, np.nan if std is None else std, str(entry['unit']))
