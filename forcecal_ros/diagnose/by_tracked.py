"""
A robot that its rig's model does not follow within the noise of the poses.

What the model lacks of the motion would look like a misfit of the wrench. So the tool is carried
along the motion as measured and simulated poses together tell it, and the robot is judged by how
far the two are apart, against what the rig states.
"""

from collections.abc import Iterator
from dataclasses import fields, replace

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.diagnose.by_motion import diagnose_motion
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.inputs.motion_dataset import require_wrench_and_pose, SHORTEST
from forcecal_ros.diagnose.localise import compare_motions, Difference, Tracking
from forcecal_ros.diagnose.recordings import (
    estimate_start,
    even_stamps,
    recognise_accelerometer,
    refuse_sparse_commands,
    require_overlap,
)
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.poses import merged
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.rigid_tool import rigid_tool_of_rig
from forcecal_ros.sim.signals import RATE
import numpy as np

LATER = 3.0
"""
Times what a rig states, from which its robot follows otherwise than when it was fitted: in other
places a linear model leaves twice as much.
"""


def is_tracked(rig: Rig) -> bool:
    """Whether a rig states that its robot's model leaves more than the noise of the poses."""
    unexplained = rig.robot.unexplained
    return unexplained is not None and unexplained.beyond(rig.pose_sensor)


def diagnose_tracked(recording: Recording, heldout: Recording | None, rig: Rig,
                     accelerometer: str | None = None) -> Outcome:
    """
    Find out why a wrench is not what the motion says, and how far the robot is from its model.

    Parameters
    ----------
    recording : Recording
        To fit on.
    heldout : Recording or None
        To judge on; every other second of ``recording`` where none is given.
    rig : Rig
        Of :func:`is_tracked`.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised where none is given.

    Returns
    -------
    Outcome
        Data that cannot answer come out as such, with the reason.
    """
    given = [one for one in (recording, heldout) if one is not None]
    try:
        moved = [_merged(one, rig, accelerometer) for one in given]
    except DataError as error:
        return Outcome(Diagnosis('invalid_data', str(error)), rig)
    outcome = diagnose_motion(moved[0][0], moved[1][0] if heldout is not None else None,
                              rigid_tool_of_rig(rig), None, accelerometer)
    d, apart = outcome.diagnosis, moved[0][1]
    if d.verdict == 'invalid_data':
        return replace(outcome, rig=rig)
    own = {f.name: getattr(outcome.rig, f.name) for f in fields(Rig)}
    left = rig.robot.unexplained
    assert left is not None
    reason = (f'{d.reason}; the motion itself is {1e3 * apart.translation.rms:.2g} mm and '
              f'{1e3 * apart.rotation.rms:.2g} mrad (RMS) from the simulated, the rig states '
              f'{1e3 * _whole(left.position, left.position_offset):.2g} mm and '
              f'{1e3 * _whole(left.orientation, left.orientation_offset):.2g} mrad')
    notes = [*d.notes, ('the model of the robot leaves more than the noise of the poses, so the '
             'tool is carried along the measured motion')]
    for _, one in moved:
        notes += _about(one, rig)
    return replace(outcome, rig=Rig(**{**own, 'spreads': rig.spreads}),
                   diagnosis=replace(d, reason=reason, notes=tuple(notes)))


def _merged(recording: Recording, rig: Rig, accelerometer: str | None
            ) -> tuple[Recording, Tracking]:
    require_wrench_and_pose(recording, 'the recording lacks wrench or measured pose, and the rig '
                            'states that its model of the robot does not replace that; record '
                            'current_pose')
    ready = even_stamps(recording).recording
    require_overlap(ready, 'pose', SHORTEST)
    target, pose = ready.target, ready.pose
    assert target is not None
    assert pose is not None
    name = accelerometer or recognise_accelerometer(ready, rig)
    refuse_sparse_commands(ready, rig, name)
    start = estimate_start(ready, rig, name)
    end = min(float(target.t[-1]) + rig.robot.period, float(pose.t[-1]))
    signals = Replay(rig, target, start, end, name).signals(rig)
    t = start + (1.0 + np.arange(float(len(signals.position)))) / RATE
    simulated = PoseStream(t, signals.position, signals.R_base_sensor, pose.frame)
    return replace(ready, pose=merged(pose, simulated)), compare_motions(pose, simulated, True)


def _about(apart: Tracking, rig: Rig) -> Iterator[str]:
    unexplained = rig.robot.unexplained
    assert unexplained is not None
    for name, one, stated, offset, noise, unit in (
            ('translation', apart.translation, unexplained.position, unexplained.position_offset,
             rig.pose_sensor.position_noise, 'mm'),
            ('rotation', apart.rotation, unexplained.orientation, unexplained.orientation_offset,
             rig.pose_sensor.orientation_noise, 'mrad')):
        yield _one(name, one, (stated, offset), noise, unit, rig.robot.period)


def _whole(left: float, offset: float) -> float:
    """Return the RMS of a difference, that of its mean among it."""
    return float(np.hypot(left, offset))


def _one(name: str, one: Difference, states: tuple[float, float], noise: float, unit: str,
         period: float) -> str:
    stated, offset = states
    words = (f'{name}: {1e3 * one.rms:.2g} {unit} from the simulated, the rig states '
             f'{1e3 * _whole(stated, offset):.2g} {unit}, {1e3 * offset:.2g} of it fixed and '
             f'{1e3 * stated:.2g} not')
    if np.isfinite(one.delay):
        words += (f'; the robot is {1e3 * one.delay:.1f} +- {1e3 * one.delay_std:.1f} ms later, '
                  f'which leaves {1e3 * one.unexplained:.2g} {unit}')
    late = np.isfinite(one.delay) and abs(one.delay) > max(3.0 * one.delay_std, 0.5 * period)
    if late or one.unexplained > LATER * float(np.hypot(stated, noise)):
        words += '; it follows otherwise than when the rig was fitted: fit it anew'
    return words
