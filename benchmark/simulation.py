"""Cost of the simulated rig: offline against real time, and live as a node.

    python benchmark/simulation.py

Offline: one core, every sensor of the nominal rig (1 kHz, pose 250 Hz) with noise, while the robot
swings and turns. Live: processor time of the `sim` node over 10 s while somebody listens to
wrench, contact wrench, accelerometer and displacement at 1 kHz each, and to the pose.
"""

import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate, warm_up
import numpy as np
from processes import own_domain, process, processor_time
from timing import best, head, row

SECONDS = 60.0
LIVE = 10.0


def commands(seconds: float) -> PoseStream:
    rig = load_rig()
    t = np.arange(0.0, seconds, rig.robot.period)
    position = np.array(rig.home.position) + 0.01 * np.sin(4.0 * t)[:, np.newaxis]
    home = np.diag([1.0, -1.0, -1.0])
    R = np.array([home @ rotation_from_vector([0.1 * np.sin(a), 0.2 * np.sin(2 * a), 0.0])
                  for a in t])
    return PoseStream(t, position, R)


def offline() -> None:
    warm_up()
    rig, target = load_rig(), commands(SECONDS)
    took = best({'rig': lambda: simulate(rig, target, seed=1)}, rounds=5)['rig']
    row('offline, 1 kHz', f'{SECONDS / took:.0f} x real time', '100 x')


def first_run() -> None:
    """Run in an empty cache of machine code, then in a filled one."""
    program = ('import time\nfrom forcecal_ros.sim.rig.simulator import warm_up\n'
               'start = time.perf_counter(); warm_up(); print(time.perf_counter() - start)')
    with tempfile.TemporaryDirectory() as cache:
        for name in ('first run of an installation, which says so', 'any later one'):
            took = float(subprocess.run(
                [sys.executable, '-c', program], env={**os.environ, 'NUMBA_CACHE_DIR': cache},
                check=True, capture_output=True, text=True).stdout)
            row(f'compiling: {name}', f'{took:.1f} s', '')


def live() -> None:
    from forcecal_ros.nodes.wire import Reader
    from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
    import rclpy
    from rclpy.experimental import EventsExecutor
    from rclpy.task import Future
    from sensor_msgs.msg import JointState

    topics = {'wrench': WrenchStamped, 'sim/contact_wrench': WrenchStamped,
              'accelerometer/raw': Vector3Stamped, 'optidrive': JointState,
              'current_pose': PoseStamped}
    heard = dict.fromkeys(topics, 0)
    rclpy.init()
    node, executor = rclpy.create_node('listener'), EventsExecutor()
    executor.add_node(node)
    for topic, kind in topics.items():
        def take(raw: bytes, topic: str = topic) -> None:
            heard[topic] += 1

        node.create_subscription(kind, topic, take, 1000, raw=True)
    target = node.create_publisher(PoseStamped, 'target_frame', 10)
    read = Reader(PoseStamped)

    def follow(raw: bytes) -> None:
        read(raw)
        target.publish(raw)

    node.create_subscription(PoseStamped, 'current_pose',
                             follow, 10, raw=True)

    def spin(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_until_future_complete(Future(), timeout_sec=0.05)

    with process(['-m', 'forcecal_ros.nodes.sim']) as pid:
        while not all(heard.values()):
            spin(0.1)
        spin(1.0)
        before, used, start = dict(heard), processor_time(pid), time.monotonic()
        spin(LIVE)
        seconds, used = time.monotonic() - start, processor_time(pid) - used
    rates = [(heard[topic] - before[topic]) / seconds for topic in topics]
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    row('live, share of a core', f'{100 * used / seconds:.0f} %', '50 %')
    row('live, messages a second by topic', ', '.join(f'{rate:.0f}' for rate in rates),
        '4 x 1000, 250')


def main() -> None:
    head('simulated rig', 'measured', 'wanted')
    offline()
    first_run()
    with tempfile.TemporaryDirectory() as logs, own_domain(Path(logs)):
        live()


if __name__ == '__main__':
    main()
