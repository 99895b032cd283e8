"""Throughput of many recordings on one and on two workers: processes, and a Dask cluster.

    python benchmark/scale_out.py [RECORDINGS]

`forcecal estimate` over recordings of 60 s of the rig, each read, estimated and written, all
workers started and warm. Time on the wall, the best of three rounds; results are compared bit for
bit. It wants two idle cores. Without dask.distributed, the extra `scale`, the cluster is left out.
"""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from importlib.util import find_spec
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from forcecal_ros.cli.estimate import answer
from forcecal_ros.cli.main import parse
from forcecal_ros.cli.many import each
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import save
import numpy as np
from timing import head, row

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / 'test' / 'helpers'))
from observing import calibration, record, Swing

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2)
ROUNDS = 3


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[str]:
    """Start a scheduler and some workers of one thread each."""
    processes = []

    def start(log: Path, module: str, *arguments: str) -> None:
        with log.open('w') as out:
            processes.append(subprocess.Popen(
                [sys.executable, '-m', f'distributed.cli.{module}', *arguments, '--no-dashboard',
                 '--host', '127.0.0.1'], cwd=folder, stdout=out, stderr=subprocess.STDOUT,
                start_new_session=True))

    try:
        said = folder / f'scheduler{workers}'
        start(said, 'dask_scheduler', '--port', '0')
        while not (found := re.search(r'at:\s+(tcp://\S+)', said.read_text())):
            time.sleep(0.05)
        for i in range(workers):
            start(folder / f'worker{i}', 'dask_worker', found[1], '--nthreads', '1')
        yield found[1]
    finally:
        for process in processes:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def tasks_of(folder: Path, count: int, out: str) -> list[argparse.Namespace]:
    return [argparse.Namespace(**{
        **vars(parse(['estimate', str(folder / f'bag{i}'), '--calibration',
                       str(folder / 'calibration.yaml'), '-o', str(folder / out / f'bag{i}')])),
        'bag': str(folder / f'bag{i}')}) for i in range(count)]


def seconds(folder: Path, count: int, out: str, **where: object) -> float:
    (folder / out).mkdir(exist_ok=True)
    start = time.perf_counter()
    for outcome in each(answer, tasks_of(folder, count, out), **where):
        assert not outcome.error, outcome.error
    return time.perf_counter() - start


def contact(path: Path) -> np.ndarray:
    return read_recording(path, {'wrench': '/observer/contact_wrench'}).wrench.values


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for i in range(count):
            write_recording(folder / f'bag{i}', record(60.0, SWING, seed=i))
        save(calibration(), folder / 'calibration.yaml')
        places: dict[str, dict[str, Any]] = {
            'this process': {'jobs': 1}, '--jobs 2': {'jobs': 2}}
        with ExitStack() as clusters:
            for workers in ('one', 'two') if find_spec('distributed') else ():
                address = clusters.enter_context(cluster(folder, 1 + (workers == 'two')))
                plural = 's' * (workers == 'two')
                places[f'--dask, {workers} worker{plural}'] = {'dask': address}
            took = dict.fromkeys(places, np.inf)
            for turn in range(ROUNDS + 1):
                for place, where in places.items():
                    once = seconds(folder, count, place, **where)
                    took[place] = min(took[place], once) if turn else np.inf
        head(f'{count} recordings of 60 s', 'recordings a second', 'times one worker', 'wanted',
             'same bits')
        for place, best in took.items():
            one = took['--dask, one worker' if 'dask' in place else 'this process']
            same = all(np.array_equal(contact(folder / place / f'bag{i}'),
                                      contact(folder / 'this process' / f'bag{i}'))
                       for i in range(count))
            row(place, f'{count / best:.2f}', f'{one / best:.2f}',
                '1.7' if '2' in place or 'two' in place else '', same)


if __name__ == '__main__':
    main()
