"""A rig: recorded commands replayed through it, or its tool carried along the measured motion."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.noise.autoregression import FEWEST
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.diagnose.dataset import (
    Dataset,
    make_dataset,
    MIN_MOTION_S,
    motion_groups,
    require_wrench_and_pose,
    REST_AFTER_BLOCKS,
    span,
)
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.localise import compare_motions, Tracking
from forcecal_ros.diagnose.recordings import (
    apply_accelerometer_calibration,
    convert_to_volts,
    correct_clocks,
    estimate_start,
    even_stamps,
    recognise_accelerometer,
    refuse_sparse_commands,
    require_axes_of,
    require_commands,
    require_overlap,
)
from forcecal_ros.diagnose.result import Diagnosis, patched_calibration
from forcecal_ros.diagnose.sources.source import Ready, recalibration_notes, Source
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.rig import Rig, Unexplained
from forcecal_ros.io.calibration_file import dump
from forcecal_ros.sim.measured_motion import MeasuredMotion, merge_poses
from forcecal_ros.sim.rig.file import dump_rig
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.rigid_tool import MARGIN_S, rigid_tool_of_rig, RigidTool
from forcecal_ros.sim.signals import BLOCK, RATE, Signals
import numpy as np
from numpy.typing import NDArray

MIN_COMMANDED_S = 5.0
"""Length of a recording with commands, at least, that can be diagnosed [s]."""

MAX_WALL_SHIFT_M = EFFECTS['wall_position'].parameters[0].high
"""Distance by which a wall may be nearer than in a rig's file: as an effect may shift it [m]."""

CONTACT_MARGIN_BLOCKS = 25
"""Blocks before and after contact that count as contact."""

NO_WALL = ('contact phases are left out, as the rig has no wall within reach; add the wall to '
           'the rig to compare them')

ALONG_MOTION = ('the error of the robot model exceeds the noise of the poses, so the wrench is '
                'compared along the measured motion')

MAX_UNEXPLAINED = 3.0
"""
Times what a rig states, from which its robot moves differently than when it was fitted: in other
places a linear model leaves twice as much.
"""


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
    by_phase = True

    def __init__(self, rig: Rig, accelerometer: str | None = None) -> None:
        super().__init__(rig)
        self._accelerometer = accelerometer

    def prepare(self, recordings: Sequence[Recording]) -> list[Ready]:
        """Bring all streams to the clock of the commands, and replay these."""
        stamps = [correct_clocks(r, self.rig, MIN_COMMANDED_S) for r in recordings]
        for one in stamps:
            require_axes_of(self.rig, one.recording)
        datasets = [prepare_commanded(s.recording, self.rig, self._accelerometer) for s in stamps]
        return [Ready(dataset, s, given, (NO_WALL,) if exclude_contact(dataset, self.rig) else ())
                for dataset, s, given in zip(datasets, stamps, recordings)]

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
        Most commands are missing.
    """
    name, start = _begin_replay(recording, rig, accelerometer)
    assert recording.target is not None
    sensed = [s.t for s in (recording.wrench, recording.accelerometer, recording.optidrive)
              if s is not None and len(s)]
    end = min(max(float(t[-1]) for t in sensed), float(recording.target.t[-1]) + BLOCK)
    replay = Replay(rig, recording.target, start, end, name)
    compared = convert_to_volts(replace(recording, joints=None), rig, name)
    return make_dataset(recording, compared, replay, rig,
                        _commanded_groups(replay.signals(rig), replay.n_blocks))


def _begin_replay(recording: Recording, rig: Rig, accelerometer: str | None) -> tuple[str, float]:
    """Return which accelerometer is mounted, and when the robot's period 0 began [s]."""
    name = accelerometer or recognise_accelerometer(recording, rig)
    refuse_sparse_commands(recording, rig, name)
    return name, estimate_start(recording, rig, name)


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


class ToolSource(Source):
    """
    Carries a rigid tool along the measured motion.

    Parameters
    ----------
    rig : RigidTool
    calibration : Calibration, optional
        That it was made of: defines what the accelerometer's readings mean.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the mounted one if None.
    """

    task = 'comparing the wrench with the measured motion'
    explained_by = 'measured motion'

    def __init__(self, rig: RigidTool, calibration: Calibration | None = None,
                 accelerometer: str | None = None) -> None:
        super().__init__(rig, rig.accelerometer_unit)
        self._tool, self._calibration = rig, calibration
        self._accelerometer = accelerometer

    def prepare(self, recordings: Sequence[Recording]) -> list[Ready]:
        """Check axes and streams, and carry the tool along."""
        stamps = [even_stamps(r) for r in recordings]
        for one in stamps:
            require_axes_of(self._tool, one.recording,
                            'calibration' if self._calibration else 'rig')
        if self._calibration is not None:
            stamps = [s._replace(recording=apply_accelerometer_calibration(
                s.recording, self._calibration.accelerometer)) for s in stamps]
        for one in stamps:
            require_overlap(one.recording, 'pose', MIN_MOTION_S)
        return [Ready(prepare_motion(s.recording, self._tool, self._accelerometer), s, given)
                for s, given in zip(stamps, recordings)]

    def explain(self, diagnosis: Diagnosis, outcome: Outcome) -> Diagnosis:
        """List what was recalibrated."""
        return replace(diagnosis, notes=(*diagnosis.notes,
                                         *recalibration_notes(outcome, self.unit)))

    def files(self, outcome: Outcome) -> dict[str, str]:
        """Return the calibration with what was found."""
        if self._calibration is None or not outcome.datasets:
            return {}
        assert isinstance(outcome.rig, RigidTool)
        return {'calibration_patched.yaml': dump(patched_calibration(
            self._calibration, outcome.rig,
            {name: std for name, (_, std) in outcome.recalibrations.items()}))}


def prepare_motion(recording: Recording, rigid_tool: RigidTool,
                   accelerometer: str | None = None) -> Dataset:
    """
    Make one recording ready; all of its blocks are for training.

    Parameters
    ----------
    recording : Recording
        Of a calibrated tool its accelerometer is in m/s^2 along ft_sensor.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the mounted one if None.

    Returns
    -------
    Dataset
        Its pose is an input, and its accelerometer is compared at rest only.

    Raises
    ------
    DataError
        Wrench or pose are missing, or overlap for too short a time.
    """
    require_wrench_and_pose(
        recording, 'the recording holds neither commands nor wrench with measured pose; record '
        'wrench and current_pose')
    name = accelerometer or rigid_tool.accelerometer.mounted
    moved = convert_to_volts(recording, rigid_tool, name)
    volts = moved.accelerometer if moved.accelerometer and len(moved.accelerometer) > 1 else None
    if rigid_tool.accelerometer.model(name).highpass:
        volts = None
    moved = replace(moved, accelerometer=volts)
    simulation = MeasuredMotion(moved, *span(moved, margin=MARGIN_S), name, rigid_tool)
    groups = motion_groups(simulation.signals(rigid_tool))
    return motion_dataset(moved, simulation, rigid_tool, groups,
                          _at_rest(volts, groups, simulation.start))


def motion_dataset(recording: Recording, simulation: MeasuredMotion, rigid_tool: RigidTool,
                   groups: NDArray[np.intp], accelerometer: Stream | None) -> Dataset:
    """Compare wrench and accelerometer only, outside phases that touch something."""
    compared = replace(recording, target=None, pose=None, optidrive=None, joints=None,
                       accelerometer=accelerometer)
    dataset = make_dataset(recording, compared, simulation, rigid_tool, groups)
    dataset.exclude_contact()
    return dataset


def _at_rest(stream: Stream | None, groups: NDArray[np.intp], start: float) -> Stream | None:
    """Keep readings of an accelerometer at rest: in motion they are an input."""
    if stream is None:
        return None
    block = np.floor((stream.t - start) / BLOCK).astype(int)
    rest = (block >= 0) & (block < len(groups))
    rest[rest] = groups[block[rest]] == 0
    if len(np.unique(block[rest])) < FEWEST:
        return None
    return stream.rows(rest)


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
        self.rig = rig
        self._tracking: list[Tracking] = []

    def prepare(self, recordings: Sequence[Recording]) -> list[Ready]:
        """Replay the commands, and merge the simulated motion with the measured one."""
        merged, self._tracking = [], []
        for one in recordings:
            require_wrench_and_pose(
                one, 'the recording lacks wrench or measured pose, and the robot model of the '
                'rig is not accurate enough to replace the pose; record both')
            one = even_stamps(one).recording
            require_commands(one)
            require_overlap(one, 'pose', MIN_MOTION_S)
            name, start = _begin_replay(one, self.rig, self._accelerometer)
            target, pose = one.target, one.pose
            assert target is not None and pose is not None
            end = min(float(target.t[-1]) + self.rig.robot.period, float(pose.t[-1]))
            signals = Replay(self.rig, target, start, end, name).signals(self.rig)
            t = start + (1.0 + np.arange(len(signals.position), dtype=np.float64)) / RATE
            simulated = PoseStream(t, signals.position, signals.R_base_sensor, target.frame)
            self._tracking.append(compare_motions(pose, simulated, True))
            merged.append(replace(one, pose=merge_poses(pose, simulated)))
        return super().prepare(merged)

    def search(self) -> Outcome:
        """Search, and return the rig of commands."""
        outcome = super().search()
        own = {f.name: getattr(outcome.rig, f.name) for f in fields(Rig)}
        return replace(outcome, rig=Rig(**{**own, 'spreads': self.rig.spreads}))

    def explain(self, diagnosis: Diagnosis, outcome: Outcome) -> Diagnosis:
        """Add how the motion was compared with the simulated, and with what the rig states."""
        found, left = super().explain(diagnosis, outcome), self.rig.robot.unexplained
        assert left is not None
        reason = (
            f'{found.reason}; the motion differs by {self._tracking[0].size} from the simulated '
            f'one, expected {1e3 * np.hypot(left.position, left.position_offset):.2g} mm and '
            f'{1e3 * np.hypot(left.orientation, left.orientation_offset):.2g} mrad')
        notes = [note for one in self._tracking for note in self._compared(one, left)]
        return replace(found, reason=reason, notes=(*found.notes, ALONG_MOTION, *notes))

    def _compared(self, motion: Tracking, left: Unexplained) -> Iterator[str]:
        """Compare the difference of the motions with what the rig states of it."""
        sensor = self.rig.pose_sensor
        for name, one, stated, offset, noise, unit in (
                ('translation', motion.translation, left.position, left.position_offset,
                 sensor.position_noise, 'mm'),
                ('rotation', motion.rotation, left.orientation, left.orientation_offset,
                 sensor.orientation_noise, 'mrad')):
            late = np.isfinite(one.delay) and abs(one.delay) > max(
                3.0 * one.delay_std, 0.5 * self.rig.robot.period)
            otherwise = late or one.unexplained > MAX_UNEXPLAINED * float(np.hypot(stated, noise))
            yield (f'{name}: {1e3 * one.rms:.2g} {unit} from the simulated, expected '
                   f'{1e3 * np.hypot(stated, offset):.2g} {unit} ({1e3 * offset:.2g} constant, '
                   f'{1e3 * stated:.2g} varying){one.delay_words(unit)}'
                   + ('; the robot moves differently than when the rig was fitted: fit it again'
                      if otherwise else ''))

    def files(self, outcome: Outcome) -> dict[str, str]:
        """Return the rig with what was found."""
        return {'rig_patched.yaml': dump_rig(outcome.rig)} if outcome.datasets else {}


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
