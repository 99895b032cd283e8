"""What a part is drawn by: that of the first part, and that which its opening has mended."""

from collections.abc import Mapping
import importlib
import math
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from blind.effect import Effect
from blind.second import kinds_development
from blind.second.law import Kind

DEVELOPMENT, SEALED = 'development', 'sealed'
"""A later sealed half is ``sealed-N``, its kinds in ``kinds_sealed_N.py``."""


class Rules(NamedTuple):
    """
    Shares and limits that PROTOCOL.md states.

    Attributes
    ----------
    bare, begun : float
        Shares without background, and of a sensor's effects that begin half-way.
    limits : mapping of (generator, effect) to float
        Largest sizes where the generator's own go further.
    touchless : mapping of str to tuple of str
        Effect -> its further aliases where a generator has no contact.
    mended : bool
        Whether energies count from the begin of an effect on, limits hold the whole of it, and
        labels have the shrink in the measure that the tool states.
    """

    bare: float
    begun: float
    limits: Mapping[tuple[str, str], float]
    touchless: Mapping[str, tuple[str, ...]]
    mended: bool


FIRST = Rules(0.2, 0.1, MappingProxyType({}), MappingProxyType({}), False)
MENDED = Rules(0.25, 0.2, MappingProxyType({
    # the library takes at most half of a tool's mass off it, and no first edition's tilt is
    # beyond 5 deg, of which the protocol allows one and a half times
    ('real', 'tool_mass'): 0.5, ('arm', 'tool_mass'): 0.5,
    ('arm', 'base_tilt'): 1.5 * math.radians(5.0)}),
    MappingProxyType({'tool_com': ('wrench_crosstalk',)}), True)


def rules_of(half: str) -> Rules:
    """Return what the cases of a half are drawn by."""
    return FIRST if half == SEALED else MENDED


def module_of(half: str) -> str:
    """Return the name of the module that has the kinds of a half."""
    return f'kinds_{half.replace("-", "_")}'


def file_of(half: str) -> Path:
    """Return where the kinds of a half are, once they are there."""
    return Path(__file__).with_name(f'{module_of(half)}.py')


def half(name: str) -> tuple[Mapping[str, Kind], Mapping[str, Effect]]:
    """Return the kinds of a half and its forms of library effects."""
    if name == DEVELOPMENT:
        return kinds_development.KINDS, {}
    module = importlib.import_module(f'blind.second.{module_of(name)}')
    return module.KINDS, module.FORMS
