"""Write the pages of docs/reference that follow from the code: ``python docs/reference.py``."""

import argparse
import ast
from collections import Counter
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
import re
from typing import Any

from forcecal_ros.cli import COMMANDS, GROUPS
from forcecal_ros.cli.main import build_parser
from forcecal_ros.core.calibration import Calibration, Entry
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.core.schema import Column, columns, shape_of
from forcecal_ros.core.topics import CONTROLLERS, ROBOTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.nodes.config import TABLES
from forcecal_ros.observe.sample import describe, Status

EVERYWHERE = ('-h', '--json', '--quiet', '--debug', '--namespace', '--timeout', '--jobs', '--dask')
"""Options of (nearly) every command, described once."""

FOLDER = Path(__file__).with_name('reference')

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
SHARED = ROOT / 'forcecal_ros' / 'nodes' / 'launching.py'

TOPICS = """
## Topics and services

Names are relative: `observer/contact_wrench` in the namespace `/left` is `/left/observer/contact_wrench`. What a node publishes and serves is
private to it (`~/phase`), so `-r __node:=left` has `left/phase`. *latched* is RELIABLE and TRANSIENT_LOCAL with depth 1; *sensor* is BEST_EFFORT
with depth 100 or more; *reliable* is RELIABLE with depth 10, of the rig's sensors 200. A line lists types, QoS, rate and frame. The observer is a lifecycle node.

### Topics of sequencer

- subscribes `wrench`: geometry_msgs/WrenchStamped; sensor; `ft_sensor`
- subscribes `accelerometer/raw` or `imu/data_raw` or `accel`: geometry_msgs/Vector3Stamped [V], sensor_msgs/Imu, geometry_msgs/AccelStamped; sensor; its own
- subscribes `current_pose`: geometry_msgs/PoseStamped; sensor; base
- subscribes `optidrive`: sensor_msgs/JointState [m]; sensor
- subscribes `deadman`: std_msgs/Header; sensor; `motion.deadman_timeout`
- publishes `target_frame` or `joint_trajectory` or `delta_twist_cmds`: geometry_msgs/PoseStamped, trajectory_msgs/JointTrajectory, geometry_msgs/TwistStamped; reliable; `motion.rate`; that of `current_pose`
- publishes `sequencer/phase`: diagnostic_msgs/DiagnosticArray; reliable; on change, 1 Hz
- publishes `sequencer/state`: std_msgs/String; reliable; on change, 1 Hz
- publishes `sequencer/planned_path`, `sequencer/markers`: nav_msgs/Path, visualization_msgs/MarkerArray; latched; each preview; base
- publishes `sequencer/calibration`: std_msgs/String; latched; each result
- publishes `sequencer/observer_gain`: std_msgs/Float64MultiArray (K of Eq. 4); latched; each result
- publishes `sequencer/tool_inertia`: geometry_msgs/InertiaStamped; latched; each result; `ft_sensor`
- serves `sequencer/preview`, `/start`, `/abort`, `/save_calibration`: std_srvs/Trigger

### Topics of observer

- subscribes `wrench`: geometry_msgs/WrenchStamped; sensor; `ft_sensor`
- subscribes `accelerometer/raw` or `imu/data_raw` or `accel`: geometry_msgs/Vector3Stamped [V], sensor_msgs/Imu, geometry_msgs/AccelStamped; sensor; its own
- subscribes `current_pose`, `optidrive`: geometry_msgs/PoseStamped, sensor_msgs/JointState; sensor; base
- subscribes `sequencer/calibration`: std_msgs/String; latched
- subscribes `observer/tool`: geometry_msgs/InertiaStamped; latched; with `tool: tracked`; `ft_sensor`
- publishes `observer/contact_wrench`: geometry_msgs/WrenchStamped; reliable; each wrench; `ft_sensor`
- publishes `observer/inertial_wrench`, `observer/innovation`: geometry_msgs/WrenchStamped; reliable; each wrench, if enabled; `ft_sensor`
- publishes `observer/contact_wrench/FRAME`: geometry_msgs/WrenchStamped; reliable; each wrench; `publish.frames`
- publishes `observer/accuracy`: std_msgs/Float64MultiArray (covariance of the error); latched; each calibration
- publishes `observer/tool`: geometry_msgs/InertiaStamped; latched; with `payload.track`; `ft_sensor`
- publishes `observer/markers`: visualization_msgs/MarkerArray; reliable; `publish.marker_rate`; `ft_sensor`
- serves `observer/tare`, `/reset`, `/reload_calibration`: std_srvs/Trigger

### Topics of sim

- subscribes `target_frame`: geometry_msgs/PoseStamped; sensor; 250 Hz; `frames.base`
- publishes `wrench`, `sim/contact_wrench`: geometry_msgs/WrenchStamped; reliable; 1000 Hz; `frames.sensor`
- publishes `accelerometer/raw`: geometry_msgs/Vector3Stamped; reliable; 1000 Hz; `frames.accelerometer`
- publishes `current_pose`: geometry_msgs/PoseStamped; reliable; 250 Hz; `frames.base`
- publishes `optidrive`: sensor_msgs/JointState [m]; reliable; 1000 Hz
- publishes `imu/data_raw`, `/clock`: sensor_msgs/Imu, rosgraph_msgs/Clock; reliable; if enabled

### Topics of gap

- subscribes `target_frame`, `current_pose`: geometry_msgs/PoseStamped; sensor; 250 Hz; base
- subscribes `wrench`, `optidrive`: geometry_msgs/WrenchStamped, sensor_msgs/JointState; sensor; as the rig; `ft_sensor`
- subscribes `accelerometer/raw` or `imu/data_raw` or `accel`: geometry_msgs/Vector3Stamped [V], sensor_msgs/Imu, geometry_msgs/AccelStamped; sensor; as the rig; its own
- publishes `/diagnostics`: diagnostic_msgs/DiagnosticArray (excess of each channel in noise RMS); reliable; 1 Hz
- serves `gap/reset`: std_srvs/Trigger

### Topics of impedance

- subscribes `wrench`, `observer/contact_wrench`: geometry_msgs/WrenchStamped; sensor; `ft_sensor`
- subscribes `current_pose`, `optidrive`, `deadman`: geometry_msgs/PoseStamped, sensor_msgs/JointState, std_msgs/Header; sensor; base
- publishes `target_frame`: geometry_msgs/PoseStamped; reliable; 250 Hz; that of `current_pose`
- publishes `impedance/phase`, `impedance/state`: diagnostic_msgs/DiagnosticArray, std_msgs/String; reliable; on change, 1 Hz
- serves `impedance/start`, `/abort`: std_srvs/Trigger

`ft_sensor` is the frame of the wrench (`sensor.frame` of the calibration). Wrenches of the observer act on the tool and are about its origin. All nodes publish `/diagnostics` at 1 Hz. A phase is
`idle` `settle` `move` `measure` `step` `sweep` `reverse` `approach` `contact` `retract` `done` or `aborted`; the last one has its reason.
"""


def nodes() -> Iterator[str]:
    """Yield the page of the nodes: topics, status bits and every parameter."""
    yield ('# Nodes\n\nThis page lists topics, services, status bits and parameters of all nodes. The parameters are '
           'generated from the code; `ros2 param describe` prints the same.\n' + TOPICS)
    yield from launch_arguments()
    yield ('\n## Status bits of the observer\n\nThe status `observer` on `/diagnostics` has the text of each set bit in its message.\n\n')
    yield from (f'- {bit.value}, {bit.name}: {describe(bit.value)[0]}\n'
                for bit in Status if bit.value)
    users: dict[Parameter, dict[str, Parameter]] = {}  # the same but for the default
    for node, (table, _) in TABLES.items():
        for row in table:
            row = row._replace(default=str(row.default))
            users.setdefault(row._replace(default='', live=False), {})[node] = row
    together: dict[str, list[dict[str, Parameter]]] = {}
    for of in users.values():
        if len(of) > 1:
            together.setdefault(', '.join(of), []).append(of)
    for names, shared in together.items():
        yield f'\n## Parameters of {names}\n\n'
        for of in shared:
            first, *others = of.values()
            defaults = '' if all(row.default == first.default for row in others) else ''.join(
                f', `{row.default}` of {node}' for node, row in list(of.items())[1:])
            yield _parameter(first, first.name, defaults)
    for node in TABLES:
        alike: dict[Parameter, list[str]] = {}  # one row for the same fault of several sensors
        for row in (of[node] for of in users.values() if [*of] == [node]):
            words = re.sub(r'of the sensor \w+,', 'of a sensor,', row.description)
            name = row.name if words == row.description else ''
            alike.setdefault(row._replace(name=name, description=words), []).append(row.name)
        yield f'\n## Parameters of {node}\n\n'
        yield from (_parameter(row, '`, `'.join(names)) for row, names in alike.items())


def launch_arguments() -> Iterator[str]:
    """Yield the arguments of the launch files, read as text: ``launch`` is not on PyPI."""
    tree = ast.parse(SHARED.read_text())
    table = next(one.value for one in tree.body
                 if isinstance(one, ast.Assign) and ast.unparse(one.targets[0]) == 'TOPICS')
    topics = {name: topic for name, (topic, _) in ast.literal_eval(table).items()}
    yield '\n## Arguments of the launch files\n\n- '
    yield ', '.join(f'`{name}`' + f' (`{topic}`)' * (name != topic)
                    for name, topic in topics.items())
    yield ': names of topics; by default those of `robot` and `controller`, or the usual ones.\n- '
    parsed = {file.name.partition('.')[0]: ast.parse(file.read_text()) for file in FILES}
    nodes = [call.args[0] for one in (*parsed.values(), tree)
             for call in _calls(one, 'parameters_argument')]
    yield ', '.join(dict.fromkeys(f'`{node.value}_params`' for node in nodes
                                  if isinstance(node, ast.Constant)))
    yield ': parameter file of the node, with priority over those of `controller` and `robot`.\n'
    users: dict[str, list[str]] = {}
    for file, one in (('', tree), *parsed.items()):
        for call in _calls(one, 'DeclareLaunchArgument'):
            words = {word.arg: word.value for word in call.keywords}
            if isinstance(words['description'], ast.Constant):
                users.setdefault(_argument(call, words), []).append(file)
    for row, files in users.items():
        yield row + f' Of {", ".join(files)}.' * any(files) + '\n'


def _calls(tree: ast.Module, function: str) -> list[ast.Call]:
    return [one for one in ast.walk(tree) if isinstance(one, ast.Call)
            and ast.unparse(one.func) == function]


def _argument(call: ast.Call, words: dict[str | None, ast.expr]) -> str:
    choices = eval(ast.unparse(words['choices']),  # noqa: S307  of this package's own source
                   {'ROBOTS': ROBOTS, 'CONTROLLERS': CONTROLLERS}) if 'choices' in words else ()
    listed = ', '.join(f'`{word}`' for word in choices if word)
    return (f'- `{ast.literal_eval(call.args[0])}`{f" ({listed})" * bool(listed)}: '
            f'{ast.literal_eval(words["description"])}.')


def _parameter(row: Parameter, names: str, others: str = '') -> str:
    listed = all(f'{word}: ' in row.description for word in row.choices)
    words = ', '.join(f'`{word}`' if word else "`''`" for word in row.choices if not listed)
    default = f'`{row.default}` {row.unit}'.strip() if row.default else 'empty'
    if len(row.default) > 30:
        default = f'{len(row.default.split(","))} values, listed under `config/`'
    limits = words or row.row.range().removeprefix('from ').replace(' to ', '..')
    return (f'- `{names}`: {default}{others}{f" ({limits})" if limits else ""}. '
            f'{row.description}.\n')


def commands() -> Iterator[str]:
    """Yield the page of the commands: every option with its help."""
    yield ('# Commands\n\nThis page lists every command of `forcecal` with its options. It is generated from the code; '
           '`forcecal COMMAND --help` prints the same with an example.\n\nEvery command that computes has `--json` (print the result as JSON) and '
           '`--quiet` (no progress). Commands that talk to running nodes have `--namespace NAME` and '
           '`--timeout S`; commands that take many recordings have `--jobs N` and `--dask ADDRESS`. `--debug` shows the traceback of an error. An earlier output is kept as NAME~. Exit status: 0 done, 1 the data '
           'cannot give a result, 2 wrong usage, 3 found what `--fail-on` names.\n')
    parsers = {name: build_parser(name).commands[name] for name in COMMANDS}
    rows = {name: [row for action in parser._actions if action.help != argparse.SUPPRESS
                   and not set(EVERYWHERE) & set(action.option_strings)
                   for row in _rows(action)]
            for name, parser in parsers.items()}
    users = Counter(row for own in rows.values() for row in own)
    shared = {row.partition(':')[0]: row for row, n in reversed(users.most_common()) if n > 1}
    known: dict[str, str] = {}
    yield '\n## Options of several commands\n\n'
    yield from (_unless_known(row, known) for row in reversed(shared.values()))
    for purpose, group in GROUPS.items():
        yield f'\n## {purpose[0].upper()}{purpose[1:]}\n'
        for name in group:
            summary = COMMANDS[name]
            yield f'\n### {name}\n\n{summary[0].upper()}{summary[1:]}.'
            also = [re.findall(r'--[a-z-]+|`[A-Z.]+`', row)[0].strip('`')
                    for row in rows[name] if row in shared.values()]
            yield f' Takes {", ".join(f"`{one}`" for one in also)} as above.\n' if also else '\n'
            if own := [row for row in rows[name] if row not in shared.values()]:
                yield '\n'
                yield from (_unless_known(row, known) for row in own)


def _unless_known(row: str, known: dict[str, str]) -> str:
    """Return a row, of an option that was described before what differs: its default."""
    name, _, text = row.partition(': ')
    text, bracket, default = text.partition(' (default: ')
    plain = re.sub(r'`--simulated-(\S+).*', r'`--\1', name[2:])
    before = next((told for one, told in known.items() if one.startswith(plain)), '')
    known.setdefault(name[2:], text)
    if plain != name[2:] and text.split()[:3] == before.split()[:3]:
        return f"{name}: as `{plain[1:]}`, of the simulator's recording\n"
    return f'{name}: as above{bracket}{default}' if before == text and bracket else row


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
    text = re.sub(r'[;,] (an )?earlier (one|results?|ones) (is|are) kept as \S+~', '', text)
    return f'- `{name}`: {" ".join(text.split())}\n'


def files() -> Iterator[str]:
    """Yield the page of the files, whose fields are those of the code."""
    page = (FOLDER / 'files.md').read_text()
    for name, rows in (('calibration', _fields(Calibration)), ('rig', _groups(Rig))):
        page = re.sub(rf'(?<=<!-- {name} -->\n).*?(?=<!-- -->)',
                      lambda _: f'\n{"".join(rows)}\n', page,  # noqa: B023  called at once
                      flags=re.DOTALL)
    yield page


def _fields(section: Any, indent: str = '') -> Iterator[str]:
    """Yield a line for each field of a document: key, shape, unit, meaning."""
    for column in columns(section):
        if column.holds_sections:
            yield f'{indent}- `{column.key}`:\n'
            yield from _fields(column.kind, indent + '  ')
        else:
            meaning = column.row.meaning[0].lower() + column.row.meaning[1:]
            star = '' if isinstance(column.row, Entry) else '\\*'
            yield f'{indent}- {_named(column)}{star}: {meaning}\n'


def _groups(section: Any) -> Iterator[str]:
    """Yield a line for each group of a document with the names and units of its keys."""
    for column in columns(section):
        if column.holds_sections:
            purpose = column.row.meaning or column.kind.__doc__.split('\n')[0].rstrip('.')
            names = ', '.join(_with_its_own(list(alike)) for _, alike in groupby(
                columns(column.kind), lambda one: one.kind))
            yield f'- `{column.key}`: {names}. {purpose[0].upper()}{purpose[1:]}.\n'
        elif column.row.meaning:
            yield f'- {_named(column)}: {column.row.meaning}.\n'


def _with_its_own(alike: list[Column]) -> str:
    """Return fields of the same kind, those of a group with its fields in brackets."""
    if not alike[0].holds_sections:
        return ', '.join(map(_named, alike))
    own = ', '.join(map(_named, columns(alike[0].kind)))
    return f'{", ".join(f"`{one.key}`" for one in alike)} {{{own}}}'


def _named(column: Column) -> str:
    """Return key, shape and unit of a field."""
    shape = column.row.shape or shape_of(column.kind)
    size = f'({" x ".join("n" if n is None else str(n) for n in shape)})' if shape else ''
    unit = f'[{column.row.unit}]' if column.row.unit not in ('', '1') else ''
    return ' '.join(filter(None, (f'`{column.key}`', size, unit)))


PAGES = {'nodes.md': nodes, 'commands.md': commands, 'files.md': files}
"""Name of a page and what writes it."""


def main() -> None:
    """Write all pages."""
    for name, page in PAGES.items():
        (FOLDER / name).write_text(''.join(page()))


if __name__ == '__main__':
    main()
