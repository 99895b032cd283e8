"""Say how often the offset of acc1 is within 0.5 mV, by the default and by designed sequences.

    python benchmark/optimal_design.py [--runs 200]

Every row is a sequence on the nominal rig, simulated with so many seeds of noise and identified:
runs in which all three axes of the offset are within 0.5 mV, RMS errors of the offset, what the
Fisher information predicts for it, and standard errors as identified of what else there is. The
tool settles for 0.5 s after each move, as it does on average in `forcecal demo`.
"""

import argparse
from dataclasses import replace
import os

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_name, '1')

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.core.geometry import Array
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.optimal_design import design_calibration, Planner, Robot
from forcecal_ros.motion.plan import calibration_plan, prepare, preview, Timing
from forcecal_ros.motion.profiles import nominal_poses, orientation, Pace, Pose, step_goal
from forcecal_ros.sim.rig.file import expected_sensors, load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

SETTLE = 0.5
WITHIN = 0.5e-3
"""The target [V]."""

Sequence = tuple[dict[str, Pose], Timing]


def sequences() -> dict[str, Sequence]:
    """Return the sequences by what they are."""
    poses = nominal_poses()
    home = poses['v']
    tilt = Pose(home.position, orientation(np.radians(-60.0), np.radians(105.0)))
    found = {'three poses of 1 s': ({'v': home, 'h': poses['h'], 'tilt': tilt},
                                    Timing(measure=1.0)),
             'default': (poses, Timing())}
    design = design_calibration(Robot(home), expected_sensors(load_rig()), 16.0)
    found['designed'] = design.poses, design.timing
    return found


def promised(poses: dict[str, Pose], timing: Timing) -> Array:
    """Return the predicted standard errors of the offset, shape (3,) [V]."""
    planner = Planner(Robot(next(iter(poses.values()))), expected_sensors(load_rig()),
                      list(poses.values()), timing, np.inf)
    return planner.errors(range(len(poses)), timing.measure).std('offset')


def tried(poses: dict[str, Pose], timing: Timing, runs: int) -> tuple[float, Array, Array]:
    """Return duration [s], errors of the offset (runs, 3) [V], and other standard errors."""
    rig, home = load_rig(), next(iter(poses.values()))
    plan = calibration_plan(poses, step_goal(home, timing.step_distance), timing)
    target, phases = preview(prepare(plan, home, Pace(), Limits()), 250.0, SETTLE)
    errors, others = [], []
    for seed in range(runs):
        found = identify(replace(simulate(rig, target, accelerometer='acc1', seed=seed),
                                 phases=phases))
        assert found.accelerometer is not None and found.inertia is not None
        errors.append(found.accelerometer.offset.value - rig.accelerometer.acc1.offset)
        others.append([found.mass.std, found.com.std.max(), found.wrench_bias.std[:3].max(),
                       found.wrench_bias.std[3:].max(), np.diag(found.inertia.std).max(),
                       found.accelerometer.gain.std.max()])
    return float(target.t[-1]), np.array(errors), np.median(others, axis=0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='hits of the offset of acc1 within 0.5 mV')
    parser.add_argument('--runs', type=int, default=200)
    runs = parser.parse_args().runs
    print('| sequence | takes | within 0.5 mV | RMS error x, y, z | predicted | mass | centre of '
          'mass | force bias | torque bias | inertia | gain |\n' + '|---' * 11 + '|')
    for name, (poses, timing) in sequences().items():
        duration, errors, others = tried(poses, timing, runs)
        hits = int((np.abs(errors).max(axis=1) < WITHIN).sum())
        rms, predicted = (' '.join(f'{1e3 * x:.2f}' for x in row) for row in (
            np.sqrt((errors**2).mean(axis=0)), promised(poses, timing)))
        print(f'| {name} | {duration:.1f} s | {hits} of {runs} | {rms} mV | {predicted} mV | '
              + ' | '.join(f'{scale * x:.3g} {unit}' for x, (scale, unit) in zip(others, (
                  (1e3, 'g'), (1e6, 'um'), (1e3, 'mN'), (1e3, 'mN m'), (1e3, 'g m^2'),
                  (1e6, 'uV/(m/s^2)')))) + ' |', flush=True)


if __name__ == '__main__':
    main()
