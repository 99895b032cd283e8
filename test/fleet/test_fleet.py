"""A fleet's nights in one page and one table; only what is new is read."""

import csv
from dataclasses import replace
from datetime import datetime, timedelta, timezone
import json
import os

from forcecal_ros.cli.main import main
from forcecal_ros.core.calibration import Estimate
from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.result import Diagnosis, to_document
from forcecal_ros.fleet.page import COLUMNS
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import dump
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


@pytest.fixture
def fleet(tmp_path):
    rng = np.random.default_rng(1)
    for number in range(NIGHTS):
        night(tmp_path / f'nights/left/n{number:02d}/calibration.yaml', number, rng, True)
        night(tmp_path / f'nights/mixed/n{number:02d}.yaml', number, rng, False, robot='right')
    damaged = tmp_path / 'nights/left/damaged/damaged_0.mcap'
    damaged.parent.mkdir()
    damaged.write_bytes(b'no bag')
    (tmp_path / 'nights/left/diagnosis.json').write_text(json.dumps({
        **to_document(Diagnosis('partial', '', gap=Gap(3.0, 2.0, 0.4, 0.8, (0.7, 0.9), {})), {},
                      None), 'source': {'recorded': DAY.isoformat()}}))
    return tmp_path


def run(fleet, capsys, *more):
    status = main(['fleet', str(fleet / 'nights'), '-o', str(fleet / 'out'), '--json', *more])
    captured = capsys.readouterr()
    return status, json.loads(captured.out), captured.err


def test_what_drifted_first_is_named_and_what_cannot_be_read_is_a_row(fleet, capsys):
    status, found, err = run(fleet, capsys)
    assert status == 1 and err.count('\n') == 1 and 'damaged_0.mcap' in err
    assert found['read'] == found['new'] - 1 == 2 * NIGHTS + 1
    assert 'First to drift: tool mass of left, by +20 ± ' in found['headline']
    (change,) = found['robots']['left']['changed']
    assert change['since'].startswith('2026-03-11') and found['robots']['right'] == {
        'entries': NIGHTS, 'changed': []}
    rows = list(csv.DictReader((fleet / 'out/fleet.csv').open()))
    assert tuple(rows[0]) == COLUMNS
    assert [row['path'] for row in rows if row['error']] == [
        str(fleet / 'nights/left/damaged/damaged_0.mcap')]
    mass = [row for row in rows if row['key'] == 'mass' and row['robot'] == 'left']
    assert len(mass) == NIGHTS and float(mass[0]['high']) > float(mass[0]['value'])
    assert [row['change'] != '' for row in mass].index(True) >= BREAK
    assert {row['said'] for row in rows if row['key'] == 'gap.closed'} == {'partial'}
    page = (fleet / 'out/fleet.html').read_text()
    assert 'tool mass of left' in page and 'damaged_0.mcap' in page


def test_only_what_is_new_or_changed_is_read_again(fleet, capsys):
    run(fleet, capsys)
    assert run(fleet, capsys)[1]['new'] == 0
    rng = np.random.default_rng(9)
    night(fleet / 'nights/left/n99/calibration.yaml', 99, rng, True)
    os.utime(fleet / 'nights/mixed/n03.yaml', ns=(1, 1))
    status, found, _ = run(fleet, capsys)
    assert (status, found['new'], found['read']) == (1, 2, 2 * NIGHTS + 2)
    # what is gone is gone, and without recordings all is well
    (fleet / 'nights/left/n99/calibration.yaml').unlink()
    status, found, err = run(fleet, capsys, '--no-bags')
    assert (status, found['new'], found['read'], err) == (0, 0, 2 * NIGHTS + 1, '')


def test_no_file_ends_the_run_and_none_reaches_the_page_as_markup(fleet, capsys):
    good = (fleet / 'nights/left/n00/calibration.yaml').read_text()
    for name, text in (('cut.yaml', good[:700]), ('edited.yaml', good.replace('13.0', '14.0', 1)),
                       ('diagnosis.json', '{"format": "forcecal-diagnosis/1"}')):
        (fleet / 'nights' / name).write_text(text)
    (fleet / 'nights/odd.yaml').write_text(dump(replace(
        WHOLE, mass=Estimate(1e-300, 1e-200, 'kg'),
        source={'robot': '<script>alert(1)</script>', 'recorded': [1], 'created': 'some day'})))
    (fleet / 'out').mkdir()
    (fleet / 'out/fleet.json').write_text('{"read": {"a": 1}}')
    status, found, err = run(fleet, capsys, '--no-bags')
    assert status == 1 and err.count('\n') == 3 == len(found['unreadable'])
    assert found['robots']['<script>alert(1)</script>']['entries'] == 1
    page = (fleet / 'out/fleet.html').read_text()
    assert '<script>alert' not in page and '&lt;script&gt;alert' in page


def test_a_recording_is_calibrated_and_counts_once(rig_run, tmp_path, capsys):
    nights, run = tmp_path / 'nights', tmp_path / 'run'
    nights.mkdir()
    run.mkdir()
    # of a day: a recording whose clock began at zero says none, by which it would be known again
    write_recording(run / 'bag', replace(read_recording(rig_run / 'bag'),
                                         start_ns=int(DAY.timestamp()) * 10**9))
    (nights / 'arm').symlink_to(run)  # links to folders are not followed, named ones are
    out = tmp_path / 'out'
    assert main(['fleet', str(nights / 'arm'), '-o', str(out), '--robot', 'arm']) == 0
    (row,) = [row for row in csv.DictReader((out / 'fleet.csv').open()) if row['key'] == 'mass']
    assert row['kind'] == 'bag' and row['robot'] == 'arm' and float(row['value']) > 1.0
    assert main(['calibrate', str(run / 'bag'), '-o', str(tmp_path / 'c.yaml'),
                 '--robot', 'arm']) == 0
    capsys.readouterr()
    listed = tmp_path / 'list'
    listed.write_text(f'{run}\n{tmp_path}/c.yaml\n')
    assert main(['fleet', f'@{listed}', '-o', str(out), '--robot', 'arm', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found['read'], found['new'], found['robots']['arm']['entries']) == (2, 1, 1)


def test_a_folder_without_any_is_refused(tmp_path, capsys):
    (tmp_path / 'empty').mkdir()
    for place in ('empty', 'nothing'):
        assert main(['fleet', str(tmp_path / place), '-o', str(tmp_path / 'out')]) == 1
        assert capsys.readouterr().err.count('\n') == 1
