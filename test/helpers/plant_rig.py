"""The nominal rig shaken along x of ft_sensor, and what it truly answers."""

from forcecal_ros.cli.sample import simulate_along_x
from forcecal_ros.impedance.plant_fit import excitation_commands
from forcecal_ros.sim.rig.file import load_rig
import numpy as np

RIG = load_rig()


def record(along_x, **options):
    return simulate_along_x(RIG, along_x, **options)


def shaken(seconds, seed):
    return record(excitation_commands(seconds, RIG.robot.period, seed=seed), seed=seed + 100)


def response(robot, frequency):
    """Return the complex response of a difference equation at frequencies [Hz]."""
    q = np.exp(-2j * np.pi * frequency * robot.period)
    return (np.polynomial.polynomial.polyval(q, robot.feedforward.value) * q**robot.delay
            / np.polynomial.polynomial.polyval(q, [1.0, *(-robot.feedback.value)]))


def true_response(frequency):
    """From what one command of 1 mm does, without noise; poses come at the end of a period."""
    pulse = np.zeros(1000)
    pulse[1] = 1e-3
    pose = record(pulse, noise=False).pose
    moved = (pose.position - RIG.home.position) @ RIG.home.R_base_sensor[:, 0] / 1e-3
    return np.exp(-2j * np.pi * np.outer(frequency, pose.t - RIG.robot.period)) @ moved
