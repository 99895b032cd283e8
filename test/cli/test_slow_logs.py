"""``forcecal estimate`` on logs at 10 to 50 Hz: a row for every wrench."""

from dataclasses import replace
import json
from typing import Any

from forcecal_ros.cli.main import main
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import save
import gravity_arm as arm
from longer import first
import numpy as np
from observing import without_times
import pytest
from rosbags.highlevel import AnyReader
from slow_log import slow_log

RATES = {'both_20': (20.0, 20.0), 'pose_10_wrench_50': (50.0, 10.0)}
FILTERS = ('kalman', 'ukf')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp('slow')
    save(arm.calibrate(np.random.default_rng(2))[0], path / 'c.yaml')
    for name, rates in RATES.items():
        write_recording(path / name, slow_log(*rates)[1])
    recording = slow_log(20.0, 20.0)[1]
    write_recording(path / 'holed', replace(recording, pose=without_times(
        recording.pose, (4.0, 6.0))))
    return path


def run(capsys, name, folder, bag, out, *more):
    status = main(['estimate', str(folder / bag), '--filter', name, '--calibration',
                   str(folder / 'c.yaml'), '-o', str(out), *more])
    assert status == 0
    return capsys.readouterr()


def contact(bag):
    return read_recording(bag, topics={'wrench': 'observer/contact_wrench'}).wrench


def statuses(bag):
    """Return (stamp [s since the epoch], level, value, message) of observer/status."""
    with AnyReader([bag]) as reader:
        wanted = [one for one in reader.connections if one.topic == '/observer/status']
        out = []
        for connection, _, raw in reader.messages(wanted):
            message: Any = reader.deserialize(raw, connection.msgtype)
            (one,) = message.status
            stamp = message.header.stamp
            out.append((stamp.sec + 1e-9 * stamp.nanosec, one.level, one.values[0].value,
                        one.message))
    return out


@pytest.mark.parametrize('name', FILTERS)
@pytest.mark.parametrize('bag', first(RATES))
def test_every_wrench_gets_a_valid_row(capsys, folder, tmp_path, name, bag):
    document = json.loads(run(capsys, name, folder, bag, tmp_path / 'out', '--json').out)
    wrench = read_recording(folder / bag).wrench
    written = contact(tmp_path / 'out')
    assert written.t == pytest.approx(wrench.t, abs=1e-6)
    assert document['samples'] == document['valid'] == len(wrench)
    assert not any('no pose' in note or 'weight unknown' in note for note in document['notes'])
    late = written.values[written.t > 1.0]
    assert (np.abs(late[:, :3]) < 6 * arm.FORCE_NOISE).all()
    (only,) = statuses(tmp_path / 'out')
    assert only[2] == '1' and 'no accelerometer' in only[3]


@pytest.mark.parametrize('name', first(FILTERS))
def test_rows_that_are_not_valid_are_written_marked_and_left_out_of_the_figures(
        capsys, folder, tmp_path, name):
    said = run(capsys, name, folder, 'holed', tmp_path / 'out')
    document = json.loads(run(capsys, name, folder, 'holed', tmp_path / 'out', '--json').out)
    wrench = read_recording(folder / 'holed').wrench
    written = contact(tmp_path / 'out')
    assert len(written.t) == document['samples'] == len(wrench)
    bad = len(wrench) - document['valid']
    # two seconds without a pose, less the gap that is bridged
    assert 0.8 * 20 * (2.0 - 0.25) < bad <= 20 * 2
    assert f'over the {document["valid"]} valid wrenches' in said.out
    assert 'weight unknown' in said.err and f'({bad} of {len(wrench)} samples)' in said.err

    start = read_recording(folder / 'holed').start_ns * 1e-9
    changes = statuses(tmp_path / 'out')
    # without acceleration, without weight, and back; kalman says first that it was restarted
    first, lost, *again = [level for _, level, _, _ in changes]
    assert (first, lost) == (1, 2) and set(again) == {1}
    begin, end = (changes[i][0] - start for i in (1, 2))
    inside = (wrench.t >= begin - 1e-4) & (wrench.t < end - 1e-4)
    assert inside.sum() == bad
    assert document['mean'] == pytest.approx(written.values[~inside].mean(axis=0), abs=1e-9)
    assert document['std'] == pytest.approx(written.values[~inside].std(axis=0), abs=1e-9)


def test_a_filter_that_learns_refuses_a_recording_without_gravity(capsys, tmp_path):
    write_recording(tmp_path / 'bag', replace(slow_log(20.0, 20.0)[1], pose=None))
    save(arm.calibrate(np.random.default_rng(2))[0], tmp_path / 'c.yaml')
    assert main(['estimate', str(tmp_path / 'bag'), '--filter', 'ukf', '--calibration',
                 str(tmp_path / 'c.yaml'), '-o', str(tmp_path / 'out')]) == 1
    assert 'has neither a pose nor accelerometer' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('name', [name for name in FILTERS if name != 'ukf'])
def test_without_any_valid_row_there_are_no_figures(capsys, folder, tmp_path, name):
    write_recording(tmp_path / 'bag', replace(slow_log(20.0, 20.0)[1], pose=None))
    save(arm.calibrate(np.random.default_rng(2))[0], tmp_path / 'c.yaml')
    out = run(capsys, name, tmp_path, 'bag', tmp_path / 'out', '--json').out
    document = json.loads(out)
    assert document['valid'] == 0 and document['mean'] == [None] * 6
    assert len(contact(tmp_path / 'out')) == document['samples'] > 0
    said = run(capsys, name, tmp_path, 'bag', tmp_path / 'out').out
    assert ', none of them valid' in said and 'mean' not in said and 'None' not in said
