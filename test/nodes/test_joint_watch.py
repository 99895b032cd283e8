"""A robot that is told joints and does not follow them."""

from forcecal_ros.nodes.runtime import OUTPUT
from live import Live, Robot
import numpy as np
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

HOME = np.array([0.0, -0.5, 0.5, 0.0, 1.0, 0.0])
AWAY = HOME + [0.0, 0.0, 0.0, 0.6, 0.0, 0.0]
NAMES = [f'joint_{i}' for i in range(1, 7)]


def test_joints_that_stay_behind_their_commands_end_the_motion(ros_domain):
    heard = []
    with Live() as live:
        Robot(live, commands=False)
        states = live.node.create_publisher(JointState, 'joint_states', OUTPUT)
        live.node.create_timer(0.01, lambda: states.publish(
            JointState(name=NAMES, position=HOME.tolist())))
        live.node.create_subscription(JointTrajectory, 'joint_trajectory', heard.append, 2000)
        live.start('sequencer', motion__backend='joint_trajectory', poses__names='[v, h]',
                   poses__values=[1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0] * 2, settle__window=0.1,
                   timing__measure=0.2, joints__names=f'[{", ".join(NAMES)}]',
                   joints__values=[*HOME.tolist(), *AWAY.tolist()], joints__away=HOME.tolist(),
                   limits__workspace_max=[1.3, 0.4, 1.4])
        answers = []

        def started():
            answers.append(live.call('sequencer/start'))
            return answers[-1].success

        live.until(started, 'start')
        assert 'limits.workspace' in answers[-1].message
        live.until(lambda: live.phases[-1] in ('done', 'aborted'), 'the end')
        live.spin(0.3)
    assert live.reasons[-1].startswith('joint_states: joint_4 is 0.2')
    told = np.array([message.points[0].positions for message in heard])
    assert 0.2 < told[:, 3].max() < 0.59
    assert not any(heard[-1].points[0].velocities)
