"""The sim node has the effects that its rig file says."""

from effects_runs import clean, resting, RIG
from forcecal_ros.effects import with_effects
from forcecal_ros.sim.rig.file import dump_rig
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
from live import Live
import numpy as np


def test_node_has_the_effects_of_its_rig_file(ros_domain, tmp_path):
    rig = with_effects(RIG, {
        'wrench_gain': {'fz': 0.1}, 'wrench_delay': {'delay': 0.003}, 'tool_mass': {'change': 0.1},
        'accel_bias': {'x': 0.3}, 'base_tilt': {'x': 0.05}, 'dropouts': {'pose': 0.9}})
    (tmp_path / 'rig.yaml').write_text(dump_rig(rig))
    expected = clean(rig, resting())
    heard = {'wrench': {}, 'accelerometer/raw': {}, 'current_pose': {}}
    with Live() as live:
        for topic, kind in zip(heard, (WrenchStamped, Vector3Stamped, PoseStamped)):
            live.hear(kind, topic, heard[topic].__setitem__)
        live.start('sim', rig=str(tmp_path / 'rig.yaml'), seed=1)
        live.until(lambda: len(heard['accelerometer/raw']) > 800, 'samples')
    for topic, values, sigma in (('wrench', expected.wrench.values, [0.25] * 3 + [0.02] * 3),
                                 ('accelerometer/raw', expected.accelerometer.values, 0.01)):
        samples = np.array(list(heard[topic].values()))
        error = samples.mean(axis=0)[:values.shape[1]] - values[-1]
        assert (np.abs(error) < 5.0 * np.array(sigma) / np.sqrt(len(samples))).all()
    poses, wrenches = (np.array(list(heard[topic])) for topic in ('current_pose', 'wrench'))
    assert 0 < len(poses) < 0.5 * np.ptp(wrenches) / 4e6
