"""Response and noise of the contact-force observer; prints the table of the README.

    python benchmark/observer_response.py

Motion and noise are the simulated rig's. The recording of a real arm is read from
``$FORCECAL_DATA`` or ``../shared/data``, and left out where it is absent.
"""

from dataclasses import replace
import os
from pathlib import Path
import sys

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.observe import design, ObserverSettings, replay
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import Simulator
import numpy as np
from scipy.signal import butter, sosfiltfilt, welch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from observing import calibration, push, record, Swing

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2, axis=(0.3, 1.0, 0.2), slide=0.003)


def row(name: str, value: str, wanted: str) -> None:
    print(f'| {name} | {value} | {wanted} |')


def rig_calibration(accelerometer: str, delay: float) -> Calibration:
    model = getattr(load_rig().accelerometer, accelerometer)
    known = calibration(delay, wash=model.highpass)
    sensor = known.accelerometer
    return replace(known, accelerometer=replace(
        sensor, gain=type(sensor.gain)(model.gain, 0.0, sensor.gain.unit),
        offset=type(sensor.offset)(model.offset, 0.0, 'V')))


def oscillation(accelerometer: str, delay: float) -> Recording:
    """Swing the simulated rig freely along x, 2 Hz, about 27 N RMS."""
    rig = load_rig()
    t = np.arange(0, 12.0, rig.robot.period)
    positions = np.tile(rig.home.position, (len(t), 1))
    positions[:, 0] += 0.012 * np.clip(t - 1, 0, 1) * np.sin(4 * np.pi * (t - 1))
    s = Simulator(rig, accelerometer, seed=2).run(
        positions, np.tile(rig.home.orientation_xyzw, (len(t), 1)))
    return Recording(
        wrench=Stream(s.wrench_t, s.wrench),
        accelerometer=Stream(s.accelerometer_t + delay, s.volts),
        optidrive=Stream(s.optidrive_t, s.optidrive[:, None]),
        pose=PoseStream(s.pose_t, s.position, s.R_base_sensor))


def response() -> None:
    on, off = (replay(record(3.0, SWING, contact, seed=3), calibration())
               for contact in (push(0, 20.0, 1.0), None))
    y = (on.contact - off.contact)[:, 0]
    start = int(np.argmax(y > 0)) - 1
    rise = np.subtract(*(np.interp(x, y[start:start + 300], on.t[start:start + 300])
                         for x in (18.0, 2.0)))
    row('bandwidth chosen', f'{design(calibration()).rate / 2 / np.pi:.1f} Hz', '')
    row('20 N step: 10-90 % rise', f'{1e3 * rise:.1f} ms', '15 ms')
    row('20 N step: overshoot', f'{100 * (y.max() / 20 - 1):.2f} %', '5 %')
    estimate = replay(record(4.2, contact=push(0, 20.0, 2.1), seed=8), calibration())
    mean = estimate.contact[2200:, 0].mean() - estimate.contact[100:2100, 0].mean()
    row('static gain, mean of 2 s', f'{mean / 20:.4f}', '1 +- 0.002')


def noise() -> None:
    recording = record(20.0, seed=4)
    for mode in ('kalman', 'newton'):
        estimate = replay(recording, calibration(), ObserverSettings(mode))
        f, p = welch(estimate.contact[:, :3], 1000.0, nperseg=2048, axis=0)
        _, q = welch(estimate.measured[:, :3], 1000.0, nperseg=2048, axis=0)
        band = (f >= 50) & (f <= 200)
        decibels = 10 * np.log10(p[band].mean(axis=0) / q[band].mean(axis=0))
        row(f'noise of x, y, z in 50-200 Hz against u - m a, filter {mode}',
            ', '.join(f'{x:.1f}' for x in decibels) + ' dB',
            '-10 dB' if mode == 'kalman' else '')


def free_oscillation() -> None:
    for accelerometer in ('acc1', 'acc2'):
        for delay in (0.0, 0.006, 0.010, -0.006, -0.010):
            recording = oscillation(accelerometer, delay)
            estimate = replay(recording, rig_calibration(accelerometer, delay))
            used = (estimate.t > 3.0) & (estimate.t < 11.9)
            sensor = recording.wrench.at(estimate.t[used])[:, 0] - 4.0
            decibels = 20 * np.log10(
                estimate.contact[used, 0].std() / np.sqrt(np.mean(sensor ** 2)))
            row(f'free oscillation, {accelerometer}, sensors {1e3 * delay:g} ms apart',
                f'{decibels:.1f} dB', '-33 dB')


def real_arm() -> None:
    folder = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data'))
    if not (folder / 'kuka_lbr_med').is_dir():
        row('real arm', 'recording absent', '')
        return
    from forcecal_ros.calibrate.delay import estimate_delay, with_delay
    from kuka import kuka_recording, static_calibration
    folder /= 'kuka_lbr_med'
    static = static_calibration(folder)
    free = kuka_recording(folder, '1-baseline')
    delay = estimate_delay(free, static)
    row('real arm: accelerometer later than wrench',
        f'{1e3 * float(delay):.2f} +- {1e3 * float(delay.std):.2f} ms', '')
    known = with_delay(static, delay)
    still = replay(Recording(wrench=free.wrench, pose=free.pose), known)
    estimate = replay(free, known)
    for name, values, slow, whole in (
            ('gravity alone', still, '', ''),
            ('observer', estimate, '0.13, 0.045, 0.07 N', '0.40, 0.17, 0.18 N')):
        sos = butter(2, 10.0, fs=1 / np.median(np.diff(values.t)), output='sos')
        force = values.contact[100:, :3]
        row(f'real arm, free, {name}: std below 10 Hz',
            show(sosfiltfilt(sos, force, axis=0).std(axis=0)), slow)
        row(f'real arm, free, {name}: std', show(force.std(axis=0)), whole)
    row('real arm, free: mean', show(estimate.contact[:, :3].mean(axis=0)), 'z about 0.2 N')
    touched = replay(kuka_recording(folder, '3-vibrations-contact'), known)
    above = touched.t[np.linalg.norm(touched.contact[:, :3], axis=1) > 3.0]
    row('real arm: contact begins, ends at 3 N', f'{above[0]:.2f} s, {above[-1]:.2f} s',
        '0.60-0.85 s, 4.10-4.25 s')
    row('real arm: largest force when free',
        f'{np.linalg.norm(estimate.contact[:, :3], axis=1).max():.2f} N', '3 N')


def show(values: np.ndarray) -> str:
    return ', '.join(f'{x:.3f}' for x in values) + ' N'


def main() -> None:
    row('figure', 'measured', 'wanted')
    row('---', '---', '---')
    response()
    noise()
    free_oscillation()
    real_arm()


if __name__ == '__main__':
    main()
