"""How well robot and tool are identified on the nominal rig, and what the design makes of it.

    python benchmark/robot_identification.py [--write FILE]

Thirty seconds of random moves of up to 20 mm with a binary code of 0.5 mm on top, simulated with
noise, ten times. The true frequency response is measured on the noise-free rig, sine by sine.
"""

import argparse

from forcecal_ros.geometry import Array
from forcecal_ros.impedance.design import design
from forcecal_ros.plant.excitation import excitation
from forcecal_ros.plant.identify import identify_plant
from forcecal_ros.plant.plant_file import save_plant
from forcecal_ros.samples import PoseStream, Recording
from forcecal_ros.sim.offline import simulate
from forcecal_ros.sim.rig import Rig
from forcecal_ros.sim.rig_file import load_rig
import numpy as np

SECONDS = 30.0
RUNS = 10
FREQUENCIES = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0, 35.0, 40.0])


def record(rig: Rig, along_x: Array, *, noise: bool = True, seed: int = 0) -> Recording:
    """Return what the rig makes of commands along x of ft_sensor."""
    R, period = rig.home.R_base_sensor, rig.robot.period
    position = np.array(rig.home.position) + along_x[:, np.newaxis] * R[:, 0]
    t = np.arange(len(along_x), dtype=float) * period
    target = PoseStream(t, position, np.broadcast_to(R, (len(t), 3, 3)))
    return simulate(rig, target, noise=noise, seed=seed)


def true_response(rig: Rig, frequency: float) -> complex:
    """Return the response to one sine, of whole cycles once it has settled."""
    period = rig.robot.period
    cycle = 1.0 / frequency
    n = round(np.ceil(1.0 / cycle) * cycle / period)
    phase = 2.0 * np.pi * frequency * period * np.arange(round(2.0 / period) + n)
    recording = record(rig, 1e-3 * np.sin(phase), noise=False)
    assert recording.pose is not None
    moved = (recording.pose.position - rig.home.position) @ rig.home.R_base_sensor[:, 0]
    t = recording.pose.t[-n:]
    basis = np.column_stack([np.sin(2 * np.pi * frequency * t), np.cos(2 * np.pi * frequency * t)])
    a, b = np.linalg.lstsq(basis, moved[-n:], rcond=None)[0]
    return complex(a, b) / 1e-3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--write', metavar='FILE', help='write the first plant')
    args = parser.parse_args()
    rig = load_rig()
    assert rig.optidrive is not None
    truth = np.array([true_response(rig, f) for f in FREQUENCIES])
    known = (rig.tool.mass, rig.optidrive.stiffness, rig.optidrive.damping)
    print('run  order  fit [%]  response error [%]  mass, stiffness, damping [standard errors]')
    for run in range(RUNS):
        fit = identify_plant(record(rig, excitation(SECONDS, rig.robot.period, seed=run),
                                    seed=100 + run))
        robot, slide = fit.robot.robot, fit.slide.slide
        error = np.abs(robot.response(FREQUENCIES) / truth - 1.0).max()
        off = [(float(one) - value) / float(one.std)
               for one, value in zip((slide.mass, slide.stiffness, slide.damping), known)]
        print(f'{run:3}  {len(robot.feedback.value):5}  {100 * fit.robot.fit:7.3f}  '
              f'{100 * error:18.2f}  ' + '  '.join(f'{one:+.2f}' for one in off))
        if run == 0:
            first = fit
    if args.write:
        save_plant(first, args.write)
    made = design(first.plant)
    print(f'\nlaw: c {made.law.force_gain:.3g} m/N, l_r {made.law.position_gain:.4f}, unstable '
          f'from {made.unstable_from:g} N/m, compliance off by {100 * made.disagreement:.2f} % '
          'up to 1 Hz')
    for one in made.margins:
        print(f'wall {one.wall_stiffness:7g} N/m: gain margin {one.gain:.2f}, phase margin '
              f'{np.rad2deg(one.phase):.0f} deg, distance from -1 {one.modulus:.2f}')


if __name__ == '__main__':
    main()
