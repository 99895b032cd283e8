"""A sequencer with a mistake of ours in it, in one callback or another, run as a node is."""

import sys

from forcecal_ros.nodes import sequencer
from forcecal_ros.nodes.runtime import run
from std_msgs.msg import Header


class Defective(sequencer.Sequencer):
    """Fails where the frame of a message on ``break`` says."""

    where = ''

    def __init__(self):
        super().__init__()
        self.create_subscription(Header, 'break', self._on_break, 10)

    def _on_break(self, message):
        self.where = message.frame_id
        self._fail('subscription')

    def _fail(self, where):
        if self.where == where:
            raise RuntimeError('a mistake')

    def _check(self):
        self._fail('timer')
        super()._check()


if __name__ == '__main__':
    sys.exit(run('sequencer', Defective))
