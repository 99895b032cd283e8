"""What is installed is whole, and says the same about itself in every place."""

import ast
from functools import cache
from importlib.metadata import version
import json
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tarfile
from xml.etree import ElementTree
import zipfile

from forcecal_ros import entry
from forcecal_ros.cli.node import NODES
from forcecal_ros.core.extras import BESIDE_APT
import pytest
from sources import parsed

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = 'forcecal_ros'
SHARE = ('config/**/*.yaml', 'launch/*.launch.py', 'layouts/*.*', 'package.xml')
INSIDE = ('**/*.py', 'config/*.yaml', 'config/*/*.yaml', '**/*.html.j2', '**/*.xml')
ROSDEP_KEYS = {  # name in an import -> key
    'argcomplete': 'python3-argcomplete', 'jinja2': 'python3-jinja2',
    'matplotlib': 'python3-matplotlib', 'numpy': 'python3-numpy', 'scipy': 'python3-scipy',
    'yaml': 'python3-yaml',
}
PIP_NAMES = {'yaml': 'pyyaml', 'backports': 'backports-zstd'}
OPTIONAL = {'scale': {'distributed'}, 'plots': {'plotly'}, 'mujoco': {'mujoco'}}
"""Extra -> what it brings."""


def _run(*arguments, cwd=ROOT, **options):
    done = subprocess.run([str(argument) for argument in arguments], cwd=cwd,
                          capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, f'{arguments}\n{done.stdout}\n{done.stderr}'
    return done.stdout


@cache
def _setup():
    """Return what setup.py declares, read from this tree and not from what is installed."""
    ask = ('import json, setuptools; from distutils.core import run_setup; '
           'one = run_setup("setup.py", stop_after="init"); print(json.dumps({'
           '"version": one.get_version(), "license": one.get_license(), '
           '"email": one.get_maintainer_email(), "requires": one.install_requires, '
           '"extras": one.extras_require}))')
    return json.loads(_run(sys.executable, '-c', ask).splitlines()[-1])


def _manifest():
    return ElementTree.parse(ROOT / 'package.xml').getroot()


@cache
def _imported():
    """Return the top-level names that the package imports from elsewhere."""
    names = set()
    for path in (ROOT / PACKAGE).rglob('*.py'):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Import):
                names.update(alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module.split('.')[0])
    return names - set(sys.stdlib_module_names) - {PACKAGE, 'compression'} - set().union(
        *OPTIONAL.values())


def _names(requirements):
    return {re.match(r'[\w.-]+', line)[0].replace('.', '-').lower() for line in requirements}


def test_version_is_the_same_everywhere():
    source = (ROOT / PACKAGE / '__init__.py').read_text()
    wanted = re.search(r"^__version__ = '(.+)'$", source, re.MULTILINE)[1]
    assert _setup()['version'] == wanted
    assert _manifest().findtext('version') == wanted
    assert f'## {wanted}, ' in (ROOT / 'CHANGELOG.md').read_text()


def test_package_xml_passes_the_checks_of_catkin_pkg():
    package_module = pytest.importorskip('catkin_pkg.package')
    warnings = []
    package = package_module.parse_package(ROOT / 'package.xml', warnings=warnings)
    package.validate(warnings=warnings)
    assert not warnings
    assert package.get_build_type() == 'ament_python'


def test_package_xml_and_setup_agree_about_license_and_maintainer():
    manifest = _manifest()
    assert _setup()['license'] == manifest.findtext('license') == 'Apache-2.0'
    assert _setup()['email'] == manifest.find('maintainer').get('email')


def test_rosdep_is_asked_for_every_import_that_apt_has_and_for_nothing_of_pip():
    declared = {node.text for node in _manifest().findall('exec_depend')}
    assert {ROSDEP_KEYS.get(name, name) for name in _imported() - BESIDE_APT} <= declared
    assert {key for key in declared if key.startswith('python')} == {*ROSDEP_KEYS.values()}


def test_nodes_on_a_robot_want_nothing_that_apt_does_not_have():
    loads = ['forcecal_ros.calibrate.pipeline', *(
        f'forcecal_ros.nodes.{node}' for node in ('sequencer', 'observer', 'impedance'))]
    code = f'import sys; sys.modules.update(dict.fromkeys({BESIDE_APT}))'
    _run(sys.executable, '-c', '\n'.join([code, *(f'import {name}' for name in loads)]))


def test_every_import_is_declared_to_pip():
    imported = {PIP_NAMES.get(name, name) for name in _imported()
                if name in ROSDEP_KEYS or name in BESIDE_APT}
    assert _names(_setup()['requires']) == imported


@pytest.mark.parametrize('extra', OPTIONAL)
def test_what_is_optional_is_declared_as_such(extra):
    assert _names(_setup()['extras'][extra]) == OPTIONAL[extra]


@pytest.mark.parametrize('name', ['forcecal', *NODES])
def test_every_executable_is_a_function(name):
    assert callable(getattr(entry, name))


@pytest.fixture(scope='module')
def archives(tmp_path_factory, project_files):
    """Return a source archive of this tree and the wheel that pip makes from it alone."""
    pytest.importorskip('pip')
    setuptools = version('setuptools')
    if tuple(int(part) for part in setuptools.split('.')[:2]) < (70, 1):
        pytest.skip(f'setuptools {setuptools} makes no wheels by itself; 70.1 does')
    tree = tmp_path_factory.mktemp('tree')
    for path in project_files:
        (tree / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, tree / path, follow_symlinks=False)
    out = tmp_path_factory.mktemp('dist')
    build = 'import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])'
    _run(sys.executable, '-c', build, out, cwd=tree)
    sdist, = out.glob('*.tar.gz')
    _run(sys.executable, '-m', 'pip', 'wheel', '--no-deps', '--no-build-isolation',
         '--disable-pip-version-check', '--wheel-dir', out, sdist)
    wheel, = out.glob('*.whl')
    return sdist, wheel


def _expected(base, patterns):
    """Return what the patterns find in the tree, generated files aside."""
    found = {path.relative_to(base).as_posix() for pattern in patterns
             for path in base.glob(pattern) if '__pycache__' not in path.parts}
    assert found
    return found


@pytest.mark.workspace
def test_wheel_holds_all_that_the_tree_holds(archives):
    names = set(zipfile.ZipFile(archives[1]).namelist())
    assert {f'{PACKAGE}/{name}' for name in _expected(ROOT / PACKAGE, INSIDE)} <= names
    share, = {name.rpartition('package.xml')[0] for name in names if name.endswith('package.xml')}
    assert share.endswith(f'.data/data/share/{PACKAGE}/')
    assert {share + name for name in _expected(ROOT, SHARE)} <= names
    assert any(name.endswith(f'/resource_index/packages/{PACKAGE}') for name in names)
    assert any(name.endswith('LICENSE') for name in names)


@pytest.mark.workspace
def test_source_archive_holds_all_that_the_tree_holds(archives, project_files):
    with tarfile.open(archives[0]) as archive:
        names = {name.partition('/')[2] for name in archive.getnames()}
    ours = _expected(ROOT, SHARE) | {path.as_posix() for path in project_files
                                     if path.parts[0] in {'test', '.ci', 'run', 'LICENSE'}}
    assert ours <= names


@pytest.mark.workspace
def test_pip_puts_the_one_command_where_a_shell_finds_it(archives, tmp_path):
    """And no name as common as sim, which ros2 run needs in lib/ only: see test_colcon.py."""
    _run(sys.executable, '-m', 'venv', '--without-pip', tmp_path)
    before = {path.name for path in (tmp_path / 'bin').iterdir()}
    _run(sys.executable, '-m', 'pip', '--python', tmp_path / 'bin' / 'python', 'install',
         '--no-deps', '--no-compile', '--disable-pip-version-check', archives[1])
    assert {path.name for path in (tmp_path / 'bin').iterdir()} - before == {'forcecal'}
    site, = tmp_path.glob('lib/python*/site-packages')
    where = _run(tmp_path / 'bin' / 'python', '-c', f'import {PACKAGE}; print({PACKAGE}.__file__)',
                 cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(site)
