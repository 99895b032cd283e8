"""A fleet's nights in one page and one table."""

import csv
from dataclasses import replace
from datetime import datetime, timedelta, timezone
import json
import re
import shutil
from xml.etree import ElementTree

from browser import cut_on_a_phone, NEEDED
from forcecal_ros.cli.main import main
from forcecal_ros.core.calibration import Estimate
from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.result import Diagnosis, to_document
from forcecal_ros.io.calibration_file import dump
from forcecal_ros.report import fleet as pages
from forcecal_ros.report.control_chart import chart
from forcecal_ros.report.fleet import COLUMNS, Entry, Robot, Series
from forcecal_ros.report.rows import Row
import numpy as np
import pytest
from whole_calibration import whole_calibration

WHOLE = whole_calibration()
NIGHTS, BREAK = 14, 10
DAY = datetime(2026, 3, 1, 2, tzinfo=timezone.utc)


def night(path, number, rng, drifted, **source):
    """Write a calibration whose mass changes from one night on."""
    mass = 13.0 + 0.001 * rng.normal() + (0.02 if drifted and number >= BREAK else 0.0)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(dump(replace(WHOLE, mass=Estimate(mass, 0.001, 'kg'), source={
        'recorded': (DAY + timedelta(days=number)).isoformat(), **source})))


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    rng, folder = np.random.default_rng(1), tmp_path_factory.mktemp('fleet')
    for number in range(NIGHTS):
        night(folder / f'left/n{number:02d}/calibration.yaml', number, rng, True)
        night(folder / f'mixed/n{number:02d}.yaml', number, rng, False, robot='right')
    (folder / 'left/damaged.yaml').write_text('format: forcecal-calibration/1\nmass: [')
    (folder / 'left/diagnosis.json').write_text(json.dumps({
        **to_document(Diagnosis('partial', '', gap=Gap(3.0, 2.0, 0.4, 0.8, (0.7, 0.9), {})), {},
                      None), 'source': {'recorded': DAY.isoformat()}}))
    return folder


@pytest.fixture
def fleet(written, tmp_path):
    shutil.copytree(written, tmp_path / 'nights')
    return tmp_path


def run(fleet, capsys, *more):
    status = main(['fleet', str(fleet / 'nights'), '-o', str(fleet / 'out'), '--json', *more])
    captured = capsys.readouterr()
    return status, json.loads(captured.out), captured.err


def test_what_drifted_first_is_named_and_what_cannot_be_read_is_a_row(fleet, capsys):
    status, found, err = run(fleet, capsys)
    assert status == 1 and err.count('\n') == 1 and 'damaged.yaml' in err
    assert found['read'] == 2 * NIGHTS + 1
    assert 'First to drift on left: tool mass, by +20 ± ' in found['headline']
    (change,) = found['robots']['left']['changed']
    assert change['since'].startswith('2026-03-11') and found['robots']['right'] == {
        'entries': NIGHTS, 'changed': []}
    assert json.loads((fleet / 'out/fleet.json').read_text()).items() <= found.items()
    rows = list(csv.DictReader((fleet / 'out/fleet.csv').open()))
    assert tuple(rows[0]) == COLUMNS
    assert [row['path'] for row in rows if row['error']] == [
        str(fleet / 'nights/left/damaged.yaml')]
    mass = [row for row in rows if row['key'] == 'mass' and row['robot'] == 'left']
    assert len(mass) == NIGHTS and float(mass[0]['std']) == 0.001
    assert [row['change'] != '' for row in mass].index(True) >= BREAK
    assert {row['verdict'] for row in rows if row['key'] == 'gap.closed'} == {'partial'}
    page = (fleet / 'out/fleet.html').read_text()
    assert 'tool mass, by +20 ± ' in page and 'damaged.yaml' in page
    # as XML parses it: six paths a picture, the dates of the change in the one of the mass
    pictures = re.findall(r'<svg.*?</svg>', page, re.DOTALL)
    assert len(pictures) == 2 and all(
        len(list(ElementTree.fromstring(one))) == 6 for one in pictures)
    assert sum('class="change" d="M' in one for one in pictures) == 1


@pytest.mark.parametrize('changed, drawn', [(5, 5), (12, 8)])
def test_of_a_robot_with_many_changes_the_first_eight_are_drawn(changed, drawn):
    values = [0.0] * 10 + [100.0] * 10
    nights = tuple(Entry('left', '', float(i)) for i in range(len(values)))
    series = tuple(Series(nights, tuple(row(f'number {k}', v) for v in values),
                          chart(values, [1.0] * len(values), 5.0)) for k in range(changed))
    pictures = [*pages._pictures(Robot('left', nights, series))]
    assert [one['name'] for one in pictures] == [f'number {k}' for k in range(drawn)]


def row(name, value):
    return Row(name, name, 'kg', value, 1.0)


@NEEDED
def test_the_page_fits_a_phone(fleet, capsys):
    run(fleet, capsys)
    assert cut_on_a_phone(fleet / 'out' / 'fleet.html', fleet / 'browser') == []


def test_a_script_fails_on_drift_alone(fleet, capsys):
    (fleet / 'nights/left/damaged.yaml').unlink()
    assert run(fleet, capsys)[0] == 0
    assert run(fleet, capsys, '--fail-on', 'drift')[0] == 3
    steady = ['fleet', str(fleet / 'nights/mixed'), '-o', str(fleet / 'out')]
    assert main([*steady, '--fail-on', 'drift']) == 0


def test_copies_count_once_and_patches_and_hidden_folders_never(fleet, capsys):
    (fleet / 'nights/left/damaged.yaml').unlink()
    night = (fleet / 'nights/left/n00/calibration.yaml').read_text()
    for name in ('.trash/a.yaml', 'left/calibration_patched.yaml', 'left/copy.yaml',
                 'left/n00/calibration.yaml~'):
        (fleet / 'nights' / name).parent.mkdir(exist_ok=True)
        (fleet / 'nights' / name).write_text(night)
    status, found, _ = run(fleet, capsys)
    assert (status, found['read']) == (0, 2 * NIGHTS + 2)
    assert found['robots']['left']['entries'] == NIGHTS + 1
    one = ['fleet', str(fleet / 'nights/left/n00/calibration.yaml'), '-o', str(fleet / 'one')]
    assert main([*one, '--json']) == 0
    assert [*json.loads(capsys.readouterr().out)['robots']] == ['n00']


def test_no_file_ends_the_run_and_none_reaches_the_page_as_markup(fleet, capsys):
    good = (fleet / 'nights/left/n00/calibration.yaml').read_text()
    for name, text in (('cut.yaml', good[:700]), ('edited.yaml', good.replace('13.0', '14.0', 1)),
                       ('diagnosis.json', '{"format": "forcecal-diagnosis/1"}')):
        (fleet / 'nights' / name).write_text(text)
    (fleet / 'nights/odd.yaml').write_text(dump(replace(
        WHOLE, mass=Estimate(1e-300, 1e-200, 'kg'),
        source={'robot': '<script>alert(1)</script>', 'recorded': [1], 'created': 'some day'})))
    status, found, err = run(fleet, capsys)
    assert status == 1 and err.count('\n') == 4 == len(found['unreadable'])
    assert found['robots']['<script>alert(1)</script>']['entries'] == 1
    page = (fleet / 'out/fleet.html').read_text()
    assert '<script>alert' not in page and '&lt;script&gt;alert' in page


def test_a_folder_without_any_is_refused(tmp_path, capsys):
    (tmp_path / 'empty').mkdir()
    for place in ('empty', 'nothing'):
        assert main(['fleet', str(tmp_path / place), '-o', str(tmp_path / 'out')]) == 1
        assert capsys.readouterr().err.count('\n') == 1
