"""The gap node over real DDS: quiet without an effect, the right stage with one."""

from diagnostic_msgs.msg import DiagnosticStatus
from fault_motion_runs import quick_poses
from forcecal_ros.effects import with_effects
from forcecal_ros.sim.rig.file import dump_rig, load_rig
from live import Live, ON_RIG_TIME, RIG_TIME
import pytest

SHORT = {**ON_RIG_TIME, 'timing__measure': 0.4, 'timing__ring': 0.3, 'watch__max_age': 0.0,
         'poses__names': '[v, tilt]', 'poses__values': quick_poses()}
"""Of the sequencer: brief, and patient with a loaded machine."""

ENOUGH = 3
"""Judgements since the step, before which the robot has turned, that show that nothing is raised:
one a second, each some time after it."""

ATTEMPTS = 3
"""A loaded machine may let commands come late to the robot, which the node rightly raises."""


@pytest.mark.parametrize('effects, stage', [
    pytest.param({}, '', marks=pytest.mark.long),
    ({'wrench_delay': {'delay': 0.006}}, 'wrench_sensor'),
])
def test_the_first_stage_that_leaves_the_noise_is_raised(ros_domain, tmp_path, effects, stage):
    path = tmp_path / 'rig.yaml'
    path.write_text(dump_rig(with_effects(load_rig(), effects)))
    for _ in range(ATTEMPTS):
        values, status, late = judged(path)
        if not late:
            break
    else:
        pytest.skip(f'commands came late to the robot {ATTEMPTS} times, a gap of its own')
    assert values['first stage'] == stage, status.message
    assert status.level == (DiagnosticStatus.ERROR if stage else DiagnosticStatus.OK)
    assert len([name for name in values if name.endswith('[noise RMS]')]) == 16


def judged(path):
    """Return what the node says of a rig that is calibrated, and how many commands came late."""
    with Live() as live:
        live.start('sim', rig=path, seed=1, latency=0.1, **RIG_TIME)
        live.start('gap', use_sim_time=True)
        live.start('sequencer', **SHORT)
        live.until(lambda: 'gap' in live.diagnostics, 'gap speaks')
        live.until(lambda: live.call('sequencer/start').success, 'it starts')
        said, before_step = [], []

        def found():
            status = live.diagnostics['gap']
            values = {pair.key: pair.value for pair in status.values}
            if 'stage' in values and (not said or said[-1][1] is not status):
                said.append((values, status))
            if 'step' in live.phases and not before_step:
                before_step.append(len(said))
            return values.get('first stage') or (
                before_step and len(said) >= before_step[0] + ENOUGH)

        live.until(found, 'a judgement', timeout=300.0)
        counted = live.diagnostics['sim']
        live.until(lambda: live.diagnostics['sim'] is not counted, 'the count of late commands')
        late = {pair.key: pair.value for pair in live.diagnostics['sim'].values}['commands late']
        assert live.end('gap') == 0
        return *said[-1], int(late)
