"""Poses from a file."""

from forcecal_ros.motion.profiles import anchor
from forcecal_ros.nodes.sequencer_settings import poses_from_file
import numpy as np


def test_poses_of_a_file_are_taken_where_the_robot_stands_if_they_say_nothing_else(tmp_path):
    path = tmp_path / 'poses.yaml'
    path.write_text('- {name: v, position: [.nan, .nan, .nan], orientation: [1.0, 0, 0, 0]}\n'
                    '- {name: up, position: [1, 2, 3], orientation: [0.6, 0, -0.8, 0]}\n')
    poses = anchor(poses_from_file(path), np.array([0.4, 0.0, 0.5]))
    assert list(poses) == ['v', 'up']
    np.testing.assert_array_equal(poses['v'].position, [0.4, 0.0, 0.5])
    np.testing.assert_array_equal(poses['up'].position, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(poses['v'].R_base_sensor, np.diag([1.0, -1.0, -1.0]), atol=1e-12)
