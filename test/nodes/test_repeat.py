"""A planned calibration, one pose of it disturbed and measured again, through the real nodes."""

from forcecal_ros.cli.main import main
from forcecal_ros.io.calibration_file import parse
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.wire import Writer
from geometry_msgs.msg import WrenchStamped
from live import Live, ON_RIG_TIME, RIG_TIME
import numpy as np
import pytest
from std_msgs.msg import String

PULL = np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0])


def relay(live):
    """Pass the wrench on, a cable pulling from the second pose's measurement until it ends."""
    out, write = live.node.create_publisher(WrenchStamped, 'wrench', OUTPUT), Writer(
        WrenchStamped, 'ft_sensor')

    def take(stamp, values):
        pulled = live.phases.count('measure') == 2 and live.phases[-1] == 'measure'
        out.publish(write(stamp, np.array(values) + PULL * pulled))

    live.hear(WrenchStamped, 'wrench_unpulled', take)


@pytest.mark.long
def test_a_planned_pose_that_is_off_is_measured_again(ros_domain, tmp_path):
    plan = tmp_path / 'plan.yaml'
    assert main(['plan', '--for', 'calibration', '--duration', '14', '--quiet', '-o',
                 str(plan)]) == 0
    with Live() as live:
        relay(live)
        texts = live.latched(String, 'sequencer/calibration')
        live.start('sim', seed=3, remap=['wrench:=wrench_unpulled'], **RIG_TIME)
        live.start('sequencer', files=[plan], identify__repeats=1, **ON_RIG_TIME)
        live.until(lambda: live.call('sequencer/start').success, 'start')
        live.until(lambda: live.phases[-1] in ('done', 'aborted'), 'the calibration', 300.0)
        assert live.phases[-1] == 'done', live.reasons
        assert 'pose_1 is off what the other poses predict' in live.said('sequencer')
        live.until(lambda: texts, 'a calibration')
        calibration = parse(texts[-1].data)
        assert len(calibration.quality['poses']) == plan.read_text().count(' 1.0, 0.0, 1.0,')
        assert calibration.quality['rejection']['pose'] is None
        np.testing.assert_allclose(calibration.wrench_bias.value[:3], [4.0, -3.0, 8.0], atol=0.02)
