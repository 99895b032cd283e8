"""Calibrations of a wrench in another frame, of swapped axes, and of an arm on a wall."""

from dataclasses import replace

from calibration_runs import run
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import Stream
from kuka import GRAVITY, static_recording
from longer import first
import numpy as np
import pytest


def turn(*degrees):
    return rotation_from_vector(np.radians(degrees))


def turned(recording, R):
    """Return the recording with its wrench in other axes: R (3, 3), or one a sample."""
    wrench = recording.wrench
    parts = wrench.values.reshape(-1, 2, 3)
    values = np.einsum('...ij,...kj->...ki', np.broadcast_to(R, (len(wrench), 3, 3)), parts)
    return replace(recording, wrench=replace(wrench, values=values.reshape(-1, 6)))


def tilted(recording, R):
    """Return the recording in a base that is turned by R."""
    def of(stream):
        return stream and replace(stream, position=stream.position @ R.T,
                                  R_base_sensor=R @ stream.R_base_sensor)
    return replace(recording, pose=of(recording.pose), target=of(recording.target))


def orientations(recording):
    """Orientation of the sensor at each wrench."""
    pose = recording.pose
    last = np.searchsorted(pose.t, recording.wrench.t, side='right') - 1
    return pose.R_base_sensor[np.maximum(last, 0)]


@pytest.fixture(scope='module', params=first(['arm', 'rig']))
def sound(request):
    """Return a sound recording and the magnitude of gravity: a real arm's, and the rig's."""
    if request.param == 'rig':
        return run(seed=1), 9.80665
    return static_recording(request.getfixturevalue('kuka_data')), GRAVITY


@pytest.mark.parametrize('R, said', [
    (turn(0.0, 0.0, -30.0), r'rotated by (30|29)\.\d+ .* deg about z'),
    (np.diag([1.0, -1.0, 1.0]), 'mirrored .*x, y, z measure x, -y, z'),
    (orientations, 'expressed in the base')])
def test_other_axes_and_frames_are_refused_with_their_name(sound, R, said):
    recording, gravity = sound
    with pytest.raises(DataError, match=said):
        identify(turned(recording, R(recording) if callable(R) else R),
                 IdentificationSettings(gravity=gravity))


def test_an_arm_on_a_wall_is_calibrated_once_gravity_is_stated(sound):
    recording, gravity = sound
    plain = identify(recording, IdentificationSettings(gravity=gravity))
    on_wall = tilted(recording, turn(90.0, 0.0, 0.0))
    with pytest.raises(DataError, match='tilted.*--gravity-direction') as refused:
        identify(on_wall, IdentificationSettings(gravity=gravity))
    said = tuple(float(x) for x in str(refused.value).rpartition('direction ')[2].split())
    found = identify(on_wall, IdentificationSettings(gravity=gravity, gravity_direction=said))
    assert float(found.mass) == pytest.approx(float(plain.mass), rel=2e-4)
    exact = identify(on_wall, IdentificationSettings(
        gravity=gravity, gravity_direction=(0.0, 3.0, 0.0)))
    for key in ('mass', 'com', 'wrench_bias'):
        np.testing.assert_allclose(getattr(exact, key).value, getattr(plain, key).value,
                                   rtol=1e-6, atol=1e-7)
    assert exact.gravity_direction == (0.0, 1.0, 0.0)
    assert exact.quality['warnings'] == plain.quality['warnings']


def test_a_base_that_is_a_little_off_is_named(sound):
    recording, gravity = sound
    found = identify(tilted(recording, turn(1.5, 0.0, 0.0)),
                     IdentificationSettings(gravity=gravity))
    assert any('--gravity-direction' in line and 'suspect: mass' in line
               for line in found.quality['warnings'])


def test_no_direction_is_no_direction():
    with pytest.raises(DataError.__mro__[1], match='gravity_direction'):
        IdentificationSettings(gravity_direction=(0.0, 0.0, 0.0))


@pytest.mark.long
def test_subsets_of_real_poses_raise_no_alarm(kuka_data):
    recording = static_recording(kuka_data)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        keep = np.sort(rng.choice(24, rng.integers(5, 20), replace=False))
        some = replace(
            recording, phases=tuple(recording.phases[i] for i in keep),
            wrench=Stream(recording.wrench.t[keep], recording.wrench.values[keep]),
            accelerometer=None)
        found = identify(some, IdentificationSettings(gravity=GRAVITY))
        assert float(found.mass) == pytest.approx(0.932, abs=0.01)
        assert not any('turned' in line or 'direction' in line
                       for line in found.quality['warnings'])
