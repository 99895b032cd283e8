"""The impedance node over real DDS, with the simulated rig and the observer."""

import signal

from calibration_runs import rehearse
from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.impedance.session import Bounds
from forcecal_ros.io.calibration_file import save
from forcecal_ros.motion.monitor import LATE_PATIENCE
from forcecal_ros.nodes.impedance import WATCH as WATCH_DEFAULT
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.sim.rig.file import load_rig
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live, ON_RIG_TIME, RIG_TIME
import numpy as np
import pytest

WATCH = {**ON_RIG_TIME, 'watch__max_age': 5.0, 'watch__frozen_timeout': 1.0,
         'limits__overspeed': 10.0}
"""A machine that runs tests may be late; where lateness is the point, it is not given."""
del WATCH['watch__most_pauses']  # the sequencer counts them, this node does not

BOX = '[1.35, 0.4, 1.4]'
QUICK = {'task__swings': 0, 'task__approach': 1.0, 'task__hold': 0.2}
LONG = {**QUICK, 'task__hold': 30.0}
"""Where something else ends the contact, it must not be over before."""


@pytest.fixture(scope='module')
def calibration(tmp_path_factory):
    path = tmp_path_factory.mktemp('impedance') / 'calibration.yaml'
    save(rehearse(load_rig(), 'acc1', 1), path)
    return path


class Bench:
    """Simulated rig, observer and impedance node, and what they say."""

    def __init__(self, live, calibration, speed=1.0, **parameters):
        self.live, self.phases, self.reason, self.commands, self.force = live, [], '', [], [0.0]
        self.counts = {}
        live.node.create_subscription(DiagnosticArray, 'impedance/phase', self._on_phase, OUTPUT)
        live.hear(PoseStamped, 'target_frame',
                  lambda stamp, values: self.commands.append((stamp * 1e-9, values[0])))
        live.hear(WrenchStamped, 'sim/contact_wrench',
                  lambda stamp, values: self.force.append(-values[0]))
        live.start('sim', seed=3, speed=speed, **RIG_TIME)
        live.start('observer', calibration__file=calibration, use_sim_time=True)
        live.start('impedance', limits__workspace_max=BOX, **parameters)

    def _on_phase(self, message):
        status = message.status[0]
        if not self.phases or self.phases[-1] != status.message:
            self.phases.append(status.message)
        values = {pair.key: pair.value for pair in status.values}
        self.reason = values['reason']
        self.counts = {key: int(values[key]) for key in ('contacts', 'missed')}

    def start(self):
        self.live.until(lambda: self.live.call('impedance/start').success, 'a start')

    def until_pressing(self, force=10.0):
        self.live.until(lambda: self.phases[-1] == 'aborted' or (
            self.force[-1] > force and self.phases[-1] == 'contact'), 'contact')
        assert self.phases[-1] == 'contact', self.reason

    def until_free(self):
        self.live.until(lambda: self.force[-1] == 0.0, 'the tool free of the wall')

    def until_still(self, count=5):
        """Wait until the last `count` commands are one place."""
        self.live.until(lambda: np.ptp([x for _, x in self.commands[-count:]]) == 0.0, 'a stop')

    def until_ended(self):
        self.live.until(lambda: self.phases[-1] in ('done', 'aborted'), 'the end')


def assert_led_away(bench):
    """Check that the last commands lead away from the wall, and no farther than they came."""
    x = np.array(bench.commands)[:, 1]
    turned = np.flatnonzero(np.diff(x) > 1e-5)[-1]
    assert x[0] - 1e-4 < x[-1] < x[turned] - 0.01


def test_a_task_ends_as_it_began_or_before_it_does_harm(ros_domain, calibration):
    with Live() as live:
        bench = Bench(live, calibration, 2.0, **WATCH, **QUICK)
        live.until(lambda: 'impedance' in live.diagnostics and bench.phases, 'the node')
        assert not bench.commands and bench.phases == ['idle']
        bench.start()
        assert not live.call('impedance/start').success
        bench.until_ended()
        bench.until_free()
        assert not bench.reason
        assert bench.phases == ['idle', 'free', 'approach', 'contact', 'retract', 'done']
        assert bench.counts == {'contacts': 1, 'missed': 0}
        assert max(bench.force) > 10.0
        live.spin(0.3)
        assert abs(bench.commands[-1][1] - bench.commands[0][1]) < 1e-3
        # a force sensor that sticks: the end, before the wall
        answers = live.set('impedance', task__approach=3.0, watch__frozen_timeout=0.4)
        assert all(answer.successful for answer in answers)
        bench.start()
        live.until(lambda: bench.phases[-1] == 'approach', 'the approach')
        live.set('sim', fault__wrench='stuck')
        del bench.force[:-1]
        bench.until_ended()
        bench.until_still()
        assert bench.phases[-1] == 'aborted'
        assert bench.reason.startswith('wrench: the same reading')
        assert max(bench.force) == 0.0
        live.set('sim', fault__wrench='none')
        # a wall where none was expected: the same one, said to be farther away
        live.set('impedance', task__clearance=0.14, watch__frozen_timeout=1.0,
                 task__approach=1.0)
        bench.start()
        bench.until_ended()
        assert bench.phases[-1] == 'aborted'
        assert 'before the wall is expected' in bench.reason
        bench.until_free()
        # gains that make it unstable: nothing moves
        live.set('impedance', design__force_gain=-0.5)
        # until then the robot may still be led away
        live.until(lambda: 'unstable' in live.call('impedance/start').message, 'a refusal')
        assert live.end('impedance') == 0


def test_told_to_go_in_contact_it_leads_the_robot_away_from_the_wall(ros_domain, calibration):
    with Live() as live:
        bench = Bench(live, calibration, **WATCH, **LONG)
        bench.start()
        bench.until_pressing()
        assert live.end('impedance', signal.SIGINT) == 0
        bench.until_free()
        bench.until_still()
        assert bench.phases[-1] == 'aborted'
        assert bench.reason == 'the impedance node received a signal to end'
        assert_led_away(bench)


def test_a_lost_observer_ends_it_in_time_away_from_the_wall(ros_domain, calibration):
    lost_timeout = 1.0
    with Live() as live:
        bench = Bench(live, calibration, **{**WATCH, 'watch__lost_timeout': lost_timeout,
                                            'watch__pause_timeout': 0.5}, **LONG)
        bench.start()
        bench.until_pressing()
        live.processes.pop('observer').kill()
        live.spin(0.02)
        lost = bench.commands[-1][0]
        bench.until_ended()
        bench.until_free()
        bench.until_still()
        assert bench.reason.startswith('observer/contact_wrench: silent for ')
        t, x = np.array(bench.commands).T
        turned = t[:-1][(np.diff(x) < -2e-4) & (t[:-1] > lost)][0]
        assert turned < lost + lost_timeout + 0.1
        assert_led_away(bench)
        assert live.said('impedance').count('[ERROR]') == 1


def test_by_default_silence_frozen_readings_and_old_stamps_end_at_rest_within_100_ms():
    period, stop = 0.004, Bounds().stop_duration
    assert WATCH_DEFAULT.lost_timeout + 2 * period + stop < 0.1
    assert WATCH_DEFAULT.frozen_timeout + period + stop < 0.1
    assert LATE_PATIENCE + 3 * period + stop < 0.1
