"""What the documents say is there, and what is there is in the documents."""

import contextlib
from fnmatch import fnmatch
from importlib import import_module
import json
from pathlib import Path
import re
import subprocess
import sys

from forcecal_ros.cli import COMMANDS, VERBS
from forcecal_ros.cli.main import build_parser
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.schema import columns
from forcecal_ros.diagnose.model.discrepancy import SCALES
from forcecal_ros.diagnose.search.model_comparison import COUNTED
from forcecal_ros.diagnose.search.posterior import WORTH
from forcecal_ros.effects.library import EFFECTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.io.bags import write_recording
from forcecal_ros.nodes.config import TABLES
from forcecal_ros.report.effect_words import VERDICTS
import pytest
from rig_recordings import FREE, own_recording

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
GENERATED = ('nodes.md', 'commands.md', 'errors.md', 'files.md')
GUIDES = [page for page in PAGES[2:] if page.name not in GENERATED]


def anchors(page):
    """Return the anchors of the headings of a page, as the site makes them."""
    headings = re.findall(r'^#+ (.+)$', page.read_text(), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', one.lower()).replace(' ', '-') for one in headings}


@pytest.mark.parametrize('page', [*PAGES, *sorted((ROOT / 'benchmark/results').glob('*.md'))],
                         ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    for target, _, anchor in re.findall(r'\]\((?!http)([^)#]*)(#([^)]+))?\)', page.read_text()):
        other = page.parent / target if target else page
        assert other.exists(), target
        assert not anchor or anchor in anchors(other), f'{target}#{anchor}'


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


@pytest.mark.parametrize('page', [*PAGES[1:], ROOT / 'CHANGELOG.md'], ids=lambda page: page.name)
def test_a_page_begins_with_what_it_is_for(page):
    first = page.read_text().split('\n\n')[1]
    assert first.startswith(('This page ', 'This tutorial ')), first


def test_sentences_are_short():
    lengths = [len(one) for page in GUIDES for one in sentences(page.read_text())]
    assert sum(lengths) / len(lengths) < 18 and max(lengths) <= 35


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_command_named_exists_with_its_options(page):
    text = page.read_text().replace('\\\n', ' ')
    for line in re.findall(r'(?:\bforcecal|\./run) ((?:[a-z-]+) [^`\n]*)', text):
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
    rows = dict(re.findall(r'^- `(\w+)`: (.*)$', text, re.MULTILINE))
    assert list(rows) and set(rows) == {*EFFECTS, 'wrench_bias_step'}
    for name, effect in EFFECTS.items():
        plain, _, shape = rows[name].partition('; shape ')
        words = {True: re.findall(r'\w+', ' '.join(re.findall('`(.+?)`', shape))),
                 False: re.findall(r'\w+', ' '.join(re.findall('`(.+?)`', plain)))}
        for shapes, found in words.items():
            assert found == [q.name for q in effect.parameters if q.shapes is shapes], name


def test_the_page_of_verdicts_has_the_meanings_that_a_report_states():
    text = (ROOT / 'docs/reference/verdicts.md').read_text()
    assert dict(re.findall(r'^\| `(\w+)` \| ([^|]+?) \|', text, re.MULTILINE)) == VERDICTS


PARAMETERS = {row.name for table, _ in TABLES.values() for row in table}
FILES = ('.toml', '.yaml', '.json', '.html', '.md', '.py', '.csv', '.xml', '.svg')
OTHERS = {'scale.linear', 'scale.rotational', 'tilt.x', 'tilt.y', 's.x'}
"""Of MoveIt Servo, of a MuJoCo model, and of a MATLAB file."""


def keys(section, prefix=''):
    """Yield the keys of a file with their groups."""
    for column in columns(section):
        yield prefix + column.key
        if column.holds_sections:
            yield from keys(column.kind, f'{prefix}{column.key}.')


def is_there(name):
    """Whether a name with dots is one of a parameter, of a key of a file, or of the package."""
    module, _, attribute = f'forcecal_ros.{name}'.rpartition('.')
    with contextlib.suppress(ImportError):
        return hasattr(import_module(module), attribute) or bool(
            import_module(f'{module}.{attribute}'))
    return any(fnmatch(known, name) for known in {
        *PARAMETERS, *keys(Calibration), *keys(Rig), *OTHERS})


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_name_with_dots_is_of_a_parameter_or_of_something_else_that_is_there(page):
    text = re.sub(r'```.*?```', '', page.read_text(), flags=re.DOTALL)
    groups = {name.partition('.')[0] for name in PARAMETERS if '.' in name}
    names = set(re.findall(r'`([a-z_]+(?:\.[A-Za-z_*]+)+)`', text)) | {
        name for name in re.findall(r'(?<![\w/.`-])([a-z_]+\.[a-z_]+)(?![\w(/])', text)
        if name.partition('.')[0] in groups}
    assert not {name for name in names if not name.endswith(FILES) and not is_there(name)}


@pytest.mark.parametrize('name', ['calibrate.sensor_rotation', 'limits.fast', 'wrench_sign.x'])
def test_a_name_that_is_nowhere_is_found_out(name):
    assert not is_there(name)


def test_every_name_that_the_page_from_python_lists_is_there():
    text = (ROOT / 'docs/reference/api.md').read_text()
    listed = re.findall(r'automodule:: (\S+)\n   :members:(.*)', text)
    assert len(listed) > 4
    for module, names in listed:
        assert all(hasattr(import_module(module), name) for name in
                   names.replace(',', ' ').split()), module


AVOIDED = re.compile(r"""(?<![\w-])(
    told | tells? | untold | says? | said | hears? | heard | asked | wants? | wanted
    | lay \s on | laid \s on | (takes?|took|taken) \s off | mended | believed | felt | seen
    | nobody | somebody | anybody | of \s (others|yours|ours) | stands? \s for
    | comes? \s out \s as | (is|are) \s no | besides? | whatever | misfit | slides?
    | optidrive | turned | doubts? | sayings?
    | loud | deafening | faint | onset | gates? | instants? | imitators? | ties? | alike | held
    | rooms? | houses? | sound | level | hot | fewest
    | where (?= \s (no|not|known|nothing|one \s of|it \s is|that \s is|the \s base) \b)
    )(?![\w-])""", re.VERBOSE | re.IGNORECASE)
"""Words that have a plainer one, or a second meaning; where: in place of if."""


def prose(page):
    """Return the text of a page without code."""
    text = re.sub(r'```.*?```', '', page.read_text(), flags=re.DOTALL)
    lines = [line for line in text.splitlines() if not line.startswith('    ')]
    return re.sub('`[^`]*`', '', '\n'.join(lines))


def test_pages_have_at_most_20_words_that_have_a_plainer_one():
    found = [(page.name, word[1]) for page in [*PAGES, ROOT / 'CHANGELOG.md']
             for word in AVOIDED.finditer(prose(page))]
    assert len(found) <= 20, found


def test_a_word_with_a_plainer_one_is_found_out():
    text = 'It is told where no pose is. Said nobody: `told`, a held-out part.'
    assert [word[1] for word in AVOIDED.finditer(re.sub('`.*?`', '', text))] == [
        'told', 'where', 'Said', 'nobody']


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
    assert 'url=docs/index.html' in (tmp_path / 'index.html').read_text()


def test_the_page_of_the_diagnosis_has_the_numbers_of_the_decision():
    text = (ROOT / 'docs/explanation/diagnosis.md').read_text()
    stored = json.loads((ROOT / 'forcecal_ros/diagnose/search/calibration.json').read_text())
    gain, beside = stored['weights']
    assert (f'= {stored["intercept"]:.2f} + {gain:g} log10((1 + G) / (1 + M)) - {beside:g} B'
            ) in text
    least, brought, missing = stored['temperature']
    assert f'T = {least:g} + {brought:g} G + {missing:g} M' in text
    assert f'counts in M up to {COUNTED:g} for each channel' in text
    assert f'within {1.0 - stored["largest"]:.2f} and {stored["largest"]:g}' in text
    assert f'must raise the log evidence by {WORTH:g}' in text
    assert f's is at most {SCALES[-1]:.1%}'.replace('%', ' %') in text
