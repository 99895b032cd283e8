"""Cost of one step of the observer, and of the same over a whole recording.

    python benchmark/step.py

The step is everything that belongs to one wrench at 1 kHz: its accelerometer reading, a quarter
of a pose at 250 Hz, gravity, inertia, lever arm, delay and filter. Against it: deserialising one
WrenchStamped with rclpy, and predict and update of filterpy's KalmanFilter with 12 states and 6
measurements, where filterpy is installed.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
import sys

from forcecal_ros.observe import (
    design,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    State,
)
from forcecal_ros.observe.batch import estimates
from forcecal_ros.observe.playback import events, run
import numpy as np
from timing import best, head, row

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from observing import calibration, record, Swing

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2, axis=(0.3, 1.0, 0.2), slide=0.003)
SECONDS = 4.0
DELAY = 0.004
CALLS = 4000
RECORDINGS = {'accelerometer, pose': 'optidrive', 'accelerometer, pose, displacement': 'target'}


def deserialisation() -> Callable[[], None]:
    from geometry_msgs.msg import WrenchStamped
    from rclpy.serialization import deserialize_message, serialize_message

    message = WrenchStamped()
    message.header.frame_id = 'ft_sensor'
    raw = serialize_message(message)

    def part() -> None:
        for _ in range(CALLS):
            deserialize_message(raw, WrenchStamped)

    return part


def filterpy() -> Callable[[], None]:
    from filterpy.kalman import KalmanFilter

    filter_ = KalmanFilter(dim_x=12, dim_z=6)
    filter_.F = np.eye(12) + 1e-3 * np.eye(12, k=6)
    filter_.H = np.eye(6, 12)
    filter_.Q *= 1e-3
    z = np.zeros(6)

    def part() -> None:
        for _ in range(CALLS):
            filter_.predict()
            filter_.update(z)

    return part


def steps(recording, model) -> Callable[[], None]:
    sequence = list(events(recording))
    calls = {'wrench': on_wrench, 'accelerometer': on_accelerometer}

    def part() -> None:
        state = State()
        for t, kind, values in sequence:
            if kind == 'pose':
                state, _ = on_pose(state, t, values[:3], values[3:], model)
            elif kind == 'displacement':
                state, _ = on_displacement(state, t, values[0], model)
            else:
                state, _ = calls[kind](state, t, values, model)

    return part


def main() -> None:
    model = design(calibration(DELAY))
    parts = {'deserialising one WrenchStamped': deserialisation()}
    if find_spec('filterpy'):
        parts['filterpy, 12 states, 6 measurements'] = filterpy()
    others = ['of deserialising', 'of filterpy'][:len(parts)]
    calls = dict.fromkeys(parts, CALLS)
    differences = {}
    for name, left_out in RECORDINGS.items():
        recording = replace(record(SECONDS, SWING, seed=1, delay=DELAY), **{left_out: None})
        parts[f'step: wrench, {name}'] = steps(recording, model)
        long = replace(record(60.0, SWING, seed=1, delay=DELAY), **{left_out: None})
        parts[f'batch: wrench, {name}'] = partial(estimates, long, model)
        calls[f'step: wrench, {name}'] = len(recording.wrench)
        calls[f'batch: wrench, {name}'] = len(long.wrench)
        expected = [(*s.contact, *s.inertial) for s in run(events(recording), model)[1]]
        found = estimates(recording, model)
        differences[name] = np.abs(np.hstack([found.contact, found.inertial]) - expected).max()
    times = {name: 1e6 * t / calls[name] for name, t in best(parts, rounds=9).items()}
    references = list(times.values())[:len(others)]
    head('a wrench costs', 'us', *others, 'wanted')
    for name, t in times.items():
        wanted = '' if ':' not in name else '1' if name.startswith('step') else '0.1'
        row(name, f'{t:.2f}', *(f'{t / one:.3f}' for one in references), wanted)
    print()
    head('batch against step', 'largest difference', 'wanted')
    for name, difference in differences.items():
        row(name, f'{difference:.1e} N, N m', '1e-9')


if __name__ == '__main__':
    main()
