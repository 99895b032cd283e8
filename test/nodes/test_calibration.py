"""The main job over DDS: simulated rig, sequencer and observer, each a process of its own."""

import re
import signal

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.io.calibration_file import load, parse
from forcecal_ros.motion.limits import Limits
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.wire import Writer
from geometry_msgs.msg import InertiaStamped, PoseStamped, WrenchStamped
from live import Live, ON_RIG_TIME, RIG_TIME
import numpy as np
import pytest
from rclpy.time import Time
from scipy.spatial.transform import RigidTransform, Rotation
from std_msgs.msg import Float64MultiArray, String

LIMITS = Limits()


class Ears:
    """Commands, contact wrenches and true ones, by stamp."""

    def __init__(self, live, commands):
        self.commands, self.contact, self.truth, self.phases = {}, {}, {}, []
        live.hear(PoseStamped, commands, self.commands.__setitem__)
        live.hear(WrenchStamped, 'observer/contact_wrench', self.contact.__setitem__)
        live.hear(WrenchStamped, 'sim/contact_wrench', self.truth.__setitem__)
        live.node.create_subscription(DiagnosticArray, 'sequencer/phase', self._on_phase, OUTPUT)

    def _on_phase(self, message):
        stamp = message.header.stamp
        self.phases.append((stamp.sec * 10**9 + stamp.nanosec, message.status[0].message))

    def error(self, begin, end):
        """Return the errors of the contact wrench between two stamps, (n, 6)."""
        return np.array([np.subtract(values, self.truth[stamp])
                         for stamp, values in self.contact.items()
                         if begin <= stamp < end and stamp in self.truth])


class Flange:
    """
    Between the rig and its nodes: poses and commands are of a flange, wrenches of turned axes.

    The transforms are computed by scipy, not by the package.
    """

    PLACE = RigidTransform.from_components([0.02, -0.03, 0.11],
                                           Rotation.from_euler('xyz', [0.4, -0.3, 1.1]))
    TURN = [0.1, -0.2, 0.4]
    TOPICS = ('current_pose', 'target_frame', 'wrench')
    GIVEN = {'sensor__from_pose': [*PLACE.translation.tolist(),
                                   *PLACE.rotation.as_quat().tolist()]}

    def __init__(self, live):
        turned = np.kron(np.eye(2), Rotation.from_rotvec(self.TURN).as_matrix())
        self._relay(live, PoseStamped, 'rig/current_pose', 'current_pose', 'base',
                    lambda pose: self._moved(pose, self.PLACE.inv()))
        self._relay(live, PoseStamped, 'target_frame', 'rig/target_frame', 'base',
                    lambda pose: self._moved(pose, self.PLACE))
        self._relay(live, WrenchStamped, 'rig/wrench', 'wrench', 'ft_sensor',
                    lambda wrench: (np.array(wrench) @ turned).tolist())

    def _moved(self, pose, by):
        there = RigidTransform.from_components(pose[:3], Rotation.from_quat(pose[3:])) * by
        return [*there.translation.tolist(), *there.rotation.as_quat().tolist()]

    def _relay(self, live, kind, topic, to, frame, change):
        write, out = Writer(kind, frame), live.node.create_publisher(kind, to, OUTPUT)
        live.hear(kind, topic, lambda stamp, values: out.publish(write(stamp, change(values))))


@pytest.mark.long
def test_calibrates_publishes_observes_and_touches(ros_domain, tmp_path):
    path = tmp_path / 'calibration.yaml'
    with Live() as live:
        ears = Ears(live, 'rig/target_frame')
        texts = live.latched(String, 'sequencer/calibration')
        flange = Flange(live)
        given = flange.GIVEN | {'identify__sensor_rotation': flange.TURN}
        remap = [f'{topic}:=rig/{topic}' for topic in flange.TOPICS]
        live.start('sim', remap=remap, seed=5, **RIG_TIME)
        live.start('observer', use_sim_time=True)
        live.start('sequencer', save__path=path, **given, **ON_RIG_TIME)
        live.until(lambda: len(ears.truth) > 1000, 'a simulated rig')
        refused = live.call('sequencer/save_calibration')
        assert not refused.success and 'there is no calibration yet' in refused.message
        assert not ears.commands

        live.until(lambda: live.call('sequencer/start').success, 'start')
        live.until(lambda: live.phases[-1] in ('done', 'aborted'), 'the calibration', 300.0)
        assert live.phases[-1] == 'done', live.reasons
        check_phases_and_commands(ears)
        live.until(lambda: texts, 'a calibration')
        check_calibration(parse(texts[-1].data))
        check_latched(live)
        saved = live.call('sequencer/save_calibration')
        assert saved.success and re.search(
            r'calibration from the live recording that ended at .+: mass 1[23]\.\d+ ± 0\.\d+ kg, '
            r'centre of mass x .+ mm, y .+ mm, z .+ mm', saved.message)
        assert saved.message.partition(': ')[2] in live.said('sequencer')
        assert load(path).mass.value == parse(texts[-1].data).mass.value

        live.until(lambda: len(ears.contact) > 1000, 'an observer that took it over')
        check_contact(live, ears)
        for module in ('sequencer', 'observer', 'sim'):
            assert live.end(module, signal.SIGINT) == 0


def check_phases_and_commands(ears):
    words = [word for i, (_, word) in enumerate(ears.phases)
             if i == 0 or ears.phases[i - 1][1] != word]
    assert [word for word in words if word != 'idle'] == [
        'move', 'settle', 'measure'] * 4 + ['move', 'settle', 'step', 'settle', 'done']
    stamps = np.array(sorted(ears.commands))
    values = np.array([ears.commands[stamp] for stamp in stamps.tolist()])
    assert np.linalg.norm(values[0, :3] - [1.0, 0.0, 1.0]) < 2e-5
    speed = np.linalg.norm(np.diff(values[:, :3], axis=0), axis=1) / (np.diff(stamps) * 1e-9)
    assert 0.18 < speed.max() <= 0.1876
    assert (stamps % 10**6 == 0).all()
    assert (np.diff(stamps) == 4 * 10**6).mean() > 0.95


def check_calibration(calibration):
    assert float(calibration.mass) == pytest.approx(13.0, rel=3e-4)
    np.testing.assert_allclose(calibration.com.value, [0.03, -0.01, 0.14], atol=1e-4)
    np.testing.assert_allclose(calibration.wrench_bias.value[:3], [4, -3, 8], atol=0.02)
    np.testing.assert_allclose(calibration.wrench_bias.value[3:], [0.3, -0.2, 0.1], atol=0.003)
    assert calibration.observer.kalman['bandwidth'].value > 20
    assert calibration.sensor_frame == 'ft_sensor'


def check_latched(live):
    """Join late and hear the results all the same."""
    gains = live.latched(Float64MultiArray, 'sequencer/observer_gain')
    inertias = live.latched(InertiaStamped, 'sequencer/tool_inertia')
    live.until(lambda: gains and inertias, 'latched results')
    assert [dim.size for dim in gains[0].layout.dim] == [2, 3]
    assert all(dim.label for dim in gains[0].layout.dim)
    assert len(gains[0].data) == 6 and gains[0].data[5] == 1.0
    assert inertias[0].inertia.m == pytest.approx(13.0, rel=3e-4)
    assert inertias[0].inertia.com.z == pytest.approx(0.14, abs=1e-4)
    assert inertias[0].header.frame_id == 'ft_sensor'
    assert Time.from_msg(inertias[0].header.stamp).nanoseconds > live.entered['measure']


def check_contact(live, ears):
    assert all(answer.successful for answer in live.set(
        'sequencer', sequence='contact', timing__contact=0.5, timing__approach=1.5))
    live.phases.clear()
    live.until(lambda: live.call('sequencer/start').success, 'start')
    live.until(lambda: 'measure' in live.phases, 'measuring')
    live.until(lambda: 'approach' in live.phases, 'the approach')
    moving = live.entered['approach'] + 500_000_000
    live.until(lambda: max(ears.contact) > moving, 'motion')
    refused = live.call('observer/tare')
    assert not refused.success and 'the robot moves' in refused.message
    live.until(lambda: 'contact' in live.phases, 'contact')
    contact = live.entered['contact']
    live.until(lambda: live.phases[-1] in ('done', 'aborted'), 'the end')
    assert live.phases[-1] == 'done', live.reasons
    truth = np.array([values for stamp, values in ears.truth.items()
                      if contact <= stamp < contact + 0.4e9])
    assert truth[:, 0].min() < -15
    error = ears.error(contact, contact + 0.4e9)
    assert len(error) > 300
    assert np.abs(error[:, 0].mean()) < 0.25
    live.until(lambda: live.call('observer/tare').success, 'a robot that has come to rest')
