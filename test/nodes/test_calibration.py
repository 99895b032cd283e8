"""The main job over DDS with a sensor of other axes, on a robot whose poses are of its flange."""

import re
import signal

from forcecal_ros.io.calibration_file import load, parse
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.wire import Writer
from geometry_msgs.msg import InertiaStamped, PoseStamped, WrenchStamped
from live import Live, ON_RIG_TIME, RIG_TIME
import numpy as np
import pytest
from rclpy.time import Time
from scipy.spatial.transform import RigidTransform, Rotation
from std_msgs.msg import Float64MultiArray, String


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
def test_a_rotated_sensor_on_a_flange_is_calibrated_saved_and_observed(ros_domain, tmp_path):
    path = tmp_path / 'calibration.yaml'
    contact = []
    with Live() as live:
        live.hear(WrenchStamped, 'observer/contact_wrench',
                  lambda _, values: contact.append(values))
        texts = live.latched(String, 'sequencer/calibration')
        flange = Flange(live)
        given = flange.GIVEN | {'identify__sensor_rotation': flange.TURN}
        remap = [f'{topic}:=rig/{topic}' for topic in flange.TOPICS]
        live.start('sim', remap=remap, seed=5, **RIG_TIME)
        live.start('observer', use_sim_time=True)
        live.start('sequencer', save__path=path, **given, **ON_RIG_TIME)
        live.until(lambda: live.call('sequencer/start').success, 'start')
        live.until(lambda: live.phases[-1] in ('done', 'aborted'), 'the calibration', 300.0)
        assert [word for word in live.phases if word != 'idle'] == [
            'move', 'settle', 'measure'] * 4 + ['move', 'settle', 'step', 'settle', 'done']
        live.until(lambda: texts, 'a calibration')
        check_calibration(parse(texts[-1].data))
        check_latched(live)
        saved = live.call('sequencer/save_calibration')
        assert saved.success and re.search(
            r'calibration from the live recording that ended at .+: mass 1[23]\.\d+ ± 0\.\d+ kg, '
            r'centre of mass x .+ mm, y .+ mm, z .+ mm', saved.message)
        assert saved.message.partition(': ')[2] in live.said('sequencer')
        assert load(path).mass.value == parse(texts[-1].data).mass.value

        live.until(lambda: len(contact) > 1000, 'an observer that took it over')
        assert np.abs(np.mean(contact[-500:], axis=0)[:3]).max() < 0.25  # of 127 N
        live.until(lambda: live.call('observer/tare').success, 'a robot that has come to rest')
        for module in ('sequencer', 'observer', 'sim'):
            assert live.end(module, signal.SIGINT) == 0


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
