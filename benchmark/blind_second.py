"""The second edition of the blind check (benchmark/blind/PROTOCOL.md), part by part.

    python benchmark/blind_check.py second 2 seal --half sealed-2 --rig 22 --arm 6 --until 15:15
    python benchmark/blind_check.py second 2 run --until 15:15
    python benchmark/blind_check.py second 2 open
    python benchmark/blind_check.py second 2 baselines     (of an opened part; goes on)
    python benchmark/blind_check.py second 1 --development all --rig 4 --arm 2 --drake 2 --real 4
    python benchmark/blind_check.py verify [--cases N]
    python benchmark/blind_check.py rerun [--cases N | --all] [--jobs 2]
    python benchmark/blind_check.py compare 2 3            (of generators that both have)

``seal`` makes all cases and publishes what binds them; commit that. ``run`` asks the tool, in the
order that was sealed, and starts no case after the hour. Several processes of ``run``, and of
``make`` before ``seal``, share the work. ``open`` publishes labels and answers,
scores, and adds to RESULTS.md. ``rerun`` asks the tool of today the cases of opened parts and
prints both scores; answers are kept in ``build/blind``. Interrupted, each goes on where it was.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
import sys
import time

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'benchmark')]

from blind.seal import read_json, SealError, write_json
from blind.second import sealing
from blind.second.rules import DEVELOPMENT
from blind.second.sealing import Part
from tqdm import tqdm

OPENINGS = ROOT / 'benchmark' / 'blind' / 'second'
AGAIN = ROOT / 'build' / 'blind'
STEPS = ('seal', 'run', 'open', 'all', 'baselines', 'make', 'ask')


def main(words):
    args = parse(words)
    try:
        return args.work(args)
    except SealError as error:
        print(f'blind_check: {error}', file=sys.stderr)
        return 1


def parse(words):
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    second = commands.add_parser('second', help='make, run and open a part')
    second.add_argument('number', type=int)
    second.add_argument('step', choices=STEPS)
    second.add_argument('--development', action='store_true', help='known seeds, seen kinds')
    for name in sealing.GENERATORS:
        second.add_argument(f'--{name}', type=int, default=0, help='cases')
    second.add_argument('--half', default='', metavar='NAME', help='sealed half: sealed-2, ...')
    second.add_argument('--until', default='', metavar='HH:MM', help='no case is begun later')
    second.set_defaults(work=work)
    for name, function in (('verify', verify), ('rerun', rerun)):
        one = commands.add_parser(name)
        one.add_argument('--part', type=int, nargs='*', help='(default: all)')
        one.add_argument('--cases', type=int, default=0 if name == 'verify' else 10)
        one.set_defaults(work=function)
        if name == 'rerun':
            one.add_argument('--all', dest='cases', action='store_const', const=sys.maxsize)
            one.add_argument('--jobs', type=int, default=1)
    two = commands.add_parser('compare', help='two opened parts, row by row')
    two.add_argument('parts', type=int, nargs=2)
    two.set_defaults(work=compare)
    return parser.parse_args(words)


def part_of(number, development=False):
    name = f'{DEVELOPMENT if development else "part"}-{number}'
    private = ROOT / 'blind_runs' / f'second-{name}'
    return Part(private / 'public' if development else OPENINGS / name, private)


def work(args):
    part = part_of(args.number, args.development)
    steps = STEPS[:3] if args.step == 'all' else (args.step,)
    for step in steps:
        DO[step](part, args)
    return 0


def seal(part, args):
    counts = {name: getattr(args, name) for name in sealing.GENERATORS}
    if counts['real'] and not _has_recordings():
        counts['real'] = 0
    half = DEVELOPMENT if args.development else args.half
    if not half:
        raise SealError('say which sealed half the part is of, as --half sealed-2')
    sealing.begin(part, half, counts, args.until)
    if args.step == 'make':
        for identity in sealing.prepare(part):
            print(identity, flush=True)
    elif not (part.public / 'commitments.json').exists():
        for _ in tqdm(sealing.seal(part), desc='making', total=sum(counts.values()),
                      disable=None):
            pass


def _has_recordings():
    from blind.second.on_real import DATA, there
    if not there():
        print(f'real motion is left out: {DATA} is not there; set FORCECAL_DATA')
    return there()


def run(part, args):
    import blind_second_tool

    sealing.start(part, blind_second_tool.identity_of_tool())
    for identity, bound in tqdm(part.read('commitments').items(), desc='diagnosing',
                                disable=None):
        with sealing.claimed(part, 'asking', identity) as mine:
            path = part.private / 'answers' / f'{identity}.json'
            if not mine or path.exists():
                continue
            if args.until and time.strftime('%H:%M') >= args.until:
                print(f'no case is begun after {args.until}')
                return
            arrays = sealing.kept(part, identity).arrays
            if sealing.content(arrays) != bound['case']:
                raise SealError(f'case {identity} is not the one that was committed to')
            write_json(path, blind_second_tool.answer(bound['generator'], arrays))


def show(part, args):
    sealing.open_labels(part)
    write_scores(part)


def ask(part, args):
    """Ask simpler methods of cases that are made, sealed or not; answers stay with the labels."""
    for identity in sealing.ask(part):
        print(identity, flush=True)


def baselines(part, args):
    """Publish what simpler methods say of every answered case; goes on where it was."""
    answers, plans = part.read('answers'), None
    path = part.public / 'baselines.json'
    told = part.read('baselines') if path.exists() else {}
    for one, bound in tqdm(part.read('commitments').items(), disable=None):
        if one not in answers or one in told:
            continue
        before = part.private / 'baselines' / f'{one}.json'
        if before.exists():
            told[one] = read_json(before)
        elif bound['generator'] != 'real' or _has_recordings():
            plans = plans or sealing.planned(part.read('plan'), part.read('opened')['master'])
            told[one] = sealing.asked(plans[one], sealing.kept(part, one)
                                      or sealing.made_anew(part, one))
            write_json(path, told)
    write_json(path, told)
    write_scores(part)


def write_scores(part):
    from blind.second import report

    figures = report.figures_of([part])
    write_json(part.public / 'scores.json', report.plain(figures))
    text = report.render(part, figures)
    (part.public / 'RESULTS.md').write_text(text)
    print(text)


def opened(args):
    numbers = args.part or [int(path.parent.name.removeprefix('part-'))
                            for path in sorted(OPENINGS.glob('part-*/opened.json'))]
    return [part_of(one) for one in numbers]


def verify(args):
    from blind.second import report

    wrong = 0
    for part in opened(args):
        faults = [*sealing.faults(part), *report.faults(part), *_anew(part, args.cases)]
        wrong += len(faults)
        for fault in faults:
            print(f'{part.public.name}: {fault}')
        answers, bound = part.read('answers'), part.read('commitments')
        print(f'{part.public.name}: {len(bound)} cases, {len(answers)} answers, '
              f'{"all hashes and scores are right" if not faults else f"{len(faults)} faults"}')
    return int(wrong > 0)


def _anew(part, count):
    """Make some cases again and compare them bit for bit."""
    for identity, bound in _some(part, count):
        if sealing.content(sealing.made_anew(part, identity).arrays) != bound['case']:
            was, now = part.read('plan')['versions'], sealing.versions()
            differ = [f'{name} {was[name]}, here {now[name]}' for name in was
                      if was[name] != now[name]]
            yield (f'case {identity} comes out otherwise'
                   + (f'; made with {", ".join(differ)}' if differ else ''))


def _some(part, count):
    """Return the first cases that ran, real ones only where their recordings are."""
    if not count:
        return []
    answers, here = part.read('answers'), _has_recordings()
    return [(one, bound) for one, bound in part.read('commitments').items()
            if one in answers and (here or bound['generator'] != 'real')][:count]


def rerun(args):
    from blind.second import others, report, score

    differ = 0
    for part in opened(args):
        was = part.read('answers')
        path = AGAIN / part.public.name / 'answers.json'
        path.parent.mkdir(parents=True, exist_ok=True)
        again = read_json(path) if path.exists() else {}
        chosen = dict(_some(part, args.cases))
        left = [(part, one, bound) for one, bound in chosen.items() if one not in again]
        with ProcessPoolExecutor(args.jobs) as pool:
            for (_, one, _), answer in zip(left, pool.map(_asked_again, left)):
                again[one] = answer
                write_json(path, again)
                before, now = (_said(some[one]['document']) for some in (was, again))
                print(f'{part.public.name} {one}: {before}'
                      + ('' if now == before else f', now {now}'), flush=True)
        differ += sum(_said(again[one]['document']) != _said(was[one]['document'])
                      for one in chosen)
        labels = part.read('opened')['labels']
        figures = [report.plain(score.score(score.judged(
            labels, {one: some[one] for one in chosen})))
                   for some in (was, again)]
        print(f'{part.public.name}, {len(chosen)} of {len(was)} answered cases')
        print('\n'.join(others.against(*figures)), flush=True)
    print(f'{differ} answers differ')
    return int(differ > 0)


def _asked_again(job):
    import blind_second_tool

    part, identity, bound = job
    return blind_second_tool.answer(bound['generator'], sealing.made_anew(part, identity).arrays)


def compare(args):
    from blind.second import others, report, score

    parts = [part_of(one) for one in args.parts]
    every = [report.cases_of(part) for part in parts]
    shared = set.intersection(*({c.generator for c in cases} for cases in every))
    half = parts[1].read('plan')['half']
    print('\n'.join(others.against(*(report.plain(score.score(
        [c for c in cases if c.generator in shared], half)) for cases in every))))
    return 0


def _said(document):
    named = ', '.join(f'{one["name"]} {one["probability"]:.2f}'
                      for one in document.get('candidates', []))
    return f'{document["verdict"]}: {named}'


DO = {'make': seal, 'seal': seal, 'run': run, 'open': show, 'ask': ask, 'baselines': baselines}
"""What each step does."""

if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
