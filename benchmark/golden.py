"""Pinned answers: a fixed set of recordings, what the commands answer, and what has changed.

    python benchmark/golden.py check              # all, on two cores within half an hour
    python benchmark/golden.py check --quick      # a subset, within five minutes
    python benchmark/golden.py make               # measure what golden.json does not hold yet
    python benchmark/golden.py make --anew --only 'rig/wrench_*'   # pin some answers again
    python benchmark/golden.py list

Recordings are made once and kept in --recordings (FORCECAL_GOLDEN, ~/.cache/forcecal_golden).
golden.json pins the hash of each and the answer on it before the redesign. ``check`` exits with 1
where an answer was right and is not any more, and where a pinned one cannot be judged: its case is
gone, or its recording cannot be made; only real recordings may be absent. A crash, or no answer in
--timeout, is a wrong answer. Computers that round otherwise make other hashes, which is stated.

Right is
- of a diagnosis: ``exact``, only true effects are named, all of them; ``first``, the first name
  is true; ``alias``, the first name is an alias of a true effect, or the verdict is ambiguous, and
  the true one is among the candidates. Where there is no effect: none is named, and without any
  background the verdict is no_gap. What a background resembles is neither right nor wrong.
  Values are compared with the pinned ones, not graded: `nominal rig/accel_resonance` is exact with
  100 Hz in place of 60.
- of a calibration: written, and within 3.5 standard errors of the truth (or within what is of no
  account); of a spoilt recording: refused, or right, or written with a warning that names the
  cause.
"""

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from fnmatch import fnmatch
import hashlib
import json
import os
from pathlib import Path
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from golden_cases import all_cases, Case, COMMANDS
import yaml

PINNED = Path(__file__).with_name('golden.json')
FORCECAL = Path(sys.executable).with_name('forcecal')
REAL_DATA = Path(os.environ.get('FORCECAL_DATA', PINNED.parents[2] / 'shared' / 'data'))

SIGMAS = 3.5
"""Standard errors by which a calibrated number may be off."""

NO_ACCOUNT = {'mass': 0.005, 'com': 0.001, 'wrench_bias': 0.05, 'tool': 10.0}
"""Errors that do no harm: of a mass in shares of it; [m], [N or N m], [N/m]."""

MOVED = 0.1
"""Standard errors by which a value may differ from the pinned one without being listed."""

WAITING = 10
"""Time that a command may take, in its limit of processor time."""

ALIASES = (
    {'wrench_delay', 'wrench_lowpass'}, {'accel_delay', 'accel_resonance'},
    {'base_tilt', 'cable_force'},
    {'tool_mass', 'wrench_gain', 'tool_stiffness', 'tool_damping', 'contact_stiffness'})
"""Effects that hardly differ in what they do to a recording."""

Answer = dict[str, Any]


# recordings

def digest(folder: Path) -> str:
    """Return a hash of the messages of all bags and of all other files of a folder."""
    from rosbags.highlevel import AnyReader

    total = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        if path.name in ('golden.json', 'known.yaml', 'poses'):  # made by the commands
            continue
        total.update(path.name.encode())
        if path.is_dir():
            with AnyReader([path]) as reader:
                for connection, stamp, raw in reader.messages():
                    total.update(f'{connection.topic} {stamp}'.encode() + bytes(raw))
        else:
            total.update(path.read_bytes())
    return total.hexdigest()[:16]


def make_recording(job: tuple[Case, Path]) -> str:
    """Make the recordings of a case where they are not there; return why that failed."""
    case, recordings = job
    folder = recordings / case.key
    if (folder / 'golden.json').exists():
        return ''
    import golden_recordings

    scratch = Path(tempfile.mkdtemp(prefix='making-', dir=recordings))
    try:
        truth = getattr(golden_recordings, case.make)(scratch, **case.options)
        (scratch / 'golden.json').write_text(json.dumps(
            {'truth': truth or {}, 'digest': digest(scratch)}))
        shutil.rmtree(folder, ignore_errors=True)
        scratch.replace(folder)
    except Exception as error:
        shutil.rmtree(scratch, ignore_errors=True)
        return f'{type(error).__name__}: {error}'
    return ''


def skipped(case: Case) -> str:
    """Say why a case cannot be run here, if so."""
    real = case.family == 'real' or case.command in ('along motion', 'kuka')
    there = not real or REAL_DATA.is_dir()
    return '' if there else f'{REAL_DATA} is not there; set FORCECAL_DATA'


# answers

def flat(document: Any, name: str = '') -> dict[str, Any]:
    """Return all leaves of a document by their path."""
    if isinstance(document, dict) and 'value' not in document:
        parts = document.items()
    elif isinstance(document, list):
        parts = enumerate(document)
    else:
        return {name: document}
    return {k: v for key, one in parts
            for k, v in flat(one, f'{name}.{key}' if name else str(key)).items()}


def of_calibration(document: Any) -> Answer:
    """Map calibration.yaml to what is pinned: values with standard errors, and warnings."""
    found: dict[str, list[float]] = {}
    parts = {k: document.get(k) for k in (
        'mass', 'com', 'wrench_bias', 'accelerometer', 'tool', 'matrix')}
    parts['matrix_offset'] = (parts['matrix'] or {}).get('offset')
    for name, estimate in flat(parts).items():
        if isinstance(estimate, dict) and not name.startswith('accelerometer.map'):
            stds = flat(estimate.get('std'))
            for index, value in flat(estimate['value']).items():
                std = stds.get(index, stds.get(''))
                if isinstance(value, (int, float)) and isinstance(std, (int, float)):
                    found['.'.join(filter(None, (name, index)))] = [value, std]
    quality = document.get('quality') or {}
    warnings = [str(line) for line in quality.get('warnings') or ()]
    return {'verdict': 'written', 'values': found, 'warnings': warnings}


def of_diagnosis(document: Any) -> Answer:
    """Map diagnosis.json to what is pinned."""
    effects = document.get('effects') or []
    values = {f'{e["name"]}.{key}': [p['value'], p['std']] for e in effects
              for key, p in e['parameters'].items() if p['value'] or p['std']}
    return {'verdict': document['verdict'], 'effects': [e['name'] for e in effects],
            'candidates': {c['name']: c['probability'] for c in document['candidates']},
            'values': values, 'explained': (document.get('gap') or {}).get('closed')}


def run(words: list[str], folder: Path, limit: float) -> tuple[int | None, str, float]:
    """Run forcecal; return its exit status or None in time-out, its messages, processor time."""
    with tempfile.TemporaryFile('w+') as messages:
        process = subprocess.Popen([FORCECAL, *words], cwd=folder, stdout=subprocess.DEVNULL,
                                   stderr=messages, env={**os.environ, 'OMP_NUM_THREADS': '1',
                                                         'OPENBLAS_NUM_THREADS': '1'})
        resource.prlimit(process.pid, resource.RLIMIT_CPU, (round(limit), round(limit)))
        watch = threading.Timer(WAITING * limit, process.kill)  # where it sleeps for ever
        watch.start()
        _, status, usage = os.wait4(process.pid, 0)
        watch.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        messages.seek(0)
        killed = process.returncode in (-signal.SIGKILL, -signal.SIGXCPU)
        return (None if killed else process.returncode, messages.read(),
                usage.ru_utime + usage.ru_stime)


def answer(case: Case, recordings: Path, limit: float) -> Answer:
    """Run the commands of a case and return what they answer, judged."""
    source = recordings / case.key
    about = json.loads((source / 'golden.json').read_text())
    with tempfile.TemporaryDirectory(prefix='golden-') as temporary:
        folder = Path(temporary)
        for path in source.iterdir():
            (folder / path.name).symlink_to(path)
        (folder / 'out').mkdir()
        status, text, seconds = 0, '', 0.0
        for line in COMMANDS[case.command]:
            status, text, more = run([*line.split(), '--quiet'] if not line.startswith('import')
                                     else line.split(), folder, limit)
            seconds += more
            if status != 0:
                break
        name = 'diagnosis.json' if case.part == 'diagnoses' else 'calibration.yaml'
        path, found = folder / 'out' / name, {}
        if status == 0 and path.exists():
            text_of = path.read_text()
            found = (of_diagnosis(json.loads(text_of)) if name.endswith('json')
                     else of_calibration(yaml.safe_load(text_of)))
        elif status == 0 and (folder / 'out' / 'insitu.json').exists():
            found = {'verdict': 'refused', 'message': text}  # loads that determine no matrix
    lines = [line for line in text.splitlines() if line.startswith('forcecal: ')
             and not line.startswith('forcecal: note')]
    if status is None:
        found = {'verdict': 'time-out'}
    elif status not in (0, 1) or 'Traceback' in text or (not found and status == 0):
        found = {'verdict': 'crashed', 'message': (text.splitlines() or [''])[-1][:200]}
    elif status == 1:
        found = {'verdict': 'refused', 'message': lines[0].removeprefix('forcecal: ')[:300]
                 if lines else ''}
    found |= {'status': status, 'seconds': round(seconds, 1), 'digest': about['digest']}
    return rounded(judged(case, found, about['truth']))


def judged(case: Case, found: Answer, truth: dict[str, float]) -> Answer:
    """Add the grade and whether that is right; keep the truth, and of warnings what counts."""
    if case.part == 'diagnoses':
        grade = grade_of_diagnosis(case.truth, found)
        return found | {'grade': grade, 'truth': case.truth['effects']}
    said = [*found.pop('warnings', ()), found.get('message', '')]
    named = bool(re.search(case.truth.get('cause') or '$.', ' '.join(said), re.IGNORECASE))
    grade, off = found['verdict'], {}
    if grade == 'written':
        off = errors(found['values'], truth)
    if grade == 'written':
        grade = 'values' if not off else 'warned' if case.truth['spoilt'] and named else 'off'
    elif grade == 'refused' and not case.truth['spoilt']:
        grade = 'falsely refused'
    return found | {'grade': grade, 'truth': truth, 'off': off, 'warnings': len(said) - 1,
                    **({'cause': named} if case.truth['spoilt'] and grade != 'values' else {})}


def errors(values: dict[str, list[float]], truth: dict[str, float]) -> dict[str, Any]:
    """Return the numbers that are off, in standard errors."""
    off: dict[str, Any] = {}
    for key, true in truth.items():
        if key not in values:
            off[key] = 'missing'
            continue
        value, std = values[key]
        least = NO_ACCOUNT.get(key.split('.')[0], 0.0) * (abs(true) if key == 'mass' else 1.0)
        sigmas = abs(value - true) / max(std, 1e-12)
        if sigmas > SIGMAS and abs(value - true) > least:
            off[key] = sigmas
    return off


def grade_of_diagnosis(truth: dict[str, Any], found: Answer) -> str:
    """Return exact, first, alias, silent (no effect, and none named), or what is wrong."""
    if 'effects' not in found:
        return str(found['verdict'])
    patterns, neutral = truth['effects'], set(truth.get('neutral', ()))
    named = [name for name in found['effects'] if name != 'unknown']

    def true(name: str) -> bool:
        return any(re.fullmatch(pattern, name) for pattern in patterns)

    if not patterns:
        false = [name for name in named if name not in neutral]
        quiet = not false and (truth.get('outside') or found['verdict'] == 'no_gap')
        return 'silent' if quiet else 'false' if false else 'unknown'
    if not named:
        return 'missed'
    if all(map(true, named)) and all(
            any(re.fullmatch(pattern, name) for name in named) for pattern in patterns):
        return 'exact'
    if true(named[0]):
        return 'first'
    alias = any(named[0] in names and any(re.fullmatch(pattern, one) for one in names
                                          for pattern in patterns) for names in ALIASES)
    if (alias or found['verdict'] == 'ambiguous') and any(map(true, found['candidates'])):
        return 'alias'
    return 'wrong'


GRADES = ('exact', 'first', 'alias', 'silent', 'values', 'warned', 'refused')
"""Those that are right, of each kind the best first."""


def rounded(document: Any) -> Any:
    """Round all numbers of a document to five digits."""
    if isinstance(document, float):
        return float(f'{document:.5g}')
    if isinstance(document, dict):
        return {key: rounded(value) for key, value in document.items()}
    return [rounded(one) for one in document] if isinstance(document, list) else document


# comparison

def compare(pinned: Answer, now: Answer) -> tuple[str, list[str]]:
    """
    Compare an answer with the pinned one.

    Returns
    -------
    word : str
        ``worse``: was right, is not; ``better``: the other way round; ``lower``, ``higher``: right
        with another grade; ``moved``: a value, by more than 0.1 standard error, or one that is
        there in one of them only; ``same``.
    lines : list of str
        What has changed.
    """
    was, there = pinned.get('values', {}), now.get('values', {})
    moved = [f'{key}: {was[key][0]} -> {there[key][0]} (std {was[key][1]})' for key in was
             if key in there and abs(was[key][0] - there[key][0]) > MOVED * was[key][1]
             + 1e-4 * abs(was[key][0])]
    moved += [f'{key}: {was.get(key, ["none"])[0]} -> {there.get(key, ["none"])[0]}'
              for key in (*was, *there) if (key in was) != (key in there)]
    before, after = (one['grade'] in GRADES for one in (pinned, now))
    if before != after:
        word = 'better' if after else 'worse'
    elif before and pinned['grade'] != now['grade']:
        lower = GRADES.index(now['grade']) > GRADES.index(pinned['grade'])
        word = 'lower' if lower else 'higher'
    else:
        word = 'moved' if moved else 'same'
    keys = ['grade', 'verdict', 'effects', 'cause']
    if word not in ('same', 'moved'):  # a reworded message alone is not worth a line
        keys += ['candidates', 'message', 'off']
    lines = [f'{key}: {pinned.get(key)} -> {now.get(key)}' for key in keys
             if pinned.get(key) != now.get(key)]
    return word, lines + moved[:6] + [f'... {len(moved)} values moved'] * (len(moved) > 6)


def table(answers: dict[str, Answer], cases: list[Case]) -> str:
    """Return right and all, by family, and the processor time."""
    rows = ['| part | family | right | grades | processor time [s] |', '|---|---|--:|---|--:|']
    families = list(dict.fromkeys((case.part, case.family) for case in cases))
    for part, family in families:
        some = [answers[c.name] for c in cases if c.name in answers
                and (c.part, c.family) == (part, family)]
        grades = Counter(one['grade'] for one in some)
        right = sum(n for grade, n in grades.items() if grade in GRADES)
        rows.append(f'| {part} | {family} | {right} of {len(some)} | '
                    + ', '.join(f'{n} {grade}' for grade, n in grades.most_common())
                    + f' | {sum(one["seconds"] for one in some):.0f} |')
    return '\n'.join(rows)


def report(pinned: dict[str, Answer], answers: dict[str, Answer], cases: list[Case],
           gone: list[str] | None = None) -> int:
    """
    Print what has changed.

    Parameters
    ----------
    gone : list of str
        Pinned answers without a case.

    Returns
    -------
    int
        1 where an answer became worse or a pinned one cannot be judged.
    """
    words: Counter[str] = Counter()
    for name in gone or ():
        words['not judged'] += 1
        print(f'NOT JUDGED {name}: it is pinned, and no case any more')
    for case in cases:
        now, before = answers.get(case.name), pinned.get(case.name)
        if before is None:
            continue
        if now is None:
            words['not judged'] += 1
            print(f'NOT JUDGED {case.name}: its recording cannot be made')
            continue
        word, lines = compare(before, now)
        words[word] += 1
        if before['digest'] != now['digest']:  # by rounding on another computer, or in its making
            words['of another recording'] += 1
            print(f'RECORDING of {case.name} differs from the pinned one')
        if word != 'same' or lines:
            print(f'{word.upper() if word == "worse" else word} {case.name}, truth {case.truth}')
            print(''.join(f'    {line}\n' for line in lines), end='')
    print('\n' + table(answers, cases))
    if unpinned := [case.name for case in cases if case.name not in pinned]:
        print(f'\n{len(unpinned)} not pinned: {", ".join(unpinned)}')
    pairs = [(pinned[name]['seconds'], one['seconds']) for name, one in answers.items()
             if name in pinned]
    print(f'\nprocessor time {sum(b for _, b in pairs):.0f} s, pinned '
          f'{sum(a for a, _ in pairs):.0f} s; '
          + ', '.join(f'{n} {word}' for word, n in words.most_common()))
    return int(words['worse'] + words['not judged'] > 0)


# command line

def write(answers: dict[str, Answer], path: Path) -> None:
    """Write answers, one a line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = (f'{json.dumps(name)}: {json.dumps(one, separators=(",", ":"))}'
             for name, one in sorted(answers.items()))
    scratch = path.with_suffix('.part')
    scratch.write_text('{\n' + ',\n'.join(lines) + '\n}\n')
    scratch.replace(path)


def read(path: Path) -> dict[str, Answer]:
    """Read answers, none where there is no file."""
    return json.loads(path.read_text()) if path.exists() else {}


def measured(cases: list[Case], args: argparse.Namespace, answers: dict[str, Answer], out: Path
             ) -> dict[str, Answer]:
    """Make recordings, run the commands, and add each answer to ``answers`` and to a file."""
    args.recordings.mkdir(parents=True, exist_ok=True)
    missing = [(c, args.recordings) for c in cases
               if not (args.recordings / c.key / 'golden.json').exists()]
    failed = {}
    if missing:
        print(f'making {len(missing)} recordings in {args.recordings}', flush=True)
        with ProcessPoolExecutor(args.jobs) as pool:
            for (case, _), why in zip(missing, pool.map(make_recording, missing)):
                if why:
                    failed[case.name] = why
                    print(f'cannot make {case.name}: {why}', flush=True)
    cases = [case for case in cases if case.name not in failed]
    with ThreadPoolExecutor(args.jobs) as pool:
        each = pool.map(lambda case: answer(case, args.recordings, args.timeout), cases)
        for number, (case, found) in enumerate(zip(cases, each), 1):
            answers[case.name] = found
            write(answers, out)
            print(f'{number}/{len(cases)} {case.name}: {found["grade"]}, '
                  f'{found["seconds"]:.0f} s', flush=True)
    return answers


def parsed(words: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('action', choices=('make', 'check', 'list'))
    parser.add_argument('--quick', action='store_true', help='a subset of some five minutes')
    parser.add_argument('--part', choices=('calibrations', 'diagnoses'))
    parser.add_argument('--only', metavar='PATTERN', help='names that match, as rig/wrench_*')
    parser.add_argument('--jobs', type=int, default=2, help='how many at once (2)')
    parser.add_argument('--timeout', type=float, default=300.0,
                        help='processor time of each command [s] (300)')
    parser.add_argument('--anew', action='store_true', help='make: pin again what is pinned')
    parser.add_argument('--list', action='store_true', help='print the cases, run nothing')
    parser.add_argument('--recordings', type=Path, metavar='DIR', default=Path(os.environ.get(
        'FORCECAL_GOLDEN', Path.home() / '.cache' / 'forcecal_golden')))
    parser.add_argument('--pinned', type=Path, default=PINNED, metavar='FILE')
    parser.add_argument('--out', type=Path, metavar='FILE', help='answers of check',
                        default=PINNED.parents[1] / 'build' / 'golden_answers.json')
    args = parser.parse_args(words)
    args.recordings = args.recordings.resolve()
    return args


def main(words: list[str] | None = None) -> int:
    """Carry it out."""
    args = parsed(words)
    cases = [case for case in all_cases()
             if (case.quick or not args.quick) and args.part in (None, case.part)
             and (not args.only or fnmatch(case.name, args.only))]
    if args.list or args.action == 'list':
        print('\n'.join(f'{c.name}\t{c.family}\t{c.command}\t{c.truth}' for c in cases))
        return 0
    for reason in sorted({*map(skipped, cases)} - {''}):
        names = [case.name for case in cases if skipped(case) == reason]
        print(f'{len(names)} cases are skipped, {reason}: {", ".join(names)}')
    cases = [case for case in cases if not skipped(case)]
    pinned = read(args.pinned)
    if args.action == 'make':
        left = [case for case in cases if args.anew or case.name not in pinned]
        print(table(measured(left, args, pinned, args.pinned), cases))
        return 0
    known = {case.name for case in all_cases()}
    gone = [name for name in pinned if name not in known and fnmatch(name, args.only or '*')]
    return report(pinned, measured(cases, args, {}, args.out), cases, gone)


if __name__ == '__main__':
    raise SystemExit(main())
