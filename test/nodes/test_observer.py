"""The observer as a process: lifecycle, services, and the numbers of the offline replay."""

from dataclasses import replace
from types import SimpleNamespace

from forcecal_ros.core.calibration import Accelerometer, Calibration, Estimate, Noise, Tool
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.io.calibration_file import dump, save
from forcecal_ros.motion.profiles import Move, nominal_poses, Pose
from forcecal_ros.nodes.observer import Observer
from forcecal_ros.nodes.runtime import LATCHED
from forcecal_ros.observe import ContactSample, ObserverSettings, replay
from forcecal_ros.observe.live import refuse_motion
from forcecal_ros.observe.sample import INVALID
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from live import Live, Robot
import numpy as np
from playing import Player, START
import pytest
from std_msgs.msg import Float64MultiArray, String

HOME = nominal_poses()['v']
IN_FRAMES = {'publish__frames': '[tool0, base]',
             'publish__frame_poses': [0.0, 0.02, -0.1, 0.0, 0.0, 0.7071067811865475,
                                      0.7071067811865476]}
"""A flange behind the sensor that is turned by 90 deg about z, and the base."""


def nominal(mass=13.0):
    """Return the calibration that a perfect identification of the nominal rig would give."""
    return Calibration(
        mass=Estimate(mass, 0.0, 'kg'), com=Estimate([0.03, -0.01, 0.14], 0.0, 'm'),
        wrench_bias=Estimate([4.0, -3.0, 8.0, 0.3, -0.2, 0.1], 0.0, 'N, N m'),
        inertia=Estimate(np.diag([0.12, 0.15, 0.06]), 0.0, 'kg m^2'),
        accelerometer=Accelerometer(
            offset=Estimate([5.0938] * 3, 0.0, 'V'),
            gain=Estimate([-0.2937] * 3, 0.0, 'V/(m/s^2)'),
            map=Estimate(np.eye(3), 0.0, '1'), delay=Estimate(0.0, 0.0, 's'),
            position=Estimate([0.05, 0.0, 0.18], 0.0, 'm')),
        tool=Tool(Estimate(5000.0, 0.0, 'N/m'), Estimate(130.0, 0.0, 'N s/m')))


@pytest.fixture(scope='module')
def recording():
    """Simulate more than half a second of turning and shifting, and then rest."""
    goal = Pose(HOME.position + [0.005, 0.01, -0.005],
                HOME.R_base_sensor @ rotation_from_vector([0.1, 0.2, -0.1]))
    move = Move(HOME, goal, 0.6)
    setpoints = [move.at(t) for t in np.arange(0.0, 2.5, 0.004)]
    target = PoseStream(0.004 * np.arange(len(setpoints)),
                        np.array([s.pose.position for s in setpoints]),
                        np.array([s.pose.R_base_sensor for s in setpoints]))
    return simulate(load_rig(), target, seed=3)


def noisy():
    """Return the nominal calibration with the rig's noise, which filters want to know."""
    return replace(nominal(), noise=Noise(
        Q=Estimate(np.eye(2), 0.0, '(m, m/s)^2 s'),
        R=Estimate(np.eye(3), 0.0, '(m, m/s, m/s^2)^2 s'),
        wrench=Estimate(np.diag([0.25**2] * 3 + [0.02**2] * 3), 0.0, '(N, N m)^2'),
        specific_force=Estimate(np.eye(3) * 0.034**2, 0.0, '(m/s^2)^2'),
        wrench_rate=1000.0, accelerometer_rate=1000.0))


class Sent(list):
    publish = list.append


@pytest.mark.parametrize('status, sent', [(0, [(7.0,) * 6]), (INVALID, [])])
def test_where_nothing_is_known_no_weight_is_published(status, sent):
    wrench, out, inertial = (7.0,) * 6, Sent(), Sent()
    sample = ContactSample(1.0, wrench, status, wrench, wrench, wrench, None)
    Observer._publish(SimpleNamespace(
        _origin=0, _chain=SimpleNamespace(model=SimpleNamespace(pose_timeout=0.1)), _out=out,
        _optional=[('inertial', inertial)], _write=lambda stamp, values: values, _markers=None,
        _source=None, _frames=SimpleNamespace(publish=lambda *_: None)), sample)
    assert out == [wrench] and inertial == sent


def offline(recording, gravity):
    """Replay the recording by the observer, or by a filter of gravity compensation."""
    settings = ObserverSettings(None if gravity == 'none' else gravity)
    return replay(recording, noisy(), settings).contact


def test_node_and_replay_give_the_same_numbers(ros_domain, tmp_path, recording):
    path = tmp_path / 'calibration.yaml'
    save(noisy(), path)
    filters = ('none', 'ukf', 'static')
    with Live() as live:
        player = Player(live, filters)
        for name in filters:
            live.start('observer', name, [f'__node:={name}'], calibration__file=path,
                       gravity__filter=name, **(IN_FRAMES if name == 'none' else {}))
        elsewhere = {frame: {} for frame in ('tool0', 'base')}
        for frame, heard in elsewhere.items():
            live.hear(WrenchStamped, f'none/contact_wrench/{frame}', heard.__setitem__)
        player.until_heard()
        for name in filters:
            live.until(lambda: live.state(name) == 'active', 'active')
        stamps = player.play(recording)
        live.until(lambda: all(len(answers) >= len(stamps) - 5
                               for answers in player.heard.values()), 'all answers')
        for name in filters:
            refused = {pair.key: pair.value for pair in live.diagnostics[name].values}
            assert refused['wrench samples not used'] == '0', name
            assert live.end(name) == 0
    check_frames(player.answers, elsewhere, recording)
    assert np.ptp(recording.wrench.values[:, 0]) > 20
    for name in filters:
        answers, expected = player.array(stamps, name), offline(recording, name)
        np.testing.assert_allclose(answers, expected[:len(answers)], atol=1e-7, err_msg=name)
        assert np.abs(answers[1000:, :3]).max() < 2


def check_frames(answers, elsewhere, recording):
    """Compare with the transport of each wrench at rest, by hand."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    R, p = recording.pose.R_base_sensor[-1], recording.pose.position[-1]
    for frame, R_frame_sensor, origin in (('tool0', turn.T, -turn.T @ [0.0, 0.02, -0.1]),
                                          ('base', R, p)):
        rest = {stamp: values for stamp, values in elsewhere[frame].items()
                if stamp > START + 15 * 10**8}
        assert len(rest) > 500
        force, torque = (np.array([answers[stamp][part] for stamp in rest]) @ R_frame_sensor.T
                         for part in (slice(0, 3), slice(3, 6)))
        expected = np.hstack([force, torque + np.cross(origin, force)])
        # poses scatter by 2e-5 m and rad, with some newtons
        np.testing.assert_allclose(list(rest.values()), expected, atol=1e-3, err_msg=frame)


def test_lifecycle_tare_and_takeover(ros_domain, tmp_path, recording):
    path = tmp_path / 'calibration.yaml'
    with Live() as live:
        player = Player(live)
        live.start('observer', autostart='false', calibration__file=path, tools=tmp_path)
        assert live.state() == 'unconfigured'
        assert not live.ask_for(Transition.TRANSITION_CONFIGURE)
        assert live.state() == 'unconfigured' and str(path) in live.said('observer')

        save(nominal(), path)
        assert live.ask_for(Transition.TRANSITION_CONFIGURE)
        player.until_heard()
        for _ in range(20):
            player.out['wrench'][0].publish(player.out['wrench'][1](START, [0.0] * 6))
        live.spin(0.3)
        assert live.state() == 'inactive' and not player.answers
        live.until(lambda: live.diagnostics.get('observer')
                   and live.diagnostics['observer'].message == 'not active', 'diagnostics')
        assert live.ask_for(Transition.TRANSITION_ACTIVATE)

        player.play(recording, 0.0, 0.55)
        refused = live.call('observer/tare')
        assert not refused.success and 'tare refused, the robot moves' in refused.message

        player.play(recording, 0.55, 1.2)
        stamps = player.play(recording, 1.2, 2.0, shift=5.0)
        assert player.array(stamps)[-200:, 0].mean() == pytest.approx(5.0, abs=0.1)
        tared = live.call('observer/tare')
        assert tared.success, tared.message
        stamps = player.play(recording, 2.0, 2.2, shift=5.0)
        assert player.array(stamps)[-50:, 0].mean() == pytest.approx(0.0, abs=0.15)

        check_takeover(live, player, recording)
        check_settings(live, player, recording)
        check_tools(live, player, recording, tmp_path)
        assert live.call('observer/reload_calibration').success
        assert live.call('observer/reset').success
        assert live.end('observer') == 0


def check_takeover(live, player, recording):
    """Take over a mass off by 5 kg, which moves the estimate by 49 N, and by no jump."""
    publisher = live.node.create_publisher(String, 'sequencer/calibration', LATCHED)
    live.until(publisher.get_subscription_count, 'a follower')
    before = player.array(player.play(recording, 2.2, 2.25, shift=5.0))
    publisher.publish(String(data='mass: a riddle'))
    live.until(lambda: 'not used: sequencer/calibration' in live.said('observer'), 'refusal')
    noise = Noise(Estimate(np.eye(2), 0.0, '(m, m/s)^2 s'),
                  Estimate(np.eye(3), 0.0, '(m, m/s, m/s^2)^2 s'),
                  Estimate(np.diag([0.0625] * 3 + [4e-4] * 3), 0.0, '(N, N m)^2'),
                  wrench_rate=1000.0)
    heard = live.latched(Float64MultiArray, 'observer/accuracy')
    live.until(lambda: heard, 'accuracy')
    assert np.isnan(heard[-1].data).all()  # without noise nothing can be promised
    publisher.publish(String(data=dump(replace(nominal(mass=8.0), noise=noise))))
    live.until(lambda: 'taken from sequencer/calibration' in live.said('observer'), 'takeover')
    live.until(lambda: np.isfinite(heard[-1].data).all(), 'a promise')
    assert [dim.size for dim in heard[-1].layout.dim] == [6, 6]
    assert 0.05 < heard[-1].data[0] ** 0.5 < 0.25
    stamps = player.play(recording, 2.25, 2.5, shift=5.0)
    after = player.array(stamps)
    steps = np.abs(np.diff(np.concatenate([before, after])[:, :3], axis=0)).max(axis=0)
    assert (steps < 0.5).all()
    assert abs(after[-1, 2] - before[-1, 2]) > 5


def check_tools(live, player, recording, folder):
    """Take up a tool 1 kg heavier, and put it down again: nothing jumps, and the tare stays."""
    save(nominal(mass=14.0), folder / 'gripper.yaml')
    save(replace(nominal(), sensor_frame='other'), folder / 'other.yaml')
    for name, why in (('other', "is for 'other' with sign 1"), ('none', 'cannot be read'),
                      ('../gripper', 'is not found')):
        (answer,) = live.set('observer', tool=name)
        assert not answer.successful and why in answer.reason
    origin = START + 15 * 10**8
    player.play(recording, 2.0, 2.5, origin=origin, shift=5.0)
    tared = live.call('observer/tare')
    assert tared.success, tared.message
    origin += 5 * 10**8
    before = player.array(player.play(recording, 2.0, 2.5, origin=origin, shift=5.0))[-100:]
    assert np.abs(before[:, :3].mean(axis=0)).max() < 0.2
    for name, kilograms in (('gripper', 6.0), ('', -1.0)):
        assert live.set('observer', tool=name)[0].successful
        heard = before
        for _ in range(2):
            origin += 5 * 10**8
            stamps = player.play(recording, 2.0, 2.5, origin=origin, shift=5.0)
            heard = np.concatenate([heard, player.array(stamps)])
        assert np.abs(np.diff(heard[:, :3], axis=0)).max() < 0.5
        moved = np.linalg.norm(heard[-100:, :3].mean(axis=0) - before[-50:, :3].mean(axis=0))
        assert moved == pytest.approx(abs(kilograms) * 9.80665, abs=0.2)
        before = heard[-100:]


def check_settings(live, player, recording):
    """Set values while a force of 50 N is published, which they leave without a jump."""
    (answer,) = live.set('observer', observer__mode='newton')
    assert not answer.successful and 'observer.K' in answer.reason
    before = player.array(player.play(recording, 2.0, 2.5, origin=START + 5 * 10**8, shift=5.0))
    assert np.abs(before[-1, :3]).max() > 40
    (answer,) = live.set('observer', observer__bandwidth=10.0)
    assert answer.successful
    after = player.array(player.play(recording, 2.0, 2.5, origin=START + 10**9, shift=5.0))
    steps = np.abs(np.diff(np.concatenate([before[-20:], after])[:, :3], axis=0)).max(axis=0)
    assert (steps < 0.5).all(), steps
    assert live.set('observer', observer__bandwidth_max=20.0)[0].successful
    (answer,) = live.set('observer', observer__bandwidth_min=50.0)
    assert not answer.successful and 'at most bandwidth_max_hz, 20' in answer.reason
    (answer,) = live.set('observer', observer__bandwidth=-1.0)
    assert not answer.successful


def test_without_calibration_or_wrench_the_diagnostics_say_so(ros_domain):
    with Live() as live:
        live.start('observer', accelerometer__source='none')
        live.until(lambda: 'observer' in live.diagnostics, 'diagnostics')
        assert live.diagnostics['observer'].message == 'waiting for a calibration'
        answer = live.call('observer/tare')
        assert not answer.success and 'there is no calibration yet' in answer.message
        publisher = live.node.create_publisher(String, 'sequencer/calibration', LATCHED)
        publisher.publish(String(data=dump(nominal())))
        live.until(lambda: live.diagnostics['observer'].message == 'wrench: nothing received',
                   'a calibration')
        assert live.diagnostics['observer'].level == b'\2'
        Robot(live)  # its accelerometer is not configured, and not missed
        live.until(lambda: 'nothing received' not in live.diagnostics['observer'].message,
                   'estimates')
        assert 'no accelerometer' not in live.diagnostics['observer'].message


def test_slow_motion_and_slow_turning_are_motion():
    q = (1.0, 0.0, 0.0, 0.0)
    refuse_motion([(1.0, 0.0, 1.0, *q), (1.0001, 0.0, 1.0, *q)])
    refuse_motion([(np.nan, np.nan, np.nan, *q)] * 3)
    with pytest.raises(DataError, match='tare refused, the robot moves: 1.00 mm'):
        refuse_motion([(1.0, 0.0, 1.0, *q), (1.001, 0.0, 1.0, *q)])
    turned = (*np.cos([0.001]), 0.0, 0.0, *np.sin([0.001]))
    with pytest.raises(DataError, match='2.00 mrad'):
        refuse_motion([(1.0, 0.0, 1.0, *q), (1.0, 0.0, 1.0, *turned)])
