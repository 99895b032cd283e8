"""Filter kalman against the best one: error, innovations, and what it promises; prints tables.

    python benchmark/observer_gain.py [--seeds 20]

The contact wrench wanders at random on a tool that swings, as the model of the filter has it, so
that there is a best filter: the joint one of place, offset and force, which knows all densities.
Noise of sensors and poses is a tenth, once and ten times the nominal rig's.
"""

from argparse import ArgumentParser
from dataclasses import replace
from pathlib import Path
import sys

from forcecal_ros.observe import design, ObserverSettings, replay
from forcecal_ros.observe.bandwidth import noise_levels
from forcecal_ros.observe.design import accuracy, noise_of_force
from forcecal_ros.observe.settings import CONTACT_WALK, POSE_RATE_HZ
import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.signal import welch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from observing import calibration, push, record
from wandering import ACCELEROMETERS, known, SWING, wandering


def joint_std(levels, mass, settings, dt):
    """
    Return the error of the force [N] by one Kalman filter of place, offset and force together.

    x = [p, v, o, F], the accelerometer as input: dv/dt = f - o + g. Measured are p and
    u - m a = F + m o, whose noise (m times the accelerometer's) is also the noise that drives v.
    """
    A = np.eye(4)
    A[0, 1], A[0, 2], A[1, 2] = dt, -dt * dt / 2, -dt
    f = levels.specific_force / dt
    drive = np.array([dt * dt / 2, dt, 0.0, 0.0])
    Q = f * np.outer(drive, drive)
    walk = CONTACT_WALK if settings.contact_walk is None else settings.contact_walk
    Q[2, 2] += 5e-4 ** 2 * dt
    Q[3, 3] += walk ** 2 * dt
    C = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, mass, 1.0]])
    p_variance = settings.pose_position_std ** 2 / POSE_RATE_HZ / dt
    R = np.diag([p_variance, levels.force / dt + mass ** 2 * f])
    P = solve_discrete_are(A.T, C.T, Q, R, s=np.stack([np.zeros(4), mass * f * drive], axis=1))
    updated = P - P @ C.T @ np.linalg.solve(C @ P @ C.T + R, C @ P)
    return np.sqrt(updated[3, 3])


def compared(noise: float, name: str, settings: ObserverSettings, seeds: int) -> tuple:
    """Return bandwidth, error, promise and best [N], ratio, and NIS over its expectation."""
    calibration = known(noise, name)
    settings = replace(settings, pose_position_std=noise * settings.pose_position_std,
                       pose_rotation_std=noise * settings.pose_rotation_std)
    model = design(calibration, settings)
    promised = accuracy(calibration, model, settings)
    best = joint_std(noise_levels(calibration.noise), 13.0,
                     replace(settings, pose_position_std=noise * 2e-5), 1e-3)
    errors, nis = [], []
    inverse = np.linalg.inv(promised.innovation)
    for seed in range(seeds):
        recording, truth = wandering(noise, name, promised, seed)
        estimate = replay(recording, calibration, settings)
        late = estimate.t > 4.0
        errors.append((estimate.contact - truth)[late])
        e = estimate.innovation[late]
        nis.append(np.einsum('ni,ij,nj->n', e, inverse, e).mean() / 6)
    error = np.sqrt(np.mean(np.square(errors), axis=(0, 1)))
    return (promised.bandwidth, error, promised.std, best, error[:3].max() / best,
            np.mean(nis), np.std(nis))


def over_settings() -> None:
    """Print what other contact walks make of the nominal rig with acc1."""
    one = calibration()
    on, off = (record(3.0, SWING, contact, seed=3) for contact in (push(0, 20.0, 1.0), None))
    still = record(20.0, seed=4)
    print('| contact walk | bandwidth | 10-90 % rise | in 50-200 Hz | noise of a steady force: '
          'measured, promised |')
    print('|---|---|---|---|---|')
    for walk in (0.5, 1.0, 2.5, 5.0, 10.0):
        settings = ObserverSettings(contact_walk=walk)
        bandwidth = design(one, settings).rate / 2 / np.pi
        y = np.subtract(*(replay(r, one, settings).contact[:, 0] for r in (on, off)))
        start = int(np.argmax(y > 0)) - 1
        rise = np.subtract(*(np.interp(x, y[start:], on.wrench.t[start:]) for x in (18.0, 2.0)))
        estimate = replay(still, one, settings)
        f, p = welch(estimate.contact[:, 0], 1000.0, nperseg=2048)
        _, q = welch(estimate.measured[:, 0], 1000.0, nperseg=2048)
        band = (f >= 50) & (f <= 200)
        print(f'| {walk:g} N/sqrt(s) | {bandwidth:.1f} Hz | {1e3 * rise:.1f} ms '
              f'| {10 * np.log10(p[band].mean() / q[band].mean()):.1f} dB '
              f'| {estimate.contact[1000:, 0].std():.3f}, '
              f'{noise_of_force(one, np.array([bandwidth]))[0, 0]:.3f} N |', flush=True)


def main() -> None:
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=20)
    seeds = parser.parse_args().seeds
    over_settings()
    print()
    print('| noise | accelerometer | bandwidth | error x, y, z | promised | best | over best '
          '| NIS / 6 |')
    print('|---|---|---|---|---|---|---|---|')
    for noise in (0.1, 1.0, 10.0):
        for name in ACCELEROMETERS:
            found = compared(noise, name, ObserverSettings(), seeds)
            bandwidth, error, promised, best, ratio, nis, spread = found
            print(f'| {noise:g} | {name} | {bandwidth:.1f} Hz | {show(error[:3])} N '
                  f'| {show(promised[:3])} N | {best:.3f} N | {ratio:.3f} '
                  f'| {nis:.3f} +- {spread:.3f} |', flush=True)
    print(f'\ncontact walk {CONTACT_WALK:g} N/sqrt(s), {seeds} recordings of 10 s a row; NIS with '
          'its spread from one to the next')


def show(values: np.ndarray) -> str:
    return ', '.join(f'{x:.3f}' for x in values)


if __name__ == '__main__':
    main()
