"""Poses from a file: the four that come with the package are worth their time."""

from pathlib import Path

from calibration_runs import run
from forcecal_ros.identify.pipeline import identify
from forcecal_ros.identify.settings import IdentificationSettings
from forcecal_ros.motion.poses import anchor, nominal_poses
from forcecal_ros.nodes.sequencer_settings import poses_from_file
from forcecal_ros.simulators.rig.file import load_rig
import numpy as np

FILE = Path(__file__).parents[2] / 'config' / 'precise_poses.yaml'


def test_four_poses_within_the_default_limits_halve_the_error_of_the_offset():
    home = nominal_poses()['v']
    poses = anchor(poses_from_file(FILE), home.position)
    assert len(poses) == 4
    np.testing.assert_allclose(poses['v'].R_base_sensor, home.R_base_sensor, atol=1e-9)
    recordings = {name: run(seed=1, poses=some)
                  for name, some in (('three', None), ('four', poses))}
    found = {name: identify(one, IdentificationSettings()) for name, one in recordings.items()}
    std = {name: one.accelerometer.offset.std.max() for name, one in found.items()}
    assert std['four'] < 0.6 * std['three'] and std['four'] < 0.5e-3 / 3
    truth = load_rig().accelerometer.acc1.offset
    assert np.abs(found['four'].accelerometer.offset.value - truth).max() < 0.5e-3
    assert recordings['four'].target.t[-1] < recordings['three'].target.t[-1] + 6.0
