"""Measured positions of joints beside those of a simulator that is run."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from forcecal_ros.core.streams import JointStream, Recording
import numpy as np


def measured_joints(joints: JointStream | None) -> tuple[str, ...]:
    """Return the names of the joints that a simulator may be compared with."""
    return () if joints is None or not len(joints) else joints.names


def of_same_joints(recordings: Sequence[Recording]) -> list[Recording]:
    """Leave joints out of recordings that do not all hold the same, in one order."""
    if len({measured_joints(one.joints) for one in recordings}) == 1:
        return list(recordings)
    return [replace(one, joints=None) for one in recordings]


def compared(joints: JointStream | None, names: Sequence[str]) -> JointStream | None:
    """
    Keep the joints that a simulator has, and samples of which each is a number.

    Parameters
    ----------
    joints : JointStream or None
        Measured.
    names : sequence of str
        The simulator's, some of the measured.

    Returns
    -------
    JointStream or None
        None where there is nothing to compare.
    """
    if joints is None or not len(joints) or not names:
        return None
    rows = joints.values[:, [joints.names.index(name) for name in names]]
    good = np.isfinite(rows).all(axis=1)
    if not good.any():
        return None
    return replace(joints, t=joints.t[good], values=rows[good], names=tuple(names))


def named_joints(names: Sequence[str], recordings: Sequence[Recording]) -> Iterator[str]:
    """Say by which names the channels of joints go."""
    listed = [one.joints for one in recordings if one.joints is not None]
    if listed:
        yield 'joints compared: ' + ', '.join(f'joint.{i} {name}' for i, name in enumerate(names))


def not_simulated(measured: Sequence[str], names: Sequence[str]) -> Iterator[str]:
    """Say which measured joints a simulator lacks."""
    if measured and not names:
        yield (f'it simulates none of the joints in joint_states ({", ".join(measured)}): what '
               'friction and gains of joints do is seen in the pose alone; return joints, named '
               'as measured')
    elif missing := [name for name in measured if name not in names]:
        yield f'not compared, as it does not simulate them: joints {", ".join(missing)}'
