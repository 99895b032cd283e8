"""The same damaged recording gets the same answer from every command that reads it."""

from dataclasses import replace
import re
import shutil

from calibration_runs import brief_run
from forcecal_ros.cli.main import main
from forcecal_ros.core.streams import Stream
from forcecal_ros.io.bags import write_recording
from insitu_leg import Leg, PROTOCOL, record
from leg_files import write_leg
from longer import but
import numpy as np
import pytest


@pytest.fixture(scope='module')
def recording():
    return brief_run()


@pytest.fixture(scope='module')
def folder(tmp_path_factory, brief):
    folder = tmp_path_factory.mktemp('same')
    shutil.copy(brief / 'c.yaml', folder)
    return folder


def with_values(recording, name, change):
    stream = getattr(recording, name)
    return replace(recording, **{name: replace(stream, values=change(
        stream.t, np.array(stream.values)))})


def nonsense(value):
    def change(t, values):
        values[(t > 4.0) & (t < 6.0), 4] = value
        return values
    return change


def stuck(channel, start, end=np.inf):
    def change(t, values):
        inside = (t >= start) & (t < end)
        values[inside, channel] = values[np.argmax(inside), channel]
        return values
    return change


def clipped(t, values):
    values[:, 5] = np.minimum(values[:, 5], 2.9)  # 2.85 in the poses, 3.55 on the way
    return values


def frozen_pose(recording):
    pose = recording.pose
    source = np.minimum(np.arange(len(pose)), np.searchsorted(pose.t, 6.0))
    return replace(recording, pose=replace(
        pose, position=pose.position[source], R_base_sensor=pose.R_base_sensor[source]))


def later(recording, name, way):
    stream = getattr(recording, name)
    return replace(recording, **{name: replace(stream, t=stream.t + way)})


NONSENSE = (r'wrench: 1\d\.\d % of the samples are not finite or beyond 1e\+06 '
            r'\(torque\.y from 4\.00 s on\)')

REFUSED = {
    'readings of 1e7': (lambda r: with_values(r, 'wrench', nonsense(1e7)), NONSENSE),
    'one channel stuck from 45 % on': (
        lambda r: with_values(r, 'wrench', stuck(3, 0.45 * r.wrench.t[-1])),
        r'torque\.x is stuck at \S+ from 6\.\d\d s to 1\d\.\d\d s while other channels change'),
    'a dead channel': (
        lambda r: with_values(r, 'wrench', stuck(0, 0.0)), r'force\.x is constant at \S+; check'),
    'a wrench that sticks': (
        lambda r: with_values(r, 'wrench', stuck(slice(None), 7.0)),
        r'wrench: all channels are constant from 7\.00 s to 1\d\.\d\d s'),
    'a pose that freezes while commands move': (
        frozen_pose,
        (r'current_pose is constant from 6\.00 s to 1\d\.\d\d s of '
         r'\S+, while the commanded pose moves')),
    'a pose that falls silent while commands move': (
        lambda r: replace(r, pose=r.pose.between(0.0, 6.0)),
        r'current_pose has no message from 6\.00 s on of \S+, while the commanded pose moves'),
    'an empty wrench': (lambda r: replace(r, wrench=r.wrench.between(0.0, 0.0)),
                        'wrench: no message was recorded'),
    'clocks apart': (
        lambda r: later(r, 'wrench', 1e4),
        r'streams do not overlap with accelerometer .*: wrench \+10000\.0 s'),
}
"""What is done to a recording, and what every command says of it."""

ACCEPTED = {
    'a channel that is clipped in motion': (
        lambda r: with_values(r, 'wrench', clipped),
        r'torque\.z is clipped at 2\.9 \(\d+ samples, the first at \d+\.\d\d s\)'),
    'single readings of 1e7': (
        lambda r: with_values(r, 'wrench', lambda t, v: np.where(
            (np.arange(len(t)) % 249 == 5)[:, np.newaxis], 1e7, v)),
        r'wrench: 1\d samples are not finite or beyond 1e\+06 and left out'),
    'an accelerometer that pauses': (
        lambda r: replace(r, accelerometer=Stream(*(
            x[(r.accelerometer.t < 1.0) | (r.accelerometer.t > 1.7)]
            for x in (r.accelerometer.t, r.accelerometer.values)))),
        r'accelerometer: nothing was recorded for 0\.7 s from 1\.0 s on'),
    'an optidrive without a message': (
        lambda r: replace(r, optidrive=r.optidrive.between(0.0, 0.0)),
        'optidrive: no message; treated as not measured'),
}
"""The same with what every command notes, and goes on; all are done to one recording."""


def commands(folder, bag):
    known = ['--calibration', folder / 'c.yaml']
    return {
        'calibrate': ['calibrate', bag, '-o', folder / 'out.yaml'],
        'estimate': ['estimate', bag, *known, '-o', folder / 'estimated'],
        'static': ['estimate', bag, *known, '--filter', 'static', '-o', folder / 'compensated'],
        'diagnose': ['diagnose', bag, '-o', folder / 'diagnosis'],
        'by motion': ['diagnose', bag, *known, '-o', folder / 'by_motion']}


def said_by(capsys, arguments):
    """Run one command; return its status, and everything it said."""
    status = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return status, out + err


def answers(capsys, folder, recording):
    """Give a recording to every command; yields its name, its status, and what it said."""
    bag = folder / 'changed'
    write_recording(bag, recording)
    for name, arguments in commands(folder, bag).items():
        yield name, *said_by(capsys, arguments)


@pytest.mark.parametrize('damage', but(
    REFUSED, {*REFUSED} - {'a pose that falls silent while commands move'}))
def test_every_command_refuses_with_the_same_sentence(capsys, folder, recording, damage):
    change, sentence = REFUSED[damage]
    reasons = set()
    for name, status, said in answers(capsys, folder, change(recording)):
        assert status == 1, (name, said)
        line = next(line for line in said.splitlines() if 'note:' not in line)
        reasons.add(line.partition('forcecal: ')[2] or line.partition('invalid_data: ')[2])
    assert len(reasons) == 1, reasons
    assert re.match(sentence, reasons.pop())


@pytest.mark.parametrize('changes', [
    pytest.param((), id='sound', marks=pytest.mark.long),
    pytest.param(tuple(ACCEPTED), id='changed', marks=pytest.mark.long)])
def test_every_command_goes_on_and_notes_the_same(capsys, folder, recording, changes):
    for one in changes:
        recording = ACCEPTED[one][0](recording)
    noted = set()
    for name, status, said in answers(capsys, folder, recording):
        assert status == 0, (name, said)
        for one in changes:
            found = re.search(ACCEPTED[one][1], said)
            assert found, (name, said)
            noted.add(found.group())
    assert len(noted) == len(changes)


LEG = {
    'a channel stuck from 45 % on': (
        lambda log: replace(log, raw=stuck(2, 27.0)(log.t, np.array(log.raw))),
        r'channel 3 is stuck at \S+ from 27\.00 s to \d\d\.\d\d s while other channels change'),
    'a dead channel': (lambda log: replace(log, raw=stuck(2, 0.0)(log.t, np.array(log.raw))),
                       r'channel 3 is constant at \S+'),
    'readings of 1e10': (
        lambda log: replace(log, raw=nonsense(1e10)(log.t, np.array(log.raw))),
        (r'\S+: \d\.\d % of the samples are not finite or beyond 4\.29497e\+09 '
         r'\(column \S+ from 4\.0')),
    'a dead accelerometer': (lambda log: replace(log, accel=np.ones_like(log.accel)),
                             'accelerometer: the values never change'),
}


@pytest.mark.parametrize('kind, damage', [
    ('mcap', 'clocks apart'), *(('csv', one) for one in LEG),
    *(pytest.param('mcap', one, marks=pytest.mark.long) for one in LEG)])
def test_in_situ_calibration_refuses_by_the_same_checks(capsys, tmp_path, kind, damage):
    apart = 1e4 if damage == 'clocks apart' else 0.0
    change, sentence = (lambda log: log, r'.* imu/data_raw \+10000\.0 s') if apart else LEG[damage]
    write_leg(tmp_path, change(record(PROTOCOL[0], Leg(duration=60.0), 1)), kind, apart)
    status, said = said_by(capsys, ['insitu', tmp_path / 'leg.yaml', '-o', tmp_path / 'out'])
    assert status == 1
    assert re.search(f'forcecal: leg: {sentence}', said), said
