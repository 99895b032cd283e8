"""
A simulator that cannot be run again: its recorded wrench, carried over to the measured motion.

The robot does not move exactly as its simulation did, and a wrench follows the motion. What is
compared with the measured wrench is therefore the simulated one, plus what a rigid tool makes of
the difference of the two motions: w_sim + W(measured motion) - W(simulated motion). So is the
specific force, where both have an Imu.
"""

from dataclasses import replace

from forcecal_ros.diagnose.body import Body
from forcecal_ros.diagnose.carried_tool import CarriedTool
from forcecal_ros.diagnose.measured_motion import MeasuredMotion
from forcecal_ros.diagnose.merged_motion import merged
from forcecal_ros.diagnose.simulated_contact import touches
from forcecal_ros.diagnose.simulation import block_means, RATE, Signals
from forcecal_ros.effects import AccelerometerEffects, physical_rig
from forcecal_ros.effects.rig import Rig
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import Recording
import numpy as np


class RecordedSimulation(MeasuredMotion):
    """
    One recorded motion, along which a simulator's tool is carried as often as needed.

    Parameters
    ----------
    recording : Recording
        Of the robot: its pose.
    simulated : Recording
        Of the simulator, on the robot's clock: wrench and pose, and specific force where it has.
    start : float
        When block 0 begins [s].
    n_blocks : int
    accelerometer : str
        ``acc1`` or ``acc2``.
    body : Body
        The simulator's, see :func:`~forcecal_ros.diagnose.simulated_tool.simulated_tool`.

    Attributes
    ----------
    touching : ndarray of bool, shape (n_blocks,)
        Where the simulated tool touches something.
    """

    def __init__(self, recording: Recording, simulated: Recording, start: float, n_blocks: int,
                 accelerometer: str, body: Body) -> None:
        measured, made = recording.pose, simulated.pose
        assert measured is not None
        assert made is not None
        felt, simulated = simulated.accelerometer, replace(simulated, accelerometer=None)
        super().__init__(replace(recording, pose=merged(measured, made), accelerometer=None),
                         start, n_blocks, accelerometer, body)
        own = CarriedTool(simulated, start, n_blocks, accelerometer)
        self._full.beyond = self._clear.beyond = own.seen(simulated) - own.wire(body)
        self.touching = touches(block_means(self._full.beyond))
        self._felt = None if felt is None else self._carried_over(felt.at(own.t), own, body)

    def _carried_over(self, felt: Array, own: CarriedTool, body: Body) -> Array:
        """Take what is felt without weight, where the Imu is, to the robot's motion, (n, 3)."""
        f = own.specific_force_of_origin(body)
        place = np.linalg.lstsq(own.lever.reshape(-1, 3), (felt - f).ravel(), rcond=1e-6)[0]
        there = self._full.specific_force_of_origin(body) + self._full.lever @ place
        return np.asarray(felt - f - own.lever @ place + there - self._full.weight(body))

    def signals(self, rig: Rig) -> Signals:
        """Carry a tool along, and the simulator's Imu."""
        found = super().signals(rig)
        if self._felt is None:
            return found
        body = physical_rig(rig)
        model = body.accelerometer.model(self.accelerometer)
        on_volts = AccelerometerEffects(rig, self.accelerometer, 1.0 / RATE)
        felt = np.asarray(self._felt + self._full.weight(body))
        return found._replace(volts=on_volts.after_noise(on_volts.before_noise(
            felt * model.gain + model.offset)))
