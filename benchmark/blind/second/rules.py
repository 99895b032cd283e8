"""What a part is drawn by: that of the first part, and that which openings have mended since."""

from collections.abc import Mapping
import importlib
import importlib.util
import math
import os
from pathlib import Path
import sys
from types import MappingProxyType, ModuleType
from typing import NamedTuple

from blind.cases import LIBRARY
from blind.effect import Effect
from blind.second import kinds_development
from blind.second.laid import ON_WRENCH
from blind.second.law import Kind

DEVELOPMENT, SEALED, SECOND = 'development', 'sealed', 'sealed-2'
ALIKE = ('sealed-3', 'sealed-4')
"""Sealed halves of one rule; a later one is ``sealed-N``, its kinds in ``kinds_sealed_N.py``."""
ASIDE = 'BLIND_SEALED'
"""Variable of the folder that a sealed half is in before its opening."""


class Rules(NamedTuple):
    """
    Shares and limits that PROTOCOL.md states.

    Attributes
    ----------
    bare : mapping of str to float
        Generator -> share without background.
    begun : float
        Share of a sensor's effects that begin half-way.
    limits : mapping of (generator, effect) to float
        Largest sizes where the generator's own go further.
    touchless : mapping of str to tuple of str
        Effect -> its further aliases where a generator has no contact.
    mended : bool
        Whether energies count from the begin of an effect on, limits hold the whole of it, and
        labels have the shrink in the measure that the tool states.
    sound : bool
        Whether laws are drawn again until they are sound (``case._law``), and no one of them is
        beyond what a sensor can have.
    """

    bare: Mapping[str, float]
    begun: float
    limits: Mapping[tuple[str, str], float]
    touchless: Mapping[str, tuple[str, ...]]
    mended: bool
    sound: bool = False


def _everywhere(share: float) -> Mapping[str, float]:
    return MappingProxyType(dict.fromkeys(('rig', 'arm', 'real'), share))


FIRST = Rules(_everywhere(0.2), 0.1, MappingProxyType({}), MappingProxyType({}), False)
MENDED = Rules(_everywhere(0.25), 0.2, MappingProxyType({
    # the library takes at most half of a tool's mass off it, and no first edition's tilt is
    # beyond 5 deg, of which the protocol allows one and a half times
    ('real', 'tool_mass'): 0.5, ('arm', 'tool_mass'): 0.5,
    ('arm', 'base_tilt'): 1.5 * math.radians(5.0)}),
    MappingProxyType({'tool_com': ('wrench_crosstalk',)}), True)
THIRD = MENDED._replace(
    # without background at all only on the rig: elsewhere the model leaves something of its own
    bare=MappingProxyType({'rig': 0.35, 'arm': 0.1, 'real': 0.1}),
    limits=MappingProxyType({
        **MENDED.limits,
        # what a sensor can have, as everywhere: one and a half times the first edition's largest
        **{(generator, name): 1.5 * LIBRARY[name].high
           for generator in ('real', 'arm') for name in ON_WRENCH},
        # where the arm's centre of mass ends
        ('real', 'tool_com'): 0.06}),
    sound=True)
FIFTH = THIRD._replace(  # the arm in Drake is drawn as the one in MuJoCo is
    bare=MappingProxyType({**THIRD.bare, 'drake': THIRD.bare['arm']}),
    limits=MappingProxyType({**THIRD.limits, **{
        ('drake', name): largest for (generator, name), largest in THIRD.limits.items()
        if generator == 'arm'}}))


def rules_of(half: str) -> Rules:
    """Return what the cases of a half are drawn by."""
    return {SEALED: FIRST, SECOND: MENDED, **dict.fromkeys(ALIKE, THIRD)}.get(half, FIFTH)


def module_of(half: str) -> str:
    """Return the name of the module that has the kinds of a half."""
    return f'kinds_{half.replace("-", "_")}'


def file_of(half: str) -> Path:
    """Return where the kinds of a half are: here once it is opened, set aside before."""
    here = Path(__file__).with_name(f'{module_of(half)}.py')
    aside = os.environ.get(ASIDE)
    return Path(aside) / here.name if aside and not here.exists() else here


def _loaded(half: str) -> ModuleType:
    """Load the module of a half from where it is."""
    name, path = f'blind.second.{module_of(half)}', file_of(half)
    if path.parent == Path(__file__).parent:
        return importlib.import_module(name)
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise ModuleNotFoundError(name=name)
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[name]


def half(name: str) -> tuple[Mapping[str, Kind], Mapping[str, Effect]]:
    """Return the kinds of a half and its forms of library effects."""
    if name == DEVELOPMENT:
        return kinds_development.KINDS, {}
    module = _loaded(name)
    return module.KINDS, module.FORMS
