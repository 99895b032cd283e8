"""The tool under test as the blind check calls it: a pair of recordings in, its answer out."""

from hashlib import sha256
import json
from pathlib import Path
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from blind.casefile import load_case
from blind.seal import write_json
from blind.sensors import Recorded
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.result import to_document
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.io.bags import write_recording
from forcecal_ros.sim.rig.file import load_rig
import numpy as np

START_NS = 1_760_000_000_000_000_000


def to_recording(recorded: Recorded, source: str = '') -> Recording:
    """Return what reading a bag with the same content would."""
    return Recording(
        wrench=Stream(recorded.wrench_t, recorded.wrench, 'ft_sensor'),
        accelerometer=Stream(recorded.volts_t, recorded.volts, 'accelerometer'),
        pose=PoseStream(recorded.pose_t, recorded.position, recorded.R),
        target=PoseStream(recorded.target_t, recorded.target_position, recorded.target_R),
        optidrive=Stream(recorded.slide_t, np.asarray(recorded.slide)[:, None], 'ft_sensor'),
        phases=tuple(Phase(*one) for one in recorded.phases), start_ns=START_NS, source=source)


def ask_with_arrays(pair):
    """Return the answer on a pair of recordings, through the function in which reading ends."""
    real, heldout = (to_recording(one, 'blind') for one in pair)
    outcome = RigSource(load_rig(None)).diagnose(real, heldout).outcome
    return to_document(outcome.diagnosis, {c.name: c.unit for c in CHANNELS}, None)


def ask_with_bags(pair):
    """Return the answer on a pair of recordings, through bags and the command."""
    with tempfile.TemporaryDirectory() as folder:
        bags = [Path(folder) / name for name in ('fit', 'heldout')]
        for bag, recorded in zip(bags, pair):
            write_recording(bag, to_recording(recorded))
        done = subprocess.run(
            [sys.executable, '-m', 'forcecal_ros.cli.main', 'diagnose', str(bags[0]), '--rig',
             'nominal', '--heldout', str(bags[1]), '-o', str(Path(folder) / 'out')], cwd=ROOT,
            capture_output=True, text=True, check=False)
        path = Path(folder) / 'out' / 'diagnosis.json'
        if not path.exists():
            raise RuntimeError(f'exit status {done.returncode}: {done.stderr[-300:]}')
        return json.loads(path.read_text())


def answer(job):
    """Diagnose one case of a run and write the result; ``job``: (folder, id, through bags)."""
    folder, identity, through_bags = Path(job[0]), job[1], job[2]
    pair = load_case(folder / 'cases' / f'{identity}.npz')
    began, cpu = time.monotonic(), time.process_time()
    try:
        document = (ask_with_bags if through_bags else ask_with_arrays)(pair)
    except Exception as error:
        document = {'verdict': 'crashed', 'error': f'{type(error).__name__}: {error}'}
    write_json(folder / 'results' / f'{identity}.json', {
        'document': document, 'route': 'bags' if through_bags else 'arrays',
        'seconds': time.monotonic() - began, 'cpu_seconds': time.process_time() - cpu})
    return document['verdict']


def identity_of_tool():
    """Return the tool's commit, whether its files differ from it, and a hash of all of them."""
    def git(*words):
        return subprocess.run(['git', *words], cwd=ROOT, capture_output=True, text=True,
                              check=True).stdout.strip()

    parts = ['forcecal_ros']
    texts = b''.join(path.read_bytes() for part in parts
                     for path in sorted((ROOT / part).rglob('*.py')))
    return {'commit': git('rev-parse', 'HEAD'),
            'changed': git('status', '--porcelain', '--', *parts),
            'thresholds': sha256(texts).hexdigest()}
