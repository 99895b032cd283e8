"""The files of config/ are those written from the rows, and hold what the nodes declare."""

from math import isfinite
from pathlib import Path

from forcecal_ros.nodes.config import config_files, TABLES
import pytest
import yaml

CONFIG = Path(__file__).parents[2] / 'config'
WRITTEN = config_files(CONFIG)


@pytest.mark.parametrize('name', WRITTEN)
def test_the_file_is_the_one_that_is_written_from_the_rows(name):
    assert (CONFIG / name).read_text() == WRITTEN[name], 'python -m forcecal_ros.nodes.config'


@pytest.mark.parametrize('node', TABLES)
def test_the_parameter_file_holds_every_parameter_at_its_default(node):
    rows, _ = TABLES[node]
    path = CONFIG / f'{node}.yaml'
    flat = {}

    def flatten(group, prefix=''):
        for name, value in group.items():
            if isinstance(value, dict):
                flatten(value, f'{prefix}{name}.')
            else:
                flat[prefix + name] = value

    flatten(yaml.safe_load(path.read_text())[f'/**/{node}']['ros__parameters'])
    assert set(flat) == {row.name for row in rows}
    for row in rows:
        value = flat[row.name]
        expected = row.default
        assert type(value) is type(expected), row.name
        if isinstance(expected, list) and isinstance(expected[0], float):
            assert value == pytest.approx(expected, abs=1e-11), row.name
        else:
            assert value == expected, row.name


@pytest.mark.parametrize('node', TABLES)
def test_every_parameter_stands_below_its_meaning_and_range(node):
    text = ' '.join(line.strip().removeprefix('# ')
                    for line in (CONFIG / f'{node}.yaml').read_text().splitlines())
    for row in TABLES[node][0]:
        bounded = isfinite(row.low) and isfinite(row.high)
        assert row.text + (f' (from {row.low:.6g} to' if bounded else '') in text, row.name
