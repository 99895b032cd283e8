"""What RViz and Foxglove show of the running rig: types, QoS and frames as the nodes publish."""

import json
from pathlib import Path

from forcecal_ros.sim.rig.file import load_rig, urdf
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
import yaml

LAYOUTS = Path(__file__).resolve().parents[2] / 'layouts'
RVIZ = {'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
        'rviz_default_plugins/Path': 'nav_msgs/msg/Path',
        'rviz_default_plugins/Pose': 'geometry_msgs/msg/PoseStamped'}
"""What the displays of RViz take."""


def test_topics_types_and_frames_of_the_layouts_are_those_of_the_nodes(ros_domain):
    manager = yaml.safe_load((LAYOUTS / 'rviz.rviz').read_text())['Visualization Manager']
    displays = [display for display in manager['Displays'] if 'Topic' in display]
    wanted = {display['Topic']['Value'] for display in displays}
    frames = {}
    with Live() as live:
        for kind, topic in ((PoseStamped, 'current_pose'), (WrenchStamped, 'wrench')):
            live.node.create_subscription(
                kind, topic, lambda message, topic=topic: frames.__setitem__(
                    topic, message.header.frame_id), 10)
        for node in ('sim', 'sequencer'):
            live.start(node)
        live.start('observer', publish__marker_rate=20.0)
        live.until(lambda: len(frames) == 2 and all(
            live.node.count_publishers(topic) for topic in wanted), 'topics')
        said = {topic: live.node.get_publishers_info_by_topic(topic) for topic in wanted}
    for display in displays:
        (publisher,) = said[display['Topic']['Value']]
        assert publisher.topic_type == RVIZ[display['Class']], display['Name']
        qos, asked = publisher.qos_profile, display['Topic']
        if asked.get('Durability Policy') == 'Transient Local':
            assert qos.durability == DurabilityPolicy.TRANSIENT_LOCAL, display['Name']
        if asked['Reliability Policy'] == 'Reliable':
            assert qos.reliability == ReliabilityPolicy.RELIABLE, display['Name']
    assert frames['current_pose'] == manager['Global Options']['Fixed Frame']
    assert f'<link name="{frames["wrench"]}">' in urdf(load_rig())
    follow = {config['followTf'] for config in json.loads(
        (LAYOUTS / 'foxglove.json').read_text())['configById'].values() if 'followTf' in config}
    assert follow == {frames['current_pose']}
