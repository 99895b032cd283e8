"""The rig offline: recorded commands in, the recording they would give out."""

from typing import Literal

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.simulator import checked_commands, Samples, Simulator
import numpy as np
from numpy.typing import NDArray

BLOCK = 500
"""Robot periods simulated in one block, which bounds the memory."""


def held_commands(stamps: Array, starts: Array, tolerance: float) -> NDArray[np.intp]:
    """
    Say which command holds during each robot period: the latest one there is at its start.

    Parameters
    ----------
    stamps : ndarray, shape (m,)
        Of the commands, increasing [s].
    starts : ndarray, shape (n,)
        Of the robot's periods [s]; before the first command, the first one holds.
    tolerance : float
        How late a command may be and still count for its period [s].

    Returns
    -------
    ndarray of int, shape (n,)
    """
    latest = np.searchsorted(stamps, starts + tolerance, side='right') - 1
    return np.maximum(latest, 0)


def simulate(rig: Rig, target: PoseStream, *, accelerometer: str | None = None,
             noise: bool = True, seed: int | None = None, start: float | None = None,
             duration: float | None = None, tolerance: float | None = None,
             unit: Literal['V', 'm/s^2'] = 'V', steps: int | None = None) -> Recording:
    """
    Simulate the recording that a stream of commands would give.

    Parameters
    ----------
    target : PoseStream
        Commanded poses. In each period of the robot the command holds that is the latest at its
        start: a late one takes effect a period later, a missing one leaves the one before.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.
    noise : bool
        False: readings of noise-free sensors, without losses.
    seed : int, optional
        Of the noise; fresh noise each time where none is given.
    start : float, optional
        When period 0 begins [s]; at the first command where none is given.
    duration : float, optional
        How long to go on from the start [s]; one period beyond the last command where none is
        given.
    tolerance : float, optional
        How late a stamp may be and still count for its period [s]; half a period where none is
        given, so that each command counts for the period nearest to its stamp and jitter neither
        drops nor doubles any.
    unit : str
        Of the accelerometer: ``V``, or ``m/s^2`` for specific force.
    steps : int, optional
        Integration steps per period; fewest sufficient ones where none is given.

    Returns
    -------
    Recording
        Times on the clock of ``target``.

    Raises
    ------
    DataError
        There are no commands, or commands without position.
    """
    if not target.has_position:
        raise DataError(f'{len(target)} commands with position; a simulation needs at least one, '
                        'and none without: record target_frame')
    period = rig.robot.period
    t0 = float(target.t[0]) if start is None else start
    span = float(target.t[-1]) - t0 + period if duration is None else duration
    starts = np.array([t0 + k * period for k in range(max(1, round(span / period)))])
    held = held_commands(target.t, starts, period / 2.0 if tolerance is None else tolerance)
    positions, xyzw = checked_commands(target.position, target.R_base_sensor)
    simulator = Simulator(rig, accelerometer, seed, steps=steps)
    blocks = [simulator.run(positions[held[i:i + BLOCK]], xyzw[held[i:i + BLOCK]], noise)
              for i in range(0, len(held), BLOCK)]
    samples = Samples(*map(np.concatenate, zip(*blocks)))
    return _recording(samples, target, t0, unit)


def _recording(s: Samples, target: PoseStream, t0: float, unit: str) -> Recording:
    return Recording(
        wrench=Stream(t0 + s.wrench_t, s.wrench, 'ft_sensor'),
        accelerometer=Stream(t0 + s.accelerometer_t,
                             s.volts if unit == 'V' else s.specific_force, 'accelerometer'),
        accelerometer_unit=unit,
        pose=PoseStream(t0 + s.pose_t, s.position, s.R_base_sensor, target.frame),
        target=target,
        optidrive=(Stream(t0 + s.optidrive_t, s.optidrive[:, np.newaxis], 'ft_sensor')
                   if len(s.optidrive) else None),
        contact_truth=Stream(t0 + s.contact_t, s.contact, 'ft_sensor'),
        source='simulation')
