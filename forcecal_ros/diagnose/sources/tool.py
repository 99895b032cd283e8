"""A tool carried along the measured motion: recordings without commands."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.noise.autoregression import FEWEST
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.diagnose.dataset import (
    Dataset,
    make_dataset,
    MIN_MOTION_S,
    motion_groups,
    require_wrench_and_pose,
    span,
)
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.recordings import (
    apply_accelerometer_calibration,
    convert_to_volts,
    even_stamps,
    require_axes_of,
    require_overlap,
)
from forcecal_ros.diagnose.result import patched_calibration
from forcecal_ros.diagnose.sources.source import Ready, recalibration_notes, Source
from forcecal_ros.io.calibration_file import dump
from forcecal_ros.sim.measured_motion import MeasuredMotion
from forcecal_ros.sim.rigid_tool import RigidTool
from forcecal_ros.sim.signals import BLOCK
import numpy as np
from numpy.typing import NDArray

IDENTIFIABLE = 0.5
"""Standard error, in its prior's, up to which the motion identifies a delay or an inertia."""


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
        require_axes_of(self._tool, [s.recording for s in stamps],
                        'calibration' if self._calibration else 'rig')
        if self._calibration is not None:
            stamps = [s._replace(recording=apply_accelerometer_calibration(
                s.recording, self._calibration.accelerometer)) for s in stamps]
        for one in stamps:
            require_overlap(one.recording, 'pose', MIN_MOTION_S)
        return [Ready(prepare_motion(s.recording, self._tool, self._accelerometer), s, given)
                for s, given in zip(stamps, recordings)]

    def notes(self, ready: Sequence[Ready], outcome: Outcome) -> list[str]:
        """List what was recalibrated."""
        return list(recalibration_notes(outcome, self.unit))

    def details(self, ready: Sequence[Ready], outcome: Outcome) -> dict[str, Any]:
        """Name the calibration that was written."""
        written = self._calibration is not None and outcome.datasets
        return {'calibration': 'calibration_patched.yaml'} if written else {}

    def files(self, outcome: Outcome) -> dict[str, str]:
        """Return the calibration with what was found."""
        if self._calibration is None or not outcome.datasets:
            return {}
        assert isinstance(outcome.rig, RigidTool)
        found = {name: std for name, (_, std) in outcome.recalibrations.items()}
        spreads = outcome.rig.spreads
        delay = found.get('accelerometer.delay', 0.0)
        x, y, z = (found.get(f'tool.inertia.{axis}', 0.0) for axis in 'xyz')
        identified = all(0.0 < std < IDENTIFIABLE * spreads.own_inertia for std in (x, y, z))
        return {'calibration_patched.yaml': dump(patched_calibration(
            self._calibration, outcome.rig,
            delay if 0.0 < delay < IDENTIFIABLE * spreads.accel_behind else None,
            (x, y, z) if identified else None))}


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
    simulation = MeasuredMotion(moved, *span(moved), name, rigid_tool)
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
