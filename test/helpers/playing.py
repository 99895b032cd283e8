"""Recordings played to observers over DDS."""

import time

from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.wire import Writer
from forcecal_ros.observe.playback import events
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
import numpy as np
from sensor_msgs.msg import JointState

LOST = 5.0
"""Messages that nobody answers for so long are lost: a busy machine answers within one [s]."""

START = 1_700_000_000_000_000_000


class Player:
    """Publishes recordings, never faster than all observers answer."""

    def __init__(self, live, observers=('observer',)):
        self.live = live
        self.heard = {name: {} for name in observers}
        self.answers = self.heard[observers[0]]
        for name, answers in self.heard.items():
            live.hear(WrenchStamped, f'{name}/contact_wrench', answers.__setitem__)
        make = live.node.create_publisher
        self.out = {
            'wrench': (make(WrenchStamped, 'wrench', OUTPUT), Writer(WrenchStamped, 'ft_sensor')),
            'accelerometer': (make(Vector3Stamped, 'accelerometer/raw', OUTPUT),
                              Writer(Vector3Stamped, 'accelerometer')),
            'pose': (make(PoseStamped, 'current_pose', OUTPUT), Writer(PoseStamped, 'base')),
            'displacement': (make(JointState, 'optidrive', OUTPUT),
                             Writer(JointState, joint='optidrive'))}

    def until_heard(self):
        self.live.until(lambda: all(publisher.get_subscription_count() >= len(self.heard)
                                    for publisher, _ in self.out.values()), 'subscriptions')

    def play(self, recording, begin=0.0, end=np.inf, origin=START, shift=0.0):
        """Play a part; returns the stamps of its wrenches."""
        stamps = []
        for t, kind, values in events(recording):
            if not begin <= t < end:
                continue
            stamp = origin + round(t * 1e9)
            publisher, write = self.out[kind]
            if kind == 'wrench':
                stamps.append(stamp)
                values = np.array(values) + [shift, 0, 0, 0, 0, 0]
            publisher.publish(write(stamp, list(values)))
            if kind == 'wrench' and len(stamps) % 20 == 0 and stamps[20:]:
                self._wait_for_one_of(stamps[-20:])
        return stamps

    def _wait_for_one_of(self, stamps):
        """Wait for any answer: a busy machine may lose some, and, once in a while, all of them."""
        silent = time.monotonic() + LOST
        self.live.until(lambda: time.monotonic() > silent or all(
            answers.keys() & stamps for answers in self.heard.values()), f'one of {stamps}')

    def array(self, stamps, observer='observer'):
        answers = self.heard[observer]
        return np.array([answers[stamp] for stamp in stamps if stamp in answers])
