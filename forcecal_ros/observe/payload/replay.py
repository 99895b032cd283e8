"""The payload over a recording, by the same step as in the node."""

from math import inf
from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.streams import Recording
from forcecal_ros.core.topics import naming
from forcecal_ros.observe.design import design
from forcecal_ros.observe.from_file import never_late
from forcecal_ros.observe.live import LiveObserver
from forcecal_ros.observe.payload.model import payload_model, PayloadSettings
from forcecal_ros.observe.payload.step import Change, ToolEstimate
from forcecal_ros.observe.payload.tracker import Tracker
from forcecal_ros.observe.playback import as_calibrated, collected, events
from forcecal_ros.observe.sample import ContactEstimate, ContactSample
from forcecal_ros.observe.settings import ObserverSettings

FADE = 0.5
"""Over which another tool is faded in, as ``takeover.duration`` of the node [s]."""


class Followed(NamedTuple):
    """
    What hung on the sensor over a recording.

    Attributes
    ----------
    contact : ContactEstimate
        Of the tool as it was known by then.
    tools : tuple of ToolEstimate
        One for every block of some 50 ms.
    announced : tuple of ToolEstimate
        Those that the contact wrench was taken from then on, the calibration's first.
    changes : tuple of Change
    """

    contact: ContactEstimate
    tools: tuple[ToolEstimate, ...]
    announced: tuple[ToolEstimate, ...]
    changes: tuple[Change, ...]


def follow(recording: Recording, calibration: Calibration,
           settings: ObserverSettings = ObserverSettings(),
           payload: PayloadSettings = PayloadSettings(),
           ) -> Followed:
    """
    Estimate the contact wrench over a recording, and what hangs on the sensor along.

    As the node does with ``payload.track`` and ``tool: tracked``. Raises as
    :func:`~forcecal_ros.observe.playback.replay`.

    Raises
    ------
    UnobservableError
        There is no pose.
    """
    recording, _ = as_calibrated(recording, calibration)
    if not recording.pose:
        raise UnobservableError(f'{recording.source or "the recording"} holds no pose, by which '
                                f'a payload is told from a push; {naming(recording, "pose")}')
    live = LiveObserver(FADE, FADE)
    live.take_over(never_late(design(calibration, settings), recording))
    tracker = live.tracker = Tracker(payload_model(calibration, payload))
    live.takes_tracked = True
    takes = {'wrench': live.on_wrench, 'accelerometer': live.on_accelerometer,
             'pose': live.on_pose, 'displacement': live.on_displacement}
    samples: list[ContactSample] = []
    tools: list[ToolEstimate] = []
    announced = [tracker.announced._replace(t=float(recording.pose.t[0]))]
    for t, kind, values in events(recording):
        samples.extend(takes[kind](t, values))
        if tracker.latest.t > (tools[-1].t if tools else -inf):
            tools.append(tracker.latest)
        if tracker.announced.t > announced[-1].t:
            announced.append(tracker.announced)
    samples.extend(live.finish())
    return Followed(collected(live.state, samples), tuple(tools), tuple(announced),
                    tracker.changes)
