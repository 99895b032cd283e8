"""The newest samples and poses of a running chain, which a tare is made of."""

from collections import deque

from forcecal_ros.observe.sample import ContactSample
from forcecal_ros.observe.tare import FEWEST

PAUSE = 1.0
"""After so long without a wrench a window begins anew, as after stamps that go back: ten periods
of the slowest sensor that is tared, 10 Hz [s]."""


class Window:
    """
    What was heard last: so many seconds, or longer where that is too few samples.

    Attributes
    ----------
    seconds : float
        How much is kept at least [s].
    samples, poses : deque
        In order of time; poses are (stamp [s], x y z qx qy qz qw).
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.samples: deque[ContactSample] = deque()
        self.poses: deque[tuple[float, tuple[float, ...]]] = deque()

    def clear(self) -> None:
        """Begin anew."""
        self.samples.clear()
        self.poses.clear()

    def add(self, sample: ContactSample) -> None:
        """Keep a sample; what remains spans ``seconds`` as soon as so much was heard."""
        samples = self.samples
        if samples and not 0 <= sample.t - samples[-1].t <= PAUSE:
            self.clear()
        samples.append(sample)
        while len(samples) > FEWEST and sample.t - samples[1].t >= self.seconds:
            samples.popleft()

    def add_pose(self, t: float, pose: tuple[float, ...]) -> None:
        """Keep a pose as long as there are samples of its time."""
        poses = self.poses
        poses.append((t, pose))
        oldest = self.samples[0].t if self.samples else t - self.seconds
        oldest = max(oldest, t - self.seconds - FEWEST * PAUSE)  # where the wrench has stopped
        while poses and poses[0][0] < oldest:
            poses.popleft()

    def poses_of_samples(self) -> list[tuple[float, ...]]:
        """Return the poses from the first sample on."""
        return [pose for t, pose in self.poses if self.samples and self.samples[0].t <= t]
