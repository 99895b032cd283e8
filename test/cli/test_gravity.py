"""``forcecal estimate --filter ukf``, ``ekf`` and ``static`` from bag to bag."""

from dataclasses import replace
import json

from forcecal_ros.cli.main import main
from forcecal_ros.io.bags import (
    read_calibrations,
    read_recording,
    write_recording,
    write_signals,
)
from forcecal_ros.io.calibration_file import parse, save
from forcecal_ros.observe import ObserverSettings, replay
import gravity_arm as arm
import numpy as np
import pytest


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp('gravity')
    calibration, drift = arm.calibrate(np.random.default_rng(21), seconds=0.3)
    rng = np.random.default_rng(22)
    recording = arm.record(arm.free_motion(rng, 1.5), rng, accelerometer_bias=drift)
    save(calibration, path / 'c.yaml')
    write_recording(path / 'bag', recording)
    write_recording(path / 'imu_only', replace(recording, pose=None))
    return path


def run(capsys, folder, out, *arguments, bag='bag', calibration=True):
    known = ['--calibration', str(folder / 'c.yaml')] if calibration else []
    name = [] if '--filter' in arguments else ['--filter', 'ukf']
    status = main(['estimate', str(folder / bag), *known, '-o', str(out), *name, *arguments])
    return status, *capsys.readouterr()


def test_the_bag_holds_what_the_replay_gives(capsys, folder, tmp_path):
    status, out, err = run(capsys, folder, tmp_path / 'out')
    assert (status, err) == (0, '')
    assert '1500 contact wrenches by ukf, gravity from the pose' in out
    written = read_recording(tmp_path / 'out', topics={'wrench': 'observer/contact_wrench'}).wrench
    calibration = parse(read_calibrations(tmp_path / 'out')[0])
    expected = replay(read_recording(folder / 'bag'), calibration, ObserverSettings('ukf'))
    assert (written.values == expected.contact).all()
    assert written.t == pytest.approx(expected.t)


@pytest.mark.parametrize('name', [
    pytest.param('ukf', marks=pytest.mark.long),
    pytest.param('ekf', marks=pytest.mark.long),
    'static'])
def test_json_tells_the_figures(capsys, folder, tmp_path, name):
    status, out, _ = run(capsys, folder, tmp_path / 'out', '--filter', name, '--json')
    document = json.loads(out)
    assert status == 0
    assert document['filter'] == name and document['samples'] == 1500
    assert (np.abs(document['mean']) < arm.TABLE).all()
    assert (document['nis'] is None) == (name == 'static')


def test_a_recording_without_pose_is_compensated_by_its_imu(capsys, folder, tmp_path):
    status, out, _ = run(capsys, folder, tmp_path / 'out', '--json', bag='imu_only')
    document = json.loads(out)
    assert status == 0 and document['orientation'] == 'imu'
    assert document['mass'] == pytest.approx(arm.MASS, abs=0.002)


def test_static_without_a_pose_is_refused_in_one_line(capsys, folder, tmp_path):
    status, out, err = run(capsys, folder, tmp_path / 'out', '--filter', 'static', bag='imu_only')
    assert (status, out, err.count('\n')) == (1, '', 1)
    assert 'needs a pose' in err
    assert not (tmp_path / 'out').exists()


def test_a_recording_that_identifies_no_tool_asks_for_a_calibration(capsys, folder, tmp_path):
    status, _, err = run(capsys, folder, tmp_path / 'out', calibration=False)
    assert status == 1
    assert 'no --calibration is given' in err


def test_the_calibration_in_the_recording_is_used(capsys, folder, tmp_path):
    recording = read_recording(folder / 'bag')
    write_signals(tmp_path / 'bag', {
        'wrench': recording.wrench, 'accel': recording.accelerometer, 'pose': recording.pose,
        'calibration': (folder / 'c.yaml').read_text()}, recording.start_ns)
    status, out, _ = run(capsys, tmp_path, tmp_path / 'out', '--json', calibration=False)
    assert status == 0
    assert json.loads(out)['calibration'] == 'in the recording'
