"""The tool under test as the second edition calls it: arrays of a case in, its answer out."""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from contextlib import redirect_stdout
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256
import io
from pathlib import Path
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'benchmark')]

from blind.second.arm import JOINTS, PERIOD
from blind.sensors import Recorded
from blind_tool import to_recording
from forcecal_ros.cli.main import main as forcecal
from forcecal_ros.core.streams import JointStream, PoseStream, Recording, Stream
from forcecal_ros.diagnose.dataset import units
from forcecal_ros.diagnose.result import to_document
from forcecal_ros.diagnose.sources.rig import RigSource, ToolSource
from forcecal_ros.diagnose.sources.simulator import SimulatorSource
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.calibration_file import load
from forcecal_ros.sim.mujoco import load_mujoco
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rigid_tool import rigid_tool_of_calibration
from forcecal_ros.sim.third_party import third_party
import numpy as np

DATA = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data')) / 'kuka_lbr_med'

PLACES = 3
"""Places of the gap that an answer keeps."""


def recorded(arrays, which):
    """Return one recording of the rig."""
    phases = tuple((name, float(start), float(end)) for name, start, end in (
        str(one).split() for one in arrays[f'{which}.phases']))
    return Recorded(**{name: arrays[f'{which}.{name}'] for name in Recorded._fields
                       if name != 'phases'}, phases=phases)


def on_rig(arrays):
    real, heldout = (to_recording(recorded(arrays, which), 'blind') for which in range(2))
    return to_document(RigSource(load_rig(None)).diagnose(real, heldout).diagnosis, units(), None)


def on_arm(arrays):
    t = arrays['t']
    told = PERIOD * np.arange(len(arrays['told']))
    real = Recording(
        wrench=Stream(t, arrays['wrench'], 'ft_sensor'),
        pose=PoseStream(t, arrays['position'], arrays['R']),
        joints=JointStream(t, arrays['joints'], '', JOINTS),
        joint_commands=JointStream(told, arrays['told'], '', JOINTS))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.xml'
        path.write_text(str(arrays['model']))
        simulator = third_party(str(path), load_mujoco(str(path)))
        found = SimulatorSource(simulator, load_rig('rigid_tool.yaml')).diagnose(real)
    return found.document()


@lru_cache(maxsize=1)
def real_arm():
    """Return the free motion of the real arm, and its calibration from static poses."""
    with tempfile.TemporaryDirectory() as name, redirect_stdout(io.StringIO()):
        folder = Path(name)
        for table in ('poses', 'baseline'):
            forcecal(['import', str(ROOT / f'config/examples/kuka_{table}.yaml'), '--tables',
                      str(DATA), '-o', str(folder / table)])
        forcecal(['calibrate', str(folder / 'poses'), '--gravity', '9.8209', '-o',
                  str(folder / 'known.yaml')])
        return read_recording(folder / 'baseline'), load(folder / 'known.yaml')


def on_real(arrays):
    recording, calibration = real_arm()
    wrench = recording.wrench
    changed = replace(recording, wrench=replace(wrench, values=wrench.values + arrays['change']))
    body = rigid_tool_of_calibration(calibration, load_rig('rigid_tool.yaml'))
    outcome = ToolSource(body, calibration).diagnose(changed).outcome
    return to_document(outcome.diagnosis, units(body.accelerometer_unit), None)


ASK = {'rig': on_rig, 'arm': on_arm, 'real': on_real, 'drake': on_arm}


def answer(generator, arrays):
    """Return the answer on a case, without its text but for the reason, and the time it took."""
    began, cpu = time.monotonic(), time.process_time()
    try:
        document = _short(ASK[generator](arrays))
    except Exception as error:
        document = {'verdict': 'crashed', 'reason': f'{type(error).__name__}: {error}'}
    return {'document': document, 'seconds': round(time.monotonic() - began, 2),
            'cpu_seconds': round(time.process_time() - cpu, 2)}


def _short(document):
    kept = {key: document[key] for key in ('verdict', 'reason', 'effects', 'candidates')}
    gap = document.get('gap')
    if gap:
        kept['gap'] = {key: gap[key] for key in ('nominal', 'recalibrated', 'explained', 'closed',
                                                 'closed_ci95')}
        kept['gap']['noise'] = {name: float(f'{one["noise_rms"]:.4g}')
                                for name, one in gap['per_channel'].items()}
    return {**kept, 'where': [[one['stage'], one['channel'], one['phase']]
                              for one in document['where'][:PLACES]]}


def identity_of_tool():
    """Return the tool's commit, whether its files differ from it, and a hash of all of them."""
    def git(*words):
        return subprocess.run(['git', *words], cwd=ROOT, capture_output=True, text=True,
                              check=True).stdout.strip()

    texts = b''.join(str(path.relative_to(ROOT)).encode() + path.read_bytes()
                     for path in sorted((ROOT / 'forcecal_ros').rglob('*'))
                     if path.suffix in ('.py', '.yaml'))
    return {'commit': git('rev-parse', 'HEAD'), 'files': sha256(texts).hexdigest(),
            'changed': git('status', '--porcelain', '--', 'forcecal_ros', 'config')}
