"""
Calibrate wrist force/torque sensors, estimate contact forces, and explain sim-to-real gaps.

>>> import forcecal_ros as fc
>>> recording = fc.read('my_bag')
>>> calibration = fc.calibrate(recording)
>>> contact = fc.estimate(recording, calibration)
>>> gap = fc.diagnose(recording, against=calibration)
"""

from importlib import import_module
import sys
from types import ModuleType
from typing import Any

__version__ = '0.1.0'

API = ('calibrate', 'check', 'diagnose', 'estimate', 'load', 'read', 'Result', 'save', 'simulate')
"""Names of :mod:`forcecal_ros.api`, which is loaded when the first of them is used."""


class _Package(ModuleType):
    """Keeps the functions of the API under names that subpackages have, too."""

    def __setattr__(self, name: str, value: object) -> None:
        if name not in API or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name in API:
        return getattr(import_module('forcecal_ros.api'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return sorted([*globals(), *API])
