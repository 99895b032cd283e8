"""Faults of sensors: what they make of samples, offline and while the node runs."""

from forcecal_ros.nodes.sim import PARAMETERS
from forcecal_ros.sim.rig.faults import (
    CLOCK_FAULTS,
    FAULTS,
    OFFSETS,
    ROBOT_FAULTS,
    RobotFault,
    RUNAWAY,
    SensorFault,
    SENSORS,
)
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import Samples, SIGNALS, Simulator
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live
import numpy as np
import pytest

PERIODS = 200


@pytest.fixture(scope='module')
def healthy():
    simulator = Simulator(load_rig(), seed=1)
    return [simulator.advance() for _ in range(PERIODS)]


def said(healthy, sensor, kind, begin=50):
    """Return stamps and first field of what is said, with the fault on from one period on."""
    fault = SensorFault(sensor, seed=2)
    blocks = []
    for i, samples in enumerate(healthy):
        fault.kind = kind if i >= begin else 'none'
        blocks.append(fault(samples))
    stamps, name = SIGNALS[sensor][:2]
    return (np.concatenate([getattr(b, stamps) for b in blocks]),
            np.concatenate([getattr(b, name) for b in blocks]))


@pytest.mark.parametrize('sensor', SENSORS)
def test_each_fault_does_what_its_word_says(healthy, sensor):
    t, values = said(healthy, sensor, 'none')
    before = t <= 50 * 0.004 + 1e-9
    first = values[before]

    def faulty(kind):
        t_faulty, out = said(healthy, sensor, kind)
        np.testing.assert_array_equal(out[:len(first)], first)
        return t_faulty[len(first):], out[len(first):]

    assert not len(faulty('off')[0])
    stamps, stuck = faulty('stuck')
    assert len(stamps) == len(t) - len(first) and (stuck == first[-1]).all()
    stamps, garbage = faulty('garbage')
    assert np.isnan(garbage).any() and np.nanmax(np.abs(garbage)) > 1e4
    _, wrong = faulty('wrong')
    np.testing.assert_allclose(wrong - values[~before],
                               np.broadcast_to(OFFSETS[SIGNALS[sensor][1]], wrong.shape))
    stamps, _ = faulty('slow')
    assert len(stamps) == pytest.approx((len(t) - len(first)) / 20, abs=1.0)
    stamps, delayed = faulty('delayed')
    assert stamps[-1] == pytest.approx(t[-1] - 0.3, abs=0.005)
    np.testing.assert_array_equal(delayed, values[~before][:len(delayed)])
    stamps, _ = faulty('intermittent')
    assert 0.55 < len(stamps) / (len(t) - len(first)) < 0.8
    assert np.diff(stamps).max() == pytest.approx(0.1, abs=0.01)


def test_a_fault_of_one_sensor_leaves_the_others_as_they_are(healthy):
    fault = SensorFault('wrench', seed=1)
    for kind in FAULTS:
        fault.kind = kind
        out = fault(healthy[0])
        for name in set(Samples._fields) - set(SIGNALS['wrench']):
            np.testing.assert_array_equal(getattr(out, name), getattr(healthy[0], name))


def test_a_robot_stands_or_runs_away():
    robot, place = RobotFault(), np.array([1.0, 0.0, 1.0])
    np.testing.assert_array_equal(robot(place, 0.004), place)
    robot.kind = 'stuck'
    assert robot(place, 0.004) is None
    robot.kind = 'runaway'
    robot(place, 0.004)
    np.testing.assert_allclose(robot(place, 0.004), place - [2 * 0.004 * RUNAWAY, 0, 0])


def test_every_fault_is_a_parameter_whose_description_says_what_it_does():
    rows = {row.name: row for row in PARAMETERS if row.name.startswith('fault.')}
    assert set(rows) == {f'fault.{part}' for part in (*SENSORS, 'robot', 'clock')}
    for name, kinds in (('fault.pose', FAULTS), ('fault.robot', ROBOT_FAULTS),
                        ('fault.clock', CLOCK_FAULTS)):
        assert rows[name].choices == tuple(kinds) and rows[name].live
        assert all(meaning in rows[name].description for meaning in kinds.values())


def test_faults_are_switched_while_the_node_runs(ros_domain):
    with Live() as live:
        heard = {'wrench': {}, 'current_pose': {}}
        live.hear(WrenchStamped, 'wrench', heard['wrench'].__setitem__)
        live.hear(PoseStamped, 'current_pose', heard['current_pose'].__setitem__)
        live.start('sim', seed=1)
        live.until(lambda: len(heard['wrench']) > 100, 'wrenches')
        assert live.set('sim', fault__wrench='stuck')[0].successful
        live.until(lambda: len(set(list(heard['wrench'].values())[-100:])) == 1, 'one reading')
        live.until(lambda: 'wrench stuck' in str(live.diagnostics.get('sim')), 'its name')
        assert live.set('sim', fault__wrench='none')[0].successful
        live.until(lambda: len(set(list(heard['wrench'].values())[-100:])) == 100, 'readings')
        (answer,) = live.set('sim', fault__wrench='funny')
        assert not answer.successful and 'expected one of none, off, stuck' in answer.reason
        (answer,) = live.set('sim', fault__clock='back')
        assert not answer.successful and 'clock.publish' in answer.reason
