"""What the documents say is there, and what is there is in the documents."""

from fnmatch import fnmatch
from importlib import import_module
from pathlib import Path
import re
import subprocess
import sys

from forcecal_ros.cli import COMMANDS, VERBS
from forcecal_ros.cli.main import build_parser
from forcecal_ros.effects.library import EFFECTS
from forcecal_ros.io.bags import write_recording
from forcecal_ros.report.effect_words import VERDICTS
import pytest
from rig_recordings import FREE, own_recording

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
GUIDES = [page for page in PAGES[2:] if page.name not in ('nodes.md', 'commands.md', 'errors.md')]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r'\]\(([^)#]+)', page.read_text()):
        assert target.startswith('http') or (page.parent / target).exists(), target


def test_no_number_is_left_to_be_filled_in():
    written = [*PAGES, ROOT / 'CHANGELOG.md', *(ROOT / 'benchmark').rglob('*.md')]
    assert not [(page.name, word) for page in written for word in re.findall(
        r'\b(?:X{2,}|XS|TODO|TBD|FIXME)\b|\?{3}', page.read_text())]


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


def sentences(text):
    """Return the words of each sentence of a page, without code and tables."""
    text = re.sub(r'```.*?```', '', text, flags=re.DOTALL)
    lines = [line for line in text.splitlines() if not line.startswith(('    ', '|', '#', '!'))]
    paragraphs = re.split(r'\n\s*\n|\n(?=- |\d+\. )', '\n'.join(lines))
    return [one.split() for part in paragraphs for one in re.split(
        r'(?<=[.!?:;])\s+(?=[A-Z`\[*(])', ' '.join(part.split())) if one]


@pytest.mark.parametrize('page', GUIDES, ids=lambda page: page.name)
def test_a_page_begins_with_what_it_is_for(page):
    first = page.read_text().split('\n\n')[1]
    assert first.startswith(('This page ', 'This tutorial ')), first


def test_sentences_are_short():
    lengths = [len(one) for page in GUIDES for one in sentences(page.read_text())]
    assert sum(lengths) / len(lengths) < 18 and max(lengths) <= 35


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


def test_no_command_is_named_that_is_not_there():
    files = [*PAGES, *(ROOT / 'benchmark').rglob('*.md'), *(ROOT / 'config').rglob('*.yaml')]
    named = {(file.name, word) for file in files for word in re.findall(
        r'(?:`|^    |\d of |File of )forcecal ([a-z][a-z-]+)', file.read_text(), re.MULTILINE)}
    assert named and {word for _, word in named} <= {*COMMANDS, *VERBS}, named


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


def test_the_page_of_verdicts_has_the_meanings_that_a_report_states():
    text = (ROOT / 'docs/reference/verdicts.md').read_text()
    assert dict(re.findall(r'^\| `(\w+)` \| ([^|]+?) \|', text, re.MULTILINE)) == VERDICTS


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


@pytest.mark.long
def test_the_pages_become_a_site_without_a_warning(tmp_path):
    pytest.importorskip('furo', reason="requires pip install -e '.[docs]'")
    done = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-q', '-W', '-c', 'docs', '.', tmp_path], cwd=ROOT,
        capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'docs' / 'reference' / 'errors.html').is_file()
