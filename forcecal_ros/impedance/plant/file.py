"""The file ``plant.yaml``: models of robot and slide, checked when it is read."""

from importlib.resources import files
from pathlib import Path
from typing import Any, TYPE_CHECKING

from forcecal_ros.core.files import write_text
from forcecal_ros.core.schema import load, plain
from forcecal_ros.impedance.plant.model import Plant, state_space
import yaml

if TYPE_CHECKING:  # a node that reads a plant does not load how one is identified
    from forcecal_ros.impedance.plant.fit import PlantFit

FORMAT = 'forcecal-plant/1'


def to_document(fit: 'PlantFit') -> dict[str, Any]:
    """Return the content of ``plant.yaml``, which ``--json`` prints too."""
    found = fit.robot
    continuous = state_space(fit.plant)
    document: dict[str, Any] = plain({
        'format': FORMAT,
        **plain(fit.plant),
        'quality': {
            'fit': found.fit, 'error': found.error, 'offset': found.offset,
            'static_gain': found.robot.static_gain,
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


def save_plant(fit: 'PlantFit', path: Path | str) -> None:
    """
    Write ``plant.yaml``; an existing one is kept as ``plant.yaml~``.

    Raises
    ------
    ConfigError
        The file cannot be written.
    """
    write_text(path, yaml.safe_dump(to_document(fit), sort_keys=False, width=99))


def load_plant(path: Path | str | None = None) -> Plant:
    """
    Read ``plant.yaml``.

    Parameters
    ----------
    path : Path or str, optional
        By default what was identified on the nominal rig.

    Raises
    ------
    ConfigError
        The file cannot be read, or is none of ``forcecal identify-robot``.
    """
    name = 'plant.yaml' if path is None else str(path)
    source = files('forcecal_ros') / 'config' / name if path is None else Path(path)
    return load(Plant, source, name=name, form=FORMAT, extra=True,
                remedy='give a file of forcecal identify-robot')
