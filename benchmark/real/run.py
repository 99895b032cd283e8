"""Recordings that others published, through the commands: what comes out, what least squares give.

    python benchmark/real/run.py DIR

DIR holds what you have fetched, one folder a source: the repositories and records that the files
`*.yaml` beside this script name, with their licences. Nothing of them is part of this package.
What is not there is skipped. Prints the table of benchmark/results/real.md.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from pathlib import Path
import re
import sys
import tempfile

from at_work import AT_WORK
from common import by_least_squares, G, ROOT, said, tool, write_table
import numpy as np
from scipy.spatial.transform import Rotation
import yaml

WRENCH = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
ORIENTATION = tuple(f'r{i}{j}' for i in '123' for j in '123')
PLACES = ((0.0, 0.0, 0.045), (0.02937, 0.02937, 0.05394), (-0.02937, 0.02937, 0.05394),
          (-0.02937, -0.02937, 0.05394), (0.02937, -0.02937, 0.05394))
"""Of the mass on the printed sensor, as its authors' program states them [m]."""


def calibrated(folder, wrench, R, *options):
    """Import poses, one row each, and calibrate."""
    write_table(folder / 'poses.csv', WRENCH + ORIENTATION,
                np.hstack([wrench, R.reshape(len(R), 9)]))
    spec = yaml.safe_load((ROOT / 'config/examples/kuka_poses.yaml').read_text())
    table = spec['tables'][0]
    table['file'] = 'poses.csv'
    del table['signals']['accel']
    (folder / 'import.yaml').write_text(yaml.safe_dump(spec))
    bag = folder / f'bag{len(list(folder.glob("bag*")))}'
    refused = said('import', folder / 'import.yaml', '--tables', folder, '-o', bag)
    return refused or said('calibrate', bag, '--gravity', G, '--json', '-o', folder / 'c.yaml',
                           *options)


def axia80(data, case, folder):
    pose, wrench = (np.loadtxt(data / name, delimiter=',') for name in case['files'])
    R = Rotation.from_quat(pose[:, 3:]).as_matrix()
    yield ('as recorded, in base', tool(calibrated(folder, wrench, R)),
           f'{by_least_squares(wrench[:, :3], R):.4f} kg')
    back = np.hstack([np.einsum('nji,nj->ni', R, wrench[:, i:i + 3]) for i in (0, 3)])
    yield ('turned back', tool(calibrated(folder, back, R)),
           f'{by_least_squares(back[:, :3], R):.4f} kg')


MECA500 = ((0.0, 0.0), (-90.0, -90.0), (0.0, 0.0), (-90.0, 0.0), (90.0, 0.0), (-90.0, 180.0))
"""Twist before each joint and the joint's zero, as the authors' program states them [deg]."""


def meca500_on_a_wall(data, case, folder):
    table = np.loadtxt(data / case['files'], delimiter=',')
    R = Rotation.identity(len(table))
    for joint, (twist, zero) in zip(table[:, :6].T, MECA500):
        R = R * Rotation.from_euler('x', twist, degrees=True)
        R = R * Rotation.from_euler('z', (joint + zero)[:, None], degrees=True)
    R = (R * Rotation.from_euler('z', 180.0, degrees=True)).as_matrix()
    wrench = table[:, 6:]
    found = calibrated(folder, wrench, R)
    yield ('as if base were level', tool(found), f'{by_least_squares(wrench[:, :3], R):.4f} kg')
    stated = re.search(r'--gravity-direction ([-\d.]+) ([-\d.]+) ([-\d.]+)', str(found))
    if stated:
        down = stated.groups()
        level, _ = Rotation.align_vectors([0, 0, -1], np.array(down, dtype=float))
        yield (f'`--gravity-direction {" ".join(down)}`',
               tool(calibrated(folder, wrench, R, '--gravity-direction', *down)),
               f'{by_least_squares(wrench[:, :3], level.as_matrix() @ R):.4f} kg')


def orientations_of_others(data, case, folder):
    wrenches, turns = (data / case['files']).read_text().split('<rotation matrices>')
    wrench = np.array([line.split()[1:] for line in wrenches.splitlines()[1:] if line.strip()],
                      dtype=float)
    R = np.array([re.findall(r'-?\d', line.split('.', 1)[1]) for line in turns.splitlines()
                  if line.strip()], dtype=float).reshape(-1, 3, 3)
    proper = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) < 0.1
    yield ('', tool(calibrated(folder, wrench[proper], R[proper])),
           f'{by_least_squares(wrench[proper, :3], R[proper]):.4f} kg')


def kuka_lbr_med(data, case, folder):
    table = np.genfromtxt(data / case['files'], delimiter=',', names=True)
    wrench = np.stack([table[name] for name in WRENCH], axis=1)
    R = np.stack([table[name] for name in ORIENTATION], axis=1).reshape(-1, 3, 3)
    for name in ('poses', 'baseline'):
        refused = said('import', ROOT / f'config/examples/kuka_{name}.yaml', '--tables', data,
                       '-o', folder / name)
        if refused:
            yield 'import', f'refused: {refused}', ''
            return
    known = folder / 'calibration.yaml'
    found = said('calibrate', folder / 'poses', '--gravity', '9.8209', '--json', '-o', known)
    yield 'poses', tool(found), f'{by_least_squares(wrench[:, :3], R) * G / 9.8209:.4f} kg'
    refused = said('estimate', folder / 'baseline', '--calibration', known,
                   '-o', folder / 'contact')
    if refused:
        yield 'free motion', f'refused: {refused}', ''
        return
    from forcecal_ros.io.bags import read_recording
    rms = []
    for bag, topics in (('contact', {'wrench': '/observer/contact_wrench'}), ('baseline', {})):
        recording = read_recording(folder / bag, topics)
        rms.append(recording.wrench.values[:, :3].std(axis=0))
    yield ('free motion', 'contact force, RMS ' + ' '.join(f'{x:.2f}' for x in rms[0]) + ' N',
           'measured ' + ' '.join(f'{x:.2f}' for x in rms[1]) + ' N')


def franka_panda(data, case, folder):
    table = np.loadtxt(data / case['files'], skiprows=1)
    R = Rotation.from_quat(table[:, [7, 8, 9, 6]]).inv().as_matrix()
    names, matrix = [f'c{k}' for k in range(19)], [f'r{k}' for k in range(9)]
    write_table(folder / 'motion.csv', names + matrix, np.hstack([table, R.reshape(-1, 9)]))
    plain = f'{by_least_squares(table[:, 13:16], R):.4f} kg'
    as_stated, turned = {'quaternion_xyzw': [*names[7:10], names[6]]}, {'R_base_sensor': matrix}
    for part, pose, options in (
            ('columns of base in the sensor, as if of the sensor in base', as_stated, ()),
            ('turned round', turned, ()),
            ('the same, `--wrench-sign -1`', turned, ('--wrench-sign', '-1'))):
        signals = {'wrench': {'frame': 'ft', 'force': {'columns': names[13:16], 'unit': 'N'},
                              'torque': {'columns': names[16:], 'unit': 'N m'}},
                   'pose': {'frame': 'base', **pose}}
        spec = {'format': 'forcecal-import/1',
                'tables': [{'file': 'motion.csv', 'rate': 1000.0, 'signals': signals}]}
        (folder / 'import.yaml').write_text(yaml.safe_dump(spec))
        bag = folder / f'{next(iter(pose))}{len(options)}'
        found = said('import', folder / 'import.yaml', '--tables', folder, '-o', bag) or said(
            'calibrate', bag, '--gravity', G, '--json', '-o', folder / 'c.yaml', *options)
        yield part, tool(found).replace(f'{folder}/', ''), plain


def franka_at_work(data, case, folder):
    part = {'columns': [f'force_{x}' for x in 'xyz'], 'unit': 'N'}
    turned = [f'current_orientation_{x}' for x in 'xyzw']
    for path in sorted((data / case['files']).glob('*.csv')):
        spec = {'format': 'forcecal-import/1', 'tables': [{
            'file': path.name, 'rate': 20, 'signals': {
                'wrench': {'frame': 'tool', 'force': part, 'torque': {
                    'columns': [f'torque_{x}' for x in 'xyz'], 'unit': 'N m'}},
                'pose': {'frame': 'base', 'quaternion_xyzw': turned, 'position': {
                    'columns': [f'current_pos_{x}' for x in 'xyz'], 'unit': 'm'}}}}]}
        (folder / 'import.yaml').write_text(yaml.safe_dump(spec))
        bag = folder / path.stem
        found = said('import', folder / 'import.yaml', '--tables', path.parent, '-o', bag) or said(
            'calibrate', bag, '--json', '-o', folder / 'c.yaml')
        table = np.genfromtxt(path, delimiter=',', names=True)
        R = Rotation.from_quat(np.stack([table[name] for name in turned], axis=1)).as_matrix()
        force = np.stack([table[name] for name in part['columns']], axis=1)
        yield path.stem, tool(found), f'{by_least_squares(force, R):.4f} kg'


def icub_foot(data, case, folder):
    spec = folder / 'foot.yaml'
    text = (ROOT / 'config/examples/insitu_icub_foot.yaml').read_text()
    spec.write_text(text.replace(case['files'], str(data / case['files'])))
    found = said('insitu', spec, '-o', folder / 'out', '--json', '--quiet')
    table = np.loadtxt(data / case['files'], delimiter=',', skiprows=1)
    table = table[(table[:, 0] > 21) & (table[:, 0] < 57)]
    x = np.column_stack([np.ones(len(table)), table[:, 7:10]])
    plain = np.linalg.lstsq(x, table[:, 1:4], rcond=None)[0][0]
    came = f'refused: {found}'
    if not isinstance(found, str):
        offset = found['sensors']['foot']['offset']
        came = 'offset ' + ' '.join(f'{value:.2f} +- {std:.2f}' for value, std in zip(
            offset['value'][:3], offset['std'][:3])) + ' N'
    yield '', came, 'window given: ' + ' '.join(f'{v:.2f}' for v in plain) + ' N'


def printed_sensor(data, case, folder):
    places = [[] for _ in PLACES]
    for path in sorted((data / case['files']).glob('data_*.csv')):
        rows = np.genfromtxt(path, delimiter=',', skip_header=1, invalid_raise=False)
        place = int(path.name[5])
        mass = 1.028 if place else 0.309
        places[place].append(np.concatenate([np.median(rows[:, 7:], axis=0),
                                             rows[0, 1:4] / mass]))
    names = [f's{k}' for k in range(8)]
    spec = yaml.safe_load((ROOT / 'config/examples/insitu_poses.yaml').read_text())
    spec |= {'gravity': G, 'sensors': {'cell': {'columns': names, 'unit': 'count'}}}
    for place, rows in enumerate(places):
        write_table(folder / f'place{place}.csv', (*names, 'gx', 'gy', 'gz'), rows)
    for out in range(len(PLACES)):
        spec['data_sets'] = [
            {'file': f'place{k}.csv', 'use': 'validate' if k == out else 'train',
             'added_mass': 1.028 if k else 0.309, 'position': list(PLACES[k])}
            for k in range(len(PLACES))]
        (folder / 'spec.yaml').write_text(yaml.safe_dump(spec))
        found = said('insitu', folder / 'spec.yaml', '-o', folder / 'out', '--json', '--quiet')
        came = found if isinstance(found, str) else found['sensors']['cell']['data_sets'][
            f'place{out}']['added_mass']
        yield (f'place {out} left out',
               f'refused: {came}' if isinstance(came, str) else
               f'{came["value"]:.3f} +- {came["std"]:.3f} kg',
               f'{_left_out(places, out):.3f} kg')


def _left_out(places, out):
    """Mass at a place by plain least squares on all others."""
    def known(k):
        rows = np.array(places[k])
        return np.column_stack([np.ones(len(rows)), rows[:, :8]]), rows[:, 8:]

    others = [k for k in range(len(places)) if k != out]
    x = np.vstack([known(k)[0] for k in others])
    force = np.vstack([known(k)[1] * (1.028 if k else 0.309) for k in others])
    mine, g = known(out)
    felt = mine @ np.linalg.lstsq(x, force, rcond=None)[0]
    return float((felt * g).sum() / (g ** 2).sum())


CASES = {one.__name__: one for one in (
    axia80, franka_at_work, franka_panda, icub_foot, kuka_lbr_med, meca500_on_a_wall,
    orientations_of_others, printed_sensor, *AT_WORK)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('folder', metavar='DIR', type=Path, help='what you have fetched')
    folder = parser.parse_args().folder
    print('| source, sensor | given | part | what came out | plain least squares | stated |\n'
          '|---|---|---|---|---|---|')
    for path in sorted(Path(__file__).parent.glob('*.yaml')):
        case = yaml.safe_load(path.read_text())
        data = folder / case['folder']
        if not data.is_dir():
            print(f'{path.stem}: {data} is absent; see {case["source"]}', file=sys.stderr)
            continue
        head = [f'[{path.stem}]({case["source"]}): {case["sensor"]}', case['given']]
        stated = case['stated']
        with tempfile.TemporaryDirectory() as temporary:
            for part, came, plain in CASES[case['run']](data, case, Path(temporary)):
                print('| ' + ' | '.join([*head, part, came, plain, stated]) + ' |', flush=True)
                head, stated = ['', ''], ''


if __name__ == '__main__':
    main()
