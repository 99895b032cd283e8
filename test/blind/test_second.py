"""The second edition: what verify finds, that cases come out again, and how they are drawn."""

import json
from pathlib import Path
import shutil

from blind.motion import Path as Trajectory
from blind.motion import TOUCH
from blind.noise import SIGMA
from blind.seal import read_json, SealError, write_json
from blind.second import case, kinds_development, on_rig, report, rules, sealing
from blind.second.judged import Judged
from blind.second.noise import draw_noise
from blind.second.sealing import Part
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.long

MECHANICS = ('pose_sag pendulum coiled_hose air_drag rail_friction seat_slip shifting_load gyro '
             'mid_stop tooth_ripple tip_power tip_stick')
ELECTRONICS = ('root_drift gain_warmup cubic_gain cross_square visco_creep mains code_ripple '
               'relay_steps slew_limit accel_square accel_product accel_walk')
MOUNTING = 'accel_lever sensor_offset yield_base floor_mode flange_warp speed_tilt'
"""As PROTOCOL.md lists them."""


def _short(seconds, rng):
    path = Trajectory()
    path.hold('settle', 0.3)
    path.go('move', 0.5, np.array([1.05, 0.03, 1.0]), rng.uniform(-0.4, 0.4, 3))
    path.go('approach', 0.4, np.array([TOUCH + 0.01, 0.03, 1.0]), np.zeros(3))
    path.go('contact', 0.3, np.array([TOUCH + 0.02, 0.05, 1.0]))
    path.go('retract', 0.4, np.array([1.0, 0.0, 1.0]))
    return path.commands()


@pytest.fixture(scope='module')
def short_motions():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(on_rig, 'trajectory', _short)
        yield


def _answer(name, p):
    return {'document': {
        'verdict': 'identified', 'reason': '', 'candidates': [{'name': name, 'probability': p}],
        'effects': [{'name': name, 'probability': p, 'parameters': {}}],
        'gap': {'closed': 0.9, 'closed_ci95': [0.8, 0.95]}, 'where': []}, 'cpu_seconds': 9.0}


@pytest.fixture(scope='module')
def opened_part(short_motions, tmp_path_factory):
    where = tmp_path_factory.mktemp('second')
    part = Part(where / 'part-1', where / 'private')
    sealing.begin(part, rules.DEVELOPMENT, {'rig': 3}, '')
    made = list(sealing.seal(part))
    sealing.start(part, {'commit': 'abc', 'files': 'def', 'changed': ''})
    for one in made:
        write_json(part.private / 'answers' / f'{one}.json', _answer('tool_mass', 0.8))
    sealing.open_labels(part)
    figures = report.figures_of([part])
    write_json(part.public / 'scores.json', report.plain(figures))
    (part.public / 'RESULTS.md').write_text(report.render(part, figures))
    return part


@pytest.fixture
def part(opened_part, tmp_path):
    return Part(Path(shutil.copytree(opened_part.public, tmp_path / 'part-1')),
                opened_part.private)


def _faults(part):
    return [*sealing.faults(part), *report.faults(part)]


def test_opened_part_verifies(part):
    assert _faults(part) == []


def test_published_parts_verify():
    pytest.importorskip('mujoco')
    published = sorted((ROOT / 'benchmark' / 'blind' / 'second').glob('part-*/opened.json'))
    if not published:
        pytest.skip('nothing has been opened yet')
    for path in published:
        assert _faults(Part(path.parent, Path())) == [], path.parent.name


def _label_of(document, key, value):
    next(iter(document['labels'].values()))[key] = value


@pytest.mark.parametrize('name, change, said', [
    ('answers', lambda d: next(iter(d.values())).update(_answer('tool_mass', 0.81)), 'answer'),
    ('answers', lambda d: d.pop(next(iter(d))), 'added or taken out'),
    ('opened', lambda d: _label_of(d, 'energy', 12.5), 'label'),
    ('opened', lambda d: d.update(master='another'), 'master'),
    ('opened', lambda d: d['nonces'].update(dict.fromkeys(d['nonces'], 'x')), 'label'),
    ('commitments', lambda d: d.update({'x': d.pop(next(iter(d)))}), 'cases'),
    ('scores', lambda d: d.update(right=d['right'] + 1), 'scores.json'),
    ])
def test_verify_finds_what_was_changed(part, name, change, said):
    path = part.public / f'{name}.json'
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    try:
        faults = _faults(part)
    except KeyError as error:  # a case that no label knows
        faults = [f'cases {error}']
    assert any(said in one for one in faults), faults


def test_case_comes_out_again_bit_for_bit(opened_part):
    identity, bound = next(iter(opened_part.read('commitments').items()))
    again = sealing.made_anew(opened_part, identity)
    assert sealing.content(again.arrays) == bound['case']
    moved = {**again.arrays, '0.wrench': np.nextafter(again.arrays['0.wrench'], 1e9)}
    assert sealing.content(moved) != bound['case']


def test_only_the_last_of_the_order_may_stay_without_answer(opened_part, tmp_path):
    public = Path(shutil.copytree(opened_part.public, tmp_path / 'part-1'))
    private = Path(shutil.copytree(opened_part.private, tmp_path / 'private'))
    (public / 'opened.json').unlink()
    order = list(read_json(public / 'commitments.json'))
    (private / 'answers' / f'{order[0]}.json').rename(tmp_path / 'kept.json')
    with pytest.raises(SealError, match='missing before'):
        sealing.open_labels(Part(public, private))
    (tmp_path / 'kept.json').rename(private / 'answers' / f'{order[0]}.json')
    (private / 'answers' / f'{order[-1]}.json').unlink()
    sealing.open_labels(Part(public, private))
    assert list(read_json(public / 'answers.json')) == order[:-1]


def test_part_tells_nothing_of_its_labels_before_it_is_opened(opened_part):
    master = read_json(opened_part.private / 'master.json')['master']
    for name in ('plan', 'commitments', 'run'):
        text = (opened_part.public / f'{name}.json').read_text()
        assert f'"{master}"' not in text and '"kind"' not in text
    for path in opened_part.private.glob('*.json'):
        assert path.stat().st_mode & 0o077 == 0


def test_backgrounds_and_effects_have_the_energies_that_were_drawn(short_motions):
    base = on_rig.OnRig(5, {})
    rng = np.random.default_rng(6)
    for name in ('pose_sag', 'mains', 'tip_stick'):
        both, energy, _ = case._law(base, kinds_development.KINDS[name], rng, rules.THIRD)
        scaled = base.of_law(both[1].times(np.sqrt(1234.0 / energy)))
        assert base.ground.net(scaled) == pytest.approx(1234.0, rel=1e-3), name
    for name in ('wrench_delay', 'tool_mass', 'cable_force'):
        size, energy = case._size(base, name, 400.0, 7, rules.MENDED)
        assert energy == pytest.approx(400.0, rel=0.3), name
        assert size > case.CERTAIN * base.nuisance(name)[1]


def test_energies_and_ratios_are_drawn_evenly_in_their_logarithm():
    drawn_by = rules.THIRD
    drawn = [case._drawn(np.random.default_rng(i), sorted(kinds_development.KINDS), on_rig.OnRig,
                         drawn_by) for i in range(2000)]
    for values, (low, high) in (
            ([e for d in drawn for e in d.background.values()], case.BACKGROUND),
            ([d.ratio for d in drawn], case.RATIO), ([d.alone for d in drawn], case.ALONE)):
        share = (np.log(values) - np.log(low)) / (np.log(high) - np.log(low))
        assert share.min() >= 0.0 and share.max() <= 1.0
        assert abs(share.mean() - 0.5) < 4 / np.sqrt(12 * len(share))
    for told, share in (([d.bare for d in drawn], drawn_by.bare['rig']),
                        ([d.begun > 0 for d in drawn], drawn_by.begun)):
        assert abs(np.mean(told) - share) < 4 * np.sqrt(0.25 / 2000)
    assert {len(d.background) for d in drawn} == {0, 3, 4, 5, 6}


def test_kinds_are_split_by_the_seed_of_the_protocol():
    rng, halves = np.random.default_rng(20261123), (set(), set())
    for group in (MECHANICS, ELECTRONICS, MOUNTING):
        names = rng.permutation(sorted(group.split())).tolist()
        halves[0].update(names[:len(names) // 2])
        halves[1].update(names[len(names) // 2:])
    assert set(rules.half(rules.DEVELOPMENT)[0]) == halves[0]
    assert set(rules.half(rules.SEALED)[0]) == halves[1]


def test_rough_noise_has_its_mean_level():
    rng = np.random.default_rng(3)
    loud = np.abs(np.sin(np.arange(40000) / 500.0))
    seen = set()
    for _ in range(12):
        one = draw_noise(rng, SIGMA, dict.fromkeys(SIGMA, 1000.0))['wrench'][0]
        white = one.whiten(one.draw(40000, 0.25, rng, loud), 0.25)
        seen.add((one.tail > 0, one.shaken > 0, one.bursts > 0))
        # a louder or heavier part counts for more, so that fewer samples tell the mean
        assert abs(np.mean(white**2) - 1) < 0.25, one
    assert len(seen) > 3


def _judged(kind, effect='', stated=(), **keys):
    label = {'generator': 'rig', 'kind': kind, 'effect': effect, 'excused': [], 'doubtful': [],
             'ambiguous': False, 'background': {'gyro': 100.0}, 'own': 0.0, 'energy': 1e4,
             'ratio': 100.0, 'onset': None, 'numbers': {}, **keys}
    named = [{'name': name, 'probability': p} for name, p in stated]
    return Judged('a', label, {'document': {'verdict': 'identified', 'candidates': named},
                               'cpu_seconds': 1.0})


@pytest.mark.parametrize('kind, effect, named, keys, right', [
    ('none', '', 'wrench_gain', {}, False),
    ('none', '', 'wrench_gain', {'excused': ['wrench_gain']}, True),
    # the effect itself is never excused by what resembles it
    ('library', 'wrench_gain', 'wrench_gain', {'excused': ['wrench_gain']}, True),
    ('library', 'tool_com', 'wrench_crosstalk', {'aliases': ['wrench_crosstalk']}, True),
    ('library', 'tool_com', 'wrench_crosstalk', {}, False),
    ('library', 'wrench_crosstalk', 'tool_com', {}, False),
    ('library', 'tool_mass', 'body_mass[gripper]', {}, True),
    ('library', 'base_tilt', 'kp[lift]', {}, False)])
def test_excused_names_and_aliases_count_as_the_label_says(kind, effect, named, keys, right):
    assert _judged(kind, effect, [(named, 0.9), ('unknown', 0.1)], **keys).right() == right
