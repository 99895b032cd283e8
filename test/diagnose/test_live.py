"""The live gap, second by second over recordings: the first stage that leaves the noise."""

from forcecal_ros.diagnose.live import LiveGap
from forcecal_ros.effects import with_effects
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import diagnosis_plan, prepare, preview, Timing
from forcecal_ros.motion.profiles import nominal_poses, Pace, step_goal
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import pytest


@pytest.fixture(scope='module')
def commands():
    """Return the planned sequence in one pose, cut short, with contact."""
    timing = Timing(contacts=1, contact=1.0)
    home = nominal_poses()['v']
    plan = diagnosis_plan({'v': home}, step_goal(home, timing.contact_distance), timing)
    kept = [s for s in plan if s.phase in ('move', 'settle', 'measure', 'step', 'approach',
                                           'contact', 'retract') or s.label.startswith('x ')]
    parts = prepare(kept, home, Pace(), Limits(workspace_max=(1.3, 0.4, 1.4)))
    return preview(parts, 250.0, 0.5)[0]


@pytest.mark.parametrize('effects, stage', [
    ({}, ''),
    ({'robot_delay': {'delay': 0.004}}, 'robot'),
    pytest.param({'tool_stiffness': {'change': 0.1}}, 'tool', marks=pytest.mark.long),
    pytest.param({'contact_stiffness': {'change': 0.5}}, 'environment', marks=pytest.mark.long),
    pytest.param({'wrench_gain': {'fz': 0.05}}, 'wrench_sensor', marks=pytest.mark.long),
    pytest.param({'accel_delay': {'delay': 0.006}}, 'accelerometer', marks=pytest.mark.long),
])
def test_the_first_stage_that_leaves_the_noise_is_named(commands, effects, stage):
    recording = simulate(with_effects(load_rig(), effects), commands, seed=2)
    live = LiveGap(load_rig(), ('wrench', 'accelerometer', 'optidrive', 'pose'))
    origin = float(recording.target.t[0])
    found = [live.judge(recording, origin, float(end))
             for end in np.arange(origin + 1.0, float(recording.wrench.t[-1]))]
    assert found[-1].first == stage
    assert all(j.learning for j in found[:2])  # one a second, and the rest lasts 3 s
