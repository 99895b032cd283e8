"""Recorded commands, replayed through a rig."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.diagnose.dataset import (
    Dataset,
    make_dataset,
    MIN_MOTION_S,
    require_wrench_and_pose,
    REST_AFTER_BLOCKS,
    split_by_phase,
    split_by_recording,
)
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.localise import compare_motions, Difference, Tracking
from forcecal_ros.diagnose.recordings import (
    convert_to_volts,
    correct_clocks,
    estimate_start,
    even_stamps,
    recognise_accelerometer,
    refuse_sparse_commands,
    require_axes_of,
    require_overlap,
)
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.sources.source import Ready, Source
from forcecal_ros.diagnose.sources.tool import ToolSource
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.measured_motion import merge_poses
from forcecal_ros.sim.rig.file import dump_rig
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.rigid_tool import rigid_tool_of_rig
from forcecal_ros.sim.signals import BLOCK, RATE, Signals
import numpy as np
from numpy.typing import NDArray

MIN_COMMANDED_S = 5.0
"""Length of a recording with commands, at least, that can be diagnosed [s]."""


MAX_WALL_SHIFT_M = EFFECTS['wall_position'].parameters[0].high
"""Distance by which a wall may be nearer than in a rig's file: as an effect may shift it [m]."""

CONTACT_MARGIN_BLOCKS = 25
"""Blocks before and after contact that count as contact."""

NO_WALL = ('phases that touch something are left out, as the rig has no wall within reach; write '
           'where it is into the rig to have them compared')

MAX_UNEXPLAINED = 3.0
"""
Times what a rig states, from which its robot moves differently than when it was fitted: in other
places a linear model leaves twice as much.
"""


def rig_source(rig: Rig, accelerometer: str | None = None) -> Source:
    """
    Return the source for recorded commands and a rig.

    Where the rig states that its model of the robot leaves more than the noise of the poses, the
    tool is carried along the measured motion.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised by its volts if None.
    """
    return (TrackedRigSource if is_tracked(rig) else RigSource)(rig, accelerometer)


class RigSource(Source):
    """
    Replays recorded commands through a rig.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised by its volts if None.
    """

    task = 'replaying the commands and weighing effects'
    requires_motion = False

    def __init__(self, rig: Rig, accelerometer: str | None = None) -> None:
        super().__init__(rig)
        self._accelerometer = accelerometer

    def prepare(self, recordings: Sequence[Recording]) -> list[Ready]:
        """Bring all streams to the clock of the commands, and replay these."""
        stamps = [correct_clocks(r, self.rig, MIN_COMMANDED_S) for r in recordings]
        require_axes_of(self.rig, [s.recording for s in stamps])
        return [Ready(prepare_commanded(s.recording, self.rig, self._accelerometer), s, given)
                for s, given in zip(stamps, recordings)]

    def split(self, datasets: Sequence[Dataset]) -> tuple[Dataset, ...]:
        """Judge on the second recording or, of one, on parts of every phase."""
        return (split_by_recording(*datasets) if len(datasets) > 1
                else (split_by_phase(datasets[0]),))

    def search(self, ready: Sequence[Ready]) -> Outcome:
        """Leave out contact that the rig has no wall for, and search."""
        left_out = [exclude_contact(one.dataset, self.rig) for one in ready]
        outcome = super().search(ready)
        if not any(left_out):
            return outcome
        return replace(outcome, diagnosis=replace(
            outcome.diagnosis, notes=(NO_WALL, *outcome.diagnosis.notes)))

    def files(self, outcome: Outcome) -> dict[str, str]:
        """Return the rig with what was found."""
        return {'rig_patched.yaml': dump_rig(outcome.rig)} if outcome.datasets else {}


def exclude_contact(dataset: Dataset, rig: Rig) -> bool:
    """Leave out phases that touch what a rig has no wall for; say whether there are any."""
    signals = dataset.nominal
    tip = signals.position + signals.R_base_sensor @ np.array(rig.tool.tip)
    if tip[:, 0].max() + MAX_WALL_SHIFT_M > rig.wall.position:
        return False
    return dataset.exclude_contact()


def prepare_commanded(recording: Recording, rig: Rig, accelerometer: str | None = None) -> Dataset:
    """
    Make one recording ready; all of its blocks are for training.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised by its volts where none is given.

    Raises
    ------
    DataError
        Commands or wrench are missing, most commands are, or they overlap for too short a time.
    """
    name = accelerometer or recognise_accelerometer(recording, rig)
    refuse_sparse_commands(recording, rig, name)
    start = estimate_start(recording, rig, name)
    assert recording.target is not None
    sensed = [s.t for s in (recording.wrench, recording.accelerometer, recording.optidrive)
              if s is not None and len(s)]
    if not sensed:
        raise DataError('the recording holds neither wrench nor accelerometer nor displacement; '
                        'record at least the wrench')
    end = min(max(float(t[-1]) for t in sensed), float(recording.target.t[-1]) + BLOCK)
    if end - max(start, min(float(t[0]) for t in sensed)) < MIN_COMMANDED_S:
        common = below(max(0.0, end - start), MIN_COMMANDED_S)
        raise DataError(f'commands and sensors overlap for {common} s; at '
                        f'least {MIN_COMMANDED_S:g} s are needed: record a longer sequence')
    replay = Replay(rig, recording.target, start, end, name)
    compared = convert_to_volts(replace(recording, joints=None), rig, name)
    return make_dataset(recording, compared, replay, rig,
                        _commanded_groups(replay.signals(rig), replay.n_blocks))


def _commanded_groups(signals: Signals, n: int) -> NDArray[np.intp]:
    touching = np.abs(signals.contact[:, :3]).max(axis=1).reshape(n, -1).max(axis=1) > 0.0
    rate = np.abs(signals.velocity).max(axis=1) + np.abs(signals.omega).max(axis=1) \
        + np.abs(signals.speed)
    moving = rate.reshape(n, -1).max(axis=1) > 1e-4
    groups = np.zeros(n, dtype=np.intp)
    groups[_spread(moving, REST_AFTER_BLOCKS)] = 1
    groups[_spread(touching, CONTACT_MARGIN_BLOCKS)] = 2
    return groups


def _spread(flag: NDArray[np.bool_], blocks: int) -> NDArray[np.bool_]:
    """Spread each true value over the blocks that follow it, and a few before."""
    count = np.convolve(flag, np.ones(blocks + 1))[:len(flag)] > 0.5
    before = np.convolve(flag[::-1], np.ones(6))[:len(flag)][::-1] > 0.5
    return np.asarray(count | before)


def is_tracked(rig: Rig) -> bool:
    """Return whether a rig states that its robot leaves more than the noise of the poses."""
    unexplained = rig.robot.unexplained
    return unexplained is not None and unexplained.beyond(rig.pose_sensor)


class TrackedRigSource(ToolSource):
    """
    Carries a rig's tool along the measured motion, and compares that with the replayed commands.

    For a rig whose robot leaves more than the noise of the poses (:func:`is_tracked`): that would
    look like a misfit of the wrench.
    """

    task = RigSource.task
    explained_by = ''

    def __init__(self, rig: Rig, accelerometer: str | None = None) -> None:
        super().__init__(rigid_tool_of_rig(rig), accelerometer=accelerometer)
        self.rig, self._rig = rig, rig
        self._tracking: list[Tracking] = []

    def prepare(self, recordings: Sequence[Recording]) -> list[Ready]:
        """Replay the commands, and merge the simulated motion with the measured one."""
        merging = [self._merge(one) for one in recordings]
        self._tracking = [tracking for _, tracking in merging]
        return super().prepare([recording for recording, _ in merging])

    def _merge(self, recording: Recording) -> tuple[Recording, Tracking]:
        rig = self._rig
        require_wrench_and_pose(recording, 'the recording lacks wrench or measured pose, and the '
                                'rig states that its model of the robot does not replace that; '
                                'record current_pose')
        ready = even_stamps(recording).recording
        require_overlap(ready, 'pose', MIN_MOTION_S)
        target, pose = ready.target, ready.pose
        assert target is not None
        assert pose is not None
        name = self._accelerometer or recognise_accelerometer(ready, rig)
        refuse_sparse_commands(ready, rig, name)
        start = estimate_start(ready, rig, name)
        end = min(float(target.t[-1]) + rig.robot.period, float(pose.t[-1]))
        signals = Replay(rig, target, start, end, name).signals(rig)
        t = start + (1.0 + np.arange(float(len(signals.position)))) / RATE
        simulated = PoseStream(t, signals.position, signals.R_base_sensor, pose.frame)
        return (replace(ready, pose=merge_poses(pose, simulated)),
                compare_motions(pose, simulated, True))

    def search(self, ready: Sequence[Ready]) -> Outcome:
        """Search, and return the rig of commands."""
        outcome = super().search(ready)
        own = {f.name: getattr(outcome.rig, f.name) for f in fields(Rig)}
        return replace(outcome, rig=Rig(**{**own, 'spreads': self._rig.spreads}))

    def reason(self, diagnosis: Diagnosis, ready: Sequence[Ready], outcome: Outcome) -> str:
        """Add how far the motion is from the simulated one."""
        motion, left = self._tracking[0], self._rig.robot.unexplained
        assert left is not None
        return (f'{diagnosis.reason}; the motion itself is {motion.size} from the simulated, the '
                f'rig states {1e3 * np.hypot(left.position, left.position_offset):.2g} mm and '
                f'{1e3 * np.hypot(left.orientation, left.orientation_offset):.2g} mrad')

    def notes(self, ready: Sequence[Ready], outcome: Outcome) -> list[str]:
        """Add how the motion was compared with what the rig states."""
        return [*super().notes(ready, outcome),
                ('the model of the robot leaves more than the noise of the poses, so the tool is '
                'carried along the measured motion'),
                *(note for one in self._tracking for note in self._compared(one))]

    def _compared(self, motion: Tracking) -> Iterator[str]:
        left, sensor = self._rig.robot.unexplained, self._rig.pose_sensor
        assert left is not None
        yield self._words('translation', motion.translation, (left.position, left.position_offset),
                          sensor.position_noise, 'mm')
        yield self._words('rotation', motion.rotation,
                          (left.orientation, left.orientation_offset), sensor.orientation_noise,
                          'mrad')

    def _words(self, name: str, one: Difference, states: tuple[float, float], noise: float,
               unit: str) -> str:
        stated, offset = states
        words = (f'{name}: {1e3 * one.rms:.2g} {unit} from the simulated, the rig states '
                 f'{1e3 * np.hypot(stated, offset):.2g} {unit}, {1e3 * offset:.2g} of it fixed '
                 f'and {1e3 * stated:.2g} not{one.delay_words(unit)}')
        late = np.isfinite(one.delay) and abs(one.delay) > max(
            3.0 * one.delay_std, 0.5 * self._rig.robot.period)
        if late or one.unexplained > MAX_UNEXPLAINED * float(np.hypot(stated, noise)):
            words += '; it moves differently than when the rig was fitted: fit it again'
        return words

    def files(self, outcome: Outcome) -> dict[str, str]:
        """Return the rig with what was found."""
        return {'rig_patched.yaml': dump_rig(outcome.rig)} if outcome.datasets else {}
