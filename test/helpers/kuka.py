"""The recordings of a real arm (KUKA LBR Med) as the package takes them."""

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
import numpy as np
from scipy.signal import butter, sosfiltfilt

GRAVITY = 9.8209


def table(path):
    return np.genfromtxt(path, delimiter=',', skip_header=1)


def poses(t, rows):
    return PoseStream(t, np.full((len(t), 3), np.nan), rows.reshape(-1, 3, 3))


def kuka_recording(folder, name):
    """Stamps in seconds since the first wrench; those that do not increase are left out."""
    parts = [table(folder / f'{name}_{kind}.csv') for kind in ('wrench', 'accel', 'orientations')]
    start = parts[0][0, 0]
    parts = [p[np.r_[True, np.diff(p[:, 0]) > 0]] for p in parts]
    t, (wrench, accel, rotation) = ([(p[:, 0] - start) * 1e-6 for p in parts],
                                    [p[:, 1:] for p in parts])
    return Recording(
        wrench=Stream(t[0], wrench), accelerometer=Stream(t[1], accel * GRAVITY),
        accelerometer_unit='m/s^2', pose=poses(t[2], rotation))


def static_recording(folder):
    """Return the 24 static poses, one sample each."""
    rows = table(folder / '0-calibration_fts-accel.csv')
    t = np.arange(len(rows), dtype=float)
    return Recording(
        wrench=Stream(t, rows[:, :6]), accelerometer=Stream(t, rows[:, 6:9] * GRAVITY),
        accelerometer_unit='m/s^2', pose=poses(t, rows[:, 12:]),
        phases=tuple(Phase('measure', x - 0.1, x + 0.1) for x in t))


def static_calibration(folder):
    """Calibrate from these."""
    return identify(static_recording(folder), IdentificationSettings(gravity=GRAVITY))


def slow(estimate):
    """Below 10 Hz: Butterworth, second order, zero phase."""
    rate = 1 / np.median(np.diff(estimate.t))
    return sosfiltfilt(butter(2, 10.0, fs=rate, output='sos'), estimate.contact[:, :3], axis=0)
