"""The recorded commands through the rig, noise-free, kinematics shared between variants."""

from dataclasses import replace
from fractions import Fraction
from math import inf, lcm

from forcecal_ros.core.streams import PoseStream
from forcecal_ros.effects import applicable, EFFECTS, WrenchEffects
from forcecal_ros.effects.nuisances import Nuisance, nuisances
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.measured_motion import EXACT_RATIO
from forcecal_ros.sim.rig.plant import common_samples, enough_steps, Plant, same_motion
from forcecal_ros.sim.rig.robot import Motion
from forcecal_ros.sim.rig.simulator import checked_commands, held_commands
from forcecal_ros.sim.signals import accelerometer_volts, BLOCK, Last, RATE, Signals, UNSEEN
import numpy as np


class Replay:
    """
    One stream of commands, simulated as often as needed.

    Parameters
    ----------
    rig : Rig
        Gives the period of the commands.
    start : float
        When period 0 begins [s].
    end : float
        How far to go [s].
    accelerometer : str
        ``acc1`` or ``acc2``.
    """

    band, exact, starts_white, library, from_accelerometer = inf, 0.0, False, EFFECTS, False

    def __init__(self, rig: Rig, target: PoseStream, start: float, end: float,
                 accelerometer: str) -> None:
        period = rig.robot.period
        if rig.robot.unexplained is not None:  # fitted to recordings, as inexact as their motion
            self.exact = EXACT_RATIO
        self.start, self.accelerometer = start, accelerometer
        self.n_blocks = max(1, int(np.floor((end - start) / BLOCK + 1e-6)))
        # the last block may end within a period
        self.n_periods = max(1, int(np.ceil(self.n_blocks * BLOCK / period - 1e-6)))
        starts = np.asarray(start + period * np.arange(self.n_periods), dtype=np.float64)
        held = held_commands(target.t, starts, period / 2.0)
        positions, xyzw = checked_commands(target.position, target.R_base_sensor)
        self._positions, self._xyzw = positions[held], xyzw[held]
        self._motion: Last[tuple[Motion, Motion]] = Last()
        self._signals: Last[Signals] = Last()

    def nuisances(self, rig: Rig, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
        """List the nuisance parameters, as far as the streams at hand can show it."""
        return nuisances(rig, self.accelerometer, streams)

    def clear(self, signals: Signals) -> Signals:
        """Return signals without noise: these have none."""
        return signals

    smooth = clear

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect could be there and be seen."""
        return effect not in UNSEEN and applicable(EFFECTS[effect], rig)

    def tangent(self, rig: Rig, nuisance: str) -> None:
        """Return that its signals are linear about no point."""

    def settle(self, rig: Rig, *, whole: bool = False) -> bool:
        """Return that signals are exact as they are."""
        return False

    def signals(self, rig: Rig) -> Signals:
        """Simulate the rig."""
        physics = self._physics(rig)
        sensor = rig.wrench_sensor
        effects = tuple(one for one in rig.effects if one[0] not in UNSEEN)
        seen = rig if effects == rig.effects else replace(rig, effects=effects)
        on_wrench = WrenchEffects(seen, 1.0 / RATE)
        wrench = on_wrench.after_noise(
            on_wrench.before_noise(physics.wrench * sensor.gain + sensor.bias))
        return physics._replace(wrench=wrench, volts=accelerometer_volts(
            seen, self.accelerometer, physics.specific_force))

    def _physics(self, rig: Rig) -> Signals:
        """Simulate without what the sensors add, which many effects act on alone."""
        own = tuple(one for one in rig.effects if EFFECTS[one[0]].where == 'rig')
        key = (rig.robot, rig.servo, rig.tool, rig.optidrive, rig.wall, rig.gravity,
               rig.accelerometer.position, rig.accelerometer.model(self.accelerometer).highpass,
               own)
        return self._signals.of(key, lambda: self._simulated(rig))

    def _simulated(self, rig: Rig) -> Signals:
        # a whole number of steps between the samples replayed, too
        replayed = Fraction(RATE * rig.robot.period).limit_denominator(1000).numerator
        common = lcm(common_samples(rig), replayed)
        # fewer integration steps than a simulator takes; right to 1e-4 N on the nominal rig
        steps = common * -(-enough_steps(rig) // (2 * common))
        plant = Plant(rig, self.accelerometer, steps)
        plant.rest(self._positions[0], self._xyzw[0])
        every = round(steps / (RATE * rig.robot.period))
        motion, m = self._moved(plant, (same_motion(rig), steps), 2 * every)
        slide, response = plant.respond(motion)
        ends = slice(every - 1, None, every)
        n = len(m.position)
        specific_force = response.specific_force[ends][:n]
        return Signals(self.start, response.wrench[ends][:n], specific_force,
                       slide.slide[every::every][:n], m.position, m.R_base_sensor, m.velocity,
                       m.acceleration, m.omega, m.alpha, slide.speed[every::every][:n],
                       response.contact[ends][:n], specific_force)

    def _moved(self, plant: Plant, key: object, nodes: int) -> tuple[Motion, Motion]:
        """Move the robot, unless it has moved just so before: at all nodes, and at samples."""
        def move() -> tuple[Motion, Motion]:
            motion = plant.move(self._positions, self._xyzw)
            n = self.n_blocks * round(BLOCK * RATE)
            return motion, Motion(*(part[nodes::nodes][:n] for part in motion))

        return self._motion.of(key, move)
