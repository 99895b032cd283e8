"""The observer node against a bare rclpy node with the same subscriptions and publisher.

    python benchmark/observer_node.py [ROUNDS]

Wrenches at 1, 2 and 4 kHz, accelerometer at 1 kHz and pose at 250 Hz come over DDS; each node in
turn answers them for some seconds. The bare node takes every message as rclpy's users do, typed,
and publishes a copy of each wrench. Latency is counted from the message that completes an answer
(for the bare node the wrench, for the observer the later of wrench and accelerometer) to when the
answer is here again. Of several rounds the least figure counts, for both alike.
"""

from pathlib import Path
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from forcecal_ros.io.calibration_file import save
from forcecal_ros.nodes.runtime import OUTPUT, SENSOR
from forcecal_ros.nodes.wire import Reader, Writer
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
import numpy as np
from observing import calibration
from processes import own_domain, process, processor_time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from timing import head, row

SECONDS = 4.0
WARM_UP = 1.0
MILLISECOND = 1_000_000
EXECUTORS = {'events': EventsExecutor, 'single': SingleThreadedExecutor}
CASES = (('events', 1, 0.0), ('events', 2, 0.0), ('events', 4, 0.0), ('events', 1, 500.0),
         ('single', 1, 0.0))
"""Executor, wrenches [kHz], poll_rate of the observer [Hz]."""
TOPICS = {'wrench': WrenchStamped, 'accelerometer/raw': Vector3Stamped,
          'current_pose': PoseStamped}


def bare_node(executor_name: str) -> None:
    """Copy wrenches until told to stop."""
    rclpy.init()
    node, executor = rclpy.create_node('observer'), EXECUTORS[executor_name]()
    publisher = node.create_publisher(WrenchStamped, 'observer/contact_wrench', OUTPUT)

    def answer(message: WrenchStamped) -> None:
        out = WrenchStamped()
        out.header = message.header
        out.wrench = message.wrench
        publisher.publish(out)

    for topic, kind in TOPICS.items():
        node.create_subscription(kind, topic, answer if topic == 'wrench' else lambda _: None,
                                 SENSOR)
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_until_future_complete(Future(), timeout_sec=0.02)
    except KeyboardInterrupt:
        rclpy.try_shutdown()


class Robot:
    """Publishes what sensors at rest say, as time passes, and hears the answers."""

    def __init__(self, node, kilohertz: int) -> None:
        self.periods = {'wrench': MILLISECOND // kilohertz, 'accelerometer/raw': MILLISECOND,
                        'current_pose': 4 * MILLISECOND}
        self.values = {'wrench': (4.0, -3.0, 135.5, 1.6, -4.1, 0.1),
                       'accelerometer/raw': (5.0, 5.0, 2.2),
                       'current_pose': (1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0)}
        self.writers = {topic: Writer(kind, 'frame') for topic, kind in TOPICS.items()}
        self.publishers = {topic: node.create_publisher(kind, topic, OUTPUT)
                           for topic, kind in TOPICS.items()}
        self.answers = node.create_subscription(
            WrenchStamped, 'observer/contact_wrench', lambda _: None, 4000)
        self.stamp_of = Reader(WrenchStamped)
        self.sent = {topic: {} for topic in TOPICS}
        self.heard: dict[int, int] = {}
        self.next = dict.fromkeys(TOPICS, 0)

    def run(self, seconds: float) -> None:
        """Publish what is due, in the order of stamps, and take what has come."""
        begin = max(time.time_ns(), *self.next.values()) // (4 * MILLISECOND) * 4 * MILLISECOND
        self.next = dict.fromkeys(TOPICS, begin + 4 * MILLISECOND)
        end = time.time_ns() + round(seconds * 1e9)
        while (now := time.time_ns()) < end:
            while self.next[topic := min(self.next, key=self.next.__getitem__)] <= now:
                stamp = self.next[topic]
                self.publishers[topic].publish(self.writers[topic](stamp, self.values[topic]))
                self.sent[topic][stamp] = time.time_ns()
                self.next[topic] += self.periods[topic]
            self.hear()
            time.sleep(5e-5)

    def hear(self) -> None:
        while True:
            message = self.answers.handle.take_message(WrenchStamped, True)
            if message is None:
                return
            self.heard[self.stamp_of(message[0]).stamp_ns] = time.time_ns()

    def forget(self) -> None:
        for sent in self.sent.values():
            sent.clear()
        self.heard.clear()

    def latencies(self, observer: bool) -> np.ndarray:
        """Return the time from what completes an answer to the answer [us]."""
        wrench, accelerometer = self.sent['wrench'], self.sent['accelerometer/raw']
        out = []
        for stamp, here in self.heard.items():
            complete = wrench.get(stamp)
            if observer:
                after = -(-stamp // MILLISECOND) * MILLISECOND
                complete = complete and accelerometer.get(after) and max(
                    complete, accelerometer[after])
            if complete:
                out.append((here - complete) / 1e3)
        return np.array(out)


def measure(robot: Robot, pid: int, observer: bool) -> tuple[float, float, float, int]:
    """Return processor time a message [us], median and 99 % latency [us], and answers missing."""
    while not robot.heard:
        robot.run(0.1)
    robot.run(WARM_UP)
    robot.forget()
    used = processor_time(pid)
    robot.run(SECONDS)
    used = processor_time(pid) - used
    messages = sum(map(len, robot.sent.values()))
    due = [stamp for stamp in robot.sent['wrench'] if stamp <= min(robot.next.values()) - 10**8]
    robot.run(0.3)
    missing = sum(stamp not in robot.heard for stamp in due)
    latencies = robot.latencies(observer)
    return (1e6 * used / messages, float(np.median(latencies)),
            float(np.percentile(latencies, 99)), missing)


def case(node, executor: str, kilohertz: int, poll_rate: float, calibration: str, rounds: int
         ) -> None:
    nodes = {
        'bare': ([__file__, '--bare', executor], {}),
        'observer': (['-m', 'forcecal_ros.nodes.observer'],
                     {'calibration.file': calibration, 'optidrive.joint': "''",
                      'executor': executor, 'poll_rate': poll_rate})}
    found = {name: [] for name in nodes}
    for _ in range(rounds):
        for name, (arguments, parameters) in nodes.items():
            robot = Robot(node, kilohertz)
            with process(arguments, parameters) as pid:
                found[name].append(measure(robot, pid, name == 'observer'))
            for entity in robot.publishers.values():
                node.destroy_publisher(entity)
            node.destroy_subscription(robot.answers)
    bare, ours = (np.min(found[name], axis=0) for name in nodes)
    lost = [int(np.sum(np.array(found[name])[:, 3])) for name in nodes]
    name = f'{executor}, {kilohertz} kHz' + (f', poll_rate {poll_rate:g}' if poll_rate else '')
    row(name, f'{bare[0]:.0f} / {ours[0]:.0f} us',
        f'{ours[0] / bare[0]:.2f}', f'{bare[1]:.0f} / {ours[1]:.0f} us',
        f'{bare[2]:.0f} / {ours[2]:.0f} us', f'{ours[2] / bare[2]:.2f}', f'{lost[0]} / {lost[1]}')


def main() -> None:
    if sys.argv[1:2] == ['--bare']:
        bare_node(sys.argv[2])
        return
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    with tempfile.TemporaryDirectory() as folder, own_domain(Path(folder)):
        path = f'{folder}/calibration.yaml'
        save(calibration(), path)
        rclpy.init()
        node = rclpy.create_node('robot')
        head('bare / observer', 'processor time a message', 'ratio (1.25 wanted)',
             'median latency', '99 % latency', 'ratio (1.5 wanted)', 'lost (0 wanted)')
        for executor, kilohertz, poll_rate in CASES:
            case(node, executor, kilohertz, poll_rate, path, rounds)
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
