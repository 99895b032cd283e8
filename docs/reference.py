"""Write the pages of docs/reference that follow from the code: ``python docs/reference.py``."""

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
import re

from forcecal_ros.cli import COMMANDS, GROUPS
from forcecal_ros.cli.main import build_parser
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.nodes.config import TABLES
from forcecal_ros.observe.sample import describe, Status

EVERYWHERE = ('-h', '--json', '--quiet', '--debug', '--namespace', '--timeout', '--jobs', '--dask')
"""Options of (nearly) every command, described once."""

FOLDER = Path(__file__).with_name('reference')

TOPICS = """
## Topics and services

Names are relative: `observer/contact_wrench` in the namespace `/left` is `/left/observer/contact_wrench`. What a node publishes and serves is
private to it (`~/phase`), so `-r __node:=left` has `left/phase`. *latched* is RELIABLE and TRANSIENT_LOCAL with depth 1; *sensor* is BEST_EFFORT
with depth 100 or more; *reliable* is RELIABLE with depth 10, of the rig's sensors 200.

| node | direction | topic | type | QoS | rate, frame |
|---|---|---|---|---|---|
| sequencer | subscribes | `wrench` | geometry_msgs/WrenchStamped | sensor | sensor frame |
| | subscribes | `accelerometer/raw` or `imu/data_raw` or `accel` | Vector3Stamped (V), sensor_msgs/Imu, AccelStamped | sensor | own frame |
| | subscribes | `current_pose` | PoseStamped | sensor | base |
| | subscribes | `optidrive` | sensor_msgs/JointState | sensor | displacement of a compliant axis [m] |
| | subscribes | `deadman` | std_msgs/Header | sensor | with `motion.deadman_timeout` |
| | publishes | `target_frame` or `joint_trajectory` or `delta_twist_cmds` | PoseStamped, JointTrajectory, TwistStamped | reliable | `motion.rate`, base |
| | publishes | `sequencer/phase` | diagnostic_msgs/DiagnosticArray | reliable | on change and 1 Hz |
| | publishes | `sequencer/state` | std_msgs/String | reliable | the same word |
| | publishes | `sequencer/planned_path`, `sequencer/markers` | nav_msgs/Path, MarkerArray | latched | after a preview |
| | publishes | `sequencer/calibration` | std_msgs/String | latched | calibration YAML |
| | publishes | `sequencer/observer_gain` | std_msgs/Float64MultiArray | latched | K, 2 x 3 |
| | publishes | `sequencer/tool_inertia` | geometry_msgs/InertiaStamped | latched | sensor frame |
| | serves | `sequencer/preview`, `/start`, `/abort`, `/save_calibration` | std_srvs/Trigger | | |
| observer (lifecycle) | subscribes | `wrench`, `accelerometer/raw` or `imu/data_raw` or `accel`, `current_pose`, `optidrive` | as above | sensor | |
| | subscribes | `sequencer/calibration` | std_msgs/String | latched | |
| | subscribes | `observer/tool` | InertiaStamped | latched | with `tool: tracked` |
| | publishes | `observer/contact_wrench` | WrenchStamped | reliable | each wrench; sensor frame, about its origin |
| | publishes | `observer/inertial_wrench`, `observer/innovation` | WrenchStamped | reliable | if enabled |
| | publishes | `observer/contact_wrench/FRAME` | WrenchStamped | reliable | `publish.frames` |
| | publishes | `observer/accuracy` | std_msgs/Float64MultiArray | latched | covariance of the error |
| | publishes | `observer/tool` | InertiaStamped | latched | with `payload.track` |
| | publishes | `observer/markers` | MarkerArray | reliable | `publish.marker_rate` |
| | serves | `observer/tare`, `/reset`, `/reload_calibration` | std_srvs/Trigger | | |
| sim | subscribes | `target_frame` | PoseStamped | sensor | 250 Hz |
| | publishes | `wrench`, `accelerometer/raw`, `current_pose`, `optidrive`, `sim/contact_wrench`; `imu/data_raw` and `/clock` if enabled | | reliable | rates of the rig |
| gap | subscribes | `target_frame`, `wrench`, `accelerometer/raw` or `imu/data_raw` or `accel`, `current_pose`, `optidrive` | as above | sensor | |
| | publishes | `/diagnostics` | DiagnosticArray | reliable | 1 Hz: excess of each channel in noise RMS |
| | serves | `gap/reset` | std_srvs/Trigger | | |
| impedance | subscribes | `wrench`, `observer/contact_wrench`, `current_pose`, `optidrive`, `deadman` | | sensor | |
| | publishes | `target_frame`, `impedance/phase`, `impedance/state` | | reliable | `motion.rate` |
| | serves | `impedance/start`, `/abort` | std_srvs/Trigger | | |

All nodes publish `/diagnostics` at 1 Hz. Words of a phase: `idle` `settle` `move` `measure` `step` `sweep` `reverse` `approach` `contact` `retract`
`done` `aborted`; the last one with its reason.
"""


def nodes() -> Iterator[str]:
    """Yield the page of the nodes: topics, status bits and every parameter."""
    yield ('# Nodes\n\nThis page lists topics, services, status bits and parameters of all nodes. The parameters are '
           'generated from the code, each with its default and range; `ros2 param describe` prints the same.\n' + TOPICS)
    yield '\n## Status bits of the observer\n\n| bit | name | meaning |\n|--:|---|---|\n'
    yield from (f'| {bit.value} | {bit.name} | {describe(bit.value)[0]} |\n'
                for bit in Status if bit.value)
    users: dict[Parameter, list[str]] = {}
    for node, (table, _) in TABLES.items():
        for row in table:
            users.setdefault(row._replace(default=str(row.default)), []).append(node)
    yield '\n## Parameters of several nodes\n\n'
    yield from (_parameter(row, row.name, f' Of {", ".join(names)}.')
                for row, names in users.items() if len(names) > 1)
    for node in TABLES:
        alike: dict[Parameter, list[str]] = {}  # one row for the same fault of several sensors
        for row in (row for row, names in users.items() if names == [node]):
            words = re.sub(r'of the sensor \w+,', 'of a sensor,', row.description)
            name = row.name if words == row.description else ''
            alike.setdefault(row._replace(name=name, description=words), []).append(row.name)
        yield f'\n## Parameters of {node}\n\n'
        yield from (_parameter(row, '`, `'.join(names)) for row, names in alike.items())


def _parameter(row: Parameter, names: str, more: str = '') -> str:
    words = ', '.join(f'`{word}`' if word else "`''`" for word in row.choices)
    default = row.default if len(row.default) <= 30 else f'{row.default[:27]}...'
    default = f'{default} {row.unit}'.strip() if default else 'empty'
    limits = words or row.row.range().removeprefix('from ')
    return f'- `{names}`: {default}{f" ({limits})" if limits else ""}. {row.description}.{more}\n'


def commands() -> Iterator[str]:
    """Yield the page of the commands: every option with its help."""
    yield ('# Commands\n\nThis page lists every command of `forcecal` with its options. It is generated from the code; '
           '`forcecal COMMAND --help` prints the same with an example.\n\nEvery command that computes has `--json` (print the result as JSON) and '
           '`--quiet` (no progress). Commands that talk to running nodes have `--namespace NAME` and '
           '`--timeout S`; commands that take many recordings have `--jobs N` and `--dask ADDRESS`. `--debug` shows the traceback of an error. Exit status: 0 done, 1 the data '
           'cannot answer, 2 wrong usage, 3 found what `--fail-on` names.\n')
    parsers = {name: build_parser(name).commands[name] for name in COMMANDS}
    rows = {name: [row for action in parser._actions if action.help != argparse.SUPPRESS
                   and not set(EVERYWHERE) & set(action.option_strings)
                   for row in _rows(action)]
            for name, parser in parsers.items()}
    users = Counter(row for own in rows.values() for row in own)
    shared = {row.partition(':')[0]: row for row, n in reversed(users.most_common()) if n > 1}
    yield '\n## Options of several commands\n\n'
    yield from reversed(shared.values())
    for purpose, group in GROUPS.items():
        yield f'\n## {purpose[0].upper()}{purpose[1:]}\n'
        for name in group:
            summary = COMMANDS[name].summary
            yield f'\n### {name}\n\n{summary[0].upper()}{summary[1:]}.'
            also = [re.findall(r'--[a-z-]+|`[A-Z.]+`', row)[0].strip('`')
                    for row in rows[name] if row in shared.values()]
            yield f' Takes {", ".join(f"`{one}`" for one in also)} as above.\n' if also else '\n'
            if own := [row for row in rows[name] if row not in shared.values()]:
                yield '\n'
                yield from own


def _rows(action: argparse.Action) -> Iterator[str]:
    if isinstance(action.choices, dict):  # verbs, with an option of their own at most
        for verb, parser in action.choices.items():
            options = [name for one in parser._actions for name in one.option_strings
                       if name.startswith('--') and name not in EVERYWHERE and name != '--help']
            yield (f'- `{" ".join([verb, *(f"[{name}]" for name in options)])}`: '
                   f'{parser.description.rstrip(".")}\n')
    else:
        yield _row(action)


def _row(action: argparse.Action) -> str:
    shown = action.metavar or (
        '{' + ','.join(map(str, action.choices)) + '}' if action.choices else action.dest.upper())
    if isinstance(shown, tuple):
        shown = ' '.join(shown)
    if action.option_strings:
        value = '' if action.nargs == 0 else f' {shown}'
        name = ', '.join(action.option_strings) + value
    else:
        name = str(shown)
    text = (action.help or '').replace('%(default)s', str(action.default)).replace('%%', '%')
    return f'- `{name}`: {" ".join(text.split())}\n'


PAGES = {'nodes.md': nodes, 'commands.md': commands}
"""Name of a page and what writes it."""


def main() -> None:
    """Write all pages."""
    for name, page in PAGES.items():
        (FOLDER / name).write_text(''.join(page()))


if __name__ == '__main__':
    main()
