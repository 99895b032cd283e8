"""The imports of the package, as the picture of its rooms in docs/ reads them."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

_SCRIPT = Path(__file__).resolve().parents[2] / 'docs' / 'architecture.py'
_spec = spec_from_file_location('architecture', _SCRIPT)
assert _spec is not None and _spec.loader is not None
architecture = module_from_spec(_spec)
_spec.loader.exec_module(architecture)

PACKAGE, PATHS, room = architecture.PACKAGE, architecture.PATHS, architecture.room
imported_by, tree = architecture.imported_by, architecture.tree
