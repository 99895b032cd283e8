"""How well robot and tool are identified on the nominal rig, and what the design makes of it.

    python benchmark/robot_identification.py [--write FILE]

Thirty seconds of random moves of up to 20 mm with a binary code of 0.5 mm on top, simulated with
noise, ten times. The true frequency response, up to 40 Hz, is measured on the noise-free rig.
"""

import argparse

from forcecal_ros.cli.sample import simulate_along_x
from forcecal_ros.core.geometry import Array
from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.law import design
from forcecal_ros.impedance.plant import Robot
from forcecal_ros.impedance.plant_fit import excitation_commands, identify_plant, save_plant
from forcecal_ros.sim.rig.file import load_rig
import numpy as np

SECONDS = 30.0
RUNS = 10
FREQUENCIES = np.linspace(0.5, 40.0, 80)


def true_response(rig: Rig, frequency: Array) -> Array:
    """Return the frequency response, from what one command of 1 mm does."""
    pulse = np.zeros(round(4.0 / rig.robot.period))
    pulse[1] = 1e-3
    pose = simulate_along_x(rig, pulse, noise=False).pose
    assert pose is not None
    moved = (pose.position - rig.home.position) @ rig.home.R_base_sensor[:, 0] / 1e-3
    # poses come at the end of their period
    delay = pose.t - rig.robot.period
    return np.asarray(np.exp(-2j * np.pi * np.outer(frequency, delay)) @ moved)


def response_of(robot: Robot, frequency: Array) -> Array:
    """Return the frequency response of an identified robot."""
    q = np.exp(-2j * np.pi * frequency * robot.period)
    above = np.polynomial.polynomial.polyval(q, robot.feedforward.value) * q**robot.delay
    return np.asarray(above / (1.0 - q * np.polynomial.polynomial.polyval(
        q, robot.feedback.value)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--write', metavar='FILE', help='write the first plant')
    args = parser.parse_args()
    rig = load_rig()
    assert rig.optidrive is not None
    truth = true_response(rig, FREQUENCIES)
    known = (rig.tool.mass, rig.optidrive.stiffness, rig.optidrive.damping)
    print('run  order  fit [%]  response error [%]  mass, stiffness, damping [standard errors]')
    for run in range(RUNS):
        commands = excitation_commands(SECONDS, rig.robot.period, seed=run)
        fit = identify_plant(simulate_along_x(rig, commands, seed=100 + run))
        robot, slide = fit.plant.robot, fit.plant.slide
        error = np.abs(response_of(robot, FREQUENCIES) / truth - 1.0).max()
        off = [(float(one) - value) / float(one.std)
               for one, value in zip((slide.mass, slide.stiffness, slide.damping), known)]
        print(f'{run:3}  {len(robot.feedback.value):5}  {100 * fit.quality["fit"]:7.3f}  '
              f'{100 * error:18.2f}  ' + '  '.join(f'{one:+.2f}' for one in off))
        if run == 0:
            first = fit
    if args.write:
        save_plant(first, args.write)
    made = design(first.plant)
    print(f'\nlaw: c {made.law.force_gain:.3g} m/N, l_r {made.law.position_gain:.4f}, unstable '
          f'from {made.unstable_from:g} N/m')


if __name__ == '__main__':
    main()
