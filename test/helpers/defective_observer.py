"""An observer that fails in the midst of its first activation, as only a mistake of ours can."""

import sys

from forcecal_ros.nodes import observer
from forcecal_ros.nodes.runtime import run


class Defective(observer.Observer):
    """Raises once."""

    failed = False

    def on_activate(self, state):
        if not self.failed:
            self.failed = True
            raise RuntimeError('a mistake')
        return super().on_activate(state)


if __name__ == '__main__':
    sys.exit(run('observer', Defective))
