"""The tool under test as the blind check calls it: a pair of recordings in, its answer out."""

import numpy as np

from blind.sensors import Recorded
from forcecal_ros.samples import Phase, PoseStream, Recording, Stream

START_NS = 1_760_000_000_000_000_000


def to_recording(recorded: Recorded, source: str = '') -> Recording:
    """Return what reading a bag with the same content would."""
    return Recording(
        wrench=Stream(recorded.wrench_t, recorded.wrench, 'ft_sensor'),
        accelerometer=Stream(recorded.volts_t, recorded.volts, 'accelerometer'),
        pose=PoseStream(recorded.pose_t, recorded.position, recorded.R),
        target=PoseStream(recorded.target_t, recorded.target_position, recorded.target_R),
        optidrive=Stream(recorded.slide_t, np.asarray(recorded.slide)[:, None], 'ft_sensor'),
        phases=tuple(Phase(*one) for one in recorded.phases), start_ns=START_NS, source=source)
