"""A part of the second edition: made and sealed, opened, and verified by anyone."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import fcntl
from hashlib import sha256
import importlib
import importlib.metadata
from pathlib import Path
import secrets
from typing import Any, NamedTuple

from blind.robot import Array
from blind.seal import commitment, digest, now, read_json, SealError, write_json
from blind.second import methods, rules
from blind.second.case import Made, make, Plan, plans, seed_of
from blind.second.rules import DEVELOPMENT, file_of
import numpy as np

GENERATORS = {'rig': 'blind.second.on_rig:OnRig', 'arm': 'blind.second.on_arm:OnArm',
              'real': 'blind.second.on_real:OnReal', 'drake': 'blind.second.on_drake:OnDrake'}
"""Name -> module and class; loaded when wanted, as not everyone has MuJoCo or the recordings."""
LIBRARIES = ('numpy', 'scipy', 'numba', 'mujoco', 'drake')
SOURCES = Path(__file__).resolve().parents[1]
MAKING = (*(f'{name}.py' for name in (
    'dynamics', 'effect', 'effects_physics', 'effects_sensing', 'motion', 'noise', 'outside',
    'rig', 'robot', 'sensors', 'tool', 'cases')), *(f'second/{name}.py' for name in (
        'arm', 'case', 'ground', 'kinds_development', 'laid', 'law', 'noise', 'numbers', 'on_arm',
        'on_drake', 'on_real', 'on_rig', 'rules', 'shrink')))
"""Files that make cases."""


class Part(NamedTuple):
    """
    Where a part is.

    Attributes
    ----------
    public : Path
        What is in the repository.
    private : Path
        Recordings, labels and answers until it is opened.
    """

    public: Path
    private: Path

    def read(self, name: str) -> Any:
        """Read a public document."""
        return read_json(self.public / f'{name}.json')

    def recordings(self, identity: str) -> Path:
        """Return where the recordings of a case are."""
        return self.private / 'cases' / f'{identity}.npz'


def generator(name: str) -> Any:
    """Load a generator."""
    module, _, found = GENERATORS[name].partition(':')
    try:
        return getattr(importlib.import_module(module), found)
    except ModuleNotFoundError as error:
        raise SealError(f'the cases of {name} want {error.name}: pip install {error.name}'
                        ) from None


def content(arrays: Mapping[str, Array]) -> str:
    """Return the SHA-256 of arrays: names, types, shapes and values."""
    total = sha256()
    for name in sorted(arrays):
        one = np.ascontiguousarray(arrays[name])
        total.update(f'{name} {one.dtype.str} {one.shape}'.encode() + one.tobytes())
    return total.hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of what computes."""
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = ''
    return found


def sources() -> dict[str, str]:
    """Return the SHA-256 of every file that makes cases."""
    return {name: digest((SOURCES / name).read_bytes()) for name in MAKING}


def begin(part: Part, half: str, counts: Mapping[str, int], until: str) -> dict[str, Any]:
    """Begin a part, or return what was begun; ``until``: when it is opened, done or not."""
    path = part.public / 'plan.json'
    if path.exists():
        plan: dict[str, Any] = read_json(path)
        if plan['counts'] != dict(counts) or plan['half'] != half:
            raise SealError(f'{part.public} holds another part ({plan["counts"]}); choose '
                            'another number')
        return plan
    sealed = half != DEVELOPMENT
    if sealed and not file_of(half).exists():
        raise SealError(f'{file_of(half)} is not there; it has the kinds of {half}')
    master = secrets.token_hex(16) if sealed else f'{half}/{part.public.name}'
    write_json(part.private / 'master.json', {'master': master}, private=True)
    plan = {'half': half, 'counts': dict(counts), 'until': until, 'begun': now(),
            'master_sha256': digest(master.encode()), 'sources': sources(),
            'sealed_sha256': digest(file_of(half).read_bytes()) if sealed else '',
            'versions': versions()}
    write_json(path, plan)
    return plan


def identity_of(master: str, generator_name: str, index: int) -> str:
    """Return the name of a case, which tells nothing of it."""
    return digest(f'{master}/{generator_name}/{index}/id'.encode())[:12]


def nonce_of(master: str, identity: str) -> str:
    """Return what keeps a label from being guessed."""
    return digest(f'{master}/{identity}/nonce'.encode())


def planned(plan: Mapping[str, Any], master: str) -> dict[str, Plan]:
    """Return all cases of a part in the order of running."""
    cases = {identity_of(master, name, i): one for name, count in plan['counts'].items()
             for i, one in enumerate(plans(name, generator(name).effects, count, plan['half'],
                                           master))}
    order = np.random.default_rng(seed_of(master, 'order')).permutation(len(cases))
    names = list(cases)
    return {names[i]: cases[names[i]] for i in order}


@contextmanager
def claimed(part: Part, what: str, identity: str) -> Iterator[bool]:
    """Say whether a case is this process's to work on, and hold it; others hold others."""
    path = part.private / what / identity
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('w') as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True


def prepare(part: Part) -> Iterator[str]:
    """Make cases, several processes each its own; yields each that is made."""
    plan, master = part.read('plan'), read_json(part.private / 'master.json')['master']
    for identity, one in planned(plan, master).items():
        with claimed(part, 'making', identity) as mine:
            if mine and not part.recordings(identity).exists():
                _keep(part, identity, make(one, generator(one.generator)))
                yield identity


def ask(part: Part) -> Iterator[str]:
    """Ask simpler methods of cases, several processes each its own; yields each that was asked."""
    plan, master = part.read('plan'), read_json(part.private / 'master.json')['master']
    for identity, one in planned(plan, master).items():
        path = part.private / 'baselines' / f'{identity}.json'
        with claimed(part, 'asking-others', identity) as mine:
            made = kept(part, identity)
            if mine and made and not path.exists():
                write_json(path, asked(one, made), private=True)
                yield identity


def asked(one: Plan, made: Made) -> dict[str, Any]:
    """Return what simpler methods say of a case, and what the oracle finds."""
    base = generator(one.generator)(one.seed, rules.half(one.half)[1])
    measured = base.measured(made.arrays)
    return {**methods.judge(base, measured), 'oracle': methods.told(base, made.label, measured)}


def seal(part: Part) -> Iterator[str]:
    """Make every case, then publish what binds it; yields each that is made."""
    plan, master = part.read('plan'), read_json(part.private / 'master.json')['master']
    bound, labels = {}, {}
    for identity, one in planned(plan, master).items():
        made = kept(part, identity) or _keep(part, identity, make(one, generator(one.generator)))
        labels[identity] = made.label
        bound[identity] = {'generator': one.generator, 'case': content(made.arrays),
                           'label': commitment(made.label, nonce_of(master, identity))}
        yield identity
    write_json(part.private / 'labels.json', labels, private=True)
    write_json(part.public / 'commitments.json', bound)


def _keep(part: Part, identity: str, made: Made) -> Made:
    path = part.recordings(identity)
    path.parent.mkdir(parents=True, exist_ok=True)
    label = part.private / 'labels' / f'{identity}.json'
    write_json(label, made.label, private=True)
    arrays: dict[str, Any] = made.arrays
    with (scratch := path.with_suffix('.part')).open('wb') as file:
        np.savez(file, **arrays)
    scratch.replace(path)
    # as it is read again: JSON knows no tuples
    return Made(made.arrays, read_json(label))


def kept(part: Part, identity: str) -> Made | None:
    """Return a case that was made before."""
    path = part.recordings(identity)
    if not path.exists():
        return None
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files}
    return Made(arrays, read_json(part.private / 'labels' / f'{identity}.json'))


def start(part: Part, tool: Mapping[str, Any]) -> None:
    """Record which tool runs, before its first case; goes on with the same files only."""
    path = part.public / 'run.json'
    if not (part.public / 'commitments.json').exists():
        raise SealError(f'{part.public}: labels are not sealed yet')
    if (part.public / 'opened.json').exists():
        raise SealError(f'{part.public}: labels are open, nothing is diagnosed any more')
    if not path.exists():
        write_json(path, {'tool': dict(tool), 'started': now()})
    elif part.read('run')['tool']['files'] != tool['files']:
        raise SealError(f'{part.public}: was begun with other files of the tool; check out '
                        f'{part.read("run")["tool"]["commit"]}')


def open_labels(part: Part) -> None:
    """
    Publish answers and labels; cases without an answer are left out by their order.

    Raises
    ------
    SealError
        It was opened before, or an answer is missing before one that is there.
    """
    if (part.public / 'opened.json').exists():
        raise SealError(f'{part.public} has been opened before')
    master = read_json(part.private / 'master.json')['master']
    labels, order = read_json(part.private / 'labels.json'), list(part.read('commitments'))
    there = [(part.private / 'answers' / f'{one}.json').exists() for one in order]
    if sorted(there, reverse=True) != there:
        raise SealError('an answer is missing before one that is there: nothing may be left out '
                        'but the last of the order')
    answers = {one: read_json(part.private / 'answers' / f'{one}.json')
               for one, done in zip(order, there) if done}
    write_json(part.public / 'answers.json', answers)
    write_json(part.public / 'opened.json', {
        'opened': now(), 'master': master,
        'answers_sha256': {one: answer_digest(answer) for one, answer in answers.items()},
        'nonces': {one: nonce_of(master, one) for one in order}, 'labels': labels})


def answer_digest(answer: Mapping[str, Any]) -> str:
    """Return the SHA-256 of an answer."""
    return commitment(answer, '')


def faults(part: Part) -> Iterator[str]:
    """Yield what is not as it was committed to."""
    plan, bound = part.read('plan'), part.read('commitments')
    opened, answers = part.read('opened'), part.read('answers')
    master, labels = opened['master'], opened['labels']
    if digest(master.encode()) != plan['master_sha256']:
        yield 'the master is not the one that was committed to'
    half = plan['half']
    if half != DEVELOPMENT and digest(file_of(half).read_bytes()) != plan['sealed_sha256']:
        yield f'{file_of(half).name} is not the one that was committed to'
    cases = planned(plan, master)
    if list(cases) != list(bound):
        yield 'the cases are not those that the master draws, in its order'
    for one, hashes in bound.items():
        if commitment(labels[one], opened['nonces'][one]) != hashes['label']:
            yield f'label {one} is not the one that was committed to'
        if one in cases and any(labels[one][key] != getattr(cases[one], key)
                                for key in ('generator', 'kind', 'half', 'seed')):
            yield f'label {one} is not of the case that the master draws'
    if set(answers) != set(opened['answers_sha256']):
        yield 'answers were added or taken out'
    for one, answer in answers.items():
        if answer_digest(answer) != opened['answers_sha256'].get(one):
            yield f'answer {one} is not the one that was there at the opening'


def made_anew(part: Part, identity: str) -> Made:
    """Make a case of an opened part again."""
    one = planned(part.read('plan'), part.read('opened')['master'])[identity]
    return make(one, generator(one.generator))

