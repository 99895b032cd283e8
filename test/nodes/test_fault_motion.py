"""Motion safety over DDS with the simulated rig: faults in the middle of a sequence."""

from fault_motion_runs import ABORT, Bench, SECOND, STOP
import pytest


@pytest.fixture(scope='module')
def bench(ros_domain_of_module):
    with Bench(clock=True, patient=True) as bench:
        yield bench


@pytest.mark.parametrize('fault, phase, reason', [
    pytest.param('wrench stuck', 'measure', 'wrench: the same reading', marks=pytest.mark.long),
    pytest.param('wrench garbage', 'contact', 'wrench: ', marks=pytest.mark.long),
    pytest.param('pose delayed', 'move', 'current_pose: newest stamp is', marks=pytest.mark.long),
    pytest.param('pose wrong', 'contact', 'current_pose: ', marks=pytest.mark.long),
    pytest.param('robot runaway', 'approach', 'current_pose: ', marks=pytest.mark.long),
    pytest.param(ABORT, 'step', 'requested by sequencer/abort', marks=pytest.mark.long),
    pytest.param('SIGTERM to sequencer', 'approach', 'the sequencer node received a signal to end',
                 marks=pytest.mark.long),
    pytest.param('SIGKILL to sim', 'move', '/clock has stopped', marks=pytest.mark.long),
    pytest.param('clock back', 'approach', 'clock', marks=pytest.mark.long),
])
def test_the_commands_come_to_rest_and_stay_there(bench, fault, phase, reason):
    outcome = bench.run(fault, phase)
    assert outcome.end == 'stopped', outcome
    assert outcome.moving <= STOP
    assert reason in outcome.reason


@pytest.mark.long
def test_a_second_sequencer_is_refused_or_both_stop(bench):
    """One that has not discovered the first yet starts, and each hears the other at once."""
    outcome = bench.run(SECOND, 'approach')
    assert outcome.end in ('went on', 'stopped'), outcome
    assert outcome.end == 'went on' or 'another node commands' in outcome.reason


def test_a_killed_sequencer_leaves_a_robot_that_stands(bench):
    """The last: DDS holds on to who died without a word for as long as the other tests take."""
    outcome = bench.run('SIGKILL to sequencer', 'approach')
    assert outcome.end == 'stopped' and outcome.moving <= 0.02
    place = [values[:3] for _, values in bench.poses[-100:]]
    assert max(max(abs(a - b) for a, b in zip(p, place[0])) for p in place) < 3e-4
