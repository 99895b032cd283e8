"""Stamps made right before anything is replayed: clocks that run fast or slow, lost samples."""

from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.diagnose import datachecks
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.samples import Recording
from forcecal_ros.sim.rig import Rig
import numpy as np


class Corrected(NamedTuple):
    """
    A recording on one clock.

    Attributes
    ----------
    recording : Recording
    clocks : tuple of Clock
        As they were found.
    skew : dict of str to float
        Of the streams whose stamps were corrected.
    lost : dict of str to float
        Fraction of lost samples by stream.
    """

    recording: Recording
    clocks: tuple[datachecks.Clock, ...]
    skew: dict[str, float]
    lost: dict[str, float]


def corrected(recording: Recording, rig: Rig) -> Corrected:
    """
    Bring all streams to the clock of the commands.

    Parameters
    ----------
    recording : Recording
    rig : Rig

    Returns
    -------
    Corrected

    Raises
    ------
    DataError
        Commands or sensors are missing, not finite, or do not overlap.
    """
    _check(recording)
    found = datachecks.clocks(recording, _rates(rig))
    skew = datachecks.skew_between(found)
    start = float(recording.target.t[0]) if recording.target is not None else 0.0
    changed = {}
    for name, value in skew.items():
        stream = getattr(recording, name)
        changed[name] = replace(stream, t=start + (stream.t - start) / (1.0 + value))
    return Corrected(replace(recording, **changed), found, skew, datachecks.dropouts(found))


def _rates(rig: Rig) -> dict[str, float]:
    rates = {'wrench': rig.wrench_sensor.rate, 'accelerometer': rig.accelerometer.rate,
             'pose': rig.pose_sensor.rate, 'target': 1.0 / rig.robot.period}
    return rates | ({'optidrive': rig.optidrive.rate} if rig.optidrive else {})


def _check(recording: Recording) -> None:
    target = recording.target
    if target is None or not len(target):
        raise DataError('the recording holds no commands (target_frame); record them, the '
                        'simulator replays them')
    if not target.has_position or not np.isfinite(target.R_base_sensor).all():
        raise DataError('a commanded pose is not finite; record target_frame again')
    for name in ('wrench', 'accelerometer', 'optidrive'):
        stream = getattr(recording, name)
        if stream is None or not len(stream):
            continue
        bad = ~np.isfinite(stream.values).all(axis=1)
        if bad.mean() > 0.01:
            raise DataError(f'{name}: {100.0 * bad.mean():.1f} % of the samples are not finite; '
                            'check the driver and record again')
        if _constant(stream.values):
            raise DataError(f'{name}: the values never change; check the driver and record again')


def _constant(values: Array) -> bool:
    return bool(np.ptp(values, axis=0).max() == 0.0)
