"""Effects laid on a real recording: which are found, and what it says untouched.

    python benchmark/blind_real.py

Takes the KUKA recordings of FORCECAL_DATA (or ../shared/data): calibrates on the static poses,
lays one effect at a time on the measured wrench of the free trajectory, and diagnoses that from
the measured motion. The arm has departures of its own, which the untouched recording shows.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from contextlib import redirect_stdout
from dataclasses import replace
import io
from pathlib import Path
import sys
import tempfile

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from forcecal_ros.calibration.file import load
from forcecal_ros.cli import main as forcecal
from forcecal_ros.diagnose.by_motion import diagnose_motion
from forcecal_ros.recording.bags import read_recording
from forcecal_ros.recording.streams import Stream
from forcecal_ros.simulators.rig.file import load_rig
from forcecal_ros.simulators.rigid_tool import rigid_tool_of_calibration
import numpy as np

DATA = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data')) / 'kuka_lbr_med'
GRAVITY = '9.8209'


def delayed(t, w, bias, size):
    return np.stack([np.interp(t - size, t, column) for column in w.T], axis=1)


def lowpass(t, w, bias, size):
    """Second order, damping 0.8; ``size`` is its delay at low frequency."""
    natural, x, v, out = 1.6 / size, w[0].copy(), np.zeros(6), np.empty_like(w)
    for n, step in enumerate(np.diff(t, prepend=t[0])):
        for _ in range(8):
            v = v + step / 8 * (natural**2 * (w[n] - x) - 1.6 * natural * v)
            x = x + step / 8 * v
        out[n] = x
    return out


def gain(t, w, bias, size):
    """Along x, where gravity turns through most of its range."""
    return bias + (w - bias) * (1 + size * np.eye(6)[0])


def crosstalk(t, w, bias, size):
    return w + size * np.outer((w - bias)[:, 0], np.eye(6)[1])


def drift(t, w, bias, size):
    rise = (1 - np.exp(-(t - t[0]) / 4.0)) / (1 - np.exp(-(t[-1] - t[0]) / 4.0))
    return w + size * np.outer(rise, np.eye(6)[0])


INJECTED = (
    ('wrench_delay', delayed, (0.001, 0.003, 0.01, 0.03), 's'),
    ('wrench_lowpass', lowpass, (0.001, 0.003, 0.01, 0.03), 's'),
    ('wrench_gain', gain, (0.01, 0.05, 0.15, 0.4), '1'),
    ('wrench_crosstalk', crosstalk, (0.01, 0.05, 0.15, 0.4), '1'),
    ('wrench_bias_drift', drift, (0.1, 0.5, 1.5, 5.0), 'N'))


def prepared(folder):
    with redirect_stdout(io.StringIO()):
        for name in ('poses', 'baseline'):
            forcecal(['import', str(ROOT / f'config/examples/kuka_{name}.yaml'), '--tables',
                      str(DATA), '-o', str(folder / name)])
        forcecal(['calibrate', str(folder / 'poses'), '--gravity', GRAVITY, '-o',
                  str(folder / 'known.yaml')])
    return read_recording(folder / 'baseline'), load(folder / 'known.yaml')


def named(recording, calibration):
    """Diagnose; the delay between both sensors, which no calibration from poses knows, along."""
    body = rigid_tool_of_calibration(calibration, load_rig('rigid_tool.yaml'))
    outcome = diagnose_motion(recording, None, body, calibration)
    effects = {one.name: {name: p.value for name, p in one.parameters.items()}
               for one in outcome.diagnosis.effects}
    return outcome.diagnosis, effects, outcome.recalibrations['accelerometer.delay'][0]


def lag(effects, behind):
    """Return how far the wrench lags: both delays are one number, the arm has its own."""
    return effects.get('wrench_delay', {}).get('delay', 0.0) - behind


def main():
    if not DATA.is_dir():
        sys.exit(f'blind_real: {DATA} is not there; set FORCECAL_DATA')
    with tempfile.TemporaryDirectory() as folder:
        recording, calibration = prepared(Path(folder))
    bias = calibration.wrench_bias.value
    diagnosis, untouched, behind = named(recording, calibration)
    print('| injected | size | verdict | closed | found | of that effect | wrench behind '
          'accelerometer | besides |')
    print('|---|---|---|---|---|---|---|---|')
    print(f'| nothing | | {diagnosis.verdict} | {100 * diagnosis.gap.closed:.0f} % | | | '
          f'{1000 * lag(untouched, behind):.1f} ms | '
          f'{", ".join(untouched)} |', flush=True)
    for name, function, sizes, unit in INJECTED:
        for size in sizes:
            wrench = recording.wrench
            values = function(wrench.t, wrench.values, bias, size)
            changed = replace(recording, wrench=Stream(wrench.t, values, wrench.frame))
            diagnosis, effects, behind = named(changed, calibration)
            numbers = ', '.join(f'{key} {value:.3g}' for key, value in
                                effects.get(name, {}).items() if abs(value) > 1e-9)
            print(f'| {name} | {size} {unit} | {diagnosis.verdict} | '
                  f'{100 * diagnosis.gap.closed:.0f} % | {"yes" if name in effects else "no"} | '
                  f'{numbers} | {1000 * lag(effects, behind):.1f} ms | '
                  f'{", ".join(one for one in effects if one != name)} |', flush=True)


if __name__ == '__main__':
    main()
