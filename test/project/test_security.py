"""What a recording or a document says is data: no code, no markup, no place to write to."""

import ast
from pathlib import Path
import re

from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.insitu import load_spec
from forcecal_ros.io.bags import write_recording
import numpy as np
import pytest
from sources import parsed

SOURCE = Path(__file__).resolve().parents[2] / 'forcecal_ros'
FORBIDDEN_NAMES = {'eval', 'exec', 'compile', '__import__', 'input'}
FORBIDDEN_MODULES = {'pickle', 'marshal', 'shelve', 'dill', 'joblib.numpy_pickle', 'telnetlib',
                     'ftplib', 'http.server', 'socketserver', 'xmlrpc'}
FORBIDDEN_CALLS = {('os', 'system'), ('os', 'popen'), ('yaml', 'safe_load'), ('yaml', 'full_load'),
                   ('yaml', 'unsafe_load')}
SUSPICIOUS = re.compile(
    r'(?<![.\w])(' + '|'.join(FORBIDDEN_NAMES) + r')\b|shell|allow_pickle|'
    + '|'.join([*(name for _, name in FORBIDDEN_CALLS), *FORBIDDEN_MODULES]))
LOADER = 'core/safe_yaml.py'
LISTENING = {('nodes/live.py', 'http.server')}
"""Tested by a browser, in ``test_live.py``."""


def nodes(words='', folder=''):
    """Yield the syntax of the files in which a pattern is found."""
    for path in sorted((SOURCE / folder).rglob('*.py')):
        if re.search(words, path.read_text()):
            name = path.relative_to(SOURCE)
            yield from ((name, node) for node in ast.walk(parsed(path)))


def offences(node):
    """Yield what one node of the source does that it must not."""
    if isinstance(node, ast.Call):
        function = node.func
        if isinstance(function, ast.Name) and function.id in FORBIDDEN_NAMES:
            yield function.id
        if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name) \
                and (function.value.id, function.attr) in FORBIDDEN_CALLS:
            yield f'{function.value.id}.{function.attr}'
        yield from (keyword.arg for keyword in node.keywords
                    if keyword.arg in ('shell', 'allow_pickle')
                    and getattr(keyword.value, 'value', None) is not False)
    if isinstance(node, ast.ImportFrom) and node.module in FORBIDDEN_MODULES:
        yield node.module
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names if alias.name in FORBIDDEN_MODULES)


def test_nothing_is_evaluated_unpickled_or_given_to_a_shell():
    assert not [f'{path}:{node.lineno} {what}' for path, node in nodes(SUSPICIOUS)
                for what in offences(node) if (str(path), what) not in LISTENING]


def test_only_one_module_loads_yaml_and_only_the_live_page_listens_besides_dds():
    loading = {str(path) for path, node in nodes(r'\byaml\.load\b') if isinstance(node, ast.Call)
               and isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name)
               and (node.func.value.id, node.func.attr) == ('yaml', 'load')}
    assert loading == {LOADER}
    assert not [str(path) for path, node in nodes(r'import .*\bsocket\b')
                if isinstance(node, ast.Import)
                and any(alias.name == 'socket' for alias in node.names)]


EVIL = '../../<script>alert(1)</script>$\\frac{'


def test_frames_of_a_recording_neither_reach_a_page_as_markup_nor_a_path(tmp_path):
    t = np.arange(4000) / 1000
    turns = [np.diag([1.0, -1, -1]), np.array([[0.0, 0, -1], [0, -1, 0], [-1, 0, 0]]),
             np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.diag([1.0, -1, -1])]
    R = np.repeat(turns, 1000, axis=0)
    rng = np.random.default_rng(1)
    force = -5.0 * 9.80665 * R[:, 2]
    torque = np.cross([0.01, 0.02, 0.1], force)
    recording = Recording(
        wrench=Stream(t, np.hstack([force, torque]) + 0.01 * rng.normal(size=(4000, 6)), EVIL),
        pose=PoseStream(t, np.zeros((4000, 3)), R, EVIL),
        phases=tuple(Phase(word, float(i) + start, float(i) + end) for i in range(4)
                     for word, start, end in (('measure', 0.0, 0.9), ('move', 0.9, 1.0))),
        start_ns=1_700_000_000_000_000_000)
    inside = tmp_path / 'inside'
    inside.mkdir()
    write_recording(inside / 'bag', recording)
    page = inside / 'report.html'
    assert main(['calibrate', str(inside / 'bag'), '-o', str(inside / 'c.yaml'),
                 '--report', str(page)]) == 0
    assert '<script>alert' not in page.read_text()
    assert {path.name for path in tmp_path.iterdir()} == {'inside'}
    assert main(['estimate', str(inside / 'bag'), '--calibration', str(inside / 'c.yaml'),
                 '-o', str(inside / 'out')]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {'inside'}


@pytest.mark.parametrize('name', ['../evil', '/etc/evil', 'a/b', '..', '', 'a\0b'])
def test_a_sensor_whose_name_leads_elsewhere_is_refused(tmp_path, name):
    path = tmp_path / 'spec.yaml'
    path.write_text(f'format: forcecal-insitu/1\nsensors:\n  {name!r}:\n    topic: wrench\n'
                    .replace("'a\\x00b'", '"a\\0b"'))
    with pytest.raises(ConfigError):
        load_spec(path)


def test_commands_leave_a_node_in_one_place_which_asks_a_motion_that_was_started():
    def callers(method):
        return {function.name for _, function in nodes(method, 'nodes')
                if isinstance(function, ast.FunctionDef) for call in ast.walk(function)
                if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)
                and call.func.attr == method
                and ast.unparse(call.func.value) in ('self', 'self._backend')}

    assert callers('send') == {'_step'}
    assert callers('_step') == {'_tick', '_watch_clock', 'halt'}
    commands = [path.as_posix() for path, node in nodes('_publish', 'nodes')
                if isinstance(node, ast.FunctionDef) and node.name == '_publish'
                and ast.unparse(node.args).endswith('raw: bytes')]
    assert commands == ['nodes/backends.py']
