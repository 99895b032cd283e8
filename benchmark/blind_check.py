"""Check the diagnosis blind: make cases, run the tool on them, open the labels, score.

    python benchmark/blind_check.py --seeds development 40            work on the tool
    python benchmark/blind_check.py --seeds sealed 400 --none 200     the figures for the README
    python benchmark/blind_check.py second|verify|rerun|compare --help        the second edition

All four steps follow each other and go on where they were interrupted. A Dask cluster (--dask
tcp://host:8786) does the same work; its workers need this folder under the same name, and on
their PYTHONPATH.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# cases come out bit for bit on processors that round otherwise, too (PROTOCOL.md)
os.environ.setdefault('OPENBLAS_CORETYPE', 'Haswell')
os.environ.setdefault('NPY_DISABLE_CPU_FEATURES', 'X86_V4 AVX512_ICL AVX512_SPR')

import argparse
from pathlib import Path
import shutil
import sys

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'benchmark')]
os.environ['PYTHONPATH'] = os.pathsep.join(
    [str(ROOT), str(ROOT / 'benchmark'), os.environ.get('PYTHONPATH', '')])

from blind import compare, report, score, seal
import blind_tool
from forcecal_ros.cli.many import each
from forcecal_ros.core.errors import ForcecalError
from tqdm import tqdm

OPENINGS = ROOT / 'benchmark' / 'blind'


def main():
    if sys.argv[1:2] and sys.argv[1] in ('second', 'verify', 'rerun', 'compare'):
        import blind_second
        return blind_second.main(sys.argv[1:])
    args = parse()
    folder = args.run or ROOT / 'blind_runs' / f'{args.seeds}-{args.count}'
    labels = args.labels or folder.with_name(folder.name + '-labels')
    try:
        return work(args, folder, labels)
    except (seal.SealError, ForcecalError) as error:
        print(f'blind_check: {error}', file=sys.stderr)
        return 1


def parse():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', choices=(seal.DEVELOPMENT, seal.SEALED), required=True)
    parser.add_argument('count', type=int, help='cases')
    parser.add_argument('--none', type=int, help='of them without effect (default: a fifth)')
    parser.add_argument('--part', default='', help='another part of the development seeds')
    parser.add_argument('--seconds', type=float, default=30.0, help='length of a recording')
    parser.add_argument('--bags', type=int, default=20,
                        help='cases that go as real bags through the command')
    parser.add_argument('--run', type=Path, metavar='DIR', help='folder of the run')
    parser.add_argument('--labels', type=Path, metavar='DIR', help='folder of the labels')
    parser.add_argument('--baselines', action='store_true',
                        help='let simpler methods judge the same cases')
    parser.add_argument('--until', choices=('made', 'run'), help='stop after this step')
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--dask', default='', metavar='ADDRESS')
    return parser.parse_args()


def work(args, folder, labels):
    seal.prepare(folder, labels, args.seeds, args.count, args.seconds, args.none,
                 args.part)
    if not (folder / 'commitments.json').exists():
        go(seal.make, seal.jobs(folder, labels), 'making', args)
        seal.seal(folder, labels)
    if args.until == 'made':
        return 0
    left = seal.waiting(folder)
    if left:
        seal.start(folder, blind_tool.identity_of_tool())
        bags = set(list(seal.read_json(folder / 'commitments.json'))[:args.bags])
        go(blind_tool.answer, [(str(folder), one, one in bags) for one in left], 'diagnosing',
           args)
    if args.baselines:
        go(compare.judge_case, [(str(folder), one) for one in seal.read_json(
            folder / 'commitments.json')], 'baselines', args)
    if args.until == 'run':
        return 0
    found = seal.open_labels(folder, labels, OPENINGS / 'openings.jsonl')
    results = {one: seal.read_json(folder / 'results' / f'{one}.json') for one in found}
    figures = score.score(found, results)
    text = report.render(figures, seal.read_json(folder / 'plan.json'),
                         seal.read_json(folder / 'run.json'),
                         seal.read_json(folder / 'opened.json'))
    if args.baselines:
        text += compare.table(found, folder)
    (folder / 'RESULTS.md').write_text(text)
    report.draw(figures, folder)
    if args.seeds == seal.SEALED:
        keep(text, folder)
    print(text)
    return 0


def keep(text, folder):
    """Add an opening to those that were before it, whatever it says."""
    OPENINGS.mkdir(exist_ok=True)
    path = OPENINGS / 'RESULTS.md'
    number = len((OPENINGS / 'openings.jsonl').read_text().splitlines())
    before = path.read_text() if path.exists() else '# Openings of the blind check\n'
    pictures = [f'opening-{number}-{one}.png' for one in report.PICTURES]
    for name, one in zip(pictures, report.PICTURES):
        shutil.copy(folder / f'{one}.png', OPENINGS / name)
    path.write_text(before + '\n' + text + '\n' + '\n'.join(
        f'![{one}]({one})' for one in pictures) + '\n')


def go(function, items, what, args):
    done = each(function, items, jobs=args.jobs, dask=args.dask)
    failed = [outcome.error for outcome in tqdm(done, desc=what, total=len(items), disable=None)
              if outcome.error]
    if failed:
        raise ForcecalError(f'{len(failed)} of {len(items)} failed while {what}; the first: '
                            f'{failed[0]}; run again to go on')


if __name__ == '__main__':
    sys.exit(main())
