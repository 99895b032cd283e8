"""What the documents say is there, and what is there is in the documents."""

from fnmatch import fnmatch
from importlib import import_module
from pathlib import Path
import re

from forcecal_ros.cli import COMMANDS
from forcecal_ros.cli.main import build_parser
from forcecal_ros.effects.library import EFFECTS
from forcecal_ros.io.bags import write_recording
import pytest
from rig_recordings import FREE, own_recording

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
HAND_WRITTEN = [page for page in PAGES if page.name not in ('nodes.md', 'commands.md')]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r'\]\(([^)#]+)', page.read_text()):
        assert target.startswith('http') or (page.parent / target).exists(), target


def test_every_page_is_in_the_contents_of_the_site():
    index = ROOT / 'docs/index.md'
    listed = {(index.parent / f'{line}.md').resolve()
              for block in re.findall(r'```{toctree}\n(.*?)```', index.read_text(), re.DOTALL)
              for line in block.splitlines() if line and not line.startswith(':')}
    assert listed >= {*PAGES} - {index} and all(page.is_file() for page in listed)


@pytest.mark.long
def test_the_example_from_python_runs(tmp_path, monkeypatch, capsys):
    page = (ROOT / 'docs/reference/api.md').read_text()
    block, = re.findall(r'```python\n(.*?)```', page, re.DOTALL)
    write_recording(tmp_path / 'my_bag', own_recording(1, FREE))
    monkeypatch.chdir(tmp_path)
    exec(block, {})  # noqa: S102  a page of ours
    assert 'nan' not in capsys.readouterr().out
    assert (tmp_path / 'calibration.yaml').is_file()


def test_the_readme_has_at_most_500_words():
    assert len((ROOT / 'README.md').read_text().split()) <= 500


def test_all_pages_have_at_most_22000_words():
    pages = [*PAGES, ROOT / 'CHANGELOG.md']
    assert sum(len(page.read_text().split()) for page in pages) <= 22_000


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_command_named_exists_with_its_options(page):
    text = page.read_text().replace('\\\n', ' ')
    for line in re.findall(r'\bforcecal ((?:[a-z-]+) [^`\n]*)', text):
        command = line.split()[0]
        if command not in COMMANDS:
            continue
        parser = build_parser(command)
        usage = parser._subparsers._group_actions[0].choices[command].format_help()  # type: ignore[index]
        for option in re.findall(r'(?<![\w-])--[a-z][a-z-]*', line.split('#')[0]):
            assert option in usage, f'{command} {option}'


def test_every_effect_and_each_of_its_parameters_is_catalogued():
    text = (ROOT / 'docs/reference/effects.md').read_text()
    rows = dict(re.findall(r'^\| `(\w+)` \|(.*)$', text, re.MULTILINE))
    assert list(rows) and set(rows) == {*EFFECTS, 'wrench_bias_step'}
    for name, effect in EFFECTS.items():
        _, plain, shape, _ = rows[name].split('|')
        words = {True: re.findall(r'\w+', ' '.join(re.findall('`(.+?)`', shape))),
                 False: re.findall(r'\w+', ' '.join(re.findall('`(.+?)`', plain)))}
        for shapes, found in words.items():
            assert found == [q.name for q in effect.parameters if q.shapes is shapes], name


PARAMETERS = {row.name for table in (
    'gap', 'impedance', 'observer_settings', 'sequencer_settings', 'sim')
    for row in import_module(f'forcecal_ros.nodes.{table}').PARAMETERS}
FILES = ('.yaml', '.json', '.html', '.md', '.py', '.csv', '.xml', '.svg')
GROUPS = {name.partition('.')[0] for name in PARAMETERS if '.' in name} - {
    path.stem for path in (ROOT / 'forcecal_ros').iterdir()}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_parameter_named_is_one_of_a_node(page):
    for word in re.findall(r'`([a-z]+\.[a-z_*/.]+)`', page.read_text()):
        group, _, rest = word.partition('.')
        if group in GROUPS and not word.endswith(FILES):
            first, *more = rest.split('/')
            stem = first.rpartition('_')[0]
            for name in (first, *(f'{stem}_{part}' for part in more)):
                assert any(fnmatch(known, f'{group}.{name}*') for known in PARAMETERS), word


@pytest.mark.parametrize('script', sorted(
    set(re.findall(r'benchmark/\w+\.py', ''.join(page.read_text() for page in PAGES)))))
def test_every_script_named_is_there(script):
    assert (ROOT / script).is_file()


