"""Presets: every name in them is one of the nodes', every value is one that its row allows."""

from pathlib import Path

from forcecal_ros.errors import ConfigError
from forcecal_ros.nodes.config import TABLES
from forcecal_ros.nodes.impedance_settings import settings_of as impedance_settings
from forcecal_ros.nodes.observer_settings import settings_of as observer_settings
from forcecal_ros.nodes.presets import CONTROLLERS, preset_file, read_preset, ROBOTS, topic_of
from forcecal_ros.nodes.sequencer_settings import settings_of as sequencer_settings
import pytest

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'robots.md'
CHECKS = {'sequencer': sequencer_settings, 'observer': observer_settings,
          'impedance': impedance_settings}
ARGUMENTS = {'wrench', 'current_pose', 'target_frame', 'joint_states', 'joint_trajectory',
             'delta_twist_cmds', 'contact_wrench'}


def test_there_is_no_file_that_is_not_offered():
    files = {path.stem for path in preset_file('ur').parent.iterdir()}
    assert files == {*ROBOTS, *CONTROLLERS}


@pytest.mark.parametrize('name', [*ROBOTS, *CONTROLLERS])
def test_a_preset_fits_the_nodes_and_the_page_shows_its_topics(name):
    preset = dict(read_preset(name))
    topics, page = preset.pop('topics'), PAGE.read_text()
    assert set(topics) <= ARGUMENTS
    assert f'`{name}`' in page and all(topic in page for topic in topics.values())
    for node, parameters in preset.items():
        rows = {row.name: row for row in TABLES[node][0]}
        assert set(parameters) <= set(rows)
        for key, value in parameters.items():
            assert type(value) is type(rows[key].default), key
            if rows[key].choices or isinstance(value, float):
                rows[key].row.take(type(rows[key].default), value, key)
        values = {key: row.default for key, row in rows.items()} | parameters
        if values.get('motion.backend') == 'joint_trajectory':
            with pytest.raises(ConfigError, match=r'numbers in joints\.values'):
                CHECKS[node](values)
            values |= {'joints.names': ['a'], 'joints.values': [0.1, 0.2, 0.3, 0.4],
                       'joints.away': [0.0]}
        CHECKS[node](values)


def test_robots_ask_for_a_preview_and_the_controller_counts_before_the_robot():
    assert all(read_preset(robot)['sequencer']['motion.require_preview'] for robot in ROBOTS)
    both = ('ur', 'cartesian_controllers')
    assert topic_of('current_pose', 'x', *both) == '/cartesian_motion_controller/current_pose'
    assert topic_of('current_pose', 'x', 'ur', '') == '/tcp_pose_broadcaster/pose'
    assert topic_of('wrench', 'x', *both) == '/force_torque_sensor_broadcaster/wrench'
    assert topic_of('optidrive', 'x', *both) == 'x'
