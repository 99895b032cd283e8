"""How well the parameters of somebody's simulator are known, where the user says it."""

from collections.abc import Mapping
from dataclasses import replace
import math
from pathlib import Path

from forcecal_ros.errors import ConfigError
from forcecal_ros.safe_yaml import load_yaml
from forcecal_ros.schema import instead
from forcecal_ros.simulators.third_party import ThirdParty


def with_priors(simulator: ThirdParty, path: str) -> ThirdParty:
    """
    Replace standard deviations of parameters by those of a file.

    Parameters
    ----------
    simulator : ThirdParty
    path : str
        YAML, ``name: sigma`` in the parameter's unit.

    Raises
    ------
    ConfigError
        The file cannot be read; a name is none of a parameter; a sigma is not above 0.
    """
    try:
        document = load_yaml(Path(path).read_bytes(), path)
    except OSError as error:
        raise ConfigError(f'--priors {path}: {error.strerror or error}') from None
    if not isinstance(document, Mapping) or not document:
        raise ConfigError(f'--priors {path}: expected lines of NAME: SIGMA, got '
                          f'{type(document).__name__}')
    units = {p.name: p.unit for p in simulator.parameters}
    for name, sigma in document.items():
        if name not in units:
            raise ConfigError(f'--priors {path}: {simulator.name} has no parameter {name}; '
                              + instead(name, units))
        if isinstance(sigma, bool) or not isinstance(sigma, (int, float)) or not (
                0.0 < sigma < math.inf):
            raise ConfigError(f'--priors {path}: {name}: got {sigma!r}, expected how well it is '
                              f'known, 1 sigma above 0 [{units[name]}]')
    return replace(simulator, parameters=tuple(
        p._replace(sigma=float(document.get(p.name, p.sigma))) for p in simulator.parameters))
