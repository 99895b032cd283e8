"""Sealing and opening: labels are committed to before anything is diagnosed, and opened after.

A run is a folder: ``cases/ID.npz`` and ``commitments.json`` (published), ``run.json`` (commit of
the tool, written before its first case), ``results/ID.json``, ``opened.json``. Labels lie in a
folder of their own. All cases come from one secret, the master, which opening reveals.
"""

from collections.abc import Mapping
from datetime import datetime, timezone
from hashlib import sha256
import json
import os
from pathlib import Path
import secrets
from typing import Any

from blind import outside
from blind.casefile import save_case
from blind.cases import draw, kinds, Runner, seed_of
from blind.truth import describe
import numpy as np

DEVELOPMENT = 'development'
SEALED = 'sealed'


class SealError(Exception):
    """The protocol does not allow what was asked for."""


def digest(data: bytes) -> str:
    """Return the SHA-256 of some bytes."""
    return sha256(data).hexdigest()


def write_json(path: Path, document: Any, *, private: bool = False) -> None:
    """Write a document whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = path.with_name(f'.{path.name}.{os.getpid()}')
    with open(scratch, 'w', opener=lambda name, flags: os.open(
            name, flags, 0o600 if private else 0o644)) as file:
        json.dump(document, file, indent=1)
        file.flush()
        os.fsync(file.fileno())
    scratch.replace(path)


def read_json(path: Path) -> Any:
    """Read a document."""
    return json.loads(path.read_text())


def now() -> str:
    """Return the time of day, to the second."""
    return datetime.now(timezone.utc).isoformat(timespec='seconds')


def commitment(label: Mapping[str, Any], nonce: str) -> str:
    """Return the SHA-256 of a label and its nonce."""
    return digest((json.dumps(label, sort_keys=True) + nonce).encode())


def prepare(folder: Path, labels: Path, seeds: str, count: int, seconds: float,
            none: int | None = None, part: str = '') -> dict[str, Any]:
    """
    Begin a run, or return what was begun.

    Parameters
    ----------
    folder, labels : Path
        Of the run, of its labels.
    seeds : str
        ``sealed``: a new secret; ``development``: known seeds, for work.
    count : int
    seconds : float
        Length of a recording.
    none : int, optional
        How many cases are without effect; a fifth if not given.
    part : str
        Which of the development seeds; cases of different parts are different.

    Returns
    -------
    dict
        The plan.
    """
    path = folder / 'plan.json'
    wanted = {'seeds': seeds, 'count': count, 'seconds': seconds, 'none': none, 'part': part}
    if part and seeds == SEALED:
        raise SealError('sealed seeds are drawn anew and have no parts')
    if path.exists():
        plan: dict[str, Any] = read_json(path)
        if any(plan[key] != value for key, value in wanted.items()):
            raise SealError(f'{folder} holds another run ({plan}); choose another folder')
        return plan
    if folder.resolve() in (labels.resolve(), *labels.resolve().parents):
        raise SealError(f'{labels}: labels lie apart from the run; choose another folder')
    master = secrets.token_hex(16) if seeds == SEALED else DEVELOPMENT + part
    write_json(labels / 'master.json', {'master': master}, private=True)
    plan = {**wanted, 'master_sha256': digest(master.encode()), 'begun': now(),
            'outside_sha256': outside.fingerprint()}
    write_json(path, plan)
    return plan


def case_kinds(plan: Mapping[str, Any], master: str) -> list[str]:
    """Return the kind of each case, in an order that only the master tells."""
    ordered = kinds(plan['count'], plan['none'])
    rng = np.random.default_rng(seed_of(master, -1))
    return [ordered[i] for i in rng.permutation(len(ordered))]


def make(job: tuple[str, str, int, str]) -> str:
    """
    Make one case: its recordings in the run, its label apart; what is there stays.

    Parameters
    ----------
    job : tuple
        (folder of the run, folder of labels, index, kind)

    Returns
    -------
    str
        Id of the case.
    """
    folder, labels, index, kind = Path(job[0]), Path(job[1]), job[2], job[3]
    master = read_json(labels / 'master.json')['master']
    plan = read_json(folder / 'plan.json')
    identity = digest(f'{master}/{index}/id'.encode())[:12]
    entry = labels / f'{identity}.json'
    if entry.exists():
        return identity
    case = draw(kind, seed_of(master, index), plan['seconds'])
    runner = Runner(case)
    path = folder / 'cases' / f'{identity}.npz'
    save_case(path, runner.recordings())
    label = {'index': index, **describe(case, runner)}
    write_json(entry, {'label': label, 'nonce': digest(f'{master}/{index}/nonce'.encode()),
                       'case_sha256': digest(path.read_bytes())}, private=True)
    return identity


def jobs(folder: Path, labels: Path) -> list[tuple[str, str, int, str]]:
    """Return what there is to make, see :func:`make`."""
    plan, master = read_json(folder / 'plan.json'), read_json(labels / 'master.json')['master']
    return [(str(folder), str(labels), index, kind)
            for index, kind in enumerate(case_kinds(plan, master))]


def seal(folder: Path, labels: Path) -> dict[str, dict[str, str]]:
    """
    Publish what binds the labels: SHA-256 of each with its nonce, and of each case.

    Returns
    -------
    dict
        Id -> ``label``, ``case``; in the order of the ids, which tells nothing.
    """
    path = folder / 'commitments.json'
    if path.exists():
        return dict(read_json(path))
    entries = {one.stem: read_json(one) for one in sorted(labels.glob('*.json'))
               if one.name != 'master.json'}
    count = read_json(folder / 'plan.json')['count']
    if len(entries) != count:
        raise SealError(f'{len(entries)} of {count} cases are made; make the others first')
    bound = {identity: {'label': commitment(entry['label'], entry['nonce']),
                        'case': entry['case_sha256']} for identity, entry in entries.items()}
    write_json(path, bound)
    return bound


def start(folder: Path, tool: Mapping[str, Any]) -> None:
    """
    Record which tool runs, before its first case; a run goes on with the same one only.

    Parameters
    ----------
    folder : Path
    tool : mapping
        ``commit`` and ``thresholds`` (SHA-256 of what holds them), and whatever names it.
    """
    if not (folder / 'commitments.json').exists():
        raise SealError(f'{folder}: labels are not sealed yet')
    if (folder / 'opened.json').exists():
        raise SealError(f'{folder}: labels are open, nothing is diagnosed any more')
    path = folder / 'run.json'
    if not path.exists():
        write_json(path, {'tool': dict(tool), 'started': now()})
    elif (begun := read_json(path)['tool']) != dict(tool):
        raise SealError(f'{folder}: was begun with another tool ({begun["commit"]}, not '
                        f'{tool["commit"]}); check that one out, or begin another run')


def waiting(folder: Path) -> list[str]:
    """Return the ids without a result, after checking that the cases are those committed to."""
    bound = read_json(folder / 'commitments.json')
    left = [one for one in bound if not (folder / 'results' / f'{one}.json').exists()]
    for one in left:
        if digest((folder / 'cases' / f'{one}.npz').read_bytes()) != bound[one]['case']:
            raise SealError(f'case {one} is not the one that was committed to')
    return left


def open_labels(folder: Path, labels: Path, ledger: Path) -> dict[str, dict[str, Any]]:
    """
    Open the labels, once all results are there.

    Parameters
    ----------
    folder, labels : Path
    ledger : Path
        Every sealed opening there ever was, a line each.

    Returns
    -------
    dict
        Id -> label.

    Raises
    ------
    SealError
        Results are missing, a label is not the one committed to, or these seeds were opened.
    """
    plan, bound = read_json(folder / 'plan.json'), read_json(folder / 'commitments.json')
    missing = [one for one in bound if not (folder / 'results' / f'{one}.json').exists()]
    if missing:
        raise SealError(f'{len(missing)} of {len(bound)} results are missing; labels stay closed')
    opened = ledger.read_text().splitlines() if ledger.exists() else []
    if plan['seeds'] == SEALED and ((folder / 'opened.json').exists() or any(
            json.loads(line)['master_sha256'] == plan['master_sha256'] for line in opened)):
        raise SealError('these seeds have been opened before; make others')
    found = {}
    for identity, hashes in bound.items():
        entry = read_json(labels / f'{identity}.json')
        if commitment(entry['label'], entry['nonce']) != hashes['label']:
            raise SealError(f'label {identity} is not the one that was committed to')
        found[identity] = entry['label']
    master = read_json(labels / 'master.json')['master']
    if digest(master.encode()) != plan['master_sha256']:
        raise SealError('the master is not the one that was committed to')
    write_json(folder / 'opened.json', {
        'opened': now(), 'master': master,
        'results_sha256': {one: digest((folder / 'results' / f'{one}.json').read_bytes())
                           for one in bound}})
    if plan['seeds'] == SEALED:
        ledger.parent.mkdir(parents=True, exist_ok=True)
        with ledger.open('a') as file:
            file.write(json.dumps({
                'opened': now(), 'master': master, 'master_sha256': plan['master_sha256'],
                'count': plan['count'], 'none': plan['none'], 'seconds': plan['seconds'],
                'tool': read_json(folder / 'run.json')['tool']}) + '\n')
    return found
