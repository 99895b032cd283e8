"""Tool and sensors of a recording as sections of a rig, by the estimates of a calibration."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.calibration import Accelerometer as CalibratedAccelerometer
from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import above, DataError, UnobservableError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.effects.nuisances import possible, rows_of
from forcecal_ros.effects.rig import (
    Accelerometer,
    AccelerometerModel,
    NominalTolerances,
    Optidrive,
    Rig,
)
from forcecal_ros.sim.rigid_tool import GYRATION
import numpy as np


class ToolFit(NamedTuple):
    """A rig with tool and sensors as they are, and what is to be known of them."""

    rig: Rig
    notes: tuple[str, ...]


def fit_tool(rig: Rig, recordings: Sequence[Recording], settings: IdentificationSettings
             ) -> ToolFit:
    """
    Give a rig the tool and the sensors of a robot.

    The first recording that can be calibrated gives them.

    Raises
    ------
    DataError, UnobservableError
        No recording can be calibrated, or the accelerometer is rotated against the sensor.
    """
    refused: DataError | UnobservableError | None = None
    for one in recordings:
        try:
            return _calibrated(rig, one, identify(one, settings))
        except (DataError, UnobservableError) as error:
            refused = refused or error
    assert refused is not None
    raise refused


def _calibrated(rig: Rig, recording: Recording, c: Calibration) -> ToolFit:
    # relative tolerance of an inertia that is not identifiable
    unknown_inertia = 1.0
    mass, usual, notes = float(c.mass), rig.spreads, []
    inertia, relative = mass * GYRATION ** 2 * np.eye(3), unknown_inertia
    if c.inertia is None:
        notes.append(f'the inertia of the tool is not identifiable; that of a gripper of '
                     f'{mass:.3g} kg is taken')
    else:
        inertia = possible(c.inertia.value)
        known = np.diag(_std(c.inertia)) / np.maximum(np.diag(inertia), 1e-9)
        relative = min(unknown_inertia, float(known.max()))
    com = tuple(c.com.value.tolist())
    rig = replace(
        rig, tool=replace(rig.tool, mass=mass, com=com, inertia=rows_of(inertia), tip=com),
        wrench_sensor=replace(rig.wrench_sensor, bias=tuple(c.wrench_bias.value.tolist())),
        optidrive=_slide(rig, recording, c),
        spreads=_no_surer(usual, mass=_std(c.mass).max() / mass, com=_std(c.com).max(),
                          inertia=relative, force_bias=_std(c.wrench_bias)[:3].max(),
                          torque_bias=_std(c.wrench_bias)[3:].max()))
    if c.tool is not None and rig.optidrive is None:
        notes.append('the tool gives, and no displacement sensor measures how far; it is taken '
                     'as rigid')
    if c.accelerometer is None:
        return ToolFit(rig, (*notes, 'no accelerometer was recorded; the rig has the nominal one'))
    return _with_accelerometer(rig, c.accelerometer, tuple(notes))


def _std(estimate: Estimate) -> Any:
    return np.nan_to_num(np.atleast_1d(estimate.std))


def _no_surer(usual: NominalTolerances, **known: float) -> NominalTolerances:
    """Add what an estimate does not know to how far a healthy rig departs from its file."""
    spreads: NominalTolerances = replace(usual, **{
        name: float(np.hypot(getattr(usual, name), std)) for name, std in known.items()})
    return spreads


def _slide(rig: Rig, recording: Recording, c: Calibration) -> Optidrive | None:
    stream, tool = recording.optidrive, c.tool
    if tool is None or stream is None or len(stream) < 2:
        return None
    return Optidrive(float(tool.stiffness), max(0.0, float(tool.damping)),
                     rate_beside(stream.t, rig.robot.period), noise_of(stream.values))


def _with_accelerometer(rig: Rig, a: CalibratedAccelerometer, notes: tuple[str, ...]) -> ToolFit:
    """Mount it; one in m/s^2 keeps a gain of 1, and what it is off counts as tolerance."""
    # of an accelerometer against ft_sensor [rad]: that reads 2 % of gravity on another axis
    most_turned = 0.02
    turned = float(np.linalg.norm(rotation_vector(a.map.value)))
    if turned > most_turned:
        raise DataError(
            f'accelerometer: its axes are turned by '
            f'{above(np.degrees(turned), np.degrees(most_turned))} deg against ft_sensor, '
            f'expected {np.degrees(most_turned):.3g} deg at most, as a rig mounts it '
            'along the sensor; record it in that frame')
    position = rig.tool.com
    if a.position is None:
        notes = (*notes, ('the place of the accelerometer is not identifiable; it is put into '
                 'the centre of mass'))
    else:
        x, y, z = a.position.value.tolist()
        position = (x, y, z)
    gain, offset = a.gain.value, a.offset.value
    of_gain = float(np.max(_std(a.gain) / np.abs(gain)))
    if a.unit != 'V':
        of_gain = float(np.hypot(of_gain, np.abs(gain - 1.0).max()))
        gain = np.ones(3)
    ac = a.coupling == 'ac' and a.cutoff is not None
    model = AccelerometerModel(tuple(gain.tolist()), tuple(offset.tolist()),
                               float(a.cutoff) if ac and a.cutoff is not None else 0.0)
    mounted: Accelerometer = replace(rig.accelerometer, mounted='acc1', acc1=model,
                                     position=position)
    spreads = _no_surer(rig.spreads, accelerometer_gain=of_gain,
                        accelerometer_offset=_std(a.offset).max())
    return ToolFit(replace(rig, accelerometer=mounted, spreads=spreads), notes)


_SMOOTHEST = (1.0, -4.0, 6.0, -4.0, 1.0)
"""Fourth difference: of a motion within 10 Hz at 250 Hz it leaves less than a hundredth."""

FEWEST = 50
"""Samples from which rate and noise are estimated."""

def period_of(t: Array) -> float:
    """Return the mean interval between samples, those that got lost counted [s]."""
    steps = np.diff(t)
    middle = float(np.median(steps))
    return float((t[-1] - t[0]) / np.maximum(1.0, np.round(steps / middle)).sum())


def command_period(t: Array) -> float:
    """
    Return the period of commands, rounded to a whole rate, or to 0.1 ms [s].

    Raises
    ------
    DataError
        They come irregularly, or too few.
    """
    # periods that are no whole number of hertz are taken in these steps [s]
    tenth = 1e-4
    if len(t) < FEWEST:
        raise DataError(f'target_frame: {len(t)} commands do not tell how the robot follows; '
                        'record the commands while it moves, 10 s or more')
    period = period_of(t)
    steps = np.diff(t) / period
    off = float(np.mean(np.abs(steps - np.maximum(1.0, np.round(steps))) > 0.5 - 1e-9)
                + np.mean(steps > 1.5))
    # irregular: share of intervals between commands that may be off by half a period: some get
    # lost
    if off > 0.1:
        raise DataError(f'target_frame: {100.0 * off:.0f} % of the commands come irregularly, '
                        f'expected one every {1e3 * period:.3g} ms; stream them at a fixed rate')
    rate = round(1.0 / period)
    # round: of a rate: as far from a whole number of hertz as computers' clocks are apart at most
    if rate and abs(rate * period - 1.0) < 1e-3:
        return 1.0 / rate
    return round(period / tenth) * tenth


def rate_beside(t: Array, period: float) -> float:
    """Return a stream's rate as a rig may have it: a whole multiple of the commands' [Hz]."""
    return max(1, round(period / period_of(t))) / period


def noise_of(values: Array) -> float:
    """Return the noise of one sample, white, by fourth differences of all columns together."""
    rows = np.reshape(values, (len(values), -1))
    if len(rows) < FEWEST:
        return 0.0
    apart = sum(c * rows[i:len(rows) - 4 + i] for i, c in enumerate(_SMOOTHEST))
    scale = float(np.sqrt(np.square(_SMOOTHEST).sum()))
    return float(np.sqrt(np.mean(np.median(np.abs(apart), axis=0) ** 2))) / (0.6745 * scale)


def orientation_noise(pose: PoseStream) -> float:
    """Return the noise of an orientation, per axis [rad]."""
    turns = rotation_vector(np.swapaxes(pose.R_base_sensor[:-1], 1, 2) @ pose.R_base_sensor[1:])
    return noise_of(np.cumsum(turns, axis=0))
