"""The generated files of ``config/``: ``python -m forcecal_ros.nodes.config``."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from forcecal_ros.core.parameters import Parameter, parameter_file
from forcecal_ros.nodes import gap, impedance, observer, sequencer, sim
from forcecal_ros.sim.rig.file import rewritten

TABLES: Mapping[str, tuple[tuple[Parameter, ...], str]] = {
    'gap': (gap.PARAMETERS, 'Parameters of the gap node, at their defaults.'),
    'impedance': (impedance.PARAMETERS,
                  'Parameters of the impedance node, at their defaults.'),
    'observer': (observer.PARAMETERS, 'Parameters of the observer, at their defaults.'),
    'sequencer': (sequencer.PARAMETERS,
                  ('Parameters of the sequencer, at their defaults: those of the nominal rig. '
                   'Before the first start on your robot, set limits.*, poses.* and '
                   'wrench.sign.')),
    'sim': (sim.PARAMETERS, ("Parameters of the simulated rig's node, at their defaults; the rig "
                             'itself is in rig.yaml.')),
}
"""Parameters of every node, and the first comment of their file."""

RIGS = ('rig.yaml', 'rigid_tool.yaml', 'rehearsal.yaml')
"""Rig files whose comments are generated; their numbers stay."""


def config_files(folder: Path) -> dict[str, str]:
    """Return the generated texts by name; ``folder`` holds the rig files."""
    return {**{f'{node}.yaml': parameter_file(node, table, heading)
               for node, (table, heading) in TABLES.items()},
            **{name: rewritten(folder / name) for name in RIGS}}


def main() -> int:
    """Write the files to the folder ``config`` of this package."""
    folder = Path(str(files('forcecal_ros') / 'config')).resolve()
    for name, text in config_files(folder).items():
        (folder / name).write_text(text)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
